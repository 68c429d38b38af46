//! Outline of a piece in the image, and the fit of its position to edge points.
//!
//! A ball is a circle, a biscuit the circle of its top. A striker is the convex hull of its lower and its upper circle,
//! so that the side that the camera sees is part of the model. Edge points lie on rays from the middle of the outline, where
//! the membership in the piece's colour falls through one half. The second search moves each point to where the
//! colour is half way between those on its two sides, so that neither shading, nor a shadow on one side, nor a white
//! line shifts the edge. The position minimizes the distances of the edge
//! points from the outline by iteratively reweighted least squares, with Cauchy weights at first and Tukey's biweight
//! at the end, so that the edges of a neighbour count nothing. A common offset of all
//! distances is fitted too: it takes up the width of the edge, motion blur and a radius that is a little off.
//!
//! Source of the distance to the hull of two circles: I. Quilez, "2D distance functions" (uneven capsule). The
//! covariance is `s^2 c (A^T W A)^-1` plus a floor; neighbouring rays share pixels, hence the factor `c`.

use crate::camera::{
    color::{ColorTable, Kind},
    frame::View,
    model::CameraModel,
};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Rays of a fit. More rays cost time and add little, since neighbours share pixels.
const RAYS: usize = 40;
/// Distance of two samples along a ray (pixels).
const SAMPLE_PX: f64 = 0.5;
/// Distance of the places whose colours an edge lies between (pixels): beyond the blur of lens and motion, within the
/// piece.
const SIDE_PX: f64 = 3.5;
/// Membership at the edge: one half of 255.
const EDGE: f64 = 127.5;
/// Scale of the Cauchy weights (pixels): edges farther away than this count less than half.
const SCALE_PX: f64 = 0.8;
/// Steps of the reweighted fit between two searches for edges.
const FIT_STEPS: usize = 8;
/// Steps with Cauchy weights before those with Tukey's biweight, which needs a start within its reach.
const CAUCHY_STEPS: usize = 4;
/// Reach of Tukey's biweight (pixels): edges farther away count nothing.
const REACH_PX: f64 = 2.0;
/// Searches for edges: the second starts at the position that the first has found.
const SEARCHES: usize = 2;
/// Weight of an offset of 0 in units of edges. A larger one trusts the radius more.
const OFFSET_WEIGHT: f64 = 2.0;
/// Residual up to which an edge point supports a piece (pixels).
const INLIER_PX: f64 = 1.6;
/// Smallest fraction of rays with a supporting edge: most of the outline may be hidden by a striker or a hand.
const MIN_SUPPORT: f64 = 0.35;
/// Smallest filled fraction within the outline.
const MIN_FILL: f64 = 0.55;
/// Largest fraction of rays on which the colour goes on outside of the outline.
const MAX_LEAK: f64 = 0.15;
/// Correlation of the residuals of neighbouring rays: variances are multiplied by it.
const RAY_CORRELATION: f64 = 3.0;
/// Floor of the standard deviation of a centre (pixels): steps of the colour table, shading, highlights, and the error
/// of a usual calibration.
const FLOOR_PX: f64 = 0.2;
/// Move of the outline after which its patch is computed anew (pixels).
const REFILL_PX: f64 = 4.0;

/// Shapes of the pieces.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Pieces {
    /// Radius of the ball (m); its centre lies at this height.
    pub ball_radius_m: f64,
    /// Radius of a striker (m).
    pub striker_radius_m: f64,
    /// Height of a striker's top above the field (m); not published, 25 mm is an estimate: measure it.
    pub striker_height_m: f64,
    /// Radius of a biscuit (m).
    pub biscuit_radius_m: f64,
    /// Height of a biscuit's top above the field (m).
    pub biscuit_height_m: f64,
}

impl Default for Pieces {
    fn default() -> Self {
        Self {
            ball_radius_m: crate::board::BALL_RADIUS,
            striker_radius_m: crate::board::STRIKER_RADIUS,
            striker_height_m: 0.025,
            biscuit_radius_m: 0.006,
            biscuit_height_m: 0.005,
        }
    }
}

