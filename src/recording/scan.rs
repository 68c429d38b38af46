//! Damage-tolerant forward pass over the bytes of an MCAP file.
//!
//! The layout is that of the MCAP specification (<https://mcap.dev/spec>): magic, then records of
//! one opcode byte, a little-endian `u64` length and that many bytes; chunks hold further records,
//! compressed. The public readers stop at the first fault. This one returns every complete record
//! of a file that was truncated at any byte, including those of the last, truncated chunk. It skips
//! chunks with a wrong checksum and counts the loss.
//!
//! Indexes are ignored on purpose. A forward pass needs none, and a truncated file has none.

use mcap::records::{ChunkHeader, Record};
use std::{
    fmt,
    io::{self, Read},
    path::Path,
};

/// First and last eight bytes of an MCAP file.
pub const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";

/// Largest accepted record outside a chunk and largest chunk, compressed or decompressed (bytes).
/// It guards against wrong lengths in a damaged or hostile file.
const MAX_RECORD_BYTES: u64 = 1 << 30;

const RECORD_PREFIX_BYTES: usize = 9;
const OPCODE_ATTACHMENT: u8 = 0x09;
/// Length of two time stamps, two string lengths, the data length and the checksum.
const MIN_ATTACHMENT_BYTES: usize = 8 + 8 + 4 + 4 + 8 + 4;

/// Losses of a damaged file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Loss {
    /// Offset at which the file ends in the middle of its data (bytes).
    pub cut_off_at: Option<u64>,
    /// Number of chunks skipped because they cannot be decompressed or have a wrong checksum.
    pub bad_chunks: u64,
    /// Number of other records that could not be decoded.
    pub bad_records: u64,
    /// Number of bytes without content.
    pub bytes: u64,
}

impl Loss {
    /// Return whether everything was read.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Sentence on the lost part of the recording at `path`, and the way to a whole file of the rest.
    #[must_use]
    pub fn sentence(&self, path: &Path) -> String {
        let file = path.display();
        format!(
            "{file}: {self}; the rest was read; copy it into a whole file with `klasktron recover \
             {file} -o OUTPUT`"
        )
    }
}

impl fmt::Display for Loss {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        if let Some(at) = self.cut_off_at {
            parts.push(format!("cut off at byte {at}"));
        }
        if 0 < self.bad_chunks {
            parts.push(format!("{} damaged chunks skipped", self.bad_chunks));
        }
        if 0 < self.bad_records {
            parts.push(format!("{} unreadable records skipped", self.bad_records));
        }
        write!(f, "{}, {} bytes lost", parts.join(", "), self.bytes)
    }
}

/// Error of a source that is not an MCAP file.
#[derive(Debug)]
pub(super) enum ScanError {
    /// Empty source.
    Empty,
    /// Other magic bytes.
    NotMcap(Vec<u8>),
    /// Read error of the source.
    Io(io::Error),
}

/// Pass every complete record of `source` to `visit`, including those of chunks, in file order, and
/// return the losses. Summary, index and chunk records are not passed.
///
/// # Errors
/// When the source fails or does not start as an MCAP file.
pub(super) fn scan(
    source: impl Read,
    visit: &mut dyn FnMut(Record<'_>),
) -> Result<Loss, ScanError> {
    let mut scan = Scan { source, offset: 0, loss: Loss::default(), unpacked: Vec::new() };
    scan.check_magic()?;
    scan.run(visit).map_err(ScanError::Io)?;
    Ok(scan.loss)
}

struct Scan<R> {
    source: R,
    /// Number of bytes read from the source so far.
    offset: u64,
    loss: Loss,
    /// Content of the present chunk; the memory is reused.
    unpacked: Vec<u8>,
}

/// Completeness of the bytes of a chunk.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Extent {
    Whole,
    CutOff,
}

enum Next {
    Continue,
    DataEnd,
}

impl<R: Read> Scan<R> {
    fn check_magic(&mut self) -> Result<(), ScanError> {
        let begins = self.take_up_to(MAGIC.len() as u64).map_err(ScanError::Io)?;
        match begins.as_slice() {
            [] => Err(ScanError::Empty),
            _ if begins == MAGIC => Ok(()),
            _ => Err(ScanError::NotMcap(begins)),
        }
    }

