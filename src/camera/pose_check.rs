//! Check that neither the camera nor the table has moved since the calibration.
//!
//! The motion of the image is fitted by a shift, a rotation and a scale, with a robust loss:
//!
//! - to the centres of the AprilTags that the calibration has measured, if two of them are visible;
//! - otherwise to the edges of the field. A wrong board size or the height of the walls shifts opposite edges in
//!   opposite directions, which the scale takes up. So the scale is left out of the verdict. The edges are compared
//!   with the calibration, and more closely with those of the first frames, in which they are as much displaced by
//!   walls and shadows.
//!
//! The verdict is the largest displacement at the corners and in the middle of the field.

use super::{
    calibrate::{find_tags, solve},
    document::{CameraDocument, MeasuredPoint},
    edges::{COUNT, EdgePoint, find_edges},
    frame::Frame,
    model::CameraModel,
};
use crate::{board::BoardSize, stats::median};
use std::fmt;

/// Displacement on the field that is a warning (m), by tags: three times the error of a detection.
const MOVED_BY_TAGS_M: f64 = 0.001;
/// The same by the edges of the field since the first frames.
const MOVED_SINCE_START_M: f64 = 0.001;
/// The same by the edges of the field since the calibration: walls and their shadows displace them.
const MOVED_BY_EDGES_M: f64 = 0.003;
/// Frames whose edges later ones are compared with.
const REFERENCE_FRAMES: usize = 3;
/// Fewest visible tags.
const FEWEST_TAGS: usize = 2;
/// Fewest points of each edge.
const FEWEST_EDGE_POINTS: usize = 8;
/// Points of an edge beyond this distance from its median are left out at first (pixels).
const EDGE_SPREAD_PX: f64 = 4.0;
/// Scale of the Cauchy loss (pixels).
const LOSS_PX: f64 = 0.5;
/// Reweighted least-squares steps.
const ITERATIONS: usize = 20;
/// Unit of distances from the middle of the field in the fit (pixels).
const DISTANCE_UNIT_PX: f64 = 100.0;

/// Features that a displacement was measured with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PoseFeatures {
    /// So many AprilTags.
    Tags(usize),
    /// Edges of the field, compared with the calibration.
    Edges,
    /// Edges of the field, compared with those of the first frames.
    EdgesSinceStart,
}

/// Displacement of the table in the image since the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseShift {
    /// Largest displacement at the corners and in the middle of the field (pixels).
    pub shift_px: f64,
    /// The same on the field (m).
    pub shift_m: f64,
    /// Features that it was measured with.
    pub features: PoseFeatures,
}

impl PoseShift {
    /// Return whether detections are off by more than a check can mistake.
    #[must_use]
    pub fn is_moved(&self) -> bool {
        let limit = match self.features {
            PoseFeatures::Tags(_) => MOVED_BY_TAGS_M,
            PoseFeatures::Edges => MOVED_BY_EDGES_M,
            PoseFeatures::EdgesSinceStart => MOVED_SINCE_START_M,
        };
        limit < self.shift_m
    }
}

impl fmt::Display for PoseShift {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let since = match self.features {
            PoseFeatures::Tags(_) | PoseFeatures::Edges => "calibration",
            PoseFeatures::EdgesSinceStart => "first frames",
        };
        write!(
            f,
            "the camera or the table has moved since the {since}: positions are off by up to {:.1} mm ({:.1} px, ",
            1e3 * self.shift_m,
            self.shift_px
        )?;
        match self.features {
            PoseFeatures::Tags(count) => write!(f, "{count} tags")?,
            PoseFeatures::Edges | PoseFeatures::EdgesSinceStart => {
                f.write_str("edges of the field")?;
            }
        }
        f.write_str("); put it back, or fit the board pose anew with `klasktron calibrate-camera`")
    }
}

