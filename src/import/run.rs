//! Common parts of all imports: settings, metadata, runs; and the import of bags.

use super::{
    bag::{self, Bag},
    error::ImportError,
    report::ImportReport,
    tape::Tape,
    topics,
};
use crate::{
    board::BoardSize,
    gantry::CoreXy,
    recording::{ExistingFile, RecordingError, Split, sha256_of_file},
};
use std::path::{Path, PathBuf};

/// Settings of every import.
#[derive(Debug, Clone, PartialEq)]
pub struct ImportConfig {
    /// Path of the recording.
    pub output: PathBuf,
    /// Policy for an existing file.
    pub existing: ExistingFile,
    /// Session; by default the source's name without extension.
    pub session: Option<String>,
    /// Split; by default that of a bag's folder, else `train`.
    pub split: Option<Split>,
    /// Name of the robot; by default `unknown`.
    pub robot: Option<String>,
}

impl ImportConfig {
    /// Create settings with all defaults.
    #[must_use]
    pub fn new(output: &Path, existing: ExistingFile) -> Self {
        Self { output: output.to_owned(), existing, session: None, split: None, robot: None }
    }

    /// Check the output before a long source is read.
    pub(super) fn check_output(&self) -> Result<(), ImportError> {
        if self.existing == ExistingFile::Refuse && self.output.exists() {
            return Err(RecordingError::Exists { path: self.output.clone() }.into());
        }
        Ok(())
    }

    /// Add the common metadata to the tape and write the recording. `files` are name and SHA-256.
    pub(super) fn write(
        &self,
        mut tape: Tape,
        source: &Path,
        split: Split,
        files: &[(String, String)],
    ) -> Result<ImportReport, ImportError> {
        for (name, sha256) in files {
            log::info!("read {name}, sha256 {sha256}");
        }
        let join = |pick: fn(&(String, String)) -> &str| {
            files.iter().map(pick).collect::<Vec<_>>().join(", ")
        };
        let stem = source.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for (key, value) in [
            ("schema_version", "1".to_owned()),
            ("source", "import".to_owned()),
            ("session", self.session.clone().unwrap_or(stem)),
            ("split", split.to_string()),
            ("robot", self.robot.clone().unwrap_or_else(|| "unknown".to_owned())),
            ("original_file", join(|(name, _)| name)),
            ("original_sha256", join(|(_, sha256)| sha256)),
            ("klasktron_version", env!("CARGO_PKG_VERSION").to_owned()),
        ] {
            tape.metadata.insert(key.to_owned(), value);
        }
        tape.write(&self.output, self.existing)
    }

    /// Return the requested split, or `train`.
    pub(super) fn split_or_train(&self) -> Split {
        self.split.unwrap_or(Split::Train)
    }
}

/// Return the file name and SHA-256 of a source, for the metadata.
pub(super) fn identity(path: &Path) -> Result<(String, String), ImportError> {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok((name, sha256_of_file(path)?))
}

/// Size of the table and its gantries.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Table {
    /// Playing field.
    pub board: BoardSize,
    /// Kinematics of both gantries.
    pub gantry: CoreXy,
}

impl Table {
    /// Store the table in the metadata.
    pub(super) fn note(&self, tape: &mut Tape) {
        for (key, metres) in [
            ("board_short_side_m", self.board.short_side),
            ("board_long_side_m", self.board.long_side),
            ("belt_metres_per_turn", self.gantry.metres_per_turn()),
        ] {
            tape.metadata.insert(key.to_owned(), metres.to_string());
        }
    }
}

/// Kind of a source.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SourceKind {
    /// ROS 2 bag.
    Bag,
    /// npz archive.
    Npz,
    /// candump log.
    Candump,
}

impl SourceKind {
    /// Determine the kind from the name: a folder, `.db3` or `.mcap` (also with `.zstd`) is a bag,
    /// then `.npz` and `.log`.
    ///
    /// # Errors
    /// When the name is ambiguous, or the file is a CSV table, whose columns must be given.
    pub fn guess(path: &Path) -> Result<Self, ImportError> {
        if path.is_dir() || bag::is_bag_file(path) {
            return Ok(Self::Bag);
        }
        let ending = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        match ending.as_str() {
            "npz" => Ok(Self::Npz),
            "log" => Ok(Self::Candump),
            "csv" | "tsv" => Err(ImportError::CsvNeedsColumns { path: path.to_owned() }),
            _ => Err(ImportError::UnknownKind { path: path.to_owned() }),
        }
    }
}