impl Pieces {
    /// Return the radius (m).
    #[must_use]
    pub fn radius(&self, kind: Kind) -> f64 {
        match kind {
            Kind::Ball => self.ball_radius_m,
            Kind::Striker => self.striker_radius_m,
            Kind::Biscuit => self.biscuit_radius_m,
        }
    }

    /// Return the heights (m) of the lowest and the highest circle of the outline.
    #[must_use]
    pub fn heights(&self, kind: Kind) -> [f64; 2] {
        match kind {
            Kind::Ball => [self.ball_radius_m; 2],
            Kind::Striker => [0.0, self.striker_height_m],
            // The sides of a flat white piece are darker than its top, and count as background.
            Kind::Biscuit => [self.biscuit_height_m; 2],
        }
    }

    /// Return the height (m) of the middle of the outline.
    #[must_use]
    pub fn middle(&self, kind: Kind) -> f64 {
        let [low, high] = self.heights(kind);
        (low + high) / 2.0
    }
}

/// Outline: the convex hull of two circles (pixels).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Outline {
    centres: [[f64; 2]; 2],
    radii: [f64; 2],
}

impl Outline {
    /// Outline of a piece at `position` (m).
    pub(super) fn new(
        camera: &CameraModel,
        pieces: &Pieces,
        kind: Kind,
        position: [f64; 2],
    ) -> Option<Self> {
        let radius = pieces.radius(kind);
        let [low, high] = pieces.heights(kind);
        let circle = |height: f64| {
            let point = [position[0], position[1], height];
            Some((camera.project(point)?, radius * camera.pixels_per_metre(point)?))
        };
        let (low, high) = (circle(low)?, circle(high)?);
        Some(Self { centres: [low.0, high.0], radii: [low.1, high.1] })
    }

    pub(super) fn middle(&self) -> [f64; 2] {
        let [low, high] = self.centres;
        [0, 1].map(|axis| (low[axis] + high[axis]) / 2.0)
    }

    /// Half of the largest extent (pixels).
    pub(super) fn reach(&self) -> f64 {
        let [low, high] = self.centres;
        let apart = (high[0] - low[0]).hypot(high[1] - low[1]);
        apart / 2.0 + self.radii[0].max(self.radii[1])
    }

    /// Signed distance (pixels) of a pixel from the outline, negative inside.
    fn distance(&self, pixel: [f64; 2]) -> f64 {
        self.distance_and_gradient(pixel).0
    }

    /// The same with its gradient by the pixel, a unit vector.
    fn distance_and_gradient(&self, pixel: [f64; 2]) -> (f64, [f64; 2]) {
        let [a, b] = self.centres;
        let [ra, rb] = self.radii;
        let from = |centre: [f64; 2], radius: f64| {
            let p = [pixel[0] - centre[0], pixel[1] - centre[1]];
            let length = p[0].hypot(p[1]).max(1e-9);
            (length - radius, p.map(|own| own / length))
        };
        let p = [pixel[0] - a[0], pixel[1] - a[1]];
        let axis = [b[0] - a[0], b[1] - a[1]];
        let h = axis[0] * axis[0] + axis[1] * axis[1];
        let shrink = ra - rb;
        if h <= shrink * shrink + 1e-9 {
            // One circle lies within the other.
            return if rb < ra { from(a, ra) } else { from(b, rb) };
        }
        let cross = p[0] * axis[1] - p[1] * axis[0];
        let side = if cross < 0.0 { -1.0 } else { 1.0 };
        let q = [cross.abs() / h, (p[0] * axis[0] + p[1] * axis[1]) / h];
        let c = [(h - shrink * shrink).sqrt(), shrink];
        let k = c[0] * q[1] - c[1] * q[0];
        if k < 0.0 {
            from(a, ra)
        } else if c[0] < k {
            from(b, rb)
        } else {
            let gradient = [
                (side * c[0] * axis[1] + c[1] * axis[0]) / h,
                (-side * c[0] * axis[0] + c[1] * axis[1]) / h,
            ];
            (c[0] * q[0] + c[1] * q[1] - ra, gradient)
        }
    }

