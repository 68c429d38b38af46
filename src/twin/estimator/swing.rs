//! Motion of the striker relative to its magnet, as the twin predicts it: too fast for a window
//! over many frames.
//!
//! For a striker with a measured carriage, the true velocity is that of the carriage plus the slope
//! of the difference between both over a window. A striker that swings on its magnet does so within
//! that window. The velocity of the twin's own striker that the window misses is added.

use super::Track;
use crate::{
    effects::both,
    twin::{Linkage, MeasuredPath, Places, Twin, camera::STEP},
};

/// Striker of one player, its frames, and the windows over which its velocity is computed.
#[derive(Debug, Clone)]
pub(super) struct Swing {
    path: MeasuredPath,
    /// Delay of the frames behind the carriage (s).
    delay: f64,
    /// Map from the axes of the carriage to the camera: `[axis][x, y]`.
    turn: [[f64; 2]; 2],
    /// Arrival time of each frame (s).
    frames: Vec<f64>,
    windows: Vec<Window>,
}

/// Window of frames over which a velocity is computed, and its weights: the slope of a parabola is
/// linear in the positions.
#[derive(Debug, Clone)]
pub(super) struct Window {
    /// Instant of the velocity (s).
    pub(super) time: f64,
    /// Its first frame, and the number of frames.
    pub(super) first: usize,
    pub(super) count: usize,
    /// Weight of a frame that is `s` half windows after the instant: `row[0] + row[1] s + row[2] s^2` (1/s).
    pub(super) row: [f64; 3],
    /// Half its length (s).
    pub(super) half: f64,
}

impl Window {
    /// Slope of `place` over the frames of the window (m/s).
    fn slope(&self, frames: &[f64], mut place: impl FnMut(f64) -> [f64; 2]) -> [f64; 2] {
        let mut slope = [0.0; 2];
        for time in &frames[self.first..self.first + self.count] {
            let s = (time - self.time) / self.half;
            let weight = self.row[0] + s * (self.row[1] + s * self.row[2]);
            let place = place(*time);
            slope = both(|axis| slope[axis] + weight * place[axis]);
        }
        slope
    }
}

impl Swing {
    /// Swing of `track`, with velocities at the instants of `windows`; `None` without a carriage
    /// that guides it.
    pub(super) fn of(track: &Track<'_>, windows: Vec<Window>) -> Option<Self> {
        let guide = track.guide.as_ref()?;
        Some(Self {
            path: guide.path.clone(),
            delay: guide.delay,
            turn: guide.map.map(|[by_x, by_y, _]| [by_x, by_y]),
            frames: track.times.clone(),
            windows,
        })
    }

    /// Velocity that the windows miss at each instant (m/s); `None` if the striker of `twin`
    /// follows its carriage.
    pub(super) fn missed(&self, twin: &Twin) -> Option<Vec<[f64; 2]>> {
        let linkage = Linkage::new(twin, Places::Reported);
        if !linkage.couples() {
            return None;
        }
        let beside = self.marched(&linkage, twin.striker_mass);
        let missed = self.windows.iter().map(|window| {
            let told = window.slope(&self.frames, |time| beside.at(time).0);
            let (_, velocity) = beside.at(window.time);
            both(|axis| velocity[axis] - told[axis])
        });
        Some(missed.collect())
    }

    /// Position of the striker relative to its magnet, in the camera, from the first frame to the
    /// last.
    fn marched(&self, linkage: &Linkage, striker_mass: f64) -> Beside {
        let (first, last) = (self.frames[0], self.frames[self.frames.len() - 1]);
        let mut memory = vec![0.0; linkage.memory()];
        let mut cursor = 0;
        let steps = ((last - first) / STEP).ceil() as usize + 2;
        let places = (0..steps).map(|k| {
            let time = first + STEP * k as f64 - self.delay;
            let carriage = self.path.carriage(time, STEP, striker_mass, &mut cursor);
            let away = linkage.away(&mut memory, &carriage);
            self.turn.map(|[by_x, by_y]| by_x * away[0] + by_y * away[1])
        });
        Beside { first, places: places.collect() }
    }
}

/// Positions (m) at equal [`STEP`]s from a first time (s) on.
struct Beside {
    first: f64,
    places: Vec<[f64; 2]>,
}

impl Beside {
    /// Position (m) and velocity (m/s) at `time` (s).
    fn at(&self, time: f64) -> ([f64; 2], [f64; 2]) {
        let last = self.places.len() - 2;
        let place = ((time - self.first) / STEP).clamp(0.0, last as f64);
        let k = (place as usize).min(last);
        let share = place - k as f64;
        let (before, after) = (self.places[k], self.places[k + 1]);
        let way = both(|axis| after[axis] - before[axis]);
        (both(|axis| before[axis] + share * way[axis]), way.map(|way| way / STEP))
    }
}
