//! Images of a recording as a source.
//!
//! The file is read from front to back with little memory, since recordings with images are large. Read are
//! `foxglove.CompressedImage` (Protocol Buffers), and `sensor_msgs/msg/Image` and `CompressedImage` in CDR, as rosbag2
//! writes them. The capture time is the time stamp of the message's header.

use super::{
    FrameSource, Next, SourceError,
    decode::{DecodeError, Scratch, decode_with},
};
use crate::{
    camera::frame::{Frame, PixelFormat, yuv_of_rgb},
    units::{NANOS_PER_SECOND, Nanos},
};
use mcap::{
    records::Record,
    sans_io::linear_reader::{LinearReadEvent, LinearReader},
};
use std::{
    collections::BTreeMap,
    fs::File,
    io::Read,
    path::{Path, PathBuf},
};

/// Types of messages that are images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum ImageType {
    /// `foxglove.CompressedImage`.
    Foxglove,
    /// `sensor_msgs/msg/CompressedImage`.
    Compressed,
    /// `sensor_msgs/msg/Image`.
    Raw,
}

/// Message `foxglove.CompressedImage`. Source: foxglove/schemas.
#[derive(Clone, PartialEq, prost::Message)]
pub(in crate::camera) struct CompressedImage {
    /// Capture time.
    #[prost(message, optional, tag = "1")]
    pub(in crate::camera) timestamp: Option<prost_types::Timestamp>,
    /// Image file.
    #[prost(bytes = "vec", tag = "2")]
    pub(in crate::camera) data: Vec<u8>,
    /// `jpeg` or `png`.
    #[prost(string, tag = "3")]
    pub(in crate::camera) format: String,
    /// Frame of reference.
    #[prost(string, tag = "4")]
    pub(in crate::camera) frame_id: String,
}

/// Images of a recording.
pub struct McapImages {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    /// Names of the schemas by id.
    schemas: BTreeMap<u16, String>,
    /// Channels with images by id.
    images: BTreeMap<u16, ImageType>,
    scratch: Scratch,
    count: u64,
}

impl McapImages {
    /// Open a recording.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let file = File::open(path).map_err(|error| SourceError::Unusable {
            source_name: format!("mcap:{}", path.display()),
            what: format!("cannot open ({error})"),
            remedy: "check its name".to_owned(),
        })?;
        Ok(Self {
            path: path.to_owned(),
            file,
            reader: LinearReader::new(),
            schemas: BTreeMap::new(),
            images: BTreeMap::new(),
            scratch: Scratch::default(),
            count: 0,
        })
    }

    fn unusable(&self, what: String, remedy: &str) -> SourceError {
        SourceError::Unusable { source_name: self.name(), what, remedy: remedy.to_owned() }
    }
}

/// What one record was.
enum Found {
    Image(Result<(), DecodeError>),
    Other,
}

impl FrameSource for McapImages {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError> {
        loop {
            let Some(event) = self.reader.next_event() else {
                if self.count == 0 {
                    return Err(self.unusable(
                        "the recording has no image".to_owned(),
                        "record one with `klasktron detect --frames`, or give another file",
                    ));
                }
                return Ok(Next::End);
            };
            let found = match event {
                Ok(LinearReadEvent::ReadRequest(bytes)) => {
                    let read = self.file.read(self.reader.insert(bytes));
                    match read {
                        Ok(count) => self.reader.notify_read(count),
                        Err(error) => {
                            return Err(
                                self.unusable(format!("reading fails ({error})"), "check the disk")
                            );
                        }
                    }
                    continue;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => {
                    let Ok(record) = mcap::parse_record(opcode, data) else { continue };
                    take(record, (&mut self.schemas, &mut self.images), &mut self.scratch, frame)
                }
                Err(error) => {
                    let what = format!("the file is damaged after {} images ({error})", self.count);
                    return Err(
                        self.unusable(what, "save its readable part with `klasktron recover`")
                    );
                }
            };
            match found {
                Found::Other => {}
                Found::Image(result) => {
                    self.count += 1;
                    let image = format!("image {} of {}", self.count, self.path.display());
                    result.map_err(|reason| SourceError::Image { image, reason })?;
                    return Ok(Next::Frame);
                }
            }
        }
    }

