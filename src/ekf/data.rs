//! Recordings as runs of frames in order of capture, with ground truth where a simulator wrote it.

use super::{error::EkfError, settings::Object, track::Detections};
use crate::{
    recording::{
        Recording, RecordingError, Series, Split,
        message::{BoardState, CameraDetections, ObjectState},
        topic,
    },
    stats::median,
    twin::{divide, runs_of},
    units::Nanos,
};

/// Minimum number of frames with a detection on either side of the split: 2.5 s at 120 Hz.
const LEAST_FRAMES: usize = 300;
/// Minimum range of a coordinate that counts as motion (m).
const LEAST_MOTION_M: f64 = 0.01;
/// Minimum difference of two camera timestamps that counts as a running clock (s).
const STANDING_CLOCK_S: f64 = 1e-6;
/// Maximum difference of capture stamp and arrival for a camera that shares the host's clock (s).
const LARGEST_LATENCY_S: f64 = 1.0;
/// Topic of the ground truth.
pub const TRUTH_TOPIC: &str = topic::TRUE_BOARD_STATE;
/// Maximum distance of truth samples that are interpolated (s).
const TRUTH_GAP_S: f64 = 0.01;
/// Maximum change of velocity between interpolated truth samples (m/s); a larger one is an impact.
const TRUTH_JUMP_M_PER_S: f64 = 0.2;

/// One camera frame: detections and ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Input of the filters.
    pub seen: Detections,
    /// True state (x, y, vx, vy) by object (m, m/s), where a simulator wrote it.
    pub truth: [Option<[f64; 4]>; 3],
}

/// Frames of one run in order of time; filters start anew with each run.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRun {
    /// Use of the run: training or validation.
    pub split: Split,
    /// Name of the recording and number of the run in it.
    pub name: String,
    /// The frames.
    pub frames: Vec<Frame>,
}

impl FrameRun {
    /// Duration from the first to the last frame (s).
    #[must_use]
    pub fn duration(&self) -> f64 {
        let [first, last] =
            [self.frames.first(), self.frames.last()].map(|f| f.map(|f| f.seen.time));
        first.zip(last).map_or(0.0, |(first, last)| last.seconds_since(first))
    }
}

/// All runs of all recordings.
#[derive(Debug, Clone, PartialEq)]
pub struct Data {
    /// The runs.
    pub runs: Vec<FrameRun>,
    /// Median time from capture to arrival (s); `None` where camera and host do not share a clock.
    pub latency_s: Option<f64>,
}

impl Data {
    /// Read the runs of `recordings`, divided into training and validation by markers, metadata or
    /// otherwise by [`divide`].
    ///
    /// # Errors
    /// When a message does not decode, nothing was detected, there are too few frames, or nothing
    /// moves.
    pub fn from_recordings(recordings: &[Recording]) -> Result<Self, EkfError> {
        let mut spans =
            recordings.iter().map(runs_of).collect::<Result<Vec<_>, RecordingError>>()?;
        divide(&mut spans);
        let mut runs = Vec::new();
        let mut ages = Vec::new();
        for (recording, spans) in recordings.iter().zip(&spans) {
            let Some((began, _)) = recording.time_range() else { continue };
            let (frames, age) = frames_of(recording)?;
            ages.extend(age);
            for (number, span) in spans.iter().enumerate() {
                let inside = frames
                    .iter()
                    .filter(|(arrival, _)| span.span.contains(&arrival.seconds_since(began)));
                let stem = recording.path.file_stem().unwrap_or_default().to_string_lossy();
                runs.push(FrameRun {
                    split: span.split.unwrap_or(Split::Train),
                    name: format!("{stem} {number} {}", span.pattern).trim_end().to_owned(),
                    frames: inside.map(|(_, frame)| *frame).collect(),
                });
            }
        }
        runs.retain(|run| run.frames.iter().any(Frame::shows_something));
        let data = Self { runs, latency_s: median(&ages) };
        data.check(recordings)?;
        Ok(data)
    }

    /// Runs of one side of the split.
    pub fn runs_for(&self, split: Split) -> impl Iterator<Item = &FrameRun> {
        self.runs.iter().filter(move |run| run.split == split)
    }

    fn check(&self, recordings: &[Recording]) -> Result<(), EkfError> {
        let names: Vec<String> =
            recordings.iter().map(|recording| recording.path.display().to_string()).collect();
        let files = names.join(", ");
        if self.runs.is_empty() {
            return Err(EkfError::NoDetections { files });
        }
        for split in [Split::Train, Split::Validation] {
            let frames = || self.runs_for(split).flat_map(|run| &run.frames);
            let frames = frames().filter(|frame| frame.shows_something()).count();
            if frames < LEAST_FRAMES {
                let split = if split == Split::Train { "train" } else { "validation" };
                return Err(EkfError::TooShort { files, split, frames, least: LEAST_FRAMES });
            }
        }
        let largest_m = Object::ALL.into_iter().map(|o| self.range(o)).fold(0.0, f64::max);
        if largest_m < LEAST_MOTION_M {
            return Err(EkfError::NoMotion { files, largest_m, least_m: LEAST_MOTION_M });
        }
        Ok(())
    }

