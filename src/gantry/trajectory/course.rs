//! Velocities of the patterns on the control grid, before placement in a workspace.

use super::{Heading, Pattern, Slope, TrajectoryError, Turn, walk, waves};
use crate::gantry::{Limits, Rectangle};

/// Fraction of the slew limit available to a circle's centripetal acceleration; the rest is for
/// starting and stopping.
const CIRCLE_FRACTION: f64 = 0.95;

/// Constraints and sampling of a course.
pub(super) struct Grid<'a> {
    /// Allowed area.
    pub(super) workspace: &'a Rectangle,
    /// Limits of the motion.
    pub(super) limits: &'a Limits,
    /// Commands per second (Hz).
    pub(super) rate: f64,
    /// Number of commands.
    pub(super) samples: usize,
    /// Seed of the random numbers.
    pub(super) seed: u64,
}

impl Grid<'_> {
    pub(super) fn dt(&self) -> f64 {
        1.0 / self.rate
    }

    /// Return the largest acceleration (m/s^2) along `unit` with each axis within the slew limit.
    fn acceleration(&self, unit: [f64; 2]) -> f64 {
        self.limits.slew_m_per_s2 / unit[0].abs().max(unit[1].abs())
    }
}

/// Velocities (m/s) and start point (m).
pub(super) struct Course {
    pub(super) start: [f64; 2],
    pub(super) velocities: Vec<[f64; 2]>,
}

impl Course {
    /// Bring both ends to rest within the slew limit. The start point puts the centre of the path's
    /// bounding box at the workspace's centre.
    fn centred(mut velocities: Vec<[f64; 2]>, grid: &Grid<'_>) -> Self {
        settle(&mut velocities, grid.limits.slew_m_per_s2 * grid.dt());
        let (mut place, mut low, mut high) = ([0.0_f64; 2], [0.0_f64; 2], [0.0_f64; 2]);
        for velocity in &velocities {
            for axis in 0..2 {
                place[axis] += velocity[axis] * grid.dt();
                low[axis] = low[axis].min(place[axis]);
                high[axis] = high[axis].max(place[axis]);
            }
        }
        let centre = grid.workspace.centre();
        let start = [0, 1].map(|axis| centre[axis] - f64::midpoint(low[axis], high[axis]));
        Self { start, velocities }
    }
}

/// Limit `|v[k]|` to `k step` from both ends. The minimum of two sequences within the slew limit is
/// within it as well.
fn settle(velocities: &mut [[f64; 2]], step: f64) {
    let last = velocities.len().saturating_sub(1);
    for (index, velocity) in velocities.iter_mut().enumerate() {
        let top = index.min(last - index) as f64 * step;
        *velocity = velocity.map(|part| part.clamp(-top, top));
    }
}

fn along(unit: [f64; 2], speeds: &[f64]) -> Vec<[f64; 2]> {
    speeds.iter().map(|speed| unit.map(|part| part * speed)).collect()
}

/// Create the course of `pattern`, whose parameters were checked.
pub(super) fn course(pattern: &Pattern, grid: &Grid<'_>) -> Result<Course, TrajectoryError> {
    let speed = pattern.speed();
    let there_and_back = |heading: Heading, length: f64, rate: Option<f64>| {
        let unit = heading.vector();
        let rate = rate.unwrap_or_else(|| grid.acceleration(unit));
        let strokes = strokes(pattern.name(), [speed, rate, length], grid)?;
        Ok(Course::centred(along(unit, &strokes), grid))
    };
    match *pattern {
        Pattern::Circle { radius_m, turn, .. } => circle(radius_m, speed, turn, grid),
        Pattern::Diagonal { slope: Slope::Up, length_m, .. } => {
            there_and_back(Heading::Up, length_m, None)
        }
        Pattern::Diagonal { slope: Slope::Down, length_m, .. } => {
            there_and_back(Heading::Down, length_m, None)
        }
        Pattern::XLine { length_m, .. } => there_and_back(Heading::X, length_m, None),
        Pattern::YLine { length_m, .. } => there_and_back(Heading::Y, length_m, None),
        Pattern::Ramp { heading, length_m, rate_m_per_s2: rate, .. } => {
            let largest = grid.acceleration(heading.vector());
            if largest < rate {
                let (pattern, key) = (pattern.name(), "rate_m_per_s2");
                return Err(TrajectoryError::TooAbrupt { pattern, key, value: rate, largest });
            }
            there_and_back(heading, length_m, Some(rate))
        }
        Pattern::Creep { heading, period_s, .. } => {
            let unit = heading.vector();
            let rate = (4.0 * speed / period_s).min(grid.acceleration(unit));
            let strokes = strokes(pattern.name(), [speed, rate, 0.0], grid)?;
            Ok(Course::centred(along(unit, &strokes), grid))
        }
        Pattern::StepLadder { heading, levels, hold_s, .. } => {
            let unit = heading.vector();
            let speeds = ladder(speed, levels, hold_s, grid.acceleration(unit), grid);
            Ok(Course::centred(along(unit, &speeds), grid))
        }
        Pattern::Chirp { heading, .. } => {
            let speeds = waves::chirp(pattern, grid)?;
            Ok(Course::centred(along(heading.vector(), &speeds), grid))
        }
        Pattern::Multisine { .. } => Ok(Course::centred(waves::multisine(pattern, grid)?, grid)),
        Pattern::RandomWalk { speed_m_per_s, hold_min_s, hold_max_s } => {
            Ok(walk::walk(speed_m_per_s, [hold_min_s, hold_max_s], grid))
        }
    }
}

