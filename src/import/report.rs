//! What an import wrote, left out and could not read.

use std::fmt;

/// How many messages went to one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicCount {
    /// The topic.
    pub topic: String,
    /// Messages written.
    pub messages: usize,
}

/// Result of an import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportReport {
    /// What was written, by topic name.
    pub written: Vec<TopicCount>,
    /// What was left out, lost or assumed, in the order in which it was found.
    pub notices: Vec<Notice>,
}

impl ImportReport {
    /// Whether something that should have been imported was not.
    #[must_use]
    pub fn is_lossy(&self) -> bool {
        self.notices.iter().any(Notice::is_loss)
    }
}

/// Something to know about an import.
#[derive(Debug, Clone, PartialEq)]
pub enum Notice {
    /// A topic that the contract has no place for; on purpose.
    LeftOut {
        /// The topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// Messages not copied.
        messages: u64,
        /// Why.
        why: LeftOutReason,
    },
    /// Messages of a wanted topic that do not decode.
    Undecodable {
        /// The topic.
        topic: String,
        /// How many.
        messages: usize,
        /// Position of the first among the topic's messages, from 0.
        first: usize,
        /// Why the first one does not.
        reason: String,
    },
    /// A wanted topic whose definition cannot be used.
    NoDefinition {
        /// The topic.
        topic: String,
        /// Its type.
        type_name: String,
        /// Messages lost.
        messages: u64,
        /// What is wrong with the definition; empty when there is none.
        reason: String,
    },
    /// The source ends early or is damaged.
    Damaged {
        /// The file.
        file: String,
        /// What is lost.
        what: String,
    },
    /// A part that the bag's metadata lists is not there.
    MissingPart {
        /// The file.
        file: String,
    },
    /// Lines of a log that were skipped.
    SkippedLines {
        /// What they are.
        what: &'static str,
        /// How many.
        lines: usize,
        /// The first, from 1.
        first_line: usize,
        /// Why the first one was skipped.
        reason: String,
    },
    /// Rows of a table without a value in a wanted column.
    EmptyCells {
        /// How many rows.
        rows: usize,
        /// The first row, from 1, the header being row 1.
        first_row: usize,
    },
    /// Frames on the bus from nodes that no motor of the table has.
    ForeignNodes {
        /// How many frames.
        frames: usize,
        /// The first such node.
        node: u8,
    },
    /// Frames that are no messages of the drives' protocol.
    NotOdrive {
        /// How many frames.
        frames: usize,
        /// Why the first one is none.
        reason: String,
    },
    /// Messages of one motor that had no counterpart of the other close enough in time.
    Unpaired {
        /// What could not be computed.
        topic: String,
        /// Messages of both motors that were not used.
        messages: usize,
    },
    /// The carriage's position counts from an unknown point.
    OriginUnknown {
        /// The topic.
        topic: String,
    },
    /// The carriage moves much faster than it was told to.
    DoubledSpeed {
        /// The topic.
        topic: String,
        /// Slope of measured on commanded velocity.
        gain: f64,
    },
    /// Something was taken for granted that the source does not say.
    Assumed {
        /// What.
        what: String,
    },
}

/// Why a topic was left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LeftOutReason {
    /// Nothing in the contract corresponds to it.
    NotInContract,
    /// Another topic carries the same, nearer to the motors.
    Superseded,
    /// What it says is in another topic already.
    Redundant,
    /// It served to place the carriage.
    UsedForOrigin,
}

impl Notice {
    /// Whether it means that something was lost.
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

impl fmt::Display for LeftOutReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotInContract => "the data contract has no topic for it",
            Self::Superseded => "the topic of the checked commands is there as well",
            Self::Redundant => "the velocity commands say the same",
            Self::UsedForOrigin => "used to place the carriage",
        })
    }
}

impl fmt::Display for Notice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::LeftOut { topic, type_name, messages, why } => {
                write!(f, "left out: {topic} ({type_name}), {messages} messages: {why}")
            }
            Self::Undecodable { topic, messages, first, reason } => write!(
                f,
                "lost: {topic}, {messages} messages do not decode, the first is message {first}: {reason}"
            ),
            Self::NoDefinition { topic, type_name, messages, reason } => write!(
                f,
                "lost: {topic} ({type_name}), {messages} messages: the bag carries no usable \
                 definition of the type{}{reason}",
                if reason.is_empty() { "" } else { ": " }
            ),
            Self::Damaged { file, what } => write!(f, "lost: {file}: {what}"),
            Self::MissingPart { file } => {
                write!(f, "lost: {file}: listed in the bag's metadata.yaml, but not there")
            }
            Self::SkippedLines { what, lines, first_line, reason } => {
                write!(f, "lost: {lines} {what}, the first in line {first_line}: {reason}")
            }
            Self::EmptyCells { rows, first_row } => write!(
                f,
                "lost: {rows} rows with an empty cell were skipped, the first is row {first_row}"
            ),
            Self::ForeignNodes { frames, node } => write!(
                f,
                "note: {frames} frames belong to nodes that the table does not have (the first: \
                 node {node}); they are in /can/frames only"
            ),
            Self::NotOdrive { frames, reason } => write!(
                f,
                "note: {frames} frames are no ODrive messages (the first: {reason}); they are in \
                 /can/frames only"
            ),
            Self::Unpaired { topic, messages } => write!(
                f,
                "note: {topic}: {messages} messages of one motor had none of the other within 15 ms"
            ),
            Self::OriginUnknown { topic } => write!(
                f,
                "note: {topic}: positions count from an unknown point, the source does not place \
                 the carriage on the board"
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
