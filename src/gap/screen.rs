//! Screen: every effect of the catalogue, on every axis, as linearized regressors.
//!
//! The column of an effect is the change of the simulation when the effect is switched on at a probe, for any physics:
//! no regressor is written twice. The directions of known parameters and nuisances are projected out. The gain is then
//! tested against the variance between blocks of time ([`joint`]), which holds under correlation within blocks.
//! Residuals are whitened for power.

use super::{
    batch::in_parallel,
    evidence::{joint, least_squares},
    fit::Fit,
    numerics::normal::Normal,
    observer::SearchStep,
    problem::{Evaluated, Linear, Problem, dot, longest_in_travels},
    user_effects,
    whiten::Filters,
};
use crate::{
    effects::{Axis, Effect, SCANS},
    twin::{Instance, Machine, Source, Twin},
};
use std::mem;

/// Effect on one axis, screened.
#[derive(Debug, Clone)]
pub struct Candidate {
    /// Effect.
    pub effect: &'static Effect,
    /// Axis on which it would act.
    pub axis: Axis,
    /// Start of its parameters that explains most.
    pub start: Vec<f64>,
    /// Probe behind it.
    pub probe: Vec<f64>,
    /// Fraction of the whitened squared error that its columns explain beyond the known parameters.
    pub explained_fraction: f64,
    /// F statistic of the block test.
    pub statistic: f64,
    /// Tail probability, not corrected for multiple comparisons.
    pub p_value: f64,
    /// Length of its columns at its largest plausible magnitude, beyond the directions of known parameters, in whitened
    /// standard deviations: the detectability under this excitation.
    pub detectability: f64,
    /// `true` where the given twin with this effect alone explains as much as a refit of the known parameters.
    pub is_as_good_as_refit: bool,
    /// Number of its starts that were tried.
    pub tries: usize,
    /// Linearized estimate of each parameter as the offset from null, bounds ignored; empty where the effect was
    /// simulated.
    pub parameter_offsets: Vec<f64>,
    /// Linearized shift of each known parameter with it (scaled).
    pub shift: Vec<f64>,
    /// Starts at other values of a parameter that is scanned for: the linearization is unreliable where the base model
    /// is wrong.
    pub other_starts: Vec<Vec<f64>>,
}

impl Candidate {
    /// Return whether it is this `effect` on this `axis`.
    pub(super) fn is(&self, effect: &Effect, axis: Axis) -> bool {
        self.effect == effect && self.axis == axis
    }
}

/// Most waves of one effect on one axis.
const MOST_WAVES: usize = 5;

/// Effects that are tried on single axes, after the screen of the shared ones.
const TRIED_ALONE: usize = 20;

/// Every effect that the stage of `problem` can show and that `found` lacks: first shared by all axes, then the best on
/// each axis alone.
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
    best.sort_by(|a, b| b.explained_fraction.total_cmp(&a.explained_fraction));
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
            let on_line =
                leading.iter().find(|(own, _)| own == effect).map(|(_, probe)| probe.clone());
            let probes: Vec<Vec<f64>> = match on_line {
                Some(probe) => vec![probe],
                // Effects that one axis already has, or that exist on single axes only, were not screened yet.
                None if !best.iter().any(|other| other.effect == *effect) => {
                    probes(problem, &linear_residual, found.point.twin.machine, effect)
                }
                None => Vec::new(),
            };
            probes.into_iter().map(|probe| (*effect, *axis, probe)).collect::<Vec<_>>()
        })
        .collect();
    best.extend(screen.run(tries));
    best.sort_by(|a, b| b.explained_fraction.total_cmp(&a.explained_fraction));
    best
}

/// Probes of `effect`; for a scanned parameter with the values that the residual of the first part proposes.
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
    let proposed: Vec<Vec<f64>> = (scan.propose)(&series, longest_in_travels(machine))
        .into_iter()
        .map(|value| {
            let mut probe = first.clone();
            probe[scan.parameter] = value;
            probe
        })
        .collect();
    if proposed.is_empty() { listed } else { proposed }
}

/// Common data of all tests of one screen.
struct Screen<'a, 'b> {
    problem: &'b Problem<'a>,
    found: &'b Fit,
    filters: &'b Filters,
    base: Evaluated,
    linear: Linear,
    normal: Normal,
}

