//! Running one point: a child process of the same program, and its result.

use super::{
    Point, SweepError,
    error::NO_SPACE,
    store::{Failure, LOG_FILE, PointRecord, RESULT_FILE, Store},
};
use serde_json::Value;
use std::{
    fs::{self, File},
    io::{self, Read as _, Seek as _},
    path::{Path, PathBuf},
    process::{Child, Command, ExitStatus},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};

/// Environment of a point's run.
#[derive(Debug, Clone)]
pub struct Runner {
    /// Path of the program.
    pub program: PathBuf,
    /// The folder in which it is run.
    pub working_folder: PathBuf,
    /// Number of threads per point, for commands with that option.
    pub threads: usize,
    /// Slurm task of the run.
    pub task: Option<String>,
}

/// End of a point's run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ended {
    /// The results are in the store, with a message if the status was 3.
    Finished(Option<String>),
    /// The run failed; the store has the reason.
    Failed(Failure),
    /// The run was stopped; commands that can resume continue from its files.
    Interrupted,
}

/// Exit status of a command that finished but lost data or missed a gate.
const STATUS_LOSSY: i32 = 3;
/// Maximum polling interval of a child (ms).
const LONGEST_LOOK_MS: u64 = 20;
/// Polling interval of a point claimed by another process.
const CLAIMED_LOOK: Duration = Duration::from_millis(200);
/// Length of the end of a log that is searched for the last line (bytes).
const LOG_TAIL: u64 = 16 * 1024;
/// Names of signals.
const SIGNALS: [(i32, &str); 7] = [
    (1, "SIGHUP"),
    (2, "SIGINT"),
    (6, "SIGABRT"),
    (9, "SIGKILL, which is also what Linux sends when memory is short"),
    (11, "SIGSEGV"),
    (15, "SIGTERM"),
    (24, "SIGXCPU"),
];

/// Run `point` into `store`, unless it is finished meanwhile, until `stop` is set.
///
/// # Errors
/// When the program cannot be started or the store cannot be written.
pub fn run_point(
    point: &Point,
    store: &Store,
    runner: &Runner,
    stop: &AtomicBool,
) -> Result<Ended, SweepError> {
    let claim = loop {
        if stop.load(Ordering::Relaxed) {
            return Ok(Ended::Interrupted);
        }
        match store.claim(point)? {
            Some(claim) => break claim,
            None => thread::sleep(CLAIMED_LOOK),
        }
    };
    // The child holds the claim as its standard input, so that it lasts as long as the child, even
    // if this process is killed.
    let held = claim.file.try_clone().map_err(SweepError::io(store.folder(point), "claim"))?;
    let ended = if store.holds(point)? {
        Ok(Ended::Finished(None))
    } else {
        run_claimed(point, store, runner, (held, stop))
    };
    claim.release();
    ended
}

fn run_claimed(
    point: &Point,
    store: &Store,
    runner: &Runner,
    (claim, stop): (File, &AtomicBool),
) -> Result<Ended, SweepError> {
    let partial = store.partial(point);
    let continued = prepare(point, &partial)?;
    let mut words = point.words.clone();
    words.extend(continued);
    words.extend(["--output".to_owned(), partial.display().to_string()]);
    if let Some(command) = point.command() {
        words.extend(command.printing_words().iter().map(|word| (*word).to_owned()));
        if command.has_threads() {
            words.extend(["--threads".to_owned(), runner.threads.to_string()]);
        }
    }
    let create = |name: &str| {
        let path = partial.join(name);
        File::create(&path).map_err(SweepError::io(path, "create"))
    };
    let mut command = Command::new(&runner.program);
    // A settings file in the working folder is not part of a point.
    command.arg("--no-config").args(&words).current_dir(&runner.working_folder);
    command.stdin(claim).stdout(create(RESULT_FILE)?).stderr(create(LOG_FILE)?);
    own_group(&mut command);
    let child = command.spawn().map_err(SweepError::io(&runner.program, "start"))?;
    drop(command);
    let status = wait(child, stop).map_err(SweepError::io(&runner.program, "wait for"))?;
    judge(point, store, runner, (status, stop))
}

/// Own process group: Ctrl-C in the terminal reaches only the engine, which ends its children
/// itself.
fn own_group(command: &mut Command) {
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    #[cfg(not(unix))]
    let _ = command;
}

