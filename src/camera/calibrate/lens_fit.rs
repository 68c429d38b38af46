//! Fits of lens and board pose.

use super::least_squares::{Problem, minimize, solve};
use crate::camera::{
    document::{BoardFit, LensFit, MeasuredPoint},
    lens::{Distortion, Lens},
    model::CameraModel,
    pose::Pose,
};

/// Parameters of the lens: two focal lengths, two coordinates of the principal point, five of distortion.
const LENS: usize = 9;
/// Fewest images of a lens' calibration.
const FEWEST_IMAGES: usize = 3;
/// Number of standard deviations of a two-sided 95 % interval.
const Z95: f64 = 1.96;
/// Fewest points of a board pose.
const FEWEST_POINTS: usize = 4;

/// Error of a calibration. Each message is one sentence with the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CalibrateError {
    /// Too few images with the complete board.
    #[error(
        "{found} of {images} images show the board, needed are {FEWEST_IMAGES}; take 15 to 30 images \
         with the board tilted by up to 40 degrees in several directions (a checkerboard completely visible), and check --columns and --rows"
    )]
    FewImages {
        /// Images with the board.
        found: usize,
        /// All images.
        images: usize,
    },
    /// The images do not determine the lens.
    #[error(
        "the images do not determine the lens: the board has the same orientation in all of them; tilt it"
    )]
    Undetermined,
    /// Too few points of the table.
    #[error(
        "{found} known points of the table were found, needed are {FEWEST_POINTS}; uncover the tags, add light, or \
         mark the corners of the field with --corner"
    )]
    FewPoints {
        /// Points found.
        found: usize,
    },
    /// The points do not determine the pose.
    #[error(
        "the points of the table lie on one line or are numbered wrongly; give four corners in order"
    )]
    Degenerate,
}

/// Order of the radial distortion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RadialOrder {
    /// k1 and k2; k3 is 0, which a usual lens allows.
    Fourth,
    /// k1, k2 and k3, as OpenCV does by default; for very wide lenses.
    Sixth,
}

/// Calibrated lens.
#[derive(Debug, Clone, PartialEq)]
pub struct LensCalibration {
    /// Columns and rows of the images.
    pub size_px: [usize; 2],
    /// The lens.
    pub lens: Lens,
    /// Errors of the fit.
    pub fit: LensFit,
    /// Pose of the board in each image.
    pub poses: Vec<Pose>,
    /// Root mean square of the reprojection errors of each image (pixels).
    pub rms_px: Vec<f64>,
}

/// Corners of a flat board in one image.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// Places on the board (m).
    pub places_m: Vec<[f64; 2]>,
    /// Their pixels.
    pub pixels: Vec<[f64; 2]>,
}

impl LensCalibration {
    /// Return the pixels at which the calibration has the corners of image `image`.
    #[must_use]
    pub fn project(&self, image: usize, view: &BoardView) -> Vec<[f64; 2]> {
        view.places_m.iter().map(|place| pixel_of(&self.lens, &self.poses[image], *place)).collect()
    }
}

/// Pixel of a place on a board.
fn pixel_of(lens: &Lens, pose: &Pose, [x, y]: [f64; 2]) -> [f64; 2] {
    let [x, y, z] = pose.apply([x, y, 0.0]);
    lens.pixel([x / z, y / z])
}

/// Reprojection errors of a plane board in several images.
struct Views<'a> {
    images: &'a [BoardView],
    order: RadialOrder,
}

impl Problem for Views<'_> {
    fn blocks(&self) -> usize {
        self.images.len()
    }

    fn parameters_of(&self, block: usize) -> Vec<usize> {
        let lens = 0..self.lens_parameters();
        let start = self.lens_parameters() + 6 * block;
        lens.chain(start..start + 6).collect()
    }

    fn residuals(&self, parameters: &[f64], block: usize, out: &mut Vec<f64>) {
        let (lens, poses) = parameters.split_at(self.lens_parameters());
        let lens = lens_of(lens);
        let pose = pose_of(&poses[6 * block..6 * block + 6]);
        let view = &self.images[block];
        for (place, seen) in view.places_m.iter().zip(&view.pixels) {
            let pixel = pixel_of(&lens, &pose, *place);
            out.extend([pixel[0] - seen[0], pixel[1] - seen[1]]);
        }
    }

    fn step(&self, parameter: usize) -> f64 {
        if parameter < 4 { 1e-3 } else { 1e-6 }
    }
}

