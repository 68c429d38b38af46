//! Recordings as sessions: each link's measured input and output, cut into runs.

use super::{
    AxisError, AxisStage, BallStage, CameraStage, Channel, DriveStage, EstimatorStage,
    MeasuredPath, Stage, StageKind,
    drive::{Output, RunStart, SETTLING},
    plant::{belts, rails},
};
use crate::{
    effects::Domain,
    gantry::BELT_METRES_PER_TURN,
    recording::{
        Recording, RecordingError, Split,
        message::{CameraDetections, CarriageState, MotorState, VelocityCommand},
        topic::{self, Motor, Player},
    },
    units::Nanos,
};
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Length of the runs into which a recording without markers is cut (s).
const UNMARKED_RUN: f64 = 5.0;

/// A pause of the recording after which the plant starts anew (s).
const PAUSE: f64 = 0.2;

/// What kind of machine a twin describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Machine {
    /// The KlaskTron table: two motors, two rails, magnet, striker, camera, ball.
    Table,
    /// A single axis.
    Axis,
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Table => "table",
            Self::Axis => "single axis",
        })
    }
}

/// What kind of machine `sessions` were recorded on: a single axis when nothing else is there.
#[must_use]
pub fn machine_of(sessions: &[Session]) -> Machine {
    let only_axes =
        |session: &Session| session.stages().iter().all(|stage| stage.kind() == StageKind::Axis);
    if sessions.iter().all(only_axes) { Machine::Axis } else { Machine::Table }
}

impl Machine {
    /// Motors of one gantry.
    #[must_use]
    pub fn motors(self) -> usize {
        match self {
            Self::Table => 2,
            Self::Axis => 1,
        }
    }
}

/// Why a recording gives no session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// It could not be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A single axis cannot be used.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// A given twin describes another kind of machine.
    #[error(
        "the twin describes a {twin}, the recordings a {recorded}; give the twin of that machine"
    )]
    OtherMachine {
        /// Of the twin.
        twin: Machine,
        /// Of the recordings.
        recorded: Machine,
    },
    /// None of the links has both input and output.
    #[error(
        "{path} holds no link with measured input and output: needed are commands with motor or \
         carriage states, carriage with camera, free rolls of the ball, or /axis/NAME/input with \
         /axis/NAME/output"
    )]
    NoLink {
        /// The file.
        path: String,
    },
}

/// One scripted run, or a piece of a recording without markers.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Start and end (s since the recording began).
    pub span: Range<f64>,
    /// Name of its pattern; empty without markers.
    pub pattern: String,
    /// What it may be used for, where markers or metadata say.
    pub split: Option<Split>,
}

/// One recording, or the part of it that has one purpose.
pub struct Session {
    /// File name without folder and ending, or the session's name from the metadata.
    pub name: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// What it may be used for.
    pub split: Split,
    /// Its runs.
    pub runs: Vec<Run>,
    /// The whole recording's length (s).
    pub length: f64,
    /// How many commands were recorded.
    pub commands: usize,
    /// Commands to motors.
    pub drive: Option<DriveStage>,
    /// Carriage to camera.
    pub camera: Option<CameraStage>,
    /// Free rolls.
    pub ball: Option<BallStage>,
    /// Positions to reported velocities.
    pub estimator: Option<EstimatorStage>,
    /// Single axes.
    pub axes: Vec<AxisStage>,
}

impl Session {
    /// Whether a carriage moved and nothing says what moved it.
    #[must_use]
    pub fn is_without_input(&self) -> bool {
        self.commands == 0 && self.ball.is_none() && self.axes.is_empty()
    }

    /// Its links.
    #[must_use]
    pub fn stages(&self) -> Vec<&dyn Stage> {
        let mut stages: Vec<&dyn Stage> = Vec::new();
        stages.extend(self.drive.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.camera.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.estimator.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.ball.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.axes.iter().map(|stage| stage as &dyn Stage));
        stages
    }
}

/// Seconds since `origin`.
pub(super) fn seconds(time: Nanos, origin: Nanos) -> f64 {
    (time.0 as i128 - origin.0 as i128) as f64 * 1e-9
}

