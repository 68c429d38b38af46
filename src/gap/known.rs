//! What is new: recordings compared with what the given twin is known to leave.
//!
//! Where the search on another recording of the machine ended, the twin left something: sensor noise, and
//! what the simulation cannot follow. Recordings that it leaves no more of hold nothing new, and small
//! effects in them are more often the simulation's own errors under another course than physics.

use super::{
    fit,
    problem::{Point, Problem},
    rounds::Outcome,
};
use crate::{
    effects::{Domain, Effect, Physics},
    twin::{Discrepancy, ReferenceResidual, StageKind, Twin},
};

/// Share of the squared residual by which recordings may exceed what is known to be left and still hold
/// nothing new: sampling, and another course. An effect of a third of the noise is above it.
const NOTHING_NEW: f64 = 0.05;

/// Share of the held-out squared error (whitened) that an effect must explain to be worth a name: a
/// simulator of finite fidelity leaves that much of anything.
const WORTH_NAMING: f64 = 0.02;

/// The same in a machine whose twin was searched before: what is imperfect there is known to be small.
const WORTH_NAMING_LATER: f64 = 0.03;

/// The same where nothing is new and nothing is known of the effect, or it is at the edge of what a simulation
/// follows; further below it the more.
const WORTH_NAMING_AGAIN: f64 = 0.1;

/// The same of a map of places, which simulates nothing: only noise limits what is seen of it.
const WORTH_NAMING_EXACT: f64 = 0.005;

/// Multiple of the discrepancy's explained fraction that an effect must explain to be identified.
const BEYOND_DISCREPANCY: f64 = 3.0;

/// Share of the squared error that the effects named before it removed which an effect must remove: the model
/// of what is new in a known machine is right to a third of its amplitude, and what it leaves looks like
/// something as well.
pub(super) const BESIDE_NAMED: f64 = 0.1;

/// How far a signal may stay below what is known to be left (share of the squared residual) on the course that
/// it is known of.
const SAME_COURSE: f64 = 0.05;

