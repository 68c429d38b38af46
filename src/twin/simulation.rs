//! Open-loop simulation: recorded or tabulated commands through a twin, without any measurement.
//!
//! The simulators are those with which `gap` predicts: the plant of [`DriveStage`](super::DriveStage), the
//! striker of [`CameraStage`](super::CameraStage), and the free-running chain of
//! [`AxisStage`](super::AxisStage). The result is deterministic and free of noise. It is one continuous
//! simulation from the initial position, so integration errors and drift accumulate.

mod axis;
mod gantry;
mod record;
#[cfg(test)]
mod tests;

pub use axis::{AxisInputs, AxisMotion, INPUT_COLUMNS, simulate_axis};
pub use gantry::{TableCommands, TableMotion, simulate_table};
pub use record::{RecordInfo, axis_csv, table_csv, write_axis_recording, write_table_recording};

use super::{AxisError, Machine};
use crate::recording::RecordingError;
use std::path::PathBuf;

/// Longest simulation (s).
pub const LONGEST_S: f64 = 7200.0;

/// Reason why commands cannot be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulationError {
    /// The recording cannot be decoded.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The input of a single axis cannot be used.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// The commands are those of another kind of machine.
    #[error(
        "{}: commands for a {commands}, but the twin describes a {twin}; give the twin of that \
         machine", path.display()
    )]
    OtherMachine {
        /// File of the commands.
        path: PathBuf,
        /// Machine of the commands.
        commands: Machine,
        /// Machine of the twin.
        twin: Machine,
    },
    /// The commands have another unit than the input of the twin.
    #[error(
        "axis '{name}' has commands in {unit}, but the input of the twin is in {expected}; give commands in {expected}, or the \
         twin of that axis"
    )]
    OtherUnit {
        /// The axis.
        name: String,
        /// Unit of the commands.
        unit: String,
        /// Unit of the twin's input.
        expected: &'static str,
    },
    /// No commands.
    #[error("{}: no commands; expected the topic {expected}", path.display())]
    NoCommands {
        /// The recording.
        path: PathBuf,
        /// Topic with commands for the twin.
        expected: String,
    },
    /// Several axes, and none was chosen.
    #[error("{}: inputs of the axes {}; choose one with --axis", path.display(), names.join(", "))]
    SeveralAxes {
        /// The recording.
        path: PathBuf,
        /// Names of the axes.
        names: Vec<String>,
    },
    /// A command that is not finite.
    #[error("{}: the command at {time} s is not finite", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// Time of the first one (s).
        time: f64,
    },
    /// A duration that is zero or too long.
    #[error("{}: the commands span {seconds} s; allowed are more than 0 and up to {LONGEST_S} s", path.display())]
    Length {
        /// The file.
        path: PathBuf,
        /// Time of the last command (s).
        seconds: f64,
    },
    /// Too few inputs of a single axis.
    #[error("{}: {found} inputs; at least 2 are needed", path.display())]
    TooFew {
        /// The file.
        path: PathBuf,
        /// Number of inputs.
        found: usize,
    },
}

/// Check the duration `seconds` of the commands in `path`.
fn check_length(path: &std::path::Path, seconds: f64) -> Result<(), SimulationError> {
    if 0.0 < seconds && seconds <= LONGEST_S {
        return Ok(());
    }
    Err(SimulationError::Length { path: path.to_owned(), seconds })
}
