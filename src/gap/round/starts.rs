//! First fits of the candidates, from several starts.

use super::{IDLE, Stand, slots_of_last};
use crate::{
    gap::{
        batch::in_parallel,
        fit::{self, Fit},
        problem::{Point, Problem},
        screen::{self, Candidate},
        whiten::Filters,
    },
    twin::StageKind,
};

/// So many probes of an effect say that its size has no slope.
const MANY_PROBES: usize = 6;

/// Places at which an effect that sits in one is fitted beside the place to which the screen leads.
const OTHER_PLACES: usize = 3;

/// Factors of a size without slope that are tried beside it, and how often.
const AWAY: [f64; 8] = [0.7, 0.82, 0.9, 0.96, 1.04, 1.1, 1.2, 1.4];
const ACROSS_STEPS: usize = 3;

/// Fits of all on the short list, each from the nearest of its starts.
pub(super) fn rough_fits(train: &Problem<'_>, stand: &Stand<'_>, short: &[Candidate]) -> Vec<Fit> {
    let columns =
        |fit: &Fit| train.columns(&train.evaluated(fit.point.clone()), &fit.slots, stand.filters);
    let mut bases = vec![(stand.base, columns(stand.base))];
    bases.extend(stand.given.map(|(given, _)| (given, columns(given))));
    in_parallel(short, |candidate| {
        let fit = fitted(train, &bases, candidate, stand.filters);
        train.context.observer.candidate_done();
        fit
    })
}

/// The candidate's effect added to each of several bases at the nearest of its sizes, everything fitted together, and
/// the best of that: what known parameters have made up for may lead astray. With each base come the columns of its
/// known parameters.
fn fitted(
    train: &Problem<'_>,
    bases: &[(&Fit, Vec<Vec<f64>>)],
    candidate: &Candidate,
    filters: &Filters,
) -> Fit {
    // The line of the screen may lead too far for what bends: what is nearer to nothing is a start too.
    let sizes = screen::towards_null(candidate);
    let fits = bases.iter().filter_map(|(base, known)| {
        let nothing = fit::squared(&train.whitened(&base.point, filters));
        let starts = sizes.iter().map(|values| {
            let twin = screen::with(&base.point.twin, candidate.effect, candidate.axis, values);
            let point = Point { twin, nuisance: base.point.nuisance.clone() };
            let loss = fit::squared(&train.whitened(&point, filters));
            // From a limit that is never reached no slope leads anywhere.
            let is_idle = (loss - nothing).abs() <= IDLE * nothing;
            (is_idle, loss, point)
        });
        let (.., point) = starts.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        let mut slots = bases[0].0.slots.clone();
        slots.extend(slots_of_last(&point.twin));
        let how = fit::How { filters, iterations: 10, known };
        Some((fit::fit_with(train, point, &slots, &how), how))
    });
    let best = fits.min_by(|a, b| a.0.loss.total_cmp(&b.0.loss));
    let (found, how) = best.expect("there is a base, and sizes to start from");
    let found = from_other_starts(train, found, candidate, &how);
    if candidate.effect.probes.len() < MANY_PROBES {
        return found;
    }
    // Whole rolls have valleys everywhere: what happens early in one is amplified.
    let is_whole = train.parts.iter().any(|part| part.stage.kind() == StageKind::WholeRolls);
    let found = match candidate.effect.is_localized() && !is_whole {
        true => from_other_places(train, found, candidate, &how),
        false => found,
    };
    across_steps(train, found, &how)
}

/// The fit, or a better one from the other values of a parameter that was scanned for.
fn from_other_starts(
    train: &Problem<'_>,
    found: Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let starts: Vec<Point> =
        candidate.other_starts.iter().map(|start| with_last(&found.point, start)).collect();
    from_starts(train, found, starts, how)
}

/// The fit, or a better one from another place of an effect that sits in one: from afar nothing leads there.
fn from_other_places(
    train: &Problem<'_>,
    found: Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let tries = candidate.effect.probes.iter().map(|probe| {
        let point = with_last(&found.point, probe);
        (fit::squared(&train.whitened(&point, how.filters)), point)
    });
    let mut tries: Vec<_> = tries.collect();
    tries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let starts = tries.into_iter().take(OTHER_PLACES).map(|(_, point)| point).collect();
    from_starts(train, found, starts, how)
}

/// `point` with the numbers `values` of the effect that was added last.
fn with_last(point: &Point, values: &[f64]) -> Point {
    let mut point = point.clone();
    let slots = slots_of_last(&point.twin);
    slots.iter().zip(values).for_each(|(slot, value)| point.twin.set(*slot, *value));
    point
}

/// The fit, or the best one from `starts` where that is better.
fn from_starts(train: &Problem<'_>, found: Fit, starts: Vec<Point>, how: &fit::How<'_>) -> Fit {
    let fits = starts.into_iter().map(|point| fit::fit_with(train, point, &found.slots, how));
    let best = fits.min_by(|a, b| a.loss.total_cmp(&b.loss));
    best.filter(|best| best.loss < found.loss).unwrap_or(found)
}

/// The fit, or a better one found by trying the size of the last effect at several distances: a threshold has no
/// slope to follow between two values at which something passes it.
fn across_steps(train: &Problem<'_>, mut found: Fit, how: &fit::How<'_>) -> Fit {
    for _ in 0..ACROSS_STEPS {
        let Some(size) = slots_of_last(&found.point.twin).first().copied() else { break };
        let tries = AWAY.map(|factor| {
            let mut point = found.point.clone();
            point.twin.set(size, factor * found.point.twin.get(size));
            (fit::squared(&train.whitened(&point, how.filters)), point)
        });
        let nearest = tries.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let nearest = nearest.filter(|(loss, _)| *loss < found.loss);
        let Some((_, point)) = nearest else { break };
        found = fit::fit_with(train, point, &found.slots, how);
    }
    found
}
