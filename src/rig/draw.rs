//! Frames of the virtual rig, drawn by ray casting: the table as a camera sees it.
//!
//! A pinhole with radial distortion looks down on a blue field with white lines, dark cups and wooden walls. Ball,
//! strikers and biscuits are a sphere and cylinders with shading and motion blur: each of the 16 rays of a pixel has
//! its own moment within the exposure. There is no perspective or colour code in common with the detector of this
//! crate, so that a match on drawn frames tests it.

use crate::{
    board::{BALL_RADIUS, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    seed::Stream,
    units::Nanos,
};

/// Columns of a drawn frame.
pub const WIDTH_PX: usize = 1280;
/// Rows of a drawn frame.
pub const HEIGHT_PX: usize = 720;
/// Focal length (pixels).
pub const FOCAL_PX: f64 = 1150.0;
/// Principal point (column and row, pixels).
pub const PRINCIPAL_POINT_PX: [f64; 2] = [640.0, 360.0];
/// Radial distortion of second order.
pub const K1: f64 = -0.1;
/// Height of the camera above the middle of the field (m). Columns run along y of the board, rows along x.
pub const CAMERA_HEIGHT: f64 = 0.65;
/// Height of a striker (m).
pub const STRIKER_HEIGHT: f64 = 0.025;
/// Rays along one side of a pixel.
const RAYS: usize = 4;
/// Standard deviation of the noise of a level (0 to 255).
const NOISE_LEVELS: f64 = 1.5;
/// Entries of the table of noise.
const NOISE_ENTRIES: usize = 1 << 16;

const BLUE: [f64; 3] = [35.0, 65.0, 130.0];
const WHITE: [f64; 3] = [205.0, 205.0, 200.0];
const CUP: [f64; 3] = [14.0, 14.0, 16.0];
const WOOD: [f64; 3] = [120.0, 88.0, 55.0];
const ORANGE: [f64; 3] = [235.0, 155.0, 25.0];
const BLACK: [f64; 3] = [16.0, 16.0, 18.0];

/// Positions and velocities in the middle of an exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scene {
    /// Middle of the exposure, or the time stamp that the camera gives.
    pub capture_time: Nanos,
    /// Exposure time (s).
    pub exposure_s: f64,
    /// Motion of the camera parallel to the board since its calibration (m).
    pub camera_shift: [f64; 2],
    /// Position (m) and velocity (m/s) of the ball.
    pub ball: Option<([f64; 2], [f64; 2])>,
    /// The same of the two strikers.
    pub strikers: [([f64; 2], [f64; 2]); 2],
}

/// Body that a ray can hit.
#[derive(Debug, Clone, Copy)]
struct Body {
    /// Position relative to the camera (m).
    position: [f64; 2],
    velocity: [f64; 2],
    radius: f64,
    /// Height of a cylinder; `None` for a sphere on the field.
    height: Option<f64>,
    color: [f64; 3],
}

/// Columns and rows of a rectangle of pixels: first, and one after the last.
type Window = [[usize; 2]; 2];

#[derive(Debug, Clone, Copy)]
struct Pixel {
    column: usize,
    row: usize,
}

/// Two neighbours in a row, which share their colour in YUYV.
type Pair = [Pixel; 2];

/// Draws frames as YUYV.
#[derive(Debug, Clone)]
pub struct Artist {
    half_field: [f64; 2],
    /// Place of the camera above the board (m).
    eye: [f64; 2],
    /// Directions of the corners of all pixels, row by row.
    corners: Vec<[f64; 2]>,
    background: Vec<u8>,
    frame: Vec<u8>,
    noise: Vec<i8>,
    drawn: usize,
}

impl Artist {
    /// Draw the empty table of half sides `half_field` (m).
    #[must_use]
    pub fn new(half_field: [f64; 2], seed: u64) -> Self {
        let mut stream = Stream::new(seed, "rig.camera.pixels");
        let mut draw = || {
            let sum: f32 = (0..12).map(|_| stream.uniform_f32(-0.5, 0.5)).sum();
            (f64::from(sum) * NOISE_LEVELS).round() as i8
        };
        let noise = (0..NOISE_ENTRIES).map(|_| draw()).collect();
        let mut artist = Self {
            half_field,
            eye: [0.0; 2],
            corners: corners(),
            background: vec![0; WIDTH_PX * HEIGHT_PX * 2],
            frame: vec![0; WIDTH_PX * HEIGHT_PX * 2],
            noise,
            drawn: 0,
        };
        artist.paint_background();
        artist
    }

