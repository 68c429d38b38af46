//! `klasktron eval`: recordings of matches to their score.

use super::{Outcome, loss_sentence_of, print, tell, terminal};
use anyhow::{Context, bail};
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
    fs,
    num::NonZeroUsize,
    path::{Path, PathBuf},
};

/// What can be typed after `klasktron eval`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Examples:\n  klasktron eval match.mcap --out eval\n  klasktron eval --compare simulated hardware --out eval"
)]
pub(crate) struct Args {
    /// Recordings with /camera/detections or /board/state; of a folder, every .mcap file in it
    #[arg(value_name = "MATCH", required_unless_present = "compare")]
    matches: Vec<PathBuf>,
    /// Compare two groups of matches, each a recording or a folder of them
    #[arg(long, num_args = 2, value_names = ["A", "B"], conflicts_with = "matches")]
    compare: Vec<PathBuf>,
    /// Folder for score.json, events.mcap, episodes.csv, episodes.parquet and index.html
    #[arg(short, long, value_name = "DIR", default_value = "eval")]
    out: PathBuf,
    /// Seed of the bootstrap and of the permutation test
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Matches at a time; the result does not depend on it [default: one per core]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZeroUsize>,
    /// Print score.json alone on stdout
    #[arg(long)]
    json: bool,
}

/// What the arguments name: a group of matches.
struct Listed {
    name: String,
    files: Vec<PathBuf>,
}

/// What came of the matches.
struct Judged {
    /// In the order in which they were named.
    matches: Vec<ScoredMatch>,
    /// Name of each group, and how many of the matches are its own.
    groups: Vec<(String, usize)>,
    /// Why others could not be judged.
    errors: Vec<String>,
}

/// Runs the command.
pub(crate) fn run(args: &Args) -> anyhow::Result<Outcome> {
    let judged = judge(args, args.listed()?)?;
    let score = scored(&judged, args.seed);
    let matches = &judged.matches;
    let provenance = Provenance::new(args.command_line());
    fs::create_dir_all(&args.out)
        .with_context(|| format!("{}: cannot create the folder", args.out.display()))?;
    let json = serde_json::to_string_pretty(&score)?;
    let replace = ExistingFile::Replace;
    write_bytes(&args.out.join("score.json"), replace, json.as_bytes())?;
    write_events(matches, &provenance, args.seed, &args.out.join(EVENTS_FILE))?;
    write_episodes(&score, &args.out.join("episodes.csv"), ColumnFormat::Csv)?;
    write_episodes(&score, &args.out.join("episodes.parquet"), ColumnFormat::Parquet)?;
    let html = page(matches, &score, &judged.errors, &provenance);
    write_bytes(&args.out.join("index.html"), replace, html.as_bytes())?;
    print(&if args.json { json } else { table(&score, &args.out) })?;
    let whole = judged.errors.is_empty() && matches.iter().all(|scored| scored.loss.is_none());
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

    /// The command without the place of its results, so that equal results are equal files.
    fn command_line(&self) -> String {
        let mut line = "klasktron eval".to_owned();
        if !self.compare.is_empty() {
            line.push_str(" --compare");
        }
        for path in self.matches.iter().chain(&self.compare) {
            line.push_str(&format!(" {}", path.display()));
        }
        line.push_str(&format!(" --seed {}", self.seed));
        line
    }
}

/// The file itself, or every MCAP file in the folder, by name.
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

fn judge(args: &Args, listed: Vec<Listed>) -> anyhow::Result<Judged> {
    let files: Vec<PathBuf> = listed.iter().flat_map(|group| group.files.clone()).collect();
    let template = "{wide_bar} {pos}/{len} matches, {eta} left";
    let bar = terminal::bar(Some(files.len() as u64), template);
    let threads = args.threads.map_or_else(parallel::cores, NonZeroUsize::get);
    let results = analyze_matches(&files, &Rules::default(), threads, &|| bar.inc(1));
    bar.finish_and_clear();
    let mut results = results.into_iter();
    let mut judged = Judged { matches: Vec::new(), groups: Vec::new(), errors: Vec::new() };
    for group in listed {
        let before = judged.matches.len();
        for result in results.by_ref().take(group.files.len()) {
            match result {
                Ok(scored) => {
                    if !scored.loss.is_none() {
                        tell(&format!("warning: {}", loss_sentence_of(&scored.path, &scored.loss)));
                    }
                    judged.matches.push(scored);
                }
                // Alone, the file's error is that of the command.
                Err(error) if files.len() == 1 => return Err(error.into()),
                Err(error) => {
                    tell(&format!("error: {error}"));
                    judged.errors.push(error.to_string());
                }
            }
        }
        let count = judged.matches.len() - before;
        if count == 0 {
            bail!("none of the {} matches of {} could be judged", group.files.len(), group.name);
        }
        judged.groups.push((group.name, count));
    }
    Ok(judged)
}

fn scored(judged: &Judged, seed: u64) -> Score {
    let mut score = Score::new(&judged.matches, seed);
    if let [(a, count), (b, _)] = &judged.groups[..] {
        let (of_a, of_b) = judged.matches.split_at(*count);
        score.comparison = Some(compare(&Group::new(a, of_a), &Group::new(b, of_b), seed));
    }
    score
}

/// The result for people.
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
