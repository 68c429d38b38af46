//! Comparison of recordings with the reference residuals and the discrepancy of the given twin.
//!
//! A reference residual is the final residual of a search on another recording of the machine: measurement noise and
//! model error. A recording at its reference residual contains nothing new. Small effects in it are more often model
//! errors on another motion than physics.

use super::{
    fit,
    problem::{Point, Problem},
    rounds::{Outcome, Reason},
    screen::{self, Candidate},
    thresholds::Thresholds,
};
use crate::{
    effects::{Domain, Effect, Physics},
    twin::{Channel, Discrepancy, Instance, Machine, ReferenceResidual, Source, StageKind, Twin},
};

/// Excess of the recordings over the reference residuals, as fractions of the squared residual.
#[derive(Debug, Clone, Copy)]
pub(super) struct Excess {
    /// Largest excess of a signal.
    pub(super) most: f64,
    /// Smallest excess of a signal; negative where the residual is below its reference.
    least: f64,
    /// Mean excess of all signals.
    mean: f64,
}

impl Excess {
    /// New fraction of the residual. Another motion moves model error from one signal to another (from velocity to
    /// torque in slow motions): a deficit in one signal offsets an excess in another.
    fn new_fraction(self, thresholds: &Thresholds) -> f64 {
        (self.most + self.least.clamp(-thresholds.moved_residual, 0.0)).max(self.most.min(0.0))
    }

    /// Mean excess of all signals as a fraction of the squared residual.
    fn fraction_of_residual(self) -> f64 {
        let above = self.mean.max(0.0);
        above / (1.0 + above)
    }

    /// Return whether the motion differs from that of the reference residuals.
    fn is_on_another_course(self, thresholds: &Thresholds) -> bool {
        self.least < -thresholds.reference_excess
    }
}

/// Excess of the residual at `points` over the reference residual of `twin`; `None` where a signal has no reference.
pub(super) fn excess<const N: usize>(
    twin: &Twin,
    points: [(&Problem<'_>, &Point); N],
) -> Option<Excess> {
    let channels = points.first()?.0.parts.first()?.stage.channels();
    let reference = |channel: &Channel| {
        let is_known = |own: &&ReferenceResidual| own.signal == channel.signal && own.searched;
        twin.reference_residuals.iter().find(is_known)
    };
    let references: Vec<&ReferenceResidual> =
        channels.iter().map(reference).collect::<Option<_>>()?;
    let squares = points
        .map(|(problem, point)| problem.squares(&fit::with_refitted_nuisances(problem, point)));
    let mut excess = Excess { most: f64::NEG_INFINITY, least: f64::INFINITY, mean: 0.0 };
    for (k, reference) in references.into_iter().enumerate() {
        let own = squares.iter().filter_map(|problem| problem.get(k));
        let (sum, count) = own.fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
        let known = reference.residual_rms.powi(2) * count as f64;
        let own = sum / known.max(f64::MIN_POSITIVE) - 1.0;
        excess = Excess {
            most: excess.most.max(own),
            least: excess.least.min(own),
            mean: excess.mean + own / channels.len() as f64,
        };
    }
    Some(excess)
}

/// Comparison of the residual of a single axis with its noise floor. Below the floor, an effect may
/// explain an error of the floor, which is low where the noise is coloured, or a model error of the
/// simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum AtFloor {
    /// Ratio of the residual to its floor.
    Yes(f64),
    No,
}

/// The time (s) of an effect that has no other parameter: a delay or a first-order lag.
pub(super) fn lag(instance: &Instance) -> Option<f64> {
    let ([parameter], [lag]) = (instance.effect.parameters, &instance.values[..]) else {
        return None;
    };
    (parameter.unit == "s").then_some(lag.value)
}

/// Sample period (s) of the axis of `twin`, where `instance` is a lag and all lags together differ
/// from those of the `given` twin by less than that period. The stamp of an input does not define
/// when it acts: at that time, until the next stamp (zero-order hold), or since the last one. Lags
/// of the same sum are hardly distinguishable.
pub(super) fn sample_period_above_lag(
    given: &Twin,
    twin: &Twin,
    instance: &Instance,
) -> Option<f64> {
    let period = twin.axis_frame?.scales.sample_period;
    lag(instance)?;
    (added_lag(given, twin).abs() < period).then_some(period)
}

/// Difference between the sums of all lags of two twins (s).
pub(super) fn added_lag(given: &Twin, twin: &Twin) -> f64 {
    let sum = |twin: &Twin| twin.instances.iter().filter_map(lag).sum::<f64>();
    sum(twin) - sum(given)
}

/// Fraction of the squared validation error that an effect must remove to be added.
#[derive(Debug, Clone, Copy)]
pub(super) struct RequiredGain<'t> {
    thresholds: &'t Thresholds,
    /// For an effect without a discrepancy of the given twin.
    general: f64,
    /// For an effect with one, at least.
    known: f64,
    /// For an effect in addition to those that were added before.
    conditional: f64,
    /// Discrepancy of the given twin.
    discrepancy: &'t [Discrepancy],
    /// Squared reference residual of a single axis as a fraction of the present one: what a discrepancy explained is a
    /// fraction of the former. That of a table grows with the change, as its simulator does not follow it exactly.
    reference_fraction: f64,
    stage: StageKind,
    floor: AtFloor,
    /// Fraction of the squared residual above the reference, up to which it is noise; `None` without a reference.
    above_reference: Option<f64>,
    machine: Machine,
    /// `true` where the gain in one signal, or in the plain residual, counts as well. `false` after an effect was
    /// added, and without a reference residual: a model error may be concentrated in one signal, and is mostly slow.
    pub(super) any_signal: bool,
}

