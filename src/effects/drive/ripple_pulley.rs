//! A force that repeats with every turn of the pulley.

use super::ripple_motor::wave;
use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.ripple.pulley`: A sin(2 pi q/p) + B cos(2 pi q/p), with p the belt per turn. The place of
/// the pulley belongs to a session.
pub(crate) static RIPPLE_PULLEY: Effect = Effect {
    name: "drive.ripple.pulley",
    says: "a small force repeats with every turn of the pulley",
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
    physics: Physics::Force(|p, _, motion| wave(p, motion.position, TURN)),
    regressors: &[Regressor::Phase, Regressor::Position],
    excitation: "slow diagonals over many turns",
    experiment: "diagonal",
    confused_with: &[
        "drive.ripple.motor",
        "sensor.encoder_eccentricity",
        "drive.friction.position",
    ],
};

/// Belt per turn (m): 20 teeth of 2 mm.
const TURN: f64 = 0.04;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_repeats_with_the_period() {
        let Physics::Force(force) = RIPPLE_PULLEY.physics else { panic!("it is a force") };
        let at = |position| Motion { position, ..Motion::default() };
        let p = [3.0, 2.0];
        assert!((force(&p, &mut [], &at(0.0)) - 2.0).abs() < 1e-12);
        assert!((force(&p, &mut [], &at(TURN / 4.0)) - 3.0).abs() < 1e-9);
        assert!((force(&p, &mut [], &at(TURN * 7.0)) - 2.0).abs() < 1e-9);
        assert_eq!(force(RIPPLE_PULLEY.null, &mut [], &at(0.1)), 0.0);
    }
}
