//! Restitution of the walls.

use crate::effects::{Change, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `impact.wall_restitution`: Newton's coefficient of restitution: ratio of the normal speeds after
/// and before an impact.
pub(crate) static WALL_RESTITUTION: Effect = Effect {
    name: "impact.wall_restitution",
    summary: "the walls return a constant fraction of the normal speed",
    domain: Domain::Impact,
    site: Site::Whole,
    equation: "v_n′ = −e · v_n",
    parameters: &[Parameter {
        name: "restitution",
        symbol: "e",
        unit: "1",
        scale: 0.05,
        bounds: (0.0, 1.0),
        plausible: (0.5, 0.95),
        per_session: false,
    }],
    null: &[1.0],
    probes: &[&[0.8], &[0.95]],
    memory: 0,
    physics: Physics::Impact(|p, _, change| Change {
        restitution: change.restitution * p[0],
        ..change
    }),
    regressors: &[Regressor::ImpactSpeed],
    signals: Signal::BALL,
    excitation: "impacts at many speeds",
    experiment: "",
    confused_with: &["sensor.camera_scale_rotation", "sensor.frame_jitter", "ball.sliding_phase"],
    reference: "Newton's law of restitution: Stronge 2000, Impact Mechanics",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Impact, Wall};

    #[test]
    fn shares_multiply_and_one_changes_nothing() {
        let Physics::Impact(act) = WALL_RESTITUTION.physics else { panic!("no impact") };
        let impact =
            Impact { wall: Wall::Far, normal_speed: 1.0, tangential_velocity: 0.3, spin: 0.0 };
        let before = Change { restitution: 0.9, tangential_velocity: 0.3, spin: 0.0 };
        assert_eq!(act(&[0.5], &impact, before).restitution, 0.45);
        assert_eq!(act(WALL_RESTITUTION.null, &impact, before).restitution, 0.9);
    }
}
