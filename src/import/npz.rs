//! Import of npz files of the upstream actuator pipeline.
//!
//! *One run*: seven arrays (N, 2) on a 0.02 s grid. `player` is the left peg, `opponent` the right.
//! Velocities come from the camera's filter, not from encoders, as stated in the metadata.
//!
//! *Windows*: each row holds `h` past commands (`X_commands`, newest first, x and y interleaved),
//! `h - 1` past velocities (`X_states`) and the velocities at t, t + 0.02 s, ... (`Y`). Rows follow
//! the camera's samples, not the grid, and the file does not link rows of one run. Each row
//! therefore becomes a run of its own with the pattern `window`; runs are a second apart. Carriage
//! positions are zero and their origin is marked as unknown. `Y_prev` is a raw earlier sample and
//! is skipped.
//!
//! The command of an instant is stamped one nanosecond before it. Readers that take "the last
//! command before" and "the last command up to" an instant then find the same command.

use super::{
    error::ImportError,
    report::{ImportReport, Notice, SkipReason},
    run::{ImportConfig, identity},
    tape::{Outgoing, Tape},
};
use crate::{
    board::{BoardSize, Frame},
    recording::{
        Split,
        message::{BoardState, CarriageState, ObjectState, VelocityCommand},
        topic::{self, Player},
    },
    units::{NANOS_PER_SECOND, Nanos},
};
use ndarray::{ArrayD, IxDyn, OwnedRepr};
use ndarray_npy::{NpzReader, ReadNpyError, ReadNpzError};
use std::{fs::File, io::BufReader, path::Path};

/// Sampling interval of these files (s).
pub const GRID_SECONDS: f64 = 0.02;
const GRID_NANOS: u64 = NANOS_PER_SECOND / 50;
/// Start time of a recording, late enough for a command before it.
const START: u64 = NANOS_PER_SECOND;
/// Time between the runs of successive windows.
const WINDOW_SPACING: u64 = NANOS_PER_SECOND;

const RUN_ARRAYS: [&str; 7] = [
    "player_pos",
    "player_vel",
    "opponent_pos",
    "opponent_vel",
    "ball_pos",
    "ball_vel",
    "player_actions",
];
const WINDOW_ARRAYS: [&str; 3] = ["X_commands", "X_states", "Y"];
const OLDER_ARRAYS: [&str; 2] = ["obs", "observations_real"];

/// Import an archive whose values are in `frame`. Files of the newer upstream builder are in
/// [`Frame::SimMirrored`].
///
/// # Errors
/// When the archive cannot be read, has another layout, holds non-finite values, or writing the
/// output fails.
pub fn import_npz(
    path: &Path,
    frame: Frame,
    board: BoardSize,
    config: &ImportConfig,
) -> Result<ImportReport, ImportError> {
    config.check_output()?;
    let mut archive = Archive::open(path)?;
    let mut tape = Tape::default();
    let split = config.split.or(split_of(path)).unwrap_or(Split::Train);
    let place = Place { frame, board };
    if archive.has(&RUN_ARRAYS) {
        push_run(&mut archive, place, &mut tape)?;
        tape.mark_run(0, "unknown", &split.to_string());
        tape.metadata.insert("carriage_origin".to_owned(), "camera".to_owned());
    } else if archive.has(&WINDOW_ARRAYS) {
        push_windows(&mut archive, place, split, &mut tape)?;
        tape.metadata.insert("carriage_origin".to_owned(), "unknown".to_owned());
    } else {
        return Err(archive.unknown_layout());
    }
    archive.note_skipped(&mut tape);
    for (key, value) in [
        ("velocity_source", "camera filter".to_owned()),
        ("source_frame", frame_name(frame).to_owned()),
        ("board_short_side_m", board.short_side.to_string()),
        ("board_long_side_m", board.long_side.to_string()),
    ] {
        tape.metadata.insert(key.to_owned(), value);
    }
    config.write(tape, path, split, &[identity(path)?])
}

