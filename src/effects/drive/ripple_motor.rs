//! Torque ripple and cogging of the motor.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Wave};
use std::f64::consts::TAU;

/// `drive.ripple.motor`: torque ripple and cogging of the motor.
///
/// The period p is the travel per turn or per pole pair. It is not known beforehand:
/// [`periods`](super::scan::periods) proposes it. The phase of the rotor belongs to a session.
pub(crate) static RIPPLE_MOTOR: Effect = Effect {
    name: "drive.ripple.motor",
    summary: "a small force repeats with the rotation of the motor",
    domain: Domain::Drive,
    site: Site::EachMotor,
    equation: "F = A · sin(2π · q / p) + B · cos(2π · q / p)",
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
        Parameter {
            name: "period_m",
            symbol: "p",
            unit: "m",
            scale: 2.5e-5,
            bounds: (1e-4, 5.0),
            plausible: (0.0005, 0.05),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.01],
    probes: &[&[0.2, 0.0, 0.04], &[0.2, 0.0, 0.01]],
    memory: 0,
    physics: Physics::Wave(|p, _| Wave { sine: p[0], cosine: p[1], per_metre: TAU / p[2] }),
    regressors: &[Regressor::Phase, Regressor::Position],
    signals: Signal::DRIVE,
    excitation: "slow constant speed over many turns",
    experiment: "creep",
    confused_with: &["drive.ripple.belt_tooth", "drive.ripple.pulley", "drive.friction.position"],
    reference: "Holtz and Springob 1996, IEEE Transactions on Industrial Electronics 43(2), 309-320",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_repeats_with_its_period() {
        let Physics::Wave(wave) = RIPPLE_MOTOR.physics else { panic!("it is a wave") };
        let force =
            |p: &[f64], position| wave(p, 0.0).force(&Motion { position, ..Motion::default() });
        assert!((force(&[3.0, 2.0, 0.008], 0.0) - 2.0).abs() < 1e-12);
        assert!((force(&[3.0, 2.0, 0.008], 0.002) - 3.0).abs() < 1e-12);
        assert!((force(&[3.0, 2.0, 0.008], 0.018) - 3.0).abs() < 1e-9);
        assert_eq!(force(RIPPLE_MOTOR.null, 0.1), 0.0);
    }
}
