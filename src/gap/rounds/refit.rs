//! Fits of everything that a twin has, from the given values and from others (multistart).

use super::{Link, judged_rows};
use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        incident,
        known::excess,
        problem::{Point, Problem},
        whiten::{self, Filters},
    },
    twin::{Slot, StageKind, Twin},
};

/// Other starts that are fitted.
const OTHER_STARTS: usize = 2;

/// Steps of a fit from another start.
const RESTART_ITERATIONS: usize = 12;

/// Leaves out single samples off the rest, and what happened once, of the fitted and of the judging sessions with
/// their points.
pub(super) fn leave_out<'a>(
    kind: StageKind,
    train: (&mut Problem<'a>, &Point),
    held_out: (&mut Problem<'a>, &Point),
) {
    train.0.drop_outliers(train.1);
    held_out.0.drop_outliers(held_out.1);
    incident::leave_out_of(kind, train, held_out);
}

/// [`refit`], in agreement with the companions of `link`. If they contradict it, parameters that also act there keep
/// their given values and leave `slots`.
pub(super) fn refit_in_agreement<'a>(
    link: &Link<'a>,
    start: &Twin,
    (train, held_out): (&mut Problem<'a>, &mut Problem<'a>),
    (given, slots): (&Point, &mut Vec<Slot>),
) -> (Fit, Filters) {
    let (best, filters) = refit(link.kind, train, held_out, (given, slots));
    let companions = Problem::new(&link.companions, start).within(link.context);
    if !contradicts(&companions, start, &best.point.twin) {
        return (best, filters);
    }
    slots.retain(|slot| {
        let effect = start.instances[slot.instance].effect;
        !link.companions.iter().any(|stage| stage.calls(effect))
    });
    refit(link.kind, train, held_out, (given, slots))
}

/// Whether the `companions` object to a refit beyond chance: they prefer the given twin.
fn contradicts(companions: &Problem<'_>, given: &Twin, refitted: &Twin) -> bool {
    let scales = companions.filters(&companions.start(given.clone()), whiten::scale_filters);
    let [before, after] = judged_rows(companions, (given, refitted), &scales);
    companions.thresholds().is_in(&after, &before, &companions.blocks())
}

/// Everything that the twin has, fitted; what is off the rest is left out from then on.
fn refit<'a>(
    kind: StageKind,
    train: &mut Problem<'a>,
    held_out: &mut Problem<'a>,
    (given, slots): (&Point, &[Slot]),
) -> (Fit, Filters) {
    let (rough, filters) = fit::fit_from_afar(train, given.clone(), slots, 15);
    let judged = fit::on(held_out, &rough.point.twin, &filters);
    leave_out(kind, (train, &rough.point), (held_out, &judged));
    let (best, filters) = fit::settle(train, rough.point, slots, 10);
    from_deepest(train, (best, filters), given)
}

/// The fit itself, or what is found from other starts where that is better.
pub(super) fn from_deepest(
    train: &Problem<'_>,
    found: (Fit, Filters),
    given: &Point,
) -> (Fit, Filters) {
    match restarted(train, &found.0, given) {
        Some(better) => fit::settle(train, better, &found.0.slots, 10),
        None => found,
    }
}

/// The given twin with nothing but its nuisances fitted; `slots` are its known parameters.
pub(super) fn as_it_is(train: &Problem<'_>, given: &Point, slots: &[Slot]) -> (Fit, Filters) {
    let (mut kept, filters) = fit::settle(train, given.clone(), &[], 10);
    kept.slots = slots.to_vec();
    (kept, filters)
}

