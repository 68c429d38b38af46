//! Tracks of objects from detections: start, update, loss, restart; late and repeated frames.

use super::{
    filter::{Gate, Innovation, Measurement, ObjectFilter},
    motion::Estimate,
    region::{Region, Strikers},
    settings::{FilterSettings, Object},
};
use crate::{
    recording::message::{CameraDetections, Covariance, Point},
    units::Nanos,
};
use serde::{Deserialize, Serialize};

/// Time without an accepted detection after which a track is lost (s).
pub const LOST_AFTER_S: f64 = 0.25;
/// Number of stored frames, so that a late one can be inserted: 0.27 s at 120 Hz.
pub const REMEMBERED_FRAMES: usize = 32;
/// Maximum velocity between two rejected detections that reinitialize a track, in standard
/// deviations of the initial speed.
const FASTEST: f64 = 4.0;

/// Detections of one frame: positions (m) of ball, left and right striker.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Detections {
    /// Capture time.
    pub time: Nanos,
    /// Positions by [`Object::index`]; `None` for an object that was not detected.
    pub positions: [Option<[f64; 2]>; 3],
    /// Covariances xx, xy, yy (m2) of these positions, where the detector gives them.
    #[serde(default, skip_serializing_if = "is_empty")]
    pub covariances: [Option<[f64; 3]>; 3],
}

fn is_empty(covariances: &[Option<[f64; 3]>; 3]) -> bool {
    covariances.iter().all(Option::is_none)
}

/// Track of one object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Time of `estimate`.
    pub time: Nanos,
    /// State estimate.
    pub estimate: Estimate,
    /// Time of the last accepted detection.
    accepted: Nanos,
    /// The last detection, if it was rejected.
    refused: Option<(Nanos, [f64; 2])>,
    /// Its covariance, if it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    refused_covariance: Option<[f64; 3]>,
}

/// Result of one frame for one object.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Region of the predicted position of the ball.
    pub region: Region,
    /// Innovation; `None` without a detection or without a prediction.
    pub innovation: Option<Innovation>,
    /// The track was started or reinitialized with this frame.
    pub started: bool,
}

impl Detections {
    /// Detections without covariances.
    #[must_use]
    pub fn new(time: Nanos, positions: [Option<[f64; 2]>; 3]) -> Self {
        Self { time, positions, covariances: [None; 3] }
    }

    /// Detections of a camera message with capture time `time`. A covariance that is not positive definite counts as
    /// absent.
    #[must_use]
    pub fn of(time: Nanos, picture: &CameraDetections) -> Self {
        let positions = [picture.ball, picture.left, picture.right].map(|point| {
            point
                .map(|Point { x, y }| [x, y])
                .filter(|position| position.iter().all(|x| x.is_finite()))
        });
        let CameraDetections { ball_covariance, left_covariance, right_covariance, .. } = *picture;
        let covariances = [ball_covariance, left_covariance, right_covariance].map(|own| {
            let Covariance { xx, xy, yy } = own?;
            let determinant = xx * yy - xy * xy;
            let is_definite = 0.0 < xx && 0.0 < yy && 0.0 < determinant && determinant.is_finite();
            is_definite.then_some([xx, xy, yy])
        });
        Self { time, positions, covariances }
    }

    /// Detection of one object; `None` if it was not detected.
    #[must_use]
    #[inline]
    pub fn measurement(&self, object: Object) -> Option<Measurement> {
        let position = self.positions[object.index()]?;
        Some(Measurement { position, covariance: self.covariances[object.index()] })
    }
}

impl Track {
    fn begin(time: Nanos, estimate: Estimate) -> Self {
        Self { time, estimate, accepted: time, refused: None, refused_covariance: None }
    }

