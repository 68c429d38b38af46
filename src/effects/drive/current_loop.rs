//! First-order lag of the motor force behind its demand.

use crate::effects::{
    Domain, Effect, Parameter, Physics, Regressor, Signal, Site, first_order::follow,
};

/// `drive.current_loop`: first-order lag of the motor force behind its demand.
///
/// A ramp of the demand F_d is late by T_e. In an inverse model this lag is an extra force of M T_e
/// times the jerk.
pub(crate) static CURRENT_LOOP: Effect = Effect {
    name: "drive.current_loop",
    summary: "the motor force follows its demand with a short first-order lag",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "T_e · dF/dt + F = F_d",
    parameters: &[Parameter {
        name: "time_constant_s",
        symbol: "T_e",
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
    signals: Signal::DRIVE,
    excitation: "reversals of the acceleration at full force, with the torque recorded",
    experiment: "step_ladder",
    confused_with: &[
        "drive.delay",
        "drive.lag1",
        "drive.compliance.belt",
        "drive.velocity_loop",
        "drive.friction.presliding",
    ],
    reference: "Leonhard 2001, Control of Electrical Drives (current control)",
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
        // The demand rises linearly within the first step and is constant afterwards.
        assert!((follow(&[1e-3], &mut memory, &motion) - 8.0 * left).abs() < 1e-12);
        let want = 8.0 - 8.0 * (1.0 - left) * left;
        assert!((follow(&[1e-3], &mut memory, &motion) - want).abs() < 1e-12);
        assert_eq!(follow(CURRENT_LOOP.null, &mut [0.0; 2], &motion), 8.0);
    }
}
