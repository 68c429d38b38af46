//! Spinning thread barrier for short, frequent waits.
//!
//! A minibatch takes about a millisecond and has two barriers; the standard barrier puts threads to
//! sleep, which costs a fraction of that. Here threads spin for a while and then yield. When one of
//! them panics, the others panic too instead of waiting for ever.

use std::{
    hint,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
    thread,
};

/// Number of reads of the counter before a thread yields; some microseconds.
const SPINS: usize = 4000;

/// Barrier for a fixed number of threads, reusable.
#[derive(Debug)]
pub(super) struct Barrier {
    threads: usize,
    arrived: AtomicUsize,
    /// Number of completed barriers.
    meetings: AtomicUsize,
    broken: AtomicBool,
}

impl Barrier {
    pub(super) fn new(threads: usize) -> Self {
        Self {
            threads,
            arrived: AtomicUsize::new(0),
            meetings: AtomicUsize::new(0),
            broken: AtomicBool::new(false),
        }
    }

    /// Wait until all threads have called it; writes before it are visible to all threads after it.
    ///
    /// # Panics
    /// When another thread has dropped its [`Attendance`] while panicking.
    pub(super) fn wait(&self) {
        let meeting = self.meetings.load(Ordering::Acquire);
        if self.arrived.fetch_add(1, Ordering::AcqRel) + 1 == self.threads {
            self.arrived.store(0, Ordering::Relaxed);
            self.meetings.store(meeting.wrapping_add(1), Ordering::Release);
            return;
        }
        let mut looks = 0usize;
        while self.meetings.load(Ordering::Acquire) == meeting {
            assert!(!self.broken.load(Ordering::Relaxed), "another learning thread has panicked");
            looks += 1;
            if looks < SPINS { hint::spin_loop() } else { thread::yield_now() }
        }
    }

    /// Guard of a participating thread, to be held while it takes part.
    pub(super) fn attend(&self) -> Attendance<'_> {
        Attendance(self)
    }
}

/// Notifies the other threads when its thread panics.
pub(super) struct Attendance<'a>(&'a Barrier);

impl Drop for Attendance<'_> {
    fn drop(&mut self) {
        if thread::panicking() {
            self.0.broken.store(true, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_is_a_meeting_ahead() {
        const MEETINGS: usize = 500;
        let barrier = Barrier::new(3);
        let counts: [AtomicUsize; MEETINGS] = std::array::from_fn(|_| AtomicUsize::new(0));
        thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| {
                    for count in &counts {
                        count.fetch_add(1, Ordering::Relaxed);
                        barrier.wait();
                        assert_eq!(count.load(Ordering::Relaxed), 3);
                    }
                });
            }
        });
    }

    #[test]
    fn a_panic_frees_the_others() {
        let barrier = Barrier::new(2);
        let ended = thread::scope(|scope| {
            let panics = scope.spawn(|| {
                let _attendance = barrier.attend();
                panic!("on purpose");
            });
            let waits = scope.spawn(|| {
                let _attendance = barrier.attend();
                barrier.wait();
            });
            [panics.join().is_err(), waits.join().is_err()]
        });
        assert_eq!(ended, [true, true]);
    }
}
