//! What can be wrong with a sweep, each with the place and the way out.

use super::Better;
use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure of a sweep.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    /// Something in the sweep file is not right.
    #[error("{}:{line}: {fault}", path.display())]
    File {
        /// The sweep file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        fault: Box<FileFault>,
    },
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What was tried, as a verb.
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The disk under the results is full.
    #[error(
        "{}: the disk is full; every finished point is kept, so free space and give the same command again",
        path.display()
    )]
    DiskFull {
        /// The folder of results.
        path: PathBuf,
    },
    /// A file of the store could not be written.
    #[error(transparent)]
    Write(#[from] RecordingError),
    /// Another sweep works in the folder.
    #[error(
        "{}: another sweep is at work here: {holder}; wait for it, end it, or choose another --output",
        path.display()
    )]
    Held {
        /// The folder.
        path: PathBuf,
        /// Who.
        holder: String,
    },
    /// Jobs of this sweep are still in the queue of Slurm.
    #[error(
        "{}: {tasks} tasks of this sweep are with Slurm; follow them with --engine slurm, or cancel them first: \
         scancel {jobs}", path.display()
    )]
    InQueue {
        /// The folder.
        path: PathBuf,
        /// How many.
        tasks: usize,
        /// Job ids with spaces between them.
        jobs: String,
    },
    /// A folder with the name of a point holds something else.
    #[error(
        "{}: holds results of other settings or inputs; choose another --output, or remove it", path.display()
    )]
    OtherPoint {
        /// The folder.
        path: PathBuf,
    },
    /// A program of Slurm cannot be started.
    #[error(
        "{program}: cannot be started: {source}; is Slurm installed here? --engine local needs none"
    )]
    NoSlurm {
        /// Its name.
        program: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// A program of Slurm refused.
    #[error("{program} refused: {said}")]
    Refused {
        /// Its name.
        program: &'static str,
        /// What it said.
        said: String,
    },
    /// What a program of Slurm printed was not understood.
    #[error("{program}: printed '{printed}', which is no {expected}")]
    Unexpected {
        /// Its name.
        program: &'static str,
        /// The text.
        printed: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A path cannot be written into a batch script.
    #[error("{}: a path with a line break cannot be used with Slurm", path.display())]
    PathForScript {
        /// The path.
        path: PathBuf,
    },
    /// A task was asked for that no list has.
    #[error("{}: has no line {index}; submit the sweep again", path.display())]
    NoTask {
        /// The list of points.
        path: PathBuf,
        /// The line, from 0.
        index: usize,
    },
}

/// What is wrong in a sweep file.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileFault {
    /// Not TOML.
    #[error("not valid TOML: {0}")]
    Syntax(String),
    /// A key that means nothing here.
    #[error("unknown key '{key}' in {place}{}; {place} takes {known}", meant(nearest.as_deref()))]
    UnknownKey {
        /// The key.
        key: String,
        /// Where: the sweep itself, or its table for Slurm.
        place: &'static str,
        /// What may have been meant.
        nearest: Option<String>,
        /// All of them.
        known: String,
    },
    /// A needed key is missing.
    #[error("'{key}' is missing; {example}")]
    Missing {
        /// The key.
        key: &'static str,
        /// What to write.
        example: &'static str,
    },
    /// A value of the wrong kind.
    #[error("'{key}' is {found}; {expected}")]
    WrongKind {
        /// The key.
        key: String,
        /// What stands there.
        found: String,
        /// What may stand there.
        expected: String,
    },
    /// A command that cannot be swept.
    #[error("'{name}' cannot be swept{}; the commands are {known}", meant(nearest.as_deref()))]
    UnknownCommand {
        /// What was written.
        name: String,
        /// What may have been meant.
        nearest: Option<String>,
        /// All of them.
        known: String,
    },
    /// An option that the command does not have.
    #[error("{command} has no option '{option}'{}", meant(nearest.as_deref()))]
    UnknownOption {
        /// The command.
        command: &'static str,
        /// What was written.
        option: String,
        /// What may have been meant.
        nearest: Option<String>,
    },
    /// An option that belongs to the engine.
    #[error("'{option}' cannot be set in a sweep: {why}")]
    Reserved {
        /// The option.
        option: String,
        /// Why.
        why: &'static str,
    },
    /// An option that is given at two places.
    #[error("'{option}' is in {first} and in {second}; leave it in one of them")]
    Twice {
        /// The option.
        option: String,
        /// The one place.
        first: &'static str,
        /// The other place.
        second: &'static str,
    },
    /// Seeds for a command without any.
    #[error("{command} draws no random numbers, so it has no seeds; leave 'seeds' out")]
    NoSeeds {
        /// The command.
        command: &'static str,
    },
    /// More combinations than can be meant.
    #[error("{points} points; at most {most} are taken")]
    TooMany {
        /// How many.
        points: u128,
        /// The limit.
        most: usize,
    },
    /// An option with a value that the command refuses.
    #[error("{command} refuses a point: {said}")]
    RefusedPoint {
        /// The command.
        command: &'static str,
        /// What the command line said.
        said: String,
    },
    /// An input file that cannot be read.
    #[error("{0}")]
    Input(String),
}

/// What Linux says of a full disk.
pub(super) const NO_SPACE: &str = "No space left on device";

fn meant(nearest: Option<&str>) -> String {
    nearest.map_or_else(String::new, |name| format!("; did you mean '{name}'?"))
}

impl SweepError {
    /// For `map_err`: `action` on `path`.
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

    /// Whether the disk is full.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        match self {
            Self::DiskFull { .. } => true,
            Self::Write(RecordingError::Io { source, .. }) => {
                source.kind() == io::ErrorKind::StorageFull
            }
            // Other libraries pass the system's words on.
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
