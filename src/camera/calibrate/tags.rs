//! AprilTags of the family 36h11, ids 0 to 59, and ArUco markers.
//!
//! Dark regions of a local threshold give quadrilaterals; their sides are fitted to the brightness with sub-pixel
//! accuracy, and the cells (a dark border around n x n bits) are read through the homography of the corners.
//! Source: E. Olson, "AprilTag: A robust and flexible visual fiducial system", ICRA 2011; the codes are those of the
//! reference implementation, read row by row. Two codes of the family differ in at least 11 bits, so that up to 2
//! wrong bits are accepted safely.

use super::lens_fit::homography;
use crate::camera::frame::{Frame, View};

/// Codes of the ids 0 to 59: 36 bits, row by row from the top left, white is 1.
const CODES: [u64; 60] = [
    0x2_1a14_6bab,
    0x9_2d18_fe9b,
    0x7_0890_14bb,
    0x1_9397_9e27,
    0x4_4153_d3d7,
    0x3_5cd5_b8cf,
    0xa_10ba_56a0,
    0x2_b874_a608,
    0xb_57fb_8d44,
    0x4_e20b_5a64,
    0x6_1d89_7f2c,
    0xa_b346_9ffc,
    0x5_94ca_45c2,
    0xf_a1c2_d2e2,
    0x9_7c24_b972,
    0x7_5928_624a,
    0x1_caaf_e99a,
    0x3_236d_dc16,
    0x8_84e5_27d6,
    0x5_771a_8c7e,
    0xf_5292_5b81,
    0x2_e59c_c1a1,
    0x7_fa58_ab31,
    0xe_b433_84f9,
    0x3_913d_5345,
    0xd_79b1_a3b5,
    0x0_dfbe_768d,
    0x5_cd7a_031d,
    0xb_9c8f_7a4b,
    0x4_6987_e06b,
    0x6_e0c5_d527,
    0x5_bc56_7bb4,
    0x1_e630_2bc2,
    0x8_ac7d_046a,
    0xa_65fe_2326,
    0x5_400e_b616,
    0xf_7a06_6836,
    0x2_dd0a_fdf6,
    0x3_b9cb_60b1,
    0xa_d6a1_caf9,
    0x9_3b62_efb5,
    0xb_b210_d93d,
    0xd_ee55_094b,
    0xa_0cd1_479b,
    0x2_a23a_bb27,
    0x4_f67f_4b5f,
    0x5_8a81_5818,
    0x7_4342_7d64,
    0x1_dec4_0874,
    0x8_92ab_3a02,
    0x3_8d57_42ee,
    0x0_c435_67a1,
    0x5_db31_1cb1,
    0xc_957c_a1f9,
    0xa_2245_7823,
    0x2_9ace_98f3,
    0xc_cc52_c528,
    0xd_a8b3_578c,
    0xd_5b4b_9e36,
    0xa_c9cd_d3ce,
];
/// Cells along a side of an AprilTag, without the dark border.
const CELLS: usize = 6;
/// Most cells along a side, with the dark border.
const MOST_CELLS: usize = 8;
/// Wrong bits that are accepted.
const MAX_WRONG_BITS: u32 = 2;
/// Window of the local threshold as a fraction of the image's width.
const WINDOW_FRACTION: f64 = 0.04;
/// Brightness below the local mean that counts as dark (levels).
const DARKER_BY: f64 = 12.0;
/// Fewest and most pixels of a dark region.
const REGION_PIXELS: [usize; 2] = [100, 40_000];

/// Family of square markers with a dark border of one cell.
#[derive(Debug, Clone)]
pub(super) struct Family {
    /// Cells along a side, without the border; at most 6.
    pub(super) cells: usize,
    /// Cells of each marker, row by row from the top left, white is 1.
    pub(super) codes: Vec<u64>,
    /// Wrong cells that are accepted.
    pub(super) wrong_cells: u32,
}

/// AprilTag or other marker in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tag {
    /// Number of the tag.
    pub id: u32,
    /// Outer corners of the dark border (pixels): top left, top right, bottom right, bottom left of the tag.
    pub corners: [[f64; 2]; 4],
    /// Centre: where the diagonals meet (pixels).
    pub centre: [f64; 2],
}

/// Find the AprilTags of an image, by id.
#[must_use]
pub fn find_tags(frame: &Frame) -> Vec<Tag> {
    let family = Family { cells: CELLS, codes: CODES.to_vec(), wrong_cells: MAX_WRONG_BITS };
    find_markers(frame, &family)
}

/// Find the markers of a family in an image, by id.
pub(super) fn find_markers(frame: &Frame, family: &Family) -> Vec<Tag> {
    let view = frame.view();
    let dark = threshold(&view);
    let mut tags: Vec<Tag> = regions(&dark, view.width_px)
        .iter()
        .filter_map(|region| read_tag(&view, &quadrilateral(region)?, family))
        .collect();
    tags.sort_by_key(|tag| tag.id);
    tags
}

