//! The board is not level.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `ball.tilt`: the constant acceleration `g tilt`, positive towards positive x and y. These are
/// the angles by which gravity leans; a solid sphere that rolls without slip on a tilted board
/// feels 5/7 of it, so the board itself then leans by 7/5 of these angles.
pub(crate) static TILT: Effect = Effect {
    name: "ball.tilt",
    says: "the ball is drawn to one side everywhere and always, as on a board that is not level",
    domain: Domain::Ball,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "tilt_x_rad",
            unit: "rad",
            scale: 0.002,
            bounds: (-0.2, 0.2),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
        Parameter {
            name: "tilt_y_rad",
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
    excitation: "rolls across the field in both directions",
    experiment: "",
    confused_with: &["ball.rolling_resistance", "ball.board_curvature", "impact.wall_location"],
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
