//! Parallel work on several threads, each with denormals flushed to zero.

use crate::nn::flushing_denormals;
use std::{
    num::NonZeroUsize,
    sync::{Mutex, PoisonError},
    thread,
};

/// Process every item with `work` on at most `threads` threads, in any order. Results do not depend
/// on the order if each item holds all state that its work changes.
pub(crate) fn for_each<T: Send>(threads: NonZeroUsize, items: Vec<T>, work: impl Fn(T) + Sync) {
    let threads = threads.get().min(items.len());
    let queue = Mutex::new(items.into_iter());
    let next = || queue.lock().unwrap_or_else(PoisonError::into_inner).next();
    let run = || {
        flushing_denormals(|| {
            while let Some(item) = next() {
                work(item);
            }
        });
    };
    if threads <= 1 {
        return run();
    }
    thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(run);
        }
        run();
    });
}