    fn shift(&mut self, by: [f64; 2]) {
        for centre in &mut self.centres {
            centre[0] += by[0];
            centre[1] += by[1];
        }
    }
}

/// Memberships of a small part of the image; the memory is reused.
#[derive(Debug, Clone)]
pub(super) struct Patch {
    memberships: Vec<u8>,
    /// Y, U, V of each pixel.
    colors: Vec<[u8; 3]>,
    origin: [usize; 2],
    size: [usize; 2],
}

impl Patch {
    /// Patch for outlines up to `reach_px` pixels.
    pub(super) fn new(reach_px: f64) -> Self {
        let side = 2 * half_side(reach_px) + 2;
        Self {
            memberships: vec![0; side * side],
            colors: vec![[0; 3]; side * side],
            origin: [0; 2],
            size: [0; 2],
        }
    }

    /// Compute the memberships around an outline; false where it is not within the image.
    fn fill(&mut self, view: &View<'_>, table: &[u8], outline: &Outline) -> bool {
        let half = half_side(outline.reach());
        let middle = outline.middle();
        let limits = [view.width_px, view.height_px];
        for axis in 0..2 {
            let at = middle[axis].round();
            if !(2.0 <= at && at + 2.0 < limits[axis] as f64) {
                return false;
            }
            let at = at as usize;
            let first = at.saturating_sub(half);
            self.origin[axis] = first;
            self.size[axis] = (at + half + 1).min(limits[axis]) - first;
        }
        if self.memberships.len() < self.size[0] * self.size[1] {
            return false;
        }
        let [y, u, v] = view.offsets();
        let last_pair = view.width_px / 2 - 1;
        for row in 0..self.size[1] {
            let bytes = view.row(self.origin[1] + row);
            let part = row * self.size[0]..(row + 1) * self.size[0];
            let out = self.memberships[part.clone()].iter_mut().zip(&mut self.colors[part]);
            for (offset, (membership, color)) in out.enumerate() {
                let column = self.origin[0] + offset;
                let pair = column / 2;
                // A chroma sample lies between its two pixels: three quarters of the own, one of the next.
                let other = if column.is_multiple_of(2) {
                    pair.saturating_sub(1)
                } else {
                    (pair + 1).min(last_pair)
                };
                let mix = |channel: usize| {
                    let (own, next) = (bytes[4 * pair + channel], bytes[4 * other + channel]);
                    ((3 * u16::from(own) + u16::from(next) + 2) / 4) as u8
                };
                let luma = bytes[4 * pair + y + 2 * (column % 2)];
                *color = [luma, mix(u), mix(v)];
                *membership = table[ColorTable::index(*color)];
            }
        }
        true
    }

    /// Membership (0 to 255) at a pixel, bilinear; 0 outside of the patch.
    fn at(&self, pixel: [f64; 2]) -> f64 {
        let x = pixel[0] - self.origin[0] as f64;
        let y = pixel[1] - self.origin[1] as f64;
        if !(0.0 <= x && 0.0 <= y) {
            return 0.0;
        }
        let (column, row) = (x as usize, y as usize);
        if self.size[0] <= column + 1 || self.size[1] <= row + 1 {
            return 0.0;
        }
        let (fx, fy) = (x - column as f64, y - row as f64);
        let at = row * self.size[0] + column;
        let own = |at: usize| f64::from(self.memberships[at]);
        let top = own(at) * (1.0 - fx) + own(at + 1) * fx;
        let low = at + self.size[0];
        let bottom = own(low) * (1.0 - fx) + own(low + 1) * fx;
        top * (1.0 - fy) + bottom * fy
    }

    /// Y, U, V at a pixel, bilinear; `None` outside of the patch.
    fn color_at(&self, pixel: [f64; 2]) -> Option<[f64; 3]> {
        let x = pixel[0] - self.origin[0] as f64;
        let y = pixel[1] - self.origin[1] as f64;
        if !(0.0 <= x && 0.0 <= y) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        if self.size[0] <= column + 1 || self.size[1] <= row + 1 {
            return None;
        }
        let (fx, fy) = (x - column as f64, y - row as f64);
        let at = row * self.size[0] + column;
        let [a, b] = [self.colors[at], self.colors[at + 1]];
        let [c, d] = [self.colors[at + self.size[0]], self.colors[at + self.size[0] + 1]];
        let weights = [(1.0 - fx) * (1.0 - fy), fx * (1.0 - fy), (1.0 - fx) * fy, fx * fy];
        Some([0, 1, 2].map(|k| {
            let values = [a[k], b[k], c[k], d[k]];
            values.iter().zip(weights).map(|(value, weight)| weight * f64::from(*value)).sum()
        }))
    }

