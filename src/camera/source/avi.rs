//! AVI files with MJPEG or PNG video as a source.
//!
//! The reader walks through the chunks in the order of the file: `hdrl` gives the frame rate and the codec, each chunk
//! `##dc` or `##db` of the video stream in a `movi` list is one frame. Further segments of large files (OpenDML,
//! `AVIX`) follow in the same way; indexes, sound and unknown chunks are passed over. Source: Microsoft, "AVI RIFF File
//! Reference", and Matrox, "OpenDML AVI File Format Extensions", version 1.02.
//!
//! Frame k has the capture time k times the period, from 0. An empty chunk stands for a frame that was dropped.

use super::{
    FrameSource, Next, SourceError,
    decode::{Scratch, decode_with},
};
use crate::{camera::frame::Frame, units::Nanos};
use std::{
    fs::File,
    io::{self, BufReader, Read as _},
    path::{Path, PathBuf},
};

/// Largest frame (bytes); an uncompressed frame of 4096 x 4096 pixels has 50 MB.
const LARGEST_FRAME: u32 = 64 << 20;
/// Longest list of headers (bytes).
const LONGEST_HEADER: u32 = 1 << 20;
/// Codecs, as AVI files name them.
const CODECS: [&str; 4] = ["MJPG", "mjpg", "MPNG", "png "];

/// Video of an AVI file.
#[derive(Debug)]
pub struct AviVideo {
    path: PathBuf,
    file: BufReader<File>,
    /// Number of the video stream.
    stream: usize,
    period_s: f64,
    /// Frames so far, the dropped ones included.
    count: u64,
    data: Vec<u8>,
    scratch: Scratch,
}

/// Name and size (bytes) of a chunk.
type Chunk = ([u8; 4], u32);

impl AviVideo {
    /// Open a file and read its header.
    ///
    /// # Errors
    /// When the file cannot be read, is no AVI file, or its video has another codec.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        let broken = |what: String, remedy: &str| SourceError::Unusable {
            source_name: format!("video:{}", path.display()),
            what,
            remedy: remedy.to_owned(),
        };
        let no_avi = |what: &str| {
            let name = path.display();
            broken(
                what.to_owned(),
                &format!("convert it with `ffmpeg -i {name} -c:v mjpeg -q:v 2 -an video.avi`"),
            )
        };
        let file = File::open(path)
            .map_err(|error| broken(format!("cannot open ({error})"), "check its name"))?;
        let mut file = BufReader::new(file);
        let mut form = [0; 12];
        if file.read_exact(&mut form).is_err() || &form[..4] != b"RIFF" || &form[8..] != b"AVI " {
            return Err(no_avi("this is no AVI file"));
        }
        let header = read_header(&mut file).map_err(|error| {
            broken(format!("cannot read the header ({error})"), "write the file anew")
        })?;
        let Some(Stream { stream, codec, scale, rate }) = header else {
            return Err(no_avi("the file has no video"));
        };
        if !CODECS.contains(&codec.as_str()) {
            return Err(no_avi(&format!("the codec is '{codec}', readable are MJPEG and PNG")));
        }
        let period_s = f64::from(scale) / f64::from(rate);
        if !(1e-4..=60.0).contains(&period_s) {
            return Err(no_avi(&format!(
                "the time between frames is {scale}/{rate} s, allowed is 0.1 ms to 60 s"
            )));
        }
        Ok(Self {
            path: path.to_owned(),
            file,
            stream,
            period_s,
            count: 0,
            data: Vec::new(),
            scratch: Scratch::default(),
        })
    }

    /// Read chunks up to the next one of the video, whose bytes go to `self.data`. Return its size as the file says it;
    /// `None` at the end.
    fn next_chunk(&mut self) -> io::Result<Option<u32>> {
        loop {
            let Some((name, size)) = read_chunk(&mut self.file)? else { return Ok(None) };
            if name == *b"RIFF" || name == *b"LIST" {
                // Go into the lists; the header was read already.
                let mut kind = [0; 4];
                self.file.read_exact(&mut kind)?;
                if ![*b"movi", *b"rec ", *b"AVIX"].contains(&kind) {
                    skip(&mut self.file, size.saturating_sub(4))?;
                }
                continue;
            }
            if !self.is_video(name) {
                skip(&mut self.file, size)?;
                continue;
            }
            if LARGEST_FRAME < size {
                return Err(io::Error::other(format!(
                    "frame {} has {size} bytes, allowed are {LARGEST_FRAME}",
                    self.count
                )));
            }
            self.data.clear();
            // A frame that is cut off goes to the decoder, which names it.
            self.file.by_ref().take(size.into()).read_to_end(&mut self.data)?;
            self.file.seek_relative(i64::from(size % 2))?;
            self.count += 1;
            return Ok(Some(size));
        }
    }

    /// Return whether a chunk `##dc` or `##db` belongs to the video stream.
    fn is_video(&self, [tens, ones, kind @ ..]: [u8; 4]) -> bool {
        let digit = |byte: u8| char::from(byte).to_digit(10).map(|own| own as usize);
        let stream = digit(tens).zip(digit(ones)).map(|(tens, ones)| 10 * tens + ones);
        stream == Some(self.stream) && [*b"dc", *b"db"].contains(&kind)
    }
}

