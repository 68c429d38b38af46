//! A match as the referee gets it: frames of positions, from whatever the recording holds.

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

/// What one picture showed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// When it was taken, as far as it is known (s since the recording began).
    pub time: f64,
    /// The ball (m); absent when it was not seen.
    pub ball: Option<[f64; 2]>,
    /// Left and right striker (m).
    pub strikers: [Option<[f64; 2]>; 2],
}

/// Which topic the frames come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// `/camera/detections`.
    Detections,
    /// `/board/state`: filtered, so impacts are smeared and late by the filter's lag.
    BoardState,
}

/// A match before it is judged.
#[derive(Debug, Clone)]
pub struct MatchFrames {
    /// The recording.
    pub path: PathBuf,
    /// Its SHA-256, in hexadecimal.
    pub sha256: String,
    /// When it began: at its first message, or when the first picture was taken.
    pub origin: Nanos,
    /// What a damaged file no longer holds.
    pub loss: Loss,
    /// Where the frames come from.
    pub source: Source,
    /// The board's size, where the recording says it.
    pub board: Option<BoardSize>,
    /// The frames, in the order in which they were received.
    pub frames: Vec<Frame>,
}

impl MatchFrames {
    /// Reads a match. Detections of the camera are preferred to the filtered state of the board.
    ///
    /// # Errors
    /// When the file cannot be read or understood, or holds neither topic.
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
        // A picture was taken before its message arrived, the first one before the recording began.
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

    /// `rules` on this match's board.
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