    /// Mean of the pixels within 1.3 times the outline, weighted by their memberships.
    fn centroid(&self, outline: &Outline) -> Option<[f64; 2]> {
        let limit = 0.3 * outline.radii[1];
        let mut sums = [0.0; 3];
        for row in 0..self.size[1] {
            for column in 0..self.size[0] {
                let weight = f64::from(self.memberships[row * self.size[0] + column]);
                let pixel = [(self.origin[0] + column) as f64, (self.origin[1] + row) as f64];
                if EDGE < weight && outline.distance(pixel) < limit {
                    sums[0] += weight;
                    sums[1] += weight * pixel[0];
                    sums[2] += weight * pixel[1];
                }
            }
        }
        (0.0 < sums[0]).then(|| [sums[1] / sums[0], sums[2] / sums[0]])
    }

    /// Fraction of the rays on which the piece's colour goes on outside of the outline: a finger is no ball.
    fn leak_fraction(&self, outline: &Outline) -> f64 {
        let middle = outline.middle();
        let mut leaks = 0_u32;
        for ray in 0..RAYS {
            let (sin, cos) = (TAU * ray as f64 / RAYS as f64).sin_cos();
            let at = |distance: f64| [middle[0] + distance * cos, middle[1] + distance * sin];
            let mut reach = outline.reach();
            // Distance of the outline along the ray, by two steps of Newton's method.
            for _ in 0..2 {
                reach -= outline.distance(at(reach));
            }
            let beyond = 0.2 * outline.radii[1] + 2.0;
            leaks += u32::from(EDGE < self.at(at(reach + beyond)));
        }
        f64::from(leaks) / RAYS as f64
    }

    /// Filled fraction of the outline shrunk to 0.8 of its radius, without the pixels that `hides` tells: a striker
    /// next to the ball hides a part of it.
    fn fill_fraction(&self, outline: &Outline, hides: impl Fn([u8; 3]) -> bool) -> f64 {
        let limit = -0.2 * outline.radii[0].min(outline.radii[1]);
        let (mut all, mut filled) = (0_u32, 0_u32);
        for row in (0..self.size[1]).step_by(2) {
            for column in (0..self.size[0]).step_by(2) {
                let pixel = [(self.origin[0] + column) as f64, (self.origin[1] + row) as f64];
                if outline.distance(pixel) < limit {
                    let at = row * self.size[0] + column;
                    let is_own = 127 < self.memberships[at];
                    all += u32::from(is_own || !hides(self.colors[at]));
                    filled += u32::from(is_own);
                }
            }
        }
        f64::from(filled) / f64::from(all.max(1))
    }
}

/// Half of the side of a patch (pixels).
fn half_side(reach_px: f64) -> usize {
    (1.5 * reach_px + 5.0).ceil() as usize
}

/// Edge point of one ray.
#[derive(Debug, Clone, Copy)]
struct Edge {
    pixel: [f64; 2],
    /// Direction of the ray, outwards.
    direction: [f64; 2],
}

