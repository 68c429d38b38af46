//! What `sweep` and its presets share: the options of an engine, and running a plan by it.

use super::{Outcome, interrupt, note, print, tell, terminal};
use anyhow::{Context as _, bail};
use indicatif::ProgressBar;
use klasktron::{
    parallel,
    provenance::Provenance,
    sweep::{
        Ended, FailedPoint, FolderLock, Merged, Plan, Point, RetryPolicy, Runner, SlurmRequest,
        Store, SweepError, SweepObserver, batch_script, request_faults, run_local, run_slurm,
        tasks_in_queue,
    },
};
use std::{
    collections::BTreeMap,
    fs,
    io::{self, IsTerminal as _},
    path::{Path, PathBuf},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicBool, AtomicUsize, Ordering},
    },
    time::Instant,
};

/// Where points are run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum EngineKind {
    /// As processes of this machine
    Local,
    /// As job arrays of Slurm, over a shared folder
    Slurm,
}

/// Options of the engine.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Where points are run")]
pub(crate) struct EngineArgs {
    /// On this machine, or by Slurm [default: local]
    #[arg(long, value_enum)]
    engine: Option<EngineKind>,
    /// Slurm: the partition
    #[arg(long, value_name = "NAME")]
    partition: Option<String>,
    /// Slurm: time limit of a point, such as 30 (minutes) or 1-12:00:00
    #[arg(long, value_name = "TIME")]
    time: Option<String>,
    /// Slurm: cores of a point [default: 1]
    #[arg(long, value_name = "COUNT", value_parser = clap::value_parser!(u16).range(1..))]
    cores: Option<u16>,
    /// Slurm: memory of a point, such as 4G
    #[arg(long, value_name = "SIZE")]
    mem: Option<String>,
    /// Slurm: a further option of sbatch, such as --sbatch-line=--gres=gpu:1, or a shell line before the program
    #[arg(long, value_name = "LINE", allow_hyphen_values = true)]
    sbatch_line: Vec<String>,
    /// Run failed points again
    #[arg(long)]
    retry: bool,
    /// Print what would be run, and with Slurm the script, and end
    #[arg(long)]
    dry_run: bool,
}

/// What an engine has left.
pub(crate) struct Finished {
    /// Everything that is known of the points.
    pub(crate) merged: Merged,
    /// Why not all points have ended, in words for the person.
    pub(crate) open: Option<String>,
    /// Whether the engine has told every failure.
    told: bool,
}

/// A plan with the place of its results and what its points are run with.
pub(crate) struct Sweep<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) out: PathBuf,
    pub(crate) workers: usize,
}

impl EngineArgs {
    /// Whether anything was said of an engine.
    pub(crate) fn is_given(&self) -> bool {
        let Self { engine, partition, time, cores, mem, sbatch_line, retry, dry_run } = self;
        let words = [partition, time, mem];
        engine.is_some()
            || cores.is_some()
            || !sbatch_line.is_empty()
            || words.iter().any(|word| word.is_some())
            || *retry
            || *dry_run
    }

    pub(crate) fn is_dry_run(&self) -> bool {
        self.dry_run
    }

    pub(crate) fn is_slurm(&self) -> bool {
        self.engine == Some(EngineKind::Slurm)
    }

    fn request(&self, plan: &Plan) -> anyhow::Result<SlurmRequest> {
        let typed = SlurmRequest {
            partition: self.partition.clone(),
            time: self.time.clone(),
            cores: self.cores.map(usize::from),
            mem: self.mem.clone(),
            lines: self.sbatch_line.clone(),
        };
        if !self.is_slurm() && typed != SlurmRequest::default() {
            bail!("--partition, --time, --cores, --mem and --sbatch-line need --engine slurm");
        }
        let request = typed.or(&plan.slurm);
        if let Some(fault) = request_faults(&request) {
            bail!("sbatch cannot be told that: {fault}");
        }
        Ok(request)
    }

    fn retry(&self) -> RetryPolicy {
        if self.retry { RetryPolicy::Again } else { RetryPolicy::Keep }
    }

    /// What would be run, as text.
    pub(crate) fn dry_run(&self, sweep: &Sweep<'_>) -> anyhow::Result<String> {
        let request = self.request(sweep.plan)?;
        let points = &sweep.plan.points;
        let mut lines = Vec::new();
        if self.is_slurm() {
            let runner = self.runner(sweep, &request)?;
            let out = absolute(&sweep.out)?;
            lines.push(batch_script(&out, &runner, &request, sweep.plan.command)?);
        } else {
            lines.extend(points.iter().map(|point| point.command_line.clone()));
        }
        let finished = match sweep.out.join("points").is_dir() {
            true => Store::open(&sweep.out)?.finished(points)?.len(),
            false => 0,
        };
        lines.push(format!("{} points, of which {finished} are finished", points.len()));
        Ok(lines.join("\n"))
    }

