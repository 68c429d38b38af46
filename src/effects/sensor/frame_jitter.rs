//! Time stamps of the camera scatter.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Site};

/// `sensor.frame_jitter`: t + n with standard deviation s, so a place that moves with v is off by
/// v n: the scatter of the residual has the variance s0^2 + s^2 v^2.
pub(crate) static FRAME_JITTER: Effect = Effect {
    name: "sensor.frame_jitter",
    says: "the camera's time stamps scatter, so its places scatter more the faster things move",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "jitter_s",
        unit: "s",
        scale: 5e-4,
        bounds: (0.0, 0.05),
        plausible: (1e-4, 3e-3),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[5e-4]],
    memory: 0,
    physics: Physics::Noise(Noise::FrameTime),
    regressors: &[Regressor::Speed],
    excitation: "rests and fast moves, with camera and encoders",
    experiment: "circle",
    confused_with: &[
        "sensor.noise_model",
        "sensor.frame_drop",
        "impact.wall_restitution_speed",
        "impact.wall_friction_spin",
    ],
};
