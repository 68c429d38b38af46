//! Range check of user-defined effects: the recordings must lie within the domain of their expressions.

use crate::{
    effects::{Effect, Motion, Physics, Place, Regressor},
    twin::{Machine, Stage, StageKind},
};

/// Reason why `effect` cannot be searched on a `machine` with these `stages`; `None` for an effect of the catalogue,
/// and for an expression that has a value throughout.
pub(super) fn objection<'a>(
    effect: &Effect,
    machine: Machine,
    stages: impl IntoIterator<Item = &'a dyn Stage>,
) -> Option<String> {
    let Physics::Expression(place, expression) = effect.physics else { return None };
    let name = effect.name;
    if (place, machine) == (Place::Output, Machine::Axis) {
        return Some(format!(
            "{name} was not searched: its place is the output, which a single axis does not have; use the place force, \
             friction or input"
        ));
    }
    let mut motions = stages.into_iter().filter(|stage| stage.calls(effect)).flat_map(motions);
    let undefined = expression.undefined_at(&mut motions)?;
    Some(format!("{name} was not searched: {undefined}, which is within the recorded motion"))
}

/// Measured motion at every sample that the stage knows it for.
fn motions(stage: &dyn Stage) -> Vec<Motion> {
    let known = |regressor| stage.regressor(regressor).unwrap_or_default();
    let of = |values: &[f64], index: usize| values.get(index).copied().unwrap_or(0.0);
    let (mut positions, mut velocities) = (known(Regressor::Position), known(Regressor::Velocity));
    if stage.kind() == StageKind::Drive {
        let measured = |unit: &str| {
            let mut channels = stage.channels().iter().filter(|own| own.unit == unit);
            channels.next().map(|own| own.measured.clone()).unwrap_or_default()
        };
        (positions, velocities) = (measured("m"), measured("m/s"));
    }
    let (accelerations, inputs, times) =
        (known(Regressor::Acceleration), known(Regressor::Command), known(Regressor::Time));
    let count = positions.len().max(velocities.len());
    let motion = |index: usize| Motion {
        position: of(&positions, index),
        velocity: of(&velocities, index),
        acceleration: of(&accelerations, index),
        force: of(&inputs, index),
        time: of(&times, index),
        ..Motion::default()
    };
    let is_measured = |own: &Motion| own.position.is_finite() && own.velocity.is_finite();
    (0..count).map(motion).filter(is_measured).collect()
}
