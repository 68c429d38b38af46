//! Racking: the bridge yaws when the carriage accelerates off its centre.

use super::cross_coupling::stable;
use crate::effects::{
    Carriage, Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site,
};

/// `gantry.racking`: racking: the bridge yaws when the carriage accelerates off its centre.
///
/// Motion along y depends on the carriage position x on the bridge. The drives see an off-diagonal
/// mass that is proportional to x, from the kinetic energy term mu x v_x v_y (Lagrange). The camera
/// sees the bridge yaw on compliant guides. With the carriage at x, its inertia M in y turns the
/// bridge against the stiffness K by the angle -(M/K) x a_y. The magnet follows by -(M/K) x^2 a_y
/// in y. At a distance h in front of the bridge it also moves by (M h/K) x a_y in x. The yaw is
/// quasi-static: the bridge is stiff enough to follow at once.
pub(crate) static RACKING: Effect = Effect {
    name: "gantry.racking",
    summary: "acceleration in y away from the centre of the bridge makes the bridge yaw",
    domain: Domain::Gantry,
    site: Site::Whole,
    equation: "F_x = −μ · x · a_y, F_y = −μ · (x · a_x + v_x²); Δy = −κ · x² · a_y, Δx = η · x · a_y",
    parameters: &[
        Parameter {
            name: "mass_kg_per_m",
            symbol: "μ",
            unit: "kg/m",
            scale: 0.5,
            bounds: (-50.0, 50.0),
            plausible: (-5.0, 5.0),
            per_session: false,
        },
        Parameter {
            name: "yaw_rad_s2_per_m2",
            symbol: "κ",
            unit: "rad s^2/m^2",
            scale: 2e-3,
            bounds: (0.0, 1.0),
            plausible: (1e-4, 2e-2),
            per_session: false,
        },
        Parameter {
            name: "across_s2_per_m",
            symbol: "η",
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
    signals: Signal::MOTION,
    excitation: "high accelerations in y at several positions in x, with torque, camera and encoders",
    experiment: "random_walk",
    confused_with: &["gantry.cross_coupling", "coupling.magnet_spring", "drive.compliance.belt"],
    reference: "Lagrange's equations; Sollmann, Jouaneh and Lavender 2010, IEEE/ASME Transactions on Mechatronics 15(2), 280-290",
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

    /// The power of both forces is the rate of decrease of mu x v_x v_y.
    #[test]
    fn the_push_takes_no_energy() {
        let (m, x, v, a) = (1.5, 0.08, [0.3, -0.5], [4.0, 7.0]);
        let axis = |index: usize, position: f64| Motion {
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
        let force = |index: usize, at: f64| push(&[m, 0.0, 0.0], &mut [], &axis(index, at));
        let power = force(0, x) * v[0] + force(1, 0.0) * v[1];
        let rate = m * (v[0] * v[0] * v[1] + x * (a[0] * v[1] + v[0] * a[1]));
        assert!((power + rate).abs() < 1e-12, "{power} {rate}");
        assert_eq!(push(RACKING.null, &mut [], &axis(0, x)), 0.0);
    }
}
