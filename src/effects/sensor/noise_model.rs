//! A signal scatters more or less than the twin says.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Site};

/// `sensor.noise_model`: standard deviation of the scatter at rest over the stated one.
pub(crate) static NOISE_MODEL: Effect = Effect {
    name: "sensor.noise_model",
    says: "a signal scatters more or less than was stated",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "scatter_ratio",
        unit: "1",
        scale: 0.2,
        bounds: (0.0, 100.0),
        plausible: (0.3, 3.0),
        per_session: false,
    }],
    null: &[1.0],
    probes: &[&[1.2]],
    memory: 0,
    physics: Physics::Noise(Noise::Scatter),
    regressors: &[Regressor::Constant],
    excitation: "rest and constant speed",
    experiment: "step_ladder",
    confused_with: &["sensor.frame_jitter", "sensor.encoder_quantisation"],
};
