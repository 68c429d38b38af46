//! Recording in memory: every message as bytes by topic, decoded on demand.

use super::{
    error::RecordingError,
    scan::{self, Loss, MAGIC, ScanError},
    schema::{self, PROTOBUF, message::RunMarker},
    topic,
    writer::{RECORDING_METADATA, RawSchema},
};
use crate::units::Nanos;
use mcap::records::{self, Record};
use prost::{Message, Name};
use sha2::{Digest, Sha256};
use std::{
    collections::{BTreeMap, HashMap},
    fs::File,
    io::{self, BufReader, Read},
    ops::Range,
    path::{Path, PathBuf},
};

/// Time stamps and location of one message among its channel's bytes.
#[derive(Debug, Clone)]
pub struct MessageIndex {
    /// Time of reception on the host's clock, or of sending for a command.
    pub log_time: Nanos,
    /// Time of the source's clock; equals `log_time` without such a clock.
    pub publish_time: Nanos,
    range: Range<usize>,
}

/// Messages of one topic with one schema, in file order.
#[derive(Debug, Clone, Default)]
pub struct Channel {
    /// Topic name.
    pub topic: String,
    /// Full name of the schema; empty without a schema.
    pub schema: String,
    /// Encoding of the schema record, such as `protobuf` or `ros2msg`.
    pub schema_encoding: String,
    /// Content of the schema record.
    pub schema_data: Vec<u8>,
    /// Encoding of the messages, such as `protobuf` or `cdr`.
    pub encoding: String,
    /// Key and value pairs of the channel record.
    pub metadata: BTreeMap<String, String>,
    /// Location of each message.
    pub messages: Vec<MessageIndex>,
    bytes: Vec<u8>,
}

impl Channel {
    /// Return the bytes of each message with its time stamps, in file order.
    pub fn raw(&self) -> impl Iterator<Item = (&MessageIndex, &[u8])> {
        self.messages.iter().map(|message| (message, &self.bytes[message.range.clone()]))
    }

    /// Return the schema, for [`RecordingWriter::write_raw`](super::RecordingWriter::write_raw).
    #[must_use]
    pub fn raw_schema(&self) -> RawSchema<'_> {
        RawSchema {
            name: &self.schema,
            encoding: &self.schema_encoding,
            data: &self.schema_data,
            message_encoding: &self.encoding,
            channel_metadata: &self.metadata,
        }
    }

    fn push(&mut self, header: &records::MessageHeader, data: &[u8]) {
        let start = self.bytes.len();
        self.bytes.extend_from_slice(data);
        self.messages.push(MessageIndex {
            log_time: Nanos(header.log_time),
            publish_time: Nanos(header.publish_time),
            range: start..self.bytes.len(),
        });
    }
}

/// Attachment of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Attachment {
    /// Name, such as `weights/seed_0.safetensors`.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Content.
    pub data: Vec<u8>,
}

/// Decoded messages of one topic in order of their log time.
#[derive(Debug, Clone, Default)]
pub struct Series<M> {
    /// Time of reception, or of sending for a command; never decreasing.
    pub times: Vec<Nanos>,
    /// Messages.
    pub values: Vec<M>,
}

impl<M> Series<M> {
    /// Return time and message of each, in order.
    pub fn iter(&self) -> impl Iterator<Item = (Nanos, &M)> {
        self.times.iter().copied().zip(&self.values)
    }
}

/// Content of one MCAP file, of the contract or any other.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Path of the file.
    pub path: PathBuf,
    /// Size of the file (bytes).
    pub bytes: u64,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
    /// Profile of the header: `klasktron` for the contract, `ros2` for bags.
    pub profile: String,
    /// Software that wrote the file.
    pub library: String,
    /// Metadata records by name; of two with one name the later counts.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Channels in the order in which they were declared.
    pub channels: Vec<Channel>,
    /// Attachments in file order.
    pub attachments: Vec<Attachment>,
    /// Losses of a damaged file.
    pub loss: Loss,
    /// True when the file ends with the magic bytes; otherwise its summary is missing.
    pub ends_whole: bool,
}

