//! `klasktron demo`: run every command of the pipeline on the virtual rig, and write the page of the results.

use super::{
    Outcome,
    interrupt::{self, Interrupted},
    note, print,
    table::{BUS_VARIABLE, CAMERA_VARIABLE, ROBOT_VARIABLE},
};
use anyhow::{Context as _, bail};
use klasktron::{
    demo::{Estimate, Experiment, Plan, Record, Size, Step, Story, begin, page, pictures},
    parallel::{cores, in_order_of_needs},
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

/// Exit statuses of a finished step: success, or finished with a loss or a failed check.
const DONE: [i32; 2] = [0, 3];

/// Arguments of `klasktron demo`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  klasktron demo --quick
  klasktron demo -o story")]
pub(crate) struct Args {
    /// Fewer data, training steps and matches
    #[arg(long)]
    quick: bool,
    /// Run every command with the least work, for tests; the results mean nothing
    #[arg(long, hide = true, conflicts_with = "quick")]
    smallest: bool,
    /// Seed of all random numbers
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(..1_000_000_000))]
    seed: u64,
    /// Folder for recordings, results and index.html
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "demo")]
    output: PathBuf,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
}

/// Running demo.
struct Demo<'a> {
    folder: &'a Path,
    program: PathBuf,
    stop: &'static AtomicBool,
    total: usize,
}

/// Step with its number, the hash of its inputs and its threads.
struct Task<'a> {
    step: &'a Step,
    key: &'a str,
    number: usize,
    threads: usize,
}

/// Run `klasktron demo`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let size = args.size();
    let plan = Plan::new(size, args.seed);
    let stop = interrupt::raised_by_ctrl_c("stopping the demo; finished steps are kept")?;
    let program = std::env::current_exe().context("cannot find the program itself")?;
    let total = plan.steps().count();
    let demo = Demo { folder: &args.output, program, stop, total };
    demo.prepare(&plan)?;
    note(&format!(
        "{total} commands in {}; about {:.0} min on two cores; finished steps are kept",
        args.output.display(),
        size.expected_minutes()
    ));
    let records = demo.records(&plan)?;
    let results =
        records.iter().map(|(name, record)| (name.clone(), record.result.clone())).collect();
    let experiment = Experiment::new(&results);
    let provenance = Provenance::new(args.command_line());
    let html = page(&Story {
        plan: &plan,
        records: &records,
        experiment: experiment.as_ref(),
        pictures: &pictures(&args.output),
        provenance: &provenance,
    });
    let document = document(&records, experiment.as_ref(), &provenance);
    let text = serde_json::to_string_pretty(&document)?;
    write_bytes(&args.output.join("demo.json"), ExistingFile::Replace, text.as_bytes())?;
    write_bytes(&args.output.join("index.html"), ExistingFile::Replace, html.as_bytes())?;
    if args.json {
        print(&text)?;
    } else {
        print(&table(experiment.as_ref()))?;
        print(&format!("wrote {}", args.output.join("index.html").display()))?;
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

    /// Command line without the output folder.
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
    /// Create the folders and the input files of the commands.
    fn prepare(&self, plan: &Plan) -> anyhow::Result<()> {
        for folder in ["steps", "rigs", "matches", "simulated"] {
            let path = self.folder.join(folder);
            fs::create_dir_all(&path)
                .with_context(|| format!("{}: cannot create the folder", path.display()))?;
        }
        for (name, text) in &plan.files {
            write_bytes(&self.folder.join(name), ExistingFile::Replace, text.as_bytes())?;
        }
        Ok(())
    }

    /// Run the steps that are not finished, and return the records of all.
    fn records(&self, plan: &Plan) -> anyhow::Result<BTreeMap<String, Record>> {
        let keys = plan.keys();
        let steps: Vec<&Step> = plan.steps().collect();
        let done = in_order_of_needs(cores(), &plan.needs(), |at, threads| {
            self.record(&Task { step: steps[at], key: &keys[at], number: at + 1, threads })
        })?;
        Ok(steps.iter().map(|step| step.name.clone()).zip(done).collect())
    }

    fn record(&self, task: &Task<'_>) -> anyhow::Result<Record> {
        let Task { step, key, number, threads } = task;
        if self.stop.load(Ordering::Relaxed) {
            return Err(interrupted(*number));
        }
        let heading = format!("[{number}/{}] {}", self.total, step.name);
        if let Some(record) = Record::read(self.folder, step, key) {
            note(&format!("{heading}: kept"));
            return Ok(record);
        }
        let again = begin(self.folder, &step.name, key)?;
        let mut arguments = if again { step.resumed() } else { step.arguments.clone() };
        if step.is_threaded() {
            arguments.extend(["--threads".to_owned(), threads.to_string()]);
            let plural = if *threads == 1 { "" } else { "s" };
            note(&format!("{heading}: begins on {threads} thread{plural}"));
        }
        log::info!("klasktron {}", arguments.join(" "));
        let start = Instant::now();
        let output = self.output(&arguments)?;
        let elapsed_s = start.elapsed().as_secs_f64();
        self.keep_log(&step.name, &output)?;
        let status = output.status.code().unwrap_or(-1);
        if self.stop.load(Ordering::Relaxed) {
            return Err(interrupted(*number));
        }
        if !DONE.contains(&status) {
            bail!("{}", failure(step, &output));
        }
        let result: Value = serde_json::from_slice(&output.stdout)
            .with_context(|| format!("`{}` printed no JSON", step.line()))?;
        // A session that has stopped early lacks data that later steps need.
        if result["stop"].as_str().is_some_and(|stop| stop != SESSION_COMPLETED) {
            bail!(
                "`{}` has stopped early: {}",
                step.line(),
                result["stop_text"].as_str().unwrap_or("-")
            );
        }
        let command_line = step.line();
        let record = Record { key: (*key).to_owned(), command_line, status, elapsed_s, result };
        record.write(self.folder, &step.name)?;
        note(&format!("{heading}: {elapsed_s:.1} s"));
        Ok(record)
    }

    /// Run this program in the folder of the demo.
    fn output(&self, arguments: &[String]) -> anyhow::Result<Output> {
        Command::new(&self.program)
            .args(arguments)
            // The page shows the steps as they are: no settings file and no environment may change them.
            .arg("--no-config")
            .env_remove(BUS_VARIABLE)
            .env_remove(CAMERA_VARIABLE)
            .env_remove(ROBOT_VARIABLE)
            .current_dir(self.folder)
            .output()
            .with_context(|| format!("{}: cannot be started", self.program.display()))
    }

    /// Write the step's stderr to its log.
    fn keep_log(&self, name: &str, output: &Output) -> anyhow::Result<()> {
        let path = self.folder.join("steps").join(format!("{name}.log"));
        Ok(write_bytes(&path, ExistingFile::Replace, &output.stderr)?)
    }
}

