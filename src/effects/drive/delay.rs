//! Dead time between the command's time stamp and the drive.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.delay`: u(t - Td).
pub(crate) static DELAY: Effect = Effect {
    name: "drive.delay",
    says: "commands take effect a constant time after they were sent",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "delay_s",
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
};
