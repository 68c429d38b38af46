//! The screen at the given twin: every effect simulated at its probes, nothing else moved.
//!
//! A refit absorbs part of a large effect in known parameters, and what it leaves can look like anything.
//! So effects are also put to the given twin as it was: the nearest are fitted alone, and the best of these
//! join the short list. Nothing is linearised here, so that effects that bend are found from far away.

use super::{
    evidence::Amplitude,
    fit::{self, Fit},
    problem::{Point, Problem},
    round::slots_of_last,
    screen::{self, Candidate},
    whiten::Filters,
};
use crate::{
    effects::{Axis, Effect},
    parallel::in_parallel,
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

/// The effects that alone bring the `given` twin nearest to the data, the nearest first.
#[must_use]
pub(super) fn nearest(problem: &Problem<'_>, given: &Fit, filters: &Filters) -> Vec<Candidate> {
    let pairs = screen::pairs(problem, &given.point.twin);
    let (shared, single): (Vec<_>, Vec<_>) =
        pairs.into_iter().partition(|(_, axis)| screen::is_shared(*axis));
    let mut tries = simulated(problem, &given.point, filters, &shared);
    tries.truncate(FITTED);
    let leading: Vec<&'static Effect> = tries.iter().map(|own| own.effect).collect();
    let alone: Vec<_> = single.into_iter().filter(|(effect, _)| leading.contains(effect)).collect();
    tries.extend(simulated(problem, &given.point, filters, &alone));
    let before = problem.whitened(&given.point, filters);
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
            tries: count,
            lean: Vec::new(),
            shift: Vec::new(),
        }
    });
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    found
}

/// Every pair at its best probe, where that is nearer to the data than nothing; the nearest first.
fn simulated(
    problem: &Problem<'_>,
    given: &Point,
    filters: &Filters,
    pairs: &[(&'static Effect, Axis)],
) -> Vec<Try> {
    let nothing = fit::squared(&problem.whitened(given, filters));
    let probes: Vec<(&'static Effect, Axis, &[f64])> = pairs
        .iter()
        .flat_map(|(effect, axis)| effect.probes.iter().map(|probe| (*effect, *axis, *probe)))
        .collect();
    let all = in_parallel(&probes, |(effect, axis, probe)| {
        let twin = screen::with(&given.twin, effect, *axis, probe);
        let start = Point { twin, nuisance: given.nuisance.clone() };
        // Where a run begins follows what the effect does in it.
        let fit = fit::fit(problem, start, &[], filters, NUISANCE_ITERATIONS);
        Try { effect, axis: *axis, probe: probe.to_vec(), point: fit.point, loss: fit.loss }
    });
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
