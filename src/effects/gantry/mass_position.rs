//! The moving mass depends on place.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// At least this share of the moving mass stays.
const LEAST_SHARE: f64 = 0.2;

/// `gantry.mass_position`: M + m1 q + m2 q^2 at the place q of the rail in the board frame, such as
/// a cable that is laid down, or a beam that is carried off its middle.
pub(crate) static MASS_POSITION: Effect = Effect {
    name: "gantry.mass_position",
    says: "the moving mass changes along the rail",
    domain: Domain::Gantry,
    site: Site::Rails,
    parameters: &[
        Parameter {
            name: "slope_kg_per_m",
            unit: "kg/m",
            scale: 0.5,
            bounds: (-50.0, 50.0),
            plausible: (-3.0, 3.0),
            per_session: false,
        },
        Parameter {
            name: "curvature_kg_per_m2",
            unit: "kg/m^2",
            scale: 5.0,
            bounds: (-500.0, 500.0),
            plausible: (-30.0, 30.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.5, 0.0], &[0.0, 5.0]],
    memory: 0,
    physics: Physics::Inertia(extra_mass),
    regressors: &[Regressor::Acceleration, Regressor::Position],
    excitation: "accelerations at many places along the rail, with the torque recorded",
    experiment: "random_walk",
    confused_with: &["drive.friction.position", "gantry.inertia"],
};

fn extra_mass(p: &[f64], motion: &Motion) -> f64 {
    let extra = (p[0] + p[1] * motion.position) * motion.position;
    if 0.0 < motion.mass { extra.max((LEAST_SHARE - 1.0) * motion.mass) } else { extra }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mass_grows_along_the_rail_and_never_vanishes() {
        let at =
            |p: &[f64]| extra_mass(p, &Motion { position: -0.1, mass: 1.0, ..Motion::default() });
        assert!((at(&[2.0, 5.0]) + 0.15).abs() < 1e-12);
        assert_eq!(at(MASS_POSITION.null), 0.0);
        assert!((at(&[50.0, 0.0]) + 0.8).abs() < 1e-12);
    }
}
