//! Prediction of the velocities that the state estimator reports, from the positions of the camera.
//!
//! The true velocity is the slope of a parabola through the camera's positions around each instant,
//! which looks ahead as far as it looks back and so does not lag. For a striker with a measured
//! carriage, it is the velocity of the carriage plus the slope of the difference between both
//! ([`guide`]). The velocity of the twin's own striker that this slope misses is added ([`swing`]).
//! The estimator effects of the twin turn the true velocity into that of `/board/state`.

mod guide;
mod swing;

use super::{
    Instance, MeasuredPath, Twin,
    stage::{Channel, Stage, StageKind},
};
use crate::effects::{Axis, Domain, Effect, Physics, Sample};
use crate::recording::{
    FrameTimes, Recording, RecordingError,
    message::{BoardState, CameraDetections, ObjectState, Point},
    topic::{self, Player},
};
use crate::stats::{median, quantile};
use guide::Guide;
use std::ops::Range;
use swing::{Swing, Window};

/// Frames on each side of an instant from which the velocity is computed.
const FRAMES_BESIDE: usize = 4;
/// The same with a guiding carriage: the striker differs from it slowly.
const GUIDED_FRAMES_BESIDE: usize = 12;
/// Fewest frames and states of an object that is compared.
const FEWEST: usize = 50;
/// Effect that reports zeros, so it is searched only where at least [`FEWEST`] velocities are
/// exactly zero. At rest, a zero has less noise than the slope of measured positions, so that noise
/// alone would resemble it.
const DEAD_ZONE: &str = "estimator.velocity_deadzone";
/// Range of positions below which an object does not move (m).
const LEAST_TRAVEL_M: f64 = 0.01;
/// Longest dropout that does not restart the estimator (s).
const LONGEST_GAP_S: f64 = 0.25;
/// Steps of 1 s with the same velocity after which any estimator has settled.
const SETTLING_STEPS: usize = 20;
/// Distance of a parabola from the positions, as a multiple of the usual one, above which it does
/// not describe them: an impact.
const POOR_FIT: f64 = 5.0;

/// Velocities of `/board/state`, of each object that moves: `state.left_vx` and so on.
#[derive(Debug, Clone, Default)]
pub struct EstimatorStage {
    channels: Vec<Channel>,
    inputs: Vec<Vec<Step>>,
    /// Compared velocities that are exactly zero, along coordinates that move at all.
    zeros: usize,
    /// The striker whose carriage is measured, with the first of its two channels.
    swing: Option<(usize, Swing)>,
}

/// One instant at which the true velocity is known: a frame or a state.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Time since the instant before (s); not finite where the estimator starts anew.
    dt: f64,
    /// True velocity (m/s).
    velocity: f64,
    /// Velocity of the other coordinate, if both are reported as zero together (m/s).
    across: Option<f64>,
    /// Sample of the channel that is reported now.
    reports: Option<usize>,
}

impl Step {
    /// Add the missed part of its velocity, and that of the other coordinate if it counts.
    fn with(mut self, [own, other]: [f64; 2]) -> Self {
        self.velocity += own;
        self.across = self.across.map(|across| across + other);
        self
    }
}

/// Times (s) and positions (m) of one object.
#[derive(Default)]
struct Track<'p> {
    times: Vec<f64>,
    /// Positions, less those of the guide.
    places: Vec<[f64; 2]>,
    guide: Option<Guide<'p>>,
}

/// Velocity by a parabola, and the distance of the parabola from the positions.
struct Slope {
    velocity: [f64; 2],
    misses: f64,
    /// Window of frames, with a guiding carriage.
    window: Option<Window>,
}

/// A frame or a state at which the velocity is known.
struct Instant {
    time: f64,
    /// Sample of the channel that is reported now.
    reports: Option<usize>,
    slope: Slope,
}

impl EstimatorStage {
    /// Measured signals, to exclude samples.
    pub(super) fn channels_mut(&mut self) -> &mut [Channel] {
        &mut self.channels
    }

