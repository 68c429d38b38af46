//! `klasktron eval`: score of recorded matches.

use super::{
    Outcome, loss_sentence_of, print,
    reported_command::ReportedCommand,
    results::{OverwriteArgs, Results},
    tell, terminal,
};
use anyhow::{Context as _, bail};
use klasktron::{
    parallel,
    provenance::Provenance,
    recording::{ExistingFile, files_in, table::ColumnFormat, write_bytes},
    referee::{
        EVENTS_FILE, Figure, Group, Metric, Rules, Score, ScoredMatch, analyze_matches, compare,
        page, write_episodes, write_events,
    },
};
use std::{
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// Files that the command writes.
const FILES: [&str; 5] =
    ["score.json", EVENTS_FILE, "episodes.csv", "episodes.parquet", "index.html"];

/// Arguments of `klasktron eval`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron eval match.mcap -o eval\n  klasktron eval --compare simulated hardware -o eval"
)]
pub(crate) struct Args {
    /// Recordings with /camera/detections or /board/state, or folders of .mcap files
    #[arg(value_name = "MATCH", required_unless_present = "compare")]
    matches: Vec<PathBuf>,
    /// Compare two groups of matches, each a recording or a folder of them
    #[arg(long, num_args = 2, value_names = ["A", "B"], conflicts_with = "matches")]
    compare: Vec<PathBuf>,
    /// Folder for score.json, events.mcap, episodes.csv, episodes.parquet and index.html
    #[arg(short, long, alias = "out", value_name = "DIR", default_value = "eval")]
    output: PathBuf,
    #[command(flatten)]
    overwrite: OverwriteArgs,
    /// Seed of the bootstrap and the permutation test
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads; the result does not depend on their number [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Print only the result document, on stdout
    #[arg(long)]
    json: bool,
}

/// Group of matches that the arguments name.
struct Listed {
    name: String,
    files: Vec<PathBuf>,
}

/// Scored matches.
struct Scored {
    /// Matches in the order of the arguments.
    matches: Vec<ScoredMatch>,
    /// Name and number of matches of each group.
    groups: Vec<(String, usize)>,
    /// Errors of the matches that could not be scored.
    errors: Vec<String>,
}

/// Run `klasktron eval`.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let listed = args.listed()?;
    let results = Results::begin(&args.output, &FILES, args.overwrite)?;
    let scored = score_matches(args, listed)?;
    let score = score_of(&scored, args.seed);
    let matches = &scored.matches;
    let provenance = Provenance::new(args.command_line());
    let json = serde_json::to_string_pretty(&score)?;
    let replace = ExistingFile::Replace;
    write_bytes(&results.path("score.json"), replace, json.as_bytes())?;
    write_events(matches, &provenance, args.seed, &results.path(EVENTS_FILE))?;
    write_episodes(&score, &results.path("episodes.csv"), ColumnFormat::Csv)?;
    write_episodes(&score, &results.path("episodes.parquet"), ColumnFormat::Parquet)?;
    let html = page(matches, &score, &scored.errors, &provenance);
    write_bytes(&results.path("index.html"), replace, html.as_bytes())?;
    results.finish()?;
    print(&if args.json { json } else { table(&score, &args.output) })?;
    for warning in &score.warnings {
        tell(&format!("warning: {warning}"));
    }
    let whole = scored.errors.is_empty()
        && score.warnings.is_empty()
        && matches.iter().all(|scored| scored.loss.is_none());
    Ok(if whole { Outcome::Done } else { Outcome::Lossy })
}

impl Args {
    fn listed(&self) -> anyhow::Result<Vec<Listed>> {
        if self.compare.is_empty() {
            let files: Vec<Vec<PathBuf>> =
                self.matches.iter().map(|path| files_of(path)).collect::<anyhow::Result<_>>()?;
            return Ok(vec![Listed { name: "all".to_owned(), files: files.concat() }]);
        }
        let group = |path: &PathBuf| {
            Ok(Listed { name: path.display().to_string(), files: files_of(path)? })
        };
        self.compare.iter().map(group).collect()
    }

