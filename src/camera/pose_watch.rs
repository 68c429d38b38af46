//! Checks of the camera's pose while frames come in: when, on which thread, and which warnings follow.

use super::{
    frame::Frame,
    pose_check::{PoseCheck, PoseShift},
};
use crate::units::Nanos;
use std::{
    fmt,
    sync::mpsc::{self, Receiver, SyncSender},
    thread::{self, JoinHandle},
};

/// Checks that must agree, so that a hand or a shaken table is no warning.
const CHECKS: u32 = 3;
/// Interval of the first checks (s).
const FIRST_INTERVAL_S: f64 = 0.1;
/// Interval of later checks (s).
const INTERVAL_S: f64 = 1.0;
/// Checks without a result after which a warning says so.
const CHECKS_WITHOUT_RESULT: u32 = 10;

/// Warning of [`PoseChecks`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PoseWarning {
    /// The camera or the table has moved.
    Moved(PoseShift),
    /// Nothing to compare with is visible.
    Unchecked,
}

impl fmt::Display for PoseWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Moved(shift) => shift.fmt(f),
            Self::Unchecked => f.write_str(
                "the pose of the camera cannot be checked: neither two tags of the calibration nor the four edges of the \
                 field are where the calibration has them; uncover them, or fit the board pose anew with `klasktron \
                 calibrate-camera`",
            ),
        }
    }
}

/// Times of the checks, and the warnings that follow from them; each warning comes once.
#[derive(Debug, Clone, Default)]
struct PoseWatch {
    last: Option<Nanos>,
    checks: u32,
    moved: u32,
    /// Result of the last check that had one.
    shift: Option<PoseShift>,
    without_result: u32,
    has_warned: [bool; 2],
}

impl PoseWatch {
    /// Return whether a frame captured at `at` is to be checked.
    fn is_due(&self, at: Nanos) -> bool {
        let interval = if self.checks < CHECKS { FIRST_INTERVAL_S } else { INTERVAL_S };
        let waits = self.last.is_some_and(|last| (0.0..interval).contains(&at.seconds_since(last)));
        !self.has_warned[0] && !waits
    }

    /// Note that a check of a frame captured at `at` begins.
    fn begin(&mut self, at: Nanos) {
        self.last = Some(at);
    }

    /// Take the result of a check, and return a warning that begins with it.
    fn finish(&mut self, shift: Option<PoseShift>) -> Option<PoseWarning> {
        self.checks += 1;
        let Some(shift) = shift else {
            self.without_result += 1;
            let begins = self.without_result == CHECKS_WITHOUT_RESULT;
            return begins.then(|| self.warn(PoseWarning::Unchecked)).flatten();
        };
        (self.without_result, self.shift) = (0, Some(shift));
        self.moved = if shift.is_moved() { self.moved + 1 } else { 0 };
        (CHECKS <= self.moved).then(|| self.warn(PoseWarning::Moved(shift))).flatten()
    }

    /// Return the displacement of the last check that had a result.
    fn shift(&self) -> Option<PoseShift> {
        self.shift
    }

    /// Return the warning of frames that have ended before three checks: all of them must agree.
    fn end(&mut self) -> Option<PoseWarning> {
        let agree = 0 < self.moved && self.moved == self.checks;
        self.shift.filter(|_| agree).and_then(|shift| self.warn(PoseWarning::Moved(shift)))
    }

    fn warn(&mut self, warning: PoseWarning) -> Option<PoseWarning> {
        let own = &mut self.has_warned[usize::from(warning == PoseWarning::Unchecked)];
        (!std::mem::replace(own, true)).then_some(warning)
    }
}

/// Checks of the frames of one source. Those of a live camera run on a thread of their own.
#[derive(Debug)]
pub struct PoseChecks {
    watch: PoseWatch,
    runner: Runner,
}

#[derive(Debug)]
enum Runner {
    Here(Box<PoseCheck>),
    Thread(Checker),
}

type CheckedFrame = (Frame, Option<PoseShift>);

/// Thread that checks one frame at a time.
#[derive(Debug)]
struct Checker {
    frames: Option<SyncSender<Frame>>,
    results: Receiver<CheckedFrame>,
    /// Memory for the next frame; `None` while one is checked.
    spare: Option<Frame>,
    thread: Option<JoinHandle<()>>,
}

impl PoseChecks {
    /// Check where the frames come in.
    #[must_use]
    pub fn here(check: PoseCheck) -> Self {
        Self { watch: PoseWatch::default(), runner: Runner::Here(Box::new(check)) }
    }

    /// Check on a thread, or where the frames come in if the system has no thread to give.
    pub(super) fn on_thread(check: PoseCheck) -> Self {
        match Checker::start(&check) {
            Some(checker) => Self { watch: PoseWatch::default(), runner: Runner::Thread(checker) },
            None => Self::here(check),
        }
    }

    /// Take a frame, and return a warning that begins with it or an earlier one. A live camera never waits here.
    pub fn take(&mut self, frame: &Frame) -> Option<PoseWarning> {
        let is_due = self.watch.is_due(frame.capture_time);
        match &mut self.runner {
            Runner::Here(check) => {
                if !is_due {
                    return None;
                }
                self.watch.begin(frame.capture_time);
                self.watch.finish(check.shift(frame))
            }
            Runner::Thread(checker) => {
                let done = checker.result();
                let warning = done.and_then(|shift| self.watch.finish(shift));
                if is_due && checker.offer(frame) {
                    self.watch.begin(frame.capture_time);
                }
                warning
            }
        }
    }

    /// Return the displacement of the last check that had a result.
    pub(super) fn shift(&self) -> Option<PoseShift> {
        self.watch.shift()
    }

    /// Return the warning of a source that has ended.
    pub(super) fn end(&mut self) -> Option<PoseWarning> {
        self.watch.end()
    }
}

impl Checker {
    /// Start the thread; `None` where the system has none to give.
    fn start(check: &PoseCheck) -> Option<Self> {
        let (frames, incoming) = mpsc::sync_channel::<Frame>(1);
        let (outgoing, results) = mpsc::sync_channel::<CheckedFrame>(1);
        let mut check = check.clone();
        let work = move || {
            for frame in incoming {
                let shift = check.shift(&frame);
                if outgoing.send((frame, shift)).is_err() {
                    return;
                }
            }
        };
        let thread = thread::Builder::new().name("camera pose".to_owned()).spawn(work).ok()?;
        let spare = Some(Frame::default());
        Some(Self { frames: Some(frames), results, spare, thread: Some(thread) })
    }

    /// Result that has come since the last call.
    fn result(&mut self) -> Option<Option<PoseShift>> {
        let (frame, shift) = self.results.try_recv().ok()?;
        self.spare = Some(frame);
        Some(shift)
    }

    /// Hand a copy of a frame to the thread, unless it is busy.
    fn offer(&mut self, frame: &Frame) -> bool {
        let (Some(mut own), Some(frames)) = (self.spare.take(), &self.frames) else { return false };
        own.copy_from(frame);
        frames.send(own).is_ok()
    }
}

impl Drop for Checker {
    fn drop(&mut self) {
        self.frames = None;
        if let Some(thread) = self.thread.take() {
            // The panic of a thread was reported already.
            thread.join().ok();
        }
    }
}
