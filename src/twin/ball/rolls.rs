//! Free rolls of the ball, from the camera's samples.
//!
//! A roll ends at missing samples, at the end of its run, and where its [`Extent`] requires it. It
//! also ends where the ball approaches a striker, is put elsewhere, or is pushed (its velocity
//! changes away from every wall). Pieces in which the ball hardly moves are left out, and so is
//! rest before and after.

use super::{BALL_RADIUS, HALF_BOARD};
use crate::{
    recording::{
        FrameTimes, Recording, RecordingError,
        message::{CameraDetections, Point},
        topic::CAMERA_DETECTIONS,
    },
    stats::median,
    twin::repeats::repeats,
    units::Nanos,
};
use std::ops::Range;

/// Distance to a striker's centre (m) below which the ball may touch it.
const STRIKER_REACH: f64 = 0.025;

/// Longest pause between samples of one roll (s).
const GAP: f64 = 0.1;

/// Highest speed of a rolling ball (m/s): a faster one was put elsewhere.
const FASTEST: f64 = 8.0;

/// Length of a roll that is predicted from one start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Extent {
    /// Pieces of a third to two thirds of a second. Errors of a twin grow with every impact; over
    /// so short a time, a fit that starts far off still converges.
    Pieces,
    /// Whole roll: weak effects (rolling resistance, slope) show with the square of the time.
    Whole,
}

impl Extent {
    /// Longest roll (s).
    fn longest(self) -> f64 {
        match self {
            Self::Pieces => 0.64,
            Self::Whole => f64::INFINITY,
        }
    }
}

/// Fewest samples of a roll.
const FEWEST: usize = 24;

/// Least displacement of a roll (m).
const LEAST_WAY: f64 = 0.02;

/// Most and fewest samples from which the start of a roll is estimated.
const FIRST: Range<usize> = 5..11;

/// Samples on each side from which a push is detected.
const BESIDE: usize = 5;

/// Samples left out on each side of a push.
const AROUND: usize = 2;

/// Least sudden change of velocity away from walls that is a push (m/s).
const PUSH: f64 = 0.15;

/// Samples over which motion is distinguished from rest, and the least displacement over them (m).
const REST: (usize, f64) = (8, 1.2e-3);

/// Time for which a ball that came to rest is still watched (s).
const WATCHED_REST: f64 = 0.15;

/// Detections of the ball, with those of the strikers.
#[derive(Clone)]
pub(super) struct Tracks {
    /// Capture time of each frame, as far as it is known (s since the recording began).
    pub(super) times: Vec<f64>,
    /// Arrival time of each frame (s since the recording began).
    arrivals: Vec<f64>,
    /// Position of the ball (m).
    pub(super) ball: Vec<[f64; 2]>,
    /// Positions of the strikers, where they were seen (m).
    pub(super) strikers: Vec<[Option<[f64; 2]>; 2]>,
    /// Usual rate of the frames (Hz).
    pub(super) rate_hz: f64,
    /// Standard deviation of one coordinate's noise, from second differences (m).
    pub(super) noise: f64,
}

/// One frame with a ball in it.
#[derive(Debug, Clone)]
pub(super) struct Sample {
    /// Capture time (s since the recording began).
    pub(super) time: f64,
    /// Arrival time (s since the recording began).
    pub(super) arrival: f64,
    /// Position of the ball (m).
    pub(super) ball: [f64; 2],
    /// Positions of the strikers, where they were seen (m).
    pub(super) strikers: [Option<[f64; 2]>; 2],
}

/// A piece of the track on which the ball rolls freely.
pub(super) struct Roll {
    /// Its samples.
    pub(super) samples: Range<usize>,
    /// First guess of x, y (m), vx, vy (m/s) at the first of them.
    pub(super) start: [f64; 4],
    /// True if this piece continues the roll that ends where it begins.
    pub(super) goes_on: bool,
}

impl Tracks {
    pub(super) fn from_recording(recording: &Recording) -> Result<Option<Self>, RecordingError> {
        let frames = recording.series::<CameraDetections>(CAMERA_DETECTIONS)?;
        let Some((origin, _)) = recording.time_range() else { return Ok(None) };
        let since = |time: Nanos| time.seconds_since(origin);
        let place = |point: &Point| [point.x, point.y];
        let mut samples = Vec::with_capacity(frames.times.len());
        for ((arrival, frame), taken) in frames.iter().zip(FrameTimes::of(&frames).taken) {
            let Some(ball) = frame.ball.as_ref().map(place) else { continue };
            let strikers = [frame.left.as_ref().map(place), frame.right.as_ref().map(place)];
            samples.push(Sample { time: since(taken), arrival: since(arrival), ball, strikers });
        }
        Ok(Self::new(samples))
    }