impl<'t> RequiredGain<'t> {
    /// Required gains of the first effect from the reference residual of the given twin, the
    /// [`excess`] of `given` and `fitted` twin over it, and whether the residual is at its noise
    /// `floor`. The discrepancy of the twin hardly applies to another motion, or to other parameter values.
    pub(super) fn new(
        thresholds: &'t Thresholds,
        (given, stage): (&'t Twin, StageKind),
        (excess, fitted): (Option<Excess>, Option<Excess>),
        floor: AtFloor,
    ) -> Self {
        let general = match floor {
            AtFloor::Yes(ratio) => thresholds.least_gain_at_floor(ratio),
            AtFloor::No => thresholds.least_gain(fitted),
        };
        let is_elsewhere = !thresholds.is_at_reference(excess)
            || excess.is_some_and(|own| own.is_on_another_course(thresholds));
        Self {
            thresholds,
            general,
            known: match floor {
                AtFloor::No if !is_elsewhere => thresholds.min_gain,
                _ => general,
            },
            conditional: 0.0,
            discrepancy: &given.discrepancy,
            reference_fraction: match (given.machine, excess) {
                (Machine::Axis, Some(excess)) => 1.0 / (1.0 + excess.most.max(0.0)),
                _ => 1.0,
            },
            stage,
            floor,
            above_reference: fitted.map(Excess::fraction_of_residual),
            machine: given.machine,
            any_signal: excess.is_some(),
        }
    }

    /// Required gains of one more effect on the twin `base`. The added ones `removed` a squared residual, and a square of
    /// `left` remains, both in the metric in which the effect is tested. On a drive with backlash, one more effect must explain
    /// most of what is above the reference. Impact times depend on noise there, so no simulation reproduces them.
    pub(super) fn in_addition_to(self, base: &Twin, removed: f64, left: f64) -> Self {
        let conditional = match self.above_reference.filter(|_| base.rattles_in(self.stage)) {
            Some(above) => self.thresholds.majority * above,
            None => self.least_after(removed, left),
        };
        Self { conditional, any_signal: false, ..self }
    }

    /// Required gains of an effect among others, tested without it, whichever of them was added first.
    pub(super) fn in_any_order(self) -> Self {
        Self { conditional: self.least_after(0.0, 1.0), any_signal: false, ..self }
    }

    /// Least gain after effects that `removed` a squared residual, with a square of `left`. On a table with a reference, the
    /// rest may be a model error along the added effects, in proportion to them, unless one more effect explains most of
    /// what is above the reference. The noise floor of a single axis contains its model error; below the floor, one more
    /// effect must explain most of the rest.
    fn least_after(&self, removed: f64, left: f64) -> f64 {
        match (self.machine, self.floor, self.above_reference) {
            (Machine::Table, _, Some(above)) => {
                let model_error = self.thresholds.model_error_of(self.machine);
                let least = model_error * removed.max(0.0) / left.max(f64::MIN_POSITIVE);
                least.min(self.thresholds.majority * above)
            }
            (Machine::Axis, AtFloor::Yes(_), _) => self.thresholds.majority,
            _ => 0.0,
        }
    }

    /// Return whether `twin` only redistributes the lags of `base`, on a machine with a reference
    /// and at its noise floor. The sums of all lags then differ by less than a sample period. Such
    /// a change must explain most of the residual.
    pub(super) fn only_redistributes_lag(&self, base: &Twin, twin: &Twin) -> bool {
        let is_lag = |last: &Instance| sample_period_above_lag(base, twin, last).is_some();
        self.above_reference.is_some()
            && self.floor != AtFloor::No
            && twin.instances.last().is_some_and(is_lag)
    }

    /// Gain that `effect` must have for any discrepancy of the given twin.
    pub(super) fn least(&self, effect: &Effect) -> f64 {
        let least = match self.is_exact(effect) {
            true => self.thresholds.min_gain_map,
            false => self.known.min(self.general),
        };
        least.max(self.conditional)
    }

    /// `base` with each model error of the given twin that was simulated, unless the effect is in it.
    pub(super) fn with_model_errors(&self, base: &Twin) -> Vec<Twin> {
        let of_stage = self.discrepancy.iter().filter(|own| own.stage == self.stage);
        let with = |own: &Discrepancy| {
            let fitted = own.fitted.as_ref()?;
            (!base.has(fitted.effect.name, fitted.axis))
                .then(|| screen::with(base, fitted.effect, fitted.axis, &fitted.numbers()))
        };
        of_stage.filter_map(with).collect()
    }

    /// Return whether `effect` maps positions after the measurement.
    fn is_exact(&self, effect: &Effect) -> bool {
        let is_map = matches!(effect.physics, Physics::Camera(_) | Physics::Frame(_));
        is_map && self.stage == StageKind::Camera
    }

    /// Discrepancy of the given twin along `effect`.
    fn known(&self, effect: &Effect) -> Option<&'t Discrepancy> {
        discrepancy(self.discrepancy, self.stage, effect)
    }