    fn paint_background(&mut self) {
        let empty = |artist: &Self, pair: Pair| Some(pair.map(|pixel| artist.empty(pixel)));
        self.paint([[0, WIDTH_PX], [0, HEIGHT_PX]], empty);
        self.background.clone_from(&self.frame);
    }

    /// Draw a scene; the bytes are YUYV, row by row.
    pub fn draw(&mut self, scene: &Scene) -> &[u8] {
        if self.eye != scene.camera_shift {
            self.eye = scene.camera_shift;
            self.paint_background();
        }
        self.frame.clone_from(&self.background);
        self.drawn += 1;
        let eye = self.eye;
        let seen = |[x, y]: [f64; 2]| [x - eye[0], y - eye[1]];
        let striker = |(position, velocity)| Body {
            position: seen(position),
            velocity,
            radius: STRIKER_RADIUS,
            height: Some(STRIKER_HEIGHT),
            color: BLACK,
        };
        let ball = scene.ball.map(|(position, velocity)| Body {
            position: seen(position),
            velocity,
            radius: BALL_RADIUS,
            height: None,
            color: ORANGE,
        });
        let mut bodies: Vec<Body> = scene.strikers.into_iter().map(striker).collect();
        bodies.extend(ball);
        let windows: Vec<_> = bodies.iter().map(|body| window(body, scene.exposure_s)).collect();
        for own in &windows {
            let near: Vec<Body> = (windows.iter().zip(&bodies))
                .filter_map(|(other, body)| overlap(own, other).then_some(*body))
                .collect();
            self.paint(*own, |artist, pair| {
                let seen = pair.map(|pixel| artist.seen(pixel, &near, scene.exposure_s));
                let color = |side: usize| seen[side].unwrap_or_else(|| artist.empty(pair[side]));
                (seen != [None; 2]).then(|| [color(0), color(1)])
            });
        }
        &self.frame
    }

    /// Paint the pairs of pixels of a window to which `colors` gives some; the others keep theirs.
    fn paint(
        &mut self,
        [columns, rows]: Window,
        colors: impl Fn(&Self, Pair) -> Option<[[f64; 3]; 2]>,
    ) {
        let mut at = self.drawn.wrapping_mul(7919);
        for row in rows[0]..rows[1] {
            for pair in columns[0] / 2..columns[1] / 2 {
                let pixels = [0, 1].map(|side| Pixel { column: 2 * pair + side, row });
                let Some(both) = colors(self, pixels) else { continue };
                let both = both.map(yuv);
                let mut level = |value: f64| {
                    at = (at + 1) % NOISE_ENTRIES;
                    (value + f64::from(self.noise[at])).round().clamp(0.0, 255.0) as u8
                };
                let mean = |k: usize| f64::midpoint(both[0][k], both[1][k]);
                let bytes = [level(both[0][0]), level(mean(1)), level(both[1][0]), level(mean(2))];
                let place = (row * WIDTH_PX + 2 * pair) * 2;
                self.frame[place..place + 4].copy_from_slice(&bytes);
            }
        }
    }

    /// Directions of the rays of a pixel. Within it they are bilinear in its corners.
    fn rays(&self, Pixel { column, row }: Pixel) -> [[f64; 2]; RAYS * RAYS] {
        let corner = |right: usize, down: usize| {
            self.corners[(row + down) * (WIDTH_PX + 1) + column + right]
        };
        let corners = [[corner(0, 0), corner(1, 0)], [corner(0, 1), corner(1, 1)]];
        let part = |ray: usize| (ray as f64 + 0.5) / RAYS as f64;
        let between = |from: [f64; 2], to: [f64; 2], part: f64| {
            [0, 1].map(|axis| from[axis] + part * (to[axis] - from[axis]))
        };
        std::array::from_fn(|ray| {
            let [above, below] =
                corners.map(|[left, right]| between(left, right, part(ray % RAYS)));
            between(above, below, part(ray / RAYS))
        })
    }

    /// Mean colour of a pixel in which a ray meets a body.
    fn seen(&self, pixel: Pixel, bodies: &[Body], exposure_s: f64) -> Option<[f64; 3]> {
        let rays = self.rays(pixel);
        let met: [_; RAYS * RAYS] = std::array::from_fn(|ray| {
            // The moments are spread over the pixel, so that they do not follow its columns.
            let moment = ((ray * 7) % (RAYS * RAYS)) as f64 + 0.5;
            let time = exposure_s * (moment / (RAYS * RAYS) as f64 - 0.5);
            nearest(rays[ray], bodies, time)
        });
        let color = |ray: usize| met[ray].unwrap_or_else(|| self.table(rays[ray]));
        met.iter().any(Option::is_some).then(|| mean(std::array::from_fn(color)))
    }

