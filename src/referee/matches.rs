//! Many matches, judged in parallel.

use super::{
    RefereeError,
    judge::{Judgement, judge},
    rules::Rules,
    tape::{Source, Tape},
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
    pub judgement: Judgement,
}

/// Reads and judges `paths` on `threads` threads; `done` is called after each. The results are in
/// the order of `paths`, and one that fails leaves the others alone.
pub fn judge_matches(
    paths: &[PathBuf],
    rules: &Rules,
    threads: usize,
    done: &(dyn Fn() + Sync),
) -> Vec<Result<ScoredMatch, RefereeError>> {
    in_parallel_on(threads, paths, |path| {
        let result = Tape::open(path).map(|tape| score(tape, rules));
        done();
        result
    })
}

fn score(tape: Tape, rules: &Rules) -> ScoredMatch {
    let rules = tape.rules(rules);
    let judgement = judge(&tape.frames, &rules);
    let events = judgement.events.len();
    log::info!("judged {}: {events} events", tape.path.display());
    let Tape { path, sha256, origin, loss, source, .. } = tape;
    ScoredMatch { path, sha256, origin, loss, source, rules, judgement }
}
