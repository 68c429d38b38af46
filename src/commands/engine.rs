//! Engines that run the points of a plan, for `sweep` and its presets: options, run and report.

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

/// Engine that runs the points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum EngineKind {
    /// Processes on this machine
    Local,
    /// Job arrays of Slurm, over a shared folder
    Slurm,
}

/// Options of the engine.
#[derive(Debug, Clone, Default, clap::Args)]
#[command(next_help_heading = "Engine")]
pub(crate) struct EngineArgs {
    /// Engine of the points [default: local]
    #[arg(long, value_enum)]
    engine: Option<EngineKind>,
    /// Slurm: partition
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
    /// Slurm: another option of sbatch, such as --sbatch-line=--gres=gpu:1, or a shell line before the program
    #[arg(long, value_name = "LINE", allow_hyphen_values = true)]
    sbatch_line: Vec<String>,
    /// Run failed points again
    #[arg(long)]
    retry: bool,
    /// Print the command lines or the Slurm script and exit
    #[arg(long)]
    dry_run: bool,
}

/// State of a sweep after an engine.
pub(crate) struct Finished {
    /// Results and failures of the points.
    pub(crate) merged: Merged,
    /// Sentence on the points that have not ended.
    pub(crate) open: Option<String>,
    /// `true` where the engine has reported every failure.
    told: bool,
}

/// Plan with its output folder and the number of workers.
pub(crate) struct Sweep<'a> {
    pub(crate) plan: &'a Plan,
    pub(crate) out: PathBuf,
    pub(crate) workers: usize,
}

impl EngineArgs {
    /// Return whether an option of the engine was given.
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
            bail!("sbatch does not take this: {fault}");
        }
        Ok(request)
    }

    fn retry(&self) -> RetryPolicy {
        if self.retry { RetryPolicy::Again } else { RetryPolicy::Keep }
    }

    /// Text of a dry run.
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
            // A single worker may use the whole machine.
            false => (parallel::cores() / sweep.workers.max(1)).max(1),
        };
        Ok(Runner {
            program: std::env::current_exe().context("cannot find the program itself")?,
            working_folder: sweep.plan.working_folder.clone(),
            threads,
            task: None,
        })
    }

    /// Run the points of `sweep` that are not finished, and read the results of all.
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
            interrupt::raised_by_ctrl_c("stopping the running points; finished ones are kept")?;
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
                "{} of {} points are finished already",
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
        let stop = interrupt::raised_by_ctrl_c("leaving the jobs with Slurm")?;
        let progress = Progress::new(plan.points.len(), 0);
        let outcome = run_slurm(plan, store, with, self.retry(), (stop, &progress));
        progress.bar.finish_and_clear();
        let outcome = outcome?;
        let merged = Merged::read(plan, store, &outcome.lost)?;
        let open = (0 < outcome.in_queue + outcome.waiting).then(|| {
            let mut text = format!("{} tasks remain with Slurm", outcome.in_queue);
            if 0 < outcome.waiting {
                text.push_str(&format!(
                    " and {} points are still to be submitted",
                    outcome.waiting
                ));
            }
            text.push_str("; the same command continues");
            if !outcome.jobs.is_empty() {
                text.push_str(&format!("; cancel them with: scancel {}", outcome.jobs.join(" ")));
            }
            text
        });
        Ok(Finished { merged, open, told: true })
    }
}

/// Refuse to run points on this machine while Slurm has tasks of the same sweep.
fn refuse_while_queued(store: &Store, plan: &Plan) -> anyhow::Result<()> {
    match tasks_in_queue(store.root(), plan) {
        // Without Slurm on this machine the claims of the points keep other engines apart.
        Ok(None | Some((0, _))) | Err(SweepError::NoSlurm { .. }) => Ok(()),
        Ok(Some((tasks, jobs))) => {
            let (path, jobs) = (store.root().to_owned(), jobs.join(" "));
            Err(SweepError::InQueue { path, tasks, jobs }.into())
        }
        Err(error) => Err(error.into()),
    }
}

/// Absolute path of `path`, which need not exist.
pub(crate) fn absolute(path: &Path) -> anyhow::Result<PathBuf> {
    std::path::absolute(path)
        .with_context(|| format!("{}: cannot find the absolute path", path.display()))
}

/// Form of the result on stdout.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PrintKind {
    /// Table.
    Table,
    /// Result document.
    Json,
}

impl PrintKind {
    /// Form for the flag `--json`.
    pub(crate) fn of_flag(json: &bool) -> Self {
        if *json { Self::Json } else { Self::Table }
    }
}

/// Write the files of a sweep, with `page` as `index.html`, and print its result.
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
    // Last, because a full disk ends the command here.
    merged.write((plan, &Store::open(&sweep.out)?), provenance, page)?;
    if print_kind == PrintKind::Json {
        print(merged.to_json(plan, provenance).trim_end())?;
    } else {
        print(&merged.table(plan))?;
        let out = sweep.out.display();
        print(&format!("wrote table.csv, table.parquet, sweep.json and index.html in {out}"))?;
    }
    let whole = open.is_none() && merged.rows.len() == plan.points.len();
    Ok(match (whole, open.is_some() && interrupt::is_raised()) {
        (true, _) => Outcome::Done,
        (false, true) => Outcome::Interrupted,
        (false, false) => Outcome::Lossy,
    })
}

/// Largest number of failures that are reported one by one.
const MOST_TOLD: usize = 20;

/// Print the reason of a failure and the path of its log.
fn tell_failure(failed: &FailedPoint) {
    let FailedPoint { title, reason, log, .. } = failed;
    tell(&format!("failed: {title}: {reason}; see {}", log.display()));
}

/// Progress of the points: a bar on a terminal, lines elsewhere.
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
