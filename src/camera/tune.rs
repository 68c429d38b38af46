//! Fit of the colour model from images with marked pieces.
//!
//! A mark is the pixel of a piece's middle. The pixels well within its outline are its colours; a ring around it is
//! left out; every other pixel of the field is background, but for the goal cups. So every visible piece of a marked image must be marked.

use super::{
    color::{ColorModel, Histogram, Kind},
    detector::{DetectorDocument, Pieces},
    frame::{Frame, rgb_of_yuv},
    model::CameraModel,
};
use crate::board::{BoardSize, CUP_DISTANCE, CUP_RADIUS};

/// Pixels up to this fraction of the radius are the piece's colours.
const CORE: f64 = 0.85;
/// Pixels up to this fraction of the radius belong neither to the piece nor to the background.
const HALO: f64 = 1.35;
/// Margin around the field that counts as background (m).
const MARGIN: f64 = 0.01;
/// Strip at the edge of the field that shows walls (m).
const WALL_SHADE: f64 = 0.004;
/// One of so many pixels of a wall counts.
const WALL_STRIDE: usize = 16;
/// Margin around a goal cup that counts as the cup (m).
const CUP_MARGIN: f64 = 0.002;
/// Fewest pixels of a class.
const FEWEST_PIXELS: u64 = 50;

/// Piece marked in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mark {
    /// Kind of piece.
    pub kind: Kind,
    /// Middle of the piece in the image (column and row, pixels).
    pub pixel: [f64; 2],
}

/// Error: marks from which no model can be fitted.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TuneError {
    /// Too few pixels of a class.
    #[error(
        "{class} has {pixels} pixels, needed are {FEWEST_PIXELS}; mark it in more images with --mark"
    )]
    FewPixels {
        /// Name of the class.
        class: &'static str,
        /// Pixels found.
        pixels: u64,
    },
    /// A mark outside of the field.
    #[error(
        "the {kind} marked at column {column}, row {row} lies outside of the field; check the mark and the board pose"
    )]
    Outside {
        /// Kind of piece.
        kind: &'static str,
        /// Column of the mark.
        column: i64,
        /// Row of the mark.
        row: i64,
    },
}

/// Return whether a place lies in a goal cup, whose darkness is that of the strikers.
fn is_cup([x, y]: [f64; 2]) -> bool {
    x.hypot(y.abs() - CUP_DISTANCE) < CUP_RADIUS + CUP_MARGIN
}

/// Collects the colours of marked images.
#[derive(Debug)]
pub struct ColorFit {
    camera: CameraModel,
    pieces: Pieces,
    board: BoardSize,
    background: Histogram,
    kinds: [Histogram; 3],
    field: [Vec<u8>; 3],
}

/// Marked piece in the image: two circles (pixels).
struct Blob {
    kind: Kind,
    centres: [[f64; 2]; 2],
    radius: f64,
}

impl Blob {
    /// Distance from the axis between the circles, in radii.
    fn distance(&self, pixel: [f64; 2]) -> f64 {
        let [a, b] = self.centres;
        let axis = [b[0] - a[0], b[1] - a[1]];
        let length2 = axis[0] * axis[0] + axis[1] * axis[1];
        let p = [pixel[0] - a[0], pixel[1] - a[1]];
        let along = if length2 < 1e-9 { 0.0 } else { (p[0] * axis[0] + p[1] * axis[1]) / length2 };
        let along = along.clamp(0.0, 1.0);
        (p[0] - along * axis[0]).hypot(p[1] - along * axis[1]) / self.radius
    }
}

impl ColorFit {
    /// Start a fit.
    #[must_use]
    pub fn new(camera: &CameraModel, pieces: &Pieces, board: BoardSize) -> Self {
        Self {
            camera: *camera,
            pieces: *pieces,
            board,
            background: Histogram::new(),
            kinds: [Histogram::new(), Histogram::new(), Histogram::new()],
            field: [Vec::new(), Vec::new(), Vec::new()],
        }
    }

