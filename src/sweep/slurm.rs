//! Slurm engine: job arrays of one task per point, over a shared folder.
//!
//! ```text
//! OUT/slurm/sweep.sbatch      the script of every array
//! OUT/slurm/points-001.jsonl  the points of a submission, one per line
//! OUT/slurm/jobs.json         arrays and their lines
//! OUT/slurm/log/JOB_TASK.log  log of a task; .exit has the exit status of its script
//! ```
//!
//! Task k of an array that begins at line n runs line n + k, by `klasktron sweep-task`, which puts
//! the point into the store of the local engine. The submitting process polls the store, and
//! `squeue` for points without a result. It may end and be started again at any time. Accounting is
//! not needed.

mod jobs;
mod scheduler;
mod script;
mod verdict;

pub use jobs::{Jobs, read_task};
pub use script::{batch_script, request_faults};

use super::{FailedPoint, Plan, Point, Store, SweepError, SweepObserver, run::Runner};
use jobs::{Array, Submission, Task, write_list};
use scheduler::{Limits, Scheduler, State, States, Submitted, TaskState};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
    thread,
    time::Duration,
};
use verdict::{Verdict, verdict};

/// Folder of the Slurm files.
pub(super) const SLURM: &str = "slurm";

/// Exit status of a task whose point failed; the store has the reason.
pub const TASK_FAILED: u8 = 1;
/// Exit status of a task that was terminated.
pub const TASK_INTERRUPTED: u8 = 75;
/// Exit status of a task that found the disk full: the error number on Linux.
pub const TASK_DISK_FULL: u8 = 28;
/// Exit status of a script that did not find the program.
pub(crate) const PROGRAM_MISSING: u8 = 127;

/// Resources for Slurm, as typed or from the sweep file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SlurmRequest {
    /// `--partition`
    pub partition: Option<String>,
    /// `--time`, as `sbatch` takes it.
    pub time: Option<String>,
    /// Cores of a task; equal to its threads.
    pub cores: Option<usize>,
    /// `--mem` of a task.
    pub mem: Option<String>,
    /// Options of `sbatch`, or shell lines before the program.
    pub lines: Vec<String>,
}

impl SlurmRequest {
    /// This request, completed by that of `file`.
    #[must_use]
    pub fn or(self, file: &Self) -> Self {
        let lines = if self.lines.is_empty() { file.lines.clone() } else { self.lines };
        Self {
            partition: self.partition.or_else(|| file.partition.clone()),
            time: self.time.or_else(|| file.time.clone()),
            cores: self.cores.or(file.cores),
            mem: self.mem.or_else(|| file.mem.clone()),
            lines,
        }
    }
}

/// State of a sweep on Slurm when this process ends.
#[derive(Debug, Clone, Default)]
pub struct SlurmOutcome {
    /// Points whose task ended without a result, with the reason, by hash.
    pub lost: BTreeMap<String, FailedPoint>,
    /// Number of tasks in Slurm's queue.
    pub in_queue: usize,
    /// Jobs of these tasks, for cancelling.
    pub jobs: Vec<String>,
    /// Number of points not yet submitted because of Slurm's limits.
    pub waiting: usize,
}

/// Range of the polling interval of the queue (s).
const LOOK_S: (f64, f64) = (0.5, 10.0);
/// Number of polls after which a task that Slurm reports as completed, but without a result, is
/// lost: a shared folder may show new files late.
const PATIENT_LOOKS: usize = 20;
/// The same for a task that Slurm reports as failed or no longer knows.
const HASTY_LOOKS: usize = 2;
/// Step in which a wait can be interrupted.
const NAP: Duration = Duration::from_millis(50);

/// The running engine.
struct Engine<'a> {
    plan: &'a Plan,
    store: &'a Store,
    scheduler: Scheduler,
    script: PathBuf,
    folder: PathBuf,
    jobs: Jobs,
    limits: Limits,
    observer: &'a dyn SweepObserver,
}