impl Recording {
    /// Read a whole file with any topics; a truncated or damaged one as far as possible (see
    /// [`Recording::loss`]).
    ///
    /// # Errors
    /// When the file cannot be read, is empty, is not MCAP, or has a topic of the contract with
    /// another schema.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(RecordingError::io(path, "open"))?;
        let mut source = HashingReader {
            inner: BufReader::new(file),
            sha256: Sha256::new(),
            bytes: 0,
            tail: [0; 8],
        };
        let mut load = Load::default();
        let loss = scan::scan(&mut source, &mut |record| load.visit(record))
            .map_err(|error| scan_error(path, error))?;
        io::copy(&mut source, &mut io::sink()).map_err(RecordingError::io(path, "read"))?;
        let mut recording = load.recording;
        recording.path = path.to_owned();
        recording.loss = loss;
        recording.bytes = source.bytes;
        recording.ends_whole = 2 * MAGIC.len() as u64 <= source.bytes && source.tail == MAGIC;
        recording.sha256 = hexadecimal(&source.sha256.finalize());
        recording.channels.retain(|channel| !channel.topic.is_empty());
        recording.check_schemas()?;
        recording.log_opened();
        Ok(recording)
    }

    fn log_opened(&self) {
        let messages: usize = self.channels.iter().map(|channel| channel.messages.len()).sum();
        let (path, bytes, channels) = (self.path.display(), self.bytes, self.channels.len());
        log::info!("opened {path}: {bytes} bytes, {messages} messages on {channels} channels");
        log::debug!("{path}: sha256 {}", self.sha256);
    }

    /// Refuse a topic of the contract with another schema.
    fn check_schemas(&self) -> Result<(), RecordingError> {
        for channel in &self.channels {
            let Some(expected) = topic::schema_of(&channel.topic) else { continue };
            if channel.schema != expected || channel.encoding != PROTOBUF {
                return Err(RecordingError::WrongSchema {
                    path: self.path.clone(),
                    topic: channel.topic.clone(),
                    found: format!("{} ({})", channel.schema, channel.encoding),
                    expected: format!("{expected} ({PROTOBUF})"),
                });
            }
            schema::check_compatible(expected, &channel.schema_data).map_err(|difference| {
                RecordingError::SchemaDiffers {
                    path: self.path.clone(),
                    topic: channel.topic.clone(),
                    schema: channel.schema.clone(),
                    difference: Box::new(difference),
                }
            })?;
        }
        Ok(())
    }

    /// Return all channels of `topic`; more than one when the file was written in parts.
    pub fn channels_of<'a>(&'a self, topic: &'a str) -> impl Iterator<Item = &'a Channel> {
        self.channels.iter().filter(move |channel| channel.topic == topic)
    }

    /// Return the number of messages of `topic`.
    #[must_use]
    pub fn count(&self, topic: &str) -> usize {
        self.channels_of(topic).map(|channel| channel.messages.len()).sum()
    }

    /// Return the messages of `topic` by log time; empty for a missing topic.
    ///
    /// # Errors
    /// When the topic has another schema than `M`, or a message cannot be decoded.
    pub fn series<M: Message + Name + Default>(
        &self,
        topic: &str,
    ) -> Result<Series<M>, RecordingError> {
        let mut stamped = Vec::with_capacity(self.count(topic));
        for channel in self.channels_of(topic) {
            if channel.schema != M::full_name() {
                return Err(RecordingError::WrongSchema {
                    path: self.path.clone(),
                    topic: topic.to_owned(),
                    found: channel.schema.clone(),
                    expected: M::full_name(),
                });
            }
            for (index, (message, bytes)) in channel.raw().enumerate() {
                let decoded = M::decode(bytes).map_err(|error| RecordingError::BadMessage {
                    path: self.path.clone(),
                    topic: topic.to_owned(),
                    index,
                    schema: M::NAME.to_owned(),
                    reason: error.to_string(),
                })?;
                stamped.push((message.log_time, decoded));
            }
        }
        stamped.sort_by_key(|(time, _)| *time);
        let (times, values) = stamped.into_iter().unzip();
        Ok(Series { times, values })
    }

    /// Return the first message of `topic` in file order; `None` without messages.
    ///
    /// # Errors
    /// When it cannot be decoded.
    pub fn first<M: Message + Name + Default>(
        &self,
        topic: &str,
    ) -> Result<Option<M>, RecordingError> {
        let Some((_, bytes)) = self.channels_of(topic).find_map(|channel| channel.raw().next())
        else {
            return Ok(None);
        };
        M::decode(bytes).map(Some).map_err(|error| RecordingError::BadMessage {
            path: self.path.clone(),
            topic: topic.to_owned(),
            index: 0,
            schema: M::NAME.to_owned(),
            reason: error.to_string(),
        })
    }

    /// Return a value of the metadata record `klasktron.recording`.
    #[must_use]
    pub fn info(&self, key: &str) -> Option<&str> {
        self.metadata.get(RECORDING_METADATA)?.get(key).map(String::as_str)
    }

    /// Return the attachment called `name`.
    #[must_use]
    pub fn attachment(&self, name: &str) -> Option<&Attachment> {
        self.attachments.iter().find(|attachment| attachment.name == name)
    }

    /// Return the first and last log time of all messages; `None` without messages.
    #[must_use]
    pub fn time_range(&self) -> Option<(Nanos, Nanos)> {
        let times = || self.channels.iter().flat_map(|c| c.messages.iter().map(|m| m.log_time));
        Some((times().min()?, times().max()?))
    }

    /// Return the run markers by log time.
    ///
    /// # Errors
    /// When one cannot be decoded.
    pub fn markers(&self) -> Result<Series<RunMarker>, RecordingError> {
        self.series(topic::RUN_MARKER)
    }
}