/// Video stream of a header.
#[derive(Debug, PartialEq, Eq)]
struct Stream {
    /// Its number.
    stream: usize,
    codec: String,
    /// Time between frames: `scale / rate` (s).
    scale: u32,
    rate: u32,
}

/// Name and size of the next chunk; `None` at the end of the file.
fn read_chunk(file: &mut impl io::Read) -> io::Result<Option<Chunk>> {
    let mut bytes = [0; 8];
    match file.read_exact(&mut bytes) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        Err(error) => return Err(error),
    }
    let [a, b, c, d, size @ ..] = bytes;
    Ok(Some(([a, b, c, d], u32::from_le_bytes(size))))
}

/// Pass over a chunk; chunks begin at even bytes.
fn skip(file: &mut BufReader<File>, size: u32) -> io::Result<()> {
    file.seek_relative(i64::from(size) + i64::from(size % 2))
}

/// Read the list `hdrl`, which comes first, and return its first video stream.
fn read_header(file: &mut BufReader<File>) -> io::Result<Option<Stream>> {
    loop {
        let Some((name, size)) = read_chunk(file)? else { return Ok(None) };
        if name != *b"LIST" {
            skip(file, size)?;
            continue;
        }
        let mut kind = [0; 4];
        file.read_exact(&mut kind)?;
        if kind == *b"movi" {
            // Frames without a header.
            return Ok(None);
        }
        if kind == *b"hdrl" {
            if LONGEST_HEADER < size {
                return Err(io::Error::other(format!(
                    "it has {size} bytes, allowed are {LONGEST_HEADER}"
                )));
            }
            let mut bytes = vec![0; size.saturating_sub(4) as usize];
            file.read_exact(&mut bytes)?;
            file.seek_relative(i64::from(size % 2))?;
            return Ok(video_stream(&bytes));
        }
        skip(file, size.saturating_sub(4))?;
    }
}

/// First video stream in the bytes of the list `hdrl`.
fn video_stream(mut bytes: &[u8]) -> Option<Stream> {
    let word =
        |bytes: &[u8], at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let mut streams = 0;
    while let Some((name, size)) = read_chunk(&mut bytes).ok().flatten() {
        let end = (size as usize).min(bytes.len());
        let (own, rest) = bytes.split_at(end);
        bytes = rest.get(size as usize % 2..).unwrap_or_default();
        if name != *b"LIST" || !own.starts_with(b"strl") {
            continue;
        }
        let mut chunks = &own[4..];
        let Some((name, size)) = read_chunk(&mut chunks).ok().flatten() else { continue };
        let header = &chunks[..(size as usize).min(chunks.len())];
        if name == *b"strh" && header.starts_with(b"vids") {
            let [scale, rate] = [word(header, 20)?, word(header, 24)?];
            // The codec stands in the format that follows; the handler of the header may be empty.
            let mut format = chunks.get(size as usize + size as usize % 2..)?;
            read_chunk(&mut format).ok().flatten()?;
            let codec = String::from_utf8_lossy(format.get(16..20)?).into_owned();
            return Some(Stream { stream: streams, codec, scale, rate });
        }
        streams += 1;
    }
    None
}

impl FrameSource for AviVideo {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError> {
        loop {
            let found = self.next_chunk().map_err(|error| SourceError::Unusable {
                source_name: self.name(),
                what: format!("cannot read ({error})"),
                remedy: "write the file anew".to_owned(),
            })?;
            match found {
                None => return Ok(Next::End),
                // A dropped frame.
                Some(0) => {}
                Some(_) => break,
            }
        }
        let number = self.count - 1;
        decode_with(&self.data, frame, &mut self.scratch).map_err(|reason| SourceError::Image {
            image: format!("{}, frame {number}", self.name()),
            reason,
        })?;
        frame.capture_time = Nanos(0).after_seconds(number as f64 * self.period_s);
        frame.received_time = frame.capture_time;
        Ok(Next::Frame)
    }

