//! Motion of one rail pushes the other.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// Largest share of the moving mass that the coupling may take, so that two rails, each with the
/// acceleration of the step before, stay stable.
const LARGEST_SHARE: f64 = 0.9;

/// `gantry.cross_coupling`: -m a - d v of the other rail, the off-diagonal mass and damping.
///
/// Rotors of different inertia give the off-diagonal mass (J_a - J_b) / r^2, belts of different
/// friction the off-diagonal damping; rails out of square give both. An off-diagonal stiffness would
/// need a spring to the frame and is a force that depends on place.
pub(crate) static CROSS_COUPLING: Effect = Effect {
    name: "gantry.cross_coupling",
    says: "motion along one rail pushes the carriage along the other",
    domain: Domain::Gantry,
    site: Site::Rails,
    parameters: &[
        Parameter {
            name: "mass_kg",
            unit: "kg",
            scale: 0.05,
            bounds: (-5.0, 5.0),
            plausible: (-0.3, 0.3),
            per_session: false,
        },
        Parameter {
            name: "damping_n_s_per_m",
            unit: "N s/m",
            scale: 1.0,
            bounds: (-500.0, 500.0),
            plausible: (-8.0, 8.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.05, 1.0]],
    memory: 0,
    physics: Physics::Force(push),
    regressors: &[Regressor::OtherAxis],
    excitation: "both rails at once with unlike motions: circles, diagonals, random walks",
    experiment: "circle",
    confused_with: &[
        "gantry.racking",
        "gantry.belt_asymmetry",
        "gantry.squareness",
        "drive.supply_sag",
        "drive.friction.viscous",
    ],
};

fn push(p: &[f64], _: &mut [f64], motion: &Motion) -> f64 {
    -stable(p[0], motion) * motion.other.acceleration - p[1] * motion.other.velocity
}

/// An off-diagonal `mass` (kg), held within what keeps two rails stable.
pub(super) fn stable(mass: f64, motion: &Motion) -> f64 {
    let most = LARGEST_SHARE * motion.mass;
    if 0.0 < most { mass.clamp(-most, most) } else { mass }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CrossMotion;

    #[test]
    fn the_other_rail_pushes() {
        let other = CrossMotion { velocity: 0.5, acceleration: 10.0, ..CrossMotion::default() };
        let motion = Motion { mass: 0.8, other, ..Motion::default() };
        assert!((push(&[0.05, 2.0], &mut [], &motion) + 1.5).abs() < 1e-12);
        assert_eq!(push(CROSS_COUPLING.null, &mut [], &motion), 0.0);
        // Never more than nine tenths of the mass.
        assert!((push(&[3.0, 0.0], &mut [], &motion) + 7.2).abs() < 1e-12);
    }
}