/// Comparison of an image with the calibrated pose.
///
/// ```
/// use klasktron::board::BoardSize;
/// use klasktron::camera::{CameraDocument, Frame, PoseCheck};
/// # let text = std::fs::read_to_string("tests/data/camera/camera.json").unwrap();
/// let document = CameraDocument::from_json(&text).unwrap();
/// let mut check = PoseCheck::new(&document, BoardSize::default()).unwrap();
/// let mut grey = Frame::default();
/// grey.set_grey([1280, 720], &[90; 1280 * 720]).unwrap();
/// assert_eq!(check.shift(&grey), None, "nothing to compare with");
/// ```
#[derive(Debug, Clone)]
pub struct PoseCheck {
    camera: CameraModel,
    tags: Vec<(u32, [f64; 2])>,
    half_field: [f64; 2],
    /// Offsets of the edges in the first frames, by place (pixels).
    reference: Vec<Vec<f64>>,
    /// Number of these frames.
    reference_frames: usize,
}

impl PoseCheck {
    /// Prepare the check of a calibration; `None` without a board pose.
    #[must_use]
    pub fn new(document: &CameraDocument, board: BoardSize) -> Option<Self> {
        let camera = document.camera().ok()?;
        let tag = |own: &MeasuredPoint| Some((own.tag?, own.pixel_px));
        Some(Self {
            camera,
            tags: document.board_points.iter().filter_map(tag).collect(),
            half_field: [board.short_side / 2.0, board.long_side / 2.0],
            reference: vec![Vec::new(); COUNT],
            reference_frames: 0,
        })
    }

    /// Measure the displacement; `None` where neither tags nor edges are visible.
    pub fn shift(&mut self, frame: &Frame) -> Option<PoseShift> {
        self.camera.check_size([frame.width_px(), frame.height_px()]).ok()?;
        self.shift_of_tags(frame).or_else(|| self.shift_of_edges(frame))
    }

    fn middle(&self) -> Option<[f64; 2]> {
        self.camera.project([0.0; 3])
    }

    fn shift_of_tags(&self, frame: &Frame) -> Option<PoseShift> {
        if self.tags.len() < FEWEST_TAGS {
            return None;
        }
        let found = find_tags(frame);
        let pairs = self.tags.iter().filter_map(|(id, pixel)| {
            let tag = found.iter().find(|own| own.id == *id)?;
            Some((*pixel, tag.centre))
        });
        let pairs: Vec<_> = pairs.collect();
        if pairs.len() < FEWEST_TAGS {
            return None;
        }
        let rows = pairs.iter().flat_map(|(pixel, now)| {
            [0, 1].map(|axis: usize| Row {
                pixel: *pixel,
                direction: if axis == 0 { [1.0, 0.0] } else { [0.0, 1.0] },
                shift: now[axis] - pixel[axis],
            })
        });
        let motion = Motion::fit(&rows.collect::<Vec<_>>(), self.middle()?)?;
        self.largest(&motion, PoseFeatures::Tags(pairs.len()))
    }

    fn shift_of_edges(&mut self, frame: &Frame) -> Option<PoseShift> {
        let points = find_edges(&frame.view(), &self.camera, self.half_field);
        let absolute = self.fit_edges(&points, PoseFeatures::Edges)?;
        if self.reference_frames < REFERENCE_FRAMES {
            self.reference_frames += 1;
            points.iter().for_each(|own| self.reference[own.place].push(own.offset));
            return Some(absolute);
        }
        let since_start = points.iter().filter_map(|own| {
            let offset = own.offset - median(&self.reference[own.place])?;
            Some(EdgePoint { offset, ..*own })
        });
        let since_start: Vec<EdgePoint> = since_start.collect();
        let since_start = self.fit_edges(&since_start, PoseFeatures::EdgesSinceStart);
        since_start.filter(|own| own.is_moved() || !absolute.is_moved()).or(Some(absolute))
    }

