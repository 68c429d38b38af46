//! The drive's velocity loop: proportional and integral action on the velocity error.

use crate::effects::{Domain, Effect, LoopGains, Parameter, Physics, Regressor, Site};
use std::f64::consts::TAU;

/// `drive.velocity_loop`: force M (2 z w e + w^2 integral of e), so that the closed loop with the mass M is
/// (2 z w s + w^2) / (s^2 + 2 z w s + w^2). M is the mass for which the loop was fitted first: its gains stay when the
/// mass changes. The loop runs on a computer: the velocity in its error e is a little old, by the sampling, the
/// encoder's filter and the time that it takes to act. So is the torque that the drive reports, by its last pass and by
/// what filters it.
pub(crate) static VELOCITY_LOOP: Effect = Effect {
    name: "drive.velocity_loop",
    says: "the velocity loop answers with another bandwidth or damping",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[
        Parameter {
            name: "natural_frequency_hz",
            unit: "Hz",
            scale: 5.0,
            bounds: (0.5, 300.0),
            plausible: (5.0, 80.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            unit: "1",
            scale: 0.5,
            bounds: (0.05, 50.0),
            plausible: (0.3, 5.0),
            per_session: false,
        },
        Parameter {
            name: "feedback_age_s",
            unit: "s",
            scale: 2e-4,
            bounds: (0.0, 1e-3),
            plausible: (0.0, 5e-4),
            per_session: false,
        },
        Parameter {
            name: "torque_age_s",
            unit: "s",
            scale: 2e-4,
            bounds: (0.0, 2e-3),
            plausible: (0.0, 1e-3),
            per_session: false,
        },
    ],
    null: &[300.0, 1.0, 0.0, 0.0],
    probes: &[&[20.0, 1.0, 0.0, 0.0], &[60.0, 1.0, 0.0, 0.0], &[10.0, 0.5, 0.0, 0.0]],
    memory: 0,
    physics: Physics::VelocityLoop(|p| {
        let w = TAU * p[0];
        LoopGains {
            proportional_per_s: 2.0 * p[1] * w,
            integral_per_s2: w * w,
            feedback_age_s: p[2],
            torque_age_s: p[3],
        }
    }),
    regressors: &[Regressor::Acceleration, Regressor::Jerk],
    excitation: "velocity steps and chirps",
    experiment: "step_ladder",
    confused_with: &["drive.compliance.belt", "drive.lag1", "drive.delay"],
};