    /// Return whether an effect with one parameter at `value` lies within the discrepancy of the given twin. It is then
    /// not clearly larger than the offset on the reference data, so nothing has changed.
    pub(super) fn is_within_discrepancy(&self, effect: &Effect, value: f64) -> bool {
        let ([null], Some(known)) = (effect.null, self.known(effect)) else { return false };
        let is_within = |offset: &f64| {
            0.0 < offset * (value - null)
                && (value - null).abs() < self.thresholds.size_ratio * offset.abs()
        };
        known.parameter_offsets.first().is_some_and(is_within)
    }

    /// Required gain of `effect` with its parameter values.
    pub(super) fn of(&self, effect: &Effect, values: &[f64]) -> f64 {
        let thresholds = self.thresholds;
        let biased = |own: &Discrepancy| {
            thresholds.size_ratio * own.explained_fraction * self.reference_fraction
        };
        let own = match self.known(effect).map(biased) {
            Some(fraction) if self.is_exact(effect) => fraction.max(thresholds.min_gain_map),
            Some(fraction) => fraction.max(self.known),
            None if self.is_exact(effect) => thresholds.min_gain_map,
            None => self.general,
        };
        let below = below_fidelity(effect, values);
        let least = below.map_or(0.0, |below| thresholds.clear_gain * below);
        own.max(self.conditional).max(least)
    }
}

