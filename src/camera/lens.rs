//! Lens: pinhole with the distortion of Brown and Conrady, in the convention of OpenCV and ROS.
//!
//! A ray `(x, y, 1)` of the camera frame (x right, y down, z forward) reaches the pixel
//!
//! ```text
//! r2 = x^2 + y^2,  s = 1 + k1 r2 + k2 r2^2 + k3 r2^3
//! xd = x s + 2 p1 x y + p2 (r2 + 2 x^2)
//! yd = y s + p1 (r2 + 2 y^2) + 2 p2 x y
//! u = fx xd + cx,  v = fy yd + cy
//! ```
//!
//! Source: D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37 (1971); the order of the
//! coefficients is that of OpenCV's `calibrateCamera` (`plumb_bob` in ROS). The centre of a pixel has integer
//! coordinates. Fisheye and rational models are left out: a lens above a table of 0.5 m needs neither.

use serde::{Deserialize, Serialize};

/// Largest number of Newton steps to invert the distortion; a usual lens needs four.
const MAX_STEPS: usize = 30;
/// Largest error of an inverted ray (in units of the ray; 1e-12 is 1e-9 pixels).
const RAY_TOLERANCE: f64 = 1e-12;

/// Distortion coefficients (dimensionless). All zero is a pinhole.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Distortion {
    /// Radial, second order; negative is barrel distortion.
    pub k1: f64,
    /// Radial, fourth order.
    pub k2: f64,
    /// Tangential, along the image's vertical axis.
    pub p1: f64,
    /// Tangential, along the image's horizontal axis.
    pub p2: f64,
    /// Radial, sixth order; 0 unless the lens is very wide.
    #[serde(default)]
    pub k3: f64,
}

/// Lens of a camera: focal lengths, principal point, distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// Focal lengths along columns and rows (pixels).
    pub focal_px: [f64; 2],
    /// Principal point: column and row (pixels).
    pub principal_point_px: [f64; 2],
    /// Distortion coefficients.
    pub distortion: Distortion,
}

impl Distortion {
    /// Return the distorted ray.
    #[must_use]
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let r2 = x * x + y * y;
        let s = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        [
            x * s + 2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            y * s + self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        ]
    }

    /// Return the derivative of the distorted ray: rows are `xd` and `yd`, columns `x` and `y`.
    #[must_use]
    pub fn jacobian(&self, [x, y]: [f64; 2]) -> [[f64; 2]; 2] {
        let r2 = x * x + y * y;
        let s = 1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3));
        let ds = self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3); // d s / d r2
        let cross = 2.0 * x * y * ds + 2.0 * self.p1 * x + 2.0 * self.p2 * y;
        [
            [s + 2.0 * x * x * ds + 2.0 * self.p1 * y + 6.0 * self.p2 * x, cross],
            [cross, s + 2.0 * y * y * ds + 6.0 * self.p1 * y + 2.0 * self.p2 * x],
        ]
    }

    /// Return the ray whose distorted ray is `seen` (Newton's method), or `None` where the polynomial has no
    /// inverse, far outside of the image.
    #[must_use]
    pub fn undistort(&self, seen: [f64; 2]) -> Option<[f64; 2]> {
        let mut ray = seen;
        for _ in 0..MAX_STEPS {
            let found = self.distort(ray);
            let error = [seen[0] - found[0], seen[1] - found[1]];
            if error[0].abs().max(error[1].abs()) < RAY_TOLERANCE {
                return Some(ray);
            }
            let [[a, b], [c, d]] = self.jacobian(ray);
            let determinant = a * d - b * c;
            if determinant <= 0.0 || determinant.is_nan() {
                return None;
            }
            ray[0] += (d * error[0] - b * error[1]) / determinant;
            ray[1] += (a * error[1] - c * error[0]) / determinant;
        }
        None
    }
}

impl Lens {
    /// Return the pixel (column, row) of a ray.
    #[must_use]
    pub fn pixel(&self, ray: [f64; 2]) -> [f64; 2] {
        let distorted = self.distortion.distort(ray);
        [0, 1].map(|axis| self.focal_px[axis] * distorted[axis] + self.principal_point_px[axis])
    }

    /// Return the ray of a pixel; `None` where the distortion has no inverse.
    #[must_use]
    pub fn ray(&self, pixel: [f64; 2]) -> Option<[f64; 2]> {
        self.distortion.undistort(
            [0, 1].map(|axis| (pixel[axis] - self.principal_point_px[axis]) / self.focal_px[axis]),
        )
    }

    /// Return the derivative of the pixel by the ray.
    #[must_use]
    pub fn pixel_by_ray(&self, ray: [f64; 2]) -> [[f64; 2]; 2] {
        let [dx, dy] = self.distortion.jacobian(ray);
        [dx.map(|d| d * self.focal_px[0]), dy.map(|d| d * self.focal_px[1])]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(crate) const WIDE: Lens = Lens {
        focal_px: [1150.0, 1149.0],
        principal_point_px: [648.3, 352.7],
        distortion: Distortion { k1: -0.31, k2: 0.12, p1: 0.0011, p2: -0.0007, k3: -0.02 },
    };

    #[test]
    fn pixels_and_rays_are_inverse_over_the_image() {
        for column in (0..=1279).step_by(71) {
            for row in (0..=719).step_by(53) {
                let pixel = [f64::from(column), f64::from(row)];
                let back = WIDE.pixel(WIDE.ray(pixel).unwrap());
                assert!(
                    (back[0] - pixel[0]).hypot(back[1] - pixel[1]) < 1e-8,
                    "{pixel:?} {back:?}"
                );
            }
        }
    }

    #[test]
    fn the_jacobian_agrees_with_finite_differences() {
        const STEP: f64 = 1e-6;
        for ray in [[0.0, 0.0], [0.31, -0.22], [-0.5, 0.3], [0.02, 0.4]] {
            let exact = WIDE.pixel_by_ray(ray);
            for axis in 0..2 {
                let mut ends = [ray, ray];
                ends[0][axis] -= STEP;
                ends[1][axis] += STEP;
                let [low, high] = ends.map(|end| WIDE.pixel(end));
                for row in 0..2 {
                    let slope = (high[row] - low[row]) / (2.0 * STEP);
                    assert!((slope - exact[row][axis]).abs() < 1e-4, "{ray:?} {row} {axis}");
                }
            }
        }
    }

    /// Values of OpenCV 5.0: `cv2.projectPoints([(0.31, -0.22, 1)], 0, 0, K, (k1, k2, p1, p2, k3))`.
    #[test]
    fn pixels_are_those_of_opencv() {
        let found = WIDE.pixel([0.31, -0.22]);
        let expected = [989.2587374866287, 111.03984627532955];
        assert!((found[0] - expected[0]).hypot(found[1] - expected[1]) < 1e-6, "{found:?}");
    }

    #[test]
    fn far_outside_there_is_no_ray() {
        assert_eq!(WIDE.distortion.undistort([5.0, 5.0]), None);
    }
}
