//! Atomic writing of files: to a temporary name in the same folder, renamed when complete.

use super::error::RecordingError;
use std::{
    fs::{self, File},
    io::Write as _,
    path::{Path, PathBuf},
};

/// Policy for an output that exists already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExistingFile {
    /// Refuse, so that no recorded data is lost.
    Refuse,
    /// Replace the file once the new one is complete.
    Replace,
}

/// Return `.NAME.partial` in the same folder as `path`.
#[must_use]
pub fn partial_name(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.partial"))
}

/// Let `write` fill a file that gets the name `path` when it succeeds; nothing remains after a
/// failure.
///
/// # Errors
/// When the file exists and `existing` refuses, writing to disk fails, or `write` fails.
pub fn write_atomically(
    path: &Path,
    existing: ExistingFile,
    write: impl FnOnce(File) -> Result<(), RecordingError>,
) -> Result<(), RecordingError> {
    if existing == ExistingFile::Refuse && path.exists() {
        return Err(RecordingError::Exists { path: path.to_owned() });
    }
    let partial = partial_name(path);
    let file = File::create(&partial).map_err(RecordingError::io(path, "create"))?;
    let named = write(file)
        .and_then(|()| fs::rename(&partial, path).map_err(RecordingError::io(path, "rename")));
    if named.is_err() {
        fs::remove_file(&partial).ok(); // half of what its maker can make again
    }
    named
}

/// Write bytes in memory, as [`write_atomically`] does.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_bytes(
    path: &Path,
    existing: ExistingFile,
    bytes: &[u8],
) -> Result<(), RecordingError> {
    write_atomically(path, existing, |mut file| {
        file.write_all(bytes).map_err(RecordingError::io(path, "write"))
    })?;
    log::info!("wrote {}: {} bytes", path.display(), bytes.len());
    Ok(())
}
