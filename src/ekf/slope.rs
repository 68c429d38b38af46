//! Velocities and impacts from detections alone, by line fits through a few frames.
//!
//! A line fit through frames on both sides of an instant gives the velocity without lag. Two line
//! fits, before and after an instant, that meet at an angle indicate an impact.

use super::{
    data::Frame,
    settings::{FilterSettings, Object},
};

/// Number of frames on each side.
const BESIDE: usize = 5;
/// Minimum number of these in which the object was detected.
const LEAST_SEEN: usize = 4;
/// Maximum RMS residual of a line fit, in standard deviations of a detection.
const MISSES: f64 = 3.0;
/// Minimum velocity change of an impact (m/s).
const LEAST_CHANGE: f64 = 0.3;

/// A line fit in time: position at the time origin and velocity.
#[derive(Debug, Clone, Copy)]
struct Line {
    position: [f64; 2],
    velocity: [f64; 2],
    /// RMS residual in each axis (m).
    misses: f64,
}

/// An impact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Impact {
    /// Index of the first frame after it.
    pub frame: usize,
    /// Time from the impact to that frame (s).
    pub since_s: f64,
    /// Position of the impact (m).
    pub position: [f64; 2],
    /// Velocity before (m/s).
    pub before: [f64; 2],
    /// Velocity after (m/s).
    pub after: [f64; 2],
}

impl Impact {
    /// Magnitude of the velocity change (m/s).
    #[must_use]
    pub fn change(&self) -> f64 {
        (self.after[0] - self.before[0]).hypot(self.after[1] - self.before[1])
    }
}

/// Fit a line to the detections in `frames`, with time counted from `origin`.
fn line(frames: &[Frame], origin: &Frame, index: usize) -> Option<Line> {
    let seen = || {
        frames.iter().filter_map(move |frame| {
            Some((frame.seen.time.seconds_since(origin.seen.time), frame.seen.positions[index]?))
        })
    };
    let count = seen().count();
    if count < LEAST_SEEN {
        return None;
    }
    let n = count as f64;
    let time = seen().map(|(t, _)| t).sum::<f64>() / n;
    let spread: f64 = seen().map(|(t, _)| (t - time).powi(2)).sum();
    let mut line = Line { position: [0.0; 2], velocity: [0.0; 2], misses: 0.0 };
    for axis in 0..2 {
        let position = seen().map(|(_, p)| p[axis]).sum::<f64>() / n;
        let slope = seen().map(|(t, p)| (t - time) * (p[axis] - position)).sum::<f64>() / spread;
        line.velocity[axis] = slope;
        line.position[axis] = position - slope * time;
        line.misses +=
            seen().map(|(t, p)| (p[axis] - line.position[axis] - slope * t).powi(2)).sum::<f64>();
    }
    line.misses = (line.misses / (2.0 * n - 4.0)).sqrt();
    Some(line)
}

/// Velocity of `object` at each frame (m/s), where the neighbouring frames lie on a line.
#[must_use]
pub fn velocities(
    frames: &[Frame],
    object: Object,
    settings: &FilterSettings,
) -> Vec<Option<[f64; 2]>> {
    let sigma = settings.object(object).measurement_sigma_m;
    (0..frames.len())
        .map(|k| {
            let around = frames.get(k.checked_sub(BESIDE)?..=k + BESIDE)?;
            let line = line(around, &frames[k], object.index())?;
            (line.misses < MISSES * sigma).then_some(line.velocity)
        })
        .collect()
}

/// Impacts of `object`, in order.
#[must_use]
pub fn impacts(frames: &[Frame], object: Object, settings: &FilterSettings) -> Vec<Impact> {
    let sigma = settings.object(object).measurement_sigma_m;
    let found: Vec<Impact> = (BESIDE..frames.len().saturating_sub(BESIDE))
        .filter_map(|k| impact(frames, k, object.index(), MISSES * sigma))
        .collect();
    // Lines on either side of a neighbouring frame find the same impact again.
    let mut kept: Vec<Impact> = Vec::new();
    for impact in found {
        match kept.last_mut() {
            Some(last) if impact.frame < last.frame + BESIDE => {
                if last.change() < impact.change() {
                    *last = impact;
                }
            }
            _ => kept.push(impact),
        }
    }
    kept
}

/// The impact between frames `k - 1` and `k`, if any.
fn impact(frames: &[Frame], k: usize, index: usize, most: f64) -> Option<Impact> {
    let before = line(&frames[k - BESIDE..k], &frames[k], index)?;
    let after = line(&frames[k..k + BESIDE], &frames[k], index)?;
    let change = [0, 1].map(|axis| after.velocity[axis] - before.velocity[axis]);
    let size = change[0].hypot(change[1]);
    if size < LEAST_CHANGE || most < before.misses || most < after.misses {
        return None;
    }
    // Intersection of the lines along the velocity change.
    let gap: f64 =
        (0..2).map(|axis| (after.position[axis] - before.position[axis]) * change[axis]).sum();
    let since_s = gap / (size * size);
    let period = frames[k].seen.time.seconds_since(frames[k - 1].seen.time);
    (0.0..=period).contains(&since_s).then(|| Impact {
        frame: k,
        since_s,
        position: [0, 1].map(|axis| after.position[axis] - since_s * after.velocity[axis]),
        before: before.velocity,
        after: after.velocity,
    })
}
