//! Ctrl-C (and SIGTERM): end with a sentence, or ask long work to stop at a safe point.
//!
//! Without an own handler, a command ends at once with status 130 and reports what it has written. Its unfinished
//! files are removed.

use super::tell;
use std::{
    fmt, fs,
    path::{Path, PathBuf},
    process,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
};

static STOP: AtomicBool = AtomicBool::new(false);
static PRESSES: AtomicUsize = AtomicUsize::new(0);
static MODE: Mutex<Mode> = Mutex::new(Mode::End);
static FILES: Mutex<Files> =
    Mutex::new(Files { unfinished: Vec::new(), created: Vec::new(), written: Vec::new() });

/// Exit status after Ctrl-C: 128 plus the number of SIGINT, as shells report it.
pub(crate) const EXIT_INTERRUPTED: u8 = 130;

/// Reaction to Ctrl-C.
#[derive(Debug, Clone, Copy)]
enum Mode {
    /// End at once and report what was written.
    End,
    /// Raise [`STOP`] and tell what the command does; the second Ctrl-C aborts.
    Stop(&'static str),
    /// Count the presses for work that drives motors, with a message for the first two; the third aborts.
    Count(&'static str, &'static str),
}

/// Files of the running command.
#[derive(Debug)]
struct Files {
    /// Partial files and folders, removed on Ctrl-C.
    unfinished: Vec<PathBuf>,
    /// Folders that did not exist before, the outermost first; removed on Ctrl-C where they are empty.
    created: Vec<PathBuf>,
    /// Complete results.
    written: Vec<PathBuf>,
}

/// Error of work that Ctrl-C has ended, with what was kept and how to continue.
#[derive(Debug)]
pub(crate) struct Interrupted(pub(crate) String);

impl fmt::Display for Interrupted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Interrupted {}

/// Listen to Ctrl-C, unless the parent process has set its signals to be ignored (`nohup`, background jobs).
pub(crate) fn listen() {
    ctrlc::try_set_handler(pressed).ok();
}

/// Flag that the first Ctrl-C raises; `doing` says what the command then does. The second Ctrl-C aborts.
///
/// # Errors
/// No signal handler can be installed.
pub(crate) fn raised_by_ctrl_c(doing: &'static str) -> anyhow::Result<&'static AtomicBool> {
    set(Mode::Stop(doing))?;
    Ok(&STOP)
}

/// Number of presses of Ctrl-C, for work that drives motors: `first` and `second` are the messages of the first two,
/// the third aborts.
///
/// # Errors
/// No signal handler can be installed.
pub(crate) fn counted_ctrl_c(
    first: &'static str,
    second: &'static str,
) -> anyhow::Result<&'static AtomicUsize> {
    set(Mode::Count(first, second))?;
    Ok(&PRESSES)
}

/// Return whether Ctrl-C has asked the work to stop.
pub(crate) fn is_raised() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Note a partial file or folder, which Ctrl-C then removes.
pub(super) fn begun(partial: &Path) {
    files().unfinished.push(partial.to_owned());
}

/// Note folders that did not exist before, the outermost first.
pub(super) fn created(folders: &[PathBuf]) {
    files().created.extend_from_slice(folders);
}

/// Let `complete` give the partial file its name; Ctrl-C waits until that is done.
pub(super) fn completed<T>(
    partial: &Path,
    results: &[PathBuf],
    complete: impl FnOnce() -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let mut files = files();
    let value = complete()?;
    files.unfinished.retain(|path| path != partial);
    files.written.extend_from_slice(results);
    Ok(value)
}

/// Forget a partial file that the command has removed itself.
pub(super) fn given_up(partial: &Path) {
    files().unfinished.retain(|path| path != partial);
}

fn set(mode: Mode) -> anyhow::Result<()> {
    *MODE.lock().unwrap_or_else(PoisonError::into_inner) = mode;
    match ctrlc::set_handler(pressed) {
        // `listen` has installed it already.
        Ok(()) | Err(ctrlc::Error::MultipleHandlers) => Ok(()),
        Err(error) => Err(error.into()),
    }
}

fn files() -> MutexGuard<'static, Files> {
    FILES.lock().unwrap_or_else(PoisonError::into_inner)
}

fn pressed() {
    let mode = *MODE.lock().unwrap_or_else(PoisonError::into_inner);
    let presses = PRESSES.fetch_add(1, Ordering::Relaxed);
    match (mode, presses) {
        (Mode::End, _) => end(),
        (Mode::Stop(doing), 0) => {
            STOP.store(true, Ordering::Relaxed);
            tell(&format!("interrupted: {doing}; press Ctrl-C again to abort"));
        }
        (Mode::Count(first, _), 0) => tell(first),
        (Mode::Count(_, second), 1) => tell(second),
        _ => abort(),
    }
}

/// Remove unfinished files, report the complete ones, and end the program.
fn end() {
    // Held until the program ends, so that no file is completed after the report.
    let files = files();
    for path in &files.unfinished {
        let removed = if path.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
        removed.ok();
    }
    files.created.iter().rev().for_each(|folder| drop(fs::remove_dir(folder)));
    tell(&sentence(&files.written));
    abort();
}

/// Report of an interrupted command.
fn sentence(written: &[PathBuf]) -> String {
    match written {
        [] => "interrupted; nothing was written".to_owned(),
        [one] => format!("interrupted; {} is complete", one.display()),
        [.., last] => {
            format!(
                "interrupted; {} files are complete, the last is {}",
                written.len(),
                last.display()
            )
        }
    }
}

fn abort() {
    #[expect(clippy::exit, reason = "the user has asked for it")]
    process::exit(EXIT_INTERRUPTED.into());
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_report_counts_complete_files() {
        let paths = |names: &[&str]| -> Vec<PathBuf> { names.iter().map(PathBuf::from).collect() };
        assert_eq!(sentence(&[]), "interrupted; nothing was written");
        assert_eq!(sentence(&paths(&["a.csv"])), "interrupted; a.csv is complete");
        assert_eq!(
            sentence(&paths(&["a.csv", "b.csv"])),
            "interrupted; 2 files are complete, the last is b.csv"
        );
    }
}
