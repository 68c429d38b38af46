//! Recovery of the readable part of a truncated or damaged file.

use super::{
    Recording, RecordingError,
    atomic::ExistingFile,
    writer::{FlushPolicy, RawSchema, RecordingWriter},
};
use std::path::Path;

/// Write the content of `recording` to `path`, with summary and indexes: messages by log time (file
/// order among equals), then metadata and attachments. Unknown topics are copied unchanged.
///
/// # Errors
/// When the file exists and `existing` refuses, or writing to disk fails.
pub fn write_copy(
    recording: &Recording,
    path: &Path,
    existing: ExistingFile,
) -> Result<(), RecordingError> {
    let mut writer =
        RecordingWriter::with_profile(path, &recording.profile, existing, FlushPolicy::WhenFull)?;
    match copy_into(recording, &mut writer) {
        Ok(()) => writer.finish(),
        Err(error) => {
            writer.discard();
            Err(error)
        }
    }
}

fn copy_into(recording: &Recording, writer: &mut RecordingWriter) -> Result<(), RecordingError> {
    for (name, values) in &recording.metadata {
        writer.metadata(name, values.clone())?;
    }
    let mut messages: Vec<_> = recording
        .channels
        .iter()
        .flat_map(|channel| channel.raw().map(move |(index, bytes)| (index, channel, bytes)))
        .collect();
    messages.sort_by_key(|(index, _, _)| index.log_time);
    for (index, channel, bytes) in messages {
        let schema = RawSchema {
            name: &channel.schema,
            encoding: &channel.schema_encoding,
            data: &channel.schema_data,
            message_encoding: &channel.encoding,
            channel_metadata: &channel.metadata,
        };
        writer.write_raw(&channel.topic, &schema, [index.log_time, index.publish_time], bytes)?;
    }
    for attachment in &recording.attachments {
        writer.attach(&attachment.name, &attachment.media_type, &attachment.data)?;
    }
    Ok(())
}
