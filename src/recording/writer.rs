//! Writer of recordings: to a temporary name, renamed when complete.

use super::{
    atomic::{ExistingFile, partial_name},
    error::RecordingError,
    schema::{FILE_DESCRIPTOR_SET, PROTOBUF},
};
use crate::units::{NANOS_PER_SECOND, Nanos};
use mcap::{
    Attachment, Compression, WriteOptions,
    records::{MessageHeader, Metadata},
};
use prost::{Message, Name};
use std::{
    borrow::Cow,
    collections::BTreeMap,
    fs::{self, File},
    io::{BufWriter, ErrorKind},
    path::{Path, PathBuf},
};

/// Profile of every file that klasktron writes.
pub const PROFILE: &str = "klasktron";
/// Name of the metadata record of every recording.
pub const RECORDING_METADATA: &str = "klasktron.recording";

/// Name of the metadata record with the outcome of a collection session: `stop`, `stop_text`,
/// `report_json`.
pub const SESSION_METADATA: &str = "klasktron.collect";
/// Value of `stop` for a complete session.
pub const SESSION_COMPLETED: &str = "completed";

const CHUNK_BYTES: u64 = 1 << 20;

/// Policy for flushing messages to the disk.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlushPolicy {
    /// Flush whenever the recorded time has advanced by a second: for live recording, where a crash
    /// loses at most that much.
    EverySecond,
    /// Flush whenever a chunk of 1 MiB is full: for files made from data on disk.
    WhenFull,
}

/// Writer of one MCAP file. Everything goes to `.NAME.partial` in the same folder until
/// [`finish`](Self::finish) renames it. `klasktron recover` reads a partial file.
pub struct RecordingWriter {
    writer: mcap::Writer<BufWriter<File>>,
    path: PathBuf,
    partial: PathBuf,
    existing: ExistingFile,
    flush: FlushPolicy,
    flushed_at: Option<Nanos>,
    /// Channel id and next sequence number by topic and schema.
    channels: BTreeMap<(String, String), (u16, u32)>,
    buffer: Vec<u8>,
    observer: Option<Observer>,
}

