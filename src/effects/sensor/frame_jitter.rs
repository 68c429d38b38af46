//! Jitter of the frame time stamps.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.frame_jitter`: jitter of the frame time stamps.
///
/// A position that moves with v has the additional error v n.
pub(crate) static FRAME_JITTER: Effect = Effect {
    name: "sensor.frame_jitter",
    summary: "the time stamps of the camera jitter, so the position noise grows with speed",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "t′ = t + n, n ~ N(0, σ_t²); variance of the position error = σ0² + σ_t² · v²",
    parameters: &[Parameter {
        name: "jitter_s",
        symbol: "σ_t",
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
    signals: Signal::FRAMES,
    excitation: "rests and fast moves, with camera and encoders",
    experiment: "circle",
    confused_with: &[
        "sensor.noise_model",
        "sensor.frame_drop",
        "impact.wall_restitution_speed",
        "impact.wall_friction_spin",
    ],
    reference: "Souders, Flach, Hagwood and Yang 1990, The Effects of Timing Jitter in Sampling Systems, IEEE TIM 39(1), 80-85",
};
