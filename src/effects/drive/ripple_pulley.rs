//! Force ripple of an eccentric pulley.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Wave};
use std::f64::consts::TAU;

/// `drive.ripple.pulley`: force ripple of an eccentric pulley.
///
/// The period is the belt travel per turn of the motor. The phase of the pulley belongs to a session.
pub(crate) static RIPPLE_PULLEY: Effect = Effect {
    name: "drive.ripple.pulley",
    summary: "a small force repeats with every turn of the pulley",
    domain: Domain::Drive,
    site: Site::EachBelt,
    equation: "F = A · sin(2π · q / p) + B · cos(2π · q / p), p = belt travel per turn",
    parameters: &[
        Parameter {
            name: "sine_n",
            symbol: "A",
            unit: "N",
            scale: 0.2,
            bounds: (-200.0, 200.0),
            plausible: (-2.0, 2.0),
            per_session: true,
        },
        Parameter {
            name: "cosine_n",
            symbol: "B",
            unit: "N",
            scale: 0.2,
            bounds: (-200.0, 200.0),
            plausible: (-2.0, 2.0),
            per_session: true,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.2, 0.0], &[0.0, 0.2]],
    memory: 0,
    physics: Physics::Wave(|p, turns_per_metre| Wave {
        sine: p[0],
        cosine: p[1],
        per_metre: TAU * turns_per_metre,
    }),
    regressors: &[Regressor::Phase, Regressor::Position],
    signals: Signal::MOTOR,
    excitation: "slow diagonals over many turns",
    experiment: "diagonal",
    confused_with: &[
        "drive.ripple.motor",
        "sensor.encoder_eccentricity",
        "drive.friction.position",
    ],
    reference: "harmonic model as for torque ripple: Holtz and Springob 1996, IEEE Transactions on Industrial Electronics 43(2), 309-320",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_repeats_with_every_turn_of_the_motor() {
        const TURN: f64 = 0.05;
        let Physics::Wave(wave) = RIPPLE_PULLEY.physics else { panic!("it is a wave") };
        let force = |p: &[f64], position| {
            wave(p, 1.0 / TURN).force(&Motion { position, ..Motion::default() })
        };
        let p = [3.0, 2.0];
        assert!((force(&p, 0.0) - 2.0).abs() < 1e-12);
        assert!((force(&p, TURN / 4.0) - 3.0).abs() < 1e-9);
        assert!((force(&p, TURN * 7.0) - 2.0).abs() < 1e-9);
        assert_eq!(force(RIPPLE_PULLEY.null, 0.1), 0.0);
    }
}
