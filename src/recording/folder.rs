//! Recordings of a folder.

use std::{
    fs, io,
    path::{Path, PathBuf},
};

/// Return every MCAP file in `folder`, by name.
///
/// # Errors
/// When the folder cannot be read.
pub fn files_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let file = entry?.path();
        if file.extension().is_some_and(|extension| extension == "mcap") {
            files.push(file);
        }
    }
    files.sort();
    Ok(files)
}
