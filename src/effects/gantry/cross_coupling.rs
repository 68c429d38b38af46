//! Inertial and viscous coupling of the two axes.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site};

/// Largest off-diagonal mass as a fraction of the moving mass. Each axis takes the acceleration of the
/// previous step, and larger fractions would be unstable.
const LARGEST_FRACTION: f64 = 0.9;

/// `gantry.cross_coupling`: inertial and viscous coupling of the two axes.
///
/// The force on one axis depends on acceleration and velocity of the other: off-diagonal mass and
/// damping. Rotors of different inertia give the off-diagonal mass (J_a - J_b) / r^2. Belts of
/// different friction give the off-diagonal damping. Guides out of square give both. An
/// off-diagonal stiffness would need a spring to the frame, and is a position-dependent force.
pub(crate) static CROSS_COUPLING: Effect = Effect {
    name: "gantry.cross_coupling",
    summary: "motion along one axis pushes the carriage along the other axis",
    domain: Domain::Gantry,
    site: Site::Guides,
    equation: "F_x = −m · a_y − d · v_y, F_y = −m · a_x − d · v_x",
    parameters: &[
        Parameter {
            name: "mass_kg",
            symbol: "m",
            unit: "kg",
            scale: 0.05,
            bounds: (-5.0, 5.0),
            plausible: (-0.3, 0.3),
            per_session: false,
        },
        Parameter {
            name: "damping_n_s_per_m",
            symbol: "d",
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
    signals: Signal::MOTOR,
    excitation: "different motions of both axes at once: circles, diagonals, random walks",
    experiment: "circle",
    confused_with: &[
        "gantry.racking",
        "gantry.belt_asymmetry",
        "gantry.squareness",
        "drive.supply_sag",
        "drive.friction.viscous",
    ],
    reference: "Lagrange's equations; Sollmann, Jouaneh and Lavender 2010, IEEE/ASME Transactions on Mechatronics 15(2), 280-290",
};

fn push(p: &[f64], _: &mut [f64], motion: &Motion) -> f64 {
    -stable(p[0], motion) * motion.other.acceleration - p[1] * motion.other.velocity
}

/// An off-diagonal `mass` (kg), clamped to the stable range.
pub(super) fn stable(mass: f64, motion: &Motion) -> f64 {
    let most = LARGEST_FRACTION * motion.mass;
    if 0.0 < most { mass.clamp(-most, most) } else { mass }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CrossMotion;

    #[test]
    fn the_other_axis_pushes() {
        let other = CrossMotion { velocity: 0.5, acceleration: 10.0, ..CrossMotion::default() };
        let motion = Motion { mass: 0.8, other, ..Motion::default() };
        assert!((push(&[0.05, 2.0], &mut [], &motion) + 1.5).abs() < 1e-12);
        assert_eq!(push(CROSS_COUPLING.null, &mut [], &motion), 0.0);
        // At most nine tenths of the mass.
        assert!((push(&[3.0, 0.0], &mut [], &motion) + 7.2).abs() < 1e-12);
    }
}
