//! Detector: positions of ball, strikers and biscuits in one frame, with covariances.
//!
//! 1. The colour of the empty field, sampled at fixed places, gives exposure and light; the colour tables follow.
//! 2. Candidates come from the coarse grid of the whole field, or of a region of interest around a predicted
//!    position (`scan`).
//! 3. Each candidate is fitted with the outline of its piece (`outline`), which gives a sub-pixel position with its
//!    covariance or refuses the candidate.
//!
//! Everything is allocated in [`Detector::new`]; a frame allocates nothing.

mod outline;
mod scan;

pub use outline::Pieces;

use super::{
    color::{ColorError, ColorModel, ColorTable, Kind},
    document::CameraDocumentError,
    frame::{Frame, View, rgb_of_yuv},
    model::CameraModel,
};
use crate::{
    board::{BoardSize, CUP_DISTANCE, CUP_RADIUS},
    units::Nanos,
};
use outline::{Fit, Fitter, Outline, Patch};
use scan::{CELL_PX, Candidates, Cells, Scan, centre};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of biscuits of the game.
pub const BISCUITS: usize = 3;
/// Samples of the field along its short and its long side.
const FIELD_SAMPLES: [usize; 2] = [11, 16];
/// Number of samples of the field.
const FIELD_COUNT: usize = FIELD_SAMPLES[0] * FIELD_SAMPLES[1];
/// Median brightness (0 to 255) below which an image is too dark: noise hides the colours.
const DARK_LEVEL: f64 = 16.0;
/// Median brightness above which an image is overexposed.
const BRIGHT_LEVEL: f64 = 235.0;
/// Fraction of field samples with a saturated channel above which an image is overexposed.
const SATURATED_FRACTION: f64 = 0.2;
/// Value of a saturated channel.
const SATURATED_LEVEL: u8 = 252;
/// Margin around the field within which pieces are searched (m).
const FIELD_MARGIN: f64 = 0.004;
/// Margin around a goal cup that counts as the cup (m).
const CUP_MARGIN: f64 = 0.002;
/// A region of interest reaches this many standard deviations of the prediction.
const REGION_SIGMAS: f64 = 4.0;
/// Smallest half side of a region of interest in radii of the piece: the surround of the filter must fit.
const REGION_RADII: f64 = 3.2;
/// Frames between two searches of the whole field while every piece is tracked. They find biscuits that were moved
/// and a second ball.
const FULL_SEARCH_PERIOD: u32 = 12;

/// Contents of `detector.json`: shapes and colours of the pieces.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DetectorDocument {
    /// Version of the format; 1.
    pub schema_version: u32,
    /// Shapes of the pieces.
    #[serde(default)]
    pub pieces: Pieces,
    /// Short side of the field (m).
    pub board_short_side_m: f64,
    /// Long side of the field (m).
    pub board_long_side_m: f64,
    /// Colours.
    pub colors: ColorModel,
}

