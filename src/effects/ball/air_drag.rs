//! Air drag of the ball.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.air_drag`: air drag of the ball.
///
/// K is Cd rho A / (2 m), divided by the 7/5 of a rolling sphere.
pub(crate) static AIR_DRAG: Effect = Effect {
    name: "ball.air_drag",
    summary: "air drag decelerates the ball in proportion to the square of its speed",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = −k · |v| · v",
    parameters: &[Parameter {
        name: "coefficient_per_m",
        symbol: "k",
        unit: "1/m",
        scale: 0.05,
        bounds: (0.0, 5.0),
        plausible: (0.01, 0.05),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.03], &[0.2]],
    memory: 0,
    physics: Physics::Resistance(|p, ball| {
        p[0] * (ball.velocity[0].powi(2) + ball.velocity[1].powi(2))
    }),
    regressors: &[Regressor::Speed],
    signals: Signal::BALL,
    excitation: "fast rolls",
    experiment: "",
    confused_with: &["ball.rolling_resistance", "impact.wall_restitution_speed"],
    reference: "Clift, Grace and Weber 1978, Bubbles, Drops and Particles",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Ball;

    #[test]
    fn drag_grows_with_the_square() {
        let Physics::Resistance(drag) = AIR_DRAG.physics else { panic!("not a resistance") };
        let ball = Ball { velocity: [0.6, -0.8], ..Ball::default() };
        assert!((drag(&[0.04], &ball) - 0.04).abs() < 1e-12);
        assert_eq!(drag(AIR_DRAG.null, &ball), 0.0);
    }
}
