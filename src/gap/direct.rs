//! Screen at the given twin: every effect simulated at its probes, nothing else refitted.
//!
//! A refit absorbs part of a large effect in known parameters, and the residual after it is misleading. So effects are
//! also added to the given twin before any refit. Those with the smallest residual are fitted alone, and the best join
//! the short list. Nothing is linearized here, so nonlinear effects are detected at large magnitudes.

use super::{
    batch::in_parallel,
    evidence::Amplitude,
    fit::{self, Fit},
    problem::{Point, Problem, dot},
    round::slots_of_last,
    screen::{self, Candidate},
    whiten::Filters,
};
use crate::{
    effects::{Axis, Effect, magnitudes},
    stats::f_tail,
};

/// Effects on all motors or axes together that are also simulated on one of them, after all probes.
const LEADING: usize = 8;

/// Effects and locations whose own parameters are fitted, after all probes.
const FITTED: usize = 12;

/// Iterations of these fits.
const ITERATIONS: usize = 4;

/// Iterations of the nuisances at a probe.
const NUISANCE_ITERATIONS: usize = 2;

/// Effect at one probe.
struct Try {
    effect: &'static Effect,
    axis: Axis,
    probe: Vec<f64>,
    point: Point,
    loss: f64,
}

/// Effects that alone reduce the residual of the `given` twin most, the smallest residual first; each is compared with
/// the `refit` of all known parameters.
#[must_use]
pub(super) fn nearest(
    problem: &Problem<'_>,
    (given, filters): (&Fit, &Filters),
    refit: &Point,
) -> Vec<Candidate> {
    let pairs = screen::pairs(problem, &given.point.twin);
    let (shared, single): (Vec<_>, Vec<_>) =
        pairs.into_iter().partition(|(_, axis)| screen::is_shared(*axis));
    let mut tries = simulated(problem, &given.point, filters, &shared);
    tries.truncate(LEADING);
    let leading: Vec<&'static Effect> = tries.iter().map(|own| own.effect).collect();
    let alone: Vec<_> = single.into_iter().filter(|(effect, _)| leading.contains(effect)).collect();
    tries.extend(simulated(problem, &given.point, filters, &alone));
    let count = tries.len();
    tries.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    tries.truncate(FITTED);
    let before = problem.whitened(&given.point, filters);
    let refitted = problem.whitened(refit, filters);
    let mut found: Vec<Candidate> = in_parallel(&tries, |own| {
        let slots = slots_of_last(&own.point.twin);
        let how = fit::How::start(filters, ITERATIONS);
        let fit = fit::fit_with(problem, own.point.clone(), &slots, &how);
        let after = problem.whitened(&fit.point, filters);
        let amplitude = Amplitude::of(&before, &after, &problem.blocks());
        let statistic = (amplitude.value / amplitude.standard_error).max(0.0).powi(2);
        Candidate {
            effect: own.effect,
            axis: own.axis,
            start: slots.iter().map(|slot| fit.point.twin.get(*slot)).collect(),
            probe: own.probe.clone(),
            explained_fraction: 1.0 - fit.loss / fit::squared(&before).max(f64::MIN_POSITIVE),
            statistic,
            p_value: f_tail(statistic, 1.0, amplitude.freedom),
            detectability: f64::INFINITY,
            is_as_good_as_refit: !problem.thresholds().is_in(&after, &refitted, &problem.blocks()),
            tries: count,
            parameter_offsets: Vec::new(),
            shift: Vec::new(),
            other_starts: Vec::new(),
        }
    });
    found.sort_by(|a, b| b.explained_fraction.total_cmp(&a.explained_fraction));
    found
}

