//! Inner corners of a checkerboard.
//!
//! A corner is a saddle of the brightness: `S = Ixy^2 - Ixx Iyy` of the smoothed image is large and positive. The
//! saddles are linked along the two directions in which the brightness does not change to second order, which are the
//! edges of the squares; neighbours have the opposite sign of `Ixy` in the axes of the squares. The largest linked
//! grid must have the size of the board. Corners are refined by the orthogonality of gradients and radii (Foerstner
//! and Guelch, ISPRS 1987), as OpenCV's `cornerSubPix`.

use super::BoardView;
use crate::camera::frame::Frame;
use std::collections::{BTreeMap, VecDeque};

/// Standard deviation of the smoothing (pixels).
const SIGMA: f64 = 1.5;
/// Fraction of the strongest saddle that a corner must reach.
const MIN_STRENGTH: f64 = 0.12;
/// Largest number of saddles.
const MAX_SADDLES: usize = 1500;
/// Half side of the window of the refinement (pixels).
const WINDOW: i32 = 5;
/// Radius of the circle that must cross four sectors (pixels).
const RING_PX: f64 = 4.5;
/// Largest angle between a link and an edge (cosine).
const MIN_ALIGNMENT: f64 = 0.97;

/// Checkerboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checkerboard {
    /// Inner corners along the first side.
    pub columns: usize,
    /// Inner corners along the second side.
    pub rows: usize,
    /// Side of a square (m).
    pub square_m: f64,
}

impl Checkerboard {
    /// Return the inner corners with their places on the board, row by row.
    #[must_use]
    pub fn view(&self, pixels: Vec<[f64; 2]>) -> BoardView {
        let rows =
            (0..self.rows).flat_map(|row| (0..self.columns).map(move |column| (column, row)));
        let place = |own: usize| own as f64 * self.square_m;
        let places_m = rows.map(|(column, row)| [place(column), place(row)]).collect();
        BoardView { places_m, pixels }
    }
}

/// Brightness as numbers, smoothed.
struct Image {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Image {
    fn luma(frame: &Frame) -> Self {
        let view = frame.view();
        let (width, height) = (view.width_px, view.height_px);
        let rows = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let values = rows.map(|(column, row)| f32::from(view.yuv(column, row)[0])).collect();
        Self { width, height, values }
    }

    fn at(&self, column: usize, row: usize) -> f32 {
        self.values[row * self.width + column]
    }

    fn smoothed(&self, sigma: f64) -> Self {
        let reach = (3.0 * sigma).ceil() as isize;
        let weight = |d: isize| (-0.5 * (d as f64 / sigma).powi(2)).exp();
        let total: f64 = (-reach..=reach).map(weight).sum();
        let kernel: Vec<f32> = (-reach..=reach).map(|d| (weight(d) / total) as f32).collect();
        let clamp = |at: isize, end: usize| at.clamp(0, end as isize - 1) as usize;
        let mut across = Vec::with_capacity(self.values.len());
        for row in 0..self.height {
            for column in 0..self.width {
                let taps = kernel.iter().zip(-reach..);
                across.push(
                    taps.map(|(k, d)| k * self.at(clamp(column as isize + d, self.width), row))
                        .sum(),
                );
            }
        }
        let across = Self { width: self.width, height: self.height, values: across };
        let mut values = Vec::with_capacity(self.values.len());
        for row in 0..self.height {
            for column in 0..self.width {
                let taps = kernel.iter().zip(-reach..);
                values.push(
                    taps.map(|(k, d)| k * across.at(column, clamp(row as isize + d, self.height)))
                        .sum(),
                );
            }
        }
        Self { width: self.width, height: self.height, values }
    }

