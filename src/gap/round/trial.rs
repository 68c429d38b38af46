//! Candidate that was simulated and fitted, and the bounds on which its fit may end.

use super::{slots_of_last, values_of_last};
use crate::{
    effects::free_range,
    gap::{
        fit::Fit,
        problem::{Point, Problem},
        rounds::Reason,
        screen::Candidate,
    },
    twin::{Instance, Slot, Twin},
};

/// Candidate, simulated and fitted.
pub(super) struct Trial {
    pub(super) candidate: Candidate,
    pub(super) fit: Fit,
    /// Whitened residuals of the training and the validation sessions.
    pub(super) train_rows: Vec<f64>,
    pub(super) held_rows: Vec<f64>,
    pub(super) held_point: Point,
    /// Reason to reject it.
    pub(super) objection: Option<Reason>,
}

impl Trial {
    pub(super) fn log(&self) {
        let Candidate { effect, axis, .. } = &self.candidate;
        let (values, loss) = (values_of_last(&self.fit.point.twin), self.fit.loss);
        log::debug!("{} on {axis}: {values:?} leave {loss}, {:?}", effect.name, self.objection);
    }

    /// Replace this trial by `again`, another fit of the same candidate, where its loss is smaller.
    pub(super) fn keep_better(&mut self, again: Option<Self>) {
        if let Some(again) = again.filter(|again| again.fit.loss < self.fit.loss) {
            *self = again;
        }
    }
}

/// Sort by loss, the smallest first.
pub(super) fn sort_by_loss(trials: &mut [Trial]) {
    trials.sort_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss));
}

/// Squared distance of two residuals.
pub(super) fn squared_distance(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum()
}

/// Return whether the effects of two trials may be confused.
pub(super) fn may_be_confused(one: &Trial, other: &Trial) -> bool {
    one.candidate.effect.may_be_confused_with(other.candidate.effect)
}

/// First of these values: the magnitude of the effect.
pub(super) fn size_of_last(twin: &Twin) -> Option<f64> {
    values_of_last(twin).first().copied()
}

/// Value of the parameter of `instance` that is scanned for.
pub(super) fn scanned(instance: Option<&Instance>) -> Option<f64> {
    let instance = instance?;
    let parameter = instance.effect.scanned_parameter()?;
    Some(instance.values[parameter].value)
}

/// Name of the magnitude of the added effect where it is negative and the effect has one sign only. Commands do not
/// take effect before they are sent, though a fit may shift a clock that way.
pub(super) fn wrong_sign(fit: &Fit) -> Option<String> {
    let effect = fit.point.twin.instances.last()?.effect;
    let parameter = effect.parameters.first()?;
    let one_sign = effect.null[0] == 0.0 && 0.0 <= parameter.plausible.0;
    (one_sign && size_of_last(&fit.point.twin)? < 0.0).then(|| parameter.name.to_owned())
}

/// Return whether the added effect is a wave along the position with a longer period than any that is scanned for.
pub(super) fn is_bend(train: &Problem<'_>, fit: &Fit) -> bool {
    let twin = &fit.point.twin;
    let period = scanned(twin.instances.last());
    period.is_some_and(|period| train.longest_period(twin.machine) < period)
}

/// Name of the end of the travel that the added effect pushes at every position of the recordings. From there, an end stop
/// is a force that hardly changes, like that of a tilt.
fn never_left(train: &Problem<'_>, twin: &Twin) -> Option<String> {
    let last = twin.instances.last()?;
    let free = free_range(last.effect, &last.numbers())?;
    let stages = train.parts.iter().map(|part| part.stage);
    let all: Vec<f64> = stages
        .flat_map(|stage| stage.positions_along(last.axis, twin))
        .filter(|own| own.is_finite())
        .collect();
    let is_below = all.iter().all(|position| *position <= free.start);
    let is_left = all.is_empty() || all.iter().any(|position| free.contains(position));
    let end = if is_below { 1 } else { 2 };
    (!is_left).then(|| last.effect.parameters[end].name.to_owned())
}

/// Name of the first parameter of the added effect that stopped on a bound, beyond the periods that are scanned for, or
/// beyond the travel. A later parameter may have no influence, or a bound that is itself plausible (contacts that do not
/// creep).
pub(super) fn on_bound(train: &Problem<'_>, fit: &Fit) -> Option<String> {
    let twin = &fit.point.twin;
    let bend = || {
        let effect = twin.instances.last().filter(|_| is_bend(train, fit))?.effect;
        Some(effect.parameters[effect.scanned_parameter()?].name.to_owned())
    };
    let on_bound = on_bound_of(twin, slots_of_last(twin)).map(|(_, name)| name);
    on_bound.or_else(bend).or_else(|| never_left(train, twin))
}

