//! Curvature of the board.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.board_curvature`: curvature of the board.
///
/// A and b are half of the sides of the board. Without `corner_drop` the board is held along its
/// rim (first term of the bent plate, approximate). At 1 it is a bowl of constant curvature: its
/// corners are as far below the middles of its sides as these are below its centre. As for the
/// tilt, the 5/7 of a rolling sphere is not applied.
pub(crate) static BOARD_CURVATURE: Effect = Effect {
    name: "ball.board_curvature",
    summary: "the ball accelerates towards the centre or the rim, as on a board that sags or bulges",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = −g · ∇h, h = H · ((1 − X²)(1 − Y²) − D · X² · Y²), X = x / 0.16 m, Y = y / 0.21 m",
    parameters: &[
        Parameter {
            name: "height_m",
            symbol: "H",
            unit: "m",
            scale: 0.0003,
            bounds: (-0.02, 0.02),
            plausible: (-0.002, 0.002),
            per_session: false,
        },
        Parameter {
            name: "corner_drop",
            symbol: "D",
            unit: "1",
            scale: 0.5,
            bounds: (-2.0, 3.0),
            plausible: (-0.5, 1.5),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.0002, 0.0], &[-0.0002, 0.0]],
    memory: 0,
    physics: Physics::Roll(slope),
    regressors: &[Regressor::Position],
    signals: Signal::BALL,
    excitation: "rolls everywhere on the board",
    experiment: "",
    confused_with: &["ball.tilt", "ball.stiction_patch", "sensor.camera_distortion"],
    reference: "Timoshenko and Woinowsky-Krieger 1959, Theory of Plates and Shells",
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;
/// Half of the board's sides (m).
const HALF: [f64; 2] = [0.16, 0.21];

fn slope(p: &[f64], ball: &Ball) -> [f64; 2] {
    let [across, along] = [ball.position[0] / HALF[0], ball.position[1] / HALF[1]];
    let (pull, kept) = (2.0 * GRAVITY * p[0], 1.0 - p[1]);
    [
        pull * across / HALF[0] * (1.0 - kept * along * along),
        pull * along / HALF[1] * (1.0 - kept * across * across),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bulge_pushes_outwards_and_a_sag_inwards() {
        let ball = Ball { position: [0.08, 0.0], ..Ball::default() };
        let [x, y] = slope(&[0.001, 0.0], &ball);
        assert!((x - 2.0 * 9.81 * 0.001 * 0.08 / 0.16_f64.powi(2)).abs() < 1e-12 && y == 0.0);
        assert_eq!(slope(&[-0.001, 0.0], &ball)[0], -x);
        assert_eq!(slope(BOARD_CURVATURE.null, &ball), [0.0, 0.0]);
    }

    #[test]
    fn the_pull_is_the_slope_of_the_board() {
        let height = |p: &[f64; 2], at: [f64; 2]| {
            let [x2, y2] = [0, 1].map(|k| (at[k] / HALF[k]).powi(2));
            p[0] * ((1.0 - x2) * (1.0 - y2) - p[1] * x2 * y2)
        };
        for p in [[0.001, 0.0], [-0.0004, 1.0], [0.0007, 0.4]] {
            let at = [0.07, -0.13];
            let pull = slope(&p, &Ball { position: at, ..Ball::default() });
            for k in 0..2 {
                let moved = |by: f64| {
                    let mut at = at;
                    at[k] += by;
                    height(&p, at)
                };
                let steep = (moved(1e-6) - moved(-1e-6)) / 2e-6;
                assert!((pull[k] + GRAVITY * steep).abs() < 1e-8, "{p:?} {k}");
            }
        }
        // In a bowl the acceleration along x does not depend on y.
        let at_y = |y: f64| slope(&[0.001, 1.0], &Ball { position: [0.05, y], ..Ball::default() });
        assert!((at_y(0.0)[0] - at_y(0.2)[0]).abs() < 1e-15);
    }
}
