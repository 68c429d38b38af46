//! Load-dependent friction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.load`: load-dependent friction.
///
/// F is the drive force.
pub(crate) static LOAD: Effect = Effect {
    name: "drive.friction.load",
    summary: "friction grows with the drive force",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "Δ|F_f| = K_l · |F|",
    parameters: &[Parameter {
        name: "coefficient",
        symbol: "K_l",
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
    signals: Signal::DRIVE,
    excitation: "two payloads, or low and high accelerations",
    experiment: "step_ladder",
    confused_with: &["drive.friction.asymmetric", "drive.gain", "drive.saturation.torque_speed"],
    reference: "Duclusaud et al. 2024, Extended Friction Models for the Physics Simulation of Servo Actuators (arXiv 2410.08650)",
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