fn frame_name(frame: Frame) -> &'static str {
    match frame {
        Frame::Image => "image",
        Frame::Sim => "sim",
        Frame::SimMirrored => "sim-mirrored",
    }
}

/// Return the split at the end of the upstream file names.
fn split_of(path: &Path) -> Option<Split> {
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    Split::from_text(stem.rsplit('_').next()?)
}

/// Conversion of the archive's numbers to the board frame.
#[derive(Clone, Copy)]
struct Place {
    frame: Frame,
    board: BoardSize,
}

impl Place {
    fn object(self, position: [f64; 2], velocity: [f64; 2]) -> ObjectState {
        let [x, y] = self.frame.position_in_board(self.board, position);
        let [vx, vy] = self.frame.velocity_in_board(velocity);
        ObjectState { x, y, vx, vy }
    }

    fn command(self, velocity: [f64; 2]) -> Outgoing {
        let [vx, vy] = self.frame.velocity_in_board(velocity);
        Outgoing::Command(VelocityCommand { vx, vy })
    }
}

fn push_run(archive: &mut Archive<'_>, place: Place, tape: &mut Tape) -> Result<(), ImportError> {
    let mut arrays = Vec::with_capacity(RUN_ARRAYS.len());
    for name in RUN_ARRAYS {
        arrays.push(archive.array(name)?);
    }
    let rows = arrays[0].shape().first().copied().unwrap_or(0);
    for (name, array) in RUN_ARRAYS.into_iter().zip(&arrays) {
        archive.expect_shape(name, array, &[rows, 2])?;
    }
    let pair = |array: usize, row: usize| [arrays[array][[row, 0]], arrays[array][[row, 1]]];
    for row in 0..rows {
        let now = Nanos(START + GRID_NANOS * row as u64);
        let left = place.object(pair(0, row), pair(1, row));
        let carriage = CarriageState { x: left.x, y: left.y, vx: left.vx, vy: left.vy };
        let state = BoardState {
            ball: Some(place.object(pair(4, row), pair(5, row))),
            left: Some(left),
            right: Some(place.object(pair(2, row), pair(3, row))),
            status: 0,
        };
        tape.push(&topic::command(Player::Left), Nanos(now.0 - 1), place.command(pair(6, row)));
        tape.push(&topic::carriage(Player::Left), now, Outgoing::Carriage(carriage));
        tape.push(topic::BOARD_STATE, now, Outgoing::Board(Box::new(state)));
    }
    Ok(())
}

/// Arrays of a windowed file; shapes (N, 2h), (N, 2h - 2), (N, k, 2), (N, k, 2).
struct Windows {
    past_commands: ArrayD<f64>,
    past_states: ArrayD<f64>,
    states: ArrayD<f64>,
    commands: Option<ArrayD<f64>>,
}

impl Windows {
    fn read(archive: &mut Archive<'_>) -> Result<Self, ImportError> {
        let windows = Self {
            past_commands: archive.array("X_commands")?,
            past_states: archive.array("X_states")?,
            states: archive.array("Y")?,
            commands: if archive.has(&["commands"]) {
                Some(archive.array("commands")?)
            } else {
                None
            },
        };
        let rows = windows.past_commands.shape().first().copied().unwrap_or(0);
        let columns = windows.past_commands.shape().get(1).copied().unwrap_or(0);
        // An odd or empty history has no expected shape; twenty columns are the usual ten steps.
        let columns = if columns < 2 || columns % 2 == 1 { 20 } else { columns };
        let horizon = windows.states.shape().get(1).copied().unwrap_or(0).max(1);
        archive.expect_shape("X_commands", &windows.past_commands, &[rows, columns])?;
        archive.expect_shape("X_states", &windows.past_states, &[rows, columns - 2])?;
        archive.expect_shape("Y", &windows.states, &[rows, horizon, 2])?;
        if let Some(commands) = &windows.commands {
            archive.expect_shape("commands", commands, &[rows, horizon, 2])?;
        }
        Ok(windows)
    }

