//! What is new: recordings compared with what the given twin is known to leave.
//!
//! Where the search on another recording of the machine ended, the twin left something: sensor noise, and
//! what the simulation cannot follow. Recordings that it leaves no more of hold nothing new, and small
//! effects in them are more often the simulation's own errors under another course than physics.

use super::{
    fit,
    problem::{Point, Problem},
    rounds::Outcome,
    thresholds::Thresholds,
};
use crate::{
    effects::{Domain, Effect, Physics},
    twin::{Discrepancy, ReferenceResidual, StageKind, Twin},
};

/// What recordings hold beyond what is known to be left, as shares of the squared residual.
#[derive(Debug, Clone, Copy)]
pub(super) struct Excess {
    /// Of the signal that holds most.
    pub(super) most: f64,
    /// Of the signal that holds least; below zero where it holds less than was left.
    least: f64,
}

impl Excess {
    /// What is new. What a simulation cannot follow moves from one signal to another with the course (from velocity
    /// to torque where motions are slow): what one has less than was left, another may have more.
    fn new_share(self, thresholds: &Thresholds) -> f64 {
        (self.most + self.least.clamp(-thresholds.moved_residual, 0.0)).max(self.most.min(0.0))
    }

    /// Whether the course is another than that of which it is known what is left.
    fn is_on_another_course(self, thresholds: &Thresholds) -> bool {
        self.least < -thresholds.reference_excess
    }
}