/// State of all points.
#[derive(Default)]
struct Standing {
    finished: BTreeSet<String>,
    failed: BTreeSet<String>,
    in_queue: BTreeMap<String, TaskState>,
    lost: BTreeMap<String, FailedPoint>,
    /// Points neither submitted nor finished.
    todo: Vec<usize>,
    /// Number of points that Slurm reports as ended, but without a result so far.
    unclear: usize,
}

/// Submit all points that are neither finished nor in Slurm's queue, and follow them until all have
/// ended or `stop` is set. `retry` includes failed and lost points.
///
/// # Errors
/// When Slurm is not available or reports an error, or the store cannot be written.
pub fn run_slurm(
    plan: &Plan,
    store: &Store,
    (runner, request): (&Runner, &SlurmRequest),
    retry: RetryPolicy,
    (stop, observer): (&AtomicBool, &dyn SweepObserver),
) -> Result<SlurmOutcome, SweepError> {
    let folder = store.root().join(SLURM);
    let log = folder.join("log");
    fs::create_dir_all(&log).map_err(SweepError::io(&log, "create the folder"))?;
    let script = folder.join("sweep.sbatch");
    let text = batch_script(store.root(), runner, request, plan.command)?;
    crate::recording::write_bytes(
        &script,
        crate::recording::ExistingFile::Replace,
        text.as_bytes(),
    )?;
    let scheduler = Scheduler;
    let limits = scheduler.limits()?;
    let jobs = Jobs::read(&folder);
    let mut engine = Engine { plan, store, scheduler, script, folder, jobs, limits, observer };
    engine.run(retry, stop)
}

/// Policy for failed and lost points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RetryPolicy {
    /// Keep them as they are.
    Keep,
    /// Run them again.
    Again,
}

/// Tasks of the sweep in `root` that are in Slurm's queue, and their jobs; `None` without any
/// submission.
///
/// # Errors
/// When tasks were submitted and Slurm cannot be queried.
pub fn tasks_in_queue(
    root: &Path,
    plan: &Plan,
) -> Result<Option<(usize, Vec<String>)>, SweepError> {
    let folder = root.join(SLURM);
    let jobs = Jobs::read(&folder);
    if jobs.is_empty() {
        return Ok(None);
    }
    let known: BTreeSet<&String> = plan.points.iter().map(|point| &point.hash).collect();
    let states = Scheduler.states(&jobs.job_ids())?.unwrap_or_default();
    let alive = |task: &Task| states.get(task).is_some_and(|one| one.state.is_alive());
    let tasks: Vec<(String, usize)> = jobs
        .tasks(&folder)
        .into_iter()
        .filter(|(hash, task)| known.contains(hash) && alive(task))
        .map(|(_, task)| task)
        .collect();
    let ids: BTreeSet<String> = tasks.iter().map(|(job, _)| job.clone()).collect();
    Ok(Some((tasks.len(), ids.into_iter().collect())))
}