/// Error: a detector that cannot be built.
#[derive(Debug, thiserror::Error)]
pub enum DetectorError {
    /// The text is not JSON of this form.
    #[error("invalid detector file: {0}; write one with `klasktron tune-detector`")]
    Syntax(#[from] serde_json::Error),
    /// A newer version.
    #[error("schema_version is {found}; this program reads version 1")]
    Version {
        /// Version found.
        found: u32,
    },
    /// Error of the colours.
    #[error(transparent)]
    Color(#[from] ColorError),
    /// Error of the board size.
    #[error(transparent)]
    Board(#[from] crate::board::BoardSizeError),
    /// A size of a piece outside its range.
    #[error("pieces.{name} is {value} m; it must lie in [{low}, {high}] m")]
    Piece {
        /// Field.
        name: &'static str,
        /// Value found (m).
        value: f64,
        /// Lower limit (m).
        low: f64,
        /// Upper limit (m).
        high: f64,
    },
    /// The camera does not see the field.
    #[error(
        "no part of the {short_side_m} m x {long_side_m} m field lies in the image; calibrate the board pose anew \
         with `klasktron calibrate-camera --board`"
    )]
    NoField {
        /// Short side (m).
        short_side_m: f64,
        /// Long side (m).
        long_side_m: f64,
    },
    /// Images of another size than the calibration.
    #[error(transparent)]
    Calibration(#[from] CameraDocumentError),
}

impl DetectorDocument {
    /// Parse and check a file.
    ///
    /// # Errors
    /// When the text is not JSON of this form or has a value outside its range.
    pub fn from_json(text: &str) -> Result<Self, DetectorError> {
        let document: Self = serde_json::from_str(text)?;
        if document.schema_version != 1 {
            return Err(DetectorError::Version { found: document.schema_version });
        }
        document.pieces.check()?;
        Ok(document)
    }

    /// Return the size of the field.
    ///
    /// # Errors
    /// When a side is outside its range.
    pub fn board(&self) -> Result<BoardSize, DetectorError> {
        Ok(BoardSize::new(self.board_short_side_m, self.board_long_side_m)?)
    }
}

impl Pieces {
    /// Check the ranges of the sizes.
    ///
    /// # Errors
    /// The first size outside its range.
    pub fn check(&self) -> Result<(), DetectorError> {
        for (name, value, [low, high]) in [
            ("ball_radius_m", self.ball_radius_m, [0.002, 0.05]),
            ("striker_radius_m", self.striker_radius_m, [0.002, 0.05]),
            ("striker_height_m", self.striker_height_m, [0.0, 0.1]),
            ("biscuit_radius_m", self.biscuit_radius_m, [0.002, 0.05]),
            ("biscuit_height_m", self.biscuit_height_m, [0.0, 0.1]),
        ] {
            if !(low <= value && value <= high) {
                return Err(DetectorError::Piece { name, value, low, high });
            }
        }
        Ok(())
    }
}

/// Position of one piece in the board frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Detection {
    /// Position (m).
    pub position: [f64; 2],
    /// Covariance of the position (m^2).
    pub covariance: [[f64; 2]; 2],
    /// Centre in the image (column and row, pixels).
    pub pixel: [f64; 2],
    /// Fraction of the outline that the image supports, 0.45 to 1.
    pub support: f64,
}

impl From<Fit> for Detection {
    fn from(fit: Fit) -> Self {
        Self {
            position: fit.position,
            covariance: fit.covariance,
            pixel: fit.pixel,
            support: fit.support,
        }
    }
}

/// Exposure of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Exposure {
    /// Colours can be distinguished.
    Good,
    /// Too dark; nothing was searched.
    Dark,
    /// Overexposed; nothing was searched.
    Overexposed,
}

/// Light of a frame, from the samples of the field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Light {
    /// Verdict.
    pub exposure: Exposure,
    /// Median brightness Y of the field (0 to 255).
    pub median_level: f64,
    /// Fraction of the samples with a saturated channel.
    pub saturated_fraction: f64,
}

impl fmt::Display for Light {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (level, saturated) = (self.median_level, 100.0 * self.saturated_fraction);
        match self.exposure {
            Exposure::Good => {
                write!(f, "the exposure is good (median brightness {level:.0} of 255)")
            }
            Exposure::Dark => write!(
                f,
                "the image is too dark: median brightness {level:.0} of 255, needed are {DARK_LEVEL:.0}; add light, \
                 or lengthen the exposure"
            ),
            Exposure::Overexposed => write!(
                f,
                "the image is overexposed: {saturated:.0} % of the field is saturated, median brightness {level:.0} of \
                 255; shorten the exposure, or lower the gain"
            ),
        }
    }
}

/// Detections of one frame; a piece that is not found is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Detections {
    /// Capture time of the frame.
    pub capture_time: Nanos,
    /// The ball.
    pub ball: Option<Detection>,
    /// The left striker (y < 0).
    pub left: Option<Detection>,
    /// The right striker (y > 0).
    pub right: Option<Detection>,
    /// The biscuits, in order of x; found ones first.
    pub biscuits: [Option<Detection>; BISCUITS],
    /// Light.
    pub light: Light,
    /// Number of balls in the last search of the whole field; 2 or more is a warning.
    pub balls: usize,
    /// True if the whole field was searched in this frame.
    pub searched_everything: bool,
}

/// Predicted position of a piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prediction {
    /// Position (m).
    pub position: [f64; 2],
    /// Standard deviation of each coordinate (m).
    pub sigma: f64,
}

/// Predictions of a filter; a piece without one is searched in the whole field.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Predictions {
    /// The ball.
    pub ball: Option<Prediction>,
    /// The left striker.
    pub left: Option<Prediction>,
    /// The right striker.
    pub right: Option<Prediction>,
}