impl Edge {
    /// Move the point to where the colour is half way between those on its two sides, if there is such a place.
    fn refine(&mut self, patch: &Patch) {
        let at = |offset: f64| [0, 1].map(|axis| self.pixel[axis] + offset * self.direction[axis]);
        let (Some(inside), Some(outside)) =
            (patch.color_at(at(-SIDE_PX)), patch.color_at(at(SIDE_PX)))
        else {
            return;
        };
        let change = [0, 1, 2].map(|k| inside[k] - outside[k]);
        let middle: f64 = (0..3).map(|k| change[k] * (inside[k] + outside[k]) / 2.0).sum();
        let mut before = 1.0;
        let mut best: Option<f64> = None;
        let steps = (2.0 * SIDE_PX / SAMPLE_PX) as i32;
        for step in 0..=steps {
            let offset = -SIDE_PX + SAMPLE_PX * f64::from(step);
            let Some(color) = patch.color_at(at(offset)) else { return };
            let now = (0..3).map(|k| change[k] * color[k]).sum::<f64>() - middle;
            if 0.0 <= before && now < 0.0 && 0 < step {
                let place = offset - SAMPLE_PX * now / (now - before);
                if best.is_none_or(|least| place.abs() < least.abs()) {
                    best = Some(place);
                }
            }
            before = now;
        }
        if let Some(place) = best {
            self.pixel = at(place);
        }
    }
}

/// Fitted piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Fit {
    /// Position in the board frame (m).
    pub(super) position: [f64; 2],
    /// Covariance of the position (m^2).
    pub(super) covariance: [[f64; 2]; 2],
    /// Middle of the outline (pixels).
    pub(super) pixel: [f64; 2],
    /// Fraction of the rays that support the outline.
    pub(super) support: f64,
}

/// Fits pieces in one frame.
pub(super) struct Fitter<'a> {
    pub(super) camera: &'a CameraModel,
    pub(super) pieces: &'a Pieces,
    pub(super) view: &'a View<'a>,
    pub(super) table: &'a ColorTable,
}

impl Fitter<'_> {
    /// Fit a piece of `kind` near `pixel`; `None` when the image does not support it.
    pub(super) fn fit(&self, patch: &mut Patch, kind: Kind, pixel: [f64; 2]) -> Option<Fit> {
        let table = self.table.memberships(kind);
        let mut outline = self.outline_at(kind, pixel)?;
        if !patch.fill(self.view, table, &outline) {
            return None;
        }
        let start = outline.middle();
        outline = self.outline_at(kind, patch.centroid(&outline)?)?;
        let [column, row] = outline.middle();
        // The patch has a margin for small moves.
        let has_moved = REFILL_PX < (column - start[0]).hypot(row - start[1]);
        if has_moved && !patch.fill(self.view, table, &outline) {
            return None;
        }
        let mut solution = Solution::default();
        for search in 0..SEARCHES {
            let (mut edges, count) = find_edges(patch, &outline);
            if search + 1 == SEARCHES {
                edges[..count].iter_mut().for_each(|edge| edge.refine(patch));
            }
            solution = solve(&edges[..count], &outline)?;
            outline.shift(solution.shift);
            outline = self.outline_at(kind, outline.middle())?;
        }
        let support = solution.inliers as f64 / RAYS as f64;
        let largest_offset = 0.25 * outline.radii[1] + 1.0;
        if support < MIN_SUPPORT
            || largest_offset < solution.offset.abs()
            || MAX_LEAK < patch.leak_fraction(&outline)
            || patch.fill_fraction(&outline, |color| self.hides(kind, color)) < MIN_FILL
        {
            return None;
        }
        let pixel = outline.middle();
        let position = self.camera.locate(pixel, self.pieces.middle(kind))?;
        let covariance = self.covariance(kind, position, &solution)?;
        Some(Fit { position, covariance, pixel, support })
    }

    /// Return whether a colour is that of a striker, which rises above the other pieces.
    fn hides(&self, kind: Kind, color: [u8; 3]) -> bool {
        let striker = self.table.memberships(Kind::Striker);
        kind != Kind::Striker && 127 < striker[ColorTable::index(color)]
    }

    fn outline_at(&self, kind: Kind, pixel: [f64; 2]) -> Option<Outline> {
        let position = self.camera.locate(pixel, self.pieces.middle(kind))?;
        Outline::new(self.camera, self.pieces, kind, position)
    }

    /// Covariance of the position from that of the pixel.
    fn covariance(
        &self,
        kind: Kind,
        position: [f64; 2],
        solution: &Solution,
    ) -> Option<[[f64; 2]; 2]> {
        let point = [position[0], position[1], self.pieces.middle(kind)];
        let [[a, b], [c, d]] = self.camera.pixel_by_position(point)?;
        let determinant = a * d - b * c;
        let inverse = [[d / determinant, -b / determinant], [-c / determinant, a / determinant]];
        let mut in_pixels = solution.covariance;
        in_pixels[0][0] += FLOOR_PX * FLOOR_PX;
        in_pixels[1][1] += FLOOR_PX * FLOOR_PX;
        Some([0, 1].map(|row| {
            [0, 1].map(|column| {
                (0..4)
                    .map(|k| inverse[row][k / 2] * in_pixels[k / 2][k % 2] * inverse[column][k % 2])
                    .sum()
            })
        }))
    }
}

