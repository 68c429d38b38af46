//! Why there is no filter.

use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure to read settings or to tune.
#[derive(Debug, thiserror::Error)]
pub enum EkfError {
    /// A recording could not be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The camera saw nothing.
    #[error(
        "{files}: no detections on /camera/detections; record with a camera, or bring a bag in with \
         `klasktron import`"
    )]
    NoDetections {
        /// The files.
        files: String,
    },
    /// Too little to tune anything.
    #[error(
        "{files}: {split} runs hold {frames} frames in which something was seen, at least {least} \
         are needed (2.5 s at 120 Hz); record longer, or mark other runs as {split}"
    )]
    TooShort {
        /// The files.
        files: String,
        /// `train` or `validation`.
        split: &'static str,
        /// Frames there are.
        frames: usize,
        /// Frames there must be.
        least: usize,
    },
    /// Nothing moves.
    #[error(
        "{files}: nothing moves further than {largest_m:.4} m in the train runs, at least {least_m} \
         m are needed; record while ball or strikers move"
    )]
    NoMotion {
        /// The files.
        files: String,
        /// Largest range of a coordinate of any object (m).
        largest_m: f64,
        /// What is needed (m).
        least_m: f64,
    },
    /// The file of settings could not be read.
    #[error("{}: cannot read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The file of settings is none.
    #[error(
        "{}: not the ekf.json of `klasktron tune-ekf`, schema_version \"1\": {reason}",
        path.display()
    )]
    NotADocument {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
    /// A number with which no filter works.
    #[error("filter setting {field} is {value}; it must lie from {low} to {high}")]
    Setting {
        /// Its path in the document.
        field: String,
        /// Its value.
        value: f64,
        /// Least allowed.
        low: f64,
        /// Largest allowed.
        high: f64,
    },
}