/// Error of a failed step, with the path of its log.
fn failure(step: &Step, output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("no message");
    let last = last.trim_start_matches("error: ");
    format!("`{}` failed: {last}; see steps/{}.log", step.line(), step.name)
}

/// Report of a demo that Ctrl-C has ended at step `number`.
fn interrupted(number: usize) -> anyhow::Error {
    Interrupted(format!("interrupted at step {number}; the same command continues with this step"))
        .into()
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

/// Result of the experiment as a table.
fn table(experiment: Option<&Experiment>) -> String {
    let Some(experiment) = experiment else {
        return "the results do not contain the data of the comparison".to_owned();
    };
    let mut lines = vec![format!(
        "{:<15}{:<12}{:>22}{:>14}{:>16}",
        "policy", "opponent", "goals per min, sim", "on the rig", "transfer ratio"
    )];
    for one in &experiment.contests {
        let ratio = one.transfer_ratio.map(|ratio| format!("{:.0} %", 1e2 * ratio.value));
        lines.push(format!(
            "{:<15}{:<12}{:>22.2}{:>14.2}{:>16}",
            one.policy,
            one.opponent,
            one.simulated_goals_per_min.value,
            one.goals_per_min.value,
            ratio.unwrap_or_else(|| "-".to_owned())
        ));
    }
    for (policy, ratio) in &experiment.transfer_ratios {
        let Estimate { value, ci95 } = ratio;
        let range =
            ci95.map(|ci| format!(" (95 %: {:.0} to {:.0} %)", 1e2 * ci.low, 1e2 * ci.high));
        let range = range.unwrap_or_default();
        lines.push(format!("transfer ratio of {policy}: {:.0} %{range}", 1e2 * value));
    }
    for one in &experiment.differences {
        lines.push(format!("{} against {}: {}", one.better, one.worse, one.summary()));
    }
    lines.join("\n")
}
