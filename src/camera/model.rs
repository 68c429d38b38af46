//! Camera above the board: lens and pose, with the parallax of everything above the field.

use super::{lens::Lens, pose::Pose};

/// Camera: resolution, lens, and pose of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraModel {
    /// Columns of the image that the calibration is for.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// The lens.
    pub lens: Lens,
    /// Transform of points of the board frame (m) into the camera frame (m).
    pub camera_from_board: Pose,
}

impl CameraModel {
    /// Return the pixel (column, row) of a point of the board frame (m); `None` behind the camera.
    ///
    /// ```
    /// use klasktron::camera::{CameraModel, Distortion, Lens, Pose};
    /// let camera = CameraModel {
    ///     width_px: 1280,
    ///     height_px: 720,
    ///     lens: Lens {
    ///         focal_px: [1000.0, 1000.0],
    ///         principal_point_px: [640.0, 360.0],
    ///         distortion: Distortion::default(),
    ///     },
    ///     // Image columns run along y of the board, rows along x; 0.5 m above the field.
    ///     camera_from_board: Pose {
    ///         rotation: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
    ///         translation: [0.0, 0.0, 0.5],
    ///     },
    /// };
    /// assert_eq!(camera.project([0.1, 0.2, 0.0]), Some([1040.0, 560.0]));
    /// // The same pixel is another place of the board for an object 5 cm above it: parallax.
    /// let place = camera.locate([1040.0, 560.0], 0.05).unwrap();
    /// assert!((place[0] - 0.09).abs() < 1e-12 && (place[1] - 0.18).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn project(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        self.ray_to(point).map(|ray| self.lens.pixel(ray))
    }

    fn ray_to(&self, point: [f64; 3]) -> Option<[f64; 2]> {
        let [x, y, z] = self.camera_from_board.apply(point);
        (0.0 < z).then(|| [x / z, y / z])
    }

    /// Return the position (x and y of the board frame, m) of an object at `height` (m above the field) whose pixel
    /// is `pixel`; `None` where no ray of the camera reaches that height.
    #[must_use]
    pub fn locate(&self, pixel: [f64; 2], height: f64) -> Option<[f64; 2]> {
        let [x, y] = self.lens.ray(pixel)?;
        let board_from_camera = self.camera_from_board.inverse();
        let eye = board_from_camera.translation;
        let target = board_from_camera.apply([x, y, 1.0]);
        let direction = [0, 1, 2].map(|axis| target[axis] - eye[axis]);
        let distance = (height - eye[2]) / direction[2];
        (distance.is_finite() && 0.0 < distance)
            .then(|| [0, 1].map(|axis| eye[axis] + distance * direction[axis]))
    }

    /// Return the derivative of the pixel by the x and y of the board (pixels/m): rows are column and row of the
    /// pixel. `None` behind the camera.
    #[must_use]
    pub fn pixel_by_position(&self, point: [f64; 3]) -> Option<[[f64; 2]; 2]> {
        let [x, y, z] = self.camera_from_board.apply(point);
        if z <= 0.0 || z.is_nan() {
            return None;
        }
        let r = &self.camera_from_board.rotation;
        let ray = [x / z, y / z];
        let ray_by_position =
            [0, 1].map(|row| [0, 1].map(|axis| (r[row][axis] - ray[row] * r[2][axis]) / z));
        let pixel_by_ray = self.lens.pixel_by_ray(ray);
        Some([0, 1].map(|row| {
            [0, 1].map(|axis| (0..2).map(|k| pixel_by_ray[row][k] * ray_by_position[k][axis]).sum())
        }))
    }

    /// Return the height of the camera above the field (m).
    #[must_use]
    pub fn height(&self) -> f64 {
        self.camera_from_board.inverse().translation[2]
    }

    /// Return the pixels per metre at a point of the board frame (m): the root of the Jacobian's determinant.
    #[must_use]
    pub fn pixels_per_metre(&self, point: [f64; 3]) -> Option<f64> {
        let [[a, b], [c, d]] = self.pixel_by_position(point)?;
        Some((a * d - b * c).abs().sqrt())
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::camera::lens::Distortion;

    /// Camera 0.65 m above the field, tilted by about 1.5 degrees.
    pub(crate) fn tilted() -> CameraModel {
        let base = Pose {
            rotation: [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
            translation: [0.011, -0.006, 0.65],
        };
        CameraModel {
            width_px: 1280,
            height_px: 720,
            lens: Lens {
                focal_px: [1150.0, 1152.0],
                principal_point_px: [648.3, 352.7],
                distortion: Distortion { k1: -0.118, k2: 0.062, p1: 0.0007, p2: -0.0004, k3: 0.0 },
            },
            camera_from_board: base.nudged([0.017, -0.023, 0.009], [0.0; 3]),
        }
    }

    #[test]
    fn positions_and_pixels_are_inverse_at_every_height() {
        let camera = tilted();
        for x in [-0.16, -0.03, 0.16] {
            for y in [-0.21, 0.07, 0.21] {
                for z in [0.0, 0.007, 0.03] {
                    let pixel = camera.project([x, y, z]).unwrap();
                    let back = camera.locate(pixel, z).unwrap();
                    assert!((back[0] - x).hypot(back[1] - y) < 1e-10, "{x} {y} {z}: {back:?}");
                }
            }
        }
    }

    #[test]
    fn the_jacobian_agrees_with_finite_differences() {
        const STEP: f64 = 1e-6;
        let camera = tilted();
        for point in [[0.0, 0.0, 0.0], [0.15, -0.2, 0.02], [-0.1, 0.19, 0.007]] {
            let exact = camera.pixel_by_position(point).unwrap();
            for axis in 0..2 {
                let mut ends = [point, point];
                ends[0][axis] -= STEP;
                ends[1][axis] += STEP;
                let [low, high] = ends.map(|end| camera.project(end).unwrap());
                for row in 0..2 {
                    let slope = (high[row] - low[row]) / (2.0 * STEP);
                    assert!((slope - exact[row][axis]).abs() < 1e-3, "{point:?} {row} {axis}");
                }
            }
        }
    }

    #[test]
    fn ignoring_the_height_of_a_striker_is_an_error_of_millimetres() {
        let camera = tilted();
        let pixel = camera.project([0.12, 0.18, 0.025]).unwrap();
        let wrong = camera.locate(pixel, 0.0).unwrap();
        let error = (wrong[0] - 0.12).hypot(wrong[1] - 0.18);
        assert!((0.005..0.02).contains(&error), "{error}");
    }

    #[test]
    fn nothing_behind_the_camera_is_seen() {
        assert_eq!(tilted().project([0.0, 0.0, 1.0]), None);
        assert_eq!(tilted().locate([640.0, 360.0], 1.0), None);
    }
}
