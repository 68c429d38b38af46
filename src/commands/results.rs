//! Results of a command: existing ones are refused or replaced, and new ones appear together when all are complete.

use super::interrupt;
use anyhow::{Context as _, bail};
use klasktron::recording::{ExistingFile, partial_name, write_bytes};
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Name of the folder in which results are written until all of them are complete.
const PARTIAL_FOLDER: &str = ".results.partial";

/// Treatment of existing results.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub(crate) struct OverwriteArgs {
    /// Replace existing results
    #[arg(long)]
    pub(crate) overwrite: bool,
}

impl OverwriteArgs {
    /// Treatment of an existing file.
    pub(crate) fn existing(self) -> ExistingFile {
        if self.overwrite { ExistingFile::Replace } else { ExistingFile::Refuse }
    }
}

/// Result files of one command in one folder.
///
/// They are written into a partial folder and moved when all are complete. Without [`finish`](Self::finish) nothing
/// is left: the old results, if there are any, stay as they are.
#[derive(Debug)]
pub(crate) struct Results {
    folder: PathBuf,
    partial: PathBuf,
    names: Vec<String>,
    omitted: Vec<String>,
    /// Folders that did not exist, the outermost first.
    created: Vec<PathBuf>,
    is_finished: bool,
}

impl Results {
    /// Begin results called `names` in `folder`, before any work is done for them.
    ///
    /// # Errors
    /// One of them exists and may not be replaced, or the folder cannot be written.
    pub(crate) fn begin(
        folder: &Path,
        names: &[&str],
        overwrite: OverwriteArgs,
    ) -> anyhow::Result<Self> {
        refuse_existing(folder, names, overwrite)?;
        let partial = folder.join(PARTIAL_FOLDER);
        let missing = partial
            .ancestors()
            .skip(1)
            .take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let mut created: Vec<PathBuf> = missing.map(Path::to_owned).collect();
        created.reverse();
        let results = Self {
            folder: folder.to_owned(),
            partial,
            names: names.iter().map(|name| (*name).to_owned()).collect(),
            omitted: Vec::new(),
            created,
            is_finished: false,
        };
        // Left by a run that was killed.
        fs::remove_dir_all(&results.partial).ok();
        fs::create_dir_all(&results.partial)
            .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
        interrupt::begun(&results.partial);
        interrupt::created(&results.created);
        Ok(results)
    }

    /// Leave out the announced result called `name`. An old one, which may be replaced, does not stay next to the new
    /// results: it is removed with them.
    pub(crate) fn omit(&mut self, name: &str) {
        self.names.retain(|own| own != name);
        self.omitted.push(name.to_owned());
    }

    /// Names of the results that are written, with "and" before the last one.
    pub(crate) fn listed(&self) -> String {
        match self.names.split_last() {
            Some((last, [])) => last.clone(),
            Some((last, first)) => format!("{} and {last}", first.join(", ")),
            None => String::new(),
        }
    }

    /// Path at which the result called `name` is written.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        debug_assert!(self.names.iter().any(|own| own == name), "{name} is not announced");
        self.partial.join(name)
    }

    /// Move all results to their folder.
    ///
    /// # Errors
    /// One of them was not written or cannot be moved.
    pub(crate) fn finish(mut self) -> anyhow::Result<()> {
        if let Some(name) = self.names.iter().find(|name| !self.partial.join(name).exists()) {
            bail!("{}: was not written", self.folder.join(name).display());
        }
        let to: Vec<PathBuf> = self.names.iter().map(|name| self.folder.join(name)).collect();
        interrupt::completed(&self.partial, &to, || {
            for (name, to) in self.names.iter().zip(&to) {
                fs::rename(self.partial.join(name), to)
                    .with_context(|| format!("{}: cannot write", to.display()))?;
            }
            for name in &self.omitted {
                fs::remove_file(self.folder.join(name)).ok();
            }
            fs::remove_dir_all(&self.partial).ok();
            Ok(())
        })?;
        self.is_finished = true;
        Ok(())
    }
}

impl Drop for Results {
    fn drop(&mut self) {
        if self.is_finished {
            return;
        }
        fs::remove_dir_all(&self.partial).ok();
        // Only empty ones go.
        self.created.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
        interrupt::given_up(&self.partial);
    }
}

/// Path of the report of the file `output`: the same name with the extension html. Both must be free.
///
/// # Errors
/// One of them exists and may not be replaced, or they have the same name.
pub(crate) fn report_of(output: &Path, overwrite: OverwriteArgs) -> anyhow::Result<PathBuf> {
    let report = output.with_extension("html");
    if report == output {
        bail!(
            "{}: --output is a JSON file; name it *.json, the report gets .html",
            output.display()
        );
    }
    for file in [output, &report] {
        refuse_existing_file(file, overwrite)?;
    }
    Ok(report)
}

