//! What can be wrong with a recording, each with the file, the place and the way out.

use super::schema::SchemaDifference;
use std::{io, path::PathBuf};

/// Failure to read, write or understand a recording.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The operating system refused.
    #[error("{}: cannot {action}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What was tried, as a verb: "open", "read", "write".
        action: &'static str,
        /// The system's reason.
        source: io::Error,
    },
    /// The file has no bytes.
    #[error("{}: the file is empty; record or copy it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin with the MCAP magic bytes.
    #[error(
        "{}: not an MCAP file (it begins with {begins}); bring ROS 2 bags, npz, CSV and candump \
         logs in with `klasktron import`", path.display()
    )]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// Its first bytes, in hexadecimal.
        begins: String,
    },
    /// A known topic carries a schema that the contract does not allow.
    #[error("{}: topic {topic} carries schema '{found}', the contract has '{expected}'", path.display())]
    WrongSchema {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Schema name and encoding in the file.
        found: String,
        /// Schema name that the contract demands.
        expected: String,
    },
    /// A known topic carries a schema of the right name whose fields differ.
    #[error("{}: topic {topic}, schema {schema}: {difference}", path.display())]
    SchemaDiffers {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Schema name.
        schema: String,
        /// The first difference.
        difference: Box<SchemaDifference>,
    },
    /// A message does not decode as its schema says.
    #[error("{}: topic {topic}, message {index}: does not decode as {schema}: {reason}", path.display())]
    BadMessage {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Position among the topic's messages, from 0.
        index: usize,
        /// Schema name.
        schema: String,
        /// The decoder's reason.
        reason: String,
    },
    /// A value of the metadata record `klasktron.recording` is not what its key stands for.
    #[error("{}: the metadata say {key} = '{value}', which must be {expected}", path.display())]
    BadMetadata {
        /// The file.
        path: PathBuf,
        /// Its key.
        key: String,
        /// The value.
        value: String,
        /// What it may be.
        expected: String,
    },
    /// The output exists already.
    #[error("{}: exists already; give another name or pass --overwrite", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another session is writing this recording, or one was cut off while it did.
    #[error(
        "{}: holds a recording that is being written or was cut off; save it with `klasktron recover \
         {} -o OUT`, then remove it, or give another name", partial.display(), partial.display()
    )]
    Unfinished {
        /// The partial file.
        partial: PathBuf,
    },
    /// A topic was asked for that the recording does not have.
    #[error("{}: no topic {topic}; it has {}", path.display(), list(topics))]
    NoSuchTopic {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// What there is.
        topics: Vec<String>,
    },
    /// A topic whose messages have no columns that this crate can find.
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
    /// A topic carries messages of several types, which make no single table.
    #[error("{}: topic {topic} carries several schemas: {}", path.display(), list(schemas))]
    MixedSchemas {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Full names.
        schemas: Vec<String>,
    },
    /// A table could not be written.
    #[error("{}: cannot write the table: {reason}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// The writer's reason.
        reason: String,
    },
    /// The MCAP writer refused.
    #[error("{}: cannot write: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The writer's reason.
        source: mcap::McapError,
    },
}

fn list(names: &[String]) -> String {
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

impl RecordingError {
    /// Wraps an I/O error with the file and the verb.
    pub fn io(path: impl Into<PathBuf>, action: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, action, source }
    }
}
