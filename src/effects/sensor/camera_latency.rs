//! Latency of the camera.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.camera_latency`: dead time from a position to its report.
pub(crate) static CAMERA_LATENCY: Effect = Effect {
    name: "sensor.camera_latency",
    summary: "the camera reports positions a constant time late",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "p′(t) = p(t − T_c)",
    parameters: &[Parameter {
        name: "latency_s",
        symbol: "T_c",
        unit: "s",
        scale: 0.005,
        bounds: (-0.05, 0.3),
        plausible: (0.0, 0.06),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.005]],
    memory: 0,
    physics: Physics::CameraDelay(|p, _| p[0]),
    regressors: &[Regressor::Velocity],
    signals: Signal::CAMERA,
    excitation: "passes at constant speed, with camera and encoders",
    experiment: "circle",
    confused_with: &["drive.delay", "sensor.clock_skew", "estimator.lag"],
    reference: "Åström and Murray 2021, Feedback Systems (time delays)",
};
