//! Friction that depends on the place.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.position`: the level changes by s q + c q^2, q from the origin of the
/// coordinate.
pub(crate) static POSITION: Effect = Effect {
    name: "drive.friction.position",
    says: "friction is higher in some places of the travel than in others",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[
        Parameter {
            name: "slope_n_per_m",
            unit: "N/m",
            scale: 5.0,
            bounds: (-10000.0, 10000.0),
            plausible: (-100.0, 100.0),
            per_session: false,
        },
        Parameter {
            name: "curvature_n_per_m2",
            unit: "N/m^2",
            scale: 50.0,
            bounds: (-1e6, 1e6),
            plausible: (-2000.0, 2000.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[5.0, 0.0], &[0.0, 50.0]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| (p[0] + p[1] * motion.position) * motion.position),
    regressors: &[Regressor::Position, Regressor::Direction],
    excitation: "slow sweeps over the whole travel in both directions",
    experiment: "x_line",
    confused_with: &[
        "drive.ripple.motor",
        "gantry.tilt",
        "gantry.mass_position",
        "drive.friction.asymmetric",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_follows_the_place() {
        let Physics::Friction(level) = POSITION.physics else { panic!("it is friction") };
        let at = |position| Motion { position, velocity: 1.0, ..Motion::default() };
        assert!((level(&[10.0, 100.0], &mut [], &at(0.1)) - 2.0).abs() < 1e-12);
        assert!(level(&[10.0, 100.0], &mut [], &at(-0.1)).abs() < 1e-12);
        assert_eq!(level(POSITION.null, &mut [], &at(0.1)), 0.0);
    }
}
