//! TensorBoard event files: TFRecords of `Event` messages.
//!
//! A TFRecord is the length (u64, little endian), its masked CRC-32C (u32), the data, and their masked CRC-32C
//! (TensorFlow, `core/lib/io/record_writer.cc`); the mask is `rotate_right(crc, 15) + 0xa282ead8`. CRC-32C is
//! that of RFC 3720, appendix B.4 (Castagnoli's polynomial, reflected 0x82f63b78). The messages are the needed
//! subset of `event.proto` and `summary.proto`, field numbers as there.

use super::CurvePoint;
use prost::Message;
use std::{
    fs::File,
    io::{self, Write as _},
    path::{Path, PathBuf},
};

#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    values: Vec<Value>,
}

#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, optional, tag = "2")]
    simple_value: Option<f32>,
}

/// A TensorBoard event file, open for appending.
#[derive(Debug)]
pub struct EventFile {
    file: File,
    path: PathBuf,
}

impl EventFile {
    /// Create a file in `folder`, which is created if missing. `first_update` is part of the file
    /// name: a resumed run adds a file. `wall_time` is seconds since the Unix epoch.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn create(folder: &Path, first_update: u64, wall_time: f64) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        let path = folder.join(format!("events.out.tfevents.{first_update:010}.klasktron"));
        let mut events = Self { file: File::create(&path)?, path };
        let file_version = Some("brain.Event:2".to_owned());
        events.write(&Event { wall_time, file_version, ..Event::default() })?;
        Ok(events)
    }

    /// Path of the file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Add the metrics of an update, at its number of transitions.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn add(&mut self, point: &CurvePoint, wall_time: f64) -> io::Result<()> {
        let values = point
            .figures()
            .map(|(tag, value)| Value { tag: tag.to_owned(), simple_value: Some(value as f32) });
        let summary = Some(Summary { values: values.into() });
        let step = point.transitions as i64;
        self.write(&Event { wall_time, step, summary, file_version: None })
    }

    fn write(&mut self, event: &Event) -> io::Result<()> {
        self.file.write_all(&record(&event.encode_to_vec()))
    }
}

/// Encode `data` as a TFRecord.
fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    let mut bytes = length.to_vec();
    bytes.extend(masked(crc32c(&length)).to_le_bytes());
    bytes.extend(data);
    bytes.extend(masked(crc32c(data)).to_le_bytes());
    bytes
}

fn masked(crc: u32) -> u32 {
    crc.rotate_right(15).wrapping_add(0xa282_ead8)
}

/// CRC-32C, bit by bit: a few kilobytes per update need no table.
fn crc32c(data: &[u8]) -> u32 {
    const POLYNOMIAL: u32 = 0x82f6_3b78;
    let byte = |crc: u32, byte: &u8| {
        let shift = |crc: u32, _| (crc >> 1) ^ (POLYNOMIAL & (crc & 1).wrapping_neg());
        (0..8).fold(crc ^ u32::from(*byte), shift)
    };
    !data.iter().fold(!0, byte)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_that_of_the_rfc() {
        // RFC 3720, appendix B.4, and the check value of the catalogue of CRC algorithms.
        assert_eq!(crc32c(&[0; 32]), 0x8a91_36aa);
        assert_eq!(crc32c(&[0xff; 32]), 0x62a8_ab43);
        let rising: Vec<u8> = (0..32).collect();
        assert_eq!(crc32c(&rising), 0x46dd_794e);
        assert_eq!(crc32c(b"123456789"), 0xe306_9283);
    }

    /// Bytes of `tensorboard.summary.writer.record_writer.RecordWriter` (tensorboard 2.21) for
    /// `b"klasktron"`.
    #[test]
    fn a_record_is_framed_as_tensorboard_frames_it() {
        let bytes = record(b"klasktron");
        assert_eq!(bytes.len(), 8 + 4 + 9 + 4);
        assert_eq!(bytes[..8], 9u64.to_le_bytes());
        assert_eq!(bytes[8..12], [0x37, 0xf9, 0x71, 0x39]);
        assert_eq!(bytes[21..], [0x4c, 0xde, 0x6e, 0x2f]);
    }
}
