//! The force follows its demand through the current loop.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site, first_order::follow};

/// `drive.current_loop`: Te F' + F = Fd, so that a ramp of the demand is Te behind.
/// In an inverse model it is an extra force M Te jerk.
pub(crate) static CURRENT_LOOP: Effect = Effect {
    name: "drive.current_loop",
    says: "the motor force follows its demand with a short first-order lag",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "time_constant_s",
        unit: "s",
        scale: 0.0005,
        bounds: (0.0, 0.1),
        plausible: (0.0002, 0.003),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.0005], &[0.003]],
    memory: 2,
    physics: Physics::Effort(|p, memory, motion| follow(p[0], memory, motion.force, motion.dt)),
    regressors: &[Regressor::Jerk],
    excitation: "reversals of the acceleration at full force, with the torque recorded",
    experiment: "step_ladder",
    confused_with: &[
        "drive.delay",
        "drive.lag1",
        "drive.compliance.belt",
        "drive.velocity_loop",
        "drive.friction.presliding",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_force_follows_and_without_a_time_constant_at_once() {
        let Physics::Effort(follow) = CURRENT_LOOP.physics else { panic!("it acts on the effort") };
        let motion = Motion { dt: 1e-3, force: 8.0, ..Motion::default() };
        let left = (-1.0_f64).exp();
        let mut memory = [0.0; 2];
        // The demand rises within the first step, and is held from then on.
        assert!((follow(&[1e-3], &mut memory, &motion) - 8.0 * left).abs() < 1e-12);
        let want = 8.0 - 8.0 * (1.0 - left) * left;
        assert!((follow(&[1e-3], &mut memory, &motion) - want).abs() < 1e-12);
        assert_eq!(follow(CURRENT_LOOP.null, &mut [0.0; 2], &motion), 8.0);
    }
}
