//! Frames of a match, from detections or from filtered states.

use super::{RefereeError, rules::Rules, vector::Vector};
use crate::{
    board::BoardSize,
    recording::{
        FrameTimes, Loss, Recording,
        message::{BoardState, CameraDetections, ObjectState, Point},
        topic::{BOARD_STATE, CAMERA_DETECTIONS},
    },
    units::Nanos,
};
use std::path::{Path, PathBuf};

/// Positions in one camera frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Capture time, if known (s since the recording began).
    pub time: f64,
    /// Ball (m); `None` without a detection.
    pub ball: Option<[f64; 2]>,
    /// Left and right striker (m).
    pub strikers: [Option<[f64; 2]>; 2],
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
    let frames = series.values.iter().zip(times).map(|(frame, taken)| Frame {
        time: taken.seconds_since(origin),
        ball: frame.ball.as_ref().map(point),
        strikers: [frame.left.as_ref().map(point), frame.right.as_ref().map(point)],
    });
    Ok(frames.collect())
}

fn board_states(recording: &Recording, origin: Nanos) -> Result<Vec<Frame>, RefereeError> {
    let position = |state: &ObjectState| [state.x, state.y];
    let series = recording.series::<BoardState>(BOARD_STATE)?;
    let frames = series.iter().map(|(arrival, state)| Frame {
        time: arrival.seconds_since(origin),
        ball: state.ball.as_ref().map(position),
        strikers: [state.left.as_ref().map(position), state.right.as_ref().map(position)],
    });
    Ok(frames.collect())
}
