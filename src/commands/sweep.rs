//! `klasktron sweep`: run the points of a sweep file and merge their results into a table and a page.

use super::{
    Outcome,
    engine::{EngineArgs, PrintKind, Sweep, conclude},
    print,
    reported_command::ReportedCommand,
    tell,
};
use crate::cli::Cli;
use clap::{CommandFactory as _, Parser as _};
use klasktron::{
    parallel,
    provenance::Provenance,
    sweep::{
        Better, CommandLine, Ended, OptionKind, OptionSpec, Plan, Runner, Store, TASK_DISK_FULL,
        TASK_FAILED, TASK_INTERRUPTED, page, quoted, read_file, read_task, run_point,
    },
};
use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// Arguments of `klasktron sweep`.
#[derive(Debug, clap::Args)]
#[command(after_help = "A sweep file:
  command = \"train\"            # or fit-actuator, tune-ekf, gap, eval
  seeds = 3                    # or [4, 7]
  [options]                    # options of every point
  steps = 1e6
  [grid]                       # every combination, the simplest first
  hidden = [[64, 64], [128, 128]]
  curriculum = [\"dense-ball-to-goal\", \"sparse\"]

Examples:
  klasktron sweep width.toml -o width
  klasktron sweep width.toml -o width --engine slurm --partition main --time 30 --mem 2G")]
pub(crate) struct Args {
    /// Sweep file (TOML)
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Folder for points, table.csv, table.parquet, sweep.json and index.html [default: FILE without .toml]
    #[arg(short, long, alias = "out", value_name = "DIR")]
    output: Option<PathBuf>,
    /// Points at a time on this machine; the result does not depend on their number [default: one per core]
    #[arg(long, value_name = "COUNT")]
    workers: Option<NonZeroUsize>,
    /// Metric to compare, a path into the result such as evaluation.opponents.*.win_rate [default: by command]
    #[arg(long, value_name = "FIELD")]
    metric: Option<String>,
    /// Better values of the metric [default: by command; smaller for a --metric]
    #[arg(long, value_name = "smaller|larger")]
    better: Option<Better>,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    engine: EngineArgs,
}

/// Run `klasktron sweep`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let mut file = read_file(&args.file)?;
    if args.metric.is_some() {
        // The direction in the file belongs to the metric of the file.
        (file.metric, file.better) = (args.metric.clone(), None);
    }
    file.better = args.better.or(file.better);
    let options = options_of(file.command.name());
    let plan = Plan::new(&file, &CommandLine { options: &options, check: &refusal })?;
    let out = args.output.clone().unwrap_or_else(|| args.file.with_extension(""));
    let workers = args.workers.map_or_else(parallel::cores, NonZeroUsize::get);
    let sweep = Sweep { plan: &plan, out: out.clone(), workers };
    if args.engine.is_dry_run() {
        print(&args.engine.dry_run(&sweep)?)?;
        return Ok(Outcome::Done);
    }
    let finished = args.engine.run(&sweep)?;
    let provenance = Provenance::new(args.command_line());
    let html = page(&plan, &finished.merged, &provenance);
    conclude(&sweep, &finished, (&provenance, &html), PrintKind::of_flag(&args.json))
}

impl Args {
    /// Command line without output folder and engine, so that equal results are equal files.
    fn command_line(&self) -> String {
        ReportedCommand::new("sweep")
            .words([quoted(&self.file.display().to_string())])
            .options("metric", self.metric.as_deref().map(quoted))
            .options("better", self.better.map(|better| better.name()))
            .into_string()
    }
}

/// Options of a subcommand.
fn options_of(name: &str) -> Vec<OptionSpec> {
    let mut cli = Cli::command();
    cli.build();
    let Some(command) = cli.find_subcommand(name) else { return Vec::new() };
    let visible = command.get_arguments().filter(|argument| !argument.is_hide_set());
    visible
        .filter_map(|argument| {
            let name = argument.get_long()?.to_owned();
            let words = argument.get_num_args().map_or(1, |range| range.min_values());
            let kind = match argument.get_value_delimiter() {
                _ if !argument.get_action().takes_values() => OptionKind::Flag,
                Some(between) => OptionKind::Delimited(between),
                None if 1 < words => OptionKind::Words(words),
                None => OptionKind::One,
            };
            Some(OptionSpec { name, kind })
        })
        .collect()
}

/// Check that the command line takes `words`.
///
/// # Errors
/// First sentence of the usage error.
fn refusal(words: &[String]) -> Result<(), String> {
    let typed = std::iter::once("klasktron").chain(words.iter().map(String::as_str));
    Cli::try_parse_from(typed).map(drop).map_err(|error| {
        let text = error.to_string();
        let first = text.split("\n\n").next().unwrap_or_default();
        let words: Vec<&str> = first.split_whitespace().collect();
        words.join(" ").trim_start_matches("error: ").to_owned()
    })
}

/// Arguments of `klasktron sweep-task`, which Slurm starts.
#[derive(Debug, clap::Args)]
pub(crate) struct TaskArgs {
    /// Folder of the sweep
    #[arg(long, alias = "out")]
    output: PathBuf,
    /// List of points
    #[arg(long)]
    list: PathBuf,
    /// Line of the list, from 0
    #[arg(long)]
    line: usize,
    /// Array and task
    #[arg(long)]
    task: String,
    /// Threads
    #[arg(long)]
    threads: usize,
}

/// Run `klasktron sweep-task`: one point of a list.
pub(crate) fn run_task(args: &TaskArgs) -> anyhow::Result<Outcome> {
    let stop = super::interrupt::raised_by_ctrl_c("stopping the point")?;
    let point = read_task(&args.list, args.line)?;
    let runner = Runner {
        program: std::env::current_exe()?,
        working_folder: std::env::current_dir()?,
        threads: args.threads,
        task: Some(args.task.clone()),
    };
    tell(&format!("task {}: {}", args.task, point.command_line));
    match run_task_point(&args.output, &point, &runner, stop) {
        Ok(Ended::Finished(remark)) => {
            tell(
                &remark.map_or_else(
                    || "finished".to_owned(),
                    |remark| format!("finished, but {remark}"),
                ),
            );
            Ok(Outcome::Done)
        }
        Ok(Ended::Failed(failure)) => {
            tell(&format!("error: {}", failure.reason));
            Ok(Outcome::Task(TASK_FAILED))
        }
        Ok(Ended::Interrupted) => {
            tell("error: interrupted before the point was finished");
            Ok(Outcome::Task(TASK_INTERRUPTED))
        }
        Err(error) if error.is_disk_full() => {
            tell(&format!("error: {error}"));
            Ok(Outcome::Task(TASK_DISK_FULL))
        }
        Err(error) => Err(error.into()),
    }
}

fn run_task_point(
    out: &Path,
    point: &klasktron::sweep::Point,
    runner: &Runner,
    stop: &std::sync::atomic::AtomicBool,
) -> Result<Ended, klasktron::sweep::SweepError> {
    run_point(point, &Store::open(out)?, runner, stop)
}