/// Pixels that are darker than the mean of their surroundings.
fn threshold(view: &View<'_>) -> Vec<bool> {
    let (width, height) = (view.width_px, view.height_px);
    let stride = width + 1;
    let mut integral = vec![0_u64; stride * (height + 1)];
    for row in 0..height {
        let mut sum = 0;
        for column in 0..width {
            sum += u64::from(view.yuv(column, row)[0]);
            integral[(row + 1) * stride + column + 1] = integral[row * stride + column + 1] + sum;
        }
    }
    let half = (WINDOW_FRACTION * width as f64 / 2.0).ceil() as usize;
    let mut dark = vec![false; width * height];
    for row in 0..height {
        let (top, bottom) = (row.saturating_sub(half), (row + half + 1).min(height));
        for column in 0..width {
            let (left, right) = (column.saturating_sub(half), (column + half + 1).min(width));
            let sum = integral[bottom * stride + right] + integral[top * stride + left]
                - integral[top * stride + right]
                - integral[bottom * stride + left];
            let mean = sum as f64 / ((bottom - top) * (right - left)) as f64;
            dark[row * width + column] = f64::from(view.yuv(column, row)[0]) < mean - DARKER_BY;
        }
    }
    dark
}

/// Connected dark regions of a fitting size.
fn regions(dark: &[bool], width: usize) -> Vec<Vec<[f64; 2]>> {
    let mut seen = vec![false; dark.len()];
    let mut found = Vec::new();
    for start in 0..dark.len() {
        if seen[start] || !dark[start] {
            continue;
        }
        let mut stack = vec![start];
        let mut pixels = Vec::new();
        seen[start] = true;
        while let Some(at) = stack.pop() {
            pixels.push([(at % width) as f64, (at / width) as f64]);
            let column = at % width;
            let beside = [
                (0 < column).then(|| at - 1),
                (column + 1 < width).then(|| at + 1),
                at.checked_sub(width),
                Some(at + width).filter(|own| *own < dark.len()),
            ];
            for next in beside.into_iter().flatten() {
                if dark[next] && !seen[next] {
                    seen[next] = true;
                    stack.push(next);
                }
            }
        }
        if (REGION_PIXELS[0]..=REGION_PIXELS[1]).contains(&pixels.len()) {
            found.push(pixels);
        }
    }
    found
}

fn farthest(pixels: &[[f64; 2]], score: impl Fn([f64; 2]) -> f64) -> Option<[f64; 2]> {
    pixels.iter().copied().max_by(|a, b| score(*a).total_cmp(&score(*b)))
}

/// Corners of a region that may be a quadrilateral, clockwise in the image.
fn quadrilateral(pixels: &[[f64; 2]]) -> Option<[[f64; 2]; 4]> {
    let count = pixels.len() as f64;
    let mean = [0, 1].map(|axis: usize| pixels.iter().map(|p| p[axis]).sum::<f64>() / count);
    let distance = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
    let a = farthest(pixels, |p| distance(p, mean))?;
    let c = farthest(pixels, |p| distance(p, a))?;
    let side = |p: [f64; 2]| (c[0] - a[0]) * (p[1] - a[1]) - (c[1] - a[1]) * (p[0] - a[0]);
    let b = farthest(pixels, |p| -side(p))?;
    let d = farthest(pixels, side)?;
    let length = distance(a, c);
    // Both other corners lie well off the diagonal.
    (0.2 * length < -side(b) / length && 0.2 * length < side(d) / length).then_some([a, b, c, d])
}