/// The runs of a recording by its markers; pieces of equal length without any.
///
/// # Errors
/// When a marker does not decode.
pub fn runs_of(recording: &Recording) -> Result<Vec<Run>, RecordingError> {
    let Some((origin, end)) = recording.time_range() else { return Ok(Vec::new()) };
    let whole = recording.info("split").and_then(Split::from_text);
    let markers = recording.markers()?;
    let mut runs: Vec<Run> = Vec::new();
    let mut open: Vec<(u32, f64, String, Option<Split>)> = Vec::new();
    for (time, marker) in markers.iter() {
        let at = seconds(time, origin);
        if marker.phase == 0 {
            open.retain(|(run, ..)| *run != marker.run);
            let split = Split::from_text(&marker.split).or(whole);
            open.push((marker.run, at, marker.pattern.clone(), split));
        } else if let Some(index) = open.iter().position(|(run, ..)| *run == marker.run) {
            let (_, start, pattern, split) = open.remove(index);
            if start < at {
                runs.push(Run { span: start..at, pattern, split });
            }
        }
    }
    let length = seconds(end, origin);
    if runs.is_empty() {
        let count = (length / UNMARKED_RUN).floor().max(1.0);
        let each = length / count;
        runs = (0..count as usize)
            .map(|k| Run {
                span: k as f64 * each..(k + 1) as f64 * each,
                pattern: String::new(),
                split: whole,
            })
            .collect();
    }
    runs.sort_by(|a, b| a.span.start.total_cmp(&b.span.start));
    Ok(runs)
}

/// Readings of one signal, in order.
#[derive(Debug, Clone, Default)]
pub(super) struct Readings<const N: usize> {
    pub(super) times: Vec<f64>,
    pub(super) values: Vec<[f64; N]>,
}

impl<const N: usize> Readings<N> {
    /// Readings with increasing times: what repeats a time is left out.
    pub(super) fn collect(from: impl Iterator<Item = (f64, [f64; N])>) -> Self {
        let mut readings = Self::default();
        for (time, value) in from {
            if readings.times.last().is_none_or(|last| last + 1e-9 < time) {
                readings.times.push(time);
                readings.values.push(value);
            }
        }
        readings
    }

    /// Median distance between readings (s); `None` below two.
    pub(super) fn period(&self) -> Option<f64> {
        let steps: Vec<f64> = self.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        crate::stats::median(&steps)
    }

    /// The same on an even index: where readings are missing, empty ones (NaN) are put in.
    pub(super) fn evened(&self) -> Self {
        let Some(period) = self.period() else { return self.clone() };
        let mut even = Self::default();
        for (index, time) in self.times.iter().enumerate() {
            if let Some(last) = even.times.last().copied() {
                let gap: f64 = time - last;
                let missing = (gap / period).round() as usize;
                if missing < 1000 {
                    for k in 1..missing {
                        even.times.push(last + gap * k as f64 / missing as f64);
                        even.values.push([f64::NAN; N]);
                    }
                }
            }
            even.times.push(*time);
            even.values.push(self.values[index]);
        }
        even
    }

    /// Indices of the readings in each of `spans`.
    pub(super) fn indices(&self, spans: &[Range<f64>]) -> Vec<Range<usize>> {
        let place = |time: f64| self.times.partition_point(|at| *at < time - 1e-9);
        spans.iter().map(|span| place(span.start)..place(span.end)).collect()
    }

    /// One channel out of the `column`th value, for the given runs.
    pub(super) fn channel(
        &self,
        column: usize,
        scale: f64,
        spans: &[Range<f64>],
        name: (&str, &'static str, Domain, &'static str),
    ) -> Channel {
        let (signal, unit, domain, axis) = name;
        Channel {
            signal: signal.to_owned(),
            unit,
            domain,
            axis,
            rate_hz: self.period().map_or(0.0, |period| 1.0 / period),
            times: self.times.clone(),
            measured: self.values.iter().map(|value| scale * value[column]).collect(),
            runs: self.indices(spans),
        }
    }
}