    fn name(&self) -> String {
        format!("video:{}", self.path.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::source::encode_jpeg;
    use std::fs;

    fn chunk(name: &[u8; 4], body: &[u8]) -> Vec<u8> {
        let size = (body.len() as u32).to_le_bytes();
        [&name[..], &size, body, &[0][..body.len() % 2]].concat()
    }

    fn list(kind: &[u8; 4], chunks: &[Vec<u8>]) -> Vec<u8> {
        chunk(b"LIST", &[&kind[..], &chunks.concat()].concat())
    }

    /// File with a sound stream before the video, and frames in two segments.
    fn file(codec: &[u8; 4], frames: &[Vec<u8>]) -> Vec<u8> {
        let header = |kind: &[u8; 4]| {
            let words = [0, 0, 0, 1, 120_u32].map(u32::to_le_bytes).concat();
            chunk(b"strh", &[&kind[..], &codec[..], &words, &[0; 28]].concat())
        };
        let format = chunk(b"strf", &[&[0; 16][..], &codec[..], &[0; 20]].concat());
        let streams = [
            list(b"strl", &[header(b"auds"), chunk(b"strf", &[0; 18])]),
            list(b"strl", &[header(b"vids"), format]),
        ];
        let hdrl = list(b"hdrl", &[&[chunk(b"avih", &[0; 56])], &streams[..]].concat());
        let movi = |frames: &[Vec<u8>]| {
            let sound = chunk(b"00wb", &[1, 2, 3]);
            let chunks = frames.iter().flat_map(|own| [sound.clone(), chunk(b"01dc", own)]);
            list(b"movi", &chunks.collect::<Vec<_>>())
        };
        let (first, second) = frames.split_at(frames.len() / 2);
        let index = chunk(b"idx1", &[0; 7]);
        let body = [hdrl, chunk(b"JUNK", &[0; 5]), movi(first), index].concat();
        let segment = [&b"AVIX"[..], &movi(second)].concat();
        [chunk(b"RIFF", &[&b"AVI "[..], &body].concat()), chunk(b"RIFF", &segment)].concat()
    }

    fn jpeg(level: u8) -> Vec<u8> {
        let mut frame = Frame::default();
        frame.set_grey([16, 16], &[level; 256]).unwrap();
        let mut bytes = Vec::new();
        encode_jpeg(&frame, 90, &mut bytes).unwrap();
        bytes
    }

    fn open(bytes: &[u8]) -> Result<AviVideo, String> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("video.avi");
        fs::write(&path, bytes).unwrap();
        AviVideo::open(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn frames_of_both_segments_are_read_with_their_times() {
        let frames = [jpeg(40), jpeg(80), Vec::new(), jpeg(120)];
        let mut video = open(&file(b"MJPG", &frames)).unwrap();
        let mut frame = Frame::default();
        // The third chunk is empty: a dropped frame, whose time passes.
        for (level, time_ns) in [(40, 0), (80, 8_333_333), (120, 25_000_000)] {
            assert_eq!(video.next_frame(&mut frame).unwrap(), Next::Frame);
            assert_eq!(frame.view().yuv(5, 5)[0], level);
            assert!(frame.capture_time.0.abs_diff(time_ns) < 2, "{:?}", frame.capture_time);
        }
        assert_eq!(video.next_frame(&mut frame).unwrap(), Next::End);
    }

    #[test]
    fn a_file_that_is_cut_off_gives_its_complete_frames_and_names_the_last_one() {
        let whole = file(b"MJPG", &[jpeg(40), jpeg(80)]);
        let mut video = open(&whole[..whole.len() - 60]).unwrap();
        let mut frame = Frame::default();
        assert_eq!(video.next_frame(&mut frame).unwrap(), Next::Frame);
        let error = video.next_frame(&mut frame).unwrap_err();
        assert!(error.is_single_frame() && error.to_string().contains("frame 1: "), "{error}");
        assert_eq!(video.next_frame(&mut frame).unwrap(), Next::End);
        // Nothing panics and nothing is read for ever, wherever the file ends.
        for end in 0..whole.len() {
            let Ok(mut video) = open(&whole[..end]) else { continue };
            let read = (0..10).map(|_| video.next_frame(&mut frame));
            assert!(read.into_iter().any(|own| matches!(own, Ok(Next::End)) || own.is_err()));
        }
    }

    #[test]
    fn other_files_and_codecs_are_refused_with_the_command_that_converts_them() {
        let error = open(b"\0\0\0\x18ftypmp42").unwrap_err();
        assert!(error.contains("this is no AVI file; convert it with `ffmpeg -i "), "{error}");
        assert!(error.ends_with("-c:v mjpeg -q:v 2 -an video.avi`"), "{error}");
        let error = open(&file(b"H264", &[])).unwrap_err();
        assert!(error.contains("the codec is 'H264', readable are MJPEG and PNG;"), "{error}");
    }

    #[test]
    fn frames_without_huffman_tables_are_read() {
        // Cameras and some programs leave the standard tables (segment ffc4) out.
        let mut bytes = jpeg(93);
        while let Some(at) = bytes.windows(2).position(|own| own == [0xff, 0xc4]) {
            let length = usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
            bytes.drain(at..at + 2 + length);
        }
        let mut video = open(&file(b"MJPG", &[bytes])).unwrap();
        let mut frame = Frame::default();
        assert_eq!(video.next_frame(&mut frame).unwrap(), Next::Frame);
        assert_eq!(frame.view().yuv(5, 5)[0], 93);
    }
}