impl Screen<'_, '_> {
    /// Test every (effect, axis, probe); the best probe of each is kept.
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
                detectability: tested.detectability * magnitude_ratio(effect, &probe),
                is_as_good_as_refit: false,
                parameter_offsets: tested.parameter_offsets(effect, &probe),
                shift: tested.shift,
                other_starts: Vec::new(),
                probe,
                explained_fraction: tested.explained_fraction,
                statistic: tested.statistic,
                p_value: tested.p_value,
                tries: 1,
            };
            match best.iter_mut().find(|other| other.is(effect, axis)) {
                Some(other) => {
                    let tries = other.tries + 1;
                    let detectability = other.detectability.max(candidate.detectability);
                    let mut other_starts = mem::take(&mut other.other_starts);
                    let worse = match other.explained_fraction < candidate.explained_fraction {
                        true => mem::replace(other, candidate),
                        false => candidate,
                    };
                    if effect.scanned_parameter().is_some() {
                        other_starts.push(worse.start);
                    }
                    other.other_starts = other_starts;
                    other.tries = tries;
                    other.detectability = detectability;
                }
                None => best.push(candidate),
            }
        }
        best
    }
}

/// Ratio of the largest plausible magnitude to that of `probe`.
pub(super) fn magnitude_ratio(effect: &Effect, probe: &[f64]) -> f64 {
    let (low, high) = effect.parameters[0].plausible;
    let null = effect.null[0];
    let away = (probe[0] - null).abs();
    let farthest = (low - null).abs().max((high - null).abs());
    // If null is far outside the plausible range (a limit that never acts), the probe decides.
    if away == 0.0 || (low..=high).contains(&null) || null == 0.0 {
        if away == 0.0 { 1.0 } else { (farthest / away).max(1.0) }
    } else {
        1.0
    }
}

/// Usual magnitude of the effect, as a fraction of its largest plausible one. It is the geometric mean of the plausible
/// range, or a third of the largest where the range begins at null or contains it.
pub(super) fn usual_fraction(effect: &Effect) -> f64 {
    let (low, high) = effect.parameters[0].plausible;
    let null = effect.null[0];
    let (one, other) = ((low - null).abs(), (high - null).abs());
    let (least, most) = (one.min(other), one.max(other));
    let has_sign = null <= low || high <= null;
    if has_sign && 0.0 < least { (least / most).sqrt() } else { 1.0 / 3.0 }
}

/// Starts of a fit of `candidate`: the linearized estimate, the probe, and values between the probe and null. These
/// have equal ratios where null is far off (a limit that never acts), else equal steps.
#[must_use]
pub(super) fn starts_towards_null(candidate: &Candidate) -> Vec<Vec<f64>> {
    let effect = candidate.effect;
    let far = |k: usize| is_far(candidate.probe[k], effect.null[k]);
    let mut starts = vec![candidate.start.clone(), candidate.probe.clone()];
    let fractions: &[f64] = if far(0) { &[0.9, 0.8, 0.5, 0.25, 0.1] } else { &[0.5, 0.25, 0.1] };
    for explained_fraction in fractions {
        let values = candidate.probe.iter().enumerate().map(|(k, probe)| {
            let null = effect.null[k];
            if far(k) {
                null * (probe / null).powf(*explained_fraction)
            } else {
                null + explained_fraction * (probe - null)
            }
        });
        // Only the magnitude is reduced; a shape parameter (a speed, a period) stays.
        let values = values.enumerate();
        starts.push(
            values.map(|(k, value)| if k == 0 { value } else { candidate.probe[k] }).collect(),
        );
    }
    starts
}

/// Ratio of null to probe from which values between them have equal ratios.
const FAR: f64 = 5.0;

/// Return whether null is too far from a probe for a linearization (a limit that never acts).
pub(super) fn is_far(probe: f64, null: f64) -> bool {
    0.0 < probe && FAR * probe < null
}

/// Return whether `axis` means all coordinates alike.
pub(super) fn is_shared(axis: Axis) -> bool {
    matches!(axis, Axis::Motors | Axis::Guides | Axis::Whole | Axis::Single)
}

/// Pairs of effect and axis to screen.
pub(super) fn pairs(problem: &Problem<'_>, twin: &Twin) -> Vec<(&'static Effect, Axis)> {
    let mut pairs = Vec::new();
    for effect in problem.context.options.candidates() {
        let stages = problem.parts.iter().map(|part| part.stage);
        if effect.is_noise() || user_effects::objection(effect, twin.machine, stages).is_some() {
            continue;
        }
        for effect in twin.forms_of(effect) {
            for axis in twin.machine.axes(effect.site) {
                let is_felt = problem.parts.iter().any(|part| part.stage.feels(effect, axis));
                if is_felt && may_be_added(twin, effect, axis) {
                    pairs.push((effect, axis));
                }
            }
        }
    }
    pairs
}

