//! The drive's ramp: the setpoint of the velocity loop changes no faster than this.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.saturation.slew`: |dr/dt| <= limit, in metres of belt.
pub(crate) static SLEW: Effect = Effect {
    name: "drive.saturation.slew",
    says: "the drive ramps its setpoint, so velocity changes with a constant slope",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "limit_m_per_s2",
        unit: "m/s^2",
        scale: 1.0,
        bounds: (0.1, 500.0),
        plausible: (1.0, 60.0),
        per_session: false,
    }],
    null: &[500.0],
    probes: &[&[30.0], &[10.0], &[4.0]],
    memory: 1,
    physics: Physics::Ramp(|p, memory, command, dt| {
        memory[0] += (command - memory[0]).clamp(-p[0] * dt, p[0] * dt);
        memory[0]
    }),
    regressors: &[Regressor::Acceleration],
    excitation: "velocity steps larger than the ramp can follow within a sample",
    experiment: "step_ladder",
    confused_with: &["drive.lag1", "drive.velocity_loop", "drive.saturation.torque_speed"],
};
