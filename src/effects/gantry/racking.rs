//! The beam yaws when the carriage accelerates off its middle.

use crate::effects::{Carriage, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `gantry.racking`: with the carriage at x on the beam, its inertia in y turns the beam against the
/// stiffness K of its guides by the angle -(M / K) x a_y. The magnet follows by -(M / K) x^2 a_y in
/// y and, h in front of the beam, by (M h / K) x a_y in x. Without dynamics of its own: the beam is
/// stiff enough to follow at once.
pub(crate) static RACKING: Effect = Effect {
    name: "gantry.racking",
    says: "the beam turns a little when the carriage accelerates in y away from the middle",
    domain: Domain::Gantry,
    site: Site::Whole,
    parameters: &[
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
    null: &[0.0, 0.0],
    probes: &[&[2e-3, 2e-4]],
    memory: 0,
    physics: Physics::Frame(yaw),
    regressors: &[Regressor::OtherAxis, Regressor::Acceleration, Regressor::Position],
    excitation: "hard moves in y at several places in x, with camera and encoders",
    experiment: "random_walk",
    confused_with: &["gantry.cross_coupling", "coupling.magnet_spring", "drive.compliance.belt"],
};

fn yaw(p: &[f64], carriage: &Carriage) -> [f64; 2] {
    let [x, y] = carriage.position;
    let moment = x * carriage.acceleration[1];
    [x + p[1] * moment, y - p[0] * x * moment]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beam_stays_behind_at_both_ends_and_moves_x_oppositely() {
        let at = |x: f64| {
            let carriage =
                Carriage { position: [x, 0.0], acceleration: [3.0, 10.0], ..Carriage::default() };
            yaw(&[2e-3, 1e-4], &carriage)
        };
        let [right, left] = [at(0.1), at(-0.1)];
        assert!((right[0] - 0.1001).abs() < 1e-12 && (right[1] + 2e-4).abs() < 1e-12);
        assert!((left[0] + 0.1001).abs() < 1e-12 && (left[1] + 2e-4).abs() < 1e-12);
        assert_eq!(at(0.0), [0.0, 0.0]);
    }
}
