//! ChArUco boards: a checkerboard with ArUco markers in its white squares, of which any part may be visible.
//!
//! The markers give a homography around each inner corner of the board, and the corner is refined as that of a
//! checkerboard. The layout is that of OpenCV 4.6 and later: the top left square is black, and markers count row by
//! row from 0. Source: S. Garrido-Jurado et al., "Automatic generation and detection of highly reliable fiducial
//! markers under occlusion", Pattern Recognition 47 (2014).

use super::{
    BoardView,
    checkerboard::CornerImage,
    lens_fit::homography,
    tags::{Family, Tag, find_markers},
};
use crate::camera::frame::Frame;
use std::{fmt, str::FromStr};

/// Cells of the markers of the three dictionaries.
const MARKERS: &str = include_str!("aruco.txt");
/// Markers that determine the homography around a corner.
const NEAREST: usize = 4;
/// Markers of a dictionary.
pub const MOST_MARKERS: usize = 250;
/// Fewest corners of an image.
const FEWEST_CORNERS: usize = 12;

/// Dictionary of ArUco markers, by the cells along a side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dictionary {
    /// `DICT_4X4_50`, `_100` and `_250`.
    Cells4,
    /// `DICT_5X5_50`, `_100` and `_250`.
    Cells5,
    /// `DICT_6X6_50`, `_100` and `_250`.
    Cells6,
}

impl Dictionary {
    const ALL: [Self; 3] = [Self::Cells4, Self::Cells5, Self::Cells6];

    fn name(self) -> &'static str {
        match self {
            Self::Cells4 => "4x4",
            Self::Cells5 => "5x5",
            Self::Cells6 => "6x6",
        }
    }

    /// Return the first `count` markers. Two markers of 4 x 4 cells differ in 3 cells or more, so that a wrong cell
    /// would make one of another; the others allow one wrong cell.
    fn family(self, count: usize) -> Family {
        let mut lines = MARKERS.lines().skip_while(|line| *line != self.name());
        let cells = 4 + self as usize;
        lines.next();
        let words = lines.take_while(|line| !line.contains('x')).flat_map(str::split_whitespace);
        let codes = words.filter_map(|word| u64::from_str_radix(word, 16).ok()).take(count);
        let wrong_cells = u32::from(self != Self::Cells4);
        Family { cells, codes: codes.collect(), wrong_cells }
    }
}

impl fmt::Display for Dictionary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Dictionary {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|own| own.name() == text);
        found.ok_or_else(|| "must be 4x4, 5x5 or 6x6, the cells of a marker".to_owned())
    }
}

/// ChArUco board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CharucoBoard {
    /// Inner corners along the rows of squares.
    pub columns: usize,
    /// Inner corners along the columns of squares.
    pub rows: usize,
    /// Side of a square (m).
    pub square_m: f64,
    /// Side of a marker (m).
    pub marker_m: f64,
    /// Dictionary of the markers.
    pub dictionary: Dictionary,
}

/// Marker of an image with the column and row of its square.
struct Placed {
    tag: Tag,
    square: [usize; 2],
}

impl CharucoBoard {
    /// Squares with a marker, in the order of the markers.
    fn squares(&self) -> impl Iterator<Item = [usize; 2]> + use<> {
        let (columns, rows) = (self.columns + 1, self.rows + 1);
        let all = (0..rows).flat_map(move |row| (0..columns).map(move |column| [column, row]));
        all.filter(|[column, row]| (column + row) % 2 == 1)
    }

    /// Return the number of markers.
    #[must_use]
    pub fn markers(&self) -> usize {
        self.squares().count()
    }

    /// Outer corners of the marker in a square (m), clockwise from the top left.
    fn marker_corners(&self, square: [usize; 2]) -> [[f64; 2]; 4] {
        let margin = (self.square_m - self.marker_m) / 2.0;
        let [x, y] = square.map(|own| own as f64 * self.square_m + margin);
        let m = self.marker_m;
        [[x, y], [x + m, y], [x + m, y + m], [x, y + m]]
    }
}

