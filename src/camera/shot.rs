//! Frames kept for a page.

use super::{
    frame::{Frame, yuv_of_rgb},
    source::encode_jpeg,
};
use crate::report::Picture;

/// Quality of the JPEG: a frame of 1280 x 720 pixels has about 100 kB.
const QUALITY: u8 = 72;

/// JPEG of a frame.
#[derive(Debug, Clone)]
pub struct Shot {
    jpeg: Vec<u8>,
    size_px: [usize; 2],
}

impl Shot {
    /// Keep a frame; `None` for a frame that is no image.
    #[must_use]
    pub fn of(frame: &Frame) -> Option<Self> {
        let mut jpeg = Vec::new();
        encode_jpeg(frame, QUALITY, &mut jpeg).ok()?;
        Some(Self { jpeg, size_px: [frame.width_px(), frame.height_px()] })
    }

    /// Keep a frame after its colours were changed: `change` gets column, row and red, green, blue.
    #[must_use]
    pub fn changed(
        frame: &Frame,
        change: impl Fn(usize, usize, [u8; 3]) -> [u8; 3],
    ) -> Option<Self> {
        let (rgb, width) = (frame.to_rgb(), frame.width_px());
        let pixels = rgb.chunks_exact(3).enumerate();
        let pixels =
            pixels.flat_map(|(at, own)| change(at % width, at / width, [own[0], own[1], own[2]]));
        let pixels: Vec<u8> = pixels.collect();
        let mut changed = Frame::default();
        changed.set_triples([width, frame.height_px()], &pixels, yuv_of_rgb).ok()?;
        Self::of(&changed)
    }

    /// Return the image as a picture of a page.
    #[must_use]
    pub fn picture(&self, caption: &str) -> Picture {
        Picture::new(caption, self.jpeg.clone(), self.size_px)
    }
}