/// A refit can stop in a valley that is not the deepest: a spring far softer, a delay far longer than
/// before, and parameters that have made up for an effect that was missing until now. Where the rest is well
/// above what the given twin is known to leave, or nothing is known of that, everything that was given starts
/// again from its given values, and each of its effects from its probes; the best of them are fitted; the best
/// fit, when it is better.
fn restarted(train: &Problem<'_>, best: &Fit, given: &Point) -> Option<Point> {
    let thresholds = train.thresholds();
    if excess(&given.twin, [(train, &best.point)])
        .is_some_and(|excess| excess.most < thresholds.large_excess)
    {
        return None;
    }
    let scales = train.filters(&best.point, whiten::scale_filters);
    let loss = |point: &Point| fit::squared(&train.whitened(point, &scales));
    let mut anew = best.point.clone();
    for (own, instance) in anew.twin.instances.iter_mut().zip(&given.twin.instances) {
        own.values.clone_from(&instance.values);
    }
    let mut starts = vec![anew.clone()];
    for (index, instance) in given.twin.instances.iter().enumerate() {
        if !best.slots.iter().any(|slot| slot.instance == index) {
            continue;
        }
        for probe in instance.effect.probes {
            let mut point = anew.clone();
            for (parameter, value) in probe.iter().enumerate() {
                point.twin.set(Slot { instance: index, parameter }, *value);
            }
            starts.push(point);
        }
    }
    let losses = in_parallel(&starts, loss);
    let mut order: Vec<usize> = (0..starts.len()).collect();
    order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
    let nearest: Vec<Point> =
        order.into_iter().take(OTHER_STARTS).map(|index| starts[index].clone()).collect();
    let fits = in_parallel(&nearest, |start| {
        fit::fit(train, start.clone(), &best.slots, &scales, RESTART_ITERATIONS)
    });
    fits.into_iter()
        .min_by(|a, b| a.loss.total_cmp(&b.loss))
        .filter(|found| found.loss < (1.0 - thresholds.clear_gain) * loss(&best.point))
        .map(|found| found.point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Domain, Effect},
        seed::Stream,
        twin::{Channel, Machine, Stage},
    };

    /// A link whose signal is `striker_mass` times a sine.
    struct Swing(Vec<Channel>);

    impl Swing {
        /// 20 s at 100 Hz of a machine with a mass of 1, with noise of RMS 0.1.
        fn of_mass_one(seed: u64) -> Self {
            let mut random = Stream::new(seed, "swing");
            let times: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
            let noise = |_: &f64| f64::from(random.uniform_f32(-0.17, 0.17));
            let noise: Vec<f64> = times.iter().map(noise).collect();
            let measured = times.iter().zip(noise).map(|(time, noise)| time.sin() + noise);
            Self(vec![Channel {
                signal: "camera.striker_x".into(),
                unit: "m",
                domain: Domain::Sensor,
                axis: "x",
                rate_hz: 100.0,
                measured: measured.collect(),
                times,
                runs: std::iter::once(0..2000).collect(),
            }])
        }
    }

    impl Stage for Swing {
        fn kind(&self) -> StageKind {
            StageKind::Camera
        }

        fn channels(&self) -> &[Channel] {
            &self.0
        }

        fn calls(&self, _effect: &Effect) -> bool {
            false
        }

        fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
            let times = self.0[0].times.iter();
            predicted[0] = times.map(|time| twin.striker_mass * time.sin()).collect();
        }
    }

    #[test]
    fn another_link_contradicts_a_refit_that_predicts_it_worse_beyond_chance() {
        let twin = |mass: f64| Twin { striker_mass: mass, ..Twin::nominal(Machine::Table) };
        let contradictions = |given: f64, refitted: f64| {
            let seeds: Vec<u64> = (0..20).collect();
            let answers = in_parallel(&seeds, |seed| {
                let stage = Swing::of_mass_one(*seed);
                let companions = Problem::new(&[&stage as &dyn Stage], &twin(given));
                contradicts(&companions, &twin(given), &twin(refitted))
            });
            answers.into_iter().filter(|own| *own).count()
        };
        assert_eq!(contradictions(1.0, 1.2), 20);
        // The refit is right, nearer than the given twin, or changes nothing here.
        assert_eq!(contradictions(1.2, 1.0), 0);
        assert_eq!(contradictions(0.9, 1.05), 0);
        assert_eq!(contradictions(1.2, 1.2), 0);
        let nothing = Problem::new(&[], &twin(1.0));
        assert!(!contradicts(&nothing, &twin(1.0), &twin(1.2)));
    }
}