/// Detector for the images of one camera.
#[derive(Debug, Clone)]
pub struct Detector {
    camera: CameraModel,
    pieces: Pieces,
    half_field: [f64; 2],
    table: ColorTable,
    scan: Scan,
    patch: Patch,
    radius_px: [f64; 3],
    field_pixels: Vec<[usize; 2]>,
    since_full_search: u32,
    biscuits: [Option<Detection>; BISCUITS],
    balls: usize,
}

impl Detector {
    /// Build a detector for a camera; allocates everything that frames need.
    ///
    /// # Errors
    /// When the colours or the sizes are invalid, or the camera does not see the field.
    pub fn new(camera: &CameraModel, document: &DetectorDocument) -> Result<Self, DetectorError> {
        document.pieces.check()?;
        let board = document.board()?;
        let half_field = [board.short_side / 2.0, board.long_side / 2.0];
        let no_field = || DetectorError::NoField {
            short_side_m: board.short_side,
            long_side_m: board.long_side,
        };
        let size = [camera.width_px, camera.height_px];
        let on_field = cells_on_field(camera, &document.pieces, half_field);
        let field_pixels = field_pixels(camera, half_field);
        if field_pixels.len() < FIELD_COUNT / 4 {
            return Err(no_field());
        }
        let centre = camera.pixels_per_metre([0.0, 0.0, 0.0]).ok_or_else(no_field)?;
        let radius_px = Kind::ALL.map(|kind| document.pieces.radius(kind) * centre);
        Ok(Self {
            camera: *camera,
            pieces: document.pieces,
            half_field,
            table: ColorTable::new(&document.colors)?,
            scan: Scan::new(size, on_field, |pixel| is_cup(camera, pixel), radius_px),
            patch: Patch::new(
                largest_reach(camera, &document.pieces, half_field).ok_or_else(no_field)?,
            ),
            radius_px,
            field_pixels,
            since_full_search: 0,
            biscuits: [None; BISCUITS],
            balls: 0,
        })
    }