    /// The stage of a recording with detections of the camera and states; `None` where it lacks one
    /// of them, or nothing moves. Its runs are `spans` (seconds since the recording began): positions
    /// beyond them only prepare the estimator, and no state beyond them is compared. `carriage` is the
    /// measured one of a player.
    ///
    /// # Errors
    /// When a message does not decode.
    pub fn from_recording(
        recording: &Recording,
        spans: &[Range<f64>],
        carriage: Option<(Player, &MeasuredPath)>,
    ) -> Result<Option<Self>, RecordingError> {
        let states = recording.series::<BoardState>(topic::BOARD_STATE)?;
        let detections = recording.series::<CameraDetections>(topic::CAMERA_DETECTIONS)?;
        let Some((began, _)) = recording.time_range() else { return Ok(None) };
        if states.times.len() < FEWEST || detections.times.len() < FEWEST {
            return Ok(None);
        }
        let times: Vec<f64> = states.times.iter().map(|t| t.seconds_since(began)).collect();
        let place = |time: f64| times.partition_point(|sample| *sample < time);
        let runs: Vec<Range<usize>> =
            spans.iter().map(|span| place(span.start)..place(span.end)).collect();
        // An estimator cannot know a frame before it arrives: its lag counts from then.
        let frames: Vec<f64> =
            FrameTimes::of(&detections).arrived.iter().map(|t| t.seconds_since(began)).collect();
        let mut stage = Self::default();
        for object in &OBJECTS {
            let seen = detections.values.iter().map(|found| (object.seen)(found));
            let path = carriage.filter(|(player, _)| object.player == Some(*player));
            let track = Track::new(&frames, seen).guided(path.map(|(_, path)| path));
            let told = |state: &BoardState| (object.state)(state).map(|state| [state.vx, state.vy]);
            let reported: Vec<_> = states.values.iter().map(told).collect();
            stage.add(object.name, &track, &reported, (&times, &runs));
        }
        Ok((!stage.channels.is_empty()).then_some(stage))
    }

    /// Add both velocities of an object if it moves and the states in `runs` contain its
    /// velocities.
    fn add(
        &mut self,
        name: &str,
        track: &Track,
        reported: &[Option<[f64; 2]>],
        (times, runs): (&[f64], &[Range<usize>]),
    ) {
        let own = runs.iter().flat_map(|run| &reported[run.clone()]).flatten();
        let told = own.filter(|v| v[0] != 0.0 || v[1] != 0.0).count();
        if track.guide.is_none() && !track.moves() || told < FEWEST {
            return;
        }
        let mut instants = track.instants(times);
        let windows = instants.iter_mut().filter_map(|instant| instant.slope.window.take());
        if let Some(swing) = Swing::of(track, windows.collect()) {
            self.swing = Some((self.channels.len(), swing));
        }
        let misses: Vec<f64> = instants.iter().map(|instant| instant.slope.misses).collect();
        let usual = median(&misses);
        let poor = POOR_FIT * usual.unwrap_or(f64::INFINITY);
        let together = zeroed_together(reported);
        for axis in 0..2 {
            let mut measured: Vec<f64> =
                reported.iter().map(|v| v.map_or(f64::NAN, |v| v[axis])).collect();
            let mut steps = Vec::with_capacity(instants.len());
            let mut before = f64::NAN;
            for Instant { time, reports, slope } in &instants {
                if let Some(sample) = reports.filter(|_| poor < slope.misses) {
                    measured[sample] = f64::NAN;
                }
                let dt = time - before;
                let dt = if LONGEST_GAP_S < dt { f64::NAN } else { dt };
                let velocity = slope.velocity[axis];
                let across = together.then_some(slope.velocity[1 - axis]);
                steps.push(Step { dt, velocity, across, reports: *reports });
                before = *time;
            }
            let compared = || runs.iter().flat_map(|run| &measured[run.clone()]);
            let zeros = compared().filter(|velocity| **velocity == 0.0).count();
            if zeros < compared().filter(|velocity| velocity.is_finite()).count() {
                self.zeros += zeros;
            }
            self.channels.push(Channel {
                signal: format!("state.{name}_{}", ["vx", "vy"][axis]),
                unit: "m/s",
                domain: Domain::Estimator,
                axis: ["x", "y"][axis],
                rate_hz: rate(times),
                times: times.to_vec(),
                measured,
                runs: runs.to_vec(),
            });
            self.inputs.push(steps);
        }
    }

