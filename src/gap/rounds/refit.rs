//! Fits of everything that a twin has, from the given values and from others (multistart).

use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        incident,
        known::excess,
        problem::{Point, Problem},
        whiten::{self, Filters},
    },
    twin::{Slot, StageKind},
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

/// Everything that the twin has, fitted; what is off the rest is left out from then on.
pub(super) fn refit<'a>(
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