    /// Tracks of samples; those out of order are left out. `None` when there are too few.
    pub(super) fn new(samples: Vec<Sample>) -> Option<Self> {
        let mut tracks = Self {
            times: Vec::with_capacity(samples.len()),
            arrivals: Vec::with_capacity(samples.len()),
            ball: Vec::with_capacity(samples.len()),
            strikers: Vec::with_capacity(samples.len()),
            rate_hz: 0.0,
            noise: 0.0,
        };
        let balls: Vec<[f64; 2]> = samples.iter().map(|sample| sample.ball).collect();
        let own = samples.into_iter().zip(repeats(&balls)).filter(|(_, repeated)| !repeated);
        for (Sample { time, arrival, ball, strikers }, _) in own {
            let ordered = tracks.times.last().is_none_or(|last| last + 1e-6 < time);
            if ordered && ball.iter().all(|coordinate| coordinate.is_finite()) {
                tracks.times.push(time);
                tracks.arrivals.push(arrival);
                tracks.ball.push(ball);
                tracks.strikers.push(strikers);
            }
        }
        if tracks.times.len() < FEWEST {
            return None;
        }
        let steps: Vec<f64> = tracks.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        tracks.rate_hz = median(&steps)?.recip();
        let bends: Vec<f64> = tracks
            .ball
            .windows(3)
            .flat_map(|w| [0, 1].map(|k| (w[2][k] - 2.0 * w[1][k] + w[0][k]).abs()))
            .collect();
        // The second difference of independent noise has sqrt(6) times its standard deviation, and
        // half of all normal values lie within 0.6745 standard deviations.
        tracks.noise = median(&bends)? / (0.6745 * 6.0_f64.sqrt());
        Some(tracks)
    }

    /// Straight lines through the samples: position at `at` and velocity, by axis, with the RMS
    /// distance of the samples from them.
    pub(super) fn line(&self, samples: Range<usize>, at: f64) -> Line {
        let count = samples.len() as f64;
        let mean = |value: &dyn Fn(usize) -> f64| samples.clone().map(value).sum::<f64>() / count;
        let middle = mean(&|i| self.times[i]);
        let spread = mean(&|i| (self.times[i] - middle).powi(2));
        let centre = [0, 1].map(|k| mean(&|i| self.ball[i][k]));
        let velocity = [0, 1]
            .map(|k| mean(&|i| (self.times[i] - middle) * (self.ball[i][k] - centre[k])) / spread);
        let off = |i: usize, k: usize| {
            self.ball[i][k] - centre[k] - velocity[k] * (self.times[i] - middle)
        };
        let off_rms = (mean(&|i| off(i, 0).powi(2) + off(i, 1).powi(2)) / 2.0).sqrt();
        let place = [0, 1].map(|k| centre[k] + velocity[k] * (at - middle));
        Line { middle, place, velocity, off_rms }
    }

    /// Standard deviation of a velocity from `samples` consecutive samples, caused by noise (m/s).
    pub(super) fn velocity_spread(&self, samples: usize) -> f64 {
        let count = samples as f64;
        self.noise * self.rate_hz * (12.0 / (count * (count * count - 1.0))).sqrt()
    }

    fn near_striker(&self, sample: usize) -> bool {
        self.strikers[sample].iter().flatten().any(|striker| {
            let ball = self.ball[sample];
            (ball[0] - striker[0]).hypot(ball[1] - striker[1]) < STRIKER_REACH
        })
    }

    fn displacement(&self, from: usize, to: usize) -> f64 {
        let (a, b) = (self.ball[from], self.ball[to]);
        (b[0] - a[0]).hypot(b[1] - a[1])
    }
}

impl Line {
    pub(super) fn speed(&self) -> f64 {
        self.velocity[0].hypot(self.velocity[1])
    }
}

/// Straight line through a piece of the track.
#[derive(Clone, Copy)]
pub(super) struct Line {
    /// Time of the middle of the samples (s).
    pub(super) middle: f64,
    pub(super) place: [f64; 2],
    pub(super) velocity: [f64; 2],
    off_rms: f64,
}

/// The free rolls in `tracks` within `spans`.
pub(super) fn cut(tracks: &Tracks, spans: &[Range<f64>], extent: Extent) -> Vec<Roll> {
    let mut rolls = Vec::new();
    for piece in continuous_pieces(tracks, spans) {
        for part in between_pushes(tracks, moving_part(tracks, piece)) {
            cut_long(tracks, part, extent, &mut rolls);
        }
    }
    rolls
}

