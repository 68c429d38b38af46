//! Local engine: worker threads with one child process each.

use super::{
    Ended, Point, SweepError,
    run::{Runner, run_point},
    store::{Failure, Store},
};
use crate::parallel::in_parallel_on;
use std::sync::{
    Mutex, PoisonError,
    atomic::{AtomicBool, Ordering},
};

/// Receiver of an engine's progress.
pub trait SweepObserver: Sync {
    /// `point` was started.
    fn point_begun(&self, point: &Point);
    /// `point` finished, failed or was stopped.
    fn point_ended(&self, point: &Point, ended: &Ended);
    /// A message for the user.
    fn remark(&self, text: &str);
    /// Progress of the whole sweep.
    fn remark_progress(&self, text: &str);
}

/// Run all `points` on `workers` workers until all are done, or `stop` is set. Failures are
/// recorded in the store; a full disk stops everything, because every further point would fail too.
///
/// # Errors
/// When the disk is full, the program cannot be started or the store cannot be written.
pub fn run_local(
    points: &[Point],
    store: &Store,
    (runner, workers): (&Runner, usize),
    stop: &AtomicBool,
    observer: &dyn SweepObserver,
) -> Result<Vec<(String, Failure)>, SweepError> {
    let error = Mutex::new(None);
    // Set by Ctrl-C or by an error; only the former is visible to the caller.
    let halted = AtomicBool::new(false);
    let ended = in_parallel_on(workers, points, |point| {
        if stop.load(Ordering::Relaxed) || halted.load(Ordering::Relaxed) {
            return None;
        }
        observer.point_begun(point);
        match run_point(point, store, runner, stop) {
            Ok(ended) => {
                observer.point_ended(point, &ended);
                Some((point.hash.clone(), ended))
            }
            Err(first) => {
                halted.store(true, Ordering::Relaxed);
                error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(first);
                None
            }
        }
    });
    if let Some(error) = error.into_inner().unwrap_or_else(PoisonError::into_inner) {
        return Err(error);
    }
    let failed = |(hash, ended)| match ended {
        Ended::Failed(failure) => Some((hash, failure)),
        Ended::Finished(_) | Ended::Interrupted => None,
    };
    Ok(ended.into_iter().flatten().filter_map(failed).collect())
}