fn scan_error(path: &Path, error: ScanError) -> RecordingError {
    let path = path.to_owned();
    match error {
        ScanError::Empty => RecordingError::Empty { path },
        ScanError::NotMcap(begins) => {
            RecordingError::NotMcap { path, begins: hexadecimal(&begins) }
        }
        ScanError::Io(source) => RecordingError::Io { path, action: "read", source },
    }
}

/// Return lower-case hexadecimal digits of `bytes`.
#[must_use]
pub fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Return the SHA-256 of a file, in hexadecimal.
///
/// # Errors
/// When the file cannot be read.
pub fn sha256_of_file(path: &Path) -> Result<String, RecordingError> {
    let file = File::open(path).map_err(RecordingError::io(path, "open"))?;
    let mut source = HashingReader { inner: file, sha256: Sha256::new(), bytes: 0, tail: [0; 8] };
    io::copy(&mut source, &mut io::sink()).map_err(RecordingError::io(path, "read"))?;
    Ok(hexadecimal(&source.sha256.finalize()))
}

/// Reader that passes bytes through and computes their hash, count and end.
struct HashingReader<R> {
    inner: R,
    sha256: Sha256,
    bytes: u64,
    /// Last bytes read.
    tail: [u8; 8],
}

impl<R: Read> Read for HashingReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        self.sha256.update(&buffer[..count]);
        self.bytes += count as u64;
        for byte in &buffer[count.saturating_sub(self.tail.len())..count] {
            self.tail.rotate_left(1);
            self.tail[7] = *byte;
        }
        Ok(count)
    }
}

/// Collector of the records of one file.
#[derive(Default)]
struct Load {
    recording: Recording,
    schemas: HashMap<u16, (records::SchemaHeader, Vec<u8>)>,
    /// Index in `recording.channels` by the file's own channel id.
    position_by_id: HashMap<u16, usize>,
}

impl Load {
    fn visit(&mut self, record: Record<'_>) {
        match record {
            Record::Header(header) => {
                self.recording.profile = header.profile;
                self.recording.library = header.library;
            }
            Record::Schema { header, data } => {
                self.schemas.insert(header.id, (header, data.into_owned()));
            }
            Record::Channel(channel) => self.add_channel(channel),
            Record::Message { header, data } => {
                // A message without a channel record cannot be decoded; a damaged chunk with the channel record is counted in `loss` already.
                if let Some(position) = self.position_by_id.get(&header.channel_id) {
                    self.recording.channels[*position].push(&header, &data);
                }
            }
            Record::Attachment { header, data, .. } => {
                self.recording.attachments.push(Attachment {
                    name: header.name,
                    media_type: header.media_type,
                    data: data.into_owned(),
                })
            }
            Record::Metadata(metadata) => {
                self.recording.metadata.insert(metadata.name, metadata.metadata);
            }
            _ => {}
        }
    }

    fn add_channel(&mut self, channel: records::Channel) {
        if self.position_by_id.contains_key(&channel.id) {
            return; // repeated in the chunk or the summary
        }
        let (schema, schema_encoding, schema_data) = match self.schemas.get(&channel.schema_id) {
            Some((header, data)) => (header.name.clone(), header.encoding.clone(), data.clone()),
            None => Default::default(),
        };
        self.position_by_id.insert(channel.id, self.recording.channels.len());
        self.recording.channels.push(Channel {
            topic: channel.topic,
            schema,
            schema_encoding,
            schema_data,
            encoding: channel.message_encoding,
            metadata: channel.metadata,
            messages: Vec::new(),
            bytes: Vec::new(),
        });
    }
}
