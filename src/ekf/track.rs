//! What detections make of objects: start, follow, lose, find again; late and repeated frames.

use super::{
    filter::{Gate, Innovation, ObjectFilter},
    motion::Estimate,
    region::{Region, Strikers},
    settings::{FilterSettings, Object},
};
use crate::{
    recording::message::{CameraDetections, Point},
    units::Nanos,
};

/// Without an accepted detection for longer, the belief is given up (s).
pub const LOST_AFTER_S: f64 = 0.25;
/// Frames that are remembered, so that a late one can be put where it belongs: 0.27 s at 120 Hz.
pub const REMEMBERED_FRAMES: usize = 32;
/// Two refused detections start anew where they would be this many standard deviations of the start
/// speed apart at most.
const FASTEST: f64 = 4.0;

/// What the camera saw at one instant: places (m) of ball, left and right striker.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// When the picture was taken.
    pub time: Nanos,
    /// Places by [`Object::index`]; `None` for what was not seen.
    pub places: [Option<[f64; 2]>; 3],
}

/// One object as it is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Track {
    /// When `estimate` holds.
    pub time: Nanos,
    /// The belief.
    pub estimate: Estimate,
    /// Last accepted detection.
    accepted: Nanos,
    /// The last detection, where it was refused.
    refused: Option<(Nanos, [f64; 2])>,
}

/// What happened to one object in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Where the ball was predicted.
    pub region: Region,
    /// The detection less its prediction; `None` where nothing was seen or nothing was predicted.
    pub innovation: Option<Innovation>,
    /// Whether the belief was started or started anew with this frame.
    pub started: bool,
}

impl Seen {
    /// A picture that was taken at `time`.
    #[must_use]
    pub fn of(time: Nanos, picture: &CameraDetections) -> Self {
        let places = [picture.ball, picture.left, picture.right].map(|point| {
            point.map(|Point { x, y }| [x, y]).filter(|place| place.iter().all(|x| x.is_finite()))
        });
        Self { time, places }
    }
}

impl Track {
    fn begin(time: Nanos, estimate: Estimate) -> Self {
        Self { time, estimate, accepted: time, refused: None }
    }

    /// Takes a frame at `time`, not before the track's own. A gap longer than [`LOST_AFTER_S`] ends
    /// the belief; two refused detections in a row that one motion explains start it anew.
    pub fn observe(
        track: &mut Option<Self>,
        filter: &ObjectFilter,
        (time, place): (Nanos, Option<[f64; 2]>),
        strikers: &Strikers,
    ) -> Step {
        if track.is_some_and(|own| LOST_AFTER_S < time.seconds_since(own.accepted)) {
            *track = None;
        }
        let Some(own) = track else {
            *track = place.map(|place| Self::begin(time, filter.start(place)));
            return Step { region: Region::Open, innovation: None, started: track.is_some() };
        };
        let dt = time.seconds_since(own.time);
        let region = filter.predict(&mut own.estimate, dt, strikers);
        own.time = time;
        let mut step = Step { region, innovation: None, started: false };
        let Some(place) = place else { return step };
        let innovation = filter.update(&mut own.estimate, place);
        step.innovation = Some(innovation);
        match innovation.gate {
            Gate::Accepted => (own.accepted, own.refused) = (time, None),
            Gate::Refused => step.started = own.refuse(filter, time, place),
        }
        step
    }

    /// Remembers a refused detection; starts anew where the one before it was refused as well and one
    /// motion leads from there to here.
    fn refuse(&mut self, filter: &ObjectFilter, time: Nanos, place: [f64; 2]) -> bool {
        if let Some((before, from)) = self.refused {
            let dt = time.seconds_since(before);
            let way = (place[0] - from[0]).hypot(place[1] - from[1]);
            if way < FASTEST * filter.start_speed_sigma() * dt {
                *self = Self::begin(time, filter.start_between(from, place, dt));
                return true;
            }
        }
        self.refused = Some((time, place));
        false
    }
}

/// The filters of all three objects, and the frames of the last moments.
///
/// Frames may come late and out of order: a late one is put where it belongs among the remembered
/// ones, and those after it are done again, so the result is that of the right order to the last bit.
#[derive(Debug, Clone)]
pub struct BoardFilter {
    filters: [ObjectFilter; 3],
    /// A ring: `count` frames in order of time from `oldest` on, and before them the last one that was
    /// dropped, from which the oldest can be done again.
    ring: [Remembered; SLOTS],
    oldest: usize,
    count: usize,
    dropped: Dropped,
}

/// Places of the ring.
const SLOTS: usize = REMEMBERED_FRAMES + 1;

/// Whether a frame was dropped before the oldest one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Dropped {
    None,
    Some,
}

/// A frame and what is believed after it.
#[derive(Debug, Clone, Copy)]
struct Remembered {
    seen: Seen,
    tracks: [Option<Track>; 3],
    /// Last seen places, this frame included.
    strikers: Strikers,
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "looked at and dropped; a box would allocate")]
pub enum Observed {
    /// It is in the estimate; steps by [`Object::index`].
    Taken([Step; 3]),
    /// A frame of this time is in the estimate already.
    Repeated,
    /// It is older than everything that is remembered.
    TooLate,
}

const NOTHING: Remembered = Remembered {
    seen: Seen { time: Nanos(0), places: [None; 3] },
    tracks: [None; 3],
    strikers: [None; 2],
};

impl BoardFilter {
    /// Filters that know nothing yet.
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

    /// Takes a frame, late or not.
    pub fn observe(&mut self, seen: &Seen) -> Observed {
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

    /// The belief about `object` at `time`: that of the last frame before it, moved ahead. `None` where
    /// nothing is known, or the object is lost at `time`.
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

    /// How many remembered frames are not after `time`; most frames are the newest, so it looks from
    /// the end.
    fn frames_until(&self, time: Nanos) -> usize {
        (0..self.count).rev().find(|at| self.frame(*at).seen.time <= time).map_or(0, |at| at + 1)
    }

    /// Place in the ring of the frame `at`, counted from the oldest.
    fn slot(&self, at: usize) -> usize {
        (self.oldest + at) % SLOTS
    }

    fn frame(&self, at: usize) -> &Remembered {
        &self.ring[self.slot(at)]
    }

    /// Moves later frames up so that `at` is free; where all places are taken the oldest frame goes.
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

    /// Does frame `at` again from the one before it.
    fn redo(&mut self, at: usize) -> [Step; 3] {
        let first = at == 0 && self.dropped == Dropped::None;
        let before = if first { &NOTHING } else { self.frame(at + SLOTS - 1) };
        let (tracks, strikers) = (before.tracks, before.strikers);
        let slot = self.slot(at);
        let own = &mut self.ring[slot];
        own.tracks = tracks;
        own.strikers = held(strikers, &own.seen.places);
        Object::ALL.map(|object| {
            let index = object.index();
            let seen = (own.seen.time, own.seen.places[index]);
            Track::observe(&mut own.tracks[index], &self.filters[index], seen, &own.strikers)
        })
    }
}

/// Where the strikers were last seen.
pub(super) fn held(before: Strikers, places: &[Option<[f64; 2]>; 3]) -> Strikers {
    [places[1].or(before[0]), places[2].or(before[1])]
}
