//! More friction at creeping speed.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.stribeck`: the level grows by (Fs - Fc) exp(-(v/vs)^2), Fs > Fc. A negative bump
/// is rounding of the sign of velocity (presliding, a lag, a filter) and no Stribeck effect, so the
/// bound excludes it. Source: Armstrong-Helouvry, Dupont and Canudas de Wit 1994, Automatica 30(7).
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
    ],
    null: &[0.0, 0.01],
    probes: &[&[0.5, 0.01], &[0.5, 0.003], &[0.5, 0.04]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| p[0] * (-(motion.velocity / p[1]).powi(2)).exp()),
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
        assert_eq!(level(&[2.0, 0.01], &mut [], &at(0.0)), 2.0);
        assert!((level(&[2.0, 0.01], &mut [], &at(-0.01)) - 2.0 * (-1.0_f64).exp()).abs() < 1e-12);
        assert!(level(&[2.0, 0.01], &mut [], &at(0.1)) < 1e-9);
        assert_eq!(level(STRIBECK.null, &mut [], &at(0.0)), 0.0);
    }
}
