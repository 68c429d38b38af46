//! Errors of a sweep, each with its location and the way out.

use super::Better;
use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure of a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// A fault in the sweep file.
    #[error("{}:{line}: {fault}", path.display())]
    File {
        /// The sweep file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The fault.
        fault: Box<FileFault>,
    },
    /// An input or output error.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Attempted action, as a verb.
        action: &'static str,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// The disk under the results is full.
    #[error(
        "{}: the disk is full; every finished point is kept, so free space and run the same command again",
        path.display()
    )]
    DiskFull {
        /// The folder of results.
        path: PathBuf,
    },
    /// A file of the store could not be written.
    #[error(transparent)]
    Write(#[from] RecordingError),
    /// Another sweep is running in the folder.
    #[error(
        "{}: another sweep is running in this folder: {holder}; wait for it, end it, or choose another --output",
        path.display()
    )]
    Held {
        /// The folder.
        path: PathBuf,
        /// Process that holds the lock.
        holder: String,
    },
    /// Tasks of this sweep are still in the queue of Slurm.
    #[error(
        "{}: {tasks} tasks of this sweep are in Slurm's queue; follow them with --engine slurm, or cancel them first: \
         scancel {jobs}", path.display()
    )]
    InQueue {
        /// The folder.
        path: PathBuf,
        /// Number of tasks.
        tasks: usize,
        /// Job ids with spaces between them.
        jobs: String,
    },
    /// The folder of a point holds other results.
    #[error(
        "{}: holds results of other settings or inputs; choose another --output, or remove it", path.display()
    )]
    OtherPoint {
        /// The folder.
        path: PathBuf,
    },
    /// A Slurm program cannot be started.
    #[error(
        "{program}: cannot be started: {source}; is Slurm installed here? --engine local needs none"
    )]
    NoSlurm {
        /// Name of the program.
        program: &'static str,
        /// Reason of the operating system.
        source: io::Error,
    },
    /// A Slurm program reported an error.
    #[error("{program} failed: {said}")]
    Refused {
        /// Name of the program.
        program: &'static str,
        /// Its message.
        said: String,
    },
    /// Unexpected output of a Slurm program.
    #[error("{program}: printed '{printed}', which is not a {expected}")]
    Unexpected {
        /// Name of the program.
        program: &'static str,
        /// Its output.
        printed: String,
        /// Expected kind of output.
        expected: &'static str,
    },
    /// A path cannot be written into a batch script.
    #[error("{}: a path with a line break cannot be used with Slurm", path.display())]
    PathForScript {
        /// The path.
        path: PathBuf,
    },
    /// A task with an index beyond its list of points.
    #[error("{}: has no line {index}; submit the sweep again", path.display())]
    NoTask {
        /// The list of points.
        path: PathBuf,
        /// The line, from 0.
        index: usize,
    },
}

/// A fault in a sweep file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileFault {
    /// The text is not TOML.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    /// An unknown key.
    #[error("unknown key '{key}' in {place}{}; {place} takes {known}", meant(nearest.as_deref()))]
    UnknownKey {
        /// The key.
        key: String,
        /// Place of the key: the sweep itself, or its table for Slurm.
        place: &'static str,
        /// Nearest known key.
        nearest: Option<String>,
        /// Known keys.
        known: String,
    },
    /// A missing key.
    #[error("'{key}' is missing; {example}")]
    Missing {
        /// The key.
        key: &'static str,
        /// Example of the key.
        example: &'static str,
    },
    /// A value of the wrong kind.
    #[error("'{key}' is {found}; {expected}")]
    WrongKind {
        /// The key.
        key: String,
        /// Value found.
        found: String,
        /// Allowed values.
        expected: String,
    },
    /// A command that cannot be swept.
    #[error("'{name}' cannot be swept{}; the commands are {known}", meant(nearest.as_deref()))]
    UnknownCommand {
        /// Name of the command.
        name: String,
        /// Nearest command.
        nearest: Option<String>,
        /// All commands.
        known: String,
    },
    /// An option that the command does not have.
    #[error("{command} has no option '{option}'{}", meant(nearest.as_deref()))]
    UnknownOption {
        /// The command.
        command: &'static str,
        /// Name of the option.
        option: String,
        /// Nearest option.
        nearest: Option<String>,
    },
    /// An option that belongs to the engine.
    #[error("'{option}' cannot be set in a sweep: {why}")]
    Reserved {
        /// The option.
        option: String,
        /// Reason.
        why: &'static str,
    },
    /// An option given in two places.
    #[error("'{option}' is in {first} and in {second}; leave it in one of them")]
    Twice {
        /// The option.
        option: String,
        /// First place.
        first: &'static str,
        /// Second place.
        second: &'static str,
    },
    /// Seeds for a command without random numbers.
    #[error("{command} draws no random numbers, so it has no seeds; leave 'seeds' out")]
    NoSeeds {
        /// The command.
        command: &'static str,
    },
    /// Too many combinations.
    #[error("{points} points; at most {most} are allowed")]
    TooMany {
        /// Number of points.
        points: u128,
        /// The limit.
        most: usize,
    },
    /// An option value that the command rejects.
    #[error("{command} rejects a point: {said}")]
    RefusedPoint {
        /// The command.
        command: &'static str,
        /// Message of the command line.
        said: String,
    },
    /// An input file cannot be read.
    #[error("{0}")]
    Input(String),
}

/// Linux message of a full disk.
pub(super) const NO_SPACE: &str = "No space left on device";

fn meant(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean '{name}'?"))
}

impl SweepError {
    /// Build an error for `map_err`: `action` on `path`.
    pub(super) fn io(
        path: impl Into<PathBuf>,
        action: &'static str,
    ) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| match source.kind() {
            io::ErrorKind::StorageFull => Self::DiskFull { path },
            _ => Self::Io { path, action, source },
        }
    }

    /// Return whether the disk is full.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        match self {
            Self::DiskFull { .. } => true,
            Self::Write(RecordingError::Io { source, .. }) => {
                source.kind() == io::ErrorKind::StorageFull
            }
            // Other libraries pass the system's message on.
            Self::Write(RecordingError::Table { reason, .. }) => reason.contains(NO_SPACE),
            _ => false,
        }
    }
}

impl std::str::FromStr for Better {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "smaller" => Ok(Self::Smaller),
            "larger" => Ok(Self::Larger),
            _ => Err("must be smaller or larger".to_owned()),
        }
    }
}