/// On each ray the fall of the membership through one half that is nearest to the outline.
fn find_edges(patch: &Patch, outline: &Outline) -> ([Edge; RAYS], usize) {
    let mut edges = [Edge { pixel: [0.0; 2], direction: [0.0; 2] }; RAYS];
    let mut count = 0;
    let middle = outline.middle();
    let start = 0.3 * outline.radii[0].min(outline.radii[1]);
    let end = 1.4 * outline.reach() + 3.0;
    for ray in 0..RAYS {
        let (sin, cos) = (TAU * ray as f64 / RAYS as f64).sin_cos();
        let at = |distance: f64| [middle[0] + distance * cos, middle[1] + distance * sin];
        let mut best: Option<(f64, [f64; 2])> = None;
        let mut distance = start;
        let mut before = patch.at(at(distance));
        while distance < end {
            distance += SAMPLE_PX;
            let now = patch.at(at(distance));
            if EDGE <= before && now < EDGE {
                let pixel = at(distance - SAMPLE_PX * (EDGE - now) / (before - now));
                let off = outline.distance(pixel).abs();
                if best.is_none_or(|(least, _)| off < least) {
                    best = Some((off, pixel));
                }
            }
            before = now;
        }
        if let Some((_, pixel)) = best {
            edges[count] = Edge { pixel, direction: [cos, sin] };
            count += 1;
        }
    }
    (edges, count)
}

/// Shift of an outline that fits it to edges.
#[derive(Debug, Clone, Copy, Default)]
struct Solution {
    /// Shift (pixels).
    shift: [f64; 2],
    /// Common distance of the edges from the outline (pixels).
    offset: f64,
    /// Covariance of the shift (pixels^2).
    covariance: [[f64; 2]; 2],
    /// Number of supporting edges.
    inliers: usize,
}

/// Iteratively reweighted least squares for shift and offset; `None` when the edges do not determine them.
fn solve(edges: &[Edge], outline: &Outline) -> Option<Solution> {
    let mut solution = Solution::default();
    let mut moved = *outline;
    for step in 0..FIT_STEPS {
        let (mut normal, mut right) = ([[0.0; 3]; 3], [0.0; 3]);
        // The offset is small: without this a hidden half would be explained by a smaller piece.
        normal[2][2] = OFFSET_WEIGHT;
        right[2] = -OFFSET_WEIGHT * solution.offset;
        for edge in edges {
            let (distance, gradient) = moved.distance_and_gradient(edge.pixel);
            let residual = distance - solution.offset;
            let weight = weight_of(residual, step);
            // Moving the outline by t changes the distance by -gradient * t.
            let row = [gradient[0], gradient[1], 1.0];
            for i in 0..3 {
                right[i] += weight * row[i] * residual;
                for j in 0..3 {
                    normal[i][j] += weight * row[i] * row[j];
                }
            }
        }
        let inverse = invert(&normal)?;
        let step = [0, 1, 2].map(|i| (0..3).map(|j| inverse[i][j] * right[j]).sum::<f64>());
        moved.shift([step[0], step[1]]);
        solution.shift = [solution.shift[0] + step[0], solution.shift[1] + step[1]];
        solution.offset += step[2];
        solution.covariance = [[inverse[0][0], inverse[0][1]], [inverse[1][0], inverse[1][1]]];
    }
    let (mut sum, mut inliers) = (0.0, 0);
    for edge in edges {
        let residual = moved.distance(edge.pixel) - solution.offset;
        if residual.abs() < INLIER_PX {
            sum += residual * residual;
            inliers += 1;
        }
    }
    solution.inliers = inliers;
    let variance = RAY_CORRELATION * sum / (inliers.saturating_sub(3).max(1)) as f64;
    solution.covariance = solution.covariance.map(|row| row.map(|value| value * variance));
    Some(solution)
}