    /// Return the camera.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        &self.camera
    }

    /// Return the shapes of the pieces.
    #[must_use]
    pub fn pieces(&self) -> &Pieces {
        &self.pieces
    }

    /// Return the kind of piece of a colour (Y, U, V) under the light of the last frame; `None` for background.
    #[must_use]
    pub fn kind_of(&self, yuv: [u8; 3]) -> Option<Kind> {
        let label = usize::from(self.table.label(yuv));
        label.checked_sub(1).map(|kind| Kind::ALL[kind])
    }

    /// Return whether a pixel shows the field, without the goal cups, where pieces are searched.
    #[must_use]
    pub fn searches(&self, pixel: [f64; 2]) -> bool {
        let place = self.camera.locate(pixel, 0.0);
        let is_inside = place.is_some_and(|own| is_on_field(own, self.half_field));
        is_inside && !is_cup(&self.camera, pixel)
    }

    /// Detect the pieces in a frame. Allocates nothing.
    ///
    /// # Errors
    /// When the frame has another size than the calibration.
    pub fn detect(
        &mut self,
        frame: &Frame,
        predictions: &Predictions,
    ) -> Result<Detections, DetectorError> {
        self.camera.check_size([frame.width_px(), frame.height_px()])?;
        let view = frame.view();
        let light = self.measure_light(&view);
        let mut found = Detections {
            capture_time: frame.capture_time,
            ball: None,
            left: None,
            right: None,
            biscuits: [None; BISCUITS],
            light,
            balls: self.balls,
            searched_everything: false,
        };
        if light.exposure != Exposure::Good {
            self.since_full_search = FULL_SEARCH_PERIOD;
            return Ok(found);
        }
        self.search_regions(&view, predictions, &mut found);
        let lost = found.ball.is_none() || found.left.is_none() || found.right.is_none();
        if lost || FULL_SEARCH_PERIOD <= self.since_full_search {
            self.search_everything(&view, &mut found);
            self.since_full_search = 0;
        } else {
            self.since_full_search += 1;
            self.follow_biscuits(&view, &mut found);
        }
        Ok(found)
    }

    /// Sample the field, let the colour tables follow the light and return it.
    fn measure_light(&mut self, view: &View<'_>) -> Light {
        let mut levels = [[0_u16; 256]; 4];
        let mut saturated = 0_u32;
        for &[column, row] in &self.field_pixels {
            let yuv = view.yuv(column, row);
            let rgb = rgb_of_yuv(yuv);
            levels[3][usize::from(yuv[0])] += 1;
            for (level, value) in levels.iter_mut().zip(rgb) {
                level[usize::from(value)] += 1;
            }
            saturated += u32::from(rgb.iter().any(|value| SATURATED_LEVEL <= *value));
        }
        let count = self.field_pixels.len();
        let [red, green, blue, median_level] = levels.map(|levels| median(&levels, count));
        let saturated_fraction = f64::from(saturated) / count as f64;
        let exposure = if median_level < DARK_LEVEL {
            Exposure::Dark
        } else if BRIGHT_LEVEL < median_level || SATURATED_FRACTION < saturated_fraction {
            Exposure::Overexposed
        } else {
            Exposure::Good
        };
        if exposure == Exposure::Good {
            self.table.adapt([red, green, blue]);
        }
        Light { exposure, median_level, saturated_fraction }
    }

    fn search_regions(
        &mut self,
        view: &View<'_>,
        predictions: &Predictions,
        found: &mut Detections,
    ) {
        if let Some(prediction) = &predictions.ball {
            found.ball = self.search_region(view, Kind::Ball, prediction);
        }
        if let Some(prediction) = &predictions.left {
            found.left = self.search_region(view, Kind::Striker, prediction).filter(is_left);
        }
        if let Some(prediction) = &predictions.right {
            found.right = self.search_region(view, Kind::Striker, prediction).filter(is_right);
        }
    }

    fn search_region(
        &mut self,
        view: &View<'_>,
        kind: Kind,
        prediction: &Prediction,
    ) -> Option<Detection> {
        let [x, y] = prediction.position;
        let point = [x, y, self.pieces.middle(kind)];
        let pixel = self.camera.project(point)?;
        let scale = self.camera.pixels_per_metre(point)?;
        let half =
            REGION_RADII * self.radius_px[kind.index()] + REGION_SIGMAS * prediction.sigma * scale;
        let cells = self.scan.around(pixel, half);
        let candidates = self.scan.run(view, &self.table, cells);
        self.first_fit(view, kind, &candidates[kind.index()])
    }

    fn first_fit(
        &mut self,
        view: &View<'_>,
        kind: Kind,
        candidates: &Candidates,
    ) -> Option<Detection> {
        let fitter =
            Fitter { camera: &self.camera, pieces: &self.pieces, view, table: &self.table };
        let mut fits = candidates
            .as_slice()
            .iter()
            .filter_map(|own| fitter.fit(&mut self.patch, kind, own.pixel));
        let half = self.half_field;
        fits.find(|fit| is_on_field(fit.position, half)).map(Detection::from)
    }

    fn search_everything(&mut self, view: &View<'_>, found: &mut Detections) {
        found.searched_everything = true;
        let cells: Cells = self.scan.everything();
        let candidates = self.scan.run(view, &self.table, cells);
        let fitter =
            Fitter { camera: &self.camera, pieces: &self.pieces, view, table: &self.table };
        let half = self.half_field;
        let patch = &mut self.patch;
        let mut balls = 0;
        let tracked = found.ball;
        for candidate in candidates[Kind::Ball.index()].as_slice() {
            let Some(fit) = fitter.fit(patch, Kind::Ball, candidate.pixel) else { continue };
            if is_on_field(fit.position, half) {
                balls += 1;
                found.ball = found.ball.or(Some(fit.into()));
            }
        }
        found.ball = tracked.or(found.ball);
        for candidate in candidates[Kind::Striker.index()].as_slice() {
            if found.left.is_some() && found.right.is_some() {
                break;
            }
            let Some(fit) = fitter.fit(patch, Kind::Striker, candidate.pixel) else { continue };
            let own = Detection::from(fit);
            let seat = if is_left(&own) { &mut found.left } else { &mut found.right };
            if seat.is_none() && is_on_field(own.position, half) {
                *seat = Some(own);
            }
        }
        let mut count = 0;
        for candidate in candidates[Kind::Biscuit.index()].as_slice() {
            if count == BISCUITS {
                break;
            }
            let Some(fit) = fitter.fit(patch, Kind::Biscuit, candidate.pixel) else { continue };
            if is_on_field(fit.position, half) {
                found.biscuits[count] = Some(fit.into());
                count += 1;
            }
        }
        sort_biscuits(&mut found.biscuits);
        self.biscuits = found.biscuits;
        self.balls = balls;
        found.balls = balls;
    }

    /// Fit the biscuits near their last places.
    fn follow_biscuits(&mut self, view: &View<'_>, found: &mut Detections) {
        let fitter =
            Fitter { camera: &self.camera, pieces: &self.pieces, view, table: &self.table };
        for (known, found) in self.biscuits.iter_mut().zip(&mut found.biscuits) {
            let Some(last) = known else { continue };
            *found = fitter.fit(&mut self.patch, Kind::Biscuit, last.pixel).map(Detection::from);
            match found {
                Some(own) => *last = *own,
                // A hidden or moved biscuit: search the whole field in the next frame.
                None => self.since_full_search = FULL_SEARCH_PERIOD,
            }
        }
    }
}