/// Import ROS 2 bags of the KlaskTron table, each as one run, in the order of the arguments.
///
/// # Errors
/// When a bag cannot be read, two overlap in time, no topic has a counterpart in the contract, or
/// writing the output fails.
pub fn import_bags(
    paths: &[PathBuf],
    table: &Table,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let mut tape = Tape::default();
    let mut files = Vec::new();
    let mut spans = Vec::new();
    let mut splits = Vec::new();
    let scratch = scratch_of(&config.output);
    for (run, path) in (0_u32..).zip(paths) {
        let mut part = Tape::default();
        let bag = Bag::open(path, &topics::is_wanted, &scratch)?;
        files.extend(bag.files.iter().cloned());
        let found = describe(&bag);
        topics::map_bag(bag, &mut part, table.board, table.gantry);
        let Some(span) = part.time_range() else {
            return Err(ImportError::NothingToImport { path: path.clone(), found });
        };
        for (other, (first, last)) in &spans {
            if span.0 <= *last && *first <= span.1 {
                let (first, second) = (PathBuf::clone(other), path.clone());
                return Err(ImportError::Overlap { first, second });
            }
        }
        spans.push((path.clone(), span));
        let name = BagName::of(path);
        let split = config.split.or(name.split).unwrap_or(Split::Train);
        part.mark_run(run, &name.pattern, &split.to_string());
        splits.push(split);
        tape.append(part);
    }
    table.note(&mut tape);
    let split = match splits.as_slice() {
        [first, rest @ ..] if rest.iter().all(|split| split == first) => *first,
        _ => config.split_or_train(),
    };
    let source = paths.first().map_or(Path::new(""), PathBuf::as_path);
    config.write(tape, source, split, &files)
}

fn scratch_of(output: &Path) -> PathBuf {
    match output.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

fn describe(bag: &Bag) -> String {
    let topics: Vec<String> = bag
        .topics
        .iter()
        .map(|topic| format!("{} ({}, {} messages)", topic.name, topic.type_name, topic.count))
        .collect();
    if topics.is_empty() {
        "it has no topics".to_owned()
    } else {
        format!("it has {}", topics.join(", "))
    }
}

/// Information in the upstream recorder's folder names.
#[derive(Debug, PartialEq, Eq)]
struct BagName {
    pattern: String,
    split: Option<Split>,
}

impl BagName {
    /// Parse the bag's own folder and its parent: `train/vel_profile_<pattern>_<stamp>_run<n>`.
    fn of(path: &Path) -> Self {
        let names: Vec<String> = path
            .ancestors()
            .take(3)
            .filter_map(|folder| Some(folder.file_name()?.to_string_lossy().into_owned()))
            .collect();
        let pattern = names.iter().find_map(|name| pattern_of(name));
        let split = names.iter().find_map(|name| match name.as_str() {
            "train" => Some(Split::Train),
            "validation" => Some(Split::Validation),
            _ => None,
        });
        Self { pattern: pattern.unwrap_or_else(|| "unknown".to_owned()), split }
    }
}

/// Return the pattern in `vel_profile_<pattern>_<stamp>_run<n>`; the stamp is the first piece that
/// starts with four digits.
fn pattern_of(name: &str) -> Option<String> {
    let rest = name.strip_prefix("vel_profile_")?;
    let is_stamp =
        |piece: &&str| 4 <= piece.len() && piece.bytes().take(4).all(|byte| byte.is_ascii_digit());
    let is_run = |piece: &&str| {
        piece
            .strip_prefix("run")
            .is_some_and(|n| !n.is_empty() && n.bytes().all(|b| b.is_ascii_digit()))
    };
    let pieces: Vec<&str> =
        rest.split('_').take_while(|piece| !is_stamp(piece) && !is_run(piece)).collect();
    let pattern = pieces.join("_");
    (!pattern.is_empty()).then_some(pattern)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_pattern_and_split() {
        let name =
            BagName::of(Path::new("bags/validation/vel_profile_x_line_20250131_120000_run3"));
        assert_eq!(name, BagName { pattern: "x_line".into(), split: Some(Split::Validation) });
        let file = Path::new("train/vel_profile_circle_2025-01-31-12-00-00_run1/a_0.db3");
        let name = BagName::of(file);
        assert_eq!(name, BagName { pattern: "circle".into(), split: Some(Split::Train) });
        let name = BagName::of(Path::new("my_bag"));
        assert_eq!(name, BagName { pattern: "unknown".into(), split: None });
    }

    #[test]
    fn kinds_are_guessed_from_names() {
        let guess = |name: &str| SourceKind::guess(Path::new(name));
        assert_eq!(guess("a.DB3").unwrap(), SourceKind::Bag);
        assert_eq!(guess("a_0.mcap.zstd").unwrap(), SourceKind::Bag);
        assert_eq!(guess("a.npz").unwrap(), SourceKind::Npz);
        assert_eq!(guess("a.log").unwrap(), SourceKind::Candump);
        assert!(guess("a.csv").unwrap_err().to_string().contains("--time COLUMN"));
        assert!(guess("a").is_err());
    }
}
