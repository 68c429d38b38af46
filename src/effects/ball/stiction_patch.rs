//! A place where the ball rolls worse.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `ball.stiction_patch`: additional deceleration `c g / (1 + (d/r)^8)` at the distance `d` from
/// the middle of the patch: nearly all of it inside the radius `r`, none outside, and smooth
/// between.
pub(crate) static STICTION_PATCH: Effect = Effect {
    name: "ball.stiction_patch",
    says: "the ball slows down more in one place of the board, as over dirt or wear",
    domain: Domain::Ball,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "coefficient",
            unit: "1",
            scale: 0.01,
            bounds: (0.0, 2.0),
            plausible: (0.002, 0.2),
            per_session: false,
        },
        Parameter {
            name: "x_m",
            unit: "m",
            scale: 0.02,
            bounds: (-0.16, 0.16),
            plausible: (-0.16, 0.16),
            per_session: false,
        },
        Parameter {
            name: "y_m",
            unit: "m",
            scale: 0.02,
            bounds: (-0.21, 0.21),
            plausible: (-0.21, 0.21),
            per_session: false,
        },
        Parameter {
            name: "radius_m",
            unit: "m",
            scale: 0.01,
            bounds: (0.002, 0.1),
            plausible: (0.005, 0.04),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0, 0.03],
    probes: &[
        &[0.01, -0.09, -0.14, 0.03],
        &[0.01, -0.09, -0.045, 0.03],
        &[0.01, -0.09, 0.045, 0.03],
        &[0.01, -0.09, 0.14, 0.03],
        &[0.01, 0.0, -0.14, 0.03],
        &[0.01, 0.0, -0.045, 0.03],
        &[0.01, 0.0, 0.045, 0.03],
        &[0.01, 0.0, 0.14, 0.03],
        &[0.01, 0.09, -0.14, 0.03],
        &[0.01, 0.09, -0.045, 0.03],
        &[0.01, 0.09, 0.045, 0.03],
        &[0.01, 0.09, 0.14, 0.03],
    ],
    memory: 0,
    physics: Physics::Resistance(patch),
    regressors: &[Regressor::Position],
    excitation: "many slow rolls over one area",
    experiment: "",
    confused_with: &["ball.board_curvature", "ball.magnet_drag"],
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;

fn patch(p: &[f64], ball: &Ball) -> f64 {
    let square = (ball.position[0] - p[1]).powi(2) + (ball.position[1] - p[2]).powi(2);
    p[0] * GRAVITY / (1.0 + (square / (p[3] * p[3])).powi(4))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_place_itself_is_worse() {
        let p = [0.05, 0.1, -0.1, 0.02];
        let at = |x: f64, y: f64| patch(&p, &Ball { position: [x, y], ..Ball::default() });
        assert!((at(0.1, -0.1) - 0.4905).abs() < 1e-9);
        assert!((at(0.12, -0.1) - 0.24525).abs() < 1e-9);
        assert!(at(0.0, 0.0) < 1e-4);
        assert_eq!(patch(STICTION_PATCH.null, &Ball::default()), 0.0);
    }
}
