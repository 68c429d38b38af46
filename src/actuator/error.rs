//! Errors of the actuator model, each with its remedy.

use crate::recording::RecordingError;
use std::path::PathBuf;

/// Failure to prepare data for, fit, store or read an actuator model.
#[derive(Debug, thiserror::Error)]
pub enum ActuatorError {
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A topic required by the fit is missing.
    #[error("{}: no messages on {topic}; the topics that it has are: {available}", path.display())]
    NoTopic {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Topics with messages.
        available: String,
    },
    /// A message holds NaN or infinity.
    #[error(
        "{}: topic {topic}, message {index}: {field} is {value}; drop or repair these messages and \
         import the recording again", path.display()
    )]
    NonFinite {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Position in order of time, from 0.
        index: usize,
        /// The field.
        field: &'static str,
        /// Its value.
        value: f64,
    },
    /// The log time of a topic decreases in file order.
    #[error(
        "{}: time runs backwards on {topic} at message {index} (by {seconds} s); sort it with \
         `klasktron recover {} -o OUT.mcap` if only the order is wrong, or record it again",
        path.display(), path.display()
    )]
    TimeBackwards {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Index of the first message that is earlier than its predecessor.
        index: usize,
        /// Step back in time (s).
        seconds: f64,
    },
    /// The command or the motion never changes.
    #[error(
        "{}: {topic} never changes over {runs} runs ({what}); a model needs commands that move the \
         carriage: check that the motors were armed and the right player was chosen", path.display()
    )]
    Constant {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Number of runs examined.
        runs: usize,
        /// Name of the constant signal.
        what: &'static str,
    },
    /// No run is long enough for one window.
    #[error(
        "{}: the longest of {runs} runs has {longest} samples at {rate_hz} Hz, and one window needs \
         {needed}; record longer runs or lower --history or --horizon", path.display()
    )]
    TooShort {
        /// The file.
        path: PathBuf,
        /// Number of runs.
        runs: usize,
        /// Length of the longest run in samples.
        longest: usize,
        /// Length of one window in samples.
        needed: usize,
        /// Sampling rate (Hz).
        rate_hz: f64,
    },
    /// No run is left to hold out.
    #[error(
        "all the data is one run, and whole runs are held out for validation, never samples; give a \
         second recording, or one with several run markers (`klasktron info` lists the runs)"
    )]
    OneRun,
    /// Every run is marked for validation.
    #[error(
        "all {runs} runs are marked split=validation, and those are never fitted; give at least one \
         recording that is not"
    )]
    NothingToTrain {
        /// Number of runs.
        runs: usize,
    },
    /// Two recordings come from different robots.
    #[error(
        "{} has {key}={first}, {} has {key}={second}; fit each robot on its own",
        first_path.display(), second_path.display()
    )]
    MixedRobots {
        /// Metadata key that differs.
        key: &'static str,
        /// One file.
        first_path: PathBuf,
        /// Its value.
        first: String,
        /// The other file.
        second_path: PathBuf,
        /// Its value.
        second: String,
    },
    /// Two recordings differ in steady velocity for the same command.
    #[error(
        "{} moves at {first:.2} times its command and {} at {second:.2} times: one of them is from \
         before a change of the drive's scale (a known fault doubled the speed); fit each on its own",
        first_path.display(), second_path.display()
    )]
    MixedSpeeds {
        /// One file.
        first_path: PathBuf,
        /// Velocity over command.
        first: f64,
        /// The other file.
        second_path: PathBuf,
        /// Velocity over command.
        second: f64,
    },
    /// The loss of a fit became non-finite.
    #[error(
        "seed {seed}: the loss is not finite after epoch {epoch}; lower --learning-rate (now \
         {learning_rate})"
    )]
    Diverged {
        /// Seed of the fit.
        seed: u64,
        /// Epoch, from 1.
        epoch: usize,
        /// Learning rate.
        learning_rate: f64,
    },
    /// A file of weights or settings is invalid.
    #[error("{}: {reason}", path.display())]
    BadModel {
        /// The file.
        path: PathBuf,
        /// Description of the defect and of the expected content.
        reason: String,
    },
}