/// Weight of an edge in one step of the fit.
fn weight_of(residual: f64, step: usize) -> f64 {
    if step < CAUCHY_STEPS {
        // The first step takes every edge, since the start may be off by a pixel or two.
        let scale = if step == 0 { 4.0 * SCALE_PX } else { SCALE_PX };
        1.0 / (1.0 + (residual / scale).powi(2))
    } else {
        (1.0 - (residual / REACH_PX).powi(2)).max(0.0).powi(2)
    }
}

/// Inverse of a symmetric matrix; `None` when it is nearly singular.
fn invert(m: &[[f64; 3]; 3]) -> Option<[[f64; 3]; 3]> {
    let cofactor = |i: usize, j: usize| {
        let (a, b) = ((i + 1) % 3, (i + 2) % 3);
        let (c, d) = ((j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum::<f64>();
    let size = (m[0][0] * m[1][1] * m[2][2]).abs();
    if determinant < 1e-6 * size || determinant.is_nan() {
        return None;
    }
    Some([0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::model::tests::tilted;

    #[test]
    fn distances_are_those_of_a_dense_hull() {
        let outline = Outline { centres: [[10.0, 20.0], [17.0, 14.0]], radii: [5.0, 7.0] };
        // The hull of two circles is the union of all circles between them.
        let dense = |p: [f64; 2]| {
            (0..=2000)
                .map(|k| {
                    let t = f64::from(k) / 2000.0;
                    let c = [10.0 + 7.0 * t, 20.0 - 6.0 * t];
                    (p[0] - c[0]).hypot(p[1] - c[1]) - (5.0 + 2.0 * t)
                })
                .fold(f64::INFINITY, f64::min)
        };
        for p in [[0.0, 0.0], [30.0, 15.0], [12.0, 30.0], [8.0, 12.0], [25.0, 25.0], [10.0, 27.0]] {
            assert!((outline.distance(p) - dense(p)).abs() < 1e-3, "{p:?}");
        }
    }

    #[test]
    fn edges_on_a_shifted_outline_give_the_shift_and_its_covariance() {
        let pieces = Pieces::default();
        let outline = Outline::new(&tilted(), &pieces, Kind::Striker, [0.1, 0.15]).unwrap();
        let mut moved = outline;
        moved.shift([0.7, -0.4]);
        let middle = moved.middle();
        let mut edges = [Edge { pixel: [0.0; 2], direction: [0.0; 2] }; RAYS];
        for (k, edge) in edges.iter_mut().enumerate() {
            let (sin, cos) = (TAU * k as f64 / RAYS as f64).sin_cos();
            let mut far = [0.0, 40.0];
            for _ in 0..60 {
                let half = f64::midpoint(far[0], far[1]);
                let inside = moved.distance([middle[0] + half * cos, middle[1] + half * sin]) < 0.3;
                far[usize::from(!inside)] = half;
            }
            edge.pixel = [middle[0] + far[0] * cos, middle[1] + far[0] * sin];
        }
        // A quarter of the edges belongs to something else.
        for edge in &mut edges[5..13] {
            edge.pixel[0] += 5.0;
        }
        let found = solve(&edges, &outline).unwrap();
        let error = (found.shift[0] - 0.7).hypot(found.shift[1] + 0.4);
        assert!(error < 0.12 && (found.offset - 0.3).abs() < 0.1, "{found:?}");
        assert!((30..=36).contains(&found.inliers), "{found:?}");
        assert!(0.0 < found.covariance[0][0] && found.covariance[0][0] < 0.1);
    }

    #[test]
    fn edges_on_one_side_determine_nothing() {
        let outline = Outline { centres: [[50.0, 50.0]; 2], radii: [10.0; 2] };
        let edges = [Edge { pixel: [60.0, 50.0], direction: [1.0, 0.0] }; 5];
        assert!(solve(&edges, &outline).is_none());
    }
}
