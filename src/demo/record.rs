//! Record of a finished step: result document and provenance.

use super::plan::{Plan, Step};
use crate::{
    provenance::GIT_HASH,
    recording::{ExistingFile, RecordingError, hexadecimal, write_bytes},
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// A finished step: `steps/NAME.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Hash of all inputs of the step.
    pub key: String,
    /// Command line.
    pub command_line: String,
    /// Exit status: 0, or 3 if data was lost or a gate was missed.
    pub status: i32,
    /// Duration (s).
    pub elapsed_s: f64,
    /// Document that the command printed.
    pub result: Value,
}

/// Path of a record of the demo in `folder`.
fn record_file(folder: &Path, name: &str) -> PathBuf {
    folder.join("steps").join(format!("{name}.json"))
}

/// Path of the file that marks a started step.
fn begun_file(folder: &Path, name: &str) -> PathBuf {
    folder.join("steps").join(format!("{name}.begun"))
}

impl Record {
    /// Read the record of `step` in `folder`, if it has the same key and its results exist.
    #[must_use]
    pub fn read(folder: &Path, step: &Step, key: &str) -> Option<Self> {
        let text = fs::read_to_string(record_file(folder, &step.name)).ok()?;
        let record: Self = serde_json::from_str(&text).ok()?;
        let output = step.output().is_none_or(|output| folder.join(output).exists());
        (record.key == key && output).then_some(record)
    }

    /// Write the record.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn write(&self, folder: &Path, name: &str) -> Result<(), RecordingError> {
        let text = serde_json::to_string_pretty(self)
            .unwrap_or_else(|_plain| unreachable!("strings, numbers and what was JSON before"));
        write_bytes(&record_file(folder, name), ExistingFile::Replace, text.as_bytes())?;
        fs::remove_file(begun_file(folder, name)).ok();
        Ok(())
    }
}

/// Mark a step as started; returns whether the same step was started before and not finished.
///
/// # Errors
/// When the file cannot be written.
pub fn begin(folder: &Path, name: &str, key: &str) -> Result<bool, RecordingError> {
    let file = begun_file(folder, name);
    let again = fs::read_to_string(&file).is_ok_and(|before| before == key);
    write_bytes(&file, ExistingFile::Replace, key.as_bytes())?;
    Ok(again)
}

impl Plan {
    /// Hashes of all steps, in their order: of the command, of the keys of the steps whose results it reads, of the
    /// plan's files and of the program. Equal keys give equal results.
    #[must_use]
    pub fn keys(&self) -> Vec<String> {
        let mut common = Sha256::new();
        common.update(GIT_HASH);
        for (name, text) in &self.files {
            common.update(name.to_string_lossy().as_bytes());
            common.update(text);
        }
        let mut keys: Vec<String> = Vec::new();
        for (step, needs) in self.steps().zip(self.needs()) {
            let mut hash = common.clone();
            hash.update(step.line());
            needs.iter().for_each(|needed| hash.update(&keys[*needed]));
            keys.push(hexadecimal(&hash.finalize()));
        }
        keys
    }
}
