//! Search for candidates: colour labels on a coarse grid, and a centre-surround filter on their integral image.
//!
//! Every fourth pixel of every fourth row gets the label of its colour. A cell is a candidate of its kind where the
//! square of the piece's size around it is filled with the label and the ring around that square is not. So a line
//! of the field is no biscuit and a hand is no ball. One integral image holds the three kinds in the bits of one
//! number.

use crate::camera::{color::ColorTable, frame::View};

/// Columns and rows of a cell (pixels); a multiple of 2, since two pixels share their chroma.
pub(super) const CELL_PX: usize = 4;
/// Bits of a kind's count in the integral image: 2^21 cells are more than any image has.
const COUNT_BITS: usize = 21;
const COUNT_MASK: u64 = (1 << COUNT_BITS) - 1;
/// Smallest filled fraction of the inner square. A larger value loses pieces that are partly hidden.
const MIN_INNER: f64 = 0.35;
/// Smallest difference between the filled fractions of square and ring. A larger value loses pieces that touch
/// others of their colour; a smaller one lets hands pass.
const MIN_CONTRAST: f64 = 0.25;
/// Candidates of one kind that are kept, best first.
pub(super) const MAX_CANDIDATES: usize = 8;

/// Rectangle of cells: first and end column, first and end row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cells {
    pub(super) columns: [usize; 2],
    pub(super) rows: [usize; 2],
}

/// Place where a piece may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    /// Centre (column and row, pixels).
    pub(super) pixel: [f64; 2],
    /// Filled fraction of the square minus that of the ring.
    pub(super) contrast: f64,
}

/// Candidates of one kind, best first.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidates {
    items: [Candidate; MAX_CANDIDATES],
    count: usize,
}

impl Candidates {
    const EMPTY: Self =
        Self { items: [Candidate { pixel: [0.0; 2], contrast: 0.0 }; MAX_CANDIDATES], count: 0 };

    pub(super) fn as_slice(&self) -> &[Candidate] {
        &self.items[..self.count]
    }

    /// Add a candidate; of two within `distance` pixels the better one stays.
    fn add(&mut self, new: Candidate, distance: f64) {
        let near = |own: &Candidate| {
            (own.pixel[0] - new.pixel[0]).hypot(own.pixel[1] - new.pixel[1]) < distance
        };
        if self.as_slice().iter().any(|own| near(own) && new.contrast <= own.contrast) {
            return;
        }
        let mut kept = 0;
        for at in 0..self.count {
            if !near(&self.items[at]) {
                self.items[kept] = self.items[at];
                kept += 1;
            }
        }
        self.count = kept;
        let place = self.as_slice().partition_point(|own| new.contrast <= own.contrast);
        if place == MAX_CANDIDATES {
            return;
        }
        self.count = (self.count + 1).min(MAX_CANDIDATES);
        self.items[place..self.count].rotate_right(1);
        self.items[place] = new;
    }
}

/// Grid of labels with its integral image; the memory is reused.
#[derive(Debug, Clone)]
pub(super) struct Scan {
    /// Columns of the grid.
    columns: usize,
    /// Rows of the grid.
    rows: usize,
    /// Cells of each row of the grid that lie on the field.
    on_field: Vec<[usize; 2]>,
    labels: Vec<u8>,
    /// Cells of the goal cups, whose darkness is that of the strikers.
    cups: Vec<usize>,
    integral: Vec<u64>,
    /// Half the side of the inner square (cells), for each kind.
    inner: [usize; 3],
    /// Half the side of the ring (cells), for each kind.
    outer: [usize; 3],
    /// Smallest distance of two pieces of a kind (pixels).
    distance: [f64; 3],
}

impl Scan {
    /// `size` is that of the image, `on_field` the first and end column of each cell row on the field, `is_cup` tells
    /// the pixels of the goal cups, `radius_px` is that of each kind.
    pub(super) fn new(
        size: [usize; 2],
        on_field: Vec<[usize; 2]>,
        is_cup: impl Fn([f64; 2]) -> bool,
        radius_px: [f64; 3],
    ) -> Self {
        let [columns, rows] = size.map(|pixels| pixels / CELL_PX);
        let cups =
            (0..columns * rows).filter(|cell| is_cup(centre([cell % columns, cell / columns])));
        let half = |factor: f64| {
            radius_px.map(|radius| (factor * radius / CELL_PX as f64).round().max(1.0) as usize)
        };
        Self {
            columns,
            rows,
            on_field,
            labels: vec![0; columns * rows],
            cups: cups.collect(),
            integral: vec![0; (columns + 1) * (rows + 1)],
            inner: half(0.72),
            outer: half(1.75).map(|cells| cells + 1),
            distance: radius_px.map(|radius| 1.2 * radius),
        }
    }

    /// All cells.
    pub(super) fn everything(&self) -> Cells {
        Cells { columns: [0, self.columns], rows: [0, self.rows] }
    }

    /// Cells within `half_px` pixels of `pixel`.
    pub(super) fn around(&self, pixel: [f64; 2], half_px: f64) -> Cells {
        let span = |at: f64, end: usize| {
            let cell = |pixels: f64| (pixels.max(0.0) / CELL_PX as f64) as usize;
            [cell(at - half_px).min(end), (cell(at + half_px) + 1).min(end)]
        };
        Cells { columns: span(pixel[0], self.columns), rows: span(pixel[1], self.rows) }
    }

