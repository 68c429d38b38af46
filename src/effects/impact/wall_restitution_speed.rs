//! Speed-dependent restitution of the walls.

use crate::effects::{Change, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `impact.wall_restitution_speed`: speed-dependent restitution of the walls.
///
/// E0 is the restitution of the other effects. Losses by plastic and viscous deformation grow with
/// speed; the straight line is an approximation over the speeds of the game.
pub(crate) static WALL_RESTITUTION_SPEED: Effect = Effect {
    name: "impact.wall_restitution_speed",
    summary: "the restitution of the walls decreases with impact speed",
    domain: Domain::Impact,
    site: Site::Whole,
    equation: "e = max(e0 − e1 · v_n, 0)",
    parameters: &[Parameter {
        name: "slope_s_per_m",
        symbol: "e1",
        unit: "s/m",
        scale: 0.05,
        bounds: (0.0, 1.0),
        plausible: (0.0, 0.3),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.03], &[0.1]],
    memory: 0,
    physics: Physics::Impact(|p, impact, change| Change {
        restitution: (change.restitution - p[0] * impact.normal_speed).max(0.0),
        ..change
    }),
    regressors: &[Regressor::ImpactSpeed],
    signals: Signal::BALL,
    excitation: "impacts over a factor of two or more in speed",
    experiment: "",
    confused_with: &[
        "impact.wall_friction_spin",
        "impact.wall_restitution",
        "ball.air_drag",
        "sensor.frame_jitter",
    ],
    reference: "Goldsmith 1960, Impact",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Impact, Wall};

    #[test]
    fn faster_is_less_and_never_below_zero() {
        let Physics::Impact(act) = WALL_RESTITUTION_SPEED.physics else { panic!("no impact") };
        let at = |slope: f64, normal_speed: f64| {
            let impact =
                Impact { wall: Wall::Left, normal_speed, tangential_velocity: 0.0, spin: 0.0 };
            let before = Change { restitution: 0.9, tangential_velocity: 0.0, spin: 0.0 };
            act(&[slope], &impact, before).restitution
        };
        assert!((at(0.15, 2.0) - 0.6).abs() < 1e-12);
        assert_eq!(at(0.15, 100.0), 0.0);
        assert_eq!(at(0.0, 2.0), 0.9);
    }
}
