//! Parallel work on independent items, with results independent of the number of threads.

use std::{
    num::NonZeroUsize,
    sync::atomic::{AtomicUsize, Ordering},
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
            .flat_map(|worker| {
                worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .collect()
    });
    found.sort_by_key(|(index, _)| *index);
    found.into_iter().map(|(_, result)| result).collect()
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
}
