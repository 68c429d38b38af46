//! Eccentricity of the encoder magnet or disc.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};
use std::f64::consts::TAU;

/// `sensor.encoder_eccentricity`: eccentricity of the encoder magnet or disc.
///
/// The period is one turn of the motor in metres of belt. The velocity loop sees the error too.
/// While the encoder reports a constant velocity, the true velocity of the motor varies, and so
/// does the torque, the more the faster it turns. The phase is that of the recorded position.
/// Homing keeps it while it finds the same position to a tenth of a turn.
pub(crate) static ENCODER_ECCENTRICITY: Effect = Effect {
    name: "sensor.encoder_eccentricity",
    summary: "the encoder error repeats with every turn of the motor, while the striker moves evenly",
    domain: Domain::Sensor,
    site: Site::EachMotor,
    equation: "q′ = q + s · sin(2π · q / p) + c · cos(2π · q / p), p = belt travel per turn",
    parameters: &[PART, Parameter { name: "cosine_m", symbol: "c", ..PART }],
    null: &[0.0, 0.0],
    probes: &[&[3e-5, 3e-5]],
    memory: 0,
    physics: Physics::Encoder(|p, position, turns_per_metre| {
        let (sine, cosine) = (TAU * turns_per_metre * position).sin_cos();
        position + p[0] * sine + p[1] * cosine
    }),
    regressors: &[Regressor::Phase],
    signals: Signal::MOTION,
    excitation: "slow moves over many turns of each motor, with camera and encoders",
    experiment: "diagonal",
    confused_with: &[
        "drive.ripple.motor",
        "drive.ripple.pulley",
        "drive.ripple.belt_tooth",
        "drive.friction.position",
    ],
    reference: "geometry of an eccentric disc, to first order",
};

const PART: Parameter = Parameter {
    name: "sine_m",
    symbol: "s",
    unit: "m",
    scale: 3e-5,
    bounds: (-3e-3, 3e-3),
    plausible: (-2e-4, 2e-4),
    per_session: false,
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_returns_every_turn() {
        let Physics::Encoder(encoder) = ENCODER_ECCENTRICITY.physics else { panic!("an encoder") };
        let turns_per_metre = 20.0;
        let error = |position| encoder(&[5e-5, 2e-5], position, turns_per_metre) - position;
        assert!((error(0.0) - 2e-5).abs() < 1e-15);
        assert!((error(0.0125) - 5e-5).abs() < 1e-12);
        assert!((error(0.013) - error(0.113)).abs() < 1e-12);
        assert_eq!(encoder(ENCODER_ECCENTRICITY.null, 0.0137, turns_per_metre), 0.0137);
    }
}
