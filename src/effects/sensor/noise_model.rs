//! Measurement noise that differs from the stated one.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.noise_model`: ratio of the standard deviation at rest to the stated one.
pub(crate) static NOISE_MODEL: Effect = Effect {
    name: "sensor.noise_model",
    summary: "the measurement noise is larger or smaller than stated",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "σ = ρ · σ_stated",
    parameters: &[Parameter {
        name: "noise_ratio",
        symbol: "ρ",
        unit: "1",
        scale: 0.2,
        bounds: (0.0, 100.0),
        plausible: (0.3, 3.0),
        per_session: false,
    }],
    null: &[1.0],
    probes: &[&[1.2]],
    memory: 0,
    physics: Physics::Noise(Noise::Level),
    regressors: &[Regressor::Constant],
    signals: Signal::CAMERA,
    excitation: "rest and constant speed",
    experiment: "step_ladder",
    confused_with: &["sensor.frame_jitter", "sensor.encoder_quantisation"],
    reference: "Ljung 1999, System Identification: Theory for the User (noise models)",
};