/// Share of the squared residual that another course moves from one signal to another at most; what is less by more
/// than that has less noise.
const MOST_MOVED: f64 = 0.15;

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
    fn new_share(self) -> f64 {
        (self.most + self.least.clamp(-MOST_MOVED, 0.0)).max(self.most.min(0.0))
    }

    /// Whether the course is another than that of which it is known what is left.
    fn is_on_another_course(self) -> bool {
        self.least < -SAME_COURSE
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
        given: &'t Twin,
        stage: StageKind,
        excess: Option<Excess>,
        removed: f64,
    ) -> Self {
        let beside = match excess {
            Some(_) => BESIDE_NAMED * removed / (1.0 - removed).max(f64::MIN_POSITIVE),
            None => 0.0,
        };
        let general = least_worth(excess);
        let is_elsewhere = excess.is_some_and(Excess::is_on_another_course);
        Self {
            general,
            known: if is_elsewhere { WORTH_NAMING_LATER.max(general) } else { WORTH_NAMING_LATER },
            beside,
            discrepancy: &given.discrepancy,
            stage,
            in_any_view: removed == 0.0 && excess.is_some(),
        }
    }

    /// Below which `effect` is not worth a name, whatever is known of it and stands beside it.
    pub(super) fn least(&self, effect: &Effect) -> f64 {
        match self.is_exact(effect) {
            true => WORTH_NAMING_EXACT,
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
                && (value - null).abs() < BEYOND_DISCREPANCY * offset.abs()
        };
        known.parameter_offsets.first().is_some_and(is_within)
    }

    /// For `effect` with its numbers.
    pub(super) fn of(&self, effect: &Effect, numbers: &[f64]) -> f64 {
        let own = match self.known(effect).map(|own| BEYOND_DISCREPANCY * own.explained_fraction) {
            Some(share) if self.is_exact(effect) => share.max(WORTH_NAMING_EXACT),
            Some(share) => share.max(self.known),
            None if self.is_exact(effect) => WORTH_NAMING_EXACT,
            None => self.general,
        };
        let least = below_fidelity(effect, numbers).map_or(0.0, |below| WORTH_NAMING_AGAIN * below);
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

/// Whether an [`excess`] is none.
pub(super) fn is_nothing_new(excess: Option<Excess>) -> bool {
    excess.is_some_and(|excess| excess.new_share() < NOTHING_NEW)
}

/// Share of the held-out squared error that an effect must explain to be worth a name.
pub(super) fn least_worth(excess: Option<Excess>) -> f64 {
    if is_nothing_new(excess) { WORTH_NAMING_AGAIN } else { WORTH_NAMING }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::Machine;

    /// The same in every signal.
    fn even(share: f64) -> Option<Excess> {
        Some(Excess { most: share, least: share })
    }

    #[test]
    fn what_is_known_to_be_left_is_nothing_new_and_worth_a_name_only_where_it_is_large() {
        assert!(is_nothing_new(even(-0.3)) && is_nothing_new(even(0.04)));
        assert!(!is_nothing_new(even(0.06)));
        // A twin that no search ended with leaves nothing that is known.
        assert!(!is_nothing_new(None));
        assert!(least_worth(None) < least_worth(even(0.0)));
        assert_eq!(least_worth(even(0.5)), least_worth(None));
    }

    #[test]
    fn what_one_signal_has_less_of_another_may_have_more_of() {
        let uneven = |most, least| Some(Excess { most, least });
        assert!(is_nothing_new(uneven(0.12, -0.1)) && !is_nothing_new(uneven(0.12, -0.04)));
        // Far less is less noise, and moves nothing.
        assert!(!is_nothing_new(uneven(0.25, -0.6)));
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
        let worth = |link, excess, removed| Worth::new(&twin, link, excess, removed);
        let known = worth(StageKind::Drive, even(0.0), 0.0);
        assert!((known.of(lag, &[1e-3]) - 0.09).abs() < 1e-12 && known.in_any_view);
        assert_eq!(known.of(delay, &[1e-3]), WORTH_NAMING_AGAIN);
        assert_eq!(worth(StageKind::Camera, even(0.0), 0.0).of(lag, &[1e-3]), WORTH_NAMING_AGAIN);
        assert!(known.was_there_before(lag, 5e-5) && !known.was_there_before(lag, 7e-5));
        assert!(!known.was_there_before(lag, -5e-5) && !known.was_there_before(delay, 1e-5));
        let elsewhere = worth(StageKind::Drive, Some(Excess { most: 0.0, least: -0.1 }), 0.0);
        assert_eq!(elsewhere.of(lag, &[1e-3]), WORTH_NAMING_AGAIN);
        // What stands beside a large effect must be large too, unless nothing was known of the machine.
        let beside = worth(StageKind::Drive, even(1.0), 0.5);
        assert!((beside.of(delay, &[1e-3]) - 0.1).abs() < 1e-12 && !beside.in_any_view);
        let unknown = worth(StageKind::Drive, None, 0.5);
        assert!(unknown.of(delay, &[1e-3]) == WORTH_NAMING && !unknown.in_any_view);
        // A map of places simulates nothing: behind measured places it may be small.
        let shear = effect("gantry.squareness");
        let of_shear = |link| worth(link, even(0.0), 0.0).of(shear, &[1e-3]);
        assert_eq!(of_shear(StageKind::Camera), WORTH_NAMING_EXACT);
        assert_eq!(of_shear(StageKind::Ball), WORTH_NAMING_AGAIN);
        // A lag within a step must be larger too, and contacts that hardly bend.
        let presliding = effect("drive.friction.presliding");
        let bristles = |distance| unknown.of(presliding, &[1.0, distance, 1e-3, 0.0]);
        assert!(bristles(1e-5) == WORTH_NAMING && bristles(2e-7) == WORTH_NAMING_AGAIN);
        assert!((unknown.of(delay, &[1e-4]) - 2.0 * WORTH_NAMING_AGAIN).abs() < 1e-12);
    }
}