/// Note the discrepancy of the stage of `outcome`: the fraction of the final residual that each rejected effect explains,
/// and each that was added and removed again.
pub(super) fn note_discrepancy(twin: &mut Twin, outcome: &Outcome<'_>) {
    twin.discrepancy.retain(|own| own.stage != outcome.kind);
    let rejected = outcome.rejected.iter().map(|rejected| Discrepancy {
        stage: outcome.kind,
        effect: rejected.candidate.effect.name.to_owned(),
        // A simulated candidate may have been screened at the given twin, which left a larger residual.
        explained_fraction: rejected
            .validation_gain
            .map_or(rejected.candidate.explained_fraction, |gain| gain.max(0.0)),
        parameter_offsets: rejected.candidate.parameter_offsets.clone(),
        fitted: rejected.values.clone().filter(|_| rejected.reason == Reason::TooSmall).map(
            |values| {
                let Candidate { effect, axis, .. } = rejected.candidate;
                Instance::new(effect, axis, &values, Source::Fitted)
            },
        ),
    });
    let is_absent =
        |own: &&Discrepancy| !outcome.added.iter().any(|step| step.effect.name == own.effect);
    let removed = outcome.removed.iter().filter(is_absent).cloned();
    let mut noted: Vec<Discrepancy> = Vec::new();
    for own in rejected.chain(removed) {
        match noted.iter_mut().find(|other| other.effect == own.effect) {
            Some(other) => {
                if other.explained_fraction < own.explained_fraction
                    || other.parameter_offsets.is_empty()
                {
                    other.parameter_offsets = own.parameter_offsets;
                }
                if other.fitted.is_none() || other.explained_fraction < own.explained_fraction {
                    other.fitted = own.fitted.or(other.fitted.take());
                }
                other.explained_fraction = other.explained_fraction.max(own.explained_fraction);
            }
            None => noted.push(own),
        }
    }
    twin.discrepancy.extend(noted);
}

/// Discrepancy of `stage` along `effect`.
fn discrepancy<'t>(
    all: &'t [Discrepancy],
    stage: StageKind,
    effect: &Effect,
) -> Option<&'t Discrepancy> {
    all.iter().find(|own| own.stage == stage && own.effect == effect.name)
}

/// Offset of each parameter of `effect` that the discrepancy of `stage` imitates: smaller offsets are not identifiable.
pub(super) fn offsets(given: &Twin, stage: StageKind, effect: &Effect) -> Vec<f64> {
    let known = discrepancy(&given.discrepancy, stage, effect);
    known.map_or_else(Vec::new, |own| own.parameter_offsets.clone())
}

/// Ratio by which an effect with these parameter values is below the resolution of a simulation, 1 at the limit; `None`
/// above it. The magnitude is a time shorter than plausible; on a drive, a time within one step of its control loop,
/// where every simulator errs by a fraction of the step. Or a shape parameter is smaller than plausible, though not
/// zero.
fn below_fidelity(effect: &Effect, values: &[f64]) -> Option<f64> {
    let all = effect.parameters.iter().zip(effect.null).zip(values).enumerate();
    let below = all.filter_map(|(index, ((parameter, null), value))| {
        let (least, size) = (parameter.plausible.0, value.abs());
        match index {
            0 if parameter.unit != "s" => None,
            0 if effect.domain == Domain::Drive => (size < least).then(|| least / size),
            0 => (size < least).then_some(1.0),
            _ => (0.0 < least && size < least && value != null).then_some(1.0),
        }
    });
    below.max_by(f64::total_cmp)
}

