//! `ekf.mcap`: estimates and measurements for MCAP viewers.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/camera/detections` | `CameraDetections` | detections of the validation runs, at capture time |
//! | `/board/state` | `BoardState` | estimate after each frame, at the same time |
//! | `/ekf/upstream/board_state` | `BoardState` | estimate of the upstream filter |
//! | `/truth/board/state` | `BoardState` | ground truth, where a simulator wrote it |
//!
//! Attachment: `ekf.json`.

use super::{document::Document, evaluate::EvaluatedFrame};
use crate::recording::{
    ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
    message::{BoardState, CameraDetections, Covariance, ObjectState, Point},
    topic,
};
use std::{collections::BTreeMap, path::Path};

/// Topic of the upstream filter's estimates.
pub const UPSTREAM_TOPIC: &str = "/ekf/upstream/board_state";

/// Write `ekf.mcap`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_recording(tuned: &super::Tuned, path: &Path) -> Result<(), RecordingError> {
    let mut writer = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
    writer.metadata(RECORDING_METADATA, metadata(&tuned.document))?;
    let mut frames: Vec<&EvaluatedFrame> = tuned.runs.iter().flat_map(|run| &run.frames).collect();
    frames.sort_by_key(|judged| judged.frame.seen.time);
    for judged in frames {
        let seen = judged.frame.seen;
        let [ball, left, right] = seen.positions.map(|p| p.map(|[x, y]| Point { x, y }));
        let covariance = |[xx, xy, yy]: [f64; 3]| Covariance { xx, xy, yy };
        let [ball_covariance, left_covariance, right_covariance] =
            seen.covariances.map(|own| own.map(covariance));
        let detections = CameraDetections {
            capture_time_ns: seen.time.0,
            ball,
            left,
            right,
            ball_covariance,
            left_covariance,
            right_covariance,
        };
        writer.write(topic::CAMERA_DETECTIONS, seen.time, &detections)?;
        let estimate = board_state(judged.estimates.map(|own| own.map(|own| own.mean)));
        writer.write(topic::BOARD_STATE, seen.time, &estimate)?;
        writer.write(UPSTREAM_TOPIC, seen.time, &board_state(judged.upstream))?;
        if judged.frame.truth.iter().any(Option::is_some) {
            writer.write(super::TRUTH_TOPIC, seen.time, &board_state(judged.frame.truth))?;
        }
    }
    writer.attach("ekf.json", "application/json", tuned.document.to_json().as_bytes())?;
    writer.finish()
}

/// Build a message from states by [`super::Object::index`], each (x, y, vx, vy) (m, m/s).
#[must_use]
pub fn board_state(states: [Option<[f64; 4]>; 3]) -> BoardState {
    let [ball, left, right] =
        states.map(|state| state.map(|[x, y, vx, vy]| ObjectState { x, y, vx, vy }));
    BoardState { ball, left, right, status: 0 }
}

fn metadata(document: &Document) -> BTreeMap<String, String> {
    let provenance = &document.provenance;
    let mut metadata: BTreeMap<String, String> = [
        ("schema_version", "1"),
        ("source", "simulation"),
        ("session", "ekf"),
        ("split", "validation"),
        ("command_line", &provenance.command_line),
        ("crate_version", provenance.crate_version),
        ("git_hash", provenance.git_hash),
    ]
    .map(|(key, value)| (key.to_owned(), value.to_owned()))
    .into();
    for (index, input) in document.inputs.iter().enumerate() {
        metadata.insert(format!("input_{index}"), input.name.clone());
        metadata.insert(format!("input_{index}_sha256"), input.sha256.clone());
    }
    metadata
}
