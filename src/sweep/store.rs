//! Result store: every finished point in a folder of its own, which appears when complete.
//!
//! ```text
//! OUT/points/HASH/         files of the command
//!                result.json   document that it printed
//!                log.txt       its log
//!                point.json    provenance
//! OUT/points/.HASH.partial/    a running or interrupted point
//! OUT/failed/HASH.json, .log   a failed point
//! ```

use super::{Point, SweepError};
use crate::{
    provenance::GIT_HASH,
    recording::{ExistingFile, write_bytes},
};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::{
    collections::BTreeSet,
    fs::{self, File, TryLockError},
    io,
    path::{Path, PathBuf},
};

/// Folder of finished points.
pub(super) const POINTS: &str = "points";
const FAILED: &str = "failed";
/// Document that a point's command printed.
pub const RESULT_FILE: &str = "result.json";
/// Its log.
pub const LOG_FILE: &str = "log.txt";
const POINT_FILE: &str = "point.json";

/// Provenance of a finished point: `point.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PointRecord {
    /// [`Point::hash`].
    pub hash: String,
    /// Command line without the output folder.
    pub command_line: String,
    /// Commit of the program.
    pub git_hash: String,
    /// Exit status: 0, or 3 if data was lost or a gate was missed.
    pub status: i32,
    /// Last message, if the status is 3.
    pub remark: Option<String>,
}

/// Reason of a failed point: `failed/HASH.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Command line.
    pub command_line: String,
    /// Last line of its log, or its end.
    pub reason: String,
    /// Slurm task that ran it, such as `12_3`.
    pub task: Option<String>,
}

/// Finished and failed points under one folder.
#[derive(Debug, Clone)]
pub struct Store {
    root: PathBuf,
}

/// Claim on a point; it lasts as long as a process, child processes included, holds the file.
#[derive(Debug)]
pub(super) struct Claim {
    path: PathBuf,
    pub(super) file: File,
}

impl Claim {
    pub(super) fn release(self) {
        fs::remove_file(&self.path).ok(); // an empty file that nobody misses
    }
}

impl Store {
    /// Open the store in `root`, which is created if missing.
    ///
    /// # Errors
    /// When it cannot be created.
    pub fn open(root: &Path) -> Result<Self, SweepError> {
        for folder in [POINTS, FAILED] {
            let path = root.join(folder);
            fs::create_dir_all(&path).map_err(SweepError::io(path, "create the folder"))?;
        }
        Ok(Self { root: root.to_owned() })
    }

    /// The folder of the sweep.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Folder of the results of `point` when it is finished.
    #[must_use]
    pub fn folder(&self, point: &Point) -> PathBuf {
        self.root.join(&point.folder)
    }

    /// Hashes of those `points` that are finished.
    ///
    /// # Errors
    /// When the folder cannot be read, or that of a point holds another one.
    pub fn finished(&self, points: &[Point]) -> Result<BTreeSet<String>, SweepError> {
        let path = self.root.join(POINTS);
        let mut there = BTreeSet::new();
        for entry in fs::read_dir(&path).map_err(SweepError::io(&path, "read"))? {
            let entry = entry.map_err(SweepError::io(&path, "read"))?;
            there.insert(entry.file_name().to_string_lossy().into_owned());
        }
        let mut finished = BTreeSet::new();
        for point in points {
            if point.folder.starts_with(POINTS) {
                if there.contains(&point.hash) {
                    finished.insert(point.hash.clone());
                }
            } else if self.holds(point)? {
                finished.insert(point.hash.clone());
            }
        }
        Ok(finished)
    }

    /// Return whether the folder of a point holds its results.
    pub(super) fn holds(&self, point: &Point) -> Result<bool, SweepError> {
        let folder = self.folder(point);
        if !folder.exists() {
            return Ok(false);
        }
        match read_json::<PointRecord>(&folder.join(POINT_FILE)) {
            Some(record) if record.hash == point.hash => Ok(true),
            _ => Err(SweepError::OtherPoint { path: folder }),
        }
    }

    /// Record and result of a finished point; `None` if they cannot be read.
    #[must_use]
    pub fn read(&self, point: &Point) -> Option<(PointRecord, Value)> {
        let folder = self.folder(point);
        Some((read_json(&folder.join(POINT_FILE))?, read_json(&folder.join(RESULT_FILE))?))
    }

