//! Files that are whole or not there: written beside their name, renamed when complete.

use super::error::RecordingError;
use std::{
    fs::{self, File},
    io::Write as _,
    path::{Path, PathBuf},
};

/// What happens when the output's name is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExistingFile {
    /// Refuse, so that nothing recorded is lost.
    Refuse,
    /// Replace it once the new file is complete.
    Replace,
}

/// `.NAME.partial` in the same folder as `path`.
#[must_use]
pub fn partial_name(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.partial"))
}

/// Lets `write` fill a file that gets the name `path` when it succeeds; nothing is left behind
/// when it does not.
///
/// # Errors
/// When the name is taken and `existing` refuses, the disk does, or `write` fails.
pub fn write_beside(
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

/// As [`write_beside`], for bytes that are at hand.
///
/// # Errors
/// As [`write_beside`].
pub fn write_bytes(
    path: &Path,
    existing: ExistingFile,
    bytes: &[u8],
) -> Result<(), RecordingError> {
    write_beside(path, existing, |mut file| {
        file.write_all(bytes).map_err(RecordingError::io(path, "write"))
    })?;
    log::info!("wrote {}: {} bytes", path.display(), bytes.len());
    Ok(())
}