    /// Read `length` bytes, or the remaining bytes when fewer.
    fn take_up_to(&mut self, length: u64) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::with_capacity(length.min(1 << 16) as usize);
        self.source.by_ref().take(length).read_to_end(&mut bytes)?;
        self.offset += bytes.len() as u64;
        Ok(bytes)
    }

    fn run(&mut self, visit: &mut dyn FnMut(Record<'_>)) -> io::Result<()> {
        loop {
            let start = self.offset;
            let prefix = self.take_up_to(RECORD_PREFIX_BYTES as u64)?;
            let Some((opcode, length)) = parse_prefix(&prefix) else {
                self.cut_off(start);
                return Ok(());
            };
            let body = self.take_up_to(length.min(MAX_RECORD_BYTES))?;
            let whole = body.len() as u64 == length;
            if !whole {
                self.cut_off(start);
            }
            if opcode == mcap::records::op::CHUNK {
                let extent = if whole { Extent::Whole } else { Extent::CutOff };
                self.visit_chunk(&body, extent, visit);
            } else if whole && matches!(self.visit_record(opcode, &body, visit), Next::DataEnd) {
                return Ok(());
            }
            if !whole {
                return Ok(());
            }
        }
    }

    fn cut_off(&mut self, start: u64) {
        self.loss.cut_off_at = Some(self.offset);
        self.loss.bytes += self.offset - start;
    }

    fn visit_record(&mut self, opcode: u8, body: &[u8], visit: &mut dyn FnMut(Record<'_>)) -> Next {
        match parse_record(opcode, body) {
            Some(Record::DataEnd(_) | Record::Footer(_)) => return Next::DataEnd,
            Some(
                record @ (Record::Header(_)
                | Record::Schema { .. }
                | Record::Channel(_)
                | Record::Message { .. }
                | Record::Attachment { .. }
                | Record::Metadata(_)),
            ) => visit(record),
            Some(_) => {}
            None => {
                self.loss.bad_records += 1;
                self.loss.bytes += body.len() as u64;
            }
        }
        Next::Continue
    }

    /// Visit the records of a chunk. A complete chunk counts only with a correct checksum. A
    /// truncated chunk cannot be checked, so every complete record counts.
    fn visit_chunk(&mut self, body: &[u8], extent: Extent, visit: &mut dyn FnMut(Record<'_>)) {
        let mut unpacked = std::mem::take(&mut self.unpacked);
        unpacked.clear();
        let good = match parse_chunk(body) {
            Some((header, packed)) => {
                let complete = unpack(&header, packed, &mut unpacked);
                extent == Extent::CutOff || (complete && checksum_holds(&header, &unpacked))
            }
            None => extent == Extent::CutOff,
        };
        if good {
            let mut rest = unpacked.as_slice();
            while let Some((opcode, record, after)) = split_record(rest) {
                self.visit_record(opcode, record, visit);
                rest = after;
            }
        } else {
            self.loss.bad_chunks += 1;
            self.loss.bytes += body.len() as u64;
        }
        self.unpacked = unpacked;
    }
}

fn parse_prefix(prefix: &[u8]) -> Option<(u8, u64)> {
    let (opcode, length) = prefix.split_first()?;
    Some((*opcode, u64::from_le_bytes(length.try_into().ok()?)))
}

/// Return the first record of `bytes` and the bytes after it; `None` when it is incomplete.
fn split_record(bytes: &[u8]) -> Option<(u8, &[u8], &[u8])> {
    let (opcode, length) = parse_prefix(bytes.get(..RECORD_PREFIX_BYTES)?)?;
    let body = bytes.get(RECORD_PREFIX_BYTES..)?;
    let length = usize::try_from(length).ok()?;
    Some((opcode, body.get(..length)?, body.get(length..)?))
}

/// Parse a record as `mcap::read::parse_record` does, which must not get an attachment shorter than
/// its fields.
fn parse_record(opcode: u8, body: &[u8]) -> Option<Record<'_>> {
    if opcode == OPCODE_ATTACHMENT && !attachment_fits(body) {
        return None;
    }
    mcap::read::parse_record(opcode, body).ok()
}

/// Return whether the two strings and the checksum of an attachment lie within its bytes.
fn attachment_fits(body: &[u8]) -> bool {
    let string_end = |at: usize| -> Option<usize> {
        let length = u32::from_le_bytes(body.get(at..at + 4)?.try_into().ok()?);
        (at + 4).checked_add(usize::try_from(length).ok()?)
    };
    let end = string_end(16).and_then(string_end);
    MIN_ATTACHMENT_BYTES <= body.len() && end.is_some_and(|end| end + 8 + 4 <= body.len())
}

/// Return the header of a chunk and its compressed bytes, as many as there are.
fn parse_chunk(body: &[u8]) -> Option<(ChunkHeader, &[u8])> {
    const FIXED_BYTES: usize = 8 + 8 + 8 + 4;
    let u64_at = |at: usize| -> Option<u64> {
        Some(u64::from_le_bytes(body.get(at..at + 8)?.try_into().ok()?))
    };
    let u32_at = |at: usize| -> Option<u32> {
        Some(u32::from_le_bytes(body.get(at..at + 4)?.try_into().ok()?))
    };
    let name_end = (FIXED_BYTES + 4).checked_add(u32_at(FIXED_BYTES)? as usize)?;
    let compressed_size = u64_at(name_end)?;
    let packed = body.get(name_end + 8..)?;
    let length = usize::try_from(compressed_size).ok()?.min(packed.len());
    let header = ChunkHeader {
        message_start_time: u64_at(0)?,
        message_end_time: u64_at(8)?,
        uncompressed_size: u64_at(16)?,
        uncompressed_crc: u32_at(24)?,
        compression: String::from_utf8(body.get(FIXED_BYTES + 4..name_end)?.to_vec()).ok()?,
        compressed_size,
    };
    Some((header, &packed[..length]))
}

/// Decompress the available bytes into `unpacked`; return whether their size is that of the header.
fn unpack(header: &ChunkHeader, packed: &[u8], unpacked: &mut Vec<u8>) -> bool {
    let limit = header.uncompressed_size.min(MAX_RECORD_BYTES);
    // A decoder that reaches the end of a truncated chunk fails after it has returned its content.
    let decoded = match header.compression.as_str() {
        "" => packed.take(limit).read_to_end(unpacked),
        "zstd" => zstd::Decoder::new(packed).and_then(|d| drain(d.take(limit), unpacked)),
        "lz4" => lz4::Decoder::new(packed).and_then(|d| drain(d.take(limit), unpacked)),
        _ => return false,
    };
    decoded.is_ok() && unpacked.len() as u64 == header.uncompressed_size
}

fn drain(mut decoder: impl Read, unpacked: &mut Vec<u8>) -> io::Result<usize> {
    let mut buffer = [0; 1 << 14];
    loop {
        match decoder.read(&mut buffer)? {
            0 => return Ok(unpacked.len()),
            count => unpacked.extend_from_slice(&buffer[..count]),
        }
    }
}

fn checksum_holds(header: &ChunkHeader, unpacked: &[u8]) -> bool {
    header.uncompressed_crc == 0 || header.uncompressed_crc == crc32fast::hash(unpacked)
}