    /// Mean colour of a pixel of the empty table.
    fn empty(&self, pixel: Pixel) -> [f64; 3] {
        mean(self.rays(pixel).map(|direction| self.table(direction)))
    }

    /// Colour of the empty table on a ray from the camera; `direction` is per metre downwards.
    fn table(&self, direction: [f64; 2]) -> [f64; 3] {
        const LINE: f64 = 0.00125;
        let [x, y] = [0, 1].map(|axis| self.eye[axis] + direction[axis] * CAMERA_HEIGHT);
        if self.half_field[0] < x.abs() || self.half_field[1] < y.abs() {
            return WOOD;
        }
        let to_cup = x.hypot(y.abs() - CUP_DISTANCE);
        let to_corner = (x.abs() - self.half_field[0]).hypot(y.abs() - self.half_field[1]);
        let is_line = y.abs() < LINE
            || (x.hypot(y) - 0.045).abs() < LINE
            || (to_cup - CUP_RADIUS - 0.003).abs() < LINE
            || (to_corner - 0.04).abs() < LINE;
        if to_cup < CUP_RADIUS {
            CUP
        } else if is_line {
            WHITE
        } else {
            // Uneven light, so that no colour is exactly that of another place.
            let light = 1.0 + 0.06 * (17.0 * x).sin() * (11.0 * y).cos();
            BLUE.map(|own| own * light)
        }
    }
}

/// Colour of the first body on a ray from the camera.
fn nearest(direction: [f64; 2], bodies: &[Body], time: f64) -> Option<[f64; 3]> {
    let hits = bodies.iter().filter_map(|body| hit(body, direction, time));
    hits.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, color)| color)
}

fn mean(colors: [[f64; 3]; RAYS * RAYS]) -> [f64; 3] {
    let sum = colors.into_iter().fold([0.0; 3], |sum, own| [0, 1, 2].map(|k| sum[k] + own[k]));
    sum.map(|own| own / (RAYS * RAYS) as f64)
}

/// Distance along a ray (m of depth) to a body, and the colour there.
fn hit(body: &Body, direction: [f64; 2], time: f64) -> Option<(f64, [f64; 3])> {
    let centre = [0, 1].map(|axis| body.position[axis] + time * body.velocity[axis]);
    let Some(height) = body.height else {
        // |t d - c|^2 = r^2 with d = (dx, dy, 1) and the centre at depth H - r
        let depth = CAMERA_HEIGHT - body.radius;
        let a = direction[0] * direction[0] + direction[1] * direction[1] + 1.0;
        let b = direction[0] * centre[0] + direction[1] * centre[1] + depth;
        let c = centre[0] * centre[0] + centre[1] * centre[1] + depth * depth
            - body.radius * body.radius;
        let root = (b * b - a * c).max(-1.0);
        if root < 0.0 {
            return None;
        }
        let t = (b - root.sqrt()) / a;
        let normal = [t * direction[0] - centre[0], t * direction[1] - centre[1], depth - t];
        let lit = (0.3 * normal[0] - 0.2 * normal[1] + 0.93 * normal[2]) / body.radius;
        return Some((t, body.color.map(|own| own * (0.45 + 0.55 * lit.max(0.0)))));
    };
    let top = CAMERA_HEIGHT - height;
    let at = |t: f64| [t * direction[0] - centre[0], t * direction[1] - centre[1]];
    let [x, y] = at(top);
    if x.hypot(y) < body.radius {
        return Some((top, body.color));
    }
    let a = direction[0] * direction[0] + direction[1] * direction[1];
    let b = direction[0] * centre[0] + direction[1] * centre[1];
    let c = centre[0] * centre[0] + centre[1] * centre[1] - body.radius * body.radius;
    let root = b * b - a * c;
    if root < 0.0 || a < 1e-12 {
        return None;
    }
    let t = (b - root.sqrt()) / a;
    (top < t && t < CAMERA_HEIGHT).then(|| (t, body.color.map(|own| own * 0.8)))
}