    /// Second derivatives: xx, yy, xy.
    fn hessian(&self, column: usize, row: usize) -> [f32; 3] {
        let at = |dc: isize, dr: isize| {
            self.at((column as isize + dc) as usize, (row as isize + dr) as usize)
        };
        [
            at(1, 0) - 2.0 * at(0, 0) + at(-1, 0),
            at(0, 1) - 2.0 * at(0, 0) + at(0, -1),
            (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / 4.0,
        ]
    }

    fn bilinear(&self, [column, row]: [f64; 2]) -> Option<f64> {
        let fits = 0.0 <= column
            && 0.0 <= row
            && column < self.width as f64 - 1.001
            && row < self.height as f64 - 1.001;
        fits.then(|| {
            let (c, r) = (column as usize, row as usize);
            let (fc, fr) = (column - c as f64, row - r as f64);
            let at = |c, r| f64::from(self.at(c, r));
            (at(c, r) * (1.0 - fc) + at(c + 1, r) * fc) * (1.0 - fr)
                + (at(c, r + 1) * (1.0 - fc) + at(c + 1, r + 1) * fc) * fr
        })
    }
}

/// Saddle of the brightness.
#[derive(Debug, Clone, Copy)]
struct Saddle {
    pixel: [f64; 2],
    strength: f32,
    /// Unit vectors along the two edges; the brightness rises between the first and the second, in mathematical order.
    edges: [[f64; 2]; 2],
}

/// Find the inner corners of `board`; `None` when the image does not show all of them. The corners run along the
/// rows of the board: the first side from `[0]` to `[columns - 1]`, and so on. The frame of the board is right-handed
/// with z away from the camera.
#[must_use]
pub fn find_checkerboard(frame: &Frame, board: &Checkerboard) -> Option<Vec<[f64; 2]>> {
    let raw = Image::luma(frame);
    if raw.width < 32 || raw.height < 32 {
        return None;
    }
    let smooth = raw.smoothed(SIGMA);
    let saddles = find_saddles(&smooth);
    let corners = grow_grid(&saddles, board)?;
    let light = raw.smoothed(0.7);
    Some(corners.into_iter().map(|corner| refine(&light, corner)).collect())
}

/// Image whose corners of squares can be refined.
pub(super) struct CornerImage(Image);

impl CornerImage {
    /// Prepare a frame; `None` if it is too small.
    pub(super) fn new(frame: &Frame) -> Option<Self> {
        let raw = Image::luma(frame);
        (32 <= raw.width && 32 <= raw.height).then(|| Self(raw.smoothed(0.7)))
    }

