//! Dead zone of the drive input.

use crate::effects::{COMMAND_UNIT, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.input_deadband`: dead zone of the drive input.
///
/// The unit is that of the command. With s = 0 the drive ignores small commands and passes all
/// others unchanged. With s = 1 larger commands lose the band, as in the dead zone of textbooks.
pub(crate) static INPUT_DEADBAND: Effect = Effect {
    name: "drive.input_deadband",
    summary: "the drive ignores small commands in both directions",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "u′ = 0 for |u| < u0, otherwise u − s · u0 · sign(u)",
    parameters: &[
        Parameter {
            name: "threshold",
            symbol: "u0",
            unit: COMMAND_UNIT,
            scale: 0.01,
            // Half the RMS of a command: a band that most samples are in explains them whatever the motion is.
            bounds: (0.0, 0.15),
            plausible: (0.0, 0.1),
            per_session: false,
        },
        Parameter {
            name: "lost_fraction",
            symbol: "s",
            unit: "1",
            scale: 0.5,
            bounds: (0.0, 1.0),
            plausible: (0.0, 1.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    // The cost is flat between two recorded command levels, so the start values are dense.
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
    signals: Signal::DRIVE,
    excitation: "a triangle of small commands in both directions",
    experiment: "creep",
    confused_with: &[
        "drive.friction.coulomb",
        "estimator.velocity_deadzone",
        "drive.backlash",
        "drive.friction.presliding",
    ],
    reference: "Tao and Kokotović 1996, Adaptive Control of Systems with Actuator and Sensor Nonlinearities",
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
