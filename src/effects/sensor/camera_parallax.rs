//! What stands above the board seems farther from the middle.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `sensor.camera_parallax`: (1 + h / (H - h)) (x, y) for something h above the board under a camera
/// H above it (similar triangles), with u = 1/H. A camera that hangs off the middle adds a constant
/// that no one can tell from the offset of the picture.
pub(crate) static CAMERA_PARALLAX: Effect = Effect {
    name: "sensor.camera_parallax",
    says: "what stands above the board seems farther from the middle than it is, the higher the farther",
    domain: Domain::Sensor,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "inverse_camera_height_per_m",
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
    excitation: "ball and striker over the whole field, with camera and encoders",
    experiment: "random_walk",
    confused_with: &["sensor.camera_scale_rotation", "sensor.camera_distortion", "drive.gain"],
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