/// Function that gets every message of a file: topic, schema, log time and content.
pub type Observer = Box<dyn FnMut(&str, &RawSchema<'_>, Nanos, &[u8]) + Send>;

impl RecordingWriter {
    /// Start a file with the final name `path`.
    ///
    /// # Errors
    /// When the file exists and `existing` refuses, the folder is not writable, or, for a live
    /// recording, an unfinished file exists.
    pub fn create(
        path: &Path,
        existing: ExistingFile,
        flush: FlushPolicy,
    ) -> Result<Self, RecordingError> {
        Self::with_profile(path, PROFILE, existing, flush)
    }

    /// Start a copy of a file with another profile, as [`create`](Self::create) does.
    ///
    /// # Errors
    /// As [`create`](Self::create).
    pub fn with_profile(
        path: &Path,
        profile: &str,
        existing: ExistingFile,
        flush: FlushPolicy,
    ) -> Result<Self, RecordingError> {
        if existing == ExistingFile::Refuse && path.exists() {
            return Err(RecordingError::Exists { path: path.to_owned() });
        }
        let partial = partial_name(path);
        let file = match flush {
            // Data of a live session cannot be recorded again.
            FlushPolicy::EverySecond => File::create_new(&partial),
            FlushPolicy::WhenFull => File::create(&partial),
        };
        let file = file.map_err(|error| match error.kind() {
            ErrorKind::AlreadyExists => RecordingError::Unfinished { partial: partial.clone() },
            _ => RecordingError::io(path, "create")(error),
        })?;
        let writer = WriteOptions::new()
            .profile(profile)
            .library(concat!("klasktron ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            .create(BufWriter::new(file))
            .map_err(|source| RecordingError::Write { path: path.to_owned(), source })?;
        Ok(Self {
            writer,
            path: path.to_owned(),
            partial,
            existing,
            flush,
            flushed_at: None,
            channels: BTreeMap::new(),
            buffer: Vec::new(),
            observer: None,
        })
    }

    /// Pass every message from now on to `observer` as well.
    pub fn observe(&mut self, observer: Observer) {
        self.observer = Some(observer);
    }

    fn write_error(&self) -> impl FnOnce(mcap::McapError) -> RecordingError + use<> {
        let path = self.path.clone();
        move |source| RecordingError::Write { path, source }
    }

    /// Write one message of the contract whose source has no clock.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn write<M: Message + Name>(
        &mut self,
        topic: &str,
        log_time: Nanos,
        message: &M,
    ) -> Result<(), RecordingError> {
        self.write_published(topic, log_time, log_time, message)
    }

    /// Write one message of the contract, with the source's own time as `publish_time`.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn write_published<M: Message + Name>(
        &mut self,
        topic: &str,
        log_time: Nanos,
        publish_time: Nanos,
        message: &M,
    ) -> Result<(), RecordingError> {
        let mut buffer = std::mem::take(&mut self.buffer);
        buffer.clear();
        message.encode(&mut buffer).unwrap_or_else(|_grows| unreachable!("a Vec grows"));
        let name = M::full_name();
        let schema = RawSchema::protobuf(&name, FILE_DESCRIPTOR_SET);
        let result = self.write_raw(topic, &schema, [log_time, publish_time], &buffer);
        self.buffer = buffer;
        result
    }

    /// Write one message as bytes, with any schema. `times` are log and publish time.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn write_raw(
        &mut self,
        topic: &str,
        schema: &RawSchema<'_>,
        times: [Nanos; 2],
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let key = (topic.to_owned(), schema.name.to_owned());
        let (channel_id, sequence) = match self.channels.get(&key) {
            Some(known) => *known,
            None => (self.add_channel(topic, schema)?, 0),
        };
        self.channels.insert(key, (channel_id, sequence.wrapping_add(1)));
        let header =
            MessageHeader { channel_id, sequence, log_time: times[0].0, publish_time: times[1].0 };
        self.writer.write_to_known_channel(&header, data).map_err(self.write_error())?;
        if let Some(observe) = &mut self.observer {
            observe(topic, schema, times[0], data);
        }
        self.flush_if_due(times[0])
    }

    fn add_channel(&mut self, topic: &str, schema: &RawSchema<'_>) -> Result<u16, RecordingError> {
        let schema_id = if schema.name.is_empty() {
            0 // MCAP's mark for a channel without schema
        } else {
            self.writer
                .add_schema(schema.name, schema.encoding, schema.data)
                .map_err(self.write_error())?
        };
        self.writer
            .add_channel(schema_id, topic, schema.message_encoding, schema.channel_metadata)
            .map_err(self.write_error())
    }

    fn flush_if_due(&mut self, now: Nanos) -> Result<(), RecordingError> {
        let since = *self.flushed_at.get_or_insert(now);
        if self.flush == FlushPolicy::EverySecond
            && since.0.saturating_add(NANOS_PER_SECOND) <= now.0
        {
            self.writer.flush().map_err(self.write_error())?;
            self.flushed_at = Some(now);
        }
        Ok(())
    }

    /// Add a metadata record.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn metadata(
        &mut self,
        name: &str,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        let record = Metadata { name: name.to_owned(), metadata };
        self.writer.write_metadata(&record).map_err(self.write_error())
    }

    /// Add an attachment.
    ///
    /// # Errors
    /// When writing to disk fails.
    pub fn attach(
        &mut self,
        name: &str,
        media_type: &str,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let attachment = Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(data),
        };
        self.writer.attach(&attachment).map_err(self.write_error())
    }

    /// Write summary and indexes, sync the bytes to disk, and rename the file to its final name.
    ///
    /// # Errors
    /// When writing to disk fails; the partial file remains.
    pub fn finish(mut self) -> Result<(), RecordingError> {
        self.writer.finish().map_err(self.write_error())?;
        let file = self.writer.into_inner();
        let file = file
            .into_inner()
            .map_err(|error| RecordingError::io(&self.path, "write")(error.into_error()))?;
        file.sync_all().map_err(RecordingError::io(&self.path, "write"))?;
        if self.existing == ExistingFile::Refuse && self.path.exists() {
            return Err(RecordingError::Exists { path: self.path });
        }
        fs::rename(&self.partial, &self.path).map_err(RecordingError::io(&self.path, "rename"))?;
        let bytes = file.metadata().map_or(0, |metadata| metadata.len());
        log::info!("wrote {}: {bytes} bytes", self.path.display());
        Ok(())
    }

    /// Remove the partial file. For conversions, whose source still exists.
    pub fn discard(self) {
        let partial = self.partial.clone();
        drop(self);
        // A failure loses nothing: the file is a copy, and its name marks it as partial.
        fs::remove_file(partial).ok();
    }
}

/// Schema and message encoding of a channel, as bytes.
#[derive(Debug, Clone, Copy)]
pub struct RawSchema<'a> {
    /// Full name; empty when the channel has no schema.
    pub name: &'a str,
    /// Schema encoding, such as `protobuf` or `ros2msg`.
    pub encoding: &'a str,
    /// Definition of the schema.
    pub data: &'a [u8],
    /// Message encoding, such as `protobuf` or `cdr`.
    pub message_encoding: &'a str,
    /// Key and value pairs of the channel record.
    pub channel_metadata: &'a BTreeMap<String, String>,
}

impl<'a> RawSchema<'a> {
    /// Schema of the Protocol Buffers message called `name`, whose serialised `FileDescriptorSet` is
    /// `data`.
    #[must_use]
    pub fn protobuf(name: &'a str, data: &'a [u8]) -> Self {
        const NONE: &BTreeMap<String, String> = &BTreeMap::new();
        Self { name, encoding: PROTOBUF, data, message_encoding: PROTOBUF, channel_metadata: NONE }
    }
}