    fn rows(&self) -> usize {
        self.past_commands.shape()[0]
    }

    fn history(&self) -> usize {
        self.past_commands.shape()[1] / 2
    }

    fn instants(&self) -> usize {
        self.history() - 1 + self.states.shape()[1]
    }

    /// Return the command at an instant, the oldest being 0; `None` where the file has no command.
    fn command(&self, row: usize, instant: usize) -> Option<[f64; 2]> {
        match (self.history() - 1).checked_sub(instant) {
            Some(age) => {
                let at = |axis| self.past_commands[[row, 2 * age + axis]];
                Some([at(0), at(1)])
            }
            None => {
                let commands = self.commands.as_ref()?;
                let ahead = instant + 1 - self.history();
                Some([commands[[row, ahead, 0]], commands[[row, ahead, 1]]])
            }
        }
    }

    /// Return the measured velocity at an instant, the oldest being 0.
    fn velocity(&self, row: usize, instant: usize) -> [f64; 2] {
        let now = self.history() - 1;
        if instant < now {
            let at = |axis| self.past_states[[row, 2 * (now - instant - 1) + axis]];
            [at(0), at(1)]
        } else {
            let at = |axis| self.states[[row, instant - now, axis]];
            [at(0), at(1)]
        }
    }
}

fn push_windows(
    archive: &mut Archive<'_>,
    place: Place,
    split: Split,
    tape: &mut Tape,
) -> Result<(), ImportError> {
    let windows = Windows::read(archive)?;
    let command_topic = topic::command(Player::Left);
    let carriage_topic = topic::carriage(Player::Left);
    let span = GRID_NANOS * windows.instants() as u64;
    let spacing = WINDOW_SPACING.max(2 * span);
    for (run, row) in (0_u32..).zip(0..windows.rows()) {
        let start = START + spacing * row as u64;
        for instant in 0..windows.instants() {
            let now = Nanos(start + GRID_NANOS * instant as u64);
            if let Some(command) = windows.command(row, instant) {
                tape.push(&command_topic, Nanos(now.0 - 1), place.command(command));
            }
            let [vx, vy] = place.frame.velocity_in_board(windows.velocity(row, instant));
            let state = CarriageState { x: 0.0, y: 0.0, vx, vy };
            tape.push(&carriage_topic, now, Outgoing::Carriage(state));
        }
        let last = start + GRID_NANOS * (windows.instants() as u64 - 1);
        tape.push_markers([Nanos(start - 1), Nanos(last)], run, "window", &split.to_string());
    }
    let what = "each window is a run of its own: the file does not link rows of one \
                another";
    tape.notices.push(Notice::Assumed { what: what.to_owned() });
    Ok(())
}

struct Archive<'a> {
    path: &'a Path,
    reader: NpzReader<BufReader<File>>,
    names: Vec<String>,
    used: Vec<&'static str>,
}

