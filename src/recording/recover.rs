//! Recovery of the readable part of a truncated or damaged file.

use super::{
    Recording, RecordingError,
    atomic::ExistingFile,
    writer::{FlushPolicy, RecordingWriter},
};
use crate::units::Nanos;
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
    write_extended(recording, path, existing, |_, _, _, _| Ok(()))
}

/// Write a copy as [`write_copy`] does, and call `after` with the topic, log and publish time and
/// content of every message, so that it can add messages of its own.
///
/// # Errors
/// As [`write_copy`], or when `after` fails.
pub fn write_extended(
    recording: &Recording,
    path: &Path,
    existing: ExistingFile,
    after: impl FnMut(&mut RecordingWriter, &str, [Nanos; 2], &[u8]) -> Result<(), RecordingError>,
) -> Result<(), RecordingError> {
    let mut writer =
        RecordingWriter::with_profile(path, &recording.profile, existing, FlushPolicy::WhenFull)?;
    match copy_into(recording, &mut writer, after) {
        Ok(()) => writer.finish(),
        Err(error) => {
            writer.discard();
            Err(error)
        }
    }
}

fn copy_into(
    recording: &Recording,
    writer: &mut RecordingWriter,
    mut after: impl FnMut(&mut RecordingWriter, &str, [Nanos; 2], &[u8]) -> Result<(), RecordingError>,
) -> Result<(), RecordingError> {
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
        let times = [index.log_time, index.publish_time];
        writer.write_raw(&channel.topic, &channel.raw_schema(), times, bytes)?;
        after(writer, &channel.topic, times, bytes)?;
    }
    for attachment in &recording.attachments {
        writer.attach(&attachment.name, &attachment.media_type, &attachment.data)?;
    }
    Ok(())
}
