//! Parallel work on independent items, with results independent of the number of threads.

use std::{
    num::NonZeroUsize,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Condvar, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Limit of the threads of [`in_parallel`]; 0 for none.
static LIMIT: AtomicUsize = AtomicUsize::new(0);

/// Limit the threads of [`in_parallel`] for the whole process. Results do not depend on it.
pub fn limit_threads(threads: NonZeroUsize) {
    LIMIT.store(threads.get(), Ordering::Relaxed);
}

/// Return the number of threads that run at once; 1 where it is unknown.
#[must_use]
pub fn cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// Apply `work` to every item on all cores. The results are in the order of the items for any
/// number of cores. A panic in `work` propagates to the caller.
pub fn in_parallel<T: Sync, R: Send>(items: &[T], work: impl Fn(&T) -> R + Sync) -> Vec<R> {
    in_parallel_on(threads(), items, work)
}

/// Return the number of threads of [`in_parallel`].
#[must_use]
pub fn threads() -> usize {
    match LIMIT.load(Ordering::Relaxed) {
        0 => cores(),
        limit => limit,
    }
}

/// Apply `work` to every item on `threads` threads, at least one; items start in their order.
pub fn in_parallel_on<T: Sync, R: Send>(
    threads: usize,
    items: &[T],
    work: impl Fn(&T) -> R + Sync,
) -> Vec<R> {
    let threads = threads.min(items.len());
    if threads < 2 {
        return items.iter().map(work).collect();
    }
    let next = AtomicUsize::new(0);
    let mut found: Vec<(usize, R)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|_| {
                scope.spawn(|| {
                    let mut own = Vec::new();
                    loop {
                        let index = next.fetch_add(1, Ordering::Relaxed);
                        let Some(item) = items.get(index) else { return own };
                        own.push((index, work(item)));
                    }
                })
            })
            .collect();
        workers
            .into_iter()
            .flat_map(|worker| worker.join().unwrap_or_else(|panic| resume_unwind(panic)))
            .collect()
    });
    found.sort_by_key(|(index, _)| *index);
    found.into_iter().map(|(_, result)| result).collect()
}

/// Where an item of a [`Schedule`] is.
enum Progress<R> {
    Waiting,
    Running,
    Done(R),
}

/// Items that need the results of others.
struct Schedule<'a, R, E> {
    /// Of each item, the items that must be done before it starts.
    needs: &'a [Vec<usize>],
    progress: Vec<Progress<R>>,
    /// Number of the first item, in their order, that has failed, with its error or panic.
    failed: Option<(usize, thread::Result<E>)>,
}

impl<R, E> Schedule<'_, R, E> {
    fn is_ready(&self, item: usize) -> bool {
        let done = |other: &usize| matches!(self.progress[*other], Progress::Done(_));
        matches!(self.progress[item], Progress::Waiting) && self.needs[item].iter().all(done)
    }

    /// Number of items that run or could run.
    fn active(&self) -> usize {
        let running = |item: &usize| matches!(self.progress[*item], Progress::Running);
        (0..self.needs.len()).filter(|item| running(item) || self.is_ready(*item)).count()
    }

    fn end(&mut self, item: usize, ended: thread::Result<Result<R, E>>) {
        let failure = match ended {
            Ok(Ok(result)) => {
                self.progress[item] = Progress::Done(result);
                return;
            }
            Ok(Err(error)) => Ok(error),
            Err(panic) => Err(panic),
        };
        if self.failed.as_ref().is_none_or(|(first, _)| item < *first) {
            self.failed = Some((item, failure));
        }
    }
}

