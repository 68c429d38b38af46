//! Small commands do nothing.

use crate::effects::{COMMAND_UNIT, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.input_deadband`: r = 0 where |u| < u0, in the unit of the command; beyond it u - s u0
/// sign u. With s = 0 small commands are ignored and all others pass whole, with s = 1 they lose
/// the band (the dead zone of the textbooks).
pub(crate) static INPUT_DEADBAND: Effect = Effect {
    name: "drive.input_deadband",
    says: "the drive ignores small commands, in both directions and everywhere",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[
        Parameter {
            name: "threshold",
            unit: COMMAND_UNIT,
            scale: 0.01,
            bounds: (0.0, 100.0),
            plausible: (0.0, 0.1),
            per_session: false,
        },
        Parameter {
            name: "lost_share",
            unit: "1",
            scale: 0.5,
            bounds: (-0.5, 1.5),
            plausible: (-0.1, 1.1),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    // Between two commands that were given the threshold has no slope, so its sizes stand close.
    probes: &[
        &[0.002, 0.0],
        &[0.003, 0.0],
        &[0.004, 0.0],
        &[0.006, 0.0],
        &[0.009, 0.0],
        &[0.013, 0.0],
        &[0.02, 0.0],
        &[0.03, 0.0],
        &[0.06, 0.0],
        &[0.005, 1.0],
        &[0.02, 1.0],
    ],
    memory: 0,
    physics: Physics::Command(|p, _, command, _| {
        if command.abs() < p[0] { 0.0 } else { command - p[1] * p[0].copysign(command) }
    }),
    regressors: &[Regressor::Command, Regressor::Direction],
    excitation: "a triangle of small commands in both directions",
    experiment: "creep",
    confused_with: &[
        "drive.friction.coulomb",
        "estimator.velocity_deadzone",
        "drive.backlash",
        "drive.friction.presliding",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_commands_vanish_and_large_ones_pass() {
        let Physics::Command(band) = INPUT_DEADBAND.physics else {
            panic!("it acts on the command")
        };
        assert_eq!(band(&[0.1, 0.0], &mut [], -0.05, 1e-3), 0.0);
        assert_eq!(band(&[0.1, 0.0], &mut [], -0.3, 1e-3), -0.3);
        assert!((band(&[0.1, 1.0], &mut [], -0.3, 1e-3) + 0.2).abs() < 1e-12);
        assert_eq!(band(INPUT_DEADBAND.null, &mut [], 0.0, 1e-3), 0.0);
        assert_eq!(band(INPUT_DEADBAND.null, &mut [], 1e-9, 1e-3), 1e-9);
    }
}
