//! The screen at the given twin: every effect simulated at its probes, nothing else moved.
//!
//! A refit absorbs part of a large effect in known parameters, and what it leaves can look like anything.
//! So effects are also put to the given twin as it was: the nearest are fitted alone, and the best of these
//! join the short list. Nothing is linearised here, so that effects that bend are found from far away.

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
    effects::{Axis, Effect},
    stats::f_tail,
};

/// Effects whose own numbers are fitted, after all probes.
const FITTED: usize = 8;

/// Steps of these fits.
const ITERATIONS: usize = 4;

/// Steps in which the nuisances follow a probe.
const NUISANCE_ITERATIONS: usize = 2;

/// One effect at one probe.
struct Try {
    effect: &'static Effect,
    axis: Axis,
    probe: Vec<f64>,
    point: Point,
    loss: f64,
}

/// The effects that alone bring the `given` twin nearest to the data, the nearest first; each is compared with the
/// `refit` of all known parameters.
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
    tries.truncate(FITTED);
    let leading: Vec<&'static Effect> = tries.iter().map(|own| own.effect).collect();
    let alone: Vec<_> = single.into_iter().filter(|(effect, _)| leading.contains(effect)).collect();
    tries.extend(simulated(problem, &given.point, filters, &alone));
    let before = problem.whitened(&given.point, filters);
    let refitted = problem.whitened(refit, filters);
    let count = tries.len();
    let mut found: Vec<Candidate> = in_parallel(&tries, |own| {
        let slots = slots_of_last(&own.point.twin);
        let fit = fit::fit(problem, own.point.clone(), &slots, filters, ITERATIONS);
        let after = problem.whitened(&fit.point, filters);
        let amplitude = Amplitude::of(&before, &after, &problem.blocks());
        let statistic = (amplitude.value / amplitude.standard_error).max(0.0).powi(2);
        Candidate {
            effect: own.effect,
            axis: own.axis,
            start: slots.iter().map(|slot| fit.point.twin.get(*slot)).collect(),
            probe: own.probe.clone(),
            share: 1.0 - fit.loss / fit::squared(&before).max(f64::MIN_POSITIVE),
            statistic,
            p_value: f_tail(statistic, 1.0, amplitude.freedom),
            visibility: f64::INFINITY,
            is_as_good_as_refit: !problem.thresholds().is_in(&after, &refitted, &problem.blocks()),
            tries: count,
            lean: Vec::new(),
            shift: Vec::new(),
            other_starts: Vec::new(),
        }
    });
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

/// Every pair at its best probe, or where the line through that leads, where it is nearer to the data than nothing; the
/// nearest first.
fn simulated(
    problem: &Problem<'_>,
    given: &Point,
    filters: &Filters,
    pairs: &[(&'static Effect, Axis)],
) -> Vec<Try> {
    let nothing = problem.whitened(given, filters);
    let probes: Vec<(&'static Effect, Axis, &[f64])> = pairs
        .iter()
        .flat_map(|(effect, axis)| effect.probes.iter().map(|probe| (*effect, *axis, *probe)))
        .collect();
    let all = in_parallel(&probes, |(effect, axis, probe)| {
        let simulated = |values: &[f64]| {
            let twin = screen::with(&given.twin, effect, *axis, values);
            let start = Point { twin, nuisance: given.nuisance.clone() };
            // Where a run begins follows what the effect does in it.
            let fit = fit::fit(problem, start, &[], filters, NUISANCE_ITERATIONS);
            Try { effect, axis: *axis, probe: probe.to_vec(), point: fit.point, loss: fit.loss }
        };
        let own = simulated(probe);
        let after = problem.whitened(&own.point, filters);
        match led(effect, probe, &nothing, &after).map(|values| simulated(&values)) {
            Some(led) if led.loss < own.loss => led,
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

/// Where the line from nothing through the `probe` comes nearest to the data, with the residuals before and at the
/// probe: a small effect is nearer to nothing than to its probe, and may have the other sign. `None` where that is
/// the probe itself, beyond what the effect may be, or where no line leads.
fn led(effect: &Effect, probe: &[f64], before: &[f64], after: &[f64]) -> Option<Vec<f64>> {
    let change: Vec<f64> = before.iter().zip(after).map(|(before, after)| before - after).collect();
    let factor = dot(&change, before) / dot(&change, &change);
    if screen::is_far(probe[0], effect.null[0]) || factor.is_nan() || 1.0 <= factor.abs() {
        return None;
    }
    let along = |k: usize| {
        let (null, (low, high)) = (effect.null[k], effect.parameters[k].bounds);
        // What is counted from nothing scales; a shape stays.
        let value =
            if k == 0 || null == 0.0 { null + factor * (probe[k] - null) } else { probe[k] };
        (low..=high).contains(&value).then_some(value)
    };
    (0..probe.len()).map(along).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the line leads when the probe changes the data by `change` and `times` that is there.
    fn leads(name: &str, times: f64) -> Option<Vec<f64>> {
        let effect = crate::effects::find(name).unwrap();
        let change = [1.0, 2.0, -0.5];
        let before = change.map(|value| times * value);
        let after = change.map(|value| (times - 1.0) * value);
        led(effect, effect.probes[0], &before, &after)
    }

    #[test]
    fn a_small_effect_is_started_where_the_line_leads_with_its_sign() {
        let gain = leads("drive.gain", -0.5).unwrap();
        assert!((gain[0] - 0.99).abs() < 1e-12, "{gain:?}");
        assert!(leads("drive.gain", 3.0).is_none(), "beyond the probe a fit goes on from there");
        // A lag has one sign; a speed that is never reached is no distance away.
        assert!(leads("drive.lag1", 0.25).is_some() && leads("drive.lag1", -0.25).is_none());
        assert!(leads("drive.saturation.torque_speed", 0.5).is_none());
    }
}
