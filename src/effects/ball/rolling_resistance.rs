//! Rolling resistance of the ball.

use crate::effects::{Ball, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.rolling_resistance`: rolling resistance of the ball.
///
/// The deceleration opposes the motion until rest. c represents the deformation of board and ball
/// (constant), b for grease and for air at small Reynolds numbers (linear).
pub(crate) static ROLLING_RESISTANCE: Effect = Effect {
    name: "ball.rolling_resistance",
    summary: "the ball decelerates at a constant rate while it rolls",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = −(c · g + b · |v|) · v / |v|",
    parameters: &[
        Parameter {
            name: "coefficient",
            symbol: "c",
            unit: "1",
            scale: 0.005,
            bounds: (0.0, 0.3),
            plausible: (0.002, 0.03),
            per_session: false,
        },
        Parameter {
            name: "viscous_per_s",
            symbol: "b",
            unit: "1/s",
            scale: 0.05,
            bounds: (0.0, 5.0),
            plausible: (0.0, 0.3),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.008, 0.0]],
    memory: 0,
    physics: Physics::Resistance(|p, ball| (p[0] * GRAVITY + p[1] * speed(ball)).max(0.0)),
    regressors: &[Regressor::Constant, Regressor::Direction],
    signals: Signal::BALL,
    excitation: "free rolls at many speeds",
    experiment: "",
    confused_with: &["ball.tilt", "ball.air_drag", "impact.wall_restitution"],
    reference: "Johnson 1985, Contact Mechanics, chapter 9",
};

fn speed(ball: &Ball) -> f64 {
    (ball.velocity[0].powi(2) + ball.velocity[1].powi(2)).sqrt()
}

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_and_linear_parts_add() {
        let Physics::Resistance(resistance) = ROLLING_RESISTANCE.physics else {
            panic!("not a resistance")
        };
        let ball = Ball { velocity: [-0.3, 0.4], ..Ball::default() };
        assert!((resistance(&[0.01, 0.2], &ball) - (0.0981 + 0.1)).abs() < 1e-12);
        assert_eq!(resistance(ROLLING_RESISTANCE.null, &ball), 0.0);
    }
}
