//! Parallax of objects above the board.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.camera_parallax`: parallax of objects above the board.
///
/// H is the height of the object and H that of the camera above the board (similar triangles). A
/// camera off the centre adds a constant, which is confounded with the offset of the image.
pub(crate) static CAMERA_PARALLAX: Effect = Effect {
    name: "sensor.camera_parallax",
    summary: "objects above the board appear farther from the centre in proportion to their height",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "p′ = p / (1 − u · h), u = 1 / H",
    parameters: &[Parameter {
        name: "inverse_camera_height_per_m",
        symbol: "u",
        unit: "1/m",
        scale: 0.5,
        bounds: (0.0, 10.0),
        plausible: (0.8, 2.5),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1.0]],
    memory: 0,
    physics: Physics::Camera(|p, [x, y], height| {
        let scale = 1.0 / (1.0 - height * p[0]).max(0.1);
        [scale * x, scale * y]
    }),
    regressors: &[Regressor::Position],
    signals: Signal::CAMERA,
    excitation: "ball and striker over the whole workspace, with camera and encoders",
    experiment: "random_walk",
    confused_with: &["sensor.camera_scale_rotation", "sensor.camera_distortion", "drive.gain"],
    reference: "Hartley and Zisserman 2004, Multiple View Geometry in Computer Vision (pinhole camera)",
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shift_grows_with_the_height() {
        let Physics::Camera(camera) = CAMERA_PARALLAX.physics else { panic!("a camera") };
        // Under a camera at 0.8 m, 16 mm above the board: 1 / (1 - 0.02).
        let [x, y] = camera(&[1.25], [0.098, -0.147], 0.016);
        assert!((x - 0.1).abs() < 1e-12 && (y + 0.15).abs() < 1e-12);
        assert_eq!(camera(&[1.25], [0.1, 0.1], 0.0), [0.1, 0.1]);
        assert_eq!(camera(CAMERA_PARALLAX.null, [0.1, 0.1], 0.02), [0.1, 0.1]);
    }
}
