//! Report of an import: written topics, skipped data and losses.

use std::fmt;

/// Number of messages of one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicCount {
    /// The topic.
    pub topic: String,
    /// Number of messages written.
    pub messages: usize,
}

/// Result of an import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportReport {
    /// Written topics by name.
    pub written: Vec<TopicCount>,
    /// Skipped, lost or assumed data, in the order of discovery.
    pub notices: Vec<Notice>,
}

impl ImportReport {
    /// Return whether data was lost that should have been imported.
    #[must_use]
    pub fn is_lossy(&self) -> bool {
        self.notices.iter().any(Notice::is_loss)
    }
}

/// Notice about an import.
#[derive(Debug, Clone, PartialEq)]
pub enum Notice {
    /// Topic without a counterpart in the contract, skipped on purpose.
    Skipped {
        /// The topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// Number of messages not copied.
        messages: u64,
        /// Reason.
        why: SkipReason,
    },
    /// Messages of a wanted topic that cannot be decoded.
    Undecodable {
        /// The topic.
        topic: String,
        /// Number of messages.
        messages: usize,
        /// Index of the first among the topic's messages, from 0.
        first: usize,
        /// Error of the first one.
        reason: String,
    },
    /// Wanted topic without a usable definition.
    NoDefinition {
        /// The topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// Number of messages lost.
        messages: u64,
        /// Defect of the definition; empty for a missing one.
        reason: String,
    },
    /// Damaged or truncated source.
    Damaged {
        /// The file.
        file: String,
        /// Description of the loss.
        what: String,
    },
    /// Missing part that the bag's metadata lists.
    MissingPart {
        /// The file.
        file: String,
    },
    /// Skipped lines of a log.
    SkippedLines {
        /// Kind of lines.
        what: &'static str,
        /// Number of lines.
        lines: usize,
        /// First line, from 1.
        first_line: usize,
        /// Reason of the first one.
        reason: String,
    },
    /// Row of text below the header of a table, such as units.
    TextRow {
        /// The file.
        file: String,
        /// Line of the file, from 1.
        row: usize,
        /// Its cells.
        cells: String,
    },
    /// Rows of a table without a value in a wanted column.
    EmptyCells {
        /// The file.
        file: String,
        /// Number of rows.
        rows: usize,
        /// First row, as a line of the file, from 1.
        first_row: usize,
    },
    /// Time column without a unit whose median step is implausible for seconds.
    LongStep {
        /// The column.
        column: String,
        /// Median step, if the column is in seconds.
        step_s: f64,
    },
    /// Entries of a servo's log with the motor off.
    MotorOff {
        /// Number of entries.
        entries: usize,
    },
    /// Frames of nodes that are not in the table.
    ForeignNodes {
        /// Number of frames.
        frames: usize,
        /// First such node.
        node: u8,
    },
    /// Frames outside the drives' protocol.
    NotOdrive {
        /// Number of frames.
        frames: usize,
        /// Reason of the first one.
        reason: String,
    },
    /// Messages of one motor without a counterpart of the other close in time.
    Unpaired {
        /// Topic of the derived quantity.
        topic: String,
        /// Number of unused messages of both motors.
        messages: usize,
    },
    /// Carriage position with an unknown origin.
    OriginUnknown {
        /// The topic.
        topic: String,
    },
    /// Carriage that moves much faster than its command.
    DoubledSpeed {
        /// The topic.
        topic: String,
        /// Slope of measured velocity on commanded velocity.
        gain: f64,
    },
    /// Assumption about missing information in the source.
    Assumed {
        /// Description of the assumption.
        what: String,
    },
}

/// Reason for skipping a topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SkipReason {
    /// The contract has no counterpart.
    NotInContract,
    /// Another topic has the same content, closer to the motors.
    Superseded,
    /// Another topic already has the content.
    Redundant,
    /// The topic was used to reference the carriage.
    UsedForOrigin,
}

