//! Many matches, judged in parallel.

use super::{
    RefereeError,
    analysis::{MatchAnalysis, analyze},
    frames::{MatchFrames, Source},
    rules::Rules,
};
use crate::{parallel::in_parallel_on, recording::Loss, units::Nanos};
use std::path::PathBuf;

/// A match with what the referee says about it.
#[derive(Debug, Clone)]
pub struct ScoredMatch {
    /// The recording.
    pub path: PathBuf,
    /// Its SHA-256, in hexadecimal.
    pub sha256: String,
    /// When it began: at its first message, or when the first picture was taken.
    pub origin: Nanos,
    /// What a damaged file no longer holds.
    pub loss: Loss,
    /// Where the frames came from.
    pub source: Source,
    /// The rules by which it was judged, with its own board.
    pub rules: Rules,
    /// What happened.
    pub analysis: MatchAnalysis,
}

/// Reads and judges `paths` on `threads` threads; `done` is called after each. The results are in
/// the order of `paths`, and one that fails leaves the others alone.
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
    log::info!("judged {}: {events} events", recorded.path.display());
    let MatchFrames { path, sha256, origin, loss, source, .. } = recorded;
    ScoredMatch { path, sha256, origin, loss, source, rules, analysis }
}