    fn name(&self) -> String {
        format!("mcap:{}", self.path.display())
    }
}

fn take(
    record: Record<'_>,
    (schemas, images): (&mut BTreeMap<u16, String>, &mut BTreeMap<u16, ImageType>),
    scratch: &mut Scratch,
    frame: &mut Frame,
) -> Found {
    match record {
        Record::Schema { header, .. } => {
            schemas.insert(header.id, header.name);
        }
        Record::Channel(channel) => {
            if let Some(name) = schemas.get(&channel.schema_id)
                && let Some(image) = image_type(name, &channel.message_encoding)
            {
                images.insert(channel.id, image);
            }
        }
        Record::Message { header, data } => {
            if let Some(image) = images.get(&header.channel_id) {
                frame.received_time = Nanos(header.log_time);
                frame.capture_time = Nanos(header.publish_time);
                return Found::Image(read_image(*image, &data, scratch, frame));
            }
        }
        _ => {}
    }
    Found::Other
}

fn image_type(schema: &str, encoding: &str) -> Option<ImageType> {
    match (schema, encoding) {
        ("foxglove.CompressedImage", "protobuf") => Some(ImageType::Foxglove),
        ("sensor_msgs/msg/CompressedImage" | "sensor_msgs/CompressedImage", "cdr") => {
            Some(ImageType::Compressed)
        }
        ("sensor_msgs/msg/Image" | "sensor_msgs/Image", "cdr") => Some(ImageType::Raw),
        _ => None,
    }
}

fn read_image(
    image: ImageType,
    data: &[u8],
    scratch: &mut Scratch,
    frame: &mut Frame,
) -> Result<(), DecodeError> {
    match image {
        ImageType::Foxglove => {
            let message = <CompressedImage as prost::Message>::decode(data).map_err(|error| {
                DecodeError::Pixels { found: format!("not readable ({error})") }
            })?;
            if let Some(time) = &message.timestamp {
                frame.capture_time = stamp(time.seconds, time.nanos as u32);
            }
            decode_with(&message.data, frame, scratch)
        }
        ImageType::Compressed => {
            let mut cdr = Cdr::new(data);
            frame.capture_time = cdr.header();
            cdr.text();
            decode_with(cdr.bytes(), frame, scratch)
        }
        ImageType::Raw => read_raw(data, frame),
    }
}

/// Read `sensor_msgs/msg/Image`.
fn read_raw(data: &[u8], frame: &mut Frame) -> Result<(), DecodeError> {
    let mut cdr = Cdr::new(data);
    frame.capture_time = cdr.header();
    let (height, width) = (cdr.u32() as usize, cdr.u32() as usize);
    let encoding = cdr.text().to_owned();
    cdr.at += 1;
    let step = cdr.u32() as usize;
    let bytes = cdr.bytes();
    let per_pixel = match encoding.as_str() {
        "mono8" => 1,
        "rgb8" | "bgr8" => 3,
        _ => 2,
    };
    if !width.is_multiple_of(2) || step != width * per_pixel {
        return Err(DecodeError::Pixels {
            found: format!("{encoding} with rows of {step} bytes for {width} pixels"),
        });
    }
    let size = [width, height];
    match encoding.as_str() {
        "uyvy" | "yuv422" => frame.set_packed(size, PixelFormat::Uyvy, bytes)?,
        "yuyv" | "yuv422_yuy2" => frame.set_packed(size, PixelFormat::Yuyv, bytes)?,
        "mono8" => frame.set_grey(size, bytes)?,
        "rgb8" => frame.set_triples(size, bytes, yuv_of_rgb)?,
        "bgr8" => frame.set_triples(size, bytes, |[b, g, r]| yuv_of_rgb([r, g, b]))?,
        _ => return Err(DecodeError::Pixels { found: encoding }),
    }
    Ok(())
}

fn stamp(seconds: i64, nanos: u32) -> Nanos {
    Nanos(seconds.max(0) as u64 * NANOS_PER_SECOND + u64::from(nanos))
}

/// Reader of little-endian CDR (XCDR1) with the fixed layout of image messages. Beyond the end it reads zeros and
/// empty texts, which the frame's size check refuses.
struct Cdr<'a> {
    body: &'a [u8],
    at: usize,
}

impl<'a> Cdr<'a> {
    fn new(data: &'a [u8]) -> Self {
        Self { body: data.get(4..).unwrap_or_default(), at: 0 }
    }

    fn u32(&mut self) -> u32 {
        self.at = self.at.next_multiple_of(4);
        let bytes = self.body.get(self.at..self.at + 4).and_then(|own| own.try_into().ok());
        self.at += 4;
        bytes.map_or(0, u32::from_le_bytes)
    }

    fn header(&mut self) -> Nanos {
        let (seconds, nanos) = (self.u32(), self.u32());
        self.text();
        stamp(i64::from(seconds), nanos)
    }

    fn text(&mut self) -> &'a str {
        let bytes = self.bytes();
        std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes)).unwrap_or_default()
    }

    fn bytes(&mut self) -> &'a [u8] {
        let length = self.u32() as usize;
        let end = self.at.saturating_add(length).min(self.body.len());
        let bytes = self.body.get(self.at..end).unwrap_or_default();
        self.at = end;
        bytes
    }
}
