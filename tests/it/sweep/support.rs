//! A sweep of `eval` over the example match, in a folder with a blank in its name.

use crate::support::said;
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Command,
};
use tempfile::TempDir;

/// A folder with `match.mcap` and `sweep.toml`.
pub(super) struct Bench {
    dir: TempDir,
}

impl Bench {
    /// A sweep of `eval` with `seeds`, and `more` text in its file.
    pub(super) fn new(seeds: usize, more: &str) -> Self {
        let bench = Self { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(bench.folder()).unwrap();
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/example-match.mcap");
        fs::copy(data, bench.folder().join("match.mcap")).unwrap();
        let text =
            format!("command = \"eval\"\ninputs = [\"match.mcap\"]\nseeds = {seeds}\n{more}");
        fs::write(bench.file(), text).unwrap();
        bench
    }

    /// Where its files are.
    pub(super) fn folder(&self) -> PathBuf {
        self.dir.path().join("a b")
    }

    /// The sweep file.
    pub(super) fn file(&self) -> PathBuf {
        self.folder().join("sweep.toml")
    }

    /// A folder for results.
    pub(super) fn out(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// The command, to be added to.
    pub(super) fn command(&self, out: &Path, more: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
        command.arg("sweep").arg(self.file()).arg("--output").arg(out).args(more);
        command
    }

    /// Runs it.
    pub(super) fn run(&self, out: &Path, more: &[&str]) -> (String, String, i32) {
        said(&self.command(out, more).output().unwrap())
    }
}

/// Every file below `folder` but those of Slurm and locks, with its bytes.
pub(super) fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            let inner = path.strip_prefix(folder).unwrap().to_owned();
            if inner.starts_with("slurm") || inner.ends_with(".sweep.lock") {
                continue;
            }
            if path.is_dir() {
                open.push(path);
            } else {
                found.insert(inner, fs::read(&path).unwrap());
            }
        }
    }
    found
}

/// Names of the finished points.
pub(super) fn finished(out: &Path) -> Vec<String> {
    let Ok(entries) = fs::read_dir(out.join("points")) else { return Vec::new() };
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| !name.starts_with('.')).collect();
    names.sort();
    names
}

/// When each finished point was made.
pub(super) fn made(out: &Path) -> BTreeMap<String, std::time::SystemTime> {
    let when = |name: String| {
        let point = out.join("points").join(&name).join("point.json");
        (name, fs::metadata(point).unwrap().modified().unwrap())
    };
    finished(out).into_iter().map(when).collect()
}
