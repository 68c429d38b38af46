//! More friction at creeping speed.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.stribeck`: the level grows by (Fs - Fc) exp(-|v/vs|^d), Fs > Fc; d is 2 for Gauss's
/// curve, 1 for a plain decay. A negative bump is rounding of the sign of velocity (presliding, a lag, a
/// filter) and no Stribeck effect, so the bound excludes it. Source: Armstrong-Helouvry, Dupont and Canudas
/// de Wit 1994, Automatica 30(7).
pub(crate) static STRIBECK: Effect = Effect {
    name: "drive.friction.stribeck",
    says: "friction is higher at creeping speed, so it sticks before it slides",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[
        Parameter {
            name: "force_n",
            unit: "N",
            scale: 0.5,
            bounds: (0.0, 500.0),
            plausible: (0.05, 10.0),
            per_session: false,
        },
        Parameter {
            name: "velocity_m_per_s",
            unit: "m/s",
            scale: 0.01,
            bounds: (0.0005, 0.5),
            plausible: (0.002, 0.05),
            per_session: false,
        },
        Parameter {
            name: "exponent",
            unit: "1",
            scale: 0.2,
            bounds: (0.3, 4.0),
            plausible: (0.5, 2.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.01, 1.0],
    probes: &[&[0.5, 0.01, 1.0], &[0.5, 0.003, 1.0], &[0.5, 0.03, 2.0]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| {
        p[0] * (-(motion.velocity / p[1]).abs().powf(p[2])).exp()
    }),
    regressors: &[Regressor::Speed, Regressor::Direction],
    excitation: "creeping, and slow ramps through zero velocity",
    experiment: "creep",
    confused_with: &[
        "drive.friction.presliding",
        "drive.lag1",
        "drive.delay",
        "drive.friction.coulomb",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_bump_is_at_rest_and_falls_with_speed() {
        let Physics::Friction(level) = STRIBECK.physics else { panic!("it is friction") };
        let at = |velocity| Motion { velocity, ..Motion::default() };
        for exponent in [1.0, 2.0] {
            let p = [2.0, 0.01, exponent];
            assert_eq!(level(&p, &mut [], &at(0.0)), 2.0);
            assert!((level(&p, &mut [], &at(-0.01)) - 2.0 * (-1.0_f64).exp()).abs() < 1e-12);
            assert!(level(&p, &mut [], &at(0.2)) < 1e-8);
        }
        assert_eq!(level(STRIBECK.null, &mut [], &at(0.0)), 0.0);
    }
}
