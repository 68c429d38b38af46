//! The board sags or bulges.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `ball.board_curvature`: acceleration `-g grad h` with `h = height (1 - (x/a)^2)(1 - (y/b)^2)`,
/// a board that is held along its rim (`a`, `b` half its sides; first term of the bent plate,
/// approximate). Like the tilt, without the 5/7 of a rolling sphere.
pub(crate) static BOARD_CURVATURE: Effect = Effect {
    name: "ball.board_curvature",
    says: "the ball is drawn to the middle, or to the rim, as on a board that sags or bulges",
    domain: Domain::Ball,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "height_m",
        unit: "m",
        scale: 0.0003,
        bounds: (-0.02, 0.02),
        plausible: (-0.002, 0.002),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.0002], &[-0.0002]],
    memory: 0,
    physics: Physics::Roll(slope),
    regressors: &[Regressor::Position],
    excitation: "rolls everywhere on the board",
    experiment: "",
    confused_with: &["ball.tilt", "ball.stiction_patch", "sensor.camera_distortion"],
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;
/// Half of the board's sides (m).
const HALF: [f64; 2] = [0.16, 0.21];

fn slope(p: &[f64], ball: &Ball) -> [f64; 2] {
    let [across, along] = [ball.position[0] / HALF[0], ball.position[1] / HALF[1]];
    let pull = 2.0 * GRAVITY * p[0];
    [
        pull * across / HALF[0] * (1.0 - along * along),
        pull * along / HALF[1] * (1.0 - across * across),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bulge_pushes_outwards_and_a_sag_inwards() {
        let ball = Ball { position: [0.08, 0.0], ..Ball::default() };
        let [x, y] = slope(&[0.001], &ball);
        assert!((x - 2.0 * 9.81 * 0.001 * 0.08 / 0.16_f64.powi(2)).abs() < 1e-12 && y == 0.0);
        assert_eq!(slope(&[-0.001], &ball)[0], -x);
        assert_eq!(slope(BOARD_CURVATURE.null, &ball), [0.0, 0.0]);
    }
}
