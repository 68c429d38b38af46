//! Errors of training.

use crate::{
    actuator::ActuatorError, game::GameError, nn::safetensors::SafetensorsError, ppo::PpoError,
    recording::RecordingError, twin::TwinError,
};
use std::path::PathBuf;

/// Error of starting or continuing a run.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// The settings of the state estimator cannot be read.
    #[error(transparent)]
    Ekf(#[from] crate::ekf::EkfError),
    /// A setting is outside its range.
    #[error("setting {name} is {value}; it must be {range}")]
    Setting {
        /// Its name in the settings.
        name: &'static str,
        /// Value of the setting.
        value: f64,
        /// Allowed range.
        range: &'static str,
    },
    /// The settings file cannot be read.
    #[error(
        "{path}: not a settings file of `klasktron train`: {source}; print an example with --print-settings"
    )]
    Settings {
        /// The file.
        path: PathBuf,
        /// Reason and position in the file.
        source: serde_json::Error,
    },
    /// The learner rejects its settings or inputs.
    #[error(transparent)]
    Ppo(#[from] PpoError),
    /// The game rejects its settings.
    #[error(transparent)]
    Game(#[from] GameError),
    /// The actuator file cannot be used.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// The twin file cannot be used.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A file cannot be read or written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A value became non-finite in training.
    #[error(
        "training stopped after {transitions} transitions (update {update}, seed {seed}): {reason}"
    )]
    NotFinite {
        /// Transitions of all environments before this update.
        transitions: u64,
        /// Update in which it happened, from 1.
        update: u64,
        /// Seed of the run.
        seed: u64,
        /// Name and location of the value.
        reason: String,
    },
    /// Two files or settings that do not match.
    #[error(transparent)]
    Mismatch(#[from] Box<Mismatch>),
    /// A file that is not a complete policy.
    #[error("{path}: {reason}")]
    BadPolicy {
        /// The file.
        path: PathBuf,
        /// Missing or faulty part.
        reason: String,
    },
    /// Faulty weights in a file.
    #[error("{path}: {attachment}: {source}")]
    BadWeights {
        /// The file.
        path: PathBuf,
        /// Attachment with the fault.
        attachment: String,
        /// Description of the fault.
        source: SafetensorsError,
    },
}

/// Two files or settings that do not match.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {what} is {found}, but {other} has {expected}; {remedy}")]
pub struct Mismatch {
    /// The file that does not fit.
    pub path: PathBuf,
    /// Name of the difference.
    pub what: String,
    /// Value in the file.
    pub found: String,
    /// Name of the other side of the comparison.
    pub other: &'static str,
    /// Value there.
    pub expected: String,
    /// The way out.
    pub remedy: &'static str,
}