    /// Process a frame at `time`, which is not before the track's own time. A gap longer than
    /// [`LOST_AFTER_S`] ends the track. Two consecutive rejected detections that one motion
    /// explains reinitialize it.
    pub fn observe(
        track: &mut Option<Self>,
        filter: &ObjectFilter,
        (time, seen): (Nanos, Option<Measurement>),
        strikers: &Strikers,
    ) -> Step {
        if track.is_some_and(|own| LOST_AFTER_S < time.seconds_since(own.accepted)) {
            *track = None;
        }
        let Some(own) = track else {
            *track = seen.map(|seen| Self::begin(time, filter.start(seen)));
            return Step { region: Region::Open, innovation: None, started: track.is_some() };
        };
        let dt = time.seconds_since(own.time);
        let region = filter.predict(&mut own.estimate, dt, strikers);
        own.time = time;
        let mut step = Step { region, innovation: None, started: false };
        let Some(seen) = seen else { return step };
        let innovation = filter.update(&mut own.estimate, seen);
        step.innovation = Some(innovation);
        match innovation.gate {
            Gate::Accepted => (own.accepted, own.refused) = (time, None),
            Gate::Rejected => step.started = own.refuse(filter, time, seen),
        }
        step
    }

    /// Store a rejected detection. Reinitializes the track if the previous detection was rejected
    /// too and one motion leads from there to here.
    fn refuse(&mut self, filter: &ObjectFilter, time: Nanos, seen: Measurement) -> bool {
        let position = seen.position;
        if let Some((before, from)) = self.refused {
            let dt = time.seconds_since(before);
            let way = (position[0] - from[0]).hypot(position[1] - from[1]);
            if way < FASTEST * filter.start_speed_sigma() * dt {
                let before = Measurement { position: from, covariance: self.refused_covariance };
                *self = Self::begin(time, filter.start_between(before, seen, dt));
                return true;
            }
        }
        (self.refused, self.refused_covariance) = (Some((time, position)), seen.covariance);
        false
    }
}

/// Filters of all three objects, and the most recent frames.
///
/// Frames may arrive late and out of order. A late frame is inserted in time order and all later
/// frames are processed again, so the result equals that of the right order to the last bit.
#[derive(Debug, Clone)]
pub struct BoardFilter {
    filters: [ObjectFilter; 3],
    /// Ring buffer: `count` frames in order of time from `oldest` on, preceded by the last dropped
    /// frame, from which the oldest one can be processed again.
    ring: [Remembered; SLOTS],
    oldest: usize,
    count: usize,
    dropped: Dropped,
}

/// Slots of the ring buffer.
const SLOTS: usize = REMEMBERED_FRAMES + 1;

/// Presence of a dropped frame before the oldest one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dropped {
    None,
    Some,
}

/// A frame and the tracks after it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
struct Remembered {
    seen: Detections,
    tracks: [Option<Track>; 3],
    /// Last detected positions, this frame included.
    strikers: Strikers,
}

/// The newest frame of a [`BoardFilter`] with the tracks after it: all that later frames depend on,
/// if they arrive in order.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LastFrame(Remembered);

/// Result of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "looked at and dropped; a box would allocate")]
pub enum Observed {
    /// The frame updated the estimate; steps by [`Object::index`].
    Taken([Step; 3]),
    /// A frame of this time was processed already.
    Repeated,
    /// The frame is older than all stored frames.
    TooLate,
}

const NOTHING: Remembered = Remembered {
    seen: Detections { time: Nanos(0), positions: [None; 3], covariances: [None; 3] },
    tracks: [None; 3],
    strikers: [None; 2],
};

impl BoardFilter {
    /// Filters without any track.
    #[must_use]
    pub fn new(settings: &FilterSettings) -> Self {
        Self {
            filters: Object::ALL.map(|object| ObjectFilter::new(settings, object)),
            ring: [NOTHING; SLOTS],
            oldest: 0,
            count: 0,
            dropped: Dropped::None,
        }
    }

    /// Filters that continue after `last`, as if it were their first frame.
    #[must_use]
    pub fn resume(settings: &FilterSettings, last: Option<LastFrame>) -> Self {
        let mut filter = Self::new(settings);
        if let Some(LastFrame(frame)) = last {
            filter.ring[0] = frame;
            filter.count = 1;
        }
        filter
    }

