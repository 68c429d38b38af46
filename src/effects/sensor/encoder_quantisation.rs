//! The encoder rounds to a grid.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Site};

/// `sensor.encoder_quantisation`: q rounded to a multiple of the step; an error within half a step
/// either way, of standard deviation step / sqrt(12). It has no value to simulate: the step is read
/// off the recorded positions.
pub(crate) static ENCODER_QUANTISATION: Effect = Effect {
    name: "sensor.encoder_quantisation",
    says: "the encoder rounds positions to a grid",
    domain: Domain::Sensor,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "step_m",
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
    excitation: "slow moves",
    experiment: "creep",
    confused_with: &["drive.friction.presliding", "sensor.noise_model"],
};
