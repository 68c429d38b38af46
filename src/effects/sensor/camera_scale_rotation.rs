//! Scale and rotation of the camera image.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.camera_scale_rotation`: a similarity about the centre of the board.
pub(crate) static CAMERA_SCALE_ROTATION: Effect = Effect {
    name: "sensor.camera_scale_rotation",
    summary: "the camera image is scaled and rotated about the centre of the board",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "p′ = s · R(θ) · p",
    parameters: &[
        Parameter {
            name: "scale",
            symbol: "s",
            unit: "1",
            scale: 0.02,
            bounds: (0.5, 2.0),
            plausible: (0.97, 1.03),
            per_session: false,
        },
        Parameter {
            name: "rotation_rad",
            symbol: "θ",
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
    signals: Signal::CAMERA,
    excitation: "moves over the whole workspace, with camera and encoders",
    experiment: "diagonal",
    confused_with: &["drive.gain", "gantry.squareness", "sensor.camera_distortion"],
    reference: "Hartley and Zisserman 2004, Multiple View Geometry in Computer Vision (similarities)",
};