/// The same for an effect with these slots.
pub(in crate::gap) fn on_bound_of(
    twin: &Twin,
    slots: impl IntoIterator<Item = Slot>,
) -> Option<(Slot, String)> {
    slots.into_iter().find_map(|slot| {
        let effect = twin.instances[slot.instance].effect;
        let parameter = &effect.parameters[slot.parameter];
        let (value, (low, high)) = (twin.get(slot), parameter.bounds);
        let near = 1e-6 * (high - low);
        let does_nothing =
            0 < slot.parameter && (value - effect.null[slot.parameter]).abs() <= near;
        let (least, most) = parameter.plausible;
        let is_limit = 0 < slot.parameter
            && (value <= low + near && least <= low || high - near <= value && high <= most);
        let is_on = value <= low + near || high - near <= value;
        (is_on && !does_nothing && !is_limit).then(|| (slot, parameter.name.to_owned()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::{screen, test_stage::TestStage},
        twin::Machine,
    };

    /// Fit that ended with the effect called `name` at `values`.
    fn ended(name: &str, axis: Axis, values: &[f64]) -> Fit {
        let effect = find(name).unwrap();
        let twin = screen::with(&Twin::nominal(Machine::Table), effect, axis, values);
        Fit { point: Point { twin, nuisance: vec![] }, slots: vec![], loss: 0.0, rows: 0 }
    }

    #[test]
    fn a_magnitude_on_its_bound_is_rejected_and_a_later_parameter_at_null_is_not() {
        let bound = |values: &[f64]| {
            let twin = ended("ball.rolling_resistance", Axis::Whole, values).point.twin;
            on_bound_of(&twin, slots_of_last(&twin)).map(|(_, name)| name)
        };
        assert_eq!(bound(&[0.0, 0.1]), Some("coefficient".to_owned()));
        assert_eq!(bound(&[0.3, 0.1]), Some("coefficient".to_owned()));
        assert_eq!(bound(&[0.01, 5.0]), Some("viscous_per_s".to_owned()));
        assert_eq!(bound(&[0.01, 0.0]), None);
    }

    #[test]
    fn a_wave_longer_than_half_the_travel_of_a_table_is_a_bend() {
        let stage = TestStage::drive(vec![0.0; 500], |_, _| 0.0).along(0.2);
        let standing = TestStage::drive(vec![0.0; 500], |_, _| 0.0);
        let bound = |stage: &dyn crate::twin::Stage, period: f64| {
            let train = Problem::new(&[stage], &Twin::nominal(Machine::Table));
            on_bound(&train, &ended("drive.ripple.motor", Axis::A, &[0.5, 0.1, period]))
        };
        assert_eq!(bound(&stage, 0.09), None);
        assert_eq!(bound(&stage, 0.11), Some("period_m".to_owned()));
        assert_eq!(bound(&standing, 0.11), None, "its travel is not known");
    }

    #[test]
    fn an_end_stop_that_is_never_left_is_on_its_bound() {
        let stage = TestStage::drive(vec![0.0; 500], |_, _| 0.0).along(0.2);
        let train = Problem::new(&[&stage as _], &Twin::nominal(Machine::Table));
        let bound = |ends: [f64; 2]| {
            on_bound(&train, &ended("gantry.endstop", Axis::Y, &[1e3, ends[0], ends[1]]))
        };
        assert_eq!(bound([-2.0, 0.15]), None);
        assert_eq!(bound([0.6, 2.0]), Some("low_m".to_owned()));
        assert_eq!(bound([-2.0, -0.1]), Some("high_m".to_owned()));
        // Where nobody knows the positions, the end may be anywhere.
        let nothing = Problem::new(&[], &Twin::nominal(Machine::Table));
        let outside = ended("gantry.endstop", Axis::Y, &[1e3, 0.6, 2.0]);
        assert_eq!(on_bound(&nothing, &outside), None);
    }

    #[test]
    fn commands_do_not_act_before_they_are_sent() {
        let wrong = |values: &[f64]| wrong_sign(&ended("drive.delay", Axis::Motors, values));
        assert_eq!(wrong(&[-5e-5]), Some("delay_s".to_owned()));
        assert_eq!(wrong(&[5e-5]), None);
        // Tilt has both signs; a gain below one has one sign.
        assert_eq!(wrong_sign(&ended("ball.tilt", Axis::Whole, &[-0.001, 0.0])), None);
        assert_eq!(wrong_sign(&ended("drive.gain", Axis::Motors, &[0.9])), None);
    }
}
