//! The built-in start: deliberately plain, so that everything beyond it is found and not assumed.

use super::{Instance, Machine, Session, Source, Twin, machine_of};
use crate::{
    effects::{self, Axis},
    gantry::BELT_METRES_PER_TURN,
};

/// Masses from the table's drawings: carriage 0.25 kg, bridge 0.45 kg (moves along y), two rotors of
/// 4.0e-5 kg m^2 on 0.04 m of belt per turn, each 0.987 kg of belt.
const MASS_KG: [f64; 2] = [2.22, 2.67];

/// Mass of the striker above the board (kg).
const STRIKER_MASS_KG: f64 = 0.012;

/// Effects of the plain table: name, axis, numbers.
const TABLE: &[(&str, Axis, &[f64])] = &[
    ("drive.velocity_loop", Axis::Motors, &[20.0, 2.0, 0.0, 0.0]),
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

/// Effects of a plain axis driven by force.
const AXIS_FORCE: &[(&str, Axis, &[f64])] = &[
    ("gantry.inertia", Axis::Guides, &[1.0]),
    ("drive.friction.coulomb", Axis::Guides, &[0.0]),
    ("drive.friction.viscous", Axis::Guides, &[0.0]),
    ("drive.offset", Axis::Guides, &[0.0]),
];

impl Twin {
    /// The plain twin of the machine on which `sessions` were recorded, with its belt.
    #[must_use]
    pub fn nominal_of(sessions: &[Session]) -> Self {
        let mut twin = Self::nominal(machine_of(sessions));
        if let Some(session) =
            sessions.iter().find(|own| own.drive.is_some() || own.camera.is_some())
        {
            twin.belt_metres_per_turn = session.belt_metres_per_turn;
        }
        twin
    }

    /// The plain twin of `machine`, before anything was measured.
    #[must_use]
    pub fn nominal(machine: Machine) -> Self {
        let effects = match machine {
            Machine::Table => TABLE,
            Machine::Axis => AXIS_FORCE,
        };
        let instances = effects
            .iter()
            .filter_map(|(name, axis, values)| {
                let effect = effects::find(name)?;
                Some(Instance::new(
                    effect,
                    *axis,
                    &values[..effect.parameters.len()],
                    Source::Nominal,
                ))
            })
            .collect();
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
}