/// What `points` hold beyond what `twin` left when its own search ended; `None` where that is not known of some
/// signal.
pub(super) fn excess<const N: usize>(
    twin: &Twin,
    points: [(&Problem<'_>, &Point); N],
) -> Option<Excess> {
    let squares = points.map(|(problem, point)| problem.squares(&fit::told(problem, point)));
    let channels = points.first()?.0.parts.first()?.stage.channels();
    let mut excess = Excess { most: f64::NEG_INFINITY, least: f64::INFINITY };
    for (k, channel) in channels.iter().enumerate() {
        let own = squares.iter().filter_map(|problem| problem.get(k));
        let (sum, count) = own.fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
        let is_known = |own: &&ReferenceResidual| own.signal == channel.signal && own.searched;
        let reference = twin.reference_residuals.iter().find(is_known)?;
        let known = reference.residual_rms.powi(2) * count as f64;
        let own = sum / known.max(f64::MIN_POSITIVE) - 1.0;
        excess = Excess { most: excess.most.max(own), least: excess.least.min(own) };
    }
    Some(excess)
}

/// What share of the held-out squared error makes an effect worth a name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Worth<'t> {
    thresholds: &'t Thresholds,
    /// Where nothing is known of the effect.
    general: f64,
    /// Where it is.
    known: f64,
    /// Because of what stands beside it already.
    beside: f64,
    /// Discrepancy of the given twin.
    discrepancy: &'t [Discrepancy],
    stage: StageKind,
    /// Whether one signal alone may show the effect, or the residual as it is where the whitened one does not: not
    /// beside a named one, and not where it is not known what the twin leaves; a model's own error may be
    /// concentrated in one signal, and is mostly slow.
    pub(super) in_any_view: bool,
}

impl<'t> Worth<'t> {
    /// From what the given twin is known to leave, the [`excess`] of the recordings over it, and the share of
    /// the squared error that named effects `removed` of what it was. What an effect explained where it was not named
    /// says little of another course.
    pub(super) fn new(
        thresholds: &'t Thresholds,
        (given, stage): (&'t Twin, StageKind),
        excess: Option<Excess>,
        removed: f64,
    ) -> Self {
        let beside = match excess {
            Some(_) => thresholds.clear_gain * removed / (1.0 - removed).max(f64::MIN_POSITIVE),
            None => 0.0,
        };
        let general = thresholds.least_gain(excess);
        let is_elsewhere = excess.is_some_and(|own| own.is_on_another_course(thresholds));
        Self {
            thresholds,
            general,
            known: if is_elsewhere { general } else { thresholds.min_gain },
            beside,
            discrepancy: &given.discrepancy,
            stage,
            in_any_view: removed == 0.0 && excess.is_some(),
        }
    }

    /// Below which `effect` is not worth a name, whatever is known of it and stands beside it.
    pub(super) fn least(&self, effect: &Effect) -> f64 {
        match self.is_exact(effect) {
            true => self.thresholds.min_gain_map,
            false => self.known.min(self.general),
        }
    }

    /// Whether `effect` is a map of places behind what was measured.
    fn is_exact(&self, effect: &Effect) -> bool {
        let is_map = matches!(effect.physics, Physics::Camera(_) | Physics::Frame(_));
        is_map && self.stage == StageKind::Camera
    }

    /// What is known of `effect` where it was not named.
    fn known(&self, effect: &Effect) -> Option<&'t Discrepancy> {
        discrepancy(self.discrepancy, self.stage, effect)
    }

    /// Whether an effect of one number at `value` is not clearly more than what the twin looked like where it was not
    /// named: what was there before is not what has changed.
    pub(super) fn was_there_before(&self, effect: &Effect, value: f64) -> bool {
        let ([null], Some(known)) = (effect.null, self.known(effect)) else { return false };
        let is_within = |offset: &f64| {
            0.0 < offset * (value - null)
                && (value - null).abs() < self.thresholds.size_ratio * offset.abs()
        };
        known.parameter_offsets.first().is_some_and(is_within)
    }

    /// For `effect` with its numbers.
    pub(super) fn of(&self, effect: &Effect, numbers: &[f64]) -> f64 {
        let thresholds = self.thresholds;
        let biased = |own: &Discrepancy| thresholds.size_ratio * own.explained_fraction;
        let own = match self.known(effect).map(biased) {
            Some(share) if self.is_exact(effect) => share.max(thresholds.min_gain_map),
            Some(share) => share.max(self.known),
            None if self.is_exact(effect) => thresholds.min_gain_map,
            None => self.general,
        };
        let below = below_fidelity(effect, numbers);
        let least = below.map_or(0.0, |below| thresholds.clear_gain * below);
        own.max(self.beside).max(least)
    }
}

/// Note the discrepancy of the stage of `outcome`: the fraction of the final residual that each rejected effect explains.
pub(super) fn note_discrepancy(twin: &mut Twin, outcome: &Outcome<'_>) {
    twin.discrepancy.retain(|own| own.stage != outcome.kind);
    let mut noted: Vec<Discrepancy> = Vec::new();
    for rejected in &outcome.rejected {
        let effect = rejected.candidate.effect.name;
        // A simulated candidate may have been screened at the given twin, which left a larger residual.
        let screened = rejected.candidate.share;
        let fraction = rejected.validation_gain.map_or(screened, |gain| gain.max(0.0));
        let offsets = rejected.candidate.lean.clone();
        match noted.iter_mut().find(|other| other.effect == effect) {
            Some(other) => {
                if other.explained_fraction < fraction || other.parameter_offsets.is_empty() {
                    other.parameter_offsets = offsets;
                }
                other.explained_fraction = other.explained_fraction.max(fraction);
            }
            None => noted.push(Discrepancy {
                stage: outcome.kind,
                effect: effect.to_owned(),
                explained_fraction: fraction,
                parameter_offsets: offsets,
            }),
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

/// Offset of each parameter of `effect` that the discrepancy of `stage` imitates: smaller offsets cannot be determined.
pub(super) fn offsets(given: &Twin, stage: StageKind, effect: &Effect) -> Vec<f64> {
    let known = discrepancy(&given.discrepancy, stage, effect);
    known.map_or_else(Vec::new, |own| own.parameter_offsets.clone())
}

/// How far below what a simulation follows an effect with these numbers is, 1 at its edge: its size is a time shorter
/// than is plausible, for a drive within one step of its loop, in which every simulator is late or early by some share
/// of it; or a number that shapes it is less than is plausible, though not at nothing.
fn below_fidelity(effect: &Effect, numbers: &[f64]) -> Option<f64> {
    let all = effect.parameters.iter().zip(effect.null).zip(numbers).enumerate();
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
    /// Whether recordings with this [`excess`] hold nothing new.
    pub(super) fn is_at_reference(&self, excess: Option<Excess>) -> bool {
        excess.is_some_and(|excess| excess.new_share(self) < self.reference_excess)
    }

    /// Fraction of the squared validation residual that an effect must remove.
    pub(super) fn least_gain(&self, excess: Option<Excess>) -> f64 {
        match self.is_at_reference(excess) {
            true => self.clear_gain,
            false => self.min_gain,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::Machine;

    const DEFAULT: Thresholds = Thresholds::DEFAULT;

    /// The same in every signal.
    fn even(share: f64) -> Option<Excess> {
        Some(Excess { most: share, least: share })
    }

    #[test]
    fn what_is_known_to_be_left_is_nothing_new_and_worth_a_name_only_where_it_is_large() {
        assert!(DEFAULT.is_at_reference(even(-0.3)) && DEFAULT.is_at_reference(even(0.04)));
        assert!(!DEFAULT.is_at_reference(even(0.06)));
        // A twin that no search ended with leaves nothing that is known.
        assert!(!DEFAULT.is_at_reference(None));
        assert!(DEFAULT.least_gain(None) < DEFAULT.least_gain(even(0.0)));
        assert_eq!(DEFAULT.least_gain(even(0.5)), DEFAULT.least_gain(None));
    }

    #[test]
    fn what_one_signal_has_less_of_another_may_have_more_of() {
        let uneven = |most, least| Some(Excess { most, least });
        assert!(
            DEFAULT.is_at_reference(uneven(0.12, -0.1))
                && !DEFAULT.is_at_reference(uneven(0.12, -0.04))
        );
        // Far less is less noise, and moves nothing.
        assert!(!DEFAULT.is_at_reference(uneven(0.25, -0.6)));
    }

    #[test]
    fn what_the_twin_itself_looks_like_must_be_outdone() {
        let effect = |name| crate::effects::find(name).unwrap();
        let (lag, delay) = (effect("drive.lag1"), effect("drive.delay"));
        let mut twin = Twin::nominal(Machine::Table);
        twin.discrepancy = vec![Discrepancy {
            stage: StageKind::Drive,
            effect: lag.name.to_owned(),
            explained_fraction: 0.03,
            parameter_offsets: vec![2e-5],
        }];
        let worth = |link, excess, removed| Worth::new(&DEFAULT, (&twin, link), excess, removed);
        let known = worth(StageKind::Drive, even(0.0), 0.0);
        assert!((known.of(lag, &[1e-3]) - 0.09).abs() < 1e-12 && known.in_any_view);
        assert_eq!(known.of(delay, &[1e-3]), DEFAULT.clear_gain);
        assert_eq!(worth(StageKind::Camera, even(0.0), 0.0).of(lag, &[1e-3]), DEFAULT.clear_gain);
        assert!(known.was_there_before(lag, 5e-5) && !known.was_there_before(lag, 7e-5));
        assert!(!known.was_there_before(lag, -5e-5) && !known.was_there_before(delay, 1e-5));
        let elsewhere = worth(StageKind::Drive, Some(Excess { most: 0.0, least: -0.1 }), 0.0);
        assert_eq!(elsewhere.of(lag, &[1e-3]), DEFAULT.clear_gain);
        // What stands beside a large effect must be large too, unless nothing was known of the machine.
        let beside = worth(StageKind::Drive, even(1.0), 0.5);
        assert!((beside.of(delay, &[1e-3]) - 0.1).abs() < 1e-12 && !beside.in_any_view);
        let unknown = worth(StageKind::Drive, None, 0.5);
        assert!(unknown.of(delay, &[1e-3]) == DEFAULT.min_gain && !unknown.in_any_view);
        // A map of places simulates nothing: behind measured places it may be small.
        let shear = effect("gantry.squareness");
        let of_shear = |link| worth(link, even(0.0), 0.0).of(shear, &[1e-3]);
        assert_eq!(of_shear(StageKind::Camera), DEFAULT.min_gain_map);
        assert_eq!(of_shear(StageKind::Ball), DEFAULT.clear_gain);
        // A lag within a step must be larger too, and contacts that hardly bend.
        let presliding = effect("drive.friction.presliding");
        let bristles = |distance| unknown.of(presliding, &[1.0, distance, 1e-3, 0.0]);
        assert!(bristles(1e-5) == DEFAULT.min_gain && bristles(2e-7) == DEFAULT.clear_gain);
        assert!((unknown.of(delay, &[1e-4]) - 2.0 * DEFAULT.clear_gain).abs() < 1e-12);
    }
}