impl Notice {
    /// Return whether data was lost.
    #[must_use]
    pub fn is_loss(&self) -> bool {
        matches!(
            self,
            Self::Undecodable { .. }
                | Self::NoDefinition { .. }
                | Self::Damaged { .. }
                | Self::MissingPart { .. }
                | Self::SkippedLines { .. }
                | Self::EmptyCells { .. }
        )
    }
}

impl fmt::Display for SkipReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotInContract => "the data contract has no topic for it",
            Self::Superseded => "the topic of the checked commands is available",
            Self::Redundant => "the velocity commands have the same content",
            Self::UsedForOrigin => "used to reference the carriage",
        })
    }
}

fn write_text_row(f: &mut fmt::Formatter<'_>, file: &str, row: usize, cells: &str) -> fmt::Result {
    write!(
        f,
        "note: {file}: row {row} holds text below the column names ({cells}); it was left out"
    )
}

fn write_empty_cells(
    f: &mut fmt::Formatter<'_>,
    file: &str,
    rows: usize,
    first_row: usize,
) -> fmt::Result {
    write!(
        f,
        "lost: {file}: {rows} rows without a value (an empty cell or nan) were skipped, the first is row {first_row}"
    )
}

fn write_long_step(f: &mut fmt::Formatter<'_>, column: &str, step_s: f64) -> fmt::Result {
    let step_s = (step_s * 1e6).round() / 1e6;
    write!(
        f,
        "note: the median time step of column '{column}' is {step_s} s; if the column is in ms, add \
         ':ms' to --time"
    )
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Skipped { topic, type_name, messages, why } => {
                write!(f, "skipped: {topic} ({type_name}), {messages} messages: {why}")
            }
            Self::Undecodable { topic, messages, first, reason } => write!(
                f,
                "lost: {topic}, {messages} messages cannot be decoded, the first is message {first}: \
                 {reason}"
            ),
            Self::NoDefinition { topic, type_name, messages, reason } => write!(
                f,
                "lost: {topic} ({type_name}), {messages} messages: the bag has no usable \
                 definition of the type{}{reason}",
                if reason.is_empty() { "" } else { ": " }
            ),
            Self::Damaged { file, what } => write!(f, "lost: {file}: {what}"),
            Self::MissingPart { file } => {
                write!(f, "lost: {file}: listed in the bag's metadata.yaml, but missing")
            }
            Self::SkippedLines { what, lines, first_line, reason } => {
                write!(f, "lost: {lines} {what}, the first in line {first_line}: {reason}")
            }
            Self::TextRow { file, row, cells } => write_text_row(f, file, *row, cells),
            Self::EmptyCells { file, rows, first_row } => {
                write_empty_cells(f, file, *rows, *first_row)
            }
            Self::LongStep { column, step_s } => write_long_step(f, column, *step_s),
            Self::MotorOff { entries } => write!(
                f,
                "skipped: {entries} entries with the motor off, whose input is no voltage"
            ),
            Self::ForeignNodes { frames, node } => write!(
                f,
                "note: {frames} frames belong to nodes that are not in the table (the first: \
                 node {node}); they are in /can/frames only"
            ),
            Self::NotOdrive { frames, reason } => write!(
                f,
                "note: {frames} frames are not ODrive messages (the first: {reason}); they are in \
                 /can/frames only"
            ),
            Self::Unpaired { topic, messages } => write!(
                f,
                "note: {topic}: {messages} messages of one motor have no counterpart of the other within 15 ms"
            ),
            Self::OriginUnknown { topic } => write!(
                f,
                "note: {topic}: the origin of the positions is unknown, because the source has no reference \
                 on the board"
            ),
            Self::DoubledSpeed { topic, gain } => write!(
                f,
                "note: {topic} moves {gain:.2} times as fast as commanded, as before upstream's fix \
                 of a factor 2; do not mix it with later recordings in one fit"
            ),
            Self::Assumed { what } => write!(f, "assumed: {what}"),
        }
    }
}
