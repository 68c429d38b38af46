//! Analysis of many matches in parallel.

use super::{
    RefereeError,
    analysis::{MatchAnalysis, analyze},
    frames::{MatchFrames, Source},
    rules::Rules,
};
use crate::{parallel::in_parallel_on, recording::Loss, units::Nanos};
use std::path::PathBuf;

/// A match with its analysis.
#[derive(Debug, Clone)]
pub struct ScoredMatch {
    /// The recording.
    pub path: PathBuf,
    /// Its SHA-256, in hexadecimal.
    pub sha256: String,
    /// Time of its beginning: the first message, or the capture of the first frame.
    pub origin: Nanos,
    /// Losses of a damaged file.
    pub loss: Loss,
    /// Source of the frames.
    pub source: Source,
    /// Rules of the analysis, with the match's own board.
    pub rules: Rules,
    /// Analysis of the match.
    pub analysis: MatchAnalysis,
}

/// Read and analyze `paths` on `threads` threads; `done` is called after each. Results are in the
/// order of `paths`; a failure does not affect the other matches.
pub fn analyze_matches(
    paths: &[PathBuf],
    rules: &Rules,
    threads: usize,
    done: &(dyn Fn() + Sync),
) -> Vec<Result<ScoredMatch, RefereeError>> {
    in_parallel_on(threads, paths, |path| {
        let result = MatchFrames::open(path).map(|recorded| score(recorded, rules));
        done();
        result
    })
}

fn score(recorded: MatchFrames, rules: &Rules) -> ScoredMatch {
    let rules = recorded.rules(rules);
    let analysis = analyze(&recorded.frames, &rules);
    let events = analysis.events.len();
    log::info!("analyzed {}: {events} events", recorded.path.display());
    let MatchFrames { path, sha256, origin, loss, source, .. } = recorded;
    ScoredMatch { path, sha256, origin, loss, source, rules, analysis }
}
