//! Many matches, judged in parallel.

use super::{
    RefereeError,
    judge::{Judgement, judge},
    rules::Rules,
    tape::{Source, Tape},
};
use crate::{recording::Loss, units::Nanos};
use std::{
    path::PathBuf,
    sync::{
        Mutex,
        atomic::{AtomicUsize, Ordering},
    },
};

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
    let next = AtomicUsize::new(0);
    let results: Vec<Mutex<Option<Result<ScoredMatch, RefereeError>>>> =
        paths.iter().map(|_| Mutex::new(None)).collect();
    std::thread::scope(|scope| {
        for _ in 0..threads.clamp(1, paths.len().max(1)) {
            scope.spawn(|| {
                loop {
                    let idx = next.fetch_add(1, Ordering::Relaxed);
                    let Some(path) = paths.get(idx) else { return };
                    let result = Tape::open(path).map(|tape| score(tape, rules));
                    if let Ok(mut slot) = results[idx].lock() {
                        *slot = Some(result);
                    }
                    done();
                }
            });
        }
    });
    results.into_iter().filter_map(|slot| slot.into_inner().ok().flatten()).collect()
}

fn score(tape: Tape, rules: &Rules) -> ScoredMatch {
    let rules = tape.rules(rules);
    let judgement = judge(&tape.frames, &rules);
    let Tape { path, sha256, origin, loss, source, .. } = tape;
    ScoredMatch { path, sha256, origin, loss, source, rules, judgement }
}