/// Motors of one gantry: position and velocity in metres of belt, torque in N m (NaN without).
fn motor_readings(
    recording: &Recording,
    player: Player,
    origin: Nanos,
) -> Result<Option<[Readings<3>; 2]>, RecordingError> {
    let mut both = [Readings::default(), Readings::default()];
    for (readings, motor) in both.iter_mut().zip([Motor::A, Motor::B]) {
        let series = recording.series::<MotorState>(&topic::motor(player, motor))?;
        *readings = Readings::collect(series.iter().map(|(time, state)| {
            let torque = state.torque_estimate_nm.or(state.torque_target_nm).unwrap_or(f64::NAN);
            let position = state.position_turns * BELT_METRES_PER_TURN;
            let velocity = state.velocity_turns_per_s * BELT_METRES_PER_TURN;
            (seconds(time, origin), [position, velocity, torque])
        }));
    }
    let usable = both.iter().all(|readings| 10 < readings.times.len());
    Ok(usable.then_some(both))
}

/// Carriage: position and velocity in board coordinates.
fn carriage_readings(
    recording: &Recording,
    player: Player,
    origin: Nanos,
) -> Result<Readings<4>, RecordingError> {
    let series = recording.series::<CarriageState>(&topic::carriage(player))?;
    Ok(Readings::collect(
        series
            .iter()
            .map(|(time, state)| (seconds(time, origin), [state.x, state.y, state.vx, state.vy])),
    ))
}

/// Carriage out of the motors' positions, for recordings without the carriage's topic.
fn carriage_of_motors(motors: &[Readings<3>; 2]) -> Readings<4> {
    let [a, b] = motors;
    let mut cursor = 0;
    Readings::collect(a.times.iter().zip(&a.values).filter_map(|(time, value)| {
        while cursor + 1 < b.times.len()
            && (b.times[cursor + 1] - time).abs() <= (b.times[cursor] - time).abs()
        {
            cursor += 1;
        }
        let other = b.values.get(cursor)?;
        let place = rails([value[0], other[0]]);
        let velocity = rails([value[1], other[1]]);
        Some((*time, [place[0], place[1], velocity[0], velocity[1]]))
    }))
}

/// Motors out of the carriage, for recordings without the motors' topics.
fn motors_of_carriage(carriage: &Readings<4>) -> [Readings<3>; 2] {
    [0, 1].map(|k| {
        Readings::collect(carriage.times.iter().zip(&carriage.values).map(|(time, value)| {
            let position = belts([value[0], value[1]])[k];
            let velocity = belts([value[2], value[3]])[k];
            (*time, [position, velocity, f64::NAN])
        }))
    })
}

/// The drive's link of one gantry.
///
/// # Errors
/// When a message does not decode.
pub(super) fn drive_stage(
    recording: &Recording,
    player: Player,
    runs: &[Run],
) -> Result<Option<DriveStage>, RecordingError> {
    let Some((origin, _)) = recording.time_range() else { return Ok(None) };
    let commands = recording.series::<VelocityCommand>(&topic::command(player))?;
    let carriage = carriage_readings(recording, player, origin)?;
    let motors = match motor_readings(recording, player, origin)? {
        Some(motors) => motors,
        None if 10 < carriage.times.len() => motors_of_carriage(&carriage),
        None => return Ok(None),
    };
    if commands.times.len() < 10 {
        return Ok(None);
    }
    let carriage = if 10 < carriage.times.len() { carriage } else { carriage_of_motors(&motors) };
    let starts: Vec<RunStart> = run_starts(runs, &carriage);
    let spans: Vec<Range<f64>> = starts
        .iter()
        .map(|start| start.time + if start.fresh { SETTLING } else { 0.0 }..start.end)
        .collect();
    let mut channels = Vec::new();
    let mut outputs = Vec::new();
    let torque_names = ["motor_a.torque", "motor_b.torque"];
    let velocity_names = ["motor_a.velocity", "motor_b.velocity"];
    let axes = ["a", "b"];
    for k in 0..2 {
        let even = motors[k].evened();
        let name = (velocity_names[k], "m/s", Domain::Drive, axes[k]);
        channels.push(even.channel(1, 1.0, &spans, name));
        outputs.push(Output::Velocity(k));
        if even.values.iter().filter(|value| value[2].is_finite()).count() * 2 > even.values.len() {
            let name = (torque_names[k], "N m", Domain::Drive, axes[k]);
            channels.push(even.channel(2, 1.0, &spans, name));
            outputs.push(Output::Torque(k));
        }
    }
    Ok(Some(DriveStage {
        command_times: commands.times.iter().map(|time| seconds(*time, origin)).collect(),
        commands: commands.values.iter().map(|command| [command.vx, command.vy]).collect(),
        starts,
        channels,
        outputs,
    }))
}