    /// The newest frame, for [`resume`](Self::resume).
    #[must_use]
    pub fn last_frame(&self) -> Option<LastFrame> {
        Some(LastFrame(*self.frame(self.count.checked_sub(1)?)))
    }

    /// Process a frame, late or not.
    pub fn observe(&mut self, seen: &Detections) -> Observed {
        let after = self.frames_until(seen.time);
        if 0 < after && self.frame(after - 1).seen.time == seen.time {
            return Observed::Repeated;
        }
        let full = self.count == REMEMBERED_FRAMES;
        if after == 0 && (full || self.dropped == Dropped::Some) {
            return Observed::TooLate;
        }
        let at = if full { after - 1 } else { after };
        self.make_room(at);
        let slot = self.slot(at);
        self.ring[slot].seen = *seen;
        let steps = self.redo(at);
        for later in at + 1..self.count {
            self.redo(later);
        }
        Observed::Taken(steps)
    }

    /// Estimate of `object` at `time`: that of the last frame before it, predicted to `time`.
    /// `None` without a track, or if the track is lost at `time`.
    #[must_use]
    pub fn estimate_at(&self, object: Object, time: Nanos) -> Option<Estimate> {
        let known = self.frame(self.frames_until(time).checked_sub(1)?);
        let track = known.tracks[object.index()]?;
        if LOST_AFTER_S < time.seconds_since(track.accepted) {
            return None;
        }
        let mut estimate = track.estimate;
        let filter = &self.filters[object.index()];
        let ahead = time.seconds_since(track.time);
        if 0.0 < ahead {
            filter.predict(&mut estimate, ahead, &known.strikers);
        }
        Some(estimate)
    }

    /// Time of the newest frame.
    #[must_use]
    pub fn newest(&self) -> Option<Nanos> {
        Some(self.frame(self.count.checked_sub(1)?).seen.time)
    }

    /// Number of stored frames at or before `time`. Searches from the end, because most frames are
    /// the newest.
    fn frames_until(&self, time: Nanos) -> usize {
        (0..self.count).rev().find(|at| self.frame(*at).seen.time <= time).map_or(0, |at| at + 1)
    }

    /// Index in the ring buffer of frame `at`, counted from the oldest.
    fn slot(&self, at: usize) -> usize {
        (self.oldest + at) % SLOTS
    }

    fn frame(&self, at: usize) -> &Remembered {
        &self.ring[self.slot(at)]
    }

    /// Shift later frames so that `at` is free; a full buffer drops its oldest frame.
    fn make_room(&mut self, at: usize) {
        if self.count == REMEMBERED_FRAMES {
            self.dropped = Dropped::Some;
            self.oldest = self.slot(1);
        } else {
            self.count += 1;
        }
        for later in (at + 1..self.count).rev() {
            self.ring[self.slot(later)] = *self.frame(later - 1);
        }
    }

    /// Process frame `at` again from the one before it.
    fn redo(&mut self, at: usize) -> [Step; 3] {
        let first = at == 0 && self.dropped == Dropped::None;
        let before = if first { &NOTHING } else { self.frame(at + SLOTS - 1) };
        let (tracks, strikers) = (before.tracks, before.strikers);
        let slot = self.slot(at);
        let own = &mut self.ring[slot];
        own.tracks = tracks;
        own.strikers = held(strikers, &own.seen.positions);
        Object::ALL.map(|object| {
            let index = object.index();
            let seen = (own.seen.time, own.seen.measurement(object));
            Track::observe(&mut own.tracks[index], &self.filters[index], seen, &own.strikers)
        })
    }
}

/// Last detected positions of the strikers.
pub(super) fn held(before: Strikers, positions: &[Option<[f64; 2]>; 3]) -> Strikers {
    [positions[1].or(before[0]), positions[2].or(before[1])]
}