    /// Label the cells and return the candidates of the three kinds.
    pub(super) fn run(
        &mut self,
        view: &View<'_>,
        table: &ColorTable,
        cells: Cells,
    ) -> [Candidates; 3] {
        self.label(view, table, cells);
        for cell in &self.cups {
            if self.labels[*cell] == STRIKER_LABEL {
                self.labels[*cell] = 0;
            }
        }
        self.integrate(cells);
        let mut found = [Candidates::EMPTY; 3];
        for row in cells.rows[0]..cells.rows[1] {
            let [first, end] = self.row_span(row, cells);
            for column in first..end {
                let label = usize::from(self.labels[row * self.columns + column]);
                let Some(kind) = label.checked_sub(1) else { continue };
                if let Some(contrast) = self.contrast(kind, [column, row], cells) {
                    let candidate = Candidate { pixel: centre([column, row]), contrast };
                    found[kind].add(candidate, self.distance[kind]);
                }
            }
        }
        found
    }

    fn row_span(&self, row: usize, cells: Cells) -> [usize; 2] {
        let [first, end] = self.on_field[row];
        let first = first.max(cells.columns[0]);
        [first, end.min(cells.columns[1]).max(first)]
    }

    fn label(&mut self, view: &View<'_>, table: &ColorTable, cells: Cells) {
        let [y, u, v] = view.offsets();
        for row in cells.rows[0]..cells.rows[1] {
            let [first, end] = self.row_span(row, cells);
            let bytes = view.row(row * CELL_PX);
            let labels = &mut self.labels[row * self.columns..(row + 1) * self.columns];
            labels[cells.columns[0]..cells.columns[1]].fill(0);
            let pixels = bytes.chunks_exact(2 * CELL_PX).take(end).skip(first);
            for (label, pixels) in labels[first..end].iter_mut().zip(pixels) {
                *label = table.label([pixels[y], pixels[u], pixels[v]]);
            }
        }
    }

    fn integrate(&mut self, cells: Cells) {
        let stride = self.columns + 1;
        let [first, end] = cells.columns;
        self.integral[cells.rows[0] * stride + first..=cells.rows[0] * stride + end].fill(0);
        for row in cells.rows[0]..cells.rows[1] {
            let labels = &self.labels[row * self.columns + first..row * self.columns + end];
            let (above, below) = self.integral.split_at_mut((row + 1) * stride);
            let above = &above[row * stride + first + 1..=row * stride + end];
            below[first] = 0;
            let mut sum = 0;
            for ((label, above), below) in labels.iter().zip(above).zip(&mut below[first + 1..=end])
            {
                sum += LABEL_COUNTS[usize::from(*label & 3)];
                *below = sum + above;
            }
        }
    }

    /// Filled fraction of the square minus that of the ring, where both limits hold.
    fn contrast(&self, kind: usize, at: [usize; 2], cells: Cells) -> Option<f64> {
        let (inner, inner_cells) = self.count(kind, at, self.inner[kind], cells);
        let filled = inner / inner_cells;
        if filled < MIN_INNER {
            return None;
        }
        let (all, all_cells) = self.count(kind, at, self.outer[kind], cells);
        let ring = (all - inner) / (all_cells - inner_cells).max(1.0);
        (MIN_CONTRAST <= filled - ring).then_some(filled - ring)
    }

    /// Labelled cells of a kind in the square of half side `half` around `at`, and the cells of the square.
    fn count(
        &self,
        kind: usize,
        [column, row]: [usize; 2],
        half: usize,
        cells: Cells,
    ) -> (f64, f64) {
        let stride = self.columns + 1;
        let left = column.saturating_sub(half).max(cells.columns[0]);
        let right = (column + half + 1).min(cells.columns[1]);
        let top = row.saturating_sub(half).max(cells.rows[0]);
        let bottom = (row + half + 1).min(cells.rows[1]);
        let at = |row: usize, column: usize| self.integral[row * stride + column];
        let sum = at(bottom, right) + at(top, left) - at(top, right) - at(bottom, left);
        let count = (sum >> (COUNT_BITS * kind)) & COUNT_MASK;
        // The square counts whole: a piece at the edge of the field is not fuller for it.
        let side = (2 * half + 1) as f64;
        (count as f64, side * side)
    }
}

/// Pixel of a cell: the middle of the chroma sample that gives its label.
pub(super) fn centre([column, row]: [usize; 2]) -> [f64; 2] {
    [(column * CELL_PX) as f64 + 0.5, (row * CELL_PX) as f64]
}

/// Label of a striker.
const STRIKER_LABEL: u8 = 2;

const LABEL_COUNTS: [u64; 4] = [0, 1, 1 << COUNT_BITS, 1 << (2 * COUNT_BITS)];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_near_candidates_the_better_one_stays() {
        let mut found = Candidates::EMPTY;
        let at = |column: f64, contrast| Candidate { pixel: [column, 0.0], contrast };
        for (column, contrast) in [(0.0, 0.5), (5.0, 0.7), (100.0, 0.6), (3.0, 0.4), (200.0, 0.9)] {
            found.add(at(column, contrast), 20.0);
        }
        let columns: Vec<f64> = found.as_slice().iter().map(|own| own.pixel[0]).collect();
        assert_eq!(columns, [200.0, 5.0, 100.0]);
        for k in 0..20 {
            found.add(at(1000.0 + 50.0 * f64::from(k), 0.65), 20.0);
        }
        assert_eq!(found.as_slice().len(), MAX_CANDIDATES);
        assert!(found.as_slice().is_sorted_by(|a, b| b.contrast <= a.contrast));
    }
}
