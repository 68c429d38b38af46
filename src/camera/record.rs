//! Frames in recordings: `foxglove.CompressedImage` with JPEG, which Foxglove, Lichtblick and Rerun show.

use super::{
    frame::Frame,
    source::{CompressedImage, encode_jpeg},
};
use crate::{
    recording::{RawSchema, RecordingError, RecordingWriter, topic},
    units::Nanos,
};
use prost::Message as _;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet,
    field_descriptor_proto::{Label, Type},
};
use std::sync::LazyLock;

/// Quality of the JPEG images: 90 moves a fitted centre by less than 0.05 pixels.
const QUALITY: u8 = 90;

/// Error of recording a frame.
#[derive(Debug, thiserror::Error)]
pub enum FrameImageError {
    /// A frame that is no image.
    #[error("the frame cannot be encoded as JPEG: {0}")]
    Jpeg(String),
    /// Error of the recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// Writer of frames into a recording.
#[derive(Debug)]
pub struct FrameImages;

impl FrameImages {
    /// Write a frame on [`topic::CAMERA_IMAGE`]; `times` are log and publish time.
    ///
    /// # Errors
    /// When the frame is empty or writing to disk fails.
    pub fn write(
        writer: &mut RecordingWriter,
        times: [Nanos; 2],
        frame: &Frame,
    ) -> Result<(), FrameImageError> {
        let mut data = Vec::new();
        encode_jpeg(frame, QUALITY, &mut data).map_err(FrameImageError::Jpeg)?;
        let message = CompressedImage {
            timestamp: Some(frame.capture_time.timestamp()),
            data,
            format: "jpeg".to_owned(),
            frame_id: "camera".to_owned(),
        };
        let schema = RawSchema::protobuf("foxglove.CompressedImage", &DESCRIPTOR);
        Ok(writer.write_raw(topic::CAMERA_IMAGE, &schema, times, &message.encode_to_vec())?)
    }
}

/// Serialised [`descriptor`], the same for every frame.
static DESCRIPTOR: LazyLock<Vec<u8>> = LazyLock::new(|| descriptor().encode_to_vec());

/// Descriptor of `foxglove.CompressedImage` (foxglove/schemas) and of the time stamp that it uses.
fn descriptor() -> FileDescriptorSet {
    let field = |name: &str, number, kind: Type, type_name: Option<&str>| FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional.into()),
        r#type: Some(kind.into()),
        type_name: type_name.map(ToOwned::to_owned),
        json_name: Some(name.to_owned()),
        ..FieldDescriptorProto::default()
    };
    let file = |name: &str, package: &str, message: DescriptorProto, dependency: Vec<String>| {
        FileDescriptorProto {
            name: Some(name.to_owned()),
            package: Some(package.to_owned()),
            message_type: vec![message],
            dependency,
            syntax: Some("proto3".to_owned()),
            ..FileDescriptorProto::default()
        }
    };
    let message = |name: &str, field| DescriptorProto {
        name: Some(name.to_owned()),
        field,
        ..DescriptorProto::default()
    };
    let time = "google/protobuf/timestamp.proto";
    let timestamp = message(
        "Timestamp",
        vec![field("seconds", 1, Type::Int64, None), field("nanos", 2, Type::Int32, None)],
    );
    let image = message(
        "CompressedImage",
        vec![
            field("timestamp", 1, Type::Message, Some(".google.protobuf.Timestamp")),
            field("frame_id", 4, Type::String, None),
            field("data", 2, Type::Bytes, None),
            field("format", 3, Type::String, None),
        ],
    );
    FileDescriptorSet {
        file: vec![
            file(time, "google.protobuf", timestamp, Vec::new()),
            file("foxglove/CompressedImage.proto", "foxglove", image, vec![time.to_owned()]),
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        camera::{FrameSource as _, McapImages, Next},
        recording::{ExistingFile, FlushPolicy},
    };

    #[test]
    fn a_recorded_frame_is_read_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("frames.mcap");
        let mut frame = Frame::default();
        frame.set_grey([64, 48], &[93; 64 * 48]).unwrap();
        frame.capture_time = Nanos(1_700_000_000_123_456_789);
        let mut writer =
            RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
        FrameImages::write(&mut writer, [Nanos(5), Nanos(3)], &frame).unwrap();
        writer.finish().unwrap();
        let mut source = McapImages::open(&path).unwrap();
        let mut back = Frame::default();
        assert_eq!(source.next_frame(&mut back).unwrap(), Next::Frame);
        assert_eq!(back.capture_time, frame.capture_time);
        assert_eq!(back.received_time, Nanos(5));
        assert_eq!(back.view().yuv(10, 10), [93, 128, 128]);
        assert_eq!(source.next_frame(&mut back).unwrap(), Next::End);
    }

    #[test]
    fn a_recording_without_images_says_so() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("empty.mcap");
        let writer =
            RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
        writer.finish().unwrap();
        let error = McapImages::open(&path).unwrap().next_frame(&mut Frame::default()).unwrap_err();
        assert!(
            error.to_string().contains("the recording has no image; record one with"),
            "{error}"
        );
    }
}