/// Find the inner corners of `board` next to visible markers; `None` when there are too few for a calibration.
#[must_use]
pub fn find_charuco(frame: &Frame, board: &CharucoBoard) -> Option<BoardView> {
    let family = board.dictionary.family(board.markers());
    let tags = find_markers(frame, &family);
    let squares: Vec<[usize; 2]> = board.squares().collect();
    // A marker that appears twice is that of another board.
    let is_only = |id: u32| tags.iter().filter(|own| own.id == id).count() == 1;
    let placed = tags
        .iter()
        .filter(|own| is_only(own.id))
        .filter_map(|tag| Some(Placed { square: *squares.get(tag.id as usize)?, tag: *tag }));
    let placed: Vec<Placed> = placed.collect();
    let image = CornerImage::new(frame)?;
    let mut view = BoardView { places_m: Vec::new(), pixels: Vec::new() };
    for row in 1..=board.rows {
        for column in 1..=board.columns {
            let place = [column, row].map(|own| own as f64 * board.square_m);
            let Some(pixel) = predict(board, &placed, [column, row]) else { continue };
            let Some(pixel) = image.refine(pixel) else { continue };
            view.places_m.push(place);
            view.pixels.push(pixel);
        }
    }
    (FEWEST_CORNERS <= view.pixels.len() && !on_one_line(&view.places_m)).then_some(view)
}

/// Pixel of an inner corner, from the nearest markers; one of them lies next to it.
fn predict(board: &CharucoBoard, placed: &[Placed], corner: [usize; 2]) -> Option<[f64; 2]> {
    let distance = |own: &Placed| -> f64 {
        let offset = [0, 1].map(|axis: usize| own.square[axis] as f64 + 0.5 - corner[axis] as f64);
        offset[0].hypot(offset[1])
    };
    let mut nearest: Vec<&Placed> = placed.iter().collect();
    nearest.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    nearest.truncate(NEAREST);
    nearest.first().filter(|own| distance(own) < 1.0)?;
    let places: Vec<_> = nearest.iter().flat_map(|own| board.marker_corners(own.square)).collect();
    let pixels: Vec<_> = nearest.iter().flat_map(|own| own.tag.corners).collect();
    let h = homography(&places, &pixels)?;
    super::tags::apply(&h, corner.map(|own| own as f64 * board.square_m))
}

/// Return whether places have one x or one y in common: they determine no homography.
fn on_one_line(places: &[[f64; 2]]) -> bool {
    (0..2).any(|axis| places.iter().all(|own| (own[axis] - places[0][axis]).abs() < 1e-9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dictionaries_have_their_markers_and_distances() {
        for dictionary in Dictionary::ALL {
            let Family { cells, codes, wrong_cells } = dictionary.family(250);
            assert_eq!((codes.len(), cells), (250, 4 + dictionary as usize));
            assert!(codes.iter().all(|own| own >> (cells * cells) == 0));
            let pairs = (0..250).flat_map(|a| (0..a).map(move |b| (a, b)));
            let least = pairs.map(|(a, b)| (codes[a] ^ codes[b]).count_ones()).min().unwrap();
            assert!(2 * wrong_cells < least, "{dictionary}: {least}");
        }
        // Marker 0 of DICT_4X4_50 has the rows 1011, 0101, 0011, 0010.
        assert_eq!(Dictionary::Cells4.family(1).codes, [0b1011_0101_0011_0010]);
        assert_eq!("5x5".parse(), Ok(Dictionary::Cells5));
        assert!("7x7".parse::<Dictionary>().is_err());
    }

    #[test]
    fn markers_lie_in_the_white_squares() {
        let board = CharucoBoard {
            columns: 4,
            rows: 2,
            square_m: 0.04,
            marker_m: 0.03,
            dictionary: Dictionary::Cells4,
        };
        let squares: Vec<_> = board.squares().collect();
        assert_eq!(squares[..3], [[1, 0], [3, 0], [0, 1]]);
        assert_eq!(board.markers(), 7);
        assert_eq!(board.marker_corners([1, 0])[2], [0.075, 0.035]);
    }
}
