//! Refits of all known parameters, from the given values and from other starts (multistart).

use super::{Search, StageData, few_changes};
use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        incident,
        known::excess,
        problem::{Point, Problem},
        round::View,
        whiten::{self, Filters},
    },
    twin::{Machine, Slot, StageKind, Twin},
};

/// Most other starts that are fitted. A larger number finds more distant minima and costs one fit each.
const OTHER_STARTS: usize = 2;

/// Iterations of a fit from another start.
const RESTART_ITERATIONS: usize = 12;

/// Iterations of each fit of all known parameters from the given values.
const DISTANT_ITERATIONS: usize = 15;

/// Exclude outliers (single samples) and one-off disturbances of the training and validation sessions, each with its
/// point.
pub(super) fn exclude_outliers<'a>(
    kind: StageKind,
    train: (&mut Problem<'a>, &Point),
    held_out: (&mut Problem<'a>, &Point),
) {
    train.0.drop_outliers(train.1);
    held_out.0.drop_outliers(held_out.1);
    incident::exclude_from(kind, train, held_out);
}

/// [`refit`], in agreement with the companions of `data`. If they contradict it, parameters that also act there keep
/// their given values and leave `slots`.
pub(super) fn refit_in_agreement<'a>(
    data: &StageData<'a>,
    start: &Twin,
    (train, held_out): (&mut Problem<'a>, &mut Problem<'a>),
    (given, slots): (&Point, &mut Vec<Slot>),
) -> (Fit, Filters) {
    let (best, filters) = refit(data.kind, train, held_out, (given, slots));
    let Some(companion) = data.companions.first() else { return (best, filters) };
    let companions = Problem::new(&data.companions, start).within(data.context);
    let only_there = |twin: &Twin| -> Vec<Slot> {
        let here = twin.free(data.train[0]);
        twin.free(*companion).into_iter().filter(|slot| !here.contains(slot)).collect()
    };
    if !contradict(&companions, only_there, [start, &best.point.twin]) {
        return (best, filters);
    }
    slots.retain(|slot| {
        let effect = start.instances[slot.instance].effect;
        !data.companions.iter().any(|stage| stage.calls(effect))
    });
    refit(data.kind, train, held_out, (given, slots))
}

/// Return whether the `companions` prefer `start` to the `refitted` twin beyond chance, each with the parameters that only the
/// companions determine fitted to them: those that `own` lists. Otherwise a soft spring of the magnet that was fitted to the
/// lag of the load would contradict the soft belt that causes it.
fn contradict(
    companions: &Problem<'_>,
    own: impl Fn(&Twin) -> Vec<Slot>,
    [start, refitted]: [&Twin; 2],
) -> bool {
    let scales = companions.filters(&companions.start(start.clone()), whiten::scale_filters);
    let fitted = |twin: &Twin| {
        let point = companions.start(twin.clone());
        fit::fit(companions, point, &own(twin), &scales, RESTART_ITERATIONS).point.twin
    };
    let start = fitted(start);
    // From the same values: fits from others may end in other minima.
    let mut refitted = refitted.clone();
    own(&refitted).into_iter().for_each(|slot| refitted.set(slot, start.get(slot)));
    View::new(companions, &start).contradicts(&fitted(&refitted))
}

/// Fit all known parameters; outliers and one-off disturbances of the rough fit are excluded from then on.
fn refit<'a>(
    kind: StageKind,
    train: &mut Problem<'a>,
    held_out: &mut Problem<'a>,
    (given, slots): (&Point, &[Slot]),
) -> (Fit, Filters) {
    let (rough, filters) = distant_fit(train, given, slots);
    let validated = fit::on(held_out, &rough.point.twin, &filters);
    exclude_outliers(kind, (train, &rough.point), (held_out, &validated));
    let (best, filters) = fit::converge(train, rough.point, slots, 10);
    multistart(train, (best, filters), given)
}

