//! Runs the program on every baseline and then on every case, as its own process each.
//!
//! `RESULTS/<name>/run.json` is written last, so an interrupted bench goes on where it stopped.

use crate::{generate::write_json, truth::Answers};
use anyhow::{Context as _, Result};
use serde::{Deserialize, Serialize};
use std::{
    fs::{self, File},
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    sync::atomic::{AtomicUsize, Ordering},
    thread,
    time::{Duration, Instant},
};

/// One case in so many is run twice and compared byte by byte.
const REPEAT_EVERY: usize = 12;
/// How often memory and end of a process are looked at.
const LOOK: Duration = Duration::from_millis(15);

/// How a run went.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Outcome {
    pub(crate) wall_s: f64,
    pub(crate) peak_mib: f64,
    /// Exit status; null when it was killed.
    pub(crate) status: Option<i32>,
    pub(crate) timed_out: bool,
    /// Whether a second run gave the same bytes; null when there was none.
    pub(crate) same_bytes: Option<bool>,
}

/// What `run` is asked for.
pub(crate) struct Request<'a> {
    pub(crate) cases: &'a Path,
    pub(crate) results: &'a Path,
    pub(crate) program: &'a Path,
    pub(crate) jobs: usize,
    pub(crate) timeout: Duration,
}

struct Task {
    name: String,
    recordings: [PathBuf; 2],
    twin: Option<PathBuf>,
    repeat: bool,
}

/// Name of the result folder of a rig's baseline.
pub(crate) fn baseline_name(rig: &str) -> String {
    format!("base-{rig}")
}

/// Runs what has not been run yet.
pub(crate) fn run(request: &Request<'_>, answers: &Answers) -> Result<()> {
    fs::create_dir_all(request.results)?;
    let file = |name: String| request.cases.join(name);
    let baselines: Vec<Task> = answers
        .rigs
        .iter()
        .map(|(rig, truth)| Task {
            name: baseline_name(rig),
            recordings: truth.baseline.clone().map(file),
            twin: None,
            repeat: false,
        })
        .collect();
    work(request, &baselines)?;
    let cases: Vec<Task> = answers
        .cases
        .iter()
        .enumerate()
        .map(|(index, (name, case))| Task {
            name: name.clone(),
            recordings: [1, 2].map(|session| file(format!("{name}-{session}.mcap"))),
            twin: Some(request.results.join(baseline_name(&case.rig)).join("out/twin.json")),
            repeat: index % REPEAT_EVERY == 0,
        })
        .collect();
    work(request, &cases)
}

fn work(request: &Request<'_>, tasks: &[Task]) -> Result<()> {
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        let workers: Vec<_> = (0..request.jobs.max(1))
            .map(|_| {
                scope.spawn(|| -> Result<()> {
                    while let Some(task) = tasks.get(next.fetch_add(1, Ordering::Relaxed)) {
                        perform(request, task).with_context(|| format!("run {}", task.name))?;
                    }
                    Ok(())
                })
            })
            .collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("a worker panicked"))
    })
}

fn perform(request: &Request<'_>, task: &Task) -> Result<()> {
    let folder = request.results.join(&task.name);
    let record = folder.join("run.json");
    if record.exists() {
        return Ok(());
    }
    fs::create_dir_all(&folder)?;
    let mut outcome = execute(request, task, &folder.join("out"))?;
    if task.repeat && !outcome.timed_out {
        let again = folder.join("again");
        execute(request, task, &again)?;
        let same = |file: &str| {
            fs::read(folder.join("out").join(file)).ok() == fs::read(again.join(file)).ok()
        };
        outcome.same_bytes = Some(same("gap.json") && same("twin.json"));
        fs::remove_dir_all(&again).ok();
    }
    // Only the document and the twin are needed; traces and pages of some hundred cases are not.
    for heavy in ["gap.mcap", "index.html"] {
        fs::remove_file(folder.join("out").join(heavy)).ok();
    }
    write_json(&record, &outcome)
}

fn execute(request: &Request<'_>, task: &Task, out: &Path) -> Result<Outcome> {
    fs::remove_dir_all(out).ok();
    let mut command = Command::new(request.program);
    command.arg("gap").args(&task.recordings).arg("--out").arg(out);
    if let Some(twin) = task.twin.as_ref().filter(|twin| twin.exists()) {
        command.arg("--twin").arg(twin);
    }
    let log = out.with_extension("log");
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(File::create(log)?);
    let start = now();
    let mut child =
        command.spawn().with_context(|| format!("start {}", request.program.display()))?;
    let mut outcome = Outcome::default();
    loop {
        outcome.peak_mib = outcome.peak_mib.max(peak_mib(&child));
        if let Some(status) = child.try_wait()? {
            outcome.status = status.code();
            break;
        }
        if request.timeout < start.elapsed() {
            child.kill().ok();
            child.wait()?;
            outcome.timed_out = true;
            break;
        }
        thread::sleep(LOOK);
    }
    outcome.wall_s = start.elapsed().as_secs_f64();
    Ok(outcome)
}

fn now() -> Instant {
    Instant::now()
}

/// Peak memory of a living process as the kernel has it; 0 where there is no such file.
fn peak_mib(child: &Child) -> f64 {
    fs::read_to_string(format!("/proc/{}/status", child.id()))
        .ok()
        .and_then(|text| {
            let line = text.lines().find(|line| line.starts_with("VmHWM:"))?;
            line.split_whitespace().nth(1)?.parse::<f64>().ok()
        })
        .map_or(0.0, |kib| kib / 1024.0)
}
