//! Frames of a match, from detections or from filtered states.

use super::{RefereeError, rules::Rules, vector::Vector};
use crate::{
    board::BoardSize,
    recording::{
        FrameTimes, Loss, Recording, RecordingError,
        message::{BoardState, CameraDetections, CameraFrame, ObjectState, Point},
        topic::{BOARD_STATE, CAMERA_DETECTIONS, CAMERA_FRAME},
    },
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Positions in one camera frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Frame {
    /// Capture time, if known (s since the recording began).
    pub time: f64,
    /// Ball (m); `None` without a detection.
    pub ball: Option<[f64; 2]>,
    /// Left and right striker (m).
    pub strikers: [Option<[f64; 2]>; 2],
    /// Biscuits, in no order (m).
    pub biscuits: [Option<[f64; 2]>; 3],
}

impl Frame {
    /// Frame at `time` (s) of the camera's `detections`, without biscuits.
    #[must_use]
    pub fn of(time: f64, detections: &CameraDetections) -> Self {
        let seen = |object: &Option<Point>| object.as_ref().map(point);
        let strikers = [&detections.left, &detections.right].map(seen);
        Self { time, ball: seen(&detections.ball), strikers, ..Self::default() }
    }
}

/// Source topic of the frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// `/camera/detections`.
    Detections,
    /// `/board/state`: filtered, so impacts are smoothed and delayed by the filter.
    BoardState,
}

/// The frames of a match before its analysis.
#[derive(Debug, Clone)]
pub struct MatchFrames {
    /// The recording.
    pub path: PathBuf,
    /// Its SHA-256, in hexadecimal.
    pub sha256: String,
    /// Time of its beginning: the first message, or the capture of the first frame.
    pub origin: Nanos,
    /// Losses of a damaged file.
    pub loss: Loss,
    /// Source of the frames.
    pub source: Source,
    /// Size of the board, if the recording contains it.
    pub board: Option<BoardSize>,
    /// Frames in the order of reception.
    pub frames: Vec<Frame>,
}

impl MatchFrames {
    /// Read a match. Detections of the camera are preferred to the filtered state of the board.
    ///
    /// # Errors
    /// When the file cannot be read or decoded, or has neither topic.
    pub fn open(path: &Path) -> Result<Self, RefereeError> {
        let recording = Recording::open(path)?;
        let Some((origin, _)) = recording.time_range() else {
            return Err(RefereeError::NoFrames { path: path.to_owned(), topics: String::new() });
        };
        let (source, frames) = if 0 < recording.count(CAMERA_DETECTIONS) {
            (Source::Detections, detections(&recording, origin)?)
        } else if 0 < recording.count(BOARD_STATE) {
            (Source::BoardState, board_states(&recording, origin)?)
        } else {
            let topics: Vec<&str> = recording.channels.iter().map(|c| c.topic.as_str()).collect();
            return Err(RefereeError::NoFrames {
                path: path.to_owned(),
                topics: topics.join(", "),
            });
        };
        // A frame was captured before its message arrived, the first one before the recording
        // began.
        let first = frames.iter().map(|frame| frame.time).fold(0.0, f64::min);
        let frames = frames.into_iter().map(|f| Frame { time: f.time - first, ..f }).collect();
        let side = |key: &str| recording.info(key).and_then(|text| text.parse().ok());
        let board = side("board_short_side_m")
            .zip(side("board_long_side_m"))
            .and_then(|(short, long)| BoardSize::new(short, long).ok());
        Ok(Self {
            path: path.to_owned(),
            sha256: recording.sha256,
            origin: origin.after_seconds(first),
            loss: recording.loss,
            source,
            board,
            frames,
        })
    }

    /// Rules with this match's board.
    #[must_use]
    pub fn rules(&self, rules: &Rules) -> Rules {
        Rules { board: self.board.unwrap_or(rules.board), ..*rules }
    }
}

fn point(point: &Point) -> Vector {
    [point.x, point.y]
}

fn detections(recording: &Recording, origin: Nanos) -> Result<Vec<Frame>, RefereeError> {
    let series = recording.series::<CameraDetections>(CAMERA_DETECTIONS)?;
    let times = FrameTimes::of(&series).taken;
    let biscuits = biscuits(recording)?;
    let frames = series.values.iter().zip(times).map(|(seen, taken)| Frame {
        biscuits: biscuits.get(&seen.capture_time_ns).copied().unwrap_or_default(),
        ..Frame::of(taken.seconds_since(origin), seen)
    });
    Ok(frames.collect())
}

/// Biscuits by the capture time of their frame (ns), where a detector of this program recorded them.
fn biscuits(recording: &Recording) -> Result<BTreeMap<u64, [Option<Vector>; 3]>, RecordingError> {
    if recording.count(CAMERA_FRAME) == 0 {
        return Ok(BTreeMap::new());
    }
    let series = recording.series::<CameraFrame>(CAMERA_FRAME)?;
    let of = |frame: &CameraFrame| {
        let mut found = [None; 3];
        for (own, seen) in found.iter_mut().zip(&frame.biscuits) {
            *own = Some(point(seen));
        }
        (frame.capture_time_ns, found)
    };
    Ok(series.values.iter().map(of).collect())
}

fn board_states(recording: &Recording, origin: Nanos) -> Result<Vec<Frame>, RefereeError> {
    let position = |state: &ObjectState| [state.x, state.y];
    let series = recording.series::<BoardState>(BOARD_STATE)?;
    let frames = series.iter().map(|(arrival, state)| Frame {
        time: arrival.seconds_since(origin),
        ball: state.ball.as_ref().map(position),
        strikers: [state.left.as_ref().map(position), state.right.as_ref().map(position)],
        ..Frame::default()
    });
    Ok(frames.collect())
}