/// Fit of all known parameters from the given values. If it leaves more than the reference residual, the fit from
/// [few changes](few_changes) is used where it leaves clearly less: an effect that is missing may resemble a change.
fn distant_fit(train: &Problem<'_>, given: &Point, slots: &[Slot]) -> (Fit, Filters) {
    let found = fit::fit_from_distant_start(train, given.clone(), slots, DISTANT_ITERATIONS);
    let (twin, thresholds) = (&given.twin, train.thresholds());
    let excess = excess(twin, [(train, &found.0.point)]);
    if twin.reference_residuals.is_empty() || thresholds.is_at_reference(excess) {
        return found;
    }
    let start = few_changes::start(train, given, slots);
    let other = fit::fit_from_distant_start(train, start, slots, DISTANT_ITERATIONS);
    let scales = train.filters(&found.0.point, whiten::scale_filters);
    let loss = |fit: &Fit| fit::squared(&train.whitened(&fit.point, &scales));
    let is_less = loss(&other.0) < (1.0 - thresholds.clear_gain) * loss(&found.0);
    if is_less { other } else { found }
}

/// The fit `found`, or that of a better start (multistart).
pub(super) fn multistart(
    train: &Problem<'_>,
    found: (Fit, Filters),
    given: &Point,
) -> (Fit, Filters) {
    match best_restart(train, &found.0, given) {
        Some(better) => fit::converge(train, better, &found.0.slots, 10),
        None => found,
    }
}

impl Search<'_> {
    /// Fit of the known parameters but for shape parameters that are not plausible in the best fit, which keep their given
    /// values; `None` where all are, and on a table. Until an effect that is missing is added, a fit far away may describe the
    /// data best: a fast integral action makes a proportional controller with a lag. No slope leads back from there. A
    /// table is calibrated before.
    pub(super) fn plausible(&self, given: &Point) -> Option<(Fit, Filters)> {
        let twin = &self.best.point.twin;
        let is_plausible = |slot: &Slot| {
            let parameter = &twin.instances[slot.instance].effect.parameters[slot.parameter];
            let (least, most) = parameter.plausible;
            slot.parameter == 0
                || given.twin.instances.len() <= slot.instance
                || (least..=most).contains(&twin.get(*slot))
        };
        let slots = self.best.slots.iter().copied();
        let free: Vec<Slot> = slots.filter(is_plausible).collect();
        if twin.machine == Machine::Table || free.len() == self.best.slots.len() {
            return None;
        }
        let start = with_given_values(self.best.point.clone(), given);
        let (mut found, filters) = fit::converge(&self.train, start, &free, 10);
        found.slots.clone_from(&self.best.slots);
        Some((found, filters))
    }
}

/// Given twin with only its nuisances fitted; `slots` are its known parameters.
pub(super) fn with_nuisances_only(
    train: &Problem<'_>,
    given: &Point,
    slots: &[Slot],
) -> (Fit, Filters) {
    let (mut kept, filters) = fit::converge(train, given.clone(), &[], 10);
    kept.slots = slots.to_vec();
    (kept, filters)
}

/// Better fit of the same parameters from another start, if there is one. A fit can stop in a local
/// minimum: a spring far softer, a delay far longer, or parameters that compensated for an effect
/// that was missing until now. A large change of one parameter can also displace others. The starts
/// are the given values, also with one effect as fitted. If the residual is far above its
/// reference, or has none, they are also the probes of each effect.
fn best_restart(train: &Problem<'_>, best: &Fit, given: &Point) -> Option<Point> {
    let thresholds = train.thresholds();
    let is_far = excess(&given.twin, [(train, &best.point)])
        .is_none_or(|excess| thresholds.large_excess <= excess.most);
    let scales = train.filters(&best.point, whiten::scale_filters);
    let loss = |point: &Point| fit::squared(&train.whitened(point, &scales));
    let mut starts = starts_with_one_change(best, given);
    if is_far {
        starts.extend(starts_at_probes(&starts[0], best, given));
    }
    let losses = in_parallel(&starts, loss);
    let mut order: Vec<usize> = (0..starts.len()).collect();
    order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
    let (reached, before) = (loss(&best.point), loss(given));
    // Near the reference, only a start that explains most of the gap by itself is worth a fit.
    let most = reached + (1.0 - thresholds.majority) * (before - reached);
    let promising = order.into_iter().filter(|index| is_far || losses[*index] < most);
    let chosen: Vec<Point> =
        promising.take(OTHER_STARTS).map(|index| starts[index].clone()).collect();
    let fits = in_parallel(&chosen, |start| {
        let how = fit::How::start(&scales, RESTART_ITERATIONS);
        fit::fit_with(train, start.clone(), &best.slots, &how)
    });
    let gain = if is_far { thresholds.clear_gain } else { thresholds.min_gain };
    fits.into_iter()
        .min_by(|a, b| a.loss.total_cmp(&b.loss))
        .filter(|found| found.loss < (1.0 - gain) * reached)
        .map(|found| found.point)
}

