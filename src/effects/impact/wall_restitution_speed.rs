//! Fast impacts lose more.

use crate::effects::{Change, Domain, Effect, Parameter, Physics, Regressor, Site};

/// `impact.wall_restitution_speed`: e = e0 - e1 v with the normal speed v, never below 0; e0 is
/// that of the effects before (losses by plastic and viscous deformation grow with speed:
/// Goldsmith, Impact; the straight line is an approximation over the speeds of the game).
pub(crate) static WALL_RESTITUTION_SPEED: Effect = Effect {
    name: "impact.wall_restitution_speed",
    says: "the walls give back less of the speed the faster the ball hits them",
    domain: Domain::Impact,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "slope_s_per_m",
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
    excitation: "impacts over a factor of two or more in speed",
    experiment: "",
    confused_with: &[
        "impact.wall_friction_spin",
        "impact.wall_restitution",
        "ball.air_drag",
        "sensor.frame_jitter",
    ],
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
