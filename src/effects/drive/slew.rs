//! Slew limit of the velocity setpoint.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// Setpoint after a step from the setpoint `before`, which follows the `command` and changes by `most` at most.
pub(crate) fn slewed(before: f64, command: f64, most: f64) -> f64 {
    before + (command - before).clamp(-most, most)
}

/// `drive.saturation.slew`: limit in metres of belt.
pub(crate) static SLEW: Effect = Effect {
    name: "drive.saturation.slew",
    summary: "the drive limits the rate of its velocity setpoint",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "|dr/dt| ≤ S",
    parameters: &[Parameter {
        name: "limit_m_per_s2",
        symbol: "S",
        unit: "m/s^2",
        scale: 1.0,
        bounds: (0.1, 500.0),
        plausible: (1.0, 60.0),
        per_session: false,
    }],
    null: &[500.0],
    probes: &[&[30.0], &[10.0], &[4.0]],
    memory: 1,
    physics: Physics::Ramp(|p| p[0]),
    regressors: &[Regressor::Acceleration],
    signals: Signal::DRIVE,
    excitation: "velocity steps larger than the drive can follow within one sample",
    experiment: "step_ladder",
    confused_with: &["drive.lag1", "drive.velocity_loop", "drive.saturation.torque_speed"],
    reference: "Åström and Murray 2021, Feedback Systems (rate limits)",
};