/// Return whether `effect` may be added on `axis`: once, or several times with different values of the parameter that
/// is scanned for. A gain of the input of an axis multiplies mass and frictions, so only a twin with a reference shows it.
fn may_be_added(twin: &Twin, effect: &Effect, axis: Axis) -> bool {
    let is_new_axis = twin.axis_frame.is_some() && twin.reference_residuals.is_empty();
    if is_new_axis && effect.name == "drive.gain" {
        return false;
    }
    let present = twin
        .instances
        .iter()
        .filter(|own| own.effect.name == effect.name && own.axis.overlaps(axis));
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

/// Values of `effect` with one amplitude each, where it has several. Either the parameters of a session (sine and
/// cosine of one wave), at the probe's shape; or all parameters of an effect with a single probe, the others at null.
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

/// Parameters of `effect` that are components of a wave with its own phase in every session.
fn waves(effect: &Effect) -> Vec<usize> {
    (0..effect.parameters.len()).filter(|k| effect.parameters[*k].per_session).collect()
}

/// Result of the test of one probe.
struct Tested {
    explained_fraction: f64,
    statistic: f64,
    p_value: f64,
    detectability: f64,
    /// Factor of each amplitude: one for all parameters together, or one for each.
    factors: Vec<f64>,
    /// Shift of the known parameters at these factors (scaled).
    shift: Vec<f64>,
}

impl Tested {
    const NOTHING: Self = Self {
        explained_fraction: 0.0,
        statistic: 0.0,
        p_value: 1.0,
        detectability: 0.0,
        factors: Vec::new(),
        shift: Vec::new(),
    };

    /// Start of a fit: the probe with its amplitudes at the linearized estimate, within a factor of 20.
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
    /// Linearized estimate of each parameter of `effect`, as the offset from null: the first at the shape of the probe,
    /// or each that is an amplitude.
    fn parameter_offsets(&self, effect: &Effect, probe: &[f64]) -> Vec<f64> {
        let mut parameter_offsets = vec![0.0; probe.len()];
        let amplitudes = amplitudes(effect, probe);
        if 1 < self.factors.len() && amplitudes.len() == self.factors.len() {
            for (factor, alone) in self.factors.iter().zip(&amplitudes) {
                for (k, value) in alone.iter().enumerate() {
                    let is_shape = !waves(effect).is_empty() && !waves(effect).contains(&k);
                    if !is_shape && *value != effect.null[k] {
                        parameter_offsets[k] = (value - effect.null[k]) * factor;
                    }
                }
            }
        } else if let Some(factor) = self.factors.first()
            && !is_far(probe[0], effect.null[0])
        {
            parameter_offsets[0] = (probe[0] - effect.null[0]) * factor;
        }
        parameter_offsets
    }
}

/// Project the directions of nuisances and known parameters out of `column`.
pub(super) fn beyond_known(linear: &Linear, normal: &Normal, column: &mut [f64]) {
    linear.take_nuisances_from(column);
    beyond_parameters(linear, normal, column);
}

/// Project the directions of known parameters out of `column`; return their coefficients.
fn beyond_parameters(linear: &Linear, normal: &Normal, column: &mut [f64]) -> Vec<f64> {
    let products: Vec<f64> = linear.columns.iter().map(|known| dot(known, column)).collect();
    let weights = normal.solve(&products);
    for (known, weight) in linear.columns.iter().zip(&weights) {
        column.iter_mut().zip(known).for_each(|(value, known)| *value -= weight * known);
    }
    weights
}

/// Test the columns of one probe: the first for all parameters together, then each alone. At least the fraction `least`
/// of their squared length must remain beyond the known parameters.
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
    // Each parameter is its own amplitude where each alone has an influence.
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
    // Negative by rounding only.
    let statistic = statistic.max(0.0);
    Tested {
        explained_fraction: explained / total,
        statistic,
        p_value,
        detectability: left.sqrt(),
        factors,
        shift,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::find;

    #[test]
    fn usual_sizes_are_in_the_middle_of_the_plausible_ones() {
        let of = |name| usual_fraction(find(name).unwrap());
        // 0.2 to 3 ms; -3 to 3 kg/m; 1 to 100 kN/m.
        assert!((of("drive.current_loop") - (0.2_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((of("gantry.mass_position") - 1.0 / 3.0).abs() < 1e-12);
        assert!((of("gantry.endstop") - 0.1).abs() < 1e-12);
    }
}