    /// Add an image with all its pieces.
    ///
    /// # Errors
    /// When a mark lies outside of the field.
    pub fn add(&mut self, frame: &Frame, marks: &[Mark]) -> Result<(), TuneError> {
        let blobs: Result<Vec<Blob>, TuneError> =
            marks.iter().map(|mark| self.blob(mark)).collect();
        let blobs = blobs?;
        let half = [self.board.short_side / 2.0, self.board.long_side / 2.0];
        let view = frame.view();
        for row in 0..view.height_px {
            for column in 0..view.width_px {
                let pixel = [column as f64, row as f64];
                let Some(place) = self.camera.locate(pixel, 0.0) else { continue };
                if (0..2).any(|axis| half[axis] + MARGIN < place[axis].abs()) || is_cup(place) {
                    continue;
                }
                // Walls count little: their shaded sides are as dark as a striker, and pieces rarely touch them.
                let is_wall = (0..2).any(|axis| half[axis] - WALL_SHADE < place[axis].abs());
                if is_wall && !(column + 3 * row).is_multiple_of(WALL_STRIDE) {
                    continue;
                }
                let yuv = view.yuv(column, row);
                let near = blobs.iter().map(|blob| (blob.distance(pixel), blob.kind));
                let nearest = near.min_by(|a, b| a.0.total_cmp(&b.0));
                match nearest {
                    Some((distance, kind)) if distance < CORE => self.kinds[kind.index()].add(yuv),
                    Some((distance, _)) if distance < HALO => {}
                    _ => {
                        self.background.add(yuv);
                        if column % 4 == 0 && row % 4 == 0 {
                            let rgb = rgb_of_yuv(yuv);
                            (0..3).for_each(|k| self.field[k].push(rgb[k]));
                        }
                    }
                }
            }
        }
        Ok(())
    }

    fn blob(&self, mark: &Mark) -> Result<Blob, TuneError> {
        let outside = || TuneError::Outside {
            kind: mark.kind.name(),
            column: mark.pixel[0] as i64,
            row: mark.pixel[1] as i64,
        };
        let middle = self.pieces.middle(mark.kind);
        let place = self.camera.locate(mark.pixel, middle).ok_or_else(outside)?;
        let half = [self.board.short_side / 2.0, self.board.long_side / 2.0];
        if (0..2).any(|axis| half[axis] < place[axis].abs()) {
            return Err(outside());
        }
        let at = |height: f64| self.camera.project([place[0], place[1], height]);
        let [low, high] = self.pieces.heights(mark.kind);
        let scale =
            self.camera.pixels_per_metre([place[0], place[1], middle]).ok_or_else(outside)?;
        Ok(Blob {
            kind: mark.kind,
            centres: [at(low).ok_or_else(outside)?, at(high).ok_or_else(outside)?],
            radius: self.pieces.radius(mark.kind) * scale,
        })
    }

    /// Return the number of pixels of background, ball, strikers and biscuits.
    #[must_use]
    pub fn pixels(&self) -> [u64; 4] {
        let [ball, striker, biscuit] = self.kinds.each_ref().map(Histogram::total);
        [self.background.total(), ball, striker, biscuit]
    }

    /// Return the detector with the colours of all images.
    ///
    /// # Errors
    /// When a class has too few pixels.
    pub fn finish(mut self) -> Result<DetectorDocument, TuneError> {
        let classes = ["background", "ball", "striker", "biscuit"];
        for (class, pixels) in classes.into_iter().zip(self.pixels()) {
            let is_absent = class == "biscuit" && pixels == 0;
            if pixels < FEWEST_PIXELS && !is_absent {
                return Err(TuneError::FewPixels { class, pixels });
            }
        }
        let field_rgb = self.field.each_mut().map(|values| {
            values.sort_unstable();
            f64::from(values[values.len() / 2]).max(1.0)
        });
        let [ball, striker, biscuit] = self.kinds.each_ref().map(Histogram::counts);
        Ok(DetectorDocument {
            schema_version: 1,
            pieces: self.pieces,
            board_short_side_m: self.board.short_side,
            board_long_side_m: self.board.long_side,
            colors: ColorModel {
                field_rgb,
                background: self.background.counts(),
                ball,
                striker,
                biscuit,
            },
        })
    }
}
