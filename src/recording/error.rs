//! Errors of a recording, each with the file, the location and the remedy.

use super::schema::SchemaDifference;
use std::{io, path::PathBuf};

/// Failure to read, write or decode a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Failure of the operating system.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// Failed action, as a verb: "open", "read", "write".
        action: &'static str,
        /// Error of the system.
        source: io::Error,
    },
    /// Empty file.
    #[error("{}: the file is empty; record or copy it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// File that does not start with the MCAP magic bytes.
    #[error(
        "{}: not an MCAP file (it starts with {begins}); bring ROS 2 bags, npz, CSV and candump \
         logs in with `klasktron import`", path.display()
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// First bytes, in hexadecimal.
        begins: String,
    },
    /// Known topic with a schema that the contract does not allow.
    #[error("{}: topic {topic} has schema '{found}', the contract has '{expected}'", path.display())]
    WrongSchema {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Schema name and encoding in the file.
        found: String,
        /// Schema name in the contract.
        expected: String,
    },
    /// Known topic with a schema of the right name but different fields.
    #[error("{}: topic {topic}, schema {schema}: {difference}", path.display())]
    SchemaDiffers {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Schema name.
        schema: String,
        /// First difference.
        difference: Box<SchemaDifference>,
    },
    /// Message that cannot be decoded with its schema.
    #[error("{}: topic {topic}, message {index}: cannot be decoded as {schema}: {reason}", path.display())]
    BadMessage {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Index among the topic's messages, from 0.
        index: usize,
        /// Schema name.
        schema: String,
        /// Error of the decoder.
        reason: String,
    },
    /// Invalid value in the metadata record `klasktron.recording`.
    #[error("{}: the metadata have {key} = '{value}', which must be {expected}", path.display())]
    BadMetadata {
        /// The file.
        path: PathBuf,
        /// Key of the entry.
        key: String,
        /// Value of the entry.
        value: String,
        /// Allowed values.
        expected: String,
    },
    /// Output that exists already.
    #[error("{}: exists already; give another name or pass --overwrite", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Recording that another session is writing, or that was interrupted.
    #[error(
        "{}: holds a recording that is being written or was cut off; save it with `klasktron recover \
         {} -o OUT`, then remove it, or give another name", partial.display(), partial.display()
    )]
    Unfinished {
        /// The partial file.
        partial: PathBuf,
    },
    /// Missing topic.
    #[error("{}: no topic {topic}; it has {}", path.display(), list(topics))]
    NoSuchTopic {
        /// The file.
        path: PathBuf,
        /// Requested topic.
        topic: String,
        /// Topics of the recording.
        topics: Vec<String>,
    },
    /// Topic without columns for a table.
    #[error(
        "{}: topic {topic} is encoded as '{encoding}' with schema '{schema}', and tables are made \
         of protobuf messages with their descriptor only; bring ROS 2 bags in with `klasktron \
         import` first", path.display()
    )]
    NotTabular {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Encoding of its messages.
        encoding: String,
        /// Full name of the schema.
        schema: String,
    },
    /// Topic with messages of several types, which do not form one table.
    #[error("{}: topic {topic} has several schemas: {}", path.display(), list(schemas))]
    MixedSchemas {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Full names of the schemas.
        schemas: Vec<String>,
    },
    /// Table that could not be written.
    #[error("{}: cannot write the table: {reason}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// Error of the writer.
        reason: String,
    },
    /// Failure of the MCAP writer.
    #[error("{}: cannot write: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the writer.
        source: mcap::McapError,
    },
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

impl RecordingError {
    /// Wrap an I/O error with the file and the verb.
    pub fn io(path: impl Into<PathBuf>, action: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, action, source }
    }
}