impl Views<'_> {
    fn lens_parameters(&self) -> usize {
        match self.order {
            RadialOrder::Fourth => LENS - 1,
            RadialOrder::Sixth => LENS,
        }
    }
}

fn lens_of(p: &[f64]) -> Lens {
    Lens {
        focal_px: [p[0], p[1]],
        principal_point_px: [p[2], p[3]],
        distortion: Distortion {
            k1: p[4],
            k2: p[5],
            p1: p[6],
            p2: p[7],
            k3: p.get(8).copied().unwrap_or(0.0),
        },
    }
}

fn pose_of(p: &[f64]) -> Pose {
    Pose::from_vectors([p[0], p[1], p[2]], [p[3], p[4], p[5]])
}

/// Fit a lens to the corners of a board in several images of `size_px`.
///
/// # Errors
/// When there are too few images, or they do not determine the lens.
pub fn calibrate_lens(
    size_px: [usize; 2],
    images: &[BoardView],
    order: RadialOrder,
) -> Result<LensCalibration, CalibrateError> {
    if images.len() < FEWEST_IMAGES {
        return Err(CalibrateError::FewImages { found: images.len(), images: images.len() });
    }
    let centre = size_px.map(|side| (side as f64 - 1.0) / 2.0);
    let homographies: Option<Vec<_>> =
        images.iter().map(|image| homography(&image.places_m, &image.pixels)).collect();
    let homographies = homographies.ok_or(CalibrateError::Undetermined)?;
    let focal = focal_length(&homographies, centre).ok_or(CalibrateError::Undetermined)?;
    let views = Views { images, order };
    let mut start = vec![focal, focal, centre[0], centre[1]];
    start.resize(views.lens_parameters(), 0.0);
    for h in &homographies {
        let pose = pose_of_homography(h, focal, centre);
        start.extend(pose.rotation_vector());
        start.extend(pose.translation);
    }
    let fit = minimize(&views, &start).ok_or(CalibrateError::Undetermined)?;
    let count = fit.parameters.len();
    let corners: usize = images.iter().map(|image| image.pixels.len()).sum();
    let residuals = 2 * corners;
    let variance = fit.cost / (residuals - count) as f64;
    let mut half_width = [0.0; LENS];
    for (at, own) in half_width.iter_mut().enumerate().take(views.lens_parameters()) {
        *own = Z95 * (variance * fit.inverse[at * count + at]).sqrt();
    }
    let (lens, poses) = fit.parameters.split_at(views.lens_parameters());
    let rms_px = (0..images.len()).map(|block| {
        let mut out = Vec::new();
        views.residuals(&fit.parameters, block, &mut out);
        (2.0 * out.iter().map(|own| own * own).sum::<f64>() / out.len() as f64).sqrt()
    });
    Ok(LensCalibration {
        size_px,
        lens: lens_of(lens),
        fit: LensFit {
            images: images.len(),
            corners,
            reprojection_rms_px: (fit.cost / corners as f64).sqrt(),
            ci95_half_width: half_width,
        },
        poses: poses.chunks_exact(6).map(pose_of).collect(),
        rms_px: rms_px.collect(),
    })
}

