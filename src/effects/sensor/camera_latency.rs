//! Age of what the camera reports.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `sensor.camera_latency`: y(t - Tc).
pub(crate) static CAMERA_LATENCY: Effect = Effect {
    name: "sensor.camera_latency",
    says: "the camera reports where things were a constant time ago",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "latency_s",
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
    excitation: "passes at constant speed, with camera and encoders",
    experiment: "circle",
    confused_with: &["drive.delay", "sensor.clock_skew", "estimator.lag"],
};