/// Write `text` to the file `output` and `html` to its `report`.
///
/// # Errors
/// As for [`write_file`].
pub(crate) fn write_with_report(
    (output, text): (&Path, &str),
    (report, html): (&Path, &str),
    overwrite: OverwriteArgs,
) -> anyhow::Result<()> {
    for (path, content) in [(output, text), (report, html)] {
        write_file(path, overwrite, |existing| {
            Ok(write_bytes(path, existing, content.as_bytes())?)
        })?;
    }
    Ok(())
}

/// Refuse existing results called `names` in `folder`, unless they may be replaced.
///
/// # Errors
/// The names that exist, and the way out; or that `folder` is a file.
pub(crate) fn refuse_existing(
    folder: &Path,
    names: &[&str],
    overwrite: OverwriteArgs,
) -> anyhow::Result<()> {
    let shown = folder.display();
    if folder.is_file() {
        bail!("{shown}: is a file; --output takes a folder here");
    }
    let existing: Vec<&str> =
        names.iter().copied().filter(|name| folder.join(name).exists()).collect();
    match (overwrite.overwrite, existing.as_slice()) {
        (true, _) | (false, []) => Ok(()),
        (false, [one]) => bail!(
            "{}: exists already; replace it with --overwrite, or give another --output",
            folder.join(one).display()
        ),
        (false, several) => bail!(
            "{shown}: holds {} already; replace them with --overwrite, or give another --output",
            several.join(", ")
        ),
    }
}

/// Write one result file with `write`, which completes it under its name.
///
/// The partial file is removed on Ctrl-C.
///
/// # Errors
/// The file exists and may not be replaced, `path` is a folder, or `write` fails.
pub(crate) fn write_file<T>(
    path: &Path,
    overwrite: OverwriteArgs,
    write: impl FnOnce(ExistingFile) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    refuse_existing_file(path, overwrite)?;
    let partial = partial_name(path);
    // The unfinished recording of another session is not ours to remove.
    if partial.exists() {
        return write(overwrite.existing());
    }
    interrupt::begun(&partial);
    let written = write(overwrite.existing());
    match &written {
        Ok(_) => interrupt::completed(&partial, &[path.to_owned()], || Ok(()))?,
        Err(_) => interrupt::given_up(&partial),
    }
    written
}

/// Refuse an existing file, unless it may be replaced, and a folder.
///
/// # Errors
/// The reason and the way out.
pub(crate) fn refuse_existing_file(path: &Path, overwrite: OverwriteArgs) -> anyhow::Result<()> {
    let shown = path.display();
    if path.is_dir() {
        bail!("{shown}: is a folder; --output takes a file here");
    }
    if path.exists() && !overwrite.overwrite {
        bail!("{shown}: exists already; replace it with --overwrite, or give another --output");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 2] = ["a.json", "b.html"];

    const REFUSE: OverwriteArgs = OverwriteArgs { overwrite: false };
    const REPLACE: OverwriteArgs = OverwriteArgs { overwrite: true };

    fn begin(folder: &Path, overwrite: OverwriteArgs) -> anyhow::Result<Results> {
        Results::begin(folder, &NAMES, overwrite)
    }

    #[test]
    fn results_appear_together_and_are_replaced_only_on_request() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("deep/out");
        let results = begin(&folder, REFUSE).unwrap();
        for name in NAMES {
            fs::write(results.path(name), "first").unwrap();
        }
        assert!(!folder.join("a.json").exists());
        results.finish().unwrap();
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 2);
        let refused = begin(&folder, REFUSE).unwrap_err().to_string();
        assert!(refused.contains("holds a.json, b.html already; replace them with --overwrite"));
        fs::remove_file(folder.join("b.html")).unwrap();
        let refused = begin(&folder, REFUSE).unwrap_err().to_string();
        assert!(refused.contains("a.json: exists already"), "{refused}");
        drop(begin(&folder, REPLACE).unwrap());
        assert_eq!(fs::read_to_string(folder.join("a.json")).unwrap(), "first");
    }

    #[test]
    fn an_old_result_does_not_stay_beside_new_ones_that_omit_it() {
        let dir = tempfile::tempdir().unwrap();
        for name in NAMES {
            fs::write(dir.path().join(name), "old").unwrap();
        }
        let mut results = begin(dir.path(), REPLACE).unwrap();
        fs::write(results.path("a.json"), "new").unwrap();
        results.omit("b.html");
        results.finish().unwrap();
        assert_eq!(fs::read_to_string(dir.path().join("a.json")).unwrap(), "new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn unfinished_results_leave_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let results = begin(&dir.path().join("deep/out"), REFUSE).unwrap();
        fs::write(results.path("a.json"), "half").unwrap();
        assert!(results.finish().is_err(), "b.html is missing");
        assert!(!dir.path().join("deep").exists());
        drop(begin(&dir.path().join("other/out"), REFUSE).unwrap());
        assert!(!dir.path().join("other").exists());
        let file = dir.path().join("file");
        fs::write(&file, "").unwrap();
        assert!(begin(&file, REPLACE).unwrap_err().to_string().contains("--output takes a folder"));
    }
}
