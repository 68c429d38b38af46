//! Force ripple of the belt teeth.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Wave};
use std::f64::consts::TAU;

/// `drive.ripple.belt_tooth`: force ripple of the belt teeth.
///
/// The period is the pitch of a GT2 belt. The phase of the teeth belongs to a session.
pub(crate) static RIPPLE_BELT_TOOTH: Effect = Effect {
    name: "drive.ripple.belt_tooth",
    summary: "a small force repeats with every tooth of the belt",
    domain: Domain::Drive,
    site: Site::EachBelt,
    equation: "F = A · sin(2π · q / p) + B · cos(2π · q / p), p = 2 mm",
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
    physics: Physics::Wave(|p, _| Wave { sine: p[0], cosine: p[1], per_metre: TAU / PITCH }),
    regressors: &[Regressor::Phase, Regressor::Position],
    signals: Signal::MOTOR,
    excitation: "slow moves at several positions",
    experiment: "creep",
    confused_with: &["drive.ripple.motor", "drive.friction.position"],
    reference: "harmonic model as for torque ripple: Holtz and Springob 1996, IEEE Transactions on Industrial Electronics 43(2), 309-320",
};

/// Pitch of a GT2 belt (m).
const PITCH: f64 = 0.002;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_repeats_with_the_period() {
        let Physics::Wave(wave) = RIPPLE_BELT_TOOTH.physics else { panic!("it is a wave") };
        let force =
            |p: &[f64], position| wave(p, 0.0).force(&Motion { position, ..Motion::default() });
        let p = [3.0, 2.0];
        assert!((force(&p, 0.0) - 2.0).abs() < 1e-12);
        assert!((force(&p, PITCH / 4.0) - 3.0).abs() < 1e-9);
        assert!((force(&p, PITCH * 7.0) - 2.0).abs() < 1e-9);
        assert_eq!(force(RIPPLE_BELT_TOOTH.null, 0.1), 0.0);
    }
}
