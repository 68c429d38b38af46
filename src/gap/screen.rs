//! The screen: every effect of the catalogue, on every axis, as linearised regressors.
//!
//! An effect is switched on at a probe's values and the change of the simulation is its column,
//! whatever its physics: no regressor is written twice. After the columns of the known parameters
//! and the nuisances are taken out, what they explain is tested against the scatter between blocks of
//! time ([`joint`]), which holds under correlation within blocks, on residuals that are whitened for
//! power.

use super::{
    batch::in_parallel,
    evidence::{joint, least_squares},
    fit::Fit,
    numerics::normal::Normal,
    observer::SearchStep,
    problem::{Evaluated, Linear, Problem, dot},
    user_effects,
    whiten::Filters,
};
use crate::{
    effects::{Axis, Effect, SCANS},
    twin::{Instance, Machine, Source, Twin},
};
use std::mem;

/// One effect on one axis, tried.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// The effect.
    pub effect: &'static Effect,
    /// Where it would act.
    pub axis: Axis,
    /// The start of its parameters that explains most.
    pub start: Vec<f64>,
    /// The probe behind it.
    pub probe: Vec<f64>,
    /// Share of the whitened squared error that its columns explain beyond the known parameters.
    pub share: f64,
    /// F statistic of the block test.
    pub statistic: f64,
    /// Its tail probability, before the correction for many tries.
    pub p_value: f64,
    /// Length of its columns at its largest plausible size, beyond what known parameters imitate, in
    /// whitened standard deviations: what the excitation shows of it.
    pub visibility: f64,
    /// Whether the given twin with it alone explains all that a refit of the known parameters explains.
    pub is_as_good_as_refit: bool,
    /// How many starts were tried for it.
    pub tries: usize,
    /// How far from doing nothing the line of the screen leads each number, bounds or not; empty where the
    /// effect was simulated instead.
    pub lean: Vec<f64>,
    /// How far each known parameter would move with it, as the line of the screen says (scaled).
    pub shift: Vec<f64>,
    /// Starts at other values of a parameter that is scanned for: the line of the screen knows little of what a wrong
    /// base model hides.
    pub other_starts: Vec<Vec<f64>>,
}

/// Most waves of one effect on one axis.
const MOST_WAVES: usize = 5;

/// How many effects are tried on single axes, after the screen of the shared ones.
const TRIED_ALONE: usize = 20;

