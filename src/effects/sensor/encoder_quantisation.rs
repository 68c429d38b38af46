//! Quantization of the encoder.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.encoder_quantisation`: quantization of the encoder.
///
/// The error lies within half a step and has the standard deviation step / sqrt(12). It changes no
/// simulated value: the recorded positions show the step.
pub(crate) static ENCODER_QUANTISATION: Effect = Effect {
    name: "sensor.encoder_quantisation",
    summary: "the encoder rounds positions to a grid",
    domain: Domain::Sensor,
    site: Site::Motors,
    equation: "q′ = Δ · round(q / Δ), standard deviation Δ / √12",
    parameters: &[Parameter {
        name: "step_m",
        symbol: "Δ",
        unit: "m",
        scale: 1e-5,
        bounds: (0.0, 1e-2),
        plausible: (1e-5, 1e-4),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1e-5]],
    memory: 0,
    physics: Physics::Noise(Noise::EncoderStep),
    regressors: &[Regressor::Position],
    signals: Signal::ENCODER,
    excitation: "slow moves",
    experiment: "creep",
    confused_with: &["drive.friction.presliding", "sensor.noise_model"],
    reference: "Widrow and Kollár 2008, Quantization Noise",
};