impl Engine<'_> {
    fn run(&mut self, retry: RetryPolicy, stop: &AtomicBool) -> Result<SlurmOutcome, SweepError> {
        let mut unseen: BTreeMap<String, usize> = BTreeMap::new();
        let mut told: BTreeSet<String> = BTreeSet::new();
        let mut standing = self.look(&mut unseen, LookKind::First)?;
        if retry == RetryPolicy::Again {
            self.forget(&mut standing);
        }
        let mut waited_s = 0.0;
        loop {
            self.tell(&standing, &mut told);
            self.submit(&mut standing)?;
            let open = standing.in_queue.len() + standing.unclear;
            if open == 0 && standing.todo.is_empty() || stop.load(Ordering::Relaxed) {
                return Ok(self.outcome(standing));
            }
            let look_s = (waited_s / 20.0_f64).clamp(LOOK_S.0, LOOK_S.1);
            waited_s += look_s;
            nap(look_s, stop);
            standing = self.look(&mut unseen, LookKind::Again)?;
        }
    }

    /// Read the store, and query the queue for points without a result.
    fn look(
        &self,
        unseen: &mut BTreeMap<String, usize>,
        kind: LookKind,
    ) -> Result<Standing, SweepError> {
        let tasks = self.jobs.tasks(&self.folder);
        // The queue before the store: a task that ends in between has its result.
        let states = match tasks.is_empty() {
            true => Some(States::new()),
            false => self.scheduler.states(&self.jobs.job_ids())?,
        };
        if states.is_none() && kind == LookKind::First {
            self.observer.remark("Slurm's controller does not answer; waiting for it");
        }
        let failed = self.store.failed()?;
        let finished = self.store.finished(&self.plan.points)?;
        let mut standing = Standing { finished, ..Standing::default() };
        for (index, point) in self.plan.points.iter().enumerate() {
            if standing.finished.contains(&point.hash) {
                continue;
            }
            if failed.contains(&point.hash) {
                standing.failed.insert(point.hash.clone());
                continue;
            }
            match (tasks.get(&point.hash), &states) {
                (None, _) => standing.todo.push(index),
                (Some(_), None) => standing.unclear += 1,
                (Some(task), Some(states)) => {
                    let looks = unseen.entry(point.hash.clone()).or_default();
                    self.ask(point, (task, states.get(task)), (looks, kind), &mut standing);
                }
            }
        }
        Ok(standing)
    }

    /// State of `point`, whose task has Slurm's `state`, at poll number `looks` since it was in the
    /// queue.
    fn ask(
        &self,
        point: &Point,
        (task, state): (&Task, Option<&TaskState>),
        (looks, kind): (&mut usize, LookKind),
        standing: &mut Standing,
    ) {
        match verdict(state, &self.log_of(task)) {
            Verdict::InQueue(state) => {
                *looks = 0;
                standing.in_queue.insert(point.hash.clone(), state);
            }
            Verdict::Ended { reason, hasty } => {
                *looks += 1;
                let patience = if hasty { HASTY_LOOKS } else { PATIENT_LOOKS };
                let may_come = match kind {
                    LookKind::Again => *looks <= patience,
                    // On a restart of the engine the shared folder has had time, unless the task
                    // completed a moment ago.
                    LookKind::First => !hasty,
                };
                if may_come {
                    standing.unclear += 1;
                } else {
                    standing.lost.insert(point.hash.clone(), self.lost(point, task, reason));
                }
            }
        }
    }

    fn log_of(&self, (job, task): &Task) -> PathBuf {
        self.folder.join("log").join(format!("{job}_{task}.log"))
    }

    fn lost(&self, point: &Point, task: &Task, reason: String) -> FailedPoint {
        FailedPoint {
            hash: point.hash.clone(),
            title: point.title(),
            reason,
            log: self.log_of(task),
            task: Some(format!("{}_{}", task.0, task.1)),
        }
    }

    /// Schedule failed and lost points again.
    fn forget(&self, standing: &mut Standing) {
        for (index, point) in self.plan.points.iter().enumerate() {
            if standing.failed.remove(&point.hash) || standing.lost.remove(&point.hash).is_some() {
                self.store.forget_failure(point);
                standing.todo.push(index);
            }
        }
        standing.todo.sort_unstable();
    }

    /// Report new failures and the progress.
    fn tell(&self, standing: &Standing, told: &mut BTreeSet<String>) {
        for lost in standing.lost.values().filter(|lost| told.insert(lost.hash.clone())) {
            self.tell_failure("ended without a result", lost);
        }
        for point in self.plan.points.iter().filter(|point| standing.failed.contains(&point.hash)) {
            if told.insert(point.hash.clone())
                && let Some(failure) = self.store.failure(point)
            {
                let failed = FailedPoint::new(point, failure, self.store.failed_log(point));
                self.tell_failure("failed", &failed);
            }
        }
        for (hash, state) in &standing.in_queue {
            if 0 < state.restarts && told.insert(format!("{hash} {}", state.restarts)) {
                let TaskState { job, task, reason, .. } = state;
                self.observer.remark(&format!(
                    "task {job}_{task} was requeued by Slurm, as after the failure of a node \
                     ({reason}); it restarts automatically"
                ));
            }
        }
        self.observer.remark_progress(&progress(self.plan, standing));
    }

    fn tell_failure(&self, what: &str, failed: &FailedPoint) {
        let FailedPoint { title, reason, log, .. } = failed;
        let task = failed.task.as_deref().unwrap_or("-");
        self.observer
            .remark(&format!("task {task} ({title}) {what}: {reason}; log {}", log.display()));
    }

    /// Submit as many scheduled points as Slurm accepts.
    fn submit(&mut self, standing: &mut Standing) -> Result<(), SweepError> {
        let room =
            self.limits.most_tasks.saturating_sub(standing.in_queue.len() + standing.unclear);
        if standing.todo.is_empty() || room == 0 {
            return Ok(());
        }
        let taken: Vec<usize> = standing.todo.iter().copied().take(room).collect();
        let points: Vec<&Point> = taken.iter().map(|index| &self.plan.points[*index]).collect();
        let list = write_list(&self.folder, self.jobs.next_list(), &points)?;
        self.jobs.submissions.push(Submission { list: list.clone(), arrays: Vec::new() });
        let mut offset = 0;
        while offset < points.len() {
            let count = (points.len() - offset).min(self.limits.array_size);
            let list = self.folder.join(&list);
            match self.scheduler.submit(&self.script, &list, (offset, count))? {
                Submitted::Job(job) => self.note(job, (offset, count))?,
                Submitted::Full(said) if 0 < offset + standing.in_queue.len() => {
                    // Slurm accepts no more now; the rest follows when some have ended.
                    self.limits.most_tasks = standing.in_queue.len() + offset;
                    self.observer.remark(&format!("Slurm accepts no more tasks for now: {said}"));
                    break;
                }
                Submitted::Full(said) => {
                    return Err(SweepError::Refused { program: "sbatch", said });
                }
            }
            offset += count;
        }
        standing.todo.drain(..offset);
        for point in points.iter().take(offset) {
            standing.in_queue.insert(point.hash.clone(), TaskState::submitted());
        }
        Ok(())
    }

    /// Record the array of a submission before anything else can happen to this process.
    fn note(&mut self, job: String, (offset, count): (usize, usize)) -> Result<(), SweepError> {
        self.observer.remark(&format!("submitted job {job}: an array of {count}"));
        if let Some(submission) = self.jobs.submissions.last_mut() {
            submission.arrays.push(Array { job, offset, count });
        }
        self.jobs.write(&self.folder)
    }

    fn outcome(&self, standing: Standing) -> SlurmOutcome {
        let tasks = self.jobs.tasks(&self.folder);
        let jobs: BTreeSet<String> = standing
            .in_queue
            .keys()
            .filter_map(|hash| tasks.get(hash).map(|(job, _)| job.clone()))
            .collect();
        SlurmOutcome {
            lost: standing.lost,
            in_queue: standing.in_queue.len() + standing.unclear,
            jobs: jobs.into_iter().collect(),
            waiting: standing.todo.len(),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum LookKind {
    First,
    Again,
}

fn progress(plan: &Plan, standing: &Standing) -> String {
    let running =
        standing.in_queue.values().filter(|one| matches!(one.state, State::Running)).count();
    let waiting = standing.in_queue.len() - running;
    let mut reasons: BTreeMap<&str, usize> = BTreeMap::new();
    for one in standing.in_queue.values().filter(|one| !matches!(one.state, State::Running)) {
        *reasons.entry(one.reason.as_str()).or_default() += 1;
    }
    let why = reasons.into_iter().max_by_key(|(_, count)| *count).map(|(reason, _)| reason);
    let why = why.filter(|why| !why.is_empty() && *why != "None");
    let failed = standing.failed.len() + standing.lost.len();
    let mut text = format!(
        "{} of {} points finished, {running} running, {waiting} waiting",
        standing.finished.len(),
        plan.points.len()
    );
    if let Some(why) = why {
        text.push_str(&format!(" ({why})"));
    }
    if !standing.todo.is_empty() {
        text.push_str(&format!(", {} to submit", standing.todo.len()));
    }
    if 0 < failed {
        text.push_str(&format!(", {failed} failed"));
    }
    text
}

fn nap(seconds: f64, stop: &AtomicBool) {
    let naps = (seconds / NAP.as_secs_f64()).ceil() as usize;
    for _ in 0..naps {
        if stop.load(Ordering::Relaxed) {
            return;
        }
        thread::sleep(NAP);
    }
}
