//! Edges of the field in an image: where the colour changes across each side of the calibrated rectangle.
//!
//! A wall has several edges: its foot, which is that of the field, the end of its shadow, and its top. The innermost of
//! the strong ones is taken.

use super::{frame::View, model::CameraModel};

/// Points along each side.
const POINTS: usize = 32;
/// Distance from the corners that is left out (m): the arcs of the corners end there.
const CORNER_M: f64 = 0.05;
/// Largest distance of an edge from its calibrated place (pixels).
const REACH_PX: usize = 24;
/// Pixels on each side of an edge whose mean colours are compared.
const WIDTH_PX: usize = 4;
/// Smallest change of the colour at an edge (levels of Y, U and V): ten times the noise of a mean of four pixels.
const LEAST_STEP: f64 = 12.0;

/// Part of the strongest change that the edge of the field has at least.
const LEAST_PART: f64 = 0.5;
/// Number of points.
pub(super) const COUNT: usize = 4 * POINTS;

/// Point of an edge of the field.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct EdgePoint {
    /// Number of the place, below [`COUNT`].
    pub(super) place: usize,
    /// Side: x negative, x positive, y negative, y positive.
    pub(super) side: usize,
    /// Pixel of the calibrated edge.
    pub(super) pixel: [f64; 2],
    /// Unit vector out of the field in the image.
    pub(super) normal: [f64; 2],
    /// Distance of the measured edge from the calibrated one along `normal` (pixels).
    pub(super) offset: f64,
}

/// Find the edges of a field of half sides `half` (m). A place without a clear edge is left out.
pub(super) fn find_edges(view: &View<'_>, camera: &CameraModel, half: [f64; 2]) -> Vec<EdgePoint> {
    let mut found = Vec::with_capacity(COUNT);
    for side in 0..4 {
        let (axis, sign) = (side / 2, if side % 2 == 0 { -1.0 } else { 1.0 });
        let length = half[1 - axis] - CORNER_M;
        for k in 0..POINTS {
            let along = length * (2.0 * (k as f64 + 0.5) / POINTS as f64 - 1.0);
            let point = edge_at(view, camera, half, (side, axis, sign), along);
            found.extend(point.map(|own| EdgePoint { place: side * POINTS + k, ..own }));
        }
    }
    found
}

fn edge_at(
    view: &View<'_>,
    camera: &CameraModel,
    half: [f64; 2],
    (side, axis, sign): (usize, usize, f64),
    along: f64,
) -> Option<EdgePoint> {
    /// Step out of the field that gives the direction of the normal (m).
    const OUT_M: f64 = 1e-3;
    let mut place = [along; 3];
    (place[axis], place[2]) = (sign * half[axis], 0.0);
    let pixel = camera.project(place)?;
    place[axis] += sign * OUT_M;
    let out = camera.project(place)?;
    let length = (out[0] - pixel[0]).hypot(out[1] - pixel[1]);
    let normal = [0, 1].map(|k: usize| (out[k] - pixel[k]) / length);
    let offset = innermost_step(view, pixel, normal)?;
    Some(EdgePoint { place: 0, side, pixel, normal, offset })
}

/// Place of the first strong change of the colour on the way out of the field, to a fraction of a pixel.
fn innermost_step(view: &View<'_>, pixel: [f64; 2], normal: [f64; 2]) -> Option<f64> {
    const SAMPLES: usize = 2 * (REACH_PX + WIDTH_PX);
    const STEPS: usize = 2 * REACH_PX + 1;
    let mut colors = [[0.0; 3]; SAMPLES];
    for (k, color) in colors.iter_mut().enumerate() {
        let at = k as f64 + 0.5 - (SAMPLES / 2) as f64;
        let [column, row] = [0, 1].map(|axis: usize| (pixel[axis] + at * normal[axis]).round());
        let inside = 0.0 <= column
            && column < view.width_px as f64
            && 0.0 <= row
            && row < view.height_px as f64;
        *color = inside.then(|| view.yuv(column as usize, row as usize).map(f64::from))?;
    }
    let mut steps = [0.0; STEPS];
    for (k, step) in steps.iter_mut().enumerate() {
        let mean = |from: usize, channel: usize| {
            (from..from + WIDTH_PX).map(|at| colors[at][channel]).sum::<f64>() / WIDTH_PX as f64
        };
        let change = [0, 1, 2].map(|channel| mean(k + WIDTH_PX, channel) - mean(k, channel));
        *step = change.iter().map(|own| own * own).sum::<f64>().sqrt();
    }
    let least = LEAST_STEP.max(LEAST_PART * steps.iter().copied().fold(0.0, f64::max));
    let is_peak =
        |k: &usize| least <= steps[*k] && steps[*k - 1] <= steps[*k] && steps[*k + 1] <= steps[*k];
    let best = (1..STEPS - 1).find(is_peak)?;
    let [before, here, after] = [steps[best - 1], steps[best], steps[best + 1]];
    // Vertex of the parabola through the three values.
    let bend = before - 2.0 * here + after;
    let part = if bend < 0.0 { 0.5 * (before - after) / bend } else { 0.0 };
    Some(best as f64 - REACH_PX as f64 + part)
}
