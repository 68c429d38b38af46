//! Errors that stop an import, each with the location and the remedy.

use super::csv::ColumnError;
use crate::recording::RecordingError;
use std::{io, path::PathBuf};

/// Failure of an import; nothing is written.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// Recording that could not be read or written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// Invalid column assignment.
    #[error(transparent)]
    Columns(#[from] ColumnError),
    /// Not a raw log of a servo test bench.
    #[error("{}: not a usable log of BAM's test bench: {reason}", path.display())]
    Bam {
        /// The file.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
    /// Dates or times of day in a time column with a unit.
    #[error(
        "{}: column '{column}' holds dates or times of day, which have no unit; write --time '{column}' instead of \
         '{column}:{unit}'", path.display()
    )]
    ClockWithUnit {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Unit that was given.
        unit: &'static str,
    },
    /// Failure of the operating system.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Failed action, as a verb.
        action: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// File name that does not determine the kind of source.
    #[error(
        "{}: its kind is not clear from the name; use `klasktron import bag`, `npz`, `csv`, \
         `candump` or `bam`", path.display()
    )]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// CSV file without a column assignment.
    #[error(
        "{}: a CSV file needs its columns named: `klasktron import csv FILE --time COLUMN --input \
         COLUMN:UNIT --position COLUMN -o OUT.mcap`", path.display()
    )]
    CsvNeedsColumns {
        /// The file.
        path: PathBuf,
    },
    /// Source without data that the contract has a topic for.
    #[error("{}: nothing in it can be imported; {found}", path.display())]
    NothingToImport {
        /// The source.
        path: PathBuf,
        /// Content of the source.
        found: String,
    },
    /// Folder without a bag.
    #[error(
        "{}: no .db3 or .mcap file in this folder; give the folder that `ros2 bag record` made, or \
         the file itself", path.display()
    )]
    NoBag {
        /// The folder.
        path: PathBuf,
    },
    /// SQLite error.
    #[error("{}: not a readable ROS 2 bag: {reason}", path.display())]
    Sqlite {
        /// The file.
        path: PathBuf,
        /// Reason of SQLite.
        reason: String,
    },
    /// Unsupported compression.
    #[error("{}: compression '{format}' is not supported; ROS 2 bags use zstd", path.display())]
    Compression {
        /// The bag.
        path: PathBuf,
        /// Name of the compression in metadata.yaml.
        format: String,
    },
    /// Two bags that overlap in time.
    #[error(
        "{} and {} overlap in time; import them into two recordings", first.display(),
        second.display()
    )]
    Overlap {
        /// Earlier argument.
        first: PathBuf,
        /// Later argument.
        second: PathBuf,
    },
    /// Negative time stamp.
    #[error("{}: topic {topic} has the time stamp {nanos} ns, before 1970", path.display())]
    NegativeTime {
        /// The bag.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Time stamp.
        nanos: i64,
    },
    /// Archive that cannot be read.
    #[error("{}: not a readable npz file: {reason}", path.display())]
    Npz {
        /// The file.
        path: PathBuf,
        /// Reason.
        reason: String,
    },
    /// Arrays of an unsupported layout.
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
        /// Remedy for a known older layout; empty otherwise.
        hint: &'static str,
    },
    /// Array of the wrong shape.
    #[error("{}: array {name} has shape {found:?}; expected {expected}", path.display())]
    NpzShape {
        /// The file.
        path: PathBuf,
        /// The array.
        name: &'static str,
        /// Shape found.
        found: Vec<usize>,
        /// Expected shape.
        expected: String,
    },
    /// Non-finite numbers.
    #[error(
        "{}: {place} holds {count} values that are not finite, the first in row {row}; repair or \
         remove those rows first", path.display()
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Array or column.
        place: String,
        /// Number of non-finite values.
        count: usize,
        /// First row: the line of the file from 1 for tables, the index from 0 for arrays.
        row: usize,
    },
    /// Table without rows.
    #[error("{}: no rows below the header", path.display())]
    NoRows {
        /// The file.
        path: PathBuf,
    },
    /// Missing column.
    #[error("{}: no column '{column}'; the columns are {}{hint}", path.display(), list(found))]
    NoColumn {
        /// The file.
        path: PathBuf,
        /// Requested column.
        column: String,
        /// Columns of the table.
        found: Vec<String>,
        /// Remedy for a header in a comment or a wrong unit; empty otherwise.
        hint: String,
    },
    /// Duplicate column name.
    #[error("{}: column '{column}' occurs {count} times in the header; rename all but one", path.display())]
    ColumnTwice {
        /// The file.
        path: PathBuf,
        /// The column.
        column: String,
        /// Number of occurrences.
        count: usize,
    },
    /// Rows without a value, where every row is needed.
    #[error("{}: {count} rows without a value (an empty cell or nan), the first is row {row}; fill or remove them", path.display())]
    EmptyCells {
        /// The file.
        path: PathBuf,
        /// Number of such rows.
        count: usize,
        /// The first one, as a line of the file, from 1.
        row: usize,
    },
    /// Cell that is not a number.
    #[error("{}: row {row}, column '{column}': '{found}' is not a number", path.display())]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        row: usize,
        /// The column.
        column: String,
        /// Text found.
        found: String,
    },
    /// Time that does not increase.
    #[error(
        "{}: row {row}, column '{column}': time {found} {unit} does not come after {previous} \
         {unit}; sort the rows and remove duplicates{hint}", path.display()
    )]
    TimeNotAdvancing {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        row: usize,
        /// The column.
        column: String,
        /// Time, in the unit of the source.
        found: f64,
        /// Time of the previous row, in the unit of the source.
        previous: f64,
        /// Unit of the source.
        unit: &'static str,
        /// Remedy for a table of several runs; empty otherwise.
        hint: &'static str,
    },
    /// Duty outside of its range.
    #[error(
        "{}: row {row}, column '{column}': duty {found} is outside of -1 to 1; scale the column \
         with --input-scale, such as 0.01 for percent", path.display()
    )]
    Duty {
        /// The file.
        path: PathBuf,
        /// Line of the file, from 1.
        row: usize,
        /// The column.
        column: String,
        /// Duty after the scale.
        found: f64,
    },
    /// Log with several interfaces, or without the requested one.
    #[error("{}: the log holds the interfaces {}; choose one with --interface", path.display(), list(found))]
    Interfaces {
        /// The file.
        path: PathBuf,
        /// Interfaces of the log.
        found: Vec<String>,
    },
    /// Log without a frame.
    #[error(
        "{}: none of its {lines} lines is a frame of `candump -L`; the first is wrong because {reason}",
        path.display()
    )]
    NoFrames {
        /// The file.
        path: PathBuf,
        /// Number of lines.
        lines: usize,
        /// Error of the first line.
        reason: String,
    },
}

impl ImportError {
    /// Wrap an I/O error with the file and the verb.
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
