//! Errors of reading settings and of tuning.

use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure to read settings or to tune.
#[derive(Debug, thiserror::Error)]
pub enum EkfError {
    /// A recording could not be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// No detections.
    #[error(
        "{files}: no detections on /camera/detections; record with a camera, or bring a bag in with \
         `klasktron import`"
    )]
    NoDetections {
        /// The files.
        files: String,
    },
    /// Too few frames to tune on.
    #[error(
        "{files}: the {split} runs hold {frames} frames with a detection, at least {least} are needed \
         (2.5 s at 120 Hz); record longer, or mark other runs as {split}"
    )]
    TooShort {
        /// The files.
        files: String,
        /// `train` or `validation`.
        split: &'static str,
        /// Number of frames found.
        frames: usize,
        /// Number of frames required.
        least: usize,
    },
    /// No object moves.
    #[error(
        "{files}: no object moves further than {largest_m:.4} m in the training runs, at least \
         {least_m} m are needed; record while ball or strikers move"
    )]
    NoMotion {
        /// The files.
        files: String,
        /// Largest range of a coordinate of any object (m).
        largest_m: f64,
        /// Required range (m).
        least_m: f64,
    },
    /// The settings file cannot be read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// The file is not a settings document.
    #[error(
        "{}: not the ekf.json of `klasktron tune-ekf`, schema_version 2: {reason}",
        path.display()
    )]
    NotADocument {
        /// The file.
        path: PathBuf,
        /// Description of the fault.
        reason: String,
    },
    /// A value outside its range.
    #[error("filter setting {field} is {value}; it must lie from {low} to {high}")]
    Setting {
        /// Path of the field in the document.
        field: String,
        /// Its value.
        value: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
}
