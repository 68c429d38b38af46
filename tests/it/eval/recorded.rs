//! Games as recordings, and as frames.

use super::game::{Game, Picture};
use crate::support::{START, writer};
use klasktron::{
    recording::{
        message::{BoardState, CameraDetections, CameraFrame, ObjectState, Point},
        topic,
    },
    referee::Frame,
};
use std::path::{Path, PathBuf};

/// The pictures as the referee takes them.
pub(super) fn frames(game: &Game) -> Vec<Frame> {
    game.pictures
        .iter()
        .map(|p| Frame { time: p.time, ball: p.ball, strikers: p.strikers, ..Frame::default() })
        .collect()
}

/// To hundredths of a millimetre, which packs to half the size.
fn point(place: [f64; 2]) -> Point {
    let [x, y] = place.map(|metres| (metres * 1e5).round() / 1e5);
    Point { x, y }
}

fn detections(picture: &Picture) -> CameraDetections {
    CameraDetections {
        capture_time_ns: START.after_seconds(picture.time).0,
        ball: picture.ball.map(point),
        left: picture.strikers[0].map(point),
        right: picture.strikers[1].map(point),
        ..CameraDetections::default()
    }
}

/// Writes detections of the camera, 5 ms late.
pub(super) fn write_detections(pictures: &[Picture], dir: &Path, name: &str) -> PathBuf {
    let path = dir.join(name);
    let mut file = writer(&path, "match");
    for picture in pictures {
        let capture = START.after_seconds(picture.time);
        let message = detections(picture);
        let arrival = capture.after_seconds(0.005);
        file.write_published(topic::CAMERA_DETECTIONS, arrival, capture, &message).unwrap();
    }
    file.finish().unwrap();
    path
}

/// Two biscuits lie on the left striker from `since` (s) on, as this program's detector records them.
pub(super) fn write_detections_with_biscuits(
    pictures: &[Picture],
    since: f64,
    dir: &Path,
    name: &str,
) -> PathBuf {
    let path = dir.join(name);
    let mut file = writer(&path, "match");
    for picture in pictures {
        let capture = START.after_seconds(picture.time);
        let held = picture.strikers[0].filter(|_| since <= picture.time);
        let on = |[x, y]: [f64; 2]| [[x + 0.014, y], [x, y - 0.014]].map(point).to_vec();
        let message = CameraFrame {
            capture_time_ns: capture.0,
            biscuits: held.map(on).unwrap_or_default(),
            ..CameraFrame::default()
        };
        file.write(topic::CAMERA_FRAME, capture.after_seconds(0.005), &message).unwrap();
        let seen = detections(picture);
        file.write_published(
            topic::CAMERA_DETECTIONS,
            capture.after_seconds(0.005),
            capture,
            &seen,
        )
        .unwrap();
    }
    file.finish().unwrap();
    path
}

/// Writes every second picture as a state of the board, as an imported bag has it.
pub(super) fn write_states(pictures: &[Picture], dir: &Path, name: &str) -> PathBuf {
    let path = dir.join(name);
    let mut file = writer(&path, "match");
    let state = |place: [f64; 2]| ObjectState { x: place[0], y: place[1], vx: 0.0, vy: 0.0 };
    for picture in pictures.iter().step_by(2) {
        let message = BoardState {
            ball: picture.ball.map(state),
            left: picture.strikers[0].map(state),
            right: picture.strikers[1].map(state),
            status: 1,
        };
        file.write(topic::BOARD_STATE, START.after_seconds(picture.time), &message).unwrap();
    }
    file.finish().unwrap();
    path
}
