//! The ball slides after an impact, until it rolls again.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `ball.sliding_phase`: an impact turns the velocity but not the rolling; the contact point then
/// slides and friction `mu g` acts on it until the slip is gone, which for a solid sphere takes
/// 2/7 of the slip from the velocity (the 5/7 rule; Alciatore, Pool and Billiards Physics
/// Principles, or any text on rolling spheres). Very large values mean an immediate change at each
/// impact, which is a smaller restitution. A ball that is struck slides at first as well: `slip_at_start` is the
/// share of its velocity with which it does where a roll begins, 0 where it rolls already, 1 where it does not turn.
pub(crate) static SLIDING_PHASE: Effect = Effect {
    name: "ball.sliding_phase",
    says: "after an impact the ball slides for a moment, and slows down faster until it rolls",
    domain: Domain::Ball,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "coefficient",
            unit: "1",
            scale: 0.05,
            bounds: (0.0, 2.0),
            plausible: (0.05, 0.25),
            per_session: false,
        },
        Parameter {
            name: "slip_at_start",
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
    excitation: "hard and off-centre impacts",
    experiment: "",
    confused_with: &[
        "impact.wall_restitution",
        "impact.wall_restitution_speed",
        "ball.rolling_resistance",
    ],
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