/// Prepare the partial folder: empty, or with the files to resume from; returns the word for
/// resuming.
fn prepare(point: &Point, partial: &Path) -> Result<Option<String>, SweepError> {
    let continues = point.command().and_then(super::SweptCommand::continues);
    let kept = continues.filter(|(file, _)| partial.join(file).exists());
    if kept.is_none() && partial.exists() {
        fs::remove_dir_all(partial).map_err(SweepError::io(partial, "empty"))?;
    }
    fs::create_dir_all(partial).map_err(SweepError::io(partial, "create"))?;
    Ok(kept.and_then(|(_, word)| word).map(str::to_owned))
}

/// Wait for `child`, which is killed when `stop` is set. The polling interval grows with the run
/// time.
fn wait(mut child: Child, stop: &AtomicBool) -> io::Result<ExitStatus> {
    let mut looks = 0_u64;
    loop {
        if let Some(status) = child.try_wait()? {
            return Ok(status);
        }
        if stop.load(Ordering::Relaxed) {
            child.kill()?;
            return child.wait();
        }
        looks += 1;
        thread::sleep(Duration::from_millis((1 + looks / 8).min(LONGEST_LOOK_MS)));
    }
}

fn judge(
    point: &Point,
    store: &Store,
    runner: &Runner,
    (status, stop): (ExitStatus, &AtomicBool),
) -> Result<Ended, SweepError> {
    let partial = store.partial(point);
    let last = last_words(&partial.join(LOG_FILE));
    let code = status.code();
    if code == Some(0) || code == Some(STATUS_LOSSY) {
        let bytes = fs::read(partial.join(RESULT_FILE)).unwrap_or_default();
        let result: Option<Value> = serde_json::from_slice(&bytes).ok();
        let whole =
            |result: &Value| point.command().is_some_and(|command| command.is_complete(result));
        if result.as_ref().is_some_and(whole) {
            let remark = last.filter(|_| code == Some(STATUS_LOSSY));
            let record = PointRecord::new(point, code.unwrap_or_default(), remark.clone());
            store.finish(point, &record)?;
            return Ok(Ended::Finished(remark));
        }
    }
    if stop.load(Ordering::Relaxed) {
        return Ok(Ended::Interrupted);
    }
    let failure = Failure {
        command_line: point.command_line.clone(),
        reason: reason(status, last.as_deref()),
        task: runner.task.clone(),
    };
    if failure.is_disk_full() {
        return Err(SweepError::DiskFull { path: store.root().to_owned() });
    }
    store.fail(point, &failure)?;
    Ok(Ended::Failed(failure))
}

impl Failure {
    /// Return whether the last line reports a full disk.
    #[must_use]
    pub fn is_disk_full(&self) -> bool {
        self.reason.contains(NO_SPACE) || self.reason.contains("the disk is full")
    }
}

fn reason(status: ExitStatus, last: Option<&str>) -> String {
    if let Some(signal) = signal_of(status) {
        let known = SIGNALS.iter().find(|(number, _)| *number == signal);
        let name = known.map_or_else(|| format!("signal {signal}"), |(_, name)| (*name).to_owned());
        return format!("killed by {name}");
    }
    match (status.code(), last) {
        (Some(STATUS_LOSSY), Some(last)) => format!("ended before completion: {last}"),
        (Some(STATUS_LOSSY), None) => "ended before completion".to_owned(),
        (Some(0), _) => "printed no result document".to_owned(),
        (_, Some(last)) => last.to_owned(),
        (Some(code), None) => format!("status {code} without a message"),
        (None, None) => "no message".to_owned(),
    }
}

#[cfg(unix)]
fn signal_of(status: ExitStatus) -> Option<i32> {
    std::os::unix::process::ExitStatusExt::signal(&status)
}

#[cfg(not(unix))]
fn signal_of(_status: ExitStatus) -> Option<i32> {
    None
}

/// Last line of a log, without its level prefix.
pub(super) fn last_words(path: &Path) -> Option<String> {
    let mut file = File::open(path).ok()?;
    let length = file.metadata().ok()?.len();
    file.seek(io::SeekFrom::Start(length.saturating_sub(LOG_TAIL))).ok()?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).ok()?;
    let text = String::from_utf8_lossy(&bytes);
    let last = text.lines().rev().map(str::trim).find(|line| !line.is_empty())?;
    let last =
        last.strip_prefix("error: ").or_else(|| last.strip_prefix("warning: ")).unwrap_or(last);
    Some(last.to_owned())
}
