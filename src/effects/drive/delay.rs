//! Dead time between the time stamp of a command and its effect.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.delay`: dead time of the command.
pub(crate) static DELAY: Effect = Effect {
    name: "drive.delay",
    summary: "commands take effect a constant time after they were sent",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "u′(t) = u(t − T_d)",
    parameters: &[Parameter {
        name: "delay_s",
        symbol: "T_d",
        unit: "s",
        scale: 0.002,
        bounds: (-0.02, 0.2),
        plausible: (0.0002, 0.06),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.002], &[0.015]],
    memory: 0,
    physics: Physics::CommandDelay(|p| p[0]),
    regressors: &[Regressor::Acceleration],
    signals: Signal::DRIVE,
    excitation: "steps of the command, or a chirp over a decade of frequency",
    experiment: "chirp",
    confused_with: &[
        "drive.lag1",
        "drive.current_loop",
        "drive.velocity_loop",
        "sensor.camera_latency",
        "estimator.lag",
        "sensor.clock_skew",
    ],
    reference: "Åström and Murray 2021, Feedback Systems (time delays)",
};