/// Work on items that need the results of others, on `threads` threads: an item starts when all items in `needs` at
/// its place are done, and ready items start in their order. `work` gets the number of an item, and its share of the
/// threads: all threads are divided equally among the items that run or could run when it starts. The results are in
/// the order of the items.
///
/// # Errors
/// The error of the first item, in their order, that has failed. After it no other item starts.
///
/// # Panics
/// If an item needs itself or one that comes later. A panic in `work` propagates.
pub fn in_order_of_needs<R: Send, E: Send>(
    threads: usize,
    needs: &[Vec<usize>],
    work: impl Fn(usize, usize) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E> {
    let earlier = |(item, needed): (usize, &Vec<usize>)| needed.iter().all(|other| *other < item);
    assert!(needs.iter().enumerate().all(earlier), "an item needs only those before it");
    let threads = threads.max(1);
    let progress = needs.iter().map(|_| Progress::Waiting).collect();
    let schedule = Mutex::new(Schedule { needs, progress, failed: None });
    let changed = Condvar::new();
    let lock = || schedule.lock().unwrap_or_else(PoisonError::into_inner);
    // The next ready item; `None` when no other will start.
    let next = || {
        let mut state = lock();
        loop {
            let waits = state.progress.iter().any(|one| matches!(one, Progress::Waiting));
            if state.failed.is_some() || !waits {
                return None;
            }
            if let Some(item) = (0..needs.len()).find(|item| state.is_ready(*item)) {
                let share = (threads / state.active()).max(1);
                state.progress[item] = Progress::Running;
                return Some((item, share));
            }
            state = changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    };
    thread::scope(|scope| {
        for _ in 0..threads.min(needs.len()) {
            scope.spawn(|| {
                while let Some((item, share)) = next() {
                    let ended = catch_unwind(AssertUnwindSafe(|| work(item, share)));
                    lock().end(item, ended);
                    changed.notify_all();
                }
            });
        }
    });
    let state = schedule.into_inner().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, failure)) = state.failed {
        return Err(failure.unwrap_or_else(|panic| resume_unwind(panic)));
    }
    let result = |one| match one {
        Progress::Done(result) => result,
        Progress::Waiting | Progress::Running => unreachable!("all items are done"),
    };
    Ok(state.progress.into_iter().map(result).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_in_the_order_of_the_items_on_any_number_of_threads() {
        let items: Vec<u64> = (0..100).collect();
        let slow_first = |item: &u64| {
            if *item < 3 {
                thread::yield_now();
            }
            item * item
        };
        let expected: Vec<u64> = items.iter().map(|item| item * item).collect();
        for threads in [0, 1, 2, 7, 200] {
            assert_eq!(in_parallel_on(threads, &items, slow_first), expected);
        }
        assert_eq!(in_parallel(&items, slow_first), expected);
        assert!(in_parallel(&[], slow_first).is_empty());
    }

    /// Two that need nothing, one that needs both, and one that needs the first.
    fn diamond() -> Vec<Vec<usize>> {
        vec![vec![], vec![], vec![0, 1], vec![0]]
    }

    #[test]
    fn an_item_starts_after_those_that_it_needs() {
        for threads in [0, 1, 2, 8] {
            let done: Vec<AtomicUsize> = (0..4).map(|_| AtomicUsize::new(0)).collect();
            let needs = diamond();
            let results = in_order_of_needs(threads, &needs, |item, share| {
                let missing = needs[item].iter().any(|at| done[*at].load(Ordering::SeqCst) == 0);
                assert!(!missing && 1 <= share && share <= threads.max(1), "{item} {share}");
                done[item].store(1, Ordering::SeqCst);
                Ok::<_, ()>(10 * item)
            });
            assert_eq!(results, Ok(vec![0, 10, 20, 30]), "{threads}");
        }
    }

    #[test]
    fn after_an_error_no_item_starts_and_the_first_one_is_reported() {
        let started = AtomicUsize::new(0);
        let result: Result<Vec<()>, usize> = in_order_of_needs(1, &diamond(), |item, _| {
            started.fetch_add(1, Ordering::SeqCst);
            if item == 1 { Err(item) } else { Ok(()) }
        });
        assert_eq!((result, started.into_inner()), (Err(1), 2));
    }

    #[test]
    #[should_panic(expected = "the second item")]
    fn a_panic_ends_the_work_of_all_threads() {
        let work = |item, _| if item == 1 { panic!("the second item") } else { Ok::<_, ()>(item) };
        in_order_of_needs(2, &diamond(), work).ok();
    }

    #[test]
    fn an_item_that_runs_alone_has_all_threads() {
        let chain = vec![vec![], vec![0]];
        assert_eq!(in_order_of_needs(6, &chain, |_, share| Ok::<_, ()>(share)), Ok(vec![6, 6]));
    }
}
