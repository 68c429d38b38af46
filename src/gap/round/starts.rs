//! First fits of the candidates, from several starts.

use super::{IDLE, RoundStart, slots_of_last};
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

/// Number of probes from which an effect has a magnitude without slope.
const MANY_PROBES: usize = 6;

/// Positions at which a localized effect is fitted in addition to that of the screen.
const OTHER_POSITIONS: usize = 3;

/// Factors of a magnitude without slope that are tried, and number of repetitions.
const MAGNITUDE_FACTORS: [f64; 8] = [0.7, 0.82, 0.9, 0.96, 1.04, 1.1, 1.2, 1.4];
const MAGNITUDE_SEARCHES: usize = 3;

/// Fits of all candidates on the short list, each from its start with the smallest loss.
pub(super) fn rough_fits(
    train: &Problem<'_>,
    round_start: &RoundStart<'_>,
    short: &[Candidate],
) -> Vec<Fit> {
    let columns = |fit: &Fit| {
        train.columns(&train.evaluated(fit.point.clone()), &fit.slots, round_start.filters)
    };
    let mut bases = vec![(round_start.base, columns(round_start.base))];
    bases.extend(round_start.given.map(|(given, _)| (given, columns(given))));
    in_parallel(short, |candidate| {
        let fit = fitted(train, &bases, candidate, round_start.filters);
        train.context.observer.candidate_done();
        fit
    })
}

/// Best fit with the candidate's effect, from each of several bases and its magnitude with the smallest loss,
/// everything fitted together. Several bases are needed because known parameters may have compensated for the effect.
/// Each base comes with the columns of its known parameters.
fn fitted(
    train: &Problem<'_>,
    bases: &[(&Fit, Vec<Vec<f64>>)],
    candidate: &Candidate,
    filters: &Filters,
) -> Fit {
    // The linearization of the screen may overshoot for a nonlinear effect: smaller magnitudes are starts too.
    let magnitudes = screen::starts_towards_null(candidate);
    let fits = bases.iter().filter_map(|(base, known)| {
        let nothing = fit::squared(&train.whitened(&base.point, filters));
        let starts = magnitudes.iter().map(|values| {
            let twin = screen::with(&base.point.twin, candidate.effect, candidate.axis, values);
            let point = Point { twin, nuisance: base.point.nuisance.clone() };
            let loss = fit::squared(&train.whitened(&point, filters));
            // A limit that is never reached has no slope.
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
    // Whole rolls have many local minima: an early change is amplified along the roll.
    let is_whole = train.parts.iter().any(|part| part.stage.kind() == StageKind::WholeRolls);
    let found = match candidate.effect.is_localized() && !is_whole {
        true => from_other_positions(train, found, candidate, &how),
        false => found,
    };
    search_magnitude(train, found, &how)
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

/// The fit, or a better one from another position of a localized effect: no slope leads there from far away.
fn from_other_positions(
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
    let starts = tries.into_iter().take(OTHER_POSITIONS).map(|(_, point)| point).collect();
    from_starts(train, found, starts, how)
}

/// `point` with the parameter values `values` of the effect that was added last.
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

/// The fit, or a better one from other magnitudes of the last effect: a threshold has no slope between two values at
/// which a sample crosses it.
fn search_magnitude(train: &Problem<'_>, mut found: Fit, how: &fit::How<'_>) -> Fit {
    for _ in 0..MAGNITUDE_SEARCHES {
        let Some(magnitude) = slots_of_last(&found.point.twin).first().copied() else { break };
        let tries = MAGNITUDE_FACTORS.map(|factor| {
            let mut point = found.point.clone();
            point.twin.set(magnitude, factor * found.point.twin.get(magnitude));
            (fit::squared(&train.whitened(&point, how.filters)), point)
        });
        let nearest = tries.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let nearest = nearest.filter(|(loss, _)| *loss < found.loss);
        let Some((_, point)) = nearest else { break };
        found = fit::fit_with(train, point, &found.slots, how);
    }
    found
}