/// Pieces without missing samples, jump, striker or end of a span.
fn continuous_pieces(tracks: &Tracks, spans: &[Range<f64>]) -> Vec<Range<usize>> {
    let span_of = |i: usize| spans.iter().position(|span| span.contains(&tracks.arrivals[i]));
    let usable = |i: usize| span_of(i).is_some() && !tracks.near_striker(i);
    let joined = |i: usize| {
        let dt = tracks.times[i + 1] - tracks.times[i];
        dt < GAP.max(1.5 / tracks.rate_hz)
            && tracks.displacement(i, i + 1) < FASTEST * dt + 6.0 * tracks.noise
            && span_of(i) == span_of(i + 1)
    };
    let mut pieces = Vec::new();
    let mut start = None;
    for i in 0..tracks.times.len() {
        if !usable(i) {
            start = None;
            continue;
        }
        let first = *start.get_or_insert(i);
        let last = i + 1 == tracks.times.len() || !usable(i + 1) || !joined(i);
        if last {
            pieces.push(first..i + 1);
            start = None;
        }
    }
    pieces
}

/// `piece` without the rest at its ends.
fn moving_part(tracks: &Tracks, piece: Range<usize>) -> Range<usize> {
    let (window, least) = (REST.0, REST.1.max(6.0 * tracks.noise));
    let ends = piece.start..piece.end.saturating_sub(window);
    let moving = |i: &usize| least < tracks.displacement(*i, *i + window);
    let (Some(first), Some(last)) = (ends.clone().find(moving), ends.rev().find(moving)) else {
        return piece.start..piece.start;
    };
    // A ball that began at rest was pushed: the roll starts when the push is over.
    let start = if first == piece.start { first } else { first + window };
    let watched = last + window + (WATCHED_REST * tracks.rate_hz) as usize;
    start..watched.min(piece.end)
}

/// `piece` without sudden changes of velocity away from the walls.
fn between_pushes(tracks: &Tracks, piece: Range<usize>) -> Vec<Range<usize>> {
    let from_wall = |i: usize| {
        let gap = |k: usize| HALF_BOARD[k] - BALL_RADIUS - tracks.ball[i][k].abs();
        gap(0).min(gap(1))
    };
    let least = PUSH.max(8.0 * tracks.velocity_spread(BESIDE));
    let change = |i: usize| -> f64 {
        let beside = i - BESIDE..i + BESIDE;
        let (before, after) = (tracks.line(i - BESIDE..i, 0.0), tracks.line(i..i + BESIDE, 0.0));
        let reach = 0.005 + 2.0 * before.speed() / tracks.rate_hz;
        if beside.clone().any(|i| from_wall(i) < reach) {
            return 0.0;
        }
        (after.velocity[0] - before.velocity[0]).hypot(after.velocity[1] - before.velocity[1])
    };
    let (mut parts, mut start) = (Vec::new(), piece.start);
    let mut i = piece.start + BESIDE;
    while i + BESIDE <= piece.end {
        if least < change(i) {
            let last = (i + 2 * BESIDE).min(piece.end - BESIDE);
            let sizes = (i..=last).map(|at| (at, change(at)));
            let at = sizes.max_by(|a, b| a.1.total_cmp(&b.1)).map_or(i, |found| found.0);
            parts.push(start..at.saturating_sub(AROUND).max(start));
            start = at + AROUND;
            i = start + BESIDE;
        } else {
            i += 1;
        }
    }
    parts.push(start.min(piece.end)..piece.end);
    parts
}

/// Cuts `part` into rolls of about equal length, none longer than `extent` allows.
fn cut_long(tracks: &Tracks, part: Range<usize>, extent: Extent, rolls: &mut Vec<Roll>) {
    if part.len() < FEWEST {
        return;
    }
    let length = tracks.times[part.end - 1] - tracks.times[part.start];
    let pieces = (length / extent.longest()).ceil().max(1.0) as usize;
    for piece in 0..pieces {
        let edge = |piece: usize| part.start + part.len() * piece / pieces;
        let mut roll = roll_of(tracks, edge(piece)..edge(piece + 1));
        if let Some(roll) = &mut roll {
            roll.goes_on =
                rolls.last().is_some_and(|last| last.samples.end == edge(piece) && 0 < piece);
        }
        rolls.extend(roll);
    }
}

/// Roll in `samples`, from the first sample at which its start can be determined; `None` where it
/// hardly moves.
fn roll_of(tracks: &Tracks, samples: Range<usize>) -> Option<Roll> {
    let good = 1.6 * tracks.noise + 5e-5;
    let mut first = samples.start;
    while first + FEWEST <= samples.end {
        for count in FIRST.rev() {
            let line = tracks.line(first..first + count, tracks.times[first]);
            if line.off_rms < good {
                let start = [line.place[0], line.place[1], line.velocity[0], line.velocity[1]];
                let samples = first..samples.end;
                let far = samples.clone().map(|i| tracks.displacement(first, i));
                return (LEAST_WAY < far.fold(0.0, f64::max)).then_some(Roll {
                    samples,
                    start,
                    goes_on: false,
                });
            }
        }
        first += 1;
    }
    None
}
