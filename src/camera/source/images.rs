//! Images of a folder as a source: PNG and JPEG files, in order of their names.
//!
//! A file name that is a number of 19 digits (nanoseconds since the Unix epoch) is the capture time; otherwise frames
//! are 1/120 s apart, from 0.

use super::{
    FrameSource, Next, SourceError,
    decode::{Scratch, decode_with},
};
use crate::{camera::frame::Frame, units::Nanos};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Period of frames without a time (s): the camera of the KlaskTron table.
const PERIOD_S: f64 = 1.0 / 120.0;
/// Digits of a time in nanoseconds since the Unix epoch.
const TIME_DIGITS: usize = 19;

/// Images of a folder.
#[derive(Debug)]
pub struct ImageFolder {
    folder: PathBuf,
    files: Vec<PathBuf>,
    next: usize,
    scratch: Scratch,
}

impl ImageFolder {
    /// List the images of a folder.
    ///
    /// # Errors
    /// When the folder cannot be read or holds no PNG or JPEG file.
    pub fn open(folder: &Path) -> Result<Self, SourceError> {
        let unusable = |what: String, remedy: &str| SourceError::Unusable {
            source_name: format!("images:{}", folder.display()),
            what,
            remedy: remedy.to_owned(),
        };
        let entries = fs::read_dir(folder).map_err(|error| {
            unusable(format!("cannot read the folder ({error})"), "check its name")
        })?;
        let is_image = |path: &PathBuf| {
            let extension = path.extension().map(|own| own.to_string_lossy().to_lowercase());
            extension.is_some_and(|own| ["png", "jpg", "jpeg"].contains(&own.as_str()))
        };
        let mut files: Vec<PathBuf> =
            entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_image).collect();
        files.sort();
        if files.is_empty() {
            return Err(unusable(
                "the folder has no image".to_owned(),
                "put PNG or JPEG files into it, or give another folder",
            ));
        }
        Ok(Self { folder: folder.to_owned(), files, next: 0, scratch: Scratch::default() })
    }

    /// Return the path of the frame with this index.
    #[must_use]
    pub fn path(&self, index: usize) -> Option<&Path> {
        self.files.get(index).map(PathBuf::as_path)
    }
}

impl FrameSource for ImageFolder {
    fn next_frame(&mut self, frame: &mut Frame) -> Result<Next, SourceError> {
        let Some(path) = self.files.get(self.next) else { return Ok(Next::End) };
        let index = self.next;
        self.next += 1;
        let bytes = fs::read(path).map_err(|error| SourceError::Unusable {
            source_name: path.display().to_string(),
            what: format!("cannot read ({error})"),
            remedy: "check the file".to_owned(),
        })?;
        decode_with(&bytes, frame, &mut self.scratch)
            .map_err(|reason| SourceError::Image { image: path.display().to_string(), reason })?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let stamp =
            Some(stem).filter(|stem| stem.len() == TIME_DIGITS).and_then(|stem| stem.parse().ok());
        frame.capture_time =
            stamp.map_or_else(|| Nanos(0).after_seconds(index as f64 * PERIOD_S), Nanos);
        frame.received_time = frame.capture_time;
        Ok(Next::Frame)
    }

    fn name(&self) -> String {
        format!("images:{}", self.folder.display())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::source::encode_jpeg;

    #[test]
    fn images_come_in_order_and_a_damaged_one_is_named() {
        let dir = tempfile::tempdir().unwrap();
        let mut frame = Frame::default();
        frame.set_grey([16, 16], &[77; 256]).unwrap();
        let mut bytes = Vec::new();
        encode_jpeg(&frame, 90, &mut bytes).unwrap();
        fs::write(dir.path().join("1700000000000000000.jpg"), &bytes).unwrap();
        fs::write(dir.path().join("2.jpeg"), &bytes[..40]).unwrap();
        fs::write(dir.path().join("notes.txt"), "no image").unwrap();
        let mut source = ImageFolder::open(dir.path()).unwrap();
        assert_eq!(source.next_frame(&mut frame).unwrap(), Next::Frame);
        assert_eq!(frame.capture_time, Nanos(1_700_000_000_000_000_000));
        assert_eq!(frame.view().yuv(3, 3)[0], 77);
        let error = source.next_frame(&mut frame).unwrap_err();
        assert!(error.is_single_frame() && error.to_string().contains("2.jpeg: "), "{error}");
        assert_eq!(source.next_frame(&mut frame).unwrap(), Next::End);
    }

    #[test]
    fn a_folder_without_images_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let error = ImageFolder::open(dir.path()).unwrap_err().to_string();
        assert!(error.ends_with(
            "the folder has no image; put PNG or JPEG files into it, or give another folder"
        ));
    }
}
