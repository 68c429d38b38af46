//! The encoder's magnet or disc sits off the motor's axis.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};
use crate::gantry::BELT_METRES_PER_TURN;
use std::f64::consts::TAU;

/// `sensor.encoder_eccentricity`: q + s sin(2 pi q / turn) + c cos(2 pi q / turn), in metres of belt.
/// The drive's velocity loop sees it too: while the encoder reports an even motion, the motor goes unevenly,
/// the more torque the faster. The phase is that of the recorded position: homing keeps it as long as it finds the same place
/// to a tenth of a turn.
pub(crate) static ENCODER_ECCENTRICITY: Effect = Effect {
    name: "sensor.encoder_eccentricity",
    says: "the encoder's error repeats with every turn of the motor, while the striker moves evenly",
    domain: Domain::Sensor,
    site: Site::EachMotor,
    parameters: &[PART, Parameter { name: "cosine_m", ..PART }],
    null: &[0.0, 0.0],
    probes: &[&[3e-5, 3e-5]],
    memory: 0,
    physics: Physics::Encoder(|p, position| {
        let (sine, cosine) = (TAU * position / BELT_METRES_PER_TURN).sin_cos();
        position + p[0] * sine + p[1] * cosine
    }),
    regressors: &[Regressor::Phase],
    excitation: "slow moves over many turns of each motor, with camera and encoders",
    experiment: "diagonal",
    confused_with: &[
        "drive.ripple.motor",
        "drive.ripple.pulley",
        "drive.ripple.belt_tooth",
        "drive.friction.position",
    ],
};

const PART: Parameter = Parameter {
    name: "sine_m",
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
        let error = |position| encoder(&[5e-5, 2e-5], position) - position;
        assert!((error(0.0) - 2e-5).abs() < 1e-15);
        assert!((error(0.01) - 5e-5).abs() < 1e-12);
        assert!((error(0.013) - error(0.093)).abs() < 1e-12);
        assert_eq!(encoder(ENCODER_ECCENTRICITY.null, 0.0137), 0.0137);
    }
}
