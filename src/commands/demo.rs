//! `klasktron demo`: every command of the pipeline, one after the other, and the page that tells it.

use super::{Outcome, interrupt, note, print};
use anyhow::{Context as _, bail};
use klasktron::{
    demo::{Experiment, Plan, Record, Size, Stage, Step, Story, begin, page, pictures},
    parallel::{cores, in_parallel_on},
    provenance::Provenance,
    recording::{ExistingFile, SESSION_COMPLETED, write_bytes},
};
use serde_json::{Value, json};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::atomic::{AtomicBool, Ordering},
    time::Instant,
};

/// Exit statuses of a step that has done its work: done, or something was lost or a gate was not met.
const DONE: [i32; 2] = [0, 3];

/// What can be typed after `klasktron demo`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron demo --quick
  klasktron demo --out story")]
pub(crate) struct Args {
    /// Less of everything: some four minutes on two cores
    #[arg(long)]
    quick: bool,
    /// Every command once, with results that mean nothing: for tests
    #[arg(long, hide = true, conflicts_with = "quick")]
    smallest: bool,
    /// Everything random comes from it
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(..1_000_000_000))]
    seed: u64,
    /// Folder for recordings, results and index.html
    #[arg(short, long, value_name = "DIR", default_value = "demo")]
    out: PathBuf,
    /// Print the result document alone on stdout
    #[arg(long)]
    json: bool,
}

/// The demo under way.
struct Demo<'a> {
    folder: &'a Path,
    program: PathBuf,
    stop: &'static AtomicBool,
    total: usize,
}

/// A step with the hash of what it depends on, and its number.
struct Task<'a> {
    step: &'a Step,
    key: &'a str,
    number: usize,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let size = args.size();
    let plan = Plan::new(size, args.seed);
    let stop = interrupt::raised_by_ctrl_c("ending the demo")?;
    let program = std::env::current_exe().context("cannot find the program itself")?;
    let total = plan.stages.iter().map(|stage| stage.steps.len()).sum();
    let demo = Demo { folder: &args.out, program, stop, total };
    demo.prepare(&plan)?;
    note(&format!(
        "{total} commands in {}; about {:.0} min on two cores, and what is finished is kept",
        args.out.display(),
        size.expected_minutes()
    ));
    let mut records = BTreeMap::new();
    let mut number = 0;
    for (stage, keys) in plan.stages.iter().zip(plan.keys()) {
        records.extend(demo.stage(stage, &keys, number)?);
        number += stage.steps.len();
    }
    let results =
        records.iter().map(|(name, record)| (name.clone(), record.result.clone())).collect();
    let experiment = Experiment::new(&results);
    let provenance = Provenance::new(args.command_line());
    let html = page(&Story {
        plan: &plan,
        records: &records,
        experiment: experiment.as_ref(),
        pictures: &pictures(&args.out),
        provenance: &provenance,
    });
    let document = document(&records, experiment.as_ref(), &provenance);
    let text = serde_json::to_string_pretty(&document)?;
    write_bytes(&args.out.join("demo.json"), ExistingFile::Replace, text.as_bytes())?;
    write_bytes(&args.out.join("index.html"), ExistingFile::Replace, html.as_bytes())?;
    if args.json {
        print(&text)?;
    } else {
        print(&table(experiment.as_ref()))?;
        print(&format!("wrote {}", args.out.join("index.html").display()))?;
    }
    Ok(if experiment.is_some() { Outcome::Done } else { Outcome::Lossy })
}

impl Args {
    fn size(&self) -> Size {
        match (self.quick, self.smallest) {
            (true, _) => Size::Quick,
            (false, true) => Size::Smallest,
            (false, false) => Size::Full,
        }
    }

    /// The command without the place of its results.
    fn command_line(&self) -> String {
        let size = match self.size() {
            Size::Quick => " --quick",
            Size::Full => "",
            Size::Smallest => " --smallest",
        };
        format!("klasktron demo{size} --seed {}", self.seed)
    }
}