/// Starts of [`best_restart`]: the given effects at their given values, and the same with one of them as fitted. The last
/// ones are the fit with one parameter of the given effects at its null value.
fn starts_with_one_change(best: &Fit, given: &Point) -> Vec<Point> {
    let as_given = with_given_values(best.point.clone(), given);
    let changed = fitted_instances(best, given).map(|index| {
        let mut point = as_given.clone();
        point.twin.instances[index].values.clone_from(&best.point.twin.instances[index].values);
        point
    });
    let is_given = |slot: &&Slot| slot.instance < given.twin.instances.len();
    let nulled = best.slots.iter().filter(is_given).filter_map(|slot| at_null(&best.point, *slot));
    std::iter::once(as_given.clone()).chain(changed).chain(nulled).collect()
}

/// `point` with the effects of the `given` twin at their given values.
fn with_given_values(mut point: Point, given: &Point) -> Point {
    for (own, instance) in point.twin.instances.iter_mut().zip(&given.twin.instances) {
        own.values.clone_from(&instance.values);
    }
    point
}

/// `point` with the parameter `slot` at its null value; `None` where its effect cannot do without it, or already does.
pub(in crate::gap) fn at_null(point: &Point, slot: Slot) -> Option<Point> {
    let null = point.twin.instances[slot.instance].effect.null[slot.parameter];
    (0 < slot.parameter && point.twin.get(slot) != null).then(|| {
        let mut point = point.clone();
        point.twin.set_to_null(slot);
        point
    })
}

/// Starts of [`best_restart`]: `as_given` with the fitted parameters of one effect at one of its probes.
fn starts_at_probes(as_given: &Point, best: &Fit, given: &Point) -> Vec<Point> {
    let mut starts = Vec::new();
    for index in fitted_instances(best, given) {
        let own = || best.slots.iter().filter(|slot| slot.instance == index);
        let probes = given.twin.instances[index].effect.probes.iter();
        starts.extend(probes.map(|probe| at_probe(as_given, own(), probe)));
    }
    starts
}

/// `point` with the values that a `probe` of their effect has for `slots`.
pub(super) fn at_probe<'s>(
    point: &Point,
    slots: impl IntoIterator<Item = &'s Slot>,
    probe: &[f64],
) -> Point {
    let mut point = point.clone();
    slots.into_iter().for_each(|slot| point.twin.set(*slot, probe[slot.parameter]));
    point
}

