//! Sources of frames behind one trait: cameras, folders of images, recordings, the virtual rig.
//!
//! | text | source |
//! |---|---|
//! | `v4l2:/dev/video0` | camera of the Linux kernel; see the `v4l2` module for its options |
//! | `images:FOLDER` | PNG and JPEG files of a folder, in order of their names |
//! | `video:FILE` | AVI file with MJPEG or PNG video |
//! | `mcap:FILE` | `foxglove.CompressedImage`, `sensor_msgs/Image` and `sensor_msgs/CompressedImage` of a recording |
//! | `virtual` | frames that the virtual rig draws |
//!
//! Decoders: `zune-jpeg` (SIMD, decodes straight to Y, Cb, Cr) and `png`, the decoders inside of `image`. The
//! `image` crate itself adds a second copy of each pixel format and 20 packages; `kornia` adds Arrow, ONNX and
//! GStreamer bindings. Both are larger than everything else here.

mod avi;
mod decode;
mod images;
mod mcap;
#[cfg(target_os = "linux")]
mod v4l2;

pub(super) use self::mcap::CompressedImage;
pub use self::mcap::McapImages;
#[cfg(target_os = "linux")]
pub use self::v4l2::{V4l2Config, V4l2Source};
pub use avi::AviVideo;
pub use decode::{DecodeError, decode_image, encode_jpeg};
pub use images::ImageFolder;

use super::frame::{CutOff, Frame};
use std::{fmt, path::PathBuf, str::FromStr};

/// Result of asking a source for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// The frame was filled.
    Frame,
    /// No frame came within the source's patience; ask again.
    Nothing,
    /// No frame will follow.
    End,
}

/// Error of a source. Each message is one sentence with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum SourceError {
    /// A source that cannot be opened or read.
    #[error("{source_name}: {what}; {remedy}")]
    Unusable {
        /// Name of the source.
        source_name: String,
        /// What happened.
        what: String,
        /// Way out.
        remedy: String,
    },
    /// An image that cannot be decoded; the next one may be readable.
    #[error("{image}: {reason}; the image is left out")]
    Image {
        /// File or message.
        image: String,
        /// Error of the decoder.
        reason: DecodeError,
    },
    /// A frame with too few bytes; the next one may be complete.
    #[error(transparent)]
    CutOff(#[from] CutOff),
}

impl SourceError {
    /// Return whether the next frame may be readable.
    #[must_use]
    pub fn is_single_frame(&self) -> bool {
        matches!(self, Self::Image { .. } | Self::CutOff(_))
    }
}

/// Source of frames.
pub trait FrameSource: Send {
    /// Wait for the next frame and fill `frame`, whose memory is reused. A camera waits at most 0.1 s.
    ///
    /// # Errors
    /// When a frame is damaged ([`SourceError::is_single_frame`]), or the source cannot be used any more.
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError>;

    /// Return the name of the source, as its address is written.
    fn name(&self) -> String;

    /// Return the exposure time (s), if the source knows it.
    fn exposure_s(&self) -> Option<f64> {
        None
    }

    /// Return whether frames come with the time, so that a slow reader loses some.
    fn is_live(&self) -> bool {
        false
    }
}

/// Address of a source of frames.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SourceSpec {
    /// Camera device of the Linux kernel, with its options behind a question mark.
    V4l2(String),
    /// Folder of images.
    Images(PathBuf),
    /// AVI file.
    Video(PathBuf),
    /// Recording.
    Mcap(PathBuf),
    /// Frames of the virtual rig.
    Virtual,
}

/// Error: a text that names no source of frames.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "'{found}' names no source of frames; write v4l2:/dev/video0, images:FOLDER, video:FILE, mcap:FILE or virtual"
)]
pub struct SourceSpecError {
    /// Text given.
    pub found: String,
}

impl FromStr for SourceSpec {
    type Err = SourceSpecError;

    fn from_str(text: &str) -> Result<Self, SourceSpecError> {
        match text.split_once(':') {
            None if text == "virtual" => Ok(Self::Virtual),
            Some(("v4l2", rest)) if !rest.is_empty() => Ok(Self::V4l2(rest.to_owned())),
            Some(("images", rest)) if !rest.is_empty() => Ok(Self::Images(rest.into())),
            Some(("video", rest)) if !rest.is_empty() => Ok(Self::Video(rest.into())),
            Some(("mcap", rest)) if !rest.is_empty() => Ok(Self::Mcap(rest.into())),
            _ => Err(SourceSpecError { found: text.to_owned() }),
        }
    }
}

impl fmt::Display for SourceSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::V4l2(rest) => write!(f, "v4l2:{rest}"),
            Self::Images(path) => write!(f, "images:{}", path.display()),
            Self::Video(path) => write!(f, "video:{}", path.display()),
            Self::Mcap(path) => write!(f, "mcap:{}", path.display()),
            Self::Virtual => f.write_str("virtual"),
        }
    }
}

impl SourceSpec {
    /// Open the source.
    ///
    /// # Errors
    /// When it does not exist or cannot be used. The virtual rig draws its frames only with its own bus.
    pub fn open(&self) -> Result<Box<dyn FrameSource>, SourceError> {
        match self {
            Self::Images(folder) => Ok(Box::new(ImageFolder::open(folder)?)),
            Self::Video(path) => Ok(Box::new(AviVideo::open(path)?)),
            Self::Mcap(path) => Ok(Box::new(McapImages::open(path)?)),
            Self::V4l2(device) => open_v4l2(device),
            Self::Virtual => Err(SourceError::Unusable {
                source_name: self.to_string(),
                what: "the virtual rig draws its frames while it runs".to_owned(),
                remedy: "use --camera virtual with --bus virtual in `collect` or `play`".to_owned(),
            }),
        }
    }
}

#[cfg(target_os = "linux")]
fn open_v4l2(device: &str) -> Result<Box<dyn FrameSource>, SourceError> {
    Ok(Box::new(V4l2Source::open(&V4l2Config::parse(device)?)?))
}

#[cfg(not(target_os = "linux"))]
fn open_v4l2(device: &str) -> Result<Box<dyn FrameSource>, SourceError> {
    Err(SourceError::Unusable {
        source_name: format!("v4l2:{device}"),
        what: "only Linux has such cameras".to_owned(),
        remedy: "let another program detect and send to --camera udp:HOST:PORT".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written_back_and_others_are_refused() {
        for text in [
            "v4l2:/dev/video0?fps=120",
            "images:frames/a b",
            "video:x.avi",
            "mcap:x.mcap",
            "virtual",
        ] {
            assert_eq!(text.parse::<SourceSpec>().unwrap().to_string(), text);
        }
        for text in ["", "virtual:", "images:", "udp:localhost:1", "/dev/video0"] {
            assert!(text.parse::<SourceSpec>().is_err(), "{text}");
        }
    }
}