impl<'a> Archive<'a> {
    fn open(path: &'a Path) -> Result<Self, ImportError> {
        let file = File::open(path).map_err(ImportError::io(path, "open"))?;
        let wrong = |error: ReadNpzError| ImportError::Npz {
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let mut reader = NpzReader::new(BufReader::new(file)).map_err(wrong)?;
        let mut names = reader.names().map_err(wrong)?;
        names.sort();
        Ok(Self { path, reader, names, used: Vec::new() })
    }

    fn has(&self, wanted: &[&str]) -> bool {
        wanted.iter().all(|wanted| self.names.iter().any(|name| name == wanted))
    }

    fn unknown_layout(&self) -> ImportError {
        let older = self.names.iter().any(|name| OLDER_ARRAYS.contains(&name.as_str()));
        let hint = if older {
            "; this looks like an older layout, build it again with the newer upstream builder or \
             import the bags"
        } else {
            ""
        };
        ImportError::NpzLayout { path: self.path.to_owned(), found: self.names.clone(), hint }
    }

    /// Read an array of `f32` or `f64`, all values finite.
    fn array(&mut self, name: &'static str) -> Result<ArrayD<f64>, ImportError> {
        self.used.push(name);
        let single = self.reader.by_name::<OwnedRepr<f32>, IxDyn>(name);
        let array = match single {
            Ok(array) => array.mapv(f64::from),
            Err(ReadNpzError::Npy(ReadNpyError::WrongDescriptor(_))) => {
                self.reader.by_name::<OwnedRepr<f64>, IxDyn>(name).map_err(self.wrong(name))?
            }
            Err(error) => return Err(self.wrong(name)(error)),
        };
        let width = array.len() / array.shape().first().copied().unwrap_or(1).max(1);
        let bad = || array.iter().enumerate().filter(|(_, value)| !value.is_finite());
        match bad().next() {
            Some((first, _)) => Err(ImportError::NotFinite {
                path: self.path.to_owned(),
                place: format!("array {name}"),
                count: bad().count(),
                row: first / width.max(1),
            }),
            None => Ok(array),
        }
    }

    fn wrong(&self, name: &'static str) -> impl Fn(ReadNpzError) -> ImportError + use<> {
        let path = self.path.to_owned();
        move |error| ImportError::Npz {
            path: path.clone(),
            reason: format!("array {name}: {error}"),
        }
    }

    fn expect_shape(
        &self,
        name: &'static str,
        array: &ArrayD<f64>,
        expected: &[usize],
    ) -> Result<(), ImportError> {
        if array.shape() == expected && expected[0] != 0 {
            return Ok(());
        }
        let mut sizes: Vec<String> = expected.iter().map(usize::to_string).collect();
        if expected[0] == 0 {
            sizes[0] = "at least 1".to_owned();
        }
        Err(ImportError::NpzShape {
            path: self.path.to_owned(),
            name,
            found: array.shape().to_vec(),
            expected: format!("({})", sizes.join(", ")),
        })
    }

    fn note_skipped(&self, tape: &mut Tape) {
        for name in &self.names {
            if !self.used.contains(&name.as_str()) {
                tape.notices.push(Notice::Skipped {
                    topic: format!("array {name}"),
                    type_name: "npy".to_owned(),
                    messages: 1,
                    why: SkipReason::NotInContract,
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{ExistingFile, Recording};
    use ndarray::{Array1, Array2, Array3};
    use ndarray_npy::NpzWriter;

    fn import(
        write: impl FnOnce(&mut NpzWriter<File>),
        frame: Frame,
    ) -> Result<Recording, ImportError> {
        let folder = tempfile::tempdir().unwrap();
        let [source, output] =
            ["run_validation.npz", "out.mcap"].map(|name| folder.path().join(name));
        let mut writer = NpzWriter::new(File::create(&source).unwrap());
        write(&mut writer);
        writer.finish().unwrap();
        let config = ImportConfig::new(&output, ExistingFile::Refuse);
        import_npz(&source, frame, BoardSize::default(), &config)?;
        Ok(Recording::open(&output).unwrap())
    }

    fn write_run(writer: &mut NpzWriter<File>) {
        for (index, name) in RUN_ARRAYS.into_iter().enumerate() {
            let array = Array2::from_shape_fn((3, 2), |(row, axis)| {
                (index as f32 + 1.0) * 0.01 + row as f32 * 0.001 + axis as f32 * 0.1
            });
            writer.add_array(name, &array).unwrap();
        }
    }

    #[test]
    fn a_run_comes_out_in_the_board_frame() {
        for (frame, sign) in [(Frame::SimMirrored, -1.0), (Frame::Sim, 1.0)] {
            let recording = import(write_run, frame).unwrap();
            let commands =
                recording.series::<VelocityCommand>(&topic::command(Player::Left)).unwrap();
            assert_eq!(commands.times[1], Nanos(START + GRID_NANOS - 1));
            let command = &commands.values[1];
            assert!((command.vx - sign * 0.071).abs() < 1e-6, "{command:?}");
            assert!((command.vy - 0.171).abs() < 1e-6);
            let board = recording.series::<BoardState>(topic::BOARD_STATE).unwrap();
            let right = board.values[0].right.unwrap();
            assert!((right.x - sign * 0.03).abs() < 1e-6 && (right.vy - 0.14).abs() < 1e-6);
            assert_eq!(recording.info("velocity_source"), Some("camera filter"));
            assert_eq!(recording.info("split"), Some("validation"));
        }
    }

    /// Write velocity k at instant k of the window, and command 100 + k.
    fn write_windows(writer: &mut NpzWriter<File>) {
        let past = |first: f32| {
            move |(row, column): (usize, usize)| {
                first - (column / 2) as f32 + 1000.0 * row as f32 + 0.5 * (column % 2) as f32
            }
        };
        let ahead = |first: f32| {
            move |(row, step, axis): (usize, usize, usize)| {
                first + step as f32 + 1000.0 * row as f32 + 0.5 * axis as f32
            }
        };
        writer.add_array("X_commands", &Array2::from_shape_fn((2, 20), past(109.0))).unwrap();
        writer.add_array("X_states", &Array2::from_shape_fn((2, 18), past(8.0))).unwrap();
        writer.add_array("Y", &Array3::from_shape_fn((2, 3, 2), ahead(9.0))).unwrap();
        writer.add_array("Y_prev", &Array3::<f32>::zeros((2, 3, 2))).unwrap();
        writer.add_array("commands", &Array3::from_shape_fn((2, 3, 2), ahead(109.0))).unwrap();
    }

    #[test]
    fn each_window_becomes_a_run_in_order_of_time() {
        let recording = import(write_windows, Frame::Sim).unwrap();
        let commands = recording.series::<VelocityCommand>(&topic::command(Player::Left)).unwrap();
        let states = recording.series::<CarriageState>(&topic::carriage(Player::Left)).unwrap();
        assert_eq!((commands.values.len(), states.values.len()), (24, 24));
        for k in 0..12 {
            let row = 1000.0 + k as f64;
            let (command, state) = (&commands.values[12 + k], &states.values[12 + k]);
            assert_eq!((command.vx, command.vy), (row + 100.0, row + 100.5));
            assert_eq!((state.vx, state.vy), (row, row + 0.5));
        }
        let markers = recording.markers().unwrap();
        assert_eq!(markers.values.len(), 4);
        assert_eq!((markers.values[2].run, markers.values[2].pattern.as_str()), (1, "window"));
        assert_eq!(markers.times[2], Nanos(2 * NANOS_PER_SECOND - 1));
        assert_eq!(recording.info("carriage_origin"), Some("unknown"));
    }

    #[test]
    fn other_archives_are_refused_with_their_arrays() {
        let error = import(
            |writer| {
                writer.add_array("obs", &Array2::<f32>::zeros((3, 12))).unwrap();
                writer.add_array("actions", &Array2::<f32>::zeros((3, 2))).unwrap();
            },
            Frame::Sim,
        );
        let message = error.unwrap_err().to_string();
        assert!(
            message.contains("holds the arrays actions, obs; expected player_pos"),
            "{message}"
        );
        assert!(message.contains("older layout"), "{message}");
        let message = import(
            |writer| {
                for name in RUN_ARRAYS {
                    writer.add_array(name, &Array1::<f32>::zeros(3)).unwrap();
                }
            },
            Frame::Sim,
        )
        .unwrap_err()
        .to_string();
        assert!(message.contains("array player_pos has shape [3]; expected (3, 2)"), "{message}");
        let message = import(
            |writer| {
                let mut array = Array2::<f64>::zeros((3, 2));
                array[[1, 1]] = f64::NAN;
                for name in RUN_ARRAYS {
                    writer.add_array(name, &array).unwrap();
                }
            },
            Frame::Sim,
        )
        .unwrap_err()
        .to_string();
        assert!(
            message.contains(
                "array player_pos holds 1 values that are not finite, the first in row 1"
            ),
            "{message}"
        );
    }
}