fn run_starts(runs: &[Run], carriage: &Readings<4>) -> Vec<RunStart> {
    let mut starts: Vec<RunStart> = Vec::new();
    for run in runs {
        let first = carriage.times.partition_point(|time| *time < run.span.start - 1e-9);
        let Some(value) = carriage.values.get(first) else { continue };
        let time = carriage.times[first];
        if run.span.end <= time {
            continue;
        }
        let fresh = starts.last().is_none_or(|last| last.end + PAUSE < time);
        starts.push(RunStart {
            time,
            end: run.span.end,
            position: [value[0], value[1]],
            velocity: [value[2], value[3]],
            fresh,
        });
    }
    starts
}

/// The link from carriage to camera of one gantry.
///
/// # Errors
/// When a message does not decode.
pub(super) fn camera_stage(
    recording: &Recording,
    player: Player,
    runs: &[Run],
) -> Result<Option<CameraStage>, RecordingError> {
    let Some((origin, _)) = recording.time_range() else { return Ok(None) };
    let mut carriage = carriage_readings(recording, player, origin)?;
    if carriage.times.len() <= 10 {
        match motor_readings(recording, player, origin)? {
            Some(motors) => carriage = carriage_of_motors(&motors),
            None => return Ok(None),
        }
    }
    let frames = recording.series::<CameraDetections>(topic::CAMERA_DETECTIONS)?;
    let seen = Readings::<2>::collect(frames.iter().map(|(time, frame)| {
        let point = match player {
            Player::Left => &frame.left,
            Player::Right => &frame.right,
        };
        let at = if frame.capture_time_ns == 0 { time } else { Nanos(frame.capture_time_ns) };
        let place = point.as_ref().map_or([f64::NAN; 2], |point| [point.x, point.y]);
        (seconds(at, origin), place)
    }))
    .evened();
    if seen.values.iter().filter(|value| value[0].is_finite()).count() < 20 {
        return Ok(None);
    }
    let spans: Vec<Range<f64>> = runs.iter().map(|run| run.span.clone()).collect();
    let x = ("camera.striker_x", "m", Domain::Sensor, "x");
    let y = ("camera.striker_y", "m", Domain::Sensor, "y");
    let channels = vec![seen.channel(0, 1.0, &spans, x), seen.channel(1, 1.0, &spans, y)];
    let path = MeasuredPath::new(
        carriage.times,
        carriage.values.iter().map(|value| [value[0], value[1]]).collect(),
        carriage.values.iter().map(|value| [value[2], value[3]]).collect(),
    );
    Ok(Some(CameraStage { carriage: path, channels, height: STRIKER_HEIGHT }))
}

/// Height of the striker's mark above the board (m).
const STRIKER_HEIGHT: f64 = 0.02;

impl Machine {
    /// The places at which an effect of `site` may act on this machine.
    #[must_use]
    pub fn axes(self, site: crate::effects::Site) -> Vec<crate::effects::Axis> {
        use crate::effects::{Axis, Site};
        match self {
            Self::Table => site.axes().to_vec(),
            // One motor is one rail: the place is written one way.
            Self::Axis => match site {
                Site::Motors => vec![Axis::Motors],
                Site::OneMotor => Vec::new(),
                Site::Rails | Site::MotorsAndRails => vec![Axis::Rails],
                Site::Whole => vec![Axis::Whole],
            },
        }
    }
}

