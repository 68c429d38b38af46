//! A force that repeats with the teeth of the belt.

use super::ripple_motor::wave;
use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.ripple.belt_tooth`: A sin(2 pi q/p) + B cos(2 pi q/p), with the pitch p of a GT2 belt.
/// The place of the teeth belongs to a session.
pub(crate) static RIPPLE_BELT_TOOTH: Effect = Effect {
    name: "drive.ripple.belt_tooth",
    says: "a small force repeats with every tooth of the belt",
    domain: Domain::Drive,
    site: Site::EachMotor,
    parameters: &[
        Parameter {
            name: "sine_n",
            unit: "N",
            scale: 0.2,
            bounds: (-200.0, 200.0),
            plausible: (-2.0, 2.0),
            per_session: true,
        },
        Parameter {
            name: "cosine_n",
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
    physics: Physics::Force(|p, _, motion| wave(p, motion.position, PITCH)),
    regressors: &[Regressor::Phase, Regressor::Position],
    excitation: "slow moves at several places",
    experiment: "creep",
    confused_with: &["drive.ripple.motor", "drive.friction.position"],
};

/// Pitch of the belt (m): GT2.
const PITCH: f64 = 0.002;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_repeats_with_the_period() {
        let Physics::Force(force) = RIPPLE_BELT_TOOTH.physics else { panic!("it is a force") };
        let at = |position| Motion { position, ..Motion::default() };
        let p = [3.0, 2.0];
        assert!((force(&p, &mut [], &at(0.0)) - 2.0).abs() < 1e-12);
        assert!((force(&p, &mut [], &at(PITCH / 4.0)) - 3.0).abs() < 1e-9);
        assert!((force(&p, &mut [], &at(PITCH * 7.0)) - 2.0).abs() < 1e-9);
        assert_eq!(force(RIPPLE_BELT_TOOTH.null, &mut [], &at(0.1)), 0.0);
    }
}