    fn runner(&self, sweep: &Sweep<'_>, request: &SlurmRequest) -> anyhow::Result<Runner> {
        let threads = match self.is_slurm() {
            true => request.cores.unwrap_or(1),
            // A worker alone has the machine to itself.
            false => (parallel::cores() / sweep.workers.max(1)).max(1),
        };
        Ok(Runner {
            program: std::env::current_exe().context("cannot find the program itself")?,
            working_folder: sweep.plan.working_folder.clone(),
            threads,
            task: None,
        })
    }

    /// Runs what is not finished of `sweep`, and reads what is.
    pub(crate) fn run(&self, sweep: &Sweep<'_>) -> anyhow::Result<Finished> {
        let request = self.request(sweep.plan)?;
        fs::create_dir_all(&sweep.out)
            .with_context(|| format!("{}: cannot create the folder", sweep.out.display()))?;
        let out = absolute(&sweep.out)?;
        let _lock = FolderLock::take(&out)?;
        let store = Store::open(&out)?;
        let runner = self.runner(sweep, &request)?;
        if self.is_slurm() {
            self.on_slurm(sweep.plan, &store, (&runner, &request))
        } else {
            self.here(sweep, &store, &runner)
        }
    }

    fn here(&self, sweep: &Sweep<'_>, store: &Store, runner: &Runner) -> anyhow::Result<Finished> {
        let plan = sweep.plan;
        refuse_while_queued(store, plan)?;
        let stop =
            interrupt::raised_by_ctrl_c("ending the points under way; finished ones are kept")?;
        let finished = store.finished(&plan.points)?;
        let mut failed = store.failed()?;
        if self.retry() == RetryPolicy::Again {
            plan.points.iter().for_each(|point| store.forget_failure(point));
            failed.clear();
        }
        let open =
            |point: &&Point| !finished.contains(&point.hash) && !failed.contains(&point.hash);
        let todo: Vec<Point> = plan.points.iter().filter(open).cloned().collect();
        let progress = Progress::new(plan.points.len(), plan.points.len() - todo.len());
        if !finished.is_empty() {
            progress.remark(&format!(
                "{} of {} points are kept",
                finished.len(),
                plan.points.len()
            ));
        }
        let ran = run_local(&todo, store, (runner, sweep.workers), stop, &progress);
        progress.bar.finish_and_clear();
        ran?;
        let merged = Merged::read(plan, store, &BTreeMap::new())?;
        let ended = merged.rows.len() + merged.failures.len();
        let open = stop.load(Ordering::Relaxed) && ended < plan.points.len();
        let open = open.then(|| {
            format!(
                "interrupted: {} of {} points are finished; the same command continues",
                merged.rows.len(),
                plan.points.len()
            )
        });
        Ok(Finished { merged, open, told: false })
    }

    fn on_slurm(
        &self,
        plan: &Plan,
        store: &Store,
        with: (&Runner, &SlurmRequest),
    ) -> anyhow::Result<Finished> {
        let stop = interrupt::raised_by_ctrl_c("leaving; the jobs stay with Slurm")?;
        let progress = Progress::new(plan.points.len(), 0);
        let outcome = run_slurm(plan, store, with, self.retry(), (stop, &progress));
        progress.bar.finish_and_clear();
        let outcome = outcome?;
        let merged = Merged::read(plan, store, &outcome.lost)?;
        let open = (0 < outcome.in_queue + outcome.waiting).then(|| {
            let mut text = format!("{} tasks stay with Slurm", outcome.in_queue);
            if 0 < outcome.waiting {
                text.push_str(&format!(
                    " and {} points are still to be submitted",
                    outcome.waiting
                ));
            }
            text.push_str("; come back with the same command");
            if !outcome.jobs.is_empty() {
                text.push_str(&format!(", cancel with: scancel {}", outcome.jobs.join(" ")));
            }
            text
        });
        Ok(Finished { merged, open, told: true })
    }
}

/// Refuses to run points here while tasks of the same sweep are with Slurm.
fn refuse_while_queued(store: &Store, plan: &Plan) -> anyhow::Result<()> {
    match tasks_in_queue(store.root(), plan) {
        // Where no Slurm is, nothing of it can be at work on this machine; claims keep others apart.
        Ok(None | Some((0, _))) | Err(SweepError::NoSlurm { .. }) => Ok(()),
        Ok(Some((tasks, jobs))) => {
            let (path, jobs) = (store.root().to_owned(), jobs.join(" "));
            Err(SweepError::InQueue { path, tasks, jobs }.into())
        }
        Err(error) => Err(error.into()),
    }
}