/// Return the speeds of strokes back and forth: from rest at `rate` (m/s^2) to `speed` (m/s), held
/// as far as `length` (m) allows, and back to rest. Length 0 holds the speed for one period and is
/// not checked.
fn strokes(
    pattern: &'static str,
    [speed, rate, length]: [f64; 3],
    grid: &Grid<'_>,
) -> Result<Vec<f64>, TrajectoryError> {
    let dt = grid.dt();
    let rising = (speed / (rate * dt)).ceil().max(1.0) as usize;
    let rising = rising.min(grid.samples);
    let up: Vec<f64> = (0..rising).map(|k| (k as f64 * rate * dt).min(speed)).collect();
    let shortest = 2.0 * up.iter().sum::<f64>() * dt + speed * dt;
    if 0.0 < length && length < shortest {
        let smallest = (shortest * 1e4).ceil() / 1e4;
        return Err(TrajectoryError::TooShort { pattern, length, speed, smallest });
    }
    let held = 1 + ((length - shortest).max(0.0) / (speed * dt)) as usize;
    let held = held.min(grid.samples);
    let mut stroke = up.clone();
    stroke.extend(std::iter::repeat_n(speed, held));
    stroke.extend(up.iter().skip(1).rev());
    let back: Vec<f64> = stroke.iter().map(|speed| -speed).collect();
    Ok(stroke.into_iter().chain(back).cycle().take(grid.samples).collect())
}

/// Return the speeds of pulses forward and backward from rest, each held for `hold` (s) with an
/// equal rest after it, at `levels` speeds up to `top` (m/s).
fn ladder(top: f64, levels: u32, hold: f64, rate: f64, grid: &Grid<'_>) -> Vec<f64> {
    let step = rate * grid.dt();
    let slope = (top / step).ceil() as usize + 1;
    // A pulse returns to rest before the next one, so that both directions cover equal distances.
    let held = ((hold * grid.rate).round() as usize).max(slope);
    let mut wanted = (0..grid.samples).map(|index| {
        let (phase, level) = (index / held % 4, index / held / 4 % levels as usize);
        let speed = top * (level + 1) as f64 / f64::from(levels);
        match phase {
            0 => speed,
            2 => -speed,
            _ => 0.0,
        }
    });
    let mut now = 0.0_f64;
    let mut speeds = vec![0.0];
    speeds.extend(wanted.by_ref().take(grid.samples - 1).map(|wanted| {
        now = wanted.clamp(now - step, now + step);
        now
    }));
    speeds
}

/// Circle around the workspace's centre from rest to rest; every sample lies on the circle.
fn circle(radius: f64, speed: f64, turn: Turn, grid: &Grid<'_>) -> Result<Course, TrajectoryError> {
    let (slew, dt) = (grid.limits.slew_m_per_s2, grid.dt());
    let largest = (CIRCLE_FRACTION * slew * radius).sqrt();
    if largest < speed {
        let (pattern, key) = ("circle", "speed_m_per_s");
        let largest = (largest * 1e4).floor() / 1e4;
        return Err(TrajectoryError::TooAbrupt { pattern, key, value: speed, largest });
    }
    let inward = speed * speed / radius;
    let gain = (slew * slew - inward * inward).sqrt().min(slew / 2.0) * CIRCLE_FRACTION;
    let sense = match turn {
        Turn::Counterclockwise => 1.0,
        Turn::Clockwise => -1.0,
    };
    let centre = grid.workspace.centre();
    let at = |arc: f64| {
        let (sin, cos) = (sense * arc / radius).sin_cos();
        [centre[0] + radius * cos, centre[1] + radius * sin]
    };
    let start = at(0.0);
    let (mut arc, mut place, mut before) = (0.0, start, [0.0; 2]);
    let mut velocities = Vec::with_capacity(grid.samples);
    for index in 0..grid.samples {
        let from_end = index.min(grid.samples - 1 - index) as f64;
        arc += (from_end * gain * dt).min(speed) * dt;
        let target = at(arc);
        let wanted = [0, 1].map(|axis| (target[axis] - place[axis]) / dt);
        let velocity =
            if from_end == 0.0 { [0.0; 2] } else { grid.limits.next_velocity(before, wanted, dt) };
        place = [0, 1].map(|axis| place[axis] + velocity[axis] * dt);
        before = velocity;
        velocities.push(velocity);
    }
    Ok(Course { start, velocities })
}