    /// Predict the reports of estimators with `instances`. `missed` is the part of the velocity
    /// that the windows miss, by channel and step.
    fn report(
        &self,
        instances: &[Instance],
        missed: impl Fn(usize, usize) -> [f64; 2],
        predicted: &mut [Vec<f64>],
    ) {
        let inputs = self.channels.iter().zip(&self.inputs).enumerate();
        for ((index, (channel, steps)), out) in inputs.zip(predicted) {
            out.clear();
            out.resize(channel.times.len(), f64::NAN);
            let mut chain: Vec<_> = instances
                .iter()
                .filter_map(|instance| match instance.effect.physics {
                    Physics::Estimator(physics) => {
                        Some((physics, instance.numbers(), vec![0.0; instance.effect.memory]))
                    }
                    _ => None,
                })
                .collect();
            let mut pass = |Step { velocity, across, .. }: Step, dt: f64| {
                let across = across.unwrap_or(0.0);
                chain.iter_mut().fold(velocity, |velocity, (physics, numbers, memory)| {
                    physics(numbers, memory, &Sample { dt, velocity, across })
                })
            };
            for (k, step) in steps.iter().enumerate() {
                let step = step.with(missed(index, k));
                let reported = if step.dt.is_finite() {
                    pass(step, step.dt)
                } else {
                    (0..SETTLING_STEPS).fold(0.0, |_, _| pass(step, 1.0))
                };
                if let Some(sample) = step.reports {
                    out[sample] = reported;
                }
            }
        }
    }
}

impl Stage for EstimatorStage {
    fn kind(&self) -> StageKind {
        StageKind::Estimator
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, effect: &Effect) -> bool {
        matches!(effect.physics, Physics::Estimator(_))
    }

    fn feels(&self, effect: &Effect, _axis: Axis) -> bool {
        self.calls(effect) && (effect.name != DEAD_ZONE || FEWEST <= self.zeros)
    }

    fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let swing = self.swing.as_ref().and_then(|(first, own)| Some((*first, own.missed(twin)?)));
        let missed = |channel: usize, step: usize| match &swing {
            Some((first, missed)) if channel == *first => missed[step],
            Some((first, missed)) if channel == first + 1 => {
                let [x, y] = missed[step];
                [y, x]
            }
            _ => [0.0; 2],
        };
        self.report(&twin.instances, missed, predicted);
    }
}

/// An object of the board, in detections and in states.
struct Object {
    name: &'static str,
    seen: fn(&CameraDetections) -> Option<&Point>,
    state: fn(&BoardState) -> Option<&ObjectState>,
    player: Option<Player>,
}

const OBJECTS: [Object; 3] = [
    Object {
        name: "ball",
        seen: |found| found.ball.as_ref(),
        state: |state| state.ball.as_ref(),
        player: None,
    },
    Object {
        name: "left",
        seen: |found| found.left.as_ref(),
        state: |state| state.left.as_ref(),
        player: Some(Player::Left),
    },
    Object {
        name: "right",
        seen: |found| found.right.as_ref(),
        state: |state| state.right.as_ref(),
        player: Some(Player::Right),
    },
];

/// Return whether zeros are reported along both coordinates together more often than along one
/// alone.
fn zeroed_together(reported: &[Option<[f64; 2]>]) -> bool {
    let zeros = |count: usize| {
        let is_zero =
            |velocity: &&[f64; 2]| velocity.iter().filter(|v| **v == 0.0).count() == count;
        reported.iter().flatten().filter(is_zero).count()
    };
    zeros(1) < zeros(2)
}

/// Rate of `times` (Hz).
fn rate(times: &[f64]) -> f64 {
    let periods: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    median(&periods).filter(|period| 0.0 < *period).map_or(0.0, f64::recip)
}