/// `path` from the root, whether it is there or not.
pub(crate) fn absolute(path: &Path) -> anyhow::Result<PathBuf> {
    std::path::absolute(path).with_context(|| format!("{}: cannot be found", path.display()))
}

/// What goes to stdout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PrintKind {
    /// A table for people.
    Table,
    /// The result document alone.
    Json,
}

impl PrintKind {
    /// Of the flag `--json`.
    pub(crate) fn of_flag(json: &bool) -> Self {
        if *json { Self::Json } else { Self::Table }
    }
}

/// Writes the files of a sweep, with `page` as `index.html`, and says how it went.
pub(crate) fn conclude(
    sweep: &Sweep<'_>,
    finished: &Finished,
    (provenance, page): (&Provenance, &str),
    print_kind: PrintKind,
) -> anyhow::Result<Outcome> {
    let Finished { merged, open, .. } = finished;
    let plan = sweep.plan;
    for warning in &merged.warnings {
        tell(&format!("warning: {warning}"));
    }
    if !finished.told {
        merged.failures.iter().take(MOST_TOLD).for_each(tell_failure);
    }
    match merged.failures.len() {
        0 => {}
        1 => tell("1 point failed; run it again with --retry"),
        count => {
            tell(&format!("{count} points failed, see index.html; run them again with --retry"))
        }
    }
    if let Some(open) = open {
        tell(open);
    }
    // Last, because on a full disk it ends the command.
    merged.write((plan, &Store::open(&sweep.out)?), provenance, page)?;
    if print_kind == PrintKind::Json {
        print(merged.to_json(plan, provenance).trim_end())?;
    } else {
        print(&merged.table(plan))?;
        let out = sweep.out.display();
        print(&format!("wrote table.csv, table.parquet, sweep.json and index.html in {out}"))?;
    }
    let whole = open.is_none() && merged.rows.len() == plan.points.len();
    Ok(if whole { Outcome::Done } else { Outcome::Lossy })
}

/// Failures that are told one by one.
const MOST_TOLD: usize = 20;

/// Says what failed, and where more is said.
fn tell_failure(failed: &FailedPoint) {
    let FailedPoint { title, reason, log, .. } = failed;
    tell(&format!("failed: {title}: {reason}; log {}", log.display()));
}

/// A bar of points on a terminal, lines elsewhere.
struct Progress {
    bar: ProgressBar,
    total: usize,
    ended: AtomicUsize,
    begun: Mutex<BTreeMap<String, Instant>>,
    last: Mutex<String>,
    is_drawn: AtomicBool,
}

impl Progress {
    fn new(total: usize, ended: usize) -> Self {
        let template = "{msg} {wide_bar} {pos}/{len} points, {eta} left";
        let bar = terminal::bar(Some(total as u64), template).with_position(ended as u64);
        Self {
            bar,
            total,
            ended: AtomicUsize::new(ended),
            begun: Mutex::default(),
            last: Mutex::default(),
            is_drawn: AtomicBool::new(io::stderr().is_terminal()),
        }
    }

    fn is_drawn(&self) -> bool {
        self.is_drawn.load(Ordering::Relaxed)
    }
}

impl SweepObserver for Progress {
    fn point_begun(&self, point: &Point) {
        let mut begun = self.begun.lock().unwrap_or_else(PoisonError::into_inner);
        begun.insert(point.hash.clone(), Instant::now());
    }

    fn point_ended(&self, point: &Point, ended: &Ended) {
        let begun = self.begun.lock().unwrap_or_else(PoisonError::into_inner).remove(&point.hash);
        let elapsed_s = begun.map_or(0.0, |begun| begun.elapsed().as_secs_f64());
        let number = self.ended.fetch_add(1, Ordering::Relaxed) + 1;
        let said = match ended {
            Ended::Finished(None) => format!("{elapsed_s:.1} s"),
            Ended::Finished(Some(remark)) => format!("{elapsed_s:.1} s, but {remark}"),
            Ended::Failed(failure) => format!("failed: {}", failure.reason),
            Ended::Interrupted => return,
        };
        self.bar.inc(1);
        if self.is_drawn() && !matches!(ended, Ended::Failed(_)) {
            self.bar.set_message(point.title());
            return;
        }
        let line = format!("[{number}/{}] {}: {said}", self.total, point.title());
        match ended {
            Ended::Failed(_) => self.bar.suspend(|| tell(&line)),
            _ => self.bar.suspend(|| note(&line)),
        }
    }

    fn remark(&self, text: &str) {
        self.bar.suspend(|| tell(text));
    }

    fn remark_progress(&self, text: &str) {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if *last != text {
            self.bar.suspend(|| note(text));
            text.clone_into(&mut last);
        }
    }
}
