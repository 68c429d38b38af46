//! One file per subcommand: its arguments, and a `run` that makes one call into the library.

pub(crate) mod collect;
pub(crate) mod completions;
pub(crate) mod demo;
mod engine;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod fit_actuator;
pub(crate) mod gap;
pub(crate) mod import;
pub(crate) mod info;
mod interrupt;
mod live_view;
pub(crate) mod man;
pub(crate) mod play;
pub(crate) mod recover;
pub(crate) mod rig;
mod session;
pub(crate) mod sweep;
mod table;
pub(crate) mod terminal;
pub(crate) mod train;
pub(crate) mod tune_ekf;

use klasktron::recording::{Loss, Recording};
use std::{path::Path, process::ExitCode};
pub(crate) use terminal::{note, print, tell};

/// Exit status of a command that failed.
pub(crate) const EXIT_FAILED: u8 = 1;
/// Exit status when something was typed or set that no command takes.
pub(crate) const EXIT_USAGE: u8 = 2;
/// Exit status of a command that finished, but lost something or did not meet a gate.
const EXIT_LOSSY: u8 = 3;

/// How a command that did not fail ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// Everything was done.
    Done,
    /// Done, but something was lost or a gate was not met; it was said on stderr.
    Lossy,
    /// A task of Slurm without a result, with the status that tells why.
    Task(u8),
}

impl Outcome {
    /// The exit status of the contract.
    pub(crate) fn exit_code(self) -> ExitCode {
        match self {
            Self::Done => ExitCode::SUCCESS,
            Self::Lossy => ExitCode::from(EXIT_LOSSY),
            Self::Task(status) => ExitCode::from(status),
        }
    }
}

/// One sentence on what a damaged recording lost, and how to make a whole file of the rest.
pub(crate) fn loss_sentence(recording: &Recording) -> String {
    loss_sentence_of(&recording.path, &recording.loss)
}

/// The same for a file of which only the loss is left.
pub(crate) fn loss_sentence_of(path: &Path, loss: &Loss) -> String {
    let file = path.display();
    format!(
        "{file}: {loss}; the rest was read; make a whole file of it with `klasktron recover {file} -o \
         OUT`"
    )
}

/// The chain of reasons on one line. A reason that the message before it already tells, as library
/// errors do, is not told again.
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
