//! Pieces of work over some threads, each with denormals flushed.

use crate::nn::flushing_denormals;
use std::{
    num::NonZeroUsize,
    sync::{Mutex, PoisonError},
    thread,
};

/// Does `work` with every item, on at most `threads` threads, in any order. Results do not depend on
/// the order as long as each item holds all that its work changes.
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