    /// Corner of four squares within 3 pixels of `start`.
    pub(super) fn refine(&self, start: [f64; 2]) -> Option<[f64; 2]> {
        let corner = refine(&self.0, start);
        let [column, row] = corner.map(|own| own.round().max(0.0) as usize);
        (corner != start && has_four_sectors(&self.0, column, row)).then_some(corner)
    }
}

fn find_saddles(image: &Image) -> Vec<Saddle> {
    let margin = 4;
    let mut strength = vec![0.0_f32; image.values.len()];
    for row in margin..image.height - margin {
        for column in margin..image.width - margin {
            let [xx, yy, xy] = image.hessian(column, row);
            strength[row * image.width + column] = (xy * xy - xx * yy).max(0.0);
        }
    }
    let strongest = strength.iter().copied().fold(0.0, f32::max);
    let limit = strongest * MIN_STRENGTH as f32;
    let mut saddles = Vec::new();
    for row in margin..image.height - margin {
        for column in margin..image.width - margin {
            let own = strength[row * image.width + column];
            let is_peak = (row - 3..=row + 3)
                .all(|r| (column - 3..=column + 3).all(|c| strength[r * image.width + c] <= own));
            if limit < own && 0.0 < own && is_peak && has_four_sectors(image, column, row) {
                saddles.push(Saddle {
                    pixel: [column as f64, row as f64],
                    strength: own,
                    edges: edge_directions(image.hessian(column, row)),
                });
            }
        }
    }
    saddles.sort_by(|a, b| b.strength.total_cmp(&a.strength));
    saddles.truncate(MAX_SADDLES);
    saddles
}

/// Return whether a small circle crosses two bright and two dark sectors: the corner of a single square has one each.
fn has_four_sectors(image: &Image, column: usize, row: usize) -> bool {
    const SAMPLES: usize = 32;
    let mut levels = [0.0; SAMPLES];
    for (k, level) in levels.iter_mut().enumerate() {
        let (sin, cos) = (std::f64::consts::TAU * k as f64 / SAMPLES as f64).sin_cos();
        let place = [column as f64 + RING_PX * cos, row as f64 + RING_PX * sin];
        let Some(own) = image.bilinear(place) else { return false };
        *level = own;
    }
    let (low, high) = levels
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(low, high), own| (low.min(*own), high.max(*own)));
    let middle = f64::midpoint(low, high);
    let changes =
        (0..SAMPLES).filter(|&k| (levels[k] < middle) != (levels[(k + 1) % SAMPLES] < middle));
    let dark = levels.iter().filter(|own| **own < middle).count();
    changes.count() == 4 && (SAMPLES / 4..=SAMPLES - SAMPLES / 4).contains(&dark)
}

/// Directions `d` with `d^T H d = 0`, in the order of the rising sector.
fn edge_directions([xx, yy, xy]: [f32; 3]) -> [[f64; 2]; 2] {
    let [xx, yy, xy] = [xx, yy, xy].map(f64::from);
    // Eigenvector of the larger eigenvalue, along which the brightness has a minimum.
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let mean = f64::midpoint(xx, yy);
    let radius = ((xx - yy) / 2.0).hypot(xy);
    let (high, low) = (mean + radius, mean - radius);
    // high cos^2 + low sin^2 = 0
    let half = (high / -low).max(0.0).sqrt().atan();
    [angle - half, angle + half].map(|own| [own.cos(), own.sin()])
}

/// Neighbour of a saddle in a direction: the nearest one along it, with the same edges in swapped order.
fn neighbour(saddles: &[Saddle], from: usize, direction: [f64; 2]) -> Option<usize> {
    let own = &saddles[from];
    let mut best: Option<(f64, usize)> = None;
    for (at, other) in saddles.iter().enumerate() {
        let offset = [other.pixel[0] - own.pixel[0], other.pixel[1] - own.pixel[1]];
        let distance = offset[0].hypot(offset[1]);
        if !(5.0..=400.0).contains(&distance) {
            continue;
        }
        let along = (offset[0] * direction[0] + offset[1] * direction[1]) / distance;
        let is_swapped =
            parallel(own.edges[0], other.edges[1]) && parallel(own.edges[1], other.edges[0]);
        // A saddle aside of the line counts as farther away.
        let cost = distance * (1.0 + 20.0 * (1.0 - along));
        if MIN_ALIGNMENT < along && is_swapped && best.is_none_or(|(least, _)| cost < least) {
            best = Some((cost, at));
        }
    }
    best.map(|(_, at)| at)
}

fn parallel(a: [f64; 2], b: [f64; 2]) -> bool {
    0.94 < (a[0] * b[0] + a[1] * b[1]).abs()
}

/// Link saddles into a grid of the board's size.
fn grow_grid(saddles: &[Saddle], board: &Checkerboard) -> Option<Vec<[f64; 2]>> {
    let mut seen = vec![false; saddles.len()];
    for seed in 0..saddles.len().min(60) {
        if seen[seed] {
            continue;
        }
        let grid = grow_from(saddles, seed);
        grid.values().for_each(|&at| seen[at] = true);
        if let Some(corners) = take_grid(saddles, &grid, board) {
            return Some(corners);
        }
    }
    None
}

/// Saddles by their place in the grid around `seed`.
fn grow_from(saddles: &[Saddle], seed: usize) -> BTreeMap<(i32, i32), usize> {
    let mut grid = BTreeMap::from([((0, 0), seed)]);
    let mut places = BTreeMap::from([(seed, (0, 0))]);
    // Axes of the grid at each saddle, so that they turn with the perspective.
    let mut axes = BTreeMap::from([(seed, saddles[seed].edges)]);
    let mut queue = VecDeque::from([seed]);
    while let Some(from) = queue.pop_front() {
        let (i, j) = places[&from];
        let own = axes[&from];
        for (di, dj, axis, sign) in
            [(1, 0, 0, 1.0), (-1, 0, 0, -1.0), (0, 1, 1, 1.0), (0, -1, 1, -1.0)]
        {
            let direction = own[axis].map(|v: f64| sign * v);
            let Some(to) = neighbour(saddles, from, direction) else { continue };
            if places.contains_key(&to) || grid.contains_key(&(i + di, j + dj)) {
                continue;
            }
            grid.insert((i + di, j + dj), to);
            places.insert(to, (i + di, j + dj));
            // Of the neighbour's edges, the one along each of this saddle's axes, with the same sign.
            let along = |edge: [f64; 2], k: usize| edge[0] * own[k][0] + edge[1] * own[k][1];
            let [first, second] = saddles[to].edges;
            let aligned = [0, 1].map(|k| {
                let edge =
                    if along(first, k).abs() < along(second, k).abs() { second } else { first };
                edge.map(|v| if along(edge, k) < 0.0 { -v } else { v })
            });
            axes.insert(to, aligned);
            queue.push_back(to);
        }
    }
    grid
}

/// Corners of a complete grid in the order of the board.
fn take_grid(
    saddles: &[Saddle],
    grid: &BTreeMap<(i32, i32), usize>,
    board: &Checkerboard,
) -> Option<Vec<[f64; 2]>> {
    let span = |of: fn(&(i32, i32)) -> i32| {
        let low = grid.keys().map(of).min()?;
        let high = grid.keys().map(of).max()?;
        Some((low, (high - low + 1) as usize))
    };
    let ((i0, width), (j0, height)) = (span(|own| own.0)?, span(|own| own.1)?);
    let is_turned = match (width, height) {
        (w, h) if (w, h) == (board.columns, board.rows) => false,
        (w, h) if (w, h) == (board.rows, board.columns) => true,
        _ => return None,
    };
    let at = |column: usize, row: usize| {
        let (i, j) = if is_turned { (row, column) } else { (column, row) };
        grid.get(&(i0 + i as i32, j0 + j as i32)).map(|&at| saddles[at].pixel)
    };
    // Right-handed with z away from the camera: columns to the right and rows down.
    let (origin, right, down) = (at(0, 0)?, at(1, 0)?, at(0, 1)?);
    let cross = (right[0] - origin[0]) * (down[1] - origin[1])
        - (right[1] - origin[1]) * (down[0] - origin[0]);
    let column_of = |column: usize| if cross < 0.0 { board.columns - 1 - column } else { column };
    let places =
        (0..board.rows).flat_map(|row| (0..board.columns).map(move |column| (column, row)));
    places.map(|(column, row)| at(column_of(column), row)).collect()
}

/// Point to which every gradient around it is orthogonal.
fn refine(image: &Image, start: [f64; 2]) -> [f64; 2] {
    let mut corner = start;
    for _ in 0..20 {
        let (mut a, mut b) = ([0.0; 3], [0.0; 2]);
        for dy in -WINDOW..=WINDOW {
            for dx in -WINDOW..=WINDOW {
                let offset = [f64::from(dx), f64::from(dy)];
                let place = [corner[0] + offset[0], corner[1] + offset[1]];
                let side = |dx: f64, dy: f64| image.bilinear([place[0] + dx, place[1] + dy]);
                let (Some(l), Some(r), Some(u), Some(d)) =
                    (side(-1.0, 0.0), side(1.0, 0.0), side(0.0, -1.0), side(0.0, 1.0))
                else {
                    return corner;
                };
                let (gx, gy) = ((r - l) / 2.0, (d - u) / 2.0);
                let weight = (-(offset[0] * offset[0] + offset[1] * offset[1]) / 18.0).exp();
                a[0] += weight * gx * gx;
                a[1] += weight * gx * gy;
                a[2] += weight * gy * gy;
                b[0] += weight * (gx * gx * offset[0] + gx * gy * offset[1]);
                b[1] += weight * (gx * gy * offset[0] + gy * gy * offset[1]);
            }
        }
        let determinant = a[0] * a[2] - a[1] * a[1];
        if determinant < 1e-9 || determinant.is_nan() {
            return corner;
        }
        let step =
            [(a[2] * b[0] - a[1] * b[1]) / determinant, (a[0] * b[1] - a[1] * b[0]) / determinant];
        let length = step[0].hypot(step[1]);
        if 3.0 < length || 3.0 < (corner[0] - start[0]).hypot(corner[1] - start[1]) {
            return start;
        }
        corner = [corner[0] + step[0], corner[1] + step[1]];
        if length < 1e-4 {
            break;
        }
    }
    corner
}
