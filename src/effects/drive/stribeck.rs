//! Stribeck effect: higher friction at low speed.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.stribeck`: Stribeck effect: higher friction at low speed.
///
/// F_s is the static friction less the Coulomb friction and is positive. The exponent is 2 for a
/// Gaussian curve and 1 for an exponential decay. A negative bump is a rounded sign of velocity
/// (presliding, a lag, a filter) and no Stribeck effect, so the bound excludes it.
pub(crate) static STRIBECK: Effect = Effect {
    name: "drive.friction.stribeck",
    summary: "friction is higher at low speed, which causes stick-slip",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "Δ|F_f| = F_s · exp(−|v / v_s|^δ)",
    parameters: &[
        Parameter {
            name: "force_n",
            symbol: "F_s",
            unit: "N",
            scale: 0.5,
            bounds: (0.0, 500.0),
            plausible: (0.05, 10.0),
            per_session: false,
        },
        Parameter {
            name: "velocity_m_per_s",
            symbol: "v_s",
            unit: "m/s",
            scale: 0.01,
            bounds: (0.0005, 0.5),
            plausible: (0.002, 0.05),
            per_session: false,
        },
        Parameter {
            name: "exponent",
            symbol: "δ",
            unit: "1",
            scale: 0.2,
            bounds: (0.3, 4.0),
            plausible: (0.5, 2.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.01, 1.0],
    probes: &[&[0.5, 0.01, 1.0], &[0.5, 0.003, 1.0], &[0.5, 0.03, 2.0], &[0.5, 0.08, 1.0]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| {
        p[0] * (-(motion.velocity / p[1]).abs().powf(p[2])).exp()
    }),
    regressors: &[Regressor::Speed, Regressor::Direction],
    signals: Signal::DRIVE,
    excitation: "creeping motion, and slow ramps through zero velocity",
    experiment: "creep",
    confused_with: &[
        "drive.friction.presliding",
        "drive.lag1",
        "drive.delay",
        "drive.friction.coulomb",
        "drive.friction.quadratic",
    ],
    reference: "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), 1083-1138",
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
