//! Tilt of the board.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.tilt`: constant acceleration, positive towards positive x and y. The parameters are the
/// angles by which gravity leans. A solid sphere that rolls without slip on a tilted board feels
/// 5/7 of it, so the board itself leans by 7/5 of these angles.
pub(crate) static TILT: Effect = Effect {
    name: "ball.tilt",
    summary: "the ball accelerates to one side everywhere, as on a board that is not level",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a_x = g · θ_x, a_y = g · θ_y",
    parameters: &[
        Parameter {
            name: "tilt_x_rad",
            symbol: "θ_x",
            unit: "rad",
            scale: 0.002,
            bounds: (-0.2, 0.2),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
        Parameter {
            name: "tilt_y_rad",
            symbol: "θ_y",
            unit: "rad",
            scale: 0.002,
            bounds: (-0.2, 0.2),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.001, 0.001]],
    memory: 0,
    physics: Physics::Roll(|p, _| [GRAVITY * p[0], GRAVITY * p[1]]),
    regressors: &[Regressor::Constant],
    signals: Signal::BALL,
    excitation: "rolls across the board in both directions",
    experiment: "",
    confused_with: &["ball.rolling_resistance", "ball.board_curvature", "impact.wall_location"],
    reference: "rolling solid sphere: Goldstein, Poole and Safko 2002, Classical Mechanics",
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Ball;

    #[test]
    fn the_same_for_every_motion() {
        let Physics::Roll(pull) = TILT.physics else { panic!("not a roll") };
        for velocity in [[0.0, 0.0], [1.0, -2.0], [-1.0, 0.5]] {
            let [x, y] = pull(&[0.004, -0.001], &Ball { velocity, ..Ball::default() });
            assert!((x - 0.03924).abs() < 1e-12 && (y + 0.00981).abs() < 1e-12);
        }
        assert_eq!(pull(TILT.null, &Ball::default()), [0.0, 0.0]);
    }
}