/// Return whether a pixel shows a goal cup.
fn is_cup(camera: &CameraModel, pixel: [f64; 2]) -> bool {
    let place = camera.locate(pixel, 0.0);
    place.is_some_and(|[x, y]| x.hypot(y.abs() - CUP_DISTANCE) < CUP_RADIUS + CUP_MARGIN)
}

fn is_left(detection: &Detection) -> bool {
    detection.position[1] < 0.0
}

fn is_right(detection: &Detection) -> bool {
    !is_left(detection)
}

fn is_on_field(position: [f64; 2], half: [f64; 2]) -> bool {
    (0..2).all(|axis| position[axis].abs() <= half[axis])
}

fn sort_biscuits(biscuits: &mut [Option<Detection>; BISCUITS]) {
    let key = |own: &Option<Detection>| own.map_or(f64::INFINITY, |own| own.position[0]);
    biscuits.sort_unstable_by(|a, b| key(a).total_cmp(&key(b)));
}

/// Median of a histogram of `count` values.
fn median(levels: &[u16; 256], count: usize) -> f64 {
    let mut sum = 0;
    for (level, number) in levels.iter().enumerate() {
        sum += usize::from(*number);
        if count <= 2 * sum {
            return level as f64;
        }
    }
    0.0
}

/// Pixels of the field samples that lie in the image.
fn field_pixels(camera: &CameraModel, half: [f64; 2]) -> Vec<[usize; 2]> {
    let place = |index: usize, count: usize, half: f64| {
        half * (2.0 * (index as f64 + 0.5) / count as f64 - 1.0)
    };
    let [across, along] = FIELD_SAMPLES;
    let all = (0..across).flat_map(|i| (0..along).map(move |j| (i, j)));
    let pixels = all.filter_map(|(i, j)| {
        let pixel = camera.project([place(i, across, half[0]), place(j, along, half[1]), 0.0])?;
        let inside = 0.0 <= pixel[0]
            && 0.0 <= pixel[1]
            && pixel[0] + 1.0 < camera.width_px as f64
            && pixel[1] + 1.0 < camera.height_px as f64;
        inside.then(|| pixel.map(|at| at as usize))
    });
    pixels.collect()
}

/// First and end cell of each cell row that lies on the field, for pieces of any height.
fn cells_on_field(camera: &CameraModel, pieces: &Pieces, half: [f64; 2]) -> Vec<[usize; 2]> {
    let heights = Kind::ALL.map(|kind| pieces.middle(kind));
    let low = heights.iter().copied().fold(f64::INFINITY, f64::min);
    let high = heights.iter().copied().fold(0.0, f64::max);
    let is_field = |column: usize, row: usize| {
        let pixel = centre([column, row]);
        [low, high].iter().any(|&height| {
            camera.locate(pixel, height).is_some_and(|place| {
                (0..2).all(|axis| place[axis].abs() <= half[axis] + FIELD_MARGIN)
            })
        })
    };
    let columns = camera.width_px / CELL_PX;
    (0..camera.height_px / CELL_PX)
        .map(|row| {
            let first = (0..columns).find(|&column| is_field(column, row));
            let last = (0..columns).rev().find(|&column| is_field(column, row));
            first.zip(last).map_or([0, 0], |(first, last)| [first, last + 1])
        })
        .collect()
}

/// Largest outline of a piece anywhere on the field (pixels).
fn largest_reach(camera: &CameraModel, pieces: &Pieces, half: [f64; 2]) -> Option<f64> {
    let mut largest: f64 = 0.0;
    for kind in Kind::ALL {
        for corner in [[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0], [0.0, 0.0]] {
            let position = [0, 1].map(|axis| corner[axis] * half[axis]);
            largest = largest.max(Outline::new(camera, pieces, kind, position)?.reach());
        }
    }
    Some(1.2 * largest)
}
