//! Velocity loop of the drive: proportional and integral action on the velocity error.

use crate::effects::{Domain, Effect, LoopGains, Parameter, Physics, Regressor, Signal, Site};
use std::f64::consts::TAU;

/// `drive.velocity_loop`: velocity loop of the drive: proportional and integral action on the
/// velocity error.
///
/// The closed loop with the mass M is (2 z w s + w^2) / (s^2 + 2 z w s + w^2). M is the mass for
/// which the loop was first fitted: the gains stay when the mass changes. The velocity in the error
/// is the output of an estimator, a critically damped phase-locked loop on the encoder with the
/// bandwidth 1/T (ODrive documentation, `encoder_bandwidth`). The drive reports that velocity, too.
/// The loop is digital: sampling and actuation delay the velocity in its error. The drive also
/// reports its torque with a delay, by its last cycle and its filter.
pub(crate) static VELOCITY_LOOP: Effect = Effect {
    name: "drive.velocity_loop",
    summary: "the velocity loop has another bandwidth or damping",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "F = M · (2 ζ · ω · e + ω² · ∫ e dt), e = r − v_e(t − T_v), ω = 2π · f; v_e = v / (1 + s · T_e)^2; reported force = F(t − T_t)",
    parameters: &[
        Parameter {
            name: "natural_frequency_hz",
            symbol: "f",
            unit: "Hz",
            scale: 5.0,
            bounds: (0.5, 300.0),
            plausible: (5.0, 80.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            symbol: "ζ",
            unit: "1",
            scale: 0.5,
            bounds: (0.05, 50.0),
            plausible: (0.3, 5.0),
            per_session: false,
        },
        Parameter {
            name: "feedback_delay_s",
            symbol: "T_v",
            unit: "s",
            scale: 2e-4,
            bounds: (0.0, 1e-3),
            plausible: (0.0, 5e-4),
            per_session: false,
        },
        Parameter {
            name: "torque_report_delay_s",
            symbol: "T_t",
            unit: "s",
            scale: 2e-4,
            bounds: (0.0, 2e-3),
            plausible: (0.0, 1e-3),
            per_session: false,
        },
        Parameter {
            name: "estimator_time_constant_s",
            symbol: "T_e",
            unit: "s",
            scale: 2e-4,
            bounds: (0.0, 2e-3),
            plausible: (0.0, 1.5e-3),
            per_session: false,
        },
    ],
    null: &[300.0, 1.0, 0.0, 0.0, 0.0],
    probes: &[
        &[20.0, 1.0, 0.0, 0.0, 0.0],
        &[60.0, 1.0, 0.0, 0.0, 0.0],
        &[10.0, 0.5, 0.0, 0.0, 0.0],
    ],
    memory: 0,
    physics: Physics::VelocityLoop(|p| {
        let w = TAU * p[0];
        LoopGains {
            proportional_per_s: 2.0 * p[1] * w,
            integral_per_s2: w * w,
            feedback_delay_s: p[2],
            torque_report_delay_s: p[3],
            estimator_time_constant_s: p[4],
        }
    }),
    regressors: &[Regressor::Acceleration, Regressor::Jerk],
    signals: Signal::MOTOR,
    excitation: "velocity steps and chirps",
    experiment: "step_ladder",
    confused_with: &["drive.compliance.belt", "drive.lag1", "drive.delay"],
    reference: "Leonhard 2001, Control of Electrical Drives (cascade control)",
};