/// Homography from a plane to pixels by the normalized direct linear transform (Hartley and Zisserman, "Multiple View
/// Geometry", algorithm 4.2), with its last element set to 1.
pub(super) fn homography(plane: &[[f64; 2]], pixels: &[[f64; 2]]) -> Option<[[f64; 3]; 3]> {
    let normalize = |points: &[[f64; 2]]| {
        let count = points.len() as f64;
        let mean = [0, 1].map(|axis: usize| points.iter().map(|p| p[axis]).sum::<f64>() / count);
        let spread =
            points.iter().map(|p| (p[0] - mean[0]).hypot(p[1] - mean[1])).sum::<f64>() / count;
        (mean, spread.max(1e-12))
    };
    let ((m1, s1), (m2, s2)) = (normalize(plane), normalize(pixels));
    let (mut normal, mut right) = (vec![0.0; 64], vec![0.0; 8]);
    for (p, q) in plane.iter().zip(pixels) {
        let [x, y] = [0, 1].map(|axis| (p[axis] - m1[axis]) / s1);
        let [u, v] = [0, 1].map(|axis| (q[axis] - m2[axis]) / s2);
        for (row, target) in [
            ([x, y, 1.0, 0.0, 0.0, 0.0, -u * x, -u * y], u),
            ([0.0, 0.0, 0.0, x, y, 1.0, -v * x, -v * y], v),
        ] {
            for i in 0..8 {
                right[i] += row[i] * target;
                for j in 0..8 {
                    normal[i * 8 + j] += row[i] * row[j];
                }
            }
        }
    }
    let h = solve(&normal, &right)?;
    let inner = [[h[0], h[1], h[2]], [h[3], h[4], h[5]], [h[6], h[7], 1.0]];
    // pixel = T2^-1 inner T1 plane
    let from_plane = [[1.0 / s1, 0.0, -m1[0] / s1], [0.0, 1.0 / s1, -m1[1] / s1], [0.0, 0.0, 1.0]];
    let to_pixel = [[s2, 0.0, m2[0]], [0.0, s2, m2[1]], [0.0, 0.0, 1.0]];
    let full = crate::camera::pose::multiply(
        &crate::camera::pose::multiply(&to_pixel, &inner),
        &from_plane,
    );
    let last = full[2][2];
    (1e-12 < last.abs()).then(|| full.map(|row| row.map(|own| own / last)))
}

/// Focal length (pixels) from the orthogonality and equal length of the first two columns of each rotation, with the
/// principal point in the middle of the image.
fn focal_length(homographies: &[[[f64; 3]; 3]], centre: [f64; 2]) -> Option<f64> {
    let (mut a2, mut ab) = (0.0, 0.0);
    for h in homographies {
        let column =
            |k: usize| [h[0][k] - centre[0] * h[2][k], h[1][k] - centre[1] * h[2][k], h[2][k]];
        let (p, q) = (column(0), column(1));
        let scale = 1.0 / (p[0].hypot(p[1]) * q[0].hypot(q[1]));
        // (p0 q0 + p1 q1) / f^2 + p2 q2 = 0 and the same for p.p - q.q
        for (a, b) in [
            (p[0] * q[0] + p[1] * q[1], p[2] * q[2]),
            (p[0] * p[0] + p[1] * p[1] - q[0] * q[0] - q[1] * q[1], p[2] * p[2] - q[2] * q[2]),
        ] {
            a2 += a * a * scale * scale;
            ab += a * b * scale * scale;
        }
    }
    let inverse = -ab / a2;
    (inverse.is_finite() && 0.0 < inverse).then(|| 1.0 / inverse.sqrt())
}

/// Pose of a plane from its homography, without distortion.
fn pose_of_homography(h: &[[f64; 3]; 3], focal: f64, centre: [f64; 2]) -> Pose {
    let column = |k: usize| {
        [(h[0][k] - centre[0] * h[2][k]) / focal, (h[1][k] - centre[1] * h[2][k]) / focal, h[2][k]]
    };
    let length = |v: [f64; 3]| v.iter().map(|own| own * own).sum::<f64>().sqrt();
    let (first, second, third) = (column(0), column(1), column(2));
    let sign = if third[2] < 0.0 { -1.0 } else { 1.0 };
    let scale = sign * 2.0 / (length(first) + length(second));
    let x = {
        let l = sign * length(first);
        first.map(|v| v / l)
    };
    let along = (0..3).map(|k| x[k] * second[k]).sum::<f64>();
    let y = [0, 1, 2].map(|k| second[k] - along * x[k]);
    let y = {
        let l = sign * length(y);
        y.map(|v| v / l)
    };
    let z = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    Pose {
        rotation: [0, 1, 2].map(|row| [x[row], y[row], z[row]]),
        translation: third.map(|v| v * scale),
    }
}

