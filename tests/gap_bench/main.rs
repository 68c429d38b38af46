//! Blind bench for `klasktron gap`: plants effects in rigs that share no code with the twin, asks the
//! program what is missing, and measures the answers against goals.
//!
//! ```text
//! cargo bench --bench gap_bench -- generate --out CASES [--seed 0] [--cases N | --quick]
//! cargo bench --bench gap_bench -- run --cases CASES --out RESULTS --program target/release/klasktron
//! cargo bench --bench gap_bench -- score --cases CASES --results RESULTS [--out FILE.json]
//! cargo bench --bench gap_bench -- all --out DIR --program target/release/klasktron
//! ```
//!
//! `answers.json` beside the recordings is sealed: only `score` reads it, and the runner for which
//! rig a case belongs to.
#![allow(
    clippy::needless_range_loop,
    reason = "loops over two axes or motors read several arrays by the same index"
)]
#![allow(clippy::print_stdout, reason = "the bench's result is its table")]

mod axis;
mod ball;
mod baseline;
mod cases;
mod catalogue;
mod draw;
mod gantry;
mod generate;
mod linear;
mod observe;
mod plan;
mod record;
mod run;
mod said;
mod score;
mod step;
mod table;
mod truth;
mod visibility;
mod wilson;

use anyhow::Result;
use cases::Extent;
use clap::{Args, Parser, Subcommand};
use std::{collections::BTreeMap, path::PathBuf, time::Duration};

/// Blind bench for `klasktron gap`
#[derive(Parser)]
struct Cli {
    /// Given by `cargo bench`; means nothing here
    #[arg(long, global = true, hide = true)]
    bench: bool,
    #[command(subcommand)]
    task: Option<Task>,
}

#[derive(Subcommand)]
enum Task {
    /// Write recordings and the sealed answers
    Generate(Generate),
    /// Run the program on all cases; goes on where it stopped
    Run(Run),
    /// Measure the goals
    Score(Score),
    /// The three in order, in one folder
    All(All),
}

#[derive(Args)]
struct Extents {
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// About so many cases instead of all
    #[arg(long = "cases", id = "count", value_name = "COUNT", conflicts_with = "quick")]
    cases_count: Option<usize>,
    /// Some forty cases of all classes
    #[arg(long)]
    quick: bool,
    #[arg(long, default_value_t = 2)]
    jobs: usize,
}

impl Extents {
    fn extent(&self) -> Extent {
        match self.cases_count {
            _ if self.quick => Extent::Quick,
            Some(count) => Extent::About(count),
            None => Extent::All,
        }
    }
}

#[derive(Args)]
struct Generate {
    #[arg(long)]
    out: PathBuf,
    #[command(flatten)]
    extents: Extents,
}

#[derive(Args)]
struct Run {
    #[arg(long)]
    cases: PathBuf,
    #[arg(long)]
    out: PathBuf,
    #[arg(long)]
    program: PathBuf,
    #[arg(long, default_value_t = 2)]
    jobs: usize,
    #[arg(long, default_value_t = 300)]
    timeout_s: u64,
}

#[derive(Args)]
struct Score {
    #[arg(long)]
    cases: PathBuf,
    #[arg(long)]
    results: PathBuf,
    /// The table as JSON
    #[arg(long)]
    out: Option<PathBuf>,
}

#[derive(Args)]
struct All {
    #[arg(long)]
    out: PathBuf,
    #[arg(long)]
    program: PathBuf,
    #[arg(long, default_value_t = 300)]
    timeout_s: u64,
    #[command(flatten)]
    extents: Extents,
}

fn main() -> Result<()> {
    let cli = Cli::parse();
    match cli.task {
        // A bare `cargo bench` runs every bench; this one needs to be asked.
        None => Ok(()),
        Some(Task::Generate(args)) => generate_cases(&args),
        Some(Task::Run(args)) => run_cases(&args),
        Some(Task::Score(args)) => score_cases(&args),
        Some(Task::All(args)) => all(args),
    }
}

fn generate_cases(args: &Generate) -> Result<()> {
    let request = generate::Request {
        out: &args.out,
        seed: args.extents.seed,
        extent: args.extents.extent(),
        jobs: args.extents.jobs,
    };
    let answers = generate::generate(&request)?;
    let mut counts = BTreeMap::new();
    for case in answers.cases.values() {
        *counts.entry(case.class).or_insert(0) += 1;
    }
    println!("{} cases on {} rigs", answers.cases.len(), answers.rigs.len());
    for (class, count) in counts {
        println!("  {count:4} {class:?}");
    }
    Ok(())
}

fn run_cases(args: &Run) -> Result<()> {
    let answers = score::read_answers(&args.cases)?;
    let request = run::Request {
        cases: &args.cases,
        results: &args.out,
        program: &args.program,
        jobs: args.jobs,
        timeout: Duration::from_secs(args.timeout_s),
    };
    run::run(&request, &answers)
}

fn score_cases(args: &Score) -> Result<()> {
    let table = table::table(&score::gather(&args.cases, &args.results)?);
    print!("{}", table::render(&table));
    match &args.out {
        Some(path) => generate::write_json(path, &table),
        None => Ok(()),
    }
}

fn all(args: All) -> Result<()> {
    let (cases, results) = (args.out.join("cases"), args.out.join("results"));
    let jobs = args.extents.jobs;
    if !cases.join("answers.json").exists() {
        generate_cases(&Generate { out: cases.clone(), extents: args.extents })?;
    }
    run_cases(&Run {
        cases: cases.clone(),
        out: results.clone(),
        program: args.program,
        jobs,
        timeout_s: args.timeout_s,
    })?;
    score_cases(&Score { cases, results, out: Some(args.out.join("table.json")) })
}
