//! Friction in proportion to the load.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.load`: the level grows by Kl |F|, with the drive force F. Source: Duclusaud et
/// al. 2024, "Extended friction models for the physics simulation of servo actuators" (arXiv
/// 2410.08650).
pub(crate) static LOAD: Effect = Effect {
    name: "drive.friction.load",
    says: "friction grows with the force that the drive gives",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[Parameter {
        name: "share",
        unit: "1",
        scale: 0.05,
        bounds: (0.0, 0.9),
        plausible: (0.02, 0.3),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.05]],
    memory: 0,
    physics: Physics::Friction(|p, _, motion| p[0] * motion.force.abs()),
    regressors: &[Regressor::Load, Regressor::Direction],
    excitation: "two payloads, or low and high accelerations",
    experiment: "step_ladder",
    confused_with: &["drive.friction.asymmetric", "drive.gain", "drive.saturation.torque_speed"],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn it_grows_with_the_force_whatever_its_sign() {
        let Physics::Friction(level) = LOAD.physics else { panic!("it is friction") };
        let motion = Motion { force: -8.0, velocity: 1.0, ..Motion::default() };
        assert_eq!(level(&[0.25], &mut [], &motion), 2.0);
        assert_eq!(level(LOAD.null, &mut [], &motion), 0.0);
    }
}