impl Thresholds {
    /// Return whether recordings with this [`excess`] contain nothing new.
    pub(super) fn is_at_reference(&self, excess: Option<Excess>) -> bool {
        excess.is_some_and(|excess| excess.new_fraction(self) < self.reference_excess)
    }

    /// Fraction of the squared validation residual of a twin with this `excess` that a change must remove. At the
    /// reference, it is a fraction of the squared reference residual: smaller changes are model errors.
    pub(super) fn least_gain(&self, excess: Option<Excess>) -> f64 {
        match excess.filter(|_| self.is_at_reference(excess)) {
            Some(own) => self.clear_gain / (1.0 + own.mean.min(0.0)).max(f64::MIN_POSITIVE),
            None => self.min_gain,
        }
    }

    /// The same on a single axis whose residual is at its noise floor, with this `ratio` to it: a fraction of the
    /// squared floor, as of an unexplained dependence. Smaller changes are model errors.
    pub(super) fn least_gain_at_floor(&self, ratio: f64) -> f64 {
        self.large_excess.max(self.reference_excess / ratio.powi(2))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, AxisScales},
        twin::{AxisFrame, Source},
    };

    const DEFAULT: Thresholds = Thresholds::DEFAULT;

    const SCALES: AxisScales = AxisScales {
        input: 3.0,
        position: 0.1,
        velocity: 0.2,
        acceleration: 2.0,
        sample_period: 1e-3,
        band: 40.0,
        duration: 20.0,
        input_unit: "N",
        position_unit: "m",
    };

    /// The same excess in every signal.
    fn even(fraction: f64) -> Option<Excess> {
        Some(Excess { most: fraction, least: fraction, mean: fraction })
    }

    #[test]
    fn a_residual_at_its_noise_floor_requires_a_large_gain() {
        let twin = Twin::nominal(Machine::Axis);
        let lag = crate::effects::find("drive.lag1").unwrap();
        let of = |floor| {
            RequiredGain::new(&DEFAULT, (&twin, StageKind::Axis), (None, None), floor)
                .of(lag, &[0.1])
        };
        let gains = [of(AtFloor::Yes(1.0)), of(AtFloor::No)];
        assert_eq!(gains, [DEFAULT.large_excess, DEFAULT.min_gain]);
        // Far below the floor no gain suffices: it is a fraction of the squared floor.
        assert!((of(AtFloor::Yes(0.25)) - 0.8).abs() < 1e-12);
        assert!(1.0 < of(AtFloor::Yes(0.1)));
    }

    #[test]
    fn lags_of_the_same_sum_are_no_new_lag() {
        let lags = |delay: f64, lag1: Option<f64>| {
            let mut twin = Twin::nominal(Machine::Axis);
            twin.axis_frame = Some(AxisFrame { position_origin: 0.0, scales: SCALES });
            let mut add = |name: &str, value: f64| {
                let effect = crate::effects::find(name).unwrap();
                twin.instances.push(Instance::new(effect, Axis::Single, &[value], Source::Fitted));
            };
            add("drive.delay", delay);
            if let Some(time) = lag1 {
                add("drive.lag1", time);
            }
            twin
        };
        let period = lags(0.0, None).axis_frame.unwrap().scales.sample_period;
        let known = lags(2.0 * period, None);
        let floor = |floor| {
            RequiredGain::new(&DEFAULT, (&known, StageKind::Axis), (even(0.0), even(0.0)), floor)
        };
        let other = lags(0.5 * period, Some(1.6 * period));
        assert!((added_lag(&known, &other) - 0.1 * period).abs() < 1e-12);
        assert!(floor(AtFloor::Yes(0.5)).only_redistributes_lag(&known, &other));
        assert!(!floor(AtFloor::No).only_redistributes_lag(&known, &other));
        let slower = lags(0.5 * period, Some(4.0 * period));
        assert!(!floor(AtFloor::Yes(0.5)).only_redistributes_lag(&known, &slower));
    }

    #[test]
    fn a_residual_at_its_reference_is_not_new_and_requires_a_larger_gain() {
        assert!(DEFAULT.is_at_reference(even(-0.3)) && DEFAULT.is_at_reference(even(0.04)));
        assert!(!DEFAULT.is_at_reference(even(0.06)));
        // A twin without a search has no reference residual.
        assert!(!DEFAULT.is_at_reference(None));
        let least = |excess| DEFAULT.least_gain(excess);
        assert!(least(None) < least(even(0.0)));
        assert_eq!(least(even(0.5)), least(None));
        // Where a refit leaves a quarter of the reference, an effect must remove the same of the reference.
        assert_eq!(least(even(-0.75)), 4.0 * least(even(0.0)));
        assert_eq!(least(even(0.04)), least(even(0.0)));
    }

    #[test]
    fn a_deficit_in_one_signal_offsets_an_excess_in_another() {
        let uneven = |most, least| Some(Excess { most, least, mean: 0.5 * (most + least) });
        assert!(
            DEFAULT.is_at_reference(uneven(0.12, -0.1))
                && !DEFAULT.is_at_reference(uneven(0.12, -0.04))
        );
        // A far smaller residual is less noise, and moves nothing.
        assert!(!DEFAULT.is_at_reference(uneven(0.25, -0.6)));
    }

    #[test]
    fn an_effect_must_exceed_the_discrepancy_of_the_given_twin() {
        let effect = |name| crate::effects::find(name).unwrap();
        let (lag, delay) = (effect("drive.lag1"), effect("drive.delay"));
        let mut twin = Twin::nominal(Machine::Table);
        twin.discrepancy = vec![Discrepancy {
            stage: StageKind::Drive,
            effect: lag.name.to_owned(),
            explained_fraction: 0.03,
            parameter_offsets: vec![2e-5],
            fitted: None,
        }];
        let required_gain = |stage, excess| {
            RequiredGain::new(&DEFAULT, (&twin, stage), (excess, excess), AtFloor::No)
        };
        let known = required_gain(StageKind::Drive, even(0.0));
        assert!((known.of(lag, &[1e-3]) - 0.09).abs() < 1e-12 && known.any_signal);
        assert_eq!(known.of(delay, &[1e-3]), DEFAULT.clear_gain);
        assert_eq!(
            required_gain(StageKind::Camera, even(0.0)).of(lag, &[1e-3]),
            DEFAULT.clear_gain
        );
        assert!(known.is_within_discrepancy(lag, 5e-5) && !known.is_within_discrepancy(lag, 7e-5));
        assert!(
            !known.is_within_discrepancy(lag, -5e-5) && !known.is_within_discrepancy(delay, 1e-5)
        );
        let elsewhere = Excess { most: 0.0, least: -0.1, mean: -0.05 };
        let elsewhere = required_gain(StageKind::Drive, Some(elsewhere));
        assert_eq!(elsewhere.of(lag, &[1e-3]), DEFAULT.clear_gain / 0.95);
        // Nor does it apply to changed parameters, and what they leave at the reference is not new.
        let changed = |fitted| {
            RequiredGain::new(&DEFAULT, (&twin, StageKind::Drive), (even(1e4), fitted), AtFloor::No)
        };
        assert_eq!(changed(even(0.0)).of(lag, &[1e-3]), DEFAULT.clear_gain);
        assert!((changed(even(0.2)).of(lag, &[1e-3]) - 0.09).abs() < 1e-12);
        assert_eq!(changed(even(0.2)).of(delay, &[1e-3]), DEFAULT.min_gain);
    }

    /// Required gains on the drives of a table with this excess, as given and fitted.
    fn on_drives(excess: Option<Excess>, twin: &Twin) -> RequiredGain<'_> {
        RequiredGain::new(&DEFAULT, (twin, StageKind::Drive), (excess, excess), AtFloor::No)
    }

    /// An effect added after a large one must exceed the model error of that one, unless the machine has no reference.
    #[test]
    fn one_more_effect_must_exceed_the_model_error_of_those_before() {
        let delay = crate::effects::find("drive.delay").unwrap();
        let twin = Twin::nominal(Machine::Table);
        let conditional = on_drives(even(1.0), &twin).in_addition_to(&twin, 3.0, 2.0);
        assert!(
            (conditional.of(delay, &[1e-3]) - 1.5 * DEFAULT.min_gain).abs() < 1e-12
                && !conditional.any_signal
        );
        // Half of the residual is above the reference, and the other half noise.
        let most = on_drives(even(1.0), &twin).in_addition_to(&twin, 1e3, 1.0);
        assert_eq!(most.of(delay, &[1e-3]), 0.5 * DEFAULT.majority);
        let unknown = on_drives(None, &twin).in_addition_to(&twin, 3.0, 2.0);
        assert!(unknown.of(delay, &[1e-3]) == DEFAULT.min_gain && !unknown.any_signal);
        let backlash = crate::effects::find("drive.backlash").unwrap();
        let mut rattling = twin.clone();
        rattling.instances.push(Instance::new(
            backlash,
            Axis::Motors,
            &[1e-3, 50.0],
            Source::Fitted,
        ));
        let beside = on_drives(even(1.0), &twin).in_addition_to(&rattling, 3.0, 2.0);
        assert_eq!(beside.of(delay, &[1e-3]), 0.5 * DEFAULT.majority);
        // The floor of a single axis contains its model error.
        let axis = Twin::nominal(Machine::Axis);
        let of_axis = |floor| {
            RequiredGain::new(&DEFAULT, (&axis, StageKind::Axis), (even(1.0), even(1.0)), floor)
                .in_addition_to(&axis, 3.0, 2.0)
                .of(delay, &[1e-3])
        };
        assert_eq!(of_axis(AtFloor::No), DEFAULT.min_gain);
        assert_eq!(of_axis(AtFloor::Yes(0.9)), DEFAULT.majority);
        let least = |floor| {
            RequiredGain::new(&DEFAULT, (&axis, StageKind::Axis), (even(1.0), even(1.0)), floor)
                .in_any_order()
                .least(delay)
        };
        assert_eq!(least(AtFloor::No), DEFAULT.min_gain);
        assert_eq!(least(AtFloor::Yes(0.9)), DEFAULT.majority);
    }

    #[test]
    fn an_effect_must_exceed_the_resolution_of_a_simulation() {
        let effect = |name| crate::effects::find(name).unwrap();
        let twin = Twin::nominal(Machine::Table);
        // A map of positions simulates nothing: applied to measured positions, it may be small.
        let shear = effect("gantry.squareness");
        let required_for_shear = |stage| {
            let excess = (even(0.0), even(0.0));
            RequiredGain::new(&DEFAULT, (&twin, stage), excess, AtFloor::No).of(shear, &[1e-3])
        };
        assert_eq!(required_for_shear(StageKind::Camera), DEFAULT.min_gain_map);
        assert_eq!(required_for_shear(StageKind::Ball), DEFAULT.clear_gain);
        // A lag within a step must be larger too, and so must contacts that hardly deflect.
        let unknown = on_drives(None, &twin);
        let presliding = effect("drive.friction.presliding");
        let bristles = |distance| unknown.of(presliding, &[1.0, distance, 1e-3, 0.0]);
        assert!(bristles(1e-5) == DEFAULT.min_gain && bristles(2e-7) == DEFAULT.clear_gain);
        assert!(
            (unknown.of(effect("drive.delay"), &[1e-4]) - 2.0 * DEFAULT.clear_gain).abs() < 1e-12
        );
    }
}
