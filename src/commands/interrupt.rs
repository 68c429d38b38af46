//! Ctrl-C: the first one asks long work to finish what it can, a further one ends the program.

use super::tell;
use std::{
    process,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
};

static STOP: AtomicBool = AtomicBool::new(false);
static PRESSES: AtomicUsize = AtomicUsize::new(0);

/// Exit status after Ctrl-C has ended the program, as shells have it for SIGINT.
const EXIT_INTERRUPTED: i32 = 130;

/// A flag that Ctrl-C (or SIGTERM) raises; it then says what is being done. The second one ends the
/// program.
pub(crate) fn raised_by_ctrl_c(doing: &'static str) -> anyhow::Result<&'static AtomicBool> {
    ctrlc::set_handler(move || {
        if STOP.swap(true, Ordering::Relaxed) {
            end_program();
        }
        tell(&format!("interrupted: {doing}; once more to end at once"));
    })?;
    Ok(&STOP)
}

/// Counts Ctrl-C (or SIGTERM), for work that drives motors: the first and the second are its own to
/// handle, as `first` and `second` tell the person; the third ends the program.
pub(crate) fn counted_ctrl_c(
    first: &'static str,
    second: &'static str,
) -> anyhow::Result<&'static AtomicUsize> {
    ctrlc::set_handler(move || match PRESSES.fetch_add(1, Ordering::Relaxed) {
        0 => tell(first),
        1 => tell(second),
        _ => end_program(),
    })?;
    Ok(&PRESSES)
}

fn end_program() {
    #[expect(clippy::exit, reason = "the person has asked for it once more")]
    process::exit(EXIT_INTERRUPTED);
}