/// Every this many runs one is held out, where recordings do not say what is for what.
const HELD_OUT_EVERY: usize = 3;

/// The sessions of `recordings`: each file's runs by their purpose. Where nothing says what is held
/// out, it is the last of several recordings, or every third run of one.
///
/// # Errors
/// When a message does not decode, or a recording has no link that can be compared.
pub fn sessions_of(recordings: &[Recording]) -> Result<Vec<Session>, SessionError> {
    let mut runs: Vec<Vec<Run>> =
        recordings.iter().map(runs_of).collect::<Result<_, RecordingError>>()?;
    divide(&mut runs);
    let mut sessions = Vec::new();
    for (recording, runs) in recordings.iter().zip(&runs) {
        let before = sessions.len();
        for split in [Split::Train, Split::Validation] {
            let own: Vec<Run> =
                runs.iter().filter(|run| run.split == Some(split)).cloned().collect();
            if own.is_empty() {
                continue;
            }
            let session = session_of(recording, own, split)?;
            if !session.stages().is_empty() {
                sessions.push(session);
            }
        }
        if sessions.len() == before {
            return Err(SessionError::NoLink { path: recording.path.display().to_string() });
        }
    }
    Ok(sessions)
}

fn session_name(recording: &Recording) -> String {
    recording.info("session").map_or_else(
        || recording.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        str::to_owned,
    )
}

/// Gives every run of every recording a purpose, where markers and metadata leave it open: the last of
/// several recordings is held out, or every third run of one.
pub fn divide(recordings: &mut [Vec<Run>]) {
    let says = |split| move |runs: &Vec<Run>| runs.iter().any(|run| run.split == Some(split));
    let held_out_known = recordings.iter().any(says(Split::Validation));
    let several = 1 < recordings.len();
    let last = recordings.len().saturating_sub(1);
    for (index, runs) in recordings.iter_mut().enumerate() {
        for (number, run) in runs.iter_mut().enumerate() {
            let held_out = !held_out_known
                && if several {
                    index == last
                } else {
                    number % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
                };
            if held_out {
                run.split = Some(Split::Validation);
            } else {
                run.split = run.split.or(Some(Split::Train));
            }
        }
    }
}

/// The links of one recording, in `runs`.
fn session_of(
    recording: &Recording,
    runs: Vec<Run>,
    split: Split,
) -> Result<Session, SessionError> {
    let player = moving_player(recording)?;
    let (mut drive, mut camera, mut commands) = (None, None, 0);
    if let Some(player) = player {
        drive = drive_stage(recording, player, &runs)?;
        camera = camera_stage(recording, player, &runs)?;
        commands = recording.count(&topic::command(player));
    }
    let spans: Vec<Range<f64>> = runs.iter().map(|run| run.span.clone()).collect();
    Ok(Session {
        name: session_name(recording),
        sha256: recording.sha256.clone(),
        split,
        length: recording.time_range().map_or(0.0, |(start, end)| seconds(end, start)),
        commands,
        runs,
        drive,
        camera,
        ball: BallStage::from_recording(recording, &spans)?,
        estimator: EstimatorStage::from_recording(recording)?,
        axes: AxisStage::from_runs(recording, &spans)?,
    })
}

/// The gantry with the longest way; the left one of equals.
fn moving_player(recording: &Recording) -> Result<Option<Player>, RecordingError> {
    let Some((origin, _)) = recording.time_range() else { return Ok(None) };
    let mut best = None;
    let mut longest = -1.0;
    for player in Player::BOTH {
        let mut carriage = carriage_readings(recording, player, origin)?;
        if carriage.times.is_empty()
            && let Some(motors) = motor_readings(recording, player, origin)?
        {
            carriage = carriage_of_motors(&motors);
        }
        let travel: f64 = carriage
            .values
            .windows(2)
            .map(|pair| (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]))
            .sum();
        if !carriage.values.is_empty() && longest < travel {
            (longest, best) = (travel, Some(player));
        }
    }
    Ok(best)
}