/// Every pair at its best probe, or at the optimum of the line through it, where the residual decreases; the smallest
/// residual first.
fn simulated(
    problem: &Problem<'_>,
    given: &Point,
    filters: &Filters,
    pairs: &[(&'static Effect, Axis)],
) -> Vec<Try> {
    let nothing = problem.whitened(given, filters);
    let probes: Vec<(&'static Effect, Axis, Vec<f64>)> = pairs
        .iter()
        .flat_map(|(effect, axis)| {
            // Between two probes, an effect with several minima may leave more than without it at all of them.
            let shape = &effect.null[1..];
            let more = magnitudes(effect).into_iter().map(move |own| [&[own], shape].concat());
            let probes = effect.probes.iter().map(|probe| probe.to_vec()).chain(more);
            probes.map(|probe| (*effect, *axis, probe))
        })
        .collect();
    let all = in_parallel(&probes, |(effect, axis, probe)| {
        let simulated = |values: &[f64]| {
            let twin = screen::with(&given.twin, effect, *axis, values);
            let start = Point { twin, nuisance: given.nuisance.clone() };
            // The start of a run depends on the effect.
            let fit = fit::fit(problem, start, &[], filters, NUISANCE_ITERATIONS);
            Try { effect, axis: *axis, probe: probe.to_vec(), point: fit.point, loss: fit.loss }
        };
        let own = simulated(probe);
        let after = problem.whitened(&own.point, filters);
        match on_line(effect, probe, &nothing, &after).map(|values| simulated(&values)) {
            Some(on_line) if on_line.loss < own.loss => on_line,
            _ => own,
        }
    });
    let nothing = fit::squared(&nothing);
    let mut best: Vec<Try> = Vec::new();
    for own in all.into_iter().filter(|own| own.loss < nothing) {
        match best.iter_mut().find(|other| other.effect == own.effect && other.axis == own.axis) {
            Some(other) if other.loss <= own.loss => {}
            Some(other) => *other = own,
            None => best.push(own),
        }
    }
    best.sort_by(|a, b| a.loss.total_cmp(&b.loss));
    best
}

/// Optimum of the line from null through the `probe`, from the residuals before and at the probe. A small effect is
/// nearer to null than to its probe, and may have the other sign. `None` where the optimum is at the probe or beyond,
/// outside the bounds, or where null is too far away for a line.
fn on_line(effect: &Effect, probe: &[f64], before: &[f64], after: &[f64]) -> Option<Vec<f64>> {
    let change: Vec<f64> = before.iter().zip(after).map(|(before, after)| before - after).collect();
    let factor = dot(&change, before) / dot(&change, &change);
    if screen::is_far(probe[0], effect.null[0]) || factor.is_nan() || 1.0 <= factor.abs() {
        return None;
    }
    let along = |k: usize| {
        let (null, (low, high)) = (effect.null[k], effect.parameters[k].bounds);
        // A parameter with null at zero scales; a shape parameter stays.
        let value =
            if k == 0 || null == 0.0 { null + factor * (probe[k] - null) } else { probe[k] };
        (low..=high).contains(&value).then_some(value)
    };
    (0..probe.len()).map(along).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        gap::{
            test_stage::{TestStage, pulses_behind_a_gap},
            whiten,
        },
        twin::{Machine, Twin},
    };

    #[test]
    fn a_gap_that_no_probe_comes_near_is_proposed() {
        const WIDTH: f64 = 0.84e-3;
        let nominal = Twin::nominal(Machine::Axis);
        let backlash = crate::effects::find("drive.backlash").unwrap();
        let truth = screen::with(&nominal, backlash, Axis::Single, &[WIDTH, 50.0]);
        let stage = TestStage::camera(&truth, pulses_behind_a_gap, 3);
        let train = Problem::new(&[&stage as _], &nominal);
        let point = train.start(nominal);
        let filters = train.filters(&point, whiten::scale_filters);
        let leaves = |width: f64| {
            let twin = screen::with(&point.twin, backlash, Axis::Single, &[width, 50.0]);
            fit::squared(&train.whitened(&train.start(twin), &filters))
        };
        let nothing = fit::squared(&train.whitened(&point, &filters));
        let probed = backlash.probes.iter().map(|probe| leaves(probe[0]));
        assert!(probed.fold(f64::INFINITY, f64::min) > nothing && leaves(WIDTH) < nothing);
        let given = Fit { point, slots: vec![], loss: nothing, rows: 2000 };
        let found = nearest(&train, (&given, &filters), &given.point);
        let own = found.iter().find(|own| own.effect.name == backlash.name).unwrap();
        assert!((own.start[0] / WIDTH - 1.0).abs() < 0.02, "{:?}", own.start);
    }

    /// Optimum of the line when the probe changes the data by `change`, and `times` that change is present.
    fn start_on_line(name: &str, times: f64) -> Option<Vec<f64>> {
        let effect = crate::effects::find(name).unwrap();
        let change = [1.0, 2.0, -0.5];
        let before = change.map(|value| times * value);
        let after = change.map(|value| (times - 1.0) * value);
        on_line(effect, effect.probes[0], &before, &after)
    }

    #[test]
    fn a_small_effect_is_started_where_the_line_leads_with_its_sign() {
        let gain = start_on_line("drive.gain", -0.5).unwrap();
        assert!((gain[0] - 0.99).abs() < 1e-12, "{gain:?}");
        assert!(
            start_on_line("drive.gain", 3.0).is_none(),
            "beyond the probe a fit goes on from there"
        );
        // A lag has one sign; for a speed that is never reached there is no line.
        assert!(
            start_on_line("drive.lag1", 0.25).is_some()
                && start_on_line("drive.lag1", -0.25).is_none()
        );
        assert!(start_on_line("drive.saturation.torque_speed", 0.5).is_none());
    }
}