    /// Return whether `object` moves in the training runs by more than noise.
    #[must_use]
    pub fn moves(&self, object: Object) -> bool {
        LEAST_MOTION_M < self.range(object)
    }

    /// Reason why a stationary object is not tuned.
    pub(super) fn still(&self, object: Object) -> String {
        let seen = |frame: &Frame| frame.seen.positions[object.index()].is_some();
        if self.runs_for(Split::Train).any(|run| run.frames.iter().any(seen)) {
            "it does not move in the training runs".to_owned()
        } else {
            "it is not detected in the training runs".to_owned()
        }
    }

    /// Larger range of the two coordinates of `object` within a training run (m).
    fn range(&self, object: Object) -> f64 {
        let mut largest: f64 = 0.0;
        for run in self.runs_for(Split::Train) {
            for axis in 0..2 {
                let positions: Vec<f64> = run
                    .frames
                    .iter()
                    .filter_map(|frame| frame.seen.positions[object.index()])
                    .map(|position| position[axis])
                    .collect();
                let ends = [0.02, 0.98].map(|share| crate::stats::quantile(&positions, share));
                largest = largest.max(ends[1].zip(ends[0]).map_or(0.0, |(high, low)| high - low));
            }
        }
        largest
    }
}

impl Frame {
    fn shows_something(&self) -> bool {
        self.seen.positions.iter().any(Option::is_some)
    }
}

/// Frames with their arrival times, and the capture-to-arrival latency (s).
type Arrivals = (Vec<(Nanos, Frame)>, Option<f64>);

/// Frames with their arrival times in order of capture, and the capture-to-arrival latency (s)
/// where the camera shares the host's clock. Otherwise arrival times are used.
fn frames_of(recording: &Recording) -> Result<Arrivals, EkfError> {
    let detections = recording.series::<CameraDetections>(topic::CAMERA_DETECTIONS)?;
    let truth = Truth(recording.series(TRUTH_TOPIC)?);
    let age = age(&detections);
    let has_clock = runs_on(&detections);
    let mut frames: Vec<(Nanos, Frame)> = detections
        .iter()
        .map(|(arrival, found)| {
            let time = if has_clock { Nanos(found.capture_time_ns) } else { arrival };
            let truth = if age.is_some() { truth.at(time) } else { [None; 3] };
            (arrival, Frame { seen: Detections::of(time, found), truth })
        })
        .collect();
    frames.sort_by_key(|(_, frame)| frame.seen.time);
    frames.dedup_by_key(|(_, frame)| frame.seen.time);
    Ok((frames, age))
}

/// Return whether the camera has a running clock.
fn runs_on(detections: &Series<CameraDetections>) -> bool {
    let stamps = || detections.values.iter().map(|found| Nanos(found.capture_time_ns));
    let ends = stamps().min().zip(stamps().max());
    let count = detections.values.len().max(2) - 1;
    ends.is_some_and(|(first, last)| STANDING_CLOCK_S * count as f64 <= last.seconds_since(first))
}

/// Median capture-to-arrival latency (s).
fn age(detections: &Series<CameraDetections>) -> Option<f64> {
    if !runs_on(detections) {
        return None;
    }
    let ages: Vec<f64> = detections
        .iter()
        .map(|(arrival, found)| arrival.seconds_since(Nanos(found.capture_time_ns)))
        .collect();
    median(&ages).filter(|age| (0.0..LARGEST_LATENCY_S).contains(age))
}

/// Ground truth on the host's clock.
struct Truth(Series<BoardState>);

impl Truth {
    fn at(&self, time: Nanos) -> [Option<[f64; 4]>; 3] {
        let after = self.0.times.partition_point(|sample| *sample < time);
        let Some(next) = self.0.values.get(after) else { return [None; 3] };
        if self.0.times[after] == time {
            return states(next);
        }
        let Some(before) = after.checked_sub(1) else { return [None; 3] };
        let gap = self.0.times[after].seconds_since(self.0.times[before]);
        if TRUTH_GAP_S < gap {
            return [None; 3];
        }
        let share = time.seconds_since(self.0.times[before]) / gap;
        let (from, to) = (states(&self.0.values[before]), states(next));
        std::array::from_fn(|object| {
            let (from, to) = (from[object]?, to[object]?);
            let jump = (to[2] - from[2]).hypot(to[3] - from[3]);
            (jump < TRUTH_JUMP_M_PER_S)
                .then(|| std::array::from_fn(|k| from[k] + share * (to[k] - from[k])))
        })
    }
}

fn states(state: &BoardState) -> [Option<[f64; 4]>; 3] {
    let own = |state: &Option<ObjectState>| state.as_ref().map(|s| [s.x, s.y, s.vx, s.vy]);
    [own(&state.ball), own(&state.left), own(&state.right)]
}
