//! What can stop an import, each with the place and the way out.

use super::csv::ColumnError;
use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure of an import; nothing was written then.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// A recording could not be read or written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A column map that cannot be.
    #[error(transparent)]
    Columns(#[from] ColumnError),
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried, as a verb.
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The kind of a source is not clear from its name.
    #[error(
        "{}: its kind is not clear from the name; use `klasktron import bag`, `npz`, `csv` or \
         `candump`", path.display()
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// A CSV file needs a column map.
    #[error(
        "{}: a CSV file needs its columns named: `klasktron import csv FILE --time COLUMN --input \
         COLUMN:UNIT --position COLUMN -o OUT.mcap`", path.display()
    )]
    CsvNeedsColumns {
        /// The file.
        path: PathBuf,
    },
    /// The source has nothing that the contract has a place for.
    #[error("{}: nothing in it can be imported; {found}", path.display())]
    NothingToImport {
        /// The source.
        path: PathBuf,
        /// What it holds instead.
        found: String,
    },
    /// A folder without a bag in it.
    #[error(
        "{}: no .db3 or .mcap file in this folder; give the folder that `ros2 bag record` made, or \
         the file itself", path.display()
    )]
    NoBag {
        /// The folder.
        path: PathBuf,
    },
    /// SQLite refused.
    #[error("{}: not a readable ROS 2 bag: {reason}", path.display())]
    Sqlite {
        /// The file.
        path: PathBuf,
        /// SQLite's reason.
        reason: String,
    },
    /// A compression that is not read.
    #[error("{}: compression '{format}' is not understood; ROS 2 bags use zstd", path.display())]
    Compression {
        /// The bag.
        path: PathBuf,
        /// Its name in metadata.yaml.
        format: String,
    },
    /// Two bags that claim the same stretch of time.
    #[error(
        "{} and {} overlap in time; import them into two recordings", first.display(),
        second.display()
    )]
    Overlap {
        /// The earlier argument.
        first: PathBuf,
        /// The later argument.
        second: PathBuf,
    },
    /// A negative time stamp.
    #[error("{}: topic {topic} has the time stamp {nanos} ns, before 1970", path.display())]
    NegativeTime {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// The stamp.
        nanos: i64,
    },
    /// An archive that cannot be read.
    #[error("{}: not a readable npz file: {reason}", path.display())]
    Npz {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: String,
    },
    /// Arrays of a layout that is not imported.
    #[error(
        "{}: holds the arrays {}; expected player_pos, player_vel, opponent_pos, opponent_vel, \
         ball_pos, ball_vel and player_actions (one run), or X_commands, X_states and Y \
         (windows){hint}", path.display(), list(found)
    )]
    NpzLayout {
        /// The file.
        path: PathBuf,
        /// Names found.
        found: Vec<String>,
        /// What to do about a known older layout; empty otherwise.
        hint: &'static str,
    },
    /// An array of another shape.
    #[error("{}: array {name} has shape {found:?}; expected {expected}", path.display())]
    NpzShape {
        /// The file.
        path: PathBuf,
        /// The array.
        name: &'static str,
        /// Its shape.
        found: Vec<usize>,
        /// The shape expected.
        expected: String,
    },
    /// Numbers that are not finite.
    #[error(
        "{}: {place} holds {count} values that are not finite, the first in row {row}; repair or \
         remove those rows first", path.display()
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Array or column.
        place: String,
        /// How many.
        count: usize,
        /// The first row: from 1 with the header for tables, from 0 for arrays.
        row: usize,
    },
    /// A table without rows.
    #[error("{}: no rows below the header", path.display())]
    NoRows {
        /// The file.
        path: PathBuf,
    },
    /// A column that is not there.
    #[error("{}: no column '{column}'; the columns are {}", path.display(), list(found))]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// The column asked for.
        column: String,
        /// Columns there are.
        found: Vec<String>,
    },
    /// A column name that stands twice.
    #[error("{}: column '{column}' stands {count} times in the header; rename all but one", path.display())]
    ColumnTwice {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// How often.
        count: usize,
    },
    /// A cell that is no number.
    #[error("{}: row {row}, column '{column}': '{found}' is no number", path.display())]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// From 1, the header being row 1.
        row: usize,
        /// The column.
        column: String,
        /// What stands there.
        found: String,
    },
    /// A time that does not advance.
    #[error(
        "{}: row {row}, column '{column}': time {found} s does not come after {previous} s; sort \
         the rows and remove duplicates", path.display()
    )]
    TimeNotAdvancing {
        /// The file.
        path: PathBuf,
        /// From 1, the header being row 1.
        row: usize,
        /// The column.
        column: String,
        /// The time (s).
        found: f64,
        /// The one before (s).
        previous: f64,
    },
    /// A log of several interfaces, or not of the one asked for.
    #[error("{}: the log holds the interfaces {}; choose one with --interface", path.display(), list(found))]
    Interfaces {
        /// The file.
        path: PathBuf,
        /// Interfaces there are.
        found: Vec<String>,
    },
    /// A log without a single frame.
    #[error(
        "{}: none of its {lines} lines is a frame of `candump -L`; the first is wrong because {reason}",
        path.display()
    )]
    NoFrames {
        /// The file.
        path: PathBuf,
        /// Lines there are.
        lines: usize,
        /// What is wrong with the first.
        reason: String,
    },
}

impl ImportError {
    /// Wraps an I/O error with the file and the verb.
    pub(super) fn io(
        path: impl Into<PathBuf>,
        action: &'static str,
    ) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, action, source }
    }
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "(none)".to_owned() } else { names.join(", ") }
}
