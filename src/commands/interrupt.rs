//! Ctrl-C: the first one asks long work to finish what it can, a second one ends the program.

use super::tell;
use std::{
    process,
    sync::atomic::{AtomicBool, Ordering},
};

static STOP: AtomicBool = AtomicBool::new(false);

/// Exit status after a second Ctrl-C, as shells have it for SIGINT.
const EXIT_INTERRUPTED: i32 = 130;

/// A flag that Ctrl-C (or SIGTERM) raises; it then says what is being done.
pub(crate) fn raised_by_ctrl_c(doing: &'static str) -> anyhow::Result<&'static AtomicBool> {
    ctrlc::set_handler(move || {
        if STOP.swap(true, Ordering::Relaxed) {
            #[expect(clippy::exit, reason = "the person has asked twice")]
            process::exit(EXIT_INTERRUPTED);
        }
        tell(&format!("interrupted: {doing}; once more to end at once"));
    })?;
    Ok(&STOP)
}
