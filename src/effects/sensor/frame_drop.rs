//! Frames of the camera are missing or come twice.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Site};

/// `sensor.frame_drop`: the share of frames that are missing from the even sequence of capture times
/// or repeat the place of the frame before although the object moves.
pub(crate) static FRAME_DROP: Effect = Effect {
    name: "sensor.frame_drop",
    says: "some frames of the camera are missing or repeat the one before",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "share",
        unit: "1",
        scale: 0.01,
        bounds: (0.0, 1.0),
        plausible: (0.002, 0.1),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.01]],
    memory: 0,
    physics: Physics::Noise(Noise::FrameLoss),
    regressors: &[Regressor::Time],
    excitation: "any motion",
    experiment: "circle",
    confused_with: &["sensor.frame_jitter"],
};
