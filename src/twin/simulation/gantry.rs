//! Open-loop simulation of a table: velocity commands to motors, carriage and striker.

use super::{SimulationError, check_length};
use crate::{
    effects::Domain,
    gantry::rails,
    recording::{
        Recording,
        message::{CarriageState, VelocityCommand},
        topic::{self, Player},
    },
    twin::{
        CameraStage, Channel, DriveStage, Machine, MeasuredPath, Output, Stage, Twin,
        drive::RunStart, session::STRIKER_HEIGHT,
    },
};
use std::path::Path;

/// Step of the carriage path from which the striker is simulated (s).
const PATH_STEP: f64 = 1e-3;
/// Time by which the simulation outlasts the last sample, so that rounding loses none (s).
const MARGIN: f64 = 1e-6;

/// Velocity commands of one carriage, each held until the next.
#[derive(Debug, Clone, PartialEq)]
pub struct TableCommands {
    /// Player whose carriage they move.
    pub player: Player,
    /// Time of each command since the simulation began (s), increasing.
    pub times: Vec<f64>,
    /// Velocity in the board frame (m/s).
    pub velocities: Vec<[f64; 2]>,
    /// Time from a command to its arrival at each motor (s).
    pub arrivals: [f64; 2],
    /// End of the simulation (s).
    pub end: f64,
    /// Initial position of the carriage (m).
    pub start: [f64; 2],
}

impl TableCommands {
    /// Check commands of the file `path` and set the end of the simulation to the last of them.
    ///
    /// # Errors
    /// No command, a value that is not finite, or a duration beyond the longest simulation.
    pub fn new(
        path: &Path,
        player: Player,
        times: Vec<f64>,
        velocities: Vec<[f64; 2]>,
    ) -> Result<Self, SimulationError> {
        let Some(end) = times.last().copied() else {
            let expected = topic::command(player);
            return Err(SimulationError::NoCommands { path: path.to_owned(), expected });
        };
        check_length(path, end)?;
        let wrong = velocities.iter().position(|own| !own.iter().all(|value| value.is_finite()));
        if let Some(time) = wrong.map(|index| times[index]) {
            return Err(SimulationError::NotFinite { path: path.to_owned(), time });
        }
        Ok(Self { player, times, velocities, arrivals: [0.0; 2], end, start: [0.0; 2] })
    }

    /// Commands of `player` in a recording; without `player`, of the one with more commands. The
    /// simulation starts at the first measured position of the carriage, or at the centre.
    ///
    /// # Errors
    /// When a message does not decode, there are no commands, or they cannot be simulated.
    pub fn from_recording(
        recording: &Recording,
        player: Option<Player>,
    ) -> Result<Self, SimulationError> {
        let count = |player: Player| recording.count(&topic::command(player));
        let busier =
            if count(Player::Left) < count(Player::Right) { Player::Right } else { Player::Left };
        let player = player.unwrap_or(busier);
        let series = recording.series::<VelocityCommand>(&topic::command(player))?;
        if series.times.is_empty() && has_axis(recording) {
            return Err(SimulationError::OtherMachine {
                path: recording.path.clone(),
                commands: Machine::Axis,
                twin: Machine::Table,
            });
        }
        let (origin, last) = recording.time_range().unwrap_or_default();
        let times = series.times.iter().map(|time| time.seconds_since(origin)).collect();
        let velocities = series.values.iter().map(|own| [own.vx, own.vy]).collect();
        let commands = Self::new(&recording.path, player, times, velocities)?;
        let end = last.seconds_since(origin);
        check_length(&recording.path, end)?;
        let carriage = recording.series::<CarriageState>(&topic::carriage(player))?;
        let start = carriage.values.first().map_or([0.0; 2], |first| [first.x, first.y]);
        Ok(Self { arrivals: recording.command_arrivals(player)?, end, start, ..commands })
    }
}

/// Return whether `recording` has the input of a single axis.
fn has_axis(recording: &Recording) -> bool {
    let is_input = |topic: &str| topic::schema_of(topic) == Some("klasktron.AxisInput");
    recording.channels.iter().any(|own| is_input(&own.topic) && !own.messages.is_empty())
}

/// Simulated motion of one carriage and its striker.
#[derive(Debug, Clone, PartialEq)]
pub struct TableMotion {
    /// Times of the samples (s).
    pub times: Vec<f64>,
    /// Position of each motor by its encoder (m of belt).
    pub motor_position: [Vec<f64>; 2],
    /// Velocity of each motor as its drive reports it (m/s of belt).
    pub motor_velocity: [Vec<f64>; 2],
    /// Torque of each motor as its drive reports it (N m).
    pub motor_torque: [Vec<f64>; 2],
    /// Striker as a frame of the camera at each of `times` would show it (m).
    pub striker: Vec<[f64; 2]>,
    /// Times of the camera frames (s).
    pub frame_times: Vec<f64>,
    /// Striker in each frame (m).
    pub frames: Vec<[f64; 2]>,
}

