//! Position and angle errors of the walls.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `impact.wall_location`: position and angle errors of the walls.
///
/// Shifts are outward; l is the distance from the middle of the wall along x or y.
pub(crate) static WALL_LOCATION: Effect = Effect {
    name: "impact.wall_location",
    summary: "the ball bounces too early or too late at a wall, at every speed",
    domain: Domain::Impact,
    site: Site::Whole,
    equation: "outward shift: w_left + φ_left · ℓ, w_right + φ_right · ℓ, w_near + φ_near · ℓ, w_far + φ_far · ℓ",
    parameters: &[
        Parameter {
            name: "left_m",
            symbol: "w_left",
            unit: "m",
            scale: 0.001,
            bounds: (-0.008, 0.008),
            plausible: (-0.003, 0.003),
            per_session: false,
        },
        Parameter {
            name: "right_m",
            symbol: "w_right",
            unit: "m",
            scale: 0.001,
            bounds: (-0.008, 0.008),
            plausible: (-0.003, 0.003),
            per_session: false,
        },
        Parameter {
            name: "near_m",
            symbol: "w_near",
            unit: "m",
            scale: 0.001,
            bounds: (-0.008, 0.008),
            plausible: (-0.003, 0.003),
            per_session: false,
        },
        Parameter {
            name: "far_m",
            symbol: "w_far",
            unit: "m",
            scale: 0.001,
            bounds: (-0.008, 0.008),
            plausible: (-0.003, 0.003),
            per_session: false,
        },
        Parameter {
            name: "left_turn_rad",
            symbol: "φ_left",
            unit: "rad",
            scale: 0.005,
            bounds: (-0.1, 0.1),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
        Parameter {
            name: "right_turn_rad",
            symbol: "φ_right",
            unit: "rad",
            scale: 0.005,
            bounds: (-0.1, 0.1),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
        Parameter {
            name: "near_turn_rad",
            symbol: "φ_near",
            unit: "rad",
            scale: 0.005,
            bounds: (-0.1, 0.1),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
        Parameter {
            name: "far_turn_rad",
            symbol: "φ_far",
            unit: "rad",
            scale: 0.005,
            bounds: (-0.1, 0.1),
            plausible: (-0.017, 0.017),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    probes: &[&[0.0005, 0.0005, 0.0005, 0.0005, 0.003, 0.003, 0.003, 0.003]],
    memory: 0,
    physics: Physics::Wall(|p, wall, along| p[wall as usize] + p[4 + wall as usize] * along),
    regressors: &[Regressor::Position],
    signals: Signal::BALL,
    excitation: "impacts along each wall",
    experiment: "",
    confused_with: &["sensor.camera_scale_rotation", "sensor.camera_latency"],
    reference: "plane geometry",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Wall;

    #[test]
    fn each_wall_has_its_own_numbers() {
        let Physics::Wall(shift) = WALL_LOCATION.physics else { panic!("no wall") };
        let p = [0.001, 0.002, 0.003, 0.004, 0.0, 0.01, 0.0, 0.0];
        assert_eq!(shift(&p, Wall::Left, 0.1), 0.001);
        assert!((shift(&p, Wall::Right, 0.1) - 0.003).abs() < 1e-12);
        assert_eq!(shift(&p, Wall::Far, 0.1), 0.004);
        assert_eq!(shift(WALL_LOCATION.null, Wall::Near, 0.1), 0.0);
    }
}