/// Every effect that the link of `problem` can show and that `found` does not have yet: first on all
/// axes alike, then the best on each axis alone.
#[must_use]
pub(super) fn screen(problem: &Problem<'_>, found: &Fit, filters: &Filters) -> Vec<Candidate> {
    let base = problem.evaluated(found.point.clone());
    let known = problem.columns(&base, &found.slots, filters);
    let linear = problem.linear_of(&base, known, filters);
    let linear_residual =
        problem.parts.first().map(|part| part.residual(&base.prediction[0])).unwrap_or_default();
    let normal = Normal::new(&linear.columns, &linear.residual);
    let screen = Screen { problem, found, filters, base, normal, linear };
    let (shared, single): (Vec<_>, Vec<_>) =
        pairs(problem, &found.point.twin).into_iter().partition(|(_, axis)| is_shared(*axis));
    let tries = shared
        .iter()
        .flat_map(|(effect, axis)| {
            let probes = probes(problem, &linear_residual, found.point.twin.machine, effect);
            probes.into_iter().map(|probe| (*effect, *axis, probe))
        })
        .collect();
    let mut best = screen.run(tries);
    best.sort_by(|a, b| b.share.total_cmp(&a.share));
    let mut leading: Vec<(&'static Effect, Vec<f64>)> = Vec::new();
    for candidate in &best {
        if leading.len() < TRIED_ALONE
            && !leading.iter().any(|(effect, _)| *effect == candidate.effect)
        {
            leading.push((candidate.effect, candidate.probe.clone()));
        }
    }
    let tries = single
        .iter()
        .flat_map(|(effect, axis)| {
            let led = leading.iter().find(|(own, _)| own == effect).map(|(_, probe)| probe.clone());
            let probes: Vec<Vec<f64>> = match led {
                Some(probe) => vec![probe],
                // What is on one axis already, or exists on single axes only, was not tried yet.
                None if !best.iter().any(|other| other.effect == *effect) => {
                    probes(problem, &linear_residual, found.point.twin.machine, effect)
                }
                None => Vec::new(),
            };
            probes.into_iter().map(|probe| (*effect, *axis, probe)).collect::<Vec<_>>()
        })
        .collect();
    best.extend(screen.run(tries));
    best.sort_by(|a, b| b.share.total_cmp(&a.share));
    best
}

/// The probes of `effect`; where one of its numbers must be scanned for, with the values that the
/// residual of the first part proposes for it.
fn probes(
    problem: &Problem<'_>,
    residual: &[Vec<f64>],
    machine: Machine,
    effect: &'static Effect,
) -> Vec<Vec<f64>> {
    let listed: Vec<Vec<f64>> = effect.probes.iter().map(|probe| probe.to_vec()).collect();
    let scan = SCANS.iter().find(|(own, _)| *own == effect).map(|(_, scan)| scan);
    let (Some(scan), Some(part), Some(first)) = (scan, problem.parts.first(), listed.first())
    else {
        return listed;
    };
    let series = part.stage.phase_series(residual);
    let proposed: Vec<Vec<f64>> = (scan.propose)(&series, longest_period(machine))
        .into_iter()
        .map(|value| {
            let mut probe = first.clone();
            probe[scan.parameter] = value;
            probe
        })
        .collect();
    if proposed.is_empty() { listed } else { proposed }
}

/// Longest period that is looked for along a position, in ranges of that position. A motor of a table makes many turns
/// in its travel; the arm on a single axis may make less than one.
fn longest_period(machine: Machine) -> f64 {
    match machine {
        Machine::Table => 0.5,
        Machine::Axis => 4.0,
    }
}

/// What all tries of one screen share.
struct Screen<'a, 'b> {
    problem: &'b Problem<'a>,
    found: &'b Fit,
    filters: &'b Filters,
    base: Evaluated,
    linear: Linear,
    normal: Normal,
}

impl Screen<'_, '_> {
    /// Tests every (effect, axis, probe); of several probes the best is kept.
    fn run(&self, tries: Vec<(&'static Effect, Axis, Vec<f64>)>) -> Vec<Candidate> {
        let twin = &self.found.point.twin;
        let total = dot(&self.linear.residual, &self.linear.residual);
        let least = self.problem.thresholds().equal_prediction;
        let observer = self.problem.context.observer;
        observer.step_begun(SearchStep::Screen, tries.len());
        let tested = in_parallel(&tries, |(effect, axis, probe)| {
            let mut variants = vec![with(twin, effect, *axis, probe)];
            let singles = amplitudes(effect, probe);
            variants.extend(singles.iter().map(|values| with(twin, effect, *axis, values)));
            let columns = self.problem.contrasts(&self.base, &variants, self.filters);
            let tested = test(&self.linear, (&self.normal, total), least, columns);
            observer.candidate_done();
            tested
        });
        let mut best: Vec<Candidate> = Vec::new();
        for ((effect, axis, probe), tested) in tries.into_iter().zip(tested) {
            let candidate = Candidate {
                effect,
                axis,
                start: tested.start(effect, &probe),
                visibility: tested.visibility * reach(effect, &probe),
                is_as_good_as_refit: false,
                lean: tested.lean(effect, &probe),
                shift: tested.shift,
                other_starts: Vec::new(),
                probe,
                share: tested.share,
                statistic: tested.statistic,
                p_value: tested.p_value,
                tries: 1,
            };
            match best.iter_mut().find(|other| other.effect == effect && other.axis == axis) {
                Some(other) => {
                    let tries = other.tries + 1;
                    let visibility = other.visibility.max(candidate.visibility);
                    let mut other_starts = mem::take(&mut other.other_starts);
                    let worse = match other.share < candidate.share {
                        true => mem::replace(other, candidate),
                        false => candidate,
                    };
                    if effect.scanned_parameter().is_some() {
                        other_starts.push(worse.start);
                    }
                    other.other_starts = other_starts;
                    other.tries = tries;
                    other.visibility = visibility;
                }
                None => best.push(candidate),
            }
        }
        best
    }
}

/// How many times larger than at `probe` the effect can plausibly be.
pub(super) fn reach(effect: &Effect, probe: &[f64]) -> f64 {
    let (low, high) = effect.parameters[0].plausible;
    let null = effect.null[0];
    let away = (probe[0] - null).abs();
    let farthest = (low - null).abs().max((high - null).abs());
    // Where null is far outside the plausible range (a limit that never acts), the probe decides.
    if away == 0.0 || (low..=high).contains(&null) || null == 0.0 {
        if away == 0.0 { 1.0 } else { (farthest / away).max(1.0) }
    } else {
        1.0
    }
}

/// What the effect is at its usual size, as a share of its largest plausible one: in the middle of the plausible sizes
/// by ratio, or a third of the largest where they begin at nothing.
pub(super) fn usual_share(effect: &Effect) -> f64 {
    let (low, high) = effect.parameters[0].plausible;
    let null = effect.null[0];
    let (one, other) = ((low - null).abs(), (high - null).abs());
    let (least, most) = (one.min(other), one.max(other));
    let has_sign = null <= low || high <= null;
    if has_sign && 0.0 < least { (least / most).sqrt() } else { 1.0 / 3.0 }
}

/// Where a fit of `candidate` may start: where the line of the screen leads, its probe, and the way from
/// there to where the effect does nothing, in equal ratios where that is far off (a limit that never
/// acts), else in equal steps.
#[must_use]
pub(super) fn towards_null(candidate: &Candidate) -> Vec<Vec<f64>> {
    let effect = candidate.effect;
    let far = |k: usize| is_far(candidate.probe[k], effect.null[k]);
    let mut starts = vec![candidate.start.clone(), candidate.probe.clone()];
    let shares: &[f64] = if far(0) { &[0.9, 0.8, 0.5, 0.25, 0.1] } else { &[0.5, 0.25, 0.1] };
    for share in shares {
        let values = candidate.probe.iter().enumerate().map(|(k, probe)| {
            let null = effect.null[k];
            if far(k) { null * (probe / null).powf(*share) } else { null + share * (probe - null) }
        });
        // Only the size goes towards nothing; a shape (a speed, a period) stays.
        let values = values.enumerate();
        starts.push(
            values.map(|(k, value)| if k == 0 { value } else { candidate.probe[k] }).collect(),
        );
    }
    starts
}

/// Ratio of null to probe from which the way between is taken in equal ratios.
const FAR: f64 = 5.0;

/// Whether null is so far from a probe (a limit that never acts) that no line leads from one to the other.
pub(super) fn is_far(probe: f64, null: f64) -> bool {
    0.0 < probe && FAR * probe < null
}

/// Whether a place is all coordinates alike.
pub(super) fn is_shared(axis: Axis) -> bool {
    matches!(axis, Axis::Motors | Axis::Guides | Axis::Whole)
}

/// Effect and axis of everything to try.
pub(super) fn pairs(problem: &Problem<'_>, twin: &Twin) -> Vec<(&'static Effect, Axis)> {
    let mut pairs = Vec::new();
    for effect in problem.context.options.candidates() {
        let stages = problem.parts.iter().map(|part| part.stage);
        if effect.is_noise() || user_effects::objection(effect, twin.machine, stages).is_some() {
            continue;
        }
        for axis in twin.machine.axes(effect.site) {
            let is_felt = problem.parts.iter().any(|part| part.stage.feels(effect, axis));
            if is_felt && may_be_added(twin, effect, axis) {
                pairs.push((twin.in_own_units(effect), axis));
            }
        }
    }
    pairs
}

/// Return whether `effect` may be added on `axis`: once, or several times with different values of the parameter that
/// is scanned for.
fn may_be_added(twin: &Twin, effect: &Effect, axis: Axis) -> bool {
    let present =
        twin.instances.iter().filter(|own| own.effect == effect && own.axis.overlaps(axis));
    let most = if effect.scanned_parameter().is_some() { MOST_WAVES } else { 1 };
    present.count() < most
}

/// `twin` with `effect` at `values`.
#[must_use]
pub(super) fn with(twin: &Twin, effect: &'static Effect, axis: Axis, values: &[f64]) -> Twin {
    let mut changed = twin.clone();
    changed.instances.push(Instance::new(effect, axis, values, Source::Fitted));
    changed
}

/// Values of `effect` with one amplitude each, where it has several: those that belong to a session (sine
/// and cosine of one wave), at the probe's shape; or all parameters of an effect with a single probe, the
/// others at null.
fn amplitudes(effect: &Effect, probe: &[f64]) -> Vec<Vec<f64>> {
    let waves: Vec<usize> = waves(effect);
    let size = waves.iter().map(|k| (probe[*k] - effect.null[*k]).abs()).fold(0.0, f64::max);
    if !waves.is_empty() {
        let alone = |own: &usize| {
            let mut values = probe.to_vec();
            waves.iter().for_each(|k| values[*k] = effect.null[*k]);
            values[*own] += size;
            values
        };
        return waves.iter().map(alone).collect();
    }
    if probe.len() < 2 || 1 < effect.probes.len() {
        return Vec::new();
    }
    let alone = |k: usize| {
        let mut values = effect.null.to_vec();
        values[k] = probe[k];
        values
    };
    (0..probe.len()).map(alone).collect()
}

/// The parameters of `effect` that are components of a wave with a phase of its own in every session.
fn waves(effect: &Effect) -> Vec<usize> {
    (0..effect.parameters.len()).filter(|k| effect.parameters[*k].per_session).collect()
}

/// What a test of one probe found.
struct Tested {
    share: f64,
    statistic: f64,
    p_value: f64,
    visibility: f64,
    /// Factor of each amplitude: one for all parameters together, or one for each.
    factors: Vec<f64>,
    /// How far known parameters move when the amplitudes have these factors (scaled).
    shift: Vec<f64>,
}

impl Tested {
    const NOTHING: Self = Self {
        share: 0.0,
        statistic: 0.0,
        p_value: 1.0,
        visibility: 0.0,
        factors: Vec::new(),
        shift: Vec::new(),
    };

    /// Where a fit should start: the probe, its amplitudes moved as far as the line says, within a
    /// factor that keeps the line believable.
    fn start(&self, effect: &Effect, probe: &[f64]) -> Vec<f64> {
        let amplitudes = amplitudes(effect, probe);
        let mut start = probe.to_vec();
        if 1 < self.factors.len() && amplitudes.len() == self.factors.len() {
            waves(effect).iter().for_each(|k| start[*k] = effect.null[*k]);
            for (factor, alone) in self.factors.iter().zip(&amplitudes) {
                for (k, value) in alone.iter().enumerate() {
                    let shape = !waves(effect).is_empty() && !waves(effect).contains(&k);
                    if !shape && *value != effect.null[k] {
                        start[k] =
                            effect.null[k] + (value - effect.null[k]) * factor.clamp(-20.0, 20.0);
                    }
                }
            }
        } else if effect.probes.len() == 1 {
            let factor = self.factors.first().copied().unwrap_or(1.0).clamp(-20.0, 20.0);
            start[0] = effect.null[0] + (probe[0] - effect.null[0]) * factor;
        }
        for (value, parameter) in start.iter_mut().zip(effect.parameters) {
            *value = value.clamp(parameter.bounds.0, parameter.bounds.1);
        }
        start
    }
}

impl Tested {
    /// How far from null the line leads each number of `effect`: its first at the shape of the probe, or each
    /// that is an amplitude of its own.
    fn lean(&self, effect: &Effect, probe: &[f64]) -> Vec<f64> {
        let mut lean = vec![0.0; probe.len()];
        let amplitudes = amplitudes(effect, probe);
        if 1 < self.factors.len() && amplitudes.len() == self.factors.len() {
            for (factor, alone) in self.factors.iter().zip(&amplitudes) {
                for (k, value) in alone.iter().enumerate() {
                    let is_shape = !waves(effect).is_empty() && !waves(effect).contains(&k);
                    if !is_shape && *value != effect.null[k] {
                        lean[k] = (value - effect.null[k]) * factor;
                    }
                }
            }
        } else if let Some(factor) = self.factors.first()
            && !is_far(probe[0], effect.null[0])
        {
            lean[0] = (probe[0] - effect.null[0]) * factor;
        }
        lean
    }
}

/// Takes out of `column` what nuisances and known parameters imitate.
pub(super) fn beyond_known(linear: &Linear, normal: &Normal, column: &mut [f64]) {
    linear.take_nuisances_from(column);
    beyond_parameters(linear, normal, column);
}

/// Takes out of `column` what known parameters imitate, and returns how far they would move.
fn beyond_parameters(linear: &Linear, normal: &Normal, column: &mut [f64]) -> Vec<f64> {
    let products: Vec<f64> = linear.columns.iter().map(|known| dot(known, column)).collect();
    let weights = normal.solve(&products);
    for (known, weight) in linear.columns.iter().zip(&weights) {
        column.iter_mut().zip(known).for_each(|(value, known)| *value -= weight * known);
    }
    weights
}

/// Tests the columns of one probe: the first is all parameters together, then each alone. At least the fraction `least`
/// of their squared length must be left beyond the known parameters.
fn test(
    linear: &Linear,
    (normal, total): (&Normal, f64),
    least: f64,
    mut own: Vec<Vec<f64>>,
) -> Tested {
    let mut original = Vec::with_capacity(own.len());
    let mut imitating = Vec::with_capacity(own.len());
    for column in &mut own {
        linear.take_nuisances_from(column);
        original.push(dot(column, column));
        imitating.push(beyond_parameters(linear, normal, column));
    }
    // Each parameter is an amplitude of its own where each alone does something.
    let amplitudes = 1 < own.len() && original[1..].iter().all(|size| 1e-12 < *size);
    let kept: Vec<Vec<f64>> = if amplitudes { own.split_off(1) } else { own.drain(..1).collect() };
    let imitating = if amplitudes { &imitating[1..] } else { &imitating[..1] };
    let sizes = if amplitudes { original[1..].to_vec() } else { original[..1].to_vec() };
    let left: f64 = kept.iter().map(|column| dot(column, column)).sum();
    if !(left.is_finite() && sizes.iter().sum::<f64>() * least < left) {
        return Tested::NOTHING;
    }
    let products: Vec<f64> = kept.iter().map(|column| dot(column, &linear.residual)).collect();
    let Some(factors) = least_squares(&kept, &linear.residual) else { return Tested::NOTHING };
    let explained: f64 = factors.iter().zip(&products).map(|(f, p)| f * p).sum();
    let (statistic, p_value) = joint(&kept, &linear.residual, &linear.blocks);
    let shift = (0..linear.columns.len())
        .map(|k| -imitating.iter().zip(&factors).map(|(weights, f)| weights[k] * f).sum::<f64>())
        .collect();
    // Below zero by rounding only.
    let statistic = statistic.max(0.0);
    Tested { share: explained / total, statistic, p_value, visibility: left.sqrt(), factors, shift }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::find;

    #[test]
    fn usual_sizes_are_in_the_middle_of_the_plausible_ones() {
        let of = |name| usual_share(find(name).unwrap());
        // 0.2 to 3 ms; -3 to 3 kg/m; 1 to 100 kN/m.
        assert!((of("drive.current_loop") - (0.2_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((of("gantry.mass_position") - 1.0 / 3.0).abs() < 1e-12);
        assert!((of("gantry.endstop") - 0.1).abs() < 1e-12);
    }
}