impl<'p> Track<'p> {
    /// Detected positions, at increasing times.
    fn new<'a>(times: &[f64], places: impl Iterator<Item = Option<&'a Point>>) -> Self {
        let mut track = Self::default();
        for (time, place) in times.iter().zip(places) {
            if let Some(place) = place
                && track.times.last().is_none_or(|last| last < time)
            {
                track.times.push(*time);
                track.places.push([place.x, place.y]);
            }
        }
        track
    }

    /// The same less the motion of the carriage on `path`, if the object moves and follows that.
    fn guided(mut self, path: Option<&'p MeasuredPath>) -> Self {
        let Some(path) = path.filter(|_| self.moves()) else { return self };
        self.guide = Guide::of(path, &self.times, &self.places);
        if let Some(guide) = &self.guide {
            for (time, place) in self.times.iter().zip(&mut self.places) {
                let (led, _) = guide.at(*time);
                *place = [place[0] - led[0], place[1] - led[1]];
            }
        }
        self
    }

    /// Return whether the range of the positions exceeds noise.
    fn moves(&self) -> bool {
        let range = |axis: usize| {
            let places: Vec<f64> = self.places.iter().map(|place| place[axis]).collect();
            Some(quantile(&places, 0.98)? - quantile(&places, 0.02)?)
        };
        let enough = |axis| range(axis).is_some_and(|range| LEAST_TRAVEL_M < range);
        FEWEST <= self.times.len() && (enough(0) || enough(1))
    }

    /// All frames and all `samples` in order of time, where the velocity is known.
    fn instants(&self, samples: &[f64]) -> Vec<Instant> {
        let mut grid: Vec<(f64, Option<usize>)> = self.times.iter().map(|t| (*t, None)).collect();
        grid.extend(samples.iter().enumerate().map(|(sample, time)| (*time, Some(sample))));
        grid.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let period = rate(&self.times).recip();
        grid.into_iter()
            .filter_map(|(time, reports)| {
                Some(Instant { time, reports, slope: self.slope(time, period)? })
            })
            .collect()
    }

    /// Parabola through the frames around `time`, in units of the window's half length; `None` at
    /// the ends of the track and where frames are missing.
    fn slope(&self, time: f64, period: f64) -> Option<Slope> {
        let beside = if self.guide.is_some() { GUIDED_FRAMES_BESIDE } else { FRAMES_BESIDE };
        let after = self.times.partition_point(|frame| *frame < time);
        let (low, high) = (after.checked_sub(beside)?, after + beside);
        let times = self.times.get(low..=high).or_else(|| self.times.get(low..high))?;
        let half = beside as f64 * period;
        let (first, last) = (time - times[0], times[times.len() - 1] - time);
        if 2.0 * half < first || 2.0 * half < last {
            return None;
        }
        let mut powers = [0.0; 5];
        let mut moments = [[0.0; 3]; 2];
        for (frame, place) in times.iter().zip(&self.places[low..]) {
            let mut power = 1.0;
            for k in 0..5 {
                powers[k] += power;
                if k < 3 {
                    moments[0][k] += power * place[0];
                    moments[1][k] += power * place[1];
                }
                power *= (frame - time) / half;
            }
        }
        let [a, b] = [parabola(&powers, &moments[0])?, parabola(&powers, &moments[1])?];
        let misses = times.iter().zip(&self.places[low..]).map(|(frame, place)| {
            let s = (frame - time) / half;
            let at = |p: &[f64; 3]| p[0] + (p[1] + p[2] * s) * s;
            (place[0] - at(&a)).powi(2) + (place[1] - at(&b)).powi(2)
        });
        let misses = (misses.sum::<f64>() / times.len() as f64).sqrt();
        let led = self.guide.as_ref().map_or([0.0; 2], |guide| guide.at(time).1);
        let window = match &self.guide {
            Some(_) => {
                let row = slope_by_moment(&powers)?.map(|share| share / half);
                Some(Window { time, first: low, count: times.len(), row, half })
            }
            None => None,
        };
        Some(Slope { velocity: [led[0] + a[1] / half, led[1] + b[1] / half], misses, window })
    }
}

/// Contribution of each moment to the slope of the parabola with these sums of powers.
fn slope_by_moment(powers: &[f64; 5]) -> Option<[f64; 3]> {
    let [a, b, c] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Some([parabola(powers, &a)?[1], parabola(powers, &b)?[1], parabola(powers, &c)?[1]])
}

/// Coefficients of the parabola with these sums of powers and moments (Cramer's rule).
fn parabola(powers: &[f64; 5], moments: &[f64; 3]) -> Option<[f64; 3]> {
    let column = |k: usize| [powers[k], powers[k + 1], powers[k + 2]];
    let determinant = |a: [f64; 3], b: [f64; 3], c: [f64; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1]) - b[0] * (a[1] * c[2] - a[2] * c[1])
            + c[0] * (a[1] * b[2] - a[2] * b[1])
    };
    let [a, b, c] = [column(0), column(1), column(2)];
    let whole = determinant(a, b, c);
    (1e-9 < whole).then(|| {
        [
            determinant(*moments, b, c) / whole,
            determinant(a, *moments, c) / whole,
            determinant(a, b, *moments) / whole,
        ]
    })
}

#[cfg(test)]
mod tests;
