//! Missing or repeated frames of the camera.

use crate::effects::{Domain, Effect, Noise, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.frame_drop`: fraction of frames that are missing from the even sequence of capture
/// times, or that repeat the previous position although the object moves.
pub(crate) static FRAME_DROP: Effect = Effect {
    name: "sensor.frame_drop",
    summary: "some frames of the camera are missing or repeat the previous one",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "P(frame missing or repeated) = f",
    parameters: &[Parameter {
        name: "fraction",
        symbol: "f",
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
    signals: Signal::FRAMES,
    excitation: "any motion",
    experiment: "circle",
    confused_with: &["sensor.frame_jitter"],
    reference: "Sinopoli et al. 2004, Kalman Filtering with Intermittent Observations, IEEE TAC 49(9), 1453-1464",
};