/// Fit the sides of a quadrilateral to the brightness and read its bits.
fn read_tag(view: &View<'_>, rough: &[[f64; 2]; 4], family: &Family) -> Option<Tag> {
    let count = family.cells + 2;
    let corners = fit_sides(view, rough)?;
    let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let h = homography(&unit, &corners)?;
    let level = |column: usize, row: usize| {
        let at = |cell: usize| (cell as f64 + 0.5) / count as f64;
        view.luma_at(apply(&h, [at(column), at(row)])?)
    };
    let mut levels = [[0.0; MOST_CELLS]; MOST_CELLS];
    for (row, line) in levels.iter_mut().enumerate().take(count) {
        for (column, own) in line.iter_mut().enumerate().take(count) {
            *own = level(column, row)?;
        }
    }
    let is_border = |column: usize, row: usize| {
        [0, count - 1].contains(&column) || [0, count - 1].contains(&row)
    };
    let cells = || (0..count * count).map(|cell| (cell % count, cell / count));
    let border: Vec<f64> = cells()
        .filter(|own| is_border(own.0, own.1))
        .map(|(column, row)| levels[row][column])
        .collect();
    let dark = border.iter().sum::<f64>() / border.len() as f64;
    let brightest = cells().map(|(column, row)| levels[row][column]).fold(0.0, f64::max);
    let middle = f64::midpoint(dark, brightest);
    if brightest - dark < 2.0 * DARKER_BY || border.iter().any(|own| middle < *own) {
        return None;
    }
    let (id, turns) = (0..4_usize).find_map(|turns| {
        let mut code = 0_u64;
        for (column, row) in cells().filter(|own| !is_border(own.0, own.1)) {
            let (c, r) = (0..turns).fold((column, row), |(c, r), _| (count - 1 - r, c));
            code = (code << 1) | u64::from(middle < levels[r][c]);
        }
        let is_own = |own: &u64| (own ^ code).count_ones() <= family.wrong_cells;
        let id = family.codes.iter().position(is_own)?;
        Some((id, turns))
    })?;
    let corners = [0, 1, 2, 3].map(|k| corners[(k + turns) % 4]);
    Some(Tag { id: id as u32, corners, centre: apply(&homography(&unit, &corners)?, [0.5, 0.5])? })
}

pub(super) fn apply(h: &[[f64; 3]; 3], [x, y]: [f64; 2]) -> Option<[f64; 2]> {
    let [u, v, w] = [0, 1, 2].map(|row| h[row][0] * x + h[row][1] * y + h[row][2]);
    (1e-9 < w.abs()).then(|| [u / w, v / w])
}

/// Lines through the edge points of each side, and their intersections.
fn fit_sides(view: &View<'_>, rough: &[[f64; 2]; 4]) -> Option<[[f64; 2]; 4]> {
    let mut lines = [([0.0; 2], 0.0); 4];
    for (k, line) in lines.iter_mut().enumerate() {
        *line = fit_side(view, rough[k], rough[(k + 1) % 4])?;
    }
    let mut corners = [[0.0; 2]; 4];
    for (k, corner) in corners.iter_mut().enumerate() {
        let ((n1, d1), (n2, d2)) = (lines[(k + 3) % 4], lines[k]);
        let determinant = n1[0] * n2[1] - n1[1] * n2[0];
        if determinant.abs() < 0.1 {
            return None;
        }
        *corner =
            [(d1 * n2[1] - d2 * n1[1]) / determinant, (n1[0] * d2 - n2[0] * d1) / determinant];
        if 4.0 < (corner[0] - rough[k][0]).hypot(corner[1] - rough[k][1]) {
            return None;
        }
    }
    Some(corners)
}

/// Line `n . p = d` through the places where the brightness is half way between inside and outside.
fn fit_side(view: &View<'_>, a: [f64; 2], b: [f64; 2]) -> Option<([f64; 2], f64)> {
    const SAMPLES: usize = 24;
    let length = (b[0] - a[0]).hypot(b[1] - a[1]);
    // Clockwise in the image: outside is to the left of the side.
    let normal = [(b[1] - a[1]) / length, -(b[0] - a[0]) / length];
    let reach = (length / 16.0).clamp(1.5, 4.0);
    let mut points = Vec::with_capacity(SAMPLES);
    for k in 0..SAMPLES {
        let t = 0.08 + 0.84 * (k as f64 + 0.5) / SAMPLES as f64;
        let middle = [0, 1].map(|axis| a[axis] + t * (b[axis] - a[axis]));
        let at = |offset: f64| [0, 1].map(|axis| middle[axis] + offset * normal[axis]);
        let (Some(inside), Some(outside)) =
            (view.luma_at(at(-reach)), view.luma_at(at(reach + 1.0)))
        else {
            continue;
        };
        let half = f64::midpoint(inside, outside);
        if outside < inside + DARKER_BY {
            continue;
        }
        let steps = (4.0 * (2.0 * reach + 1.0)) as i32;
        let mut before = inside;
        for step in 1..=steps {
            let offset = -reach + 0.25 * f64::from(step);
            let now = view.luma_at(at(offset))?;
            if before < half && half <= now {
                points.push(at(offset - 0.25 * (now - half) / (now - before)));
                break;
            }
            before = now;
        }
    }
    (SAMPLES / 2 <= points.len()).then(|| total_least_squares(&points))
}

fn total_least_squares(points: &[[f64; 2]]) -> ([f64; 2], f64) {
    let count = points.len() as f64;
    let mean = [0, 1].map(|axis: usize| points.iter().map(|p| p[axis]).sum::<f64>() / count);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = [p[0] - mean[0], p[1] - mean[1]];
        xx += d[0] * d[0];
        yy += d[1] * d[1];
        xy += d[0] * d[1];
    }
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let normal = [-angle.sin(), angle.cos()];
    (normal, normal[0] * mean[0] + normal[1] * mean[1])
}