/// Direction of a pixel, per metre downwards: x and y of the board.
fn direction(pixel: [f64; 2]) -> [f64; 2] {
    let seen = [0, 1].map(|axis| (pixel[axis] - PRINCIPAL_POINT_PX[axis]) / FOCAL_PX);
    let radius = seen[0].hypot(seen[1]);
    let mut ray = radius;
    for _ in 0..8 {
        ray = radius / (1.0 + K1 * ray * ray);
    }
    let scale = if 0.0 < radius { ray / radius } else { 1.0 };
    // Columns run along y of the board, rows along x.
    [seen[1] * scale, seen[0] * scale]
}

/// Directions of the corners of all pixels, row by row: one more in each row and column than pixels.
fn corners() -> Vec<[f64; 2]> {
    let row = |row: usize| {
        (0..=WIDTH_PX).map(move |column| direction([column as f64 - 0.5, row as f64 - 0.5]))
    };
    (0..=HEIGHT_PX).flat_map(row).collect()
}

fn overlap(a: &Window, b: &Window) -> bool {
    (0..2).all(|axis| a[axis][0] < b[axis][1] && b[axis][0] < a[axis][1])
}

/// Columns and rows that a body can cover.
fn window(body: &Body, exposure_s: f64) -> Window {
    let reach = body.radius + exposure_s * body.velocity[0].hypot(body.velocity[1]);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for height in [0.0, body.height.unwrap_or(2.0 * body.radius)] {
        for (dx, dy) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)] {
            let depth = CAMERA_HEIGHT - height;
            let ray =
                [(body.position[1] + dy * reach) / depth, (body.position[0] + dx * reach) / depth];
            let bent = 1.0 + K1 * (ray[0] * ray[0] + ray[1] * ray[1]);
            for axis in 0..2 {
                let pixel = FOCAL_PX * ray[axis] * bent + PRINCIPAL_POINT_PX[axis];
                low[axis] = low[axis].min(pixel - 3.0);
                high[axis] = high[axis].max(pixel + 4.0);
            }
        }
    }
    let end = [WIDTH_PX, HEIGHT_PX];
    [0, 1].map(|axis| {
        let clamp = |value: f64| value.clamp(0.0, end[axis] as f64) as usize;
        [clamp(low[axis]) & !1, clamp(high[axis])]
    })
}

/// Y, U, V of BT.601 with full range.
fn yuv([r, g, b]: [f64; 3]) -> [f64; 3] {
    let y = 0.299 * r + 0.587 * g + 0.114 * b;
    [y, 128.0 + 0.564 * (b - y), 128.0 + 0.713 * (r - y)]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(ball: ([f64; 2], [f64; 2]), exposure_s: f64) -> Scene {
        let strikers = [([0.0, -0.1], [0.0; 2]), ([0.0, 0.1], [0.0; 2])];
        Scene {
            capture_time: Nanos(0),
            exposure_s,
            camera_shift: [0.0; 2],
            ball: Some(ball),
            strikers,
        }
    }

    /// Mean column and row of the pixels with little blue for their brightness, which only the ball has, and their
    /// number.
    fn orange(bytes: &[u8]) -> ([f64; 2], usize) {
        let orange = bytes.chunks_exact(4).enumerate().filter(|(_, own)| own[1] < 95);
        let (mut sum, mut count) = ([0.0; 2], 0);
        for (pair, _) in orange {
            sum[0] += (2 * pair % WIDTH_PX) as f64 + 0.5;
            sum[1] += (2 * pair / WIDTH_PX) as f64;
            count += 1;
        }
        (sum.map(|own| own / count as f64), count)
    }

    #[test]
    fn the_ball_is_where_the_pinhole_puts_it_and_motion_blurs_it() {
        let mut artist = Artist::new([0.16, 0.21], 0);
        let (middle, count) = orange(artist.draw(&scene(([0.05, 0.08], [0.0; 2]), 0.004)));
        let depth = CAMERA_HEIGHT - BALL_RADIUS;
        let ray = [0.08 / depth, 0.05 / depth];
        let bent = 1.0 + K1 * (ray[0] * ray[0] + ray[1] * ray[1]);
        for axis in 0..2 {
            let expected = FOCAL_PX * ray[axis] * bent + PRINCIPAL_POINT_PX[axis];
            assert!((middle[axis] - expected).abs() < 0.6, "{middle:?} {axis} {expected}");
        }
        let (moving, blurred) = orange(artist.draw(&scene(([0.05, 0.08], [1.5, 0.0]), 0.004)));
        assert!((moving[0] - middle[0]).hypot(moving[1] - middle[1]) < 0.6);
        assert_ne!(count, blurred);
    }
}
