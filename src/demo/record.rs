//! What a finished step leaves: its result document, and what it was made of.

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
    /// Hash of everything that the step depends on.
    pub key: String,
    /// What was run.
    pub command_line: String,
    /// Exit status: 0, or 3 where something was lost or a gate was not met.
    pub status: i32,
    /// How long it took (s).
    pub elapsed_s: f64,
    /// The document that the command printed.
    pub result: Value,
}

/// Where the records of a demo in `folder` are.
fn record_file(folder: &Path, name: &str) -> PathBuf {
    folder.join("steps").join(format!("{name}.json"))
}

/// Where it is noted that a step was begun.
fn begun_file(folder: &Path, name: &str) -> PathBuf {
    folder.join("steps").join(format!("{name}.begun"))
}

impl Record {
    /// The record of `step` in `folder`, when it was made of the same things and its results are there.
    #[must_use]
    pub fn read(folder: &Path, step: &Step, key: &str) -> Option<Self> {
        let text = fs::read_to_string(record_file(folder, &step.name)).ok()?;
        let record: Self = serde_json::from_str(&text).ok()?;
        let output = step.output().is_none_or(|output| folder.join(output).exists());
        (record.key == key && output).then_some(record)
    }

    /// Writes it.
    ///
    /// # Errors
    /// When the disk refuses.
    pub fn write(&self, folder: &Path, name: &str) -> Result<(), RecordingError> {
        let text = serde_json::to_string_pretty(self)
            .unwrap_or_else(|_plain| unreachable!("strings, numbers and what was JSON before"));
        write_bytes(&record_file(folder, name), ExistingFile::Replace, text.as_bytes())?;
        fs::remove_file(begun_file(folder, name)).ok();
        Ok(())
    }
}

/// Notes that a step is begun; gives whether the very same step was begun before and not finished.
///
/// # Errors
/// When the disk refuses.
pub fn begin(folder: &Path, name: &str, key: &str) -> Result<bool, RecordingError> {
    let file = begun_file(folder, name);
    let again = fs::read_to_string(&file).is_ok_and(|before| before == key);
    write_bytes(&file, ExistingFile::Replace, key.as_bytes())?;
    Ok(again)
}

impl Step {
    /// The file or folder that it makes.
    #[must_use]
    pub fn output(&self) -> Option<&str> {
        let mut words = self.arguments.iter();
        words.find(|word| *word == "-o" || *word == "--output")?;
        words.next().map(String::as_str)
    }
}

impl Plan {
    /// For every step of every stage a hash of its command, of everything before its stage, and of the
    /// program: equal keys are equal results.
    #[must_use]
    pub fn keys(&self) -> Vec<Vec<String>> {
        let mut before = Sha256::new();
        before.update(GIT_HASH);
        for (name, text) in &self.files {
            before.update(name.to_string_lossy().as_bytes());
            before.update(text);
        }
        let mut keys = Vec::new();
        for stage in &self.stages {
            let key = |step: &Step| {
                let mut hash = before.clone();
                hash.update(step.line());
                hexadecimal(&hash.finalize())
            };
            let of_stage: Vec<String> = stage.steps.iter().map(key).collect();
            of_stage.iter().for_each(|key| before.update(key));
            keys.push(of_stage);
        }
        keys
    }
}