    fn failed_file(&self, point: &Point, extension: &str) -> PathBuf {
        self.root.join(FAILED).join(format!("{}.{extension}", point.hash))
    }

    /// Path of the log of a failed point.
    #[must_use]
    pub fn failed_log(&self, point: &Point) -> PathBuf {
        self.failed_file(point, "log")
    }

    /// Failure of `point`, if it failed.
    #[must_use]
    pub fn failure(&self, point: &Point) -> Option<Failure> {
        read_json(&self.failed_file(point, "json"))
    }

    /// Hashes of failed points.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn failed(&self) -> Result<BTreeSet<String>, SweepError> {
        let path = self.root.join(FAILED);
        let mut failed = BTreeSet::new();
        for entry in fs::read_dir(&path).map_err(SweepError::io(&path, "read"))? {
            let name = entry.map_err(SweepError::io(&path, "read"))?.file_name();
            if let Some(hash) = name.to_string_lossy().strip_suffix(".json") {
                failed.insert(hash.to_owned());
            }
        }
        Ok(failed)
    }

    /// Remove the failure of `point`, so that it is run again.
    pub fn forget_failure(&self, point: &Point) {
        for extension in ["json", "log"] {
            fs::remove_file(self.failed_file(point, extension)).ok(); // most have none
        }
    }

    /// Folder of a running `point`, next to that of its results.
    pub(super) fn partial(&self, point: &Point) -> PathBuf {
        self.beside(point, "partial")
    }

    fn beside(&self, point: &Point, what: &str) -> PathBuf {
        let folder = self.folder(point);
        let name = folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
        folder.with_file_name(format!(".{name}.{what}"))
    }

    /// Claim `point`; `None` if another process works on it. On a file system without locks every
    /// process gets the claim, and the first result counts.
    pub(super) fn claim(&self, point: &Point) -> Result<Option<Claim>, SweepError> {
        let path = self.beside(point, "lock");
        let file = File::create(&path).map_err(SweepError::io(&path, "create"))?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => Ok(None),
            Ok(()) | Err(TryLockError::Error(_)) => Ok(Some(Claim { path, file })),
        }
    }

    /// Rename the partial folder of `point` to its final name.
    pub(super) fn finish(&self, point: &Point, record: &PointRecord) -> Result<(), SweepError> {
        let (partial, folder) = (self.partial(point), self.folder(point));
        let text = to_json(record);
        write_bytes(&partial.join(POINT_FILE), ExistingFile::Replace, text.as_bytes())?;
        if let Err(error) = fs::rename(&partial, &folder) {
            // On a file system without locks another process may have been first, with the same
            // bytes.
            if !self.holds(point)? {
                return Err(SweepError::io(folder, "rename")(error));
            }
            fs::remove_dir_all(&partial).ok();
        }
        self.forget_failure(point);
        Ok(())
    }

    /// Record the failure of `point`, with the log of its partial folder.
    pub(super) fn fail(&self, point: &Point, failure: &Failure) -> Result<(), SweepError> {
        let log = self.failed_log(point);
        match fs::copy(self.partial(point).join(LOG_FILE), &log) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => {
                return Err(SweepError::io(log, "write")(error));
            }
            _ => {}
        }
        let path = self.failed_file(point, "json");
        Ok(write_bytes(&path, ExistingFile::Replace, to_json(failure).as_bytes())?)
    }
}

impl PointRecord {
    /// Record of a point that ended with `status`.
    pub(super) fn new(point: &Point, status: i32, remark: Option<String>) -> Self {
        Self {
            hash: point.hash.clone(),
            command_line: point.command_line.clone(),
            git_hash: GIT_HASH.to_owned(),
            status,
            remark,
        }
    }
}

pub(super) fn to_json(value: &impl Serialize) -> String {
    serde_json::to_string_pretty(value).unwrap_or_else(|_plain| unreachable!("plain data")) + "\n"
}

pub(super) fn read_json<T: for<'a> Deserialize<'a>>(path: &Path) -> Option<T> {
    serde_json::from_slice(&fs::read(path).ok()?).ok()
}