impl TableMotion {
    /// Position of the carriage by the encoders at sample `index` (m).
    #[must_use]
    pub fn position(&self, index: usize) -> [f64; 2] {
        rails([self.motor_position[0][index], self.motor_position[1][index]])
    }

    /// Velocity of the carriage as the drives report it at sample `index` (m/s).
    #[must_use]
    pub fn velocity(&self, index: usize) -> [f64; 2] {
        rails([self.motor_velocity[0][index], self.motor_velocity[1][index]])
    }
}

/// Times from 0 to `end` (s) at `rate` (Hz), both ends included where the rate meets them.
fn grid(end: f64, rate: f64) -> Vec<f64> {
    let last = (end * rate + 1e-6).floor() as usize;
    (0..=last).map(|index| index as f64 / rate).collect()
}

/// A channel without measurements at `times`.
fn channel(times: &[f64], domain: Domain) -> Channel {
    let run = 0..times.len();
    Channel {
        signal: String::new(),
        unit: "",
        domain,
        axis: "",
        rate_hz: 0.0,
        times: times.to_vec(),
        measured: vec![f64::NAN; times.len()],
        runs: vec![run],
    }
}

/// Simulate `twin` under `commands`, sampled at `rate` (Hz) with camera frames at `frame_rate` (Hz).
#[must_use]
pub fn simulate_table(
    twin: &Twin,
    commands: &TableCommands,
    rate: f64,
    frame_rate: f64,
) -> TableMotion {
    let times = grid(commands.end, rate);
    let path_times = grid(commands.end, 1.0 / PATH_STEP);
    let sampled =
        [Output::Position(0), Output::Position(1), Output::Velocity(0), Output::Velocity(1)];
    let outputs = [sampled.as_slice(), &[Output::Torque(0), Output::Torque(1)], &sampled].concat();
    let [mut a, mut b, mut va, mut vb, ta, tb, pa, pb, wa, wb] =
        drive(twin, commands, outputs, &times, &path_times);
    // The encoders start at the initial position of the carriage, for any error that they have
    // there.
    let path = MeasuredPath::new(
        path_times,
        pa.iter().zip(&pb).map(|(a, b)| rails([*a, *b])).collect(),
        wa.iter().zip(&wb).map(|(a, b)| rails([*a, *b])).collect(),
    );
    let frame_times = grid(commands.end, frame_rate);
    let own = |column: &mut Vec<f64>| std::mem::take(column);
    TableMotion {
        striker: striker(twin, &path, &times),
        frames: striker(twin, &path, &frame_times),
        motor_position: [own(&mut a), own(&mut b)],
        motor_velocity: [own(&mut va), own(&mut vb)],
        motor_torque: [ta, tb],
        times,
        frame_times,
    }
}

/// Outputs of the drives: the first six at `times`, the others at `path_times` (s).
fn drive(
    twin: &Twin,
    commands: &TableCommands,
    outputs: Vec<Output>,
    times: &[f64],
    path_times: &[f64],
) -> [Vec<f64>; 10] {
    let at = |index: usize| if index < 6 { times } else { path_times };
    let channels: Vec<Channel> =
        (0..outputs.len()).map(|index| channel(at(index), Domain::Drive)).collect();
    let stage = DriveStage {
        command_times: commands.times.clone(),
        arrivals: commands.arrivals,
        commands: commands.velocities.clone(),
        starts: vec![RunStart {
            time: 0.0,
            end: commands.end + MARGIN,
            position: commands.start,
            velocity: [0.0; 2],
            fresh: true,
        }],
        channels,
        outputs,
        path: None,
    };
    let mut predicted: [Vec<f64>; 10] = std::array::from_fn(|index| vec![0.0; at(index).len()]);
    stage.predict(twin, &[], &mut predicted);
    predicted
}

/// Striker that the camera shows at `times` (s) of a carriage on `path`.
fn striker(twin: &Twin, path: &MeasuredPath, times: &[f64]) -> Vec<[f64; 2]> {
    let stage = CameraStage {
        carriage: path.clone(),
        channels: vec![channel(times, Domain::Sensor), channel(times, Domain::Sensor)],
        height: STRIKER_HEIGHT,
        has_drives: false,
        losses: None,
    };
    let mut predicted = [vec![0.0; times.len()], vec![0.0; times.len()]];
    stage.predict(twin, &[vec![0.0; 2]], &mut predicted);
    let [x, y] = predicted;
    x.into_iter().zip(y).map(<[f64; 2]>::from).collect()
}
