//! First fits of the candidates, from several starts.

use super::{IDLE, RoundStart, Tried, slots_of_last, trial::is_bend, values_of_last};
use crate::{
    effects::magnitudes,
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

/// Probes from which such an effect is fitted in addition to the start of the screen.
const OTHER_PROBES: usize = 3;

/// Minima of the loss along the magnitude from which an effect with several is fitted.
const LEAST_LOSSES: usize = 2;

/// Factors of a magnitude without slope that are tried, and number of repetitions.
const MAGNITUDE_FACTORS: [f64; 8] = [0.7, 0.82, 0.9, 0.96, 1.04, 1.1, 1.2, 1.4];
const MAGNITUDE_SEARCHES: usize = 3;

/// Fractions of the magnitude of the last winner at which a candidate's fit of the round before is tried.
const WINNER_FRACTIONS: [f64; 3] = [1.0, 0.5, 0.25];

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
    let others = round_start.plausible.into_iter().chain(round_start.given);
    bases.extend(others.map(|(base, _)| (base, columns(base))));
    in_parallel(short, |candidate| {
        let fit = fitted(train, &bases, candidate, round_start.filters);
        let fit = from_previous_fit(train, fit, round_start, candidate);
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
    let fits = bases.iter().filter_map(|(base, known)| {
        let nothing = fit::squared(&train.whitened(&base.point, filters));
        let starts = with_candidate(train, &base.point, candidate, filters).map(|(loss, point)| {
            // A limit that is never reached has no slope.
            let is_idle = (loss - nothing).abs() <= IDLE * nothing;
            (is_idle, loss, point)
        });
        let (.., point) = starts.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        let mut slots = bases[0].0.slots.clone();
        slots.extend(slots_of_last(&point.twin));
        let how = fit::How { known, ..fit::How::start(filters, 10) };
        Some((fit::fit_with(train, point, &slots, &how), how))
    });
    let best = fits.min_by(|a, b| a.0.loss.total_cmp(&b.0.loss));
    let (found, how) = best.expect("there is a base, and sizes to start from");
    let found = from_other_starts(train, found, candidate, &how);
    // In the given twin, the known parameters have not compensated for the effect.
    let (given, _) = bases[bases.len() - 1];
    let found = from_least_losses(train, found, given, candidate, &how);
    if candidate.effect.probes.len() < MANY_PROBES {
        return found;
    }
    // Whole rolls have many local minima: an early change is amplified along the roll.
    let is_whole = train.parts.iter().any(|part| part.stage.kind() == StageKind::WholeRolls);
    let found = match is_whole {
        true => found,
        false => from_other_probes(train, found, candidate, &how),
    };
    search_magnitude(train, found, &how)
}

/// `base` with the effect of `candidate` at each of its magnitudes, with the squared residual. The linearization of the
/// screen may overshoot for a nonlinear effect, so smaller magnitudes are starts too.
pub(super) fn with_candidate(
    train: &Problem<'_>,
    base: &Point,
    candidate: &Candidate,
    filters: &Filters,
) -> impl Iterator<Item = (f64, Point)> {
    let starts = screen::starts_towards_null(candidate);
    starts.into_iter().map(move |values| with_values(train, base, candidate, &values, filters))
}

/// `base` with the effect of `candidate` at these parameter values, with the squared residual.
fn with_values(
    train: &Problem<'_>,
    base: &Point,
    candidate: &Candidate,
    values: &[f64],
    filters: &Filters,
) -> (f64, Point) {
    let twin = screen::with(&base.twin, candidate.effect, candidate.axis, values);
    let point = Point { twin, nuisance: base.nuisance.clone() };
    (fit::squared(&train.whitened(&point, filters)), point)
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

/// The fit, or a better one from the magnitudes at the lowest minima of the loss, for an effect that has several. The
/// other parameters of the effect are as fitted, and the known ones as in `base`.
fn from_least_losses(
    train: &Problem<'_>,
    found: Fit,
    base: &Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let shape = values_of_last(&found.point.twin);
    let at = |magnitude: f64| {
        let values = [&[magnitude], &shape[1..]].concat();
        with_values(train, &base.point, candidate, &values, how.filters)
    };
    let tries: Vec<(f64, Point)> = magnitudes(candidate.effect).into_iter().map(at).collect();
    let loss = |index: usize| tries.get(index).map_or(f64::INFINITY, |(loss, _)| *loss);
    let is_least = |index: &usize| {
        let before = index.checked_sub(1).map_or(f64::INFINITY, loss);
        loss(*index) <= before && loss(*index) < loss(index + 1)
    };
    let mut least: Vec<usize> = (0..tries.len()).filter(is_least).collect();
    least.sort_by(|a, b| loss(*a).total_cmp(&loss(*b)));
    let starts = least.into_iter().take(LEAST_LOSSES).map(|index| tries[index].1.clone());
    from_starts(train, found, starts, how)
}

/// The fit, or a better one from that of the same candidate in the round before, with the winner of that round added.
/// The known parameters were fitted there with the candidate in place; since then, they and the winner may have taken its
/// place.
fn from_previous_fit(
    train: &Problem<'_>,
    found: Fit,
    round_start: &RoundStart<'_>,
    candidate: &Candidate,
) -> Fit {
    let base = &round_start.base.point.twin;
    let is_same = |tried: &&Tried| {
        tried.is_of(candidate) && tried.fit.point.twin.instances.len() == base.instances.len()
    };
    let previous = round_start.previous.iter().find(is_same).map(|tried| &tried.fit);
    let (Some(previous), Some(winner)) = (previous, base.instances.last()) else { return found };
    let filters = round_start.filters;
    // The winner may have been larger without the candidate.
    let starts = WINNER_FRACTIONS.map(|fraction| {
        let (mut point, mut winner) = (previous.point.clone(), winner.clone());
        let null = winner.effect.null[0];
        winner.values[0].value = null + fraction * (winner.values[0].value - null);
        let last = point.twin.instances.len() - 1;
        point.twin.instances.insert(last, winner);
        (fit::squared(&train.whitened(&point, filters)), point)
    });
    let nearest = starts.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
    let nearest = nearest.map(|(_, point)| point);
    from_starts(train, found, nearest, &fit::How::start(filters, 10))
}

/// The fit, or a better one from other probes: with their magnitude or the fitted one, or with one shape parameter of
/// theirs. No slope leads to another position from far away, or to another cause of the same shape.
fn from_other_probes(
    train: &Problem<'_>,
    found: Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let fitted = values_of_last(&found.point.twin);
    let mut starts: Vec<Vec<f64>> = Vec::new();
    for probe in candidate.effect.probes {
        let with_fitted_magnitude = [&fitted[..1], &probe[1..]].concat();
        let with_one_shape = (1..fitted.len()).map(|changed| {
            let mut values = fitted.clone();
            values[changed] = probe[changed];
            values
        });
        let own = [probe.to_vec(), with_fitted_magnitude].into_iter().chain(with_one_shape);
        starts.extend(own.filter(|own| !starts.contains(own)).collect::<Vec<_>>());
    }
    let mut tries = in_parallel(&starts, |values| {
        let point = with_last(&found.point, values);
        (fit::squared(&train.whitened(&point, how.filters)), point)
    });
    tries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let starts = tries.into_iter().take(OTHER_PROBES).map(|(_, point)| point);
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
pub(super) fn from_starts(
    train: &Problem<'_>,
    found: Fit,
    starts: impl IntoIterator<Item = Point>,
    how: &fit::How<'_>,
) -> Fit {
    let fits = starts.into_iter().map(|point| fit::fit_with(train, point, &found.slots, how));
    // A bend may leave less than the waves between which it was to decide.
    let loss = |fit: &Fit| if is_bend(train, fit) { f64::INFINITY } else { fit.loss };
    let best = fits.min_by(|a, b| loss(a).total_cmp(&loss(b)));
    best.filter(|best| loss(best) < loss(&found)).unwrap_or(found)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::{
            test_stage::{
                TestStage, axis_of_frequency, candidate, first_parameters, pulses_behind_a_gap,
                sines, with,
            },
            whiten,
        },
        twin::{Machine, Twin},
    };

    const FREQUENCY_HZ: f64 = 5.0;

    #[test]
    fn a_candidate_also_starts_from_its_fit_in_the_round_before() {
        let nominal = Twin::nominal(Machine::Axis);
        let truth =
            with(&with(&axis_of_frequency(FREQUENCY_HZ), "drive.lag1", 0.3), "drive.delay", 0.5);
        let stage = TestStage::camera(&truth, sines, 3);
        let train = Problem::new(&[&stage as _], &nominal);
        let fit_of = |twin: Twin| {
            let point = train.start(twin);
            let mut slots = first_parameters(&point.twin, ["gantry.inertia"]).to_vec();
            slots.extend(slots_of_last(&point.twin));
            Fit { point, slots, loss: f64::INFINITY, rows: 2000 }
        };
        // Since the winner was added, the frequency is in another local minimum.
        let base = fit_of(with(&axis_of_frequency(5.7), "drive.lag1", 0.3));
        let filters = train.filters(&base.point, whiten::scale_filters);
        let candidate = candidate("drive.delay", 0.4);
        let previous = [Tried {
            candidate: candidate.clone(),
            fit: fit_of(with(&axis_of_frequency(FREQUENCY_HZ), "drive.delay", 0.5)),
            has_passed: true,
        }];
        let frequency_after = |previous: &[Tried]| {
            let round_start = RoundStart::at(&base, &filters, &nominal, previous);
            let [found] = &rough_fits(&train, &round_start, std::slice::from_ref(&candidate))[..]
            else {
                panic!()
            };
            let [slot] = first_parameters(&found.point.twin, ["gantry.inertia"]);
            found.point.twin.get(slot)
        };
        assert!((frequency_after(&previous) - FREQUENCY_HZ).abs() < 0.01);
        assert!((frequency_after(&[]) - FREQUENCY_HZ).abs() > 0.1, "the base leads elsewhere");
    }

    #[test]
    fn a_wide_gap_is_found_across_other_minima_of_the_loss() {
        const WIDTH: f64 = 1.33e-3;
        let nominal = Twin::nominal(Machine::Axis);
        let backlash = find("drive.backlash").unwrap();
        let truth = screen::with(&nominal, backlash, Axis::Single, &[WIDTH, 50.0]);
        let stage = TestStage::camera(&truth, pulses_behind_a_gap, 3);
        let train = Problem::new(&[&stage as _], &nominal);
        let base = Fit {
            point: train.start(nominal.clone()),
            slots: Vec::new(),
            loss: f64::INFINITY,
            rows: 2000,
        };
        let filters = train.filters(&base.point, whiten::scale_filters);
        let start = vec![2e-4, 50.0];
        let zeros = vec![0.0; 2];
        let own = Candidate {
            probe: start.clone(),
            start,
            parameter_offsets: zeros.clone(),
            shift: zeros,
            ..candidate("drive.backlash", 2e-4)
        };
        let round_start = RoundStart::at(&base, &filters, &nominal, &[]);
        let [found] = &rough_fits(&train, &round_start, std::slice::from_ref(&own))[..] else {
            panic!()
        };
        let width = values_of_last(&found.point.twin)[0];
        assert!((width / WIDTH - 1.0).abs() < 0.02, "{width}");
    }
}
