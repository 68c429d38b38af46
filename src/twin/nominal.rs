//! Built-in start: deliberately plain, so that everything beyond it is identified and not assumed.

use super::{AxisStage, Instance, Machine, Session, Source, Twin, machine_of};
use crate::{
    effects::{self, Axis, InputKind},
    gantry::BELT_METRES_PER_TURN,
};

/// Masses from the table's drawings: a carriage of 0.25 kg, a bridge of 0.45 kg (moves along y),
/// and two rotors. A rotor has 4.0e-5 kg m^2 on 0.04 m of belt per turn, which is 0.987 kg of belt.
const MASS_KG: [f64; 2] = [2.22, 2.67];

/// Mass of the striker above the board (kg).
const STRIKER_MASS_KG: f64 = 0.012;

/// Effects of the plain table: name, axis, values.
const TABLE: &[(&str, Axis, &[f64])] = &[
    ("drive.velocity_loop", Axis::Motors, &[20.0, 2.0, 0.0, 0.0, 0.0]),
    ("drive.saturation.slew", Axis::Motors, &[15.0]),
    ("drive.friction.coulomb", Axis::X, &[1.0]),
    ("drive.friction.coulomb", Axis::Y, &[1.0]),
    ("drive.friction.viscous", Axis::X, &[1.0]),
    ("drive.friction.viscous", Axis::Y, &[1.0]),
    ("gantry.inertia", Axis::X, &[MASS_KG[0]]),
    ("gantry.inertia", Axis::Y, &[MASS_KG[1]]),
    ("ball.rolling_resistance", Axis::Whole, &[0.01, 0.0]),
    ("impact.wall_restitution", Axis::Whole, &[0.8]),
];

/// Effects of a plain axis driven by a velocity setpoint.
const AXIS_VELOCITY: &[(&str, Axis, &[f64])] = &[
    ("drive.velocity_controller", Axis::Single, &[0.01, 20.0]),
    ("drive.friction.coulomb", Axis::Single, &[0.0]),
    ("drive.friction.viscous", Axis::Single, &[0.0]),
    ("drive.offset", Axis::Single, &[0.0]),
];

/// Effects of a plain axis driven by force.
const AXIS_FORCE: &[(&str, Axis, &[f64])] = &[
    ("gantry.inertia", Axis::Single, &[1.0]),
    ("drive.friction.coulomb", Axis::Single, &[0.0]),
    ("drive.friction.viscous", Axis::Single, &[0.0]),
    ("drive.offset", Axis::Single, &[0.0]),
];

fn instances(effects: &[(&str, Axis, &[f64])]) -> Vec<Instance> {
    let nominal = |(name, axis, values): &(&str, Axis, &[f64])| {
        let effect = effects::find(name)?;
        let values = &values[..effect.parameters.len()];
        Some(Instance::new(effect, *axis, values, Source::Nominal))
    };
    effects.iter().filter_map(nominal).collect()
}

impl Twin {
    /// The plain twin of the machine on which `sessions` were recorded, with its belt.
    #[must_use]
    pub fn nominal_of(sessions: &[Session]) -> Self {
        let axis = sessions.iter().find_map(|session| session.axes.first());
        let kind = axis.map_or(InputKind::Force, AxisStage::input_kind);
        let mut twin = Self::nominal_with(machine_of(sessions), kind);
        if let Some(session) =
            sessions.iter().find(|own| own.drive.is_some() || own.camera.is_some())
        {
            twin.belt_metres_per_turn = session.belt_metres_per_turn;
        }
        twin
    }

    /// The plain twin of the machine that this one describes.
    #[must_use]
    pub fn plain(&self) -> Self {
        let kind = self.axis_frame.map_or(InputKind::Force, |own| own.scales.input_kind());
        Self::nominal_with(self.machine, kind)
    }

    /// The plain twin of `machine` before anything was measured; a single axis is driven by force.
    #[must_use]
    pub fn nominal(machine: Machine) -> Self {
        Self::nominal_with(machine, InputKind::Force)
    }

    /// The plain twin of `machine`; `kind` is the input of a single axis.
    fn nominal_with(machine: Machine, kind: InputKind) -> Self {
        let instances = instances(match (machine, kind) {
            (Machine::Table, _) => TABLE,
            (Machine::Axis, InputKind::Force) => AXIS_FORCE,
            (Machine::Axis, InputKind::Velocity) => AXIS_VELOCITY,
        });
        Self {
            machine,
            striker_mass: STRIKER_MASS_KG,
            belt_metres_per_turn: BELT_METRES_PER_TURN,
            controller_reference_mass: None,
            axis_frame: None,
            instances,
            reference_residuals: Vec::new(),
            discrepancy: Vec::new(),
            measurement_noise: Vec::new(),
            fitted_to: Vec::new(),
        }
    }

    /// The plain table with further `effects`: name, axis, values.
    #[cfg(test)]
    pub(crate) fn table_with(effects: &[(&str, Axis, &[f64])]) -> Self {
        let mut twin = Self::nominal(Machine::Table);
        let further = instances(effects);
        assert_eq!(further.len(), effects.len(), "an effect is not in the catalogue");
        twin.instances.extend(further);
        twin
    }
}
