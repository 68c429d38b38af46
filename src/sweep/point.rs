//! A point: one command line, identified by the hash of its settings and inputs.

use super::{SweepError, SweptCommand};
use crate::{
    provenance::CRATE_VERSION,
    recording::{files_in, hexadecimal, sha256_of_file},
};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// Number of hash digits kept: 96 bits, so that collisions among a million points are negligible.
const HASH_DIGITS: usize = 24;

/// One run of a command.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Point {
    /// Hash of its settings, the content of its inputs and the version of this crate.
    pub hash: String,
    /// Folder of its results, relative to that of the sweep.
    pub folder: PathBuf,
    /// Words typed after `klasktron`, without output folder and number of threads.
    pub words: Vec<String>,
    /// The same as a command line for people and shells, independent of the sweep's folder.
    pub command_line: String,
    /// Options that differ between points, with their values.
    pub settings: BTreeMap<String, String>,
    /// Seed of the point.
    pub seed: Option<u64>,
}

impl Point {
    /// Point of `words` in `points/HASH`; `inputs` are the hashes of its inputs.
    #[must_use]
    pub fn new(words: Vec<String>, inputs: &[String]) -> Self {
        let hash = hash_of(&words, inputs);
        let folder = Path::new(super::store::POINTS).join(&hash);
        let quoted: Vec<String> = words.iter().map(|word| quoted(word)).collect();
        let command_line = format!("klasktron {}", quoted.join(" "));
        Self { hash, folder, words, command_line, settings: BTreeMap::new(), seed: None }
    }

    /// Title of the point: `width 64, history 5, seed 2`.
    #[must_use]
    pub fn title(&self) -> String {
        let seed = self.seed.map(|seed| format!("seed {seed}"));
        let settings = self.settings.iter().map(|(name, value)| format!("{name} {value}"));
        let parts: Vec<String> = settings.chain(seed).collect();
        if parts.is_empty() { "the only point".to_owned() } else { parts.join(", ") }
    }

    /// Command of the point.
    #[must_use]
    pub fn command(&self) -> Option<SweptCommand> {
        SweptCommand::named(self.words.first()?)
    }
}

/// Hash of a point of `words`; `inputs` are the hashes of its inputs.
#[must_use]
pub fn hash_of(words: &[String], inputs: &[String]) -> String {
    let mut hash = Sha256::new();
    hash.update(CRATE_VERSION);
    for word in words {
        hash.update([0]);
        hash.update(word);
    }
    hash.update([1]);
    for input in inputs {
        hash.update([0]);
        hash.update(input);
    }
    let mut digits = hexadecimal(&hash.finalize());
    digits.truncate(HASH_DIGITS);
    digits
}

/// Quote `word` for a shell: unchanged where that is safe, otherwise in single quotes.
#[must_use]
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

/// Cache of file hashes; each file is read once.
#[derive(Debug, Default)]
pub struct InputHashes {
    known: BTreeMap<PathBuf, String>,
}

impl InputHashes {
    /// Hash of the file at `path`, or of every `.mcap` file in the folder there.
    ///
    /// # Errors
    /// When a file cannot be read.
    pub fn of(&mut self, path: &Path) -> Result<String, SweepError> {
        if let Some(hash) = self.known.get(path) {
            return Ok(hash.clone());
        }
        let hash = if path.is_dir() { of_folder(path)? } else { sha256_of_file(path)? };
        self.known.insert(path.to_owned(), hash.clone());
        Ok(hash)
    }
}

fn of_folder(path: &Path) -> Result<String, SweepError> {
    let mut hash = Sha256::new();
    for file in files_in(path).map_err(SweepError::io(path, "read"))? {
        hash.update(file.file_name().unwrap_or_default().to_string_lossy().as_bytes());
        hash.update([0]);
        hash.update(sha256_of_file(&file)?);
    }
    Ok(hexadecimal(&hash.finalize()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_only_where_a_shell_needs_it() {
        assert_eq!(quoted("--width=64,32"), "--width=64,32");
        assert_eq!(quoted("a b"), "'a b'");
        assert_eq!(quoted("it's $HOME"), "'it'\\''s $HOME'");
        assert_eq!(quoted(""), "''");
    }

    #[test]
    fn words_and_inputs_cannot_take_each_others_place() {
        let words = |list: &[&str]| list.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        let hash = |a: &[&str], b: &[&str]| hash_of(&words(a), &words(b));
        assert_eq!(hash(&["a", "b"], &["c"]), hash(&["a", "b"], &["c"]));
        assert_ne!(hash(&["a", "b"], &["c"]), hash(&["a"], &["b", "c"]));
        assert_ne!(hash(&["ab"], &[]), hash(&["a", "b"], &[]));
    }
}
