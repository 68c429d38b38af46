//! Live view of a running session.

use super::{note, terminal};
use indicatif::ProgressBar;
use klasktron::collect::Progress;
use std::cell::Cell;

/// Live view: a progress bar on a terminal, a line for each run elsewhere.
pub(super) struct LiveView {
    bar: ProgressBar,
    said: Cell<u32>,
}

impl LiveView {
    pub(super) fn new() -> Self {
        let bar = terminal::bar(None, "{elapsed_precise} [{bar:20}] {wide_msg}");
        Self { bar, said: Cell::new(0) }
    }

    pub(super) fn show(&self, progress: &Progress<'_>) {
        self.bar.set_length(progress.periods as u64);
        self.bar.set_position(progress.periods_done as u64);
        let run = progress.run.map_or_else(
            || format!("{} of {} runs done", progress.runs_done, progress.runs),
            |run| format!("run {} of {}: {}", run.number, progress.runs, run.pattern),
        );
        self.bar.set_message(format!(
            "{run}; largest path error {:.1} mm, {} errors, {:.0} CAN frames/s, {:.0} images/s",
            1e3 * progress.worst_tracking,
            progress.errors,
            progress.frames_per_s,
            progress.camera_frames_per_s,
        ));
        let Some(run) = progress.run else { return };
        if self.bar.is_hidden() && self.said.replace(run.number) != run.number {
            let (number, runs) = (run.number, progress.runs);
            let split =
                if run.split.is_empty() { String::new() } else { format!(" ({})", run.split) };
            note(&format!("run {number} of {runs}: {}{split}", run.pattern));
        }
    }

    /// Remove the bar.
    pub(super) fn close(&self) {
        self.bar.finish_and_clear();
    }
}
