//! The beam yaws when the carriage accelerates off its middle.

use super::cross_coupling::stable;
use crate::effects::{Carriage, Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// `gantry.racking`: what goes along y depends on how far along the beam the carriage is.
///
/// The drives see it as an off-diagonal mass m x of the rails at the place x, from the kinetic energy
/// m x v_x v_y (Lagrange): -m x a_y in x and -m (x a_x + v_x^2) in y. The camera sees the beam turn, where its
/// guides are soft: with the carriage at x, its inertia in y turns the beam against the stiffness K by the
/// angle -(M / K) x a_y; the magnet follows by -(M / K) x^2 a_y in y and, h in front of the beam, by
/// (M h / K) x a_y in x. Without dynamics of its own: the beam is stiff enough to follow at once.
pub(crate) static RACKING: Effect = Effect {
    name: "gantry.racking",
    says: "accelerating in y away from the middle of the beam pushes and turns it",
    domain: Domain::Gantry,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "mass_kg_per_m",
            unit: "kg/m",
            scale: 0.5,
            bounds: (-50.0, 50.0),
            plausible: (-5.0, 5.0),
            per_session: false,
        },
        Parameter {
            name: "yaw_rad_s2_per_m2",
            unit: "rad s^2/m^2",
            scale: 2e-3,
            bounds: (0.0, 1.0),
            plausible: (1e-4, 2e-2),
            per_session: false,
        },
        Parameter {
            name: "across_s2_per_m",
            unit: "s^2/m",
            scale: 2e-4,
            bounds: (-0.1, 0.1),
            plausible: (-2e-3, 2e-3),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0],
    probes: &[&[0.5, 0.0, 0.0], &[0.0, 2e-3, 2e-4]],
    memory: 0,
    physics: Physics::Both(&[Physics::Force(push), Physics::Frame(yaw)]),
    regressors: &[Regressor::OtherAxis, Regressor::Acceleration, Regressor::Position],
    excitation: "hard moves in y at several places in x, with torque, camera and encoders",
    experiment: "random_walk",
    confused_with: &["gantry.cross_coupling", "coupling.magnet_spring", "drive.compliance.belt"],
};

fn push(p: &[f64], _: &mut [f64], motion: &Motion) -> f64 {
    let other = &motion.other;
    match motion.index {
        0 => -stable(p[0] * motion.position, motion) * other.acceleration,
        _ => {
            -stable(p[0] * other.position, motion) * other.acceleration
                - p[0] * other.velocity.powi(2)
        }
    }
}

fn yaw(p: &[f64], carriage: &Carriage) -> [f64; 2] {
    let [x, y] = carriage.position;
    let moment = x * carriage.acceleration[1];
    [x + p[2] * moment, y - p[1] * x * moment]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CrossMotion;

    #[test]
    fn the_beam_stays_behind_at_both_ends_and_moves_x_oppositely() {
        let at = |x: f64| {
            let carriage =
                Carriage { position: [x, 0.0], acceleration: [3.0, 10.0], ..Carriage::default() };
            yaw(&[0.0, 2e-3, 1e-4], &carriage)
        };
        let [right, left] = [at(0.1), at(-0.1)];
        assert!((right[0] - 0.1001).abs() < 1e-12 && (right[1] + 2e-4).abs() < 1e-12);
        assert!((left[0] + 0.1001).abs() < 1e-12 && (left[1] + 2e-4).abs() < 1e-12);
        assert_eq!(at(0.0), [0.0, 0.0]);
    }

    /// The power of both forces is the rate at which m x v_x v_y falls.
    #[test]
    fn the_push_takes_no_energy() {
        let (m, x, v, a) = (1.5, 0.08, [0.3, -0.5], [4.0, 7.0]);
        let rail = |index: usize, position: f64| Motion {
            index,
            position,
            velocity: v[index],
            other: CrossMotion {
                position: if index == 1 { x } else { 0.0 },
                velocity: v[1 - index],
                acceleration: a[1 - index],
                ..CrossMotion::default()
            },
            ..Motion::default()
        };
        let force = |index: usize, at: f64| push(&[m, 0.0, 0.0], &mut [], &rail(index, at));
        let power = force(0, x) * v[0] + force(1, 0.0) * v[1];
        let rate = m * (v[0] * v[0] * v[1] + x * (a[0] * v[1] + v[0] * a[1]));
        assert!((power + rate).abs() < 1e-12, "{power} {rate}");
        assert_eq!(push(RACKING.null, &mut [], &rail(0, x)), 0.0);
    }
}
