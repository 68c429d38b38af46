//! The camera's picture is larger or turned.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `sensor.camera_scale_rotation`: a similarity about the board's centre.
pub(crate) static CAMERA_SCALE_ROTATION: Effect = Effect {
    name: "sensor.camera_scale_rotation",
    says: "the camera's picture is scaled and turned about the board's centre",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "scale",
            unit: "1",
            scale: 0.02,
            bounds: (0.5, 2.0),
            plausible: (0.97, 1.03),
            per_session: false,
        },
        Parameter {
            name: "rotation_rad",
            unit: "rad",
            scale: 0.02,
            bounds: (-0.8, 0.8),
            plausible: (-0.035, 0.035),
            per_session: false,
        },
    ],
    null: &[1.0, 0.0],
    probes: &[&[1.005, 0.005]],
    memory: 0,
    physics: Physics::Camera(|p, [x, y], _| {
        let (sin, cos) = p[1].sin_cos();
        [p[0] * (cos * x - sin * y), p[0] * (sin * x + cos * y)]
    }),
    regressors: &[Regressor::Position],
    excitation: "moves over the whole field, with camera and encoders",
    experiment: "diagonal",
    confused_with: &["drive.gain", "gantry.squareness", "sensor.camera_distortion"],
};