/// Indices of the given instances with a fitted parameter.
fn fitted_instances(best: &Fit, given: &Point) -> impl Iterator<Item = usize> {
    let is_fitted = |index: &usize| best.slots.iter().any(|slot| slot.instance == *index);
    (0..given.twin.instances.len()).filter(is_fitted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::test_stage::{CAMERA_NOISE_RMS, CAMERA_SIGNAL, TestStage, first_parameters},
        twin::{Instance, Machine, ReferenceResidual, Source, Stage},
    };
    use std::f64::consts::TAU;

    #[test]
    fn another_stage_contradicts_a_refit_that_predicts_it_worse_beyond_chance() {
        let twin = |mass: f64| Twin { striker_mass: mass, ..Twin::nominal(Machine::Table) };
        let contradictions = |given: f64, refitted: f64| {
            let seeds: Vec<u64> = (0..20).collect();
            let answers = in_parallel(&seeds, |seed| {
                let predict = |twin: &Twin, time: f64| twin.striker_mass * time.sin();
                let stage = TestStage::camera(&twin(1.0), predict, *seed);
                let companions = Problem::new(&[&stage as &dyn Stage], &twin(given));
                contradict(&companions, |_| Vec::new(), [&twin(given), &twin(refitted)])
            });
            answers.into_iter().filter(|own| *own).count()
        };
        assert_eq!(contradictions(1.0, 1.2), 20);
        // The refit is right, or nearer than the given twin, or changes nothing on this stage.
        assert_eq!(contradictions(1.2, 1.0), 0);
        assert_eq!(contradictions(0.9, 1.05), 0);
        assert_eq!(contradictions(1.2, 1.2), 0);
        let nothing = Problem::new(&[], &twin(1.0));
        assert!(!contradict(&nothing, |_| Vec::new(), [&twin(1.0), &twin(1.2)]));
    }

    #[test]
    fn what_only_another_stage_determines_is_fitted_before_it_contradicts() {
        // The sum of friction and mass: a change of the friction had been taken for one of the mass.
        let twin = |friction: f64, mass: f64| {
            let mut twin = Twin::nominal(Machine::Axis);
            let values = [friction, mass];
            slots_of(&twin).into_iter().zip(values).for_each(|(slot, own)| twin.set(slot, own));
            twin
        };
        let sum = |twin: &Twin, time: f64| {
            let [friction, mass] = slots_of(twin).map(|slot| twin.get(slot));
            (friction + mass) * time.sin()
        };
        let stage = TestStage::camera(&twin(3.0, 1.0), sum, 5);
        let twins = [&twin(1.0, 3.0), &twin(3.0, 3.0)];
        let companions = Problem::new(&[&stage as &dyn Stage], twins[0]);
        assert!(contradict(&companions, |_| Vec::new(), twins));
        assert!(!contradict(&companions, |twin| slots_of(twin)[1..].to_vec(), twins));
    }

    const SMALL_AMPLITUDE: f64 = 0.05;

    fn slots_of(twin: &Twin) -> [Slot; 2] {
        first_parameters(twin, ["drive.friction.coulomb", "gantry.inertia"])
    }

    /// Sum of two sines. Coulomb friction is the amplitude of one, mass the frequency (Hz) of the other.
    fn two_sines(twin: &Twin, time: f64) -> f64 {
        let [amplitude, frequency] = slots_of(twin).map(|slot| twin.get(slot));
        amplitude * time.sin() + SMALL_AMPLITUDE * (TAU * frequency * time).sin()
    }

    #[test]
    fn a_parameter_that_the_change_of_another_displaced_returns() {
        const AMPLITUDES: [f64; 2] = [1.0, 3.0];
        const FREQUENCY_HZ: f64 = 5.0;
        let twin_at = |amplitude: f64, frequency: f64| {
            let mut twin = Twin::nominal(Machine::Axis);
            let [first, second] = slots_of(&twin);
            twin.set(first, amplitude);
            twin.set(second, frequency);
            // The displaced frequency leaves a quarter more than the noise.
            twin.reference_residuals = vec![ReferenceResidual {
                signal: CAMERA_SIGNAL.into(),
                residual_rms: CAMERA_NOISE_RMS,
                searched: true,
            }];
            twin
        };
        let [given, truth] = AMPLITUDES.map(|amplitude| twin_at(amplitude, FREQUENCY_HZ));
        let stage = TestStage::camera(&truth, two_sines, 3);
        let train = Problem::new(&[&stage as &dyn Stage], &given);
        let given = train.start(given);
        let fit_at = |amplitude: f64, frequency: f64| {
            let point = train.start(twin_at(amplitude, frequency));
            let slots = slots_of(&point.twin).to_vec();
            Fit { point, slots, loss: 0.0, rows: 2000 }
        };
        let better = best_restart(&train, &fit_at(2.99, 5.7), &given).unwrap();
        let [amplitude, frequency] = slots_of(&better.twin).map(|slot| better.twin.get(slot));
        assert!((amplitude - AMPLITUDES[1]).abs() < 0.02, "{amplitude}");
        assert!((frequency - FREQUENCY_HZ).abs() < 0.01, "{frequency}");
        let (best, _) = fit::converge(&train, better, &slots_of(&given.twin), RESTART_ITERATIONS);
        assert!(best_restart(&train, &best, &given).is_none(), "the optimum has no better start");
    }

    /// Sum of three sines. The first two have the frequencies (Hz) Coulomb friction and mass, the third the angular
    /// frequency (rad/s) of the integral rate, if it is not zero.
    fn three_sines(twin: &Twin, time: f64) -> f64 {
        const AMPLITUDE: f64 = 0.3;
        let [first, second] = slots_of(twin).map(|slot| twin.get(slot));
        let third = twin.get(integral_rate_of(twin));
        (TAU * first * time).sin() + (TAU * second * time).sin() + AMPLITUDE * (third * time).sin()
    }

    fn integral_rate_of(twin: &Twin) -> Slot {
        let [time_constant] = first_parameters(twin, ["drive.velocity_controller"]);
        Slot { parameter: 1, ..time_constant }
    }

    #[test]
    fn a_parameter_that_compensated_for_a_missing_effect_returns_to_its_null_value() {
        let twin_at = |frequencies: [f64; 2], rate: f64| {
            let mut twin = Twin::nominal(Machine::Axis);
            let controller = find("drive.velocity_controller").unwrap();
            twin.instances.push(Instance::new(
                controller,
                Axis::Single,
                &[0.0, rate],
                Source::Fitted,
            ));
            for (slot, frequency) in slots_of(&twin).into_iter().zip(frequencies) {
                twin.set(slot, frequency);
            }
            twin
        };
        let (given, truth) = (twin_at([5.0, 7.0], 0.0), twin_at([5.6, 7.7], 0.0));
        let stage = TestStage::camera(&truth, three_sines, 3);
        let train = Problem::new(&[&stage as &dyn Stage], &given);
        let given = train.start(given);
        let found = twin_at([5.6, 7.7], 50.0);
        let mut slots = slots_of(&found).to_vec();
        slots.push(integral_rate_of(&found));
        let fit = Fit { point: train.start(found), slots, loss: 0.0, rows: 2000 };
        // Parameters that are at their null value, and magnitudes, give no start.
        let starts = starts_with_one_change(&fit, &given);
        assert!(at_null(&given, integral_rate_of(&given.twin)).is_none());
        assert!(fit.slots[..2].iter().all(|slot| at_null(&fit.point, *slot).is_none()));
        assert_eq!(starts.len(), 5);
        let better = best_restart(&train, &fit, &given).unwrap();
        let rate = better.twin.get(integral_rate_of(&better.twin));
        assert!(rate.abs() < 0.01, "{rate}");
    }

    #[test]
    fn starts_at_probes_leave_what_is_not_fitted() {
        const WIDTH: f64 = 1.3e-3;
        let backlash = find("drive.backlash").unwrap();
        let twin = Twin {
            instances: vec![Instance::new(backlash, Axis::Motors, &[WIDTH, 50.0], Source::Fitted)],
            ..Twin::nominal(Machine::Table)
        };
        let given = Point { twin, nuisance: Vec::new() };
        let slots = vec![Slot { instance: 0, parameter: 1 }];
        let best = Fit { point: given.clone(), slots, loss: 0.0, rows: 2000 };
        let starts = starts_at_probes(&given, &best, &given);
        let values = |start: &Point| start.twin.instances[0].numbers();
        assert!(starts.iter().all(|start| values(start)[0] == WIDTH));
        assert!(starts.iter().any(|start| values(start)[1] == 3.0));
    }
}
