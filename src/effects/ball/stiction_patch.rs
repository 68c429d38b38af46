//! Local patch of higher rolling resistance.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.stiction_patch`: local patch of higher rolling resistance.
///
/// Dirt that is thickest in the middle has an exponent of about 2. A worn disc with an edge at the
/// radius r has a large one (super-Gaussian).
pub(crate) static STICTION_PATCH: Effect = Effect {
    name: "ball.stiction_patch",
    summary: "the ball decelerates more in one region of the board, as over dirt or wear",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = −c · g · exp(−(d / r)^n) · v / |v|, d² = (x − x0)² + (y − y0)²",
    parameters: &[
        Parameter {
            name: "coefficient",
            symbol: "c",
            unit: "1",
            scale: 0.01,
            bounds: (0.0, 2.0),
            plausible: (0.002, 0.2),
            per_session: false,
        },
        Parameter {
            name: "x_m",
            symbol: "x0",
            unit: "m",
            scale: 0.02,
            bounds: (-0.16, 0.16),
            plausible: (-0.16, 0.16),
            per_session: false,
        },
        Parameter {
            name: "y_m",
            symbol: "y0",
            unit: "m",
            scale: 0.02,
            bounds: (-0.21, 0.21),
            plausible: (-0.21, 0.21),
            per_session: false,
        },
        Parameter {
            name: "radius_m",
            symbol: "r",
            unit: "m",
            scale: 0.01,
            bounds: (0.002, 0.1),
            plausible: (0.005, 0.04),
            per_session: false,
        },
        Parameter {
            name: "edge_exponent",
            symbol: "n",
            unit: "1",
            scale: 1.0,
            bounds: (1.0, 8.0),
            plausible: (1.0, 8.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0, 0.03, 2.0],
    probes: &[
        &[0.01, -0.12, -0.175, 0.035, 2.0],
        &[0.01, -0.12, -0.105, 0.035, 2.0],
        &[0.01, -0.12, -0.035, 0.035, 2.0],
        &[0.01, -0.12, 0.035, 0.035, 2.0],
        &[0.01, -0.12, 0.105, 0.035, 2.0],
        &[0.01, -0.12, 0.175, 0.035, 2.0],
        &[0.01, -0.06, -0.175, 0.035, 2.0],
        &[0.01, -0.06, -0.105, 0.035, 2.0],
        &[0.01, -0.06, -0.035, 0.035, 2.0],
        &[0.01, -0.06, 0.035, 0.035, 2.0],
        &[0.01, -0.06, 0.105, 0.035, 2.0],
        &[0.01, -0.06, 0.175, 0.035, 2.0],
        &[0.01, 0.0, -0.175, 0.035, 2.0],
        &[0.01, 0.0, -0.105, 0.035, 2.0],
        &[0.01, 0.0, -0.035, 0.035, 2.0],
        &[0.01, 0.0, 0.035, 0.035, 2.0],
        &[0.01, 0.0, 0.105, 0.035, 2.0],
        &[0.01, 0.0, 0.175, 0.035, 2.0],
        &[0.01, 0.06, -0.175, 0.035, 2.0],
        &[0.01, 0.06, -0.105, 0.035, 2.0],
        &[0.01, 0.06, -0.035, 0.035, 2.0],
        &[0.01, 0.06, 0.035, 0.035, 2.0],
        &[0.01, 0.06, 0.105, 0.035, 2.0],
        &[0.01, 0.06, 0.175, 0.035, 2.0],
        &[0.01, 0.12, -0.175, 0.035, 2.0],
        &[0.01, 0.12, -0.105, 0.035, 2.0],
        &[0.01, 0.12, -0.035, 0.035, 2.0],
        &[0.01, 0.12, 0.035, 0.035, 2.0],
        &[0.01, 0.12, 0.105, 0.035, 2.0],
        &[0.01, 0.12, 0.175, 0.035, 2.0],
    ],
    memory: 0,
    physics: Physics::Resistance(patch),
    regressors: &[Regressor::Position],
    signals: Signal::BALL,
    excitation: "many slow rolls over one region",
    experiment: "",
    confused_with: &["ball.board_curvature", "ball.magnet_drag"],
    reference: "local rolling resistance: Johnson 1985, Contact Mechanics, chapter 9",
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;

fn patch(p: &[f64], ball: &Ball) -> f64 {
    let square = (ball.position[0] - p[1]).powi(2) + (ball.position[1] - p[2]).powi(2);
    p[0] * GRAVITY * (-(square / (p[3] * p[3])).powf(0.5 * p[4])).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_place_itself_is_worse() {
        let at = |x: f64, y: f64, exponent: f64| {
            let ball = Ball { position: [x, y], ..Ball::default() };
            patch(&[0.05, 0.1, -0.1, 0.02, exponent], &ball)
        };
        assert!((at(0.1, -0.1, 2.0) - 0.4905).abs() < 1e-9);
        assert!((at(0.12, -0.1, 2.0) - 0.4905 * (-1.0_f64).exp()).abs() < 1e-9);
        // With a sharp edge: the full value inside, zero outside.
        assert!((at(0.11, -0.1, 8.0) - 0.4905).abs() < 0.01);
        assert!(at(0.13, -0.1, 8.0) < 1e-9);
        assert_eq!(patch(STICTION_PATCH.null, &Ball::default()), 0.0);
    }
}
