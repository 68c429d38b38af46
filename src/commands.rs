//! Subcommands, one file each: the arguments, and a `run` that makes one call into the library.

pub(crate) mod calibrate_camera;
pub(crate) mod collect;
pub(crate) mod completions;
pub(crate) mod demo;
pub(crate) mod detect;
pub(crate) mod diff;
mod drawn;
pub(crate) mod effects;
mod engine;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod fit_actuator;
pub(crate) mod gap;
pub(crate) mod import;
pub(crate) mod info;
pub(crate) mod interrupt;
mod live;
mod live_view;
pub(crate) mod man;
pub(crate) mod play;
pub(crate) mod recover;
pub(crate) mod replay;
mod reported_command;
mod results;
pub(crate) mod rig;
pub(crate) mod schema;
mod search;
mod session;
pub(crate) mod simulate;
pub(crate) mod sweep;
mod table;
pub(crate) mod terminal;
pub(crate) mod train;
pub(crate) mod tune_detector;
pub(crate) mod tune_ekf;

use klasktron::recording::{Loss, Recording};
use std::{path::Path, process::ExitCode};
pub(crate) use terminal::{note, print, tell};

/// Exit status of a failure.
pub(crate) const EXIT_FAILED: u8 = 1;
/// Exit status of a usage error, on the command line or in the settings file.
pub(crate) const EXIT_USAGE: u8 = 2;
/// Exit status of a command that finished, but lost data or failed a check.
const EXIT_LOSSY: u8 = 3;

/// End of a command that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Complete.
    Done,
    /// Finished, but data were lost or a check failed; stderr says which.
    Lossy,
    /// Ended by Ctrl-C; stderr says what was kept and how to continue.
    Interrupted,
    /// A Slurm task without a result, with the status that gives the reason.
    Task(u8),
}

impl Outcome {
    /// Exit status of the program.
    pub(crate) fn exit_code(self) -> ExitCode {
        match self {
            Self::Done => ExitCode::SUCCESS,
            Self::Lossy => ExitCode::from(EXIT_LOSSY),
            Self::Interrupted => ExitCode::from(interrupt::EXIT_INTERRUPTED),
            Self::Task(status) => ExitCode::from(status),
        }
    }
}

/// Sentence on the lost part of a damaged recording, and the way to a whole file of the rest.
pub(crate) fn loss_sentence(recording: &Recording) -> String {
    loss_sentence_of(&recording.path, &recording.loss)
}

/// The same sentence for a file that has been closed.
pub(crate) fn loss_sentence_of(path: &Path, loss: &Loss) -> String {
    loss.sentence(path)
}

/// Chain of reasons on one line, without reasons that the text before them contains already.
pub(crate) fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for reason in error.chain().map(ToString::to_string) {
        if !line.contains(&reason) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&reason);
        }
    }
    line
}