/// Reprojection errors of known points of the table.
struct TablePoints<'a> {
    lens: &'a Lens,
    points: &'a [MeasuredPoint],
}

impl Problem for TablePoints<'_> {
    fn blocks(&self) -> usize {
        1
    }

    fn parameters_of(&self, _block: usize) -> Vec<usize> {
        (0..6).collect()
    }

    fn residuals(&self, parameters: &[f64], _block: usize, out: &mut Vec<f64>) {
        let pose = pose_of(parameters);
        for point in self.points {
            let [x, y, z] = pose.apply(point.place_m);
            let pixel = self.lens.pixel([x / z, y / z]);
            out.extend([pixel[0] - point.pixel_px[0], pixel[1] - point.pixel_px[1]]);
        }
    }

    fn step(&self, _parameter: usize) -> f64 {
        1e-6
    }
}

/// Fit the pose of the table to at least four known points, not all on one line. The interval is that of the worst
/// corner of a field of half sides `half_field` (m); with the fewest points it assumes an error of 0.3 pixels.
///
/// # Errors
/// When there are too few points or they do not determine the pose.
pub fn fit_board_pose(
    size_px: [usize; 2],
    lens: &Lens,
    points: &[MeasuredPoint],
    half_field: [f64; 2],
) -> Result<(CameraModel, BoardFit), CalibrateError> {
    if points.len() < FEWEST_POINTS {
        return Err(CalibrateError::FewPoints { found: points.len() });
    }
    let plane: Vec<[f64; 2]> = points.iter().map(|own| [own.place_m[0], own.place_m[1]]).collect();
    let rays: Option<Vec<[f64; 2]>> = points.iter().map(|own| lens.ray(own.pixel_px)).collect();
    let rays = rays.ok_or(CalibrateError::Degenerate)?;
    let h = homography(&plane, &rays).ok_or(CalibrateError::Degenerate)?;
    let pose = pose_of_homography(&h, 1.0, [0.0, 0.0]);
    let start: Vec<f64> = pose.rotation_vector().into_iter().chain(pose.translation).collect();
    let problem = TablePoints { lens, points };
    let fit = minimize(&problem, &start).ok_or(CalibrateError::Degenerate)?;
    let camera = CameraModel {
        width_px: size_px[0],
        height_px: size_px[1],
        lens: *lens,
        camera_from_board: pose_of(&fit.parameters),
    };
    let free = (2 * points.len() - 6) as f64;
    // Two degrees of freedom say little about the noise: it is at least that of a coarse detector.
    let variance = (fit.cost / free).max(0.3 * 0.3);
    let half_width = worst_position_error(&camera, &fit.parameters, &fit.inverse, half_field)
        .map(|error| Z95 * variance.sqrt() * error)
        .ok_or(CalibrateError::Degenerate)?;
    let report = BoardFit {
        points: points.len(),
        reprojection_rms_px: (fit.cost / points.len() as f64).sqrt(),
        ci95_half_width_m: half_width,
    };
    Ok((camera, report))
}

/// Largest standard deviation (m per pixel of noise) of a position at the corners and in the middle of the field.
fn worst_position_error(
    camera: &CameraModel,
    parameters: &[f64],
    inverse: &[f64],
    half_field: [f64; 2],
) -> Option<f64> {
    const STEP: f64 = 1e-6;
    let mut worst: f64 = 0.0;
    for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0]] {
        let place = [corner[0] * half_field[0], corner[1] * half_field[1], 0.0];
        let pixel = camera.project(place)?;
        let mut slopes = [[0.0; 6]; 2];
        for at in 0..6 {
            let mut moved = parameters.to_vec();
            moved[at] += STEP;
            let other = CameraModel { camera_from_board: pose_of(&moved), ..*camera };
            let found = other.locate(pixel, 0.0)?;
            (0..2).for_each(|axis| slopes[axis][at] = (found[axis] - place[axis]) / STEP);
        }
        for slope in slopes {
            let variance: f64 = (0..36).map(|k| slope[k / 6] * inverse[k] * slope[k % 6]).sum();
            worst = worst.max(variance.sqrt());
        }
    }
    Some(worst)
}