    /// Fit the motion to points of all four edges.
    fn fit_edges(&self, points: &[EdgePoint], features: PoseFeatures) -> Option<PoseShift> {
        let mut rows = Vec::with_capacity(points.len());
        for side in 0..4 {
            let own = points.iter().filter(|point| point.side == side);
            let agreeing = agreeing(own.copied().collect());
            if agreeing.len() < FEWEST_EDGE_POINTS {
                return None;
            }
            rows.extend(agreeing.iter().map(|own| Row {
                pixel: own.pixel,
                direction: own.normal,
                shift: own.offset,
            }));
        }
        let motion = Motion::fit(&rows, self.middle()?)?;
        self.largest(&Motion { scale: 0.0, ..motion }, features)
    }

    /// Largest displacement at the corners and in the middle of the field.
    fn largest(&self, motion: &Motion, features: PoseFeatures) -> Option<PoseShift> {
        let mut largest = PoseShift { shift_px: 0.0, shift_m: 0.0, features };
        for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0]] {
            let place = [0, 1].map(|axis| corner[axis] * self.half_field[axis]);
            let pixel = self.camera.project([place[0], place[1], 0.0])?;
            let shift = motion.at(pixel);
            let now = self.camera.locate([pixel[0] + shift[0], pixel[1] + shift[1]], 0.0)?;
            largest.shift_px = largest.shift_px.max(shift[0].hypot(shift[1]));
            let metres = (now[0] - place[0]).hypot(now[1] - place[1]);
            largest.shift_m = largest.shift_m.max(metres);
        }
        Some(largest)
    }
}

/// Points of one edge near their median offset.
fn agreeing(mut points: Vec<EdgePoint>) -> Vec<EdgePoint> {
    points.sort_by(|a, b| a.offset.total_cmp(&b.offset));
    let Some(median) = points.get(points.len() / 2).map(|own| own.offset) else { return points };
    points.retain(|own| (own.offset - median).abs() < EDGE_SPREAD_PX);
    points
}

/// One measured component of the displacement.
#[derive(Debug, Clone, Copy)]
struct Row {
    pixel: [f64; 2],
    /// Unit vector along which the displacement was measured.
    direction: [f64; 2],
    /// Displacement along it (pixels).
    shift: f64,
}

/// Motion of the image: shift (pixels), rotation (rad) and relative scale around `middle`.
#[derive(Debug, Clone, Copy)]
struct Motion {
    middle: [f64; 2],
    shift: [f64; 2],
    rotation: f64,
    scale: f64,
}

impl Motion {
    /// Fit by iteratively reweighted least squares with the Cauchy loss.
    fn fit(rows: &[Row], middle: [f64; 2]) -> Option<Self> {
        let slopes = |row: &Row| {
            let [x, y] = [0, 1].map(|axis| (row.pixel[axis] - middle[axis]) / DISTANCE_UNIT_PX);
            let [a, b] = row.direction;
            [a, b, b * x - a * y, a * x + b * y]
        };
        let mut p = [0.0; 4];
        for iteration in 0..ITERATIONS {
            let (mut normal, mut right) = ([0.0; 16], [0.0; 4]);
            for row in rows {
                let j = slopes(row);
                let residual = row.shift - (0..4).map(|k| j[k] * p[k]).sum::<f64>();
                // The first step has equal weights: its residuals are the displacement itself.
                let ratio = if iteration == 0 { 0.0 } else { residual / LOSS_PX };
                let weight = 1.0 / (1.0 + ratio * ratio);
                for i in 0..4 {
                    right[i] += weight * j[i] * row.shift;
                    (0..4).for_each(|k| normal[4 * i + k] += weight * j[i] * j[k]);
                }
            }
            p = solve(&normal, &right)?.try_into().ok()?;
        }
        Some(Self {
            middle,
            shift: [p[0], p[1]],
            rotation: p[2] / DISTANCE_UNIT_PX,
            scale: p[3] / DISTANCE_UNIT_PX,
        })
    }

    /// Displacement of a pixel.
    fn at(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| pixel[axis] - self.middle[axis]);
        [
            self.shift[0] - self.rotation * y + self.scale * x,
            self.shift[1] + self.rotation * x + self.scale * y,
        ]
    }
}
