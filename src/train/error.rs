//! What can go wrong.

use crate::{
    actuator::ActuatorError, game::GameError, nn::safetensors::SafetensorsError, ppo::PpoError,
    recording::RecordingError, twin::TwinError,
};
use std::path::PathBuf;

/// Why there is no run, or why it ended.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    /// A setting is outside its range.
    #[error("setting {name} is {value}; it must be {range}")]
    Setting {
        /// Its name in the settings.
        name: &'static str,
        /// What it is.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// The settings cannot be read.
    #[error(
        "{path} holds no settings of `train`: {source}; `klasktron train --print-settings` prints some"
    )]
    Settings {
        /// The file.
        path: PathBuf,
        /// Where it departs from them.
        source: serde_json::Error,
    },
    /// The learner refuses its settings or numbers.
    #[error(transparent)]
    Ppo(#[from] PpoError),
    /// The game refuses its settings.
    #[error(transparent)]
    Game(#[from] GameError),
    /// The actuator's file cannot be used.
    #[error(transparent)]
    Actuator(#[from] ActuatorError),
    /// The twin cannot be used.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A file cannot be read or written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A number left the range in training.
    #[error(
        "training stopped after {transitions} transitions (update {update}, seed {seed}): {reason}"
    )]
    NotFinite {
        /// Transitions of all environments before this update.
        transitions: u64,
        /// The update in which it happened, from 1.
        update: u64,
        /// The user's seed.
        seed: u64,
        /// What left the range, and where.
        reason: String,
    },
    /// Two things that do not belong together.
    #[error(transparent)]
    Mismatch(#[from] Box<Mismatch>),
    /// A file that is no policy, or half of one.
    #[error("{path}: {reason}")]
    BadPolicy {
        /// The file.
        path: PathBuf,
        /// What is missing or wrong.
        reason: String,
    },
    /// Weights in a file that are none.
    #[error("{path}: {attachment}: {source}")]
    BadWeights {
        /// The file.
        path: PathBuf,
        /// Which part of it.
        attachment: String,
        /// What is wrong.
        source: SafetensorsError,
    },
}

/// Two things that do not belong together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path}: {what} is {found}, but {other} has {expected}; {remedy}")]
pub struct Mismatch {
    /// The file that does not fit.
    pub path: PathBuf,
    /// What differs.
    pub what: String,
    /// In the file.
    pub found: String,
    /// What it is compared with.
    pub other: &'static str,
    /// There.
    pub expected: String,
    /// The way out.
    pub remedy: &'static str,
}