impl Demo<'_> {
    /// Folders, and the files that the commands name.
    fn prepare(&self, plan: &Plan) -> anyhow::Result<()> {
        for folder in ["steps", "rigs", "matches"] {
            let path = self.folder.join(folder);
            fs::create_dir_all(&path)
                .with_context(|| format!("{}: cannot create the folder", path.display()))?;
        }
        for (name, text) in &plan.files {
            write_bytes(&self.folder.join(name), ExistingFile::Replace, text.as_bytes())?;
        }
        Ok(())
    }

    /// The records of a stage: those that are there, and those of what is still to be run.
    fn stage(
        &self,
        stage: &Stage,
        keys: &[String],
        before: usize,
    ) -> anyhow::Result<Vec<(String, Record)>> {
        let tasks: Vec<Task<'_>> = stage
            .steps
            .iter()
            .zip(keys)
            .zip(before + 1..)
            .map(|((step, key), number)| Task { step, key, number })
            .collect();
        let threads = if stage.side_by_side { cores() } else { 1 };
        let done = in_parallel_on(threads, &tasks, |task| self.record(task));
        let named = tasks.iter().zip(done).map(|(task, done)| Ok((task.step.name.clone(), done?)));
        named.collect()
    }

    fn record(&self, task: &Task<'_>) -> anyhow::Result<Record> {
        let Task { step, key, number } = task;
        if self.stop.load(Ordering::Relaxed) {
            bail!("interrupted before step {number}; the same command goes on from there");
        }
        let heading = format!("[{number}/{}] {}", self.total, step.name);
        if let Some(record) = Record::read(self.folder, step, key) {
            note(&format!("{heading}: kept"));
            return Ok(record);
        }
        let again = begin(self.folder, &step.name, key)?;
        let arguments = if again { step.resumed() } else { step.arguments.clone() };
        log::info!("klasktron {}", arguments.join(" "));
        let start = Instant::now();
        let output = self.output(&arguments)?;
        let elapsed_s = start.elapsed().as_secs_f64();
        self.keep_log(&step.name, &output)?;
        let status = output.status.code().unwrap_or(-1);
        if self.stop.load(Ordering::Relaxed) {
            bail!("interrupted in step {number}; the same command goes on from there");
        }
        if !DONE.contains(&status) {
            bail!("{}", failure(step, &output));
        }
        let result: Value = serde_json::from_slice(&output.stdout)
            .with_context(|| format!("`{}` printed no JSON", step.line()))?;
        // A session that has stopped early is lossy too, but what it lacks is needed.
        if result["stop"].as_str().is_some_and(|stop| stop != SESSION_COMPLETED) {
            bail!("`{}` has stopped: {}", step.line(), result["stop_text"].as_str().unwrap_or("-"));
        }
        let command_line = step.line();
        let record = Record { key: (*key).to_owned(), command_line, status, elapsed_s, result };
        record.write(self.folder, &step.name)?;
        note(&format!("{heading}: {elapsed_s:.1} s"));
        Ok(record)
    }

    /// Runs this program in the folder of the demo.
    fn output(&self, arguments: &[String]) -> anyhow::Result<Output> {
        Command::new(&self.program)
            .args(arguments)
            // The steps are what stands on the page, whatever lies in that folder.
            .arg("--no-config")
            .current_dir(self.folder)
            .output()
            .with_context(|| format!("{}: cannot be started", self.program.display()))
    }

    /// What the step said beside its result.
    fn keep_log(&self, name: &str, output: &Output) -> anyhow::Result<()> {
        let path = self.folder.join("steps").join(format!("{name}.log"));
        Ok(write_bytes(&path, ExistingFile::Replace, &output.stderr)?)
    }
}

/// The step's own last words, and how to see more.
fn failure(step: &Step, output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("it said nothing");
    let last = last.trim_start_matches("error: ");
    format!("`{}` failed: {last}; its log is steps/{}.log", step.line(), step.name)
}

fn document(
    records: &BTreeMap<String, Record>,
    experiment: Option<&Experiment>,
    provenance: &Provenance,
) -> Value {
    let steps: Vec<Value> = records
        .iter()
        .map(|(name, record)| {
            json!({
                "name": name,
                "command_line": record.command_line,
                "status": record.status,
                "elapsed_s": record.elapsed_s,
            })
        })
        .collect();
    json!({
        "schema_version": 1,
        "experiment": experiment,
        "steps": steps,
        "provenance": provenance,
    })
}

/// The experiment for people.
fn table(experiment: Option<&Experiment>) -> String {
    let Some(experiment) = experiment else {
        return "the results do not hold what the comparison needs".to_owned();
    };
    let mut lines = vec![format!(
        "{:<12}{:<12}{:>22}{:>14}{:>8}",
        "policy", "against", "points per min, sim", "on the rig", "kept"
    )];
    for one in &experiment.contests {
        let kept = one.transfer_ratio.map(|kept| format!("{:.0} %", 1e2 * kept.value));
        lines.push(format!(
            "{:<12}{:<12}{:>22.2}{:>14.2}{:>8}",
            one.policy,
            one.opponent,
            one.simulated_goals_per_min.value,
            one.goals_per_min.value,
            kept.unwrap_or_else(|| "-".to_owned())
        ));
    }
    for one in &experiment.differences {
        lines.push(format!("{} against {}: {}", one.better, one.worse, one.summary()));
    }
    lines.join("\n")
}
