//! Radial distortion of the lens.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `sensor.camera_distortion`: radial distortion about the centre of the board, above which the
/// camera is mounted.
pub(crate) static CAMERA_DISTORTION: Effect = Effect {
    name: "sensor.camera_distortion",
    summary: "the lens distorts the image: positions far from the centre shift outwards or inwards",
    domain: Domain::Sensor,
    site: Site::Whole,
    equation: "p′ = p · (1 + k1 · r² + k2 · r⁴), r = |p|",
    parameters: &[
        Parameter {
            name: "k1_per_m2",
            symbol: "k1",
            unit: "1/m^2",
            scale: 0.1,
            bounds: (-10.0, 10.0),
            plausible: (-1.5, 1.5),
            per_session: false,
        },
        Parameter {
            name: "k2_per_m4",
            symbol: "k2",
            unit: "1/m^4",
            scale: 2.0,
            bounds: (-200.0, 200.0),
            plausible: (-20.0, 20.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.1, 0.0]],
    memory: 0,
    physics: Physics::Camera(|p, [x, y], _| {
        let square = x * x + y * y;
        let scale = 1.0 + (p[0] + p[1] * square) * square;
        [scale * x, scale * y]
    }),
    regressors: &[Regressor::Position],
    signals: Signal::CAMERA,
    excitation: "moves over the whole workspace, with camera and encoders",
    experiment: "random_walk",
    confused_with: &[
        "sensor.camera_scale_rotation",
        "sensor.camera_parallax",
        "drive.gain",
        "ball.board_curvature",
    ],
    reference: "Brown 1966, Decentering Distortion of Lenses, Photogrammetric Engineering 32(3), 444-462",
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shift_is_cubic_in_the_radius() {
        let Physics::Camera(camera) = CAMERA_DISTORTION.physics else { panic!("a camera") };
        // r = 0.2, r^2 = 0.04: 1 + 0.5 * 0.04 + 10 * 0.0016 = 1.036.
        let [x, y] = camera(&[0.5, 10.0], [0.12, -0.16], 0.0);
        assert!((x - 0.124_32).abs() < 1e-12 && (y + 0.165_76).abs() < 1e-12);
        assert_eq!(camera(CAMERA_DISTORTION.null, [0.12, -0.16], 0.0), [0.12, -0.16]);
    }
}
