//! Sliding of the ball after an impact, until it rolls.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `ball.sliding_phase`: sliding of the ball after an impact, until it rolls.
///
/// An impact changes the velocity and not the spin of rolling. The contact point then slides, and
/// friction acts on it until the slip is zero. For a solid sphere this takes 2/7 of the slip from
/// the velocity (the 5/7 rule). Very large values mean an immediate change at each impact, which is
/// a smaller restitution. A ball that is struck slides at first as well. `slip_at_start` is the
/// fraction of its velocity with which it slides where a roll begins: 0 for a rolling ball, 1 for a
/// ball without spin.
pub(crate) static SLIDING_PHASE: Effect = Effect {
    name: "ball.sliding_phase",
    summary: "after an impact the ball slides for a moment, and decelerates faster until it rolls",
    domain: Domain::Ball,
    site: Site::Whole,
    equation: "a = −μ · g · w / |w| while the slip velocity w ≠ 0; w = s · v at the start of a roll",
    parameters: &[
        Parameter {
            name: "coefficient",
            symbol: "μ",
            unit: "1",
            scale: 0.05,
            bounds: (0.0, 2.0),
            plausible: (0.05, 0.25),
            per_session: false,
        },
        Parameter {
            name: "slip_at_start",
            symbol: "s",
            unit: "1",
            scale: 0.5,
            bounds: (0.0, 1.0),
            plausible: (0.0, 1.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.03, 0.0], &[0.1, 0.0], &[0.25, 0.0], &[0.06, 1.0]],
    memory: 0,
    physics: Physics::Both(&[Physics::Slide(|p, _| p[0] * GRAVITY), Physics::Launch(|p| p[1])]),
    regressors: &[Regressor::ImpactSpeed],
    signals: Signal::BALL,
    excitation: "hard and off-centre impacts",
    experiment: "",
    confused_with: &[
        "impact.wall_restitution",
        "impact.wall_restitution_speed",
        "ball.rolling_resistance",
    ],
    reference: "Alciatore 2004, The Illustrated Principles of Pool and Billiards",
};

/// Standard gravity (m/s^2).
const GRAVITY: f64 = 9.81;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Ball;

    #[test]
    fn friction_is_a_share_of_gravity() {
        let Physics::Both([Physics::Slide(slide), Physics::Launch(slip)]) = SLIDING_PHASE.physics
        else {
            panic!("not sliding")
        };
        assert!((slide(&[0.2, 0.5], &Ball::default()) - 1.962).abs() < 1e-12);
        assert_eq!(slip(&[0.2, 0.5]), 0.5);
        assert_eq!(slide(SLIDING_PHASE.null, &Ball::default()), 0.0);
    }
}