    /// Command line without the output folder, so that equal results are equal files.
    fn command_line(&self) -> String {
        ReportedCommand::new("eval")
            .words((!self.compare.is_empty()).then_some("--compare"))
            .words(self.matches.iter().chain(&self.compare).map(|path| path.display()))
            .option("seed", self.seed)
            .into_string()
    }
}

/// Return the file itself, or every MCAP file of a folder in the order of their names.
fn files_of(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let folder = path.display();
    let files = files_in(path).with_context(|| format!("{folder}: cannot read"))?;
    if files.is_empty() {
        bail!("{folder}: no .mcap file in this folder; name the recordings or another folder");
    }
    Ok(files)
}

fn score_matches(args: &Args, listed: Vec<Listed>) -> anyhow::Result<Scored> {
    let files: Vec<PathBuf> = listed.iter().flat_map(|group| group.files.clone()).collect();
    let template = "{wide_bar} {pos}/{len} matches, {eta} left";
    let bar = terminal::bar(Some(files.len() as u64), template);
    let threads = args.threads.map_or_else(parallel::cores, NonZeroUsize::get);
    let results = analyze_matches(&files, &Rules::default(), threads, &|| bar.inc(1));
    bar.finish_and_clear();
    let mut results = results.into_iter();
    let mut scored = Scored { matches: Vec::new(), groups: Vec::new(), errors: Vec::new() };
    for group in listed {
        let before = scored.matches.len();
        for result in results.by_ref().take(group.files.len()) {
            match result {
                Ok(own) => {
                    if !own.loss.is_none() {
                        tell(&format!("warning: {}", loss_sentence_of(&own.path, &own.loss)));
                    }
                    scored.matches.push(own);
                }
                // The error of a single file is the error of the command.
                Err(error) if files.len() == 1 => return Err(error.into()),
                Err(error) => {
                    tell(&format!("error: {error}"));
                    scored.errors.push(error.to_string());
                }
            }
        }
        let count = scored.matches.len() - before;
        if count == 0 {
            bail!("none of the {} matches of {} could be scored", group.files.len(), group.name);
        }
        scored.groups.push((group.name, count));
    }
    Ok(scored)
}

fn score_of(scored: &Scored, seed: u64) -> Score {
    let mut score = Score::new(&scored.matches, seed);
    if let [(a, count), (b, _)] = &scored.groups[..] {
        let (of_a, of_b) = scored.matches.split_at(*count);
        score.comparison = Some(compare(&Group::new(a, of_a), &Group::new(b, of_b), seed));
    }
    score
}

/// Result as a table.
fn table(score: &Score, out: &Path) -> String {
    let number = |value: f64| format!("{value:>9.3}");
    let mut lines =
        vec![format!("{:<34}{:>9}{:>21}{:>10}{:>8}", "", "mean", "95 %", "episodes", "paper")];
    for metric in Metric::ALL {
        let Figure { mean, ci95, n } = score.summary[metric.name()];
        let mean = mean.map_or_else(|| format!("{:>9}", "-"), number);
        let interval = ci95.map_or_else(
            || format!("{:>21}", "-"),
            |[low, high]| format!("{:>21}", format!("{low:.3} to {high:.3}")),
        );
        let paper = metric.in_paper().map_or_else(|| "-".to_owned(), |value| value.to_string());
        lines.push(format!("{:<34}{mean}{interval}{n:>10}{paper:>8}", metric.title()));
    }
    if let Some(comparison) = &score.comparison {
        lines.push(comparison.summary.clone());
    }
    lines.push(format!(
        "wrote score.json, {EVENTS_FILE}, episodes.csv, episodes.parquet and index.html in {}",
        out.display()
    ));
    lines.join("\n")
}
