//! Observations as recordings of the data contract.

use crate::{
    axis::{AxisTrace, RATE},
    ball::{BallFrame, PAUSE, ROLL},
    gantry::HOME,
    observe::{Observation, SAMPLE},
    plan::{PERIOD, Run},
};
use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RecordingError, RecordingWriter, Split,
        message::{
            AxisInput, AxisOutput, BoardState, CameraDetections, CarriageState, MotorState,
            ObjectState, Point, RunMarker, VelocityCommand, run_marker::Phase,
        },
        topic::{self, Motor, Player},
    },
    units::Nanos,
};
use std::{collections::BTreeMap, path::Path};

/// Start of every recording (ns).
const EPOCH: u64 = 1_763_000_000_000_000_000;

/// Name, split and start of a file.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Label<'a> {
    pub(crate) session: &'a str,
    pub(crate) split: Split,
}

/// Messages gathered by time, so that the file is in order.
struct Sheet {
    entries: Vec<(u64, u32, Entry)>,
}

enum Entry {
    Command(VelocityCommand),
    Motor(Motor, MotorState),
    Carriage(CarriageState),
    Camera(CameraDetections),
    State(BoardState),
    Marker(RunMarker),
    Input(AxisInput),
    Output(AxisOutput),
}

impl Sheet {
    fn new() -> Self {
        Self { entries: Vec::new() }
    }

    fn add(&mut self, time: f64, entry: Entry) {
        let at = EPOCH + (time.max(0.0) * 1e9).round() as u64;
        let rank = match entry {
            Entry::Marker(ref marker) => u32::from(marker.phase == Phase::Start as i32),
            _ => 2,
        };
        self.entries.push((at, rank, entry));
    }

    fn write(mut self, path: &Path, label: Label<'_>, extra: &[(&str, String)]) -> Outcome {
        self.entries.sort_by_key(|(time, rank, _)| (*time, *rank));
        let mut writer =
            RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull)?;
        let mut metadata: BTreeMap<String, String> = [
            ("schema_version", "1"),
            ("source", "hardware"),
            ("session", label.session),
            ("robot", "klasktron"),
        ]
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect();
        metadata.insert("split".to_owned(), label.split.to_string());
        metadata.extend(extra.iter().map(|(key, value)| ((*key).to_owned(), value.clone())));
        writer.metadata(klasktron::recording::RECORDING_METADATA, metadata)?;
        for (time, _, entry) in &self.entries {
            put(&mut writer, Nanos(*time), entry)?;
        }
        writer.finish()
    }

    fn markers(&mut self, runs: &[Run], split: Split) {
        for (index, run) in runs.iter().enumerate() {
            for (time, phase) in [(run.start, Phase::Start), (run.end, Phase::End)] {
                let marker = RunMarker {
                    run: index as u32,
                    pattern: run.pattern.to_owned(),
                    phase: phase as i32,
                    split: split.to_string(),
                };
                self.add(time, Entry::Marker(marker));
            }
        }
    }
}

type Outcome = Result<(), RecordingError>;

fn put(writer: &mut RecordingWriter, at: Nanos, entry: &Entry) -> Outcome {
    let left = Player::Left;
    match entry {
        Entry::Command(message) => writer.write(&topic::command(left), at, message),
        Entry::Motor(motor, message) => writer.write(&topic::motor(left, *motor), at, message),
        Entry::Carriage(message) => writer.write(&topic::carriage(left), at, message),
        Entry::Camera(message) => writer.write(topic::CAMERA_DETECTIONS, at, message),
        Entry::State(message) => writer.write(topic::BOARD_STATE, at, message),
        Entry::Marker(message) => writer.write(topic::RUN_MARKER, at, message),
        Entry::Input(message) => writer.write(&topic::axis_input(AXIS), at, message),
        Entry::Output(message) => writer.write(&topic::axis_output(AXIS), at, message),
    }
}

/// Name of the single axis.
const AXIS: &str = "slide";

fn point(at: [f64; 2]) -> Option<Point> {
    Some(Point { x: at[0], y: at[1] })
}

fn stamp(time: f64) -> u64 {
    EPOCH + (time.max(0.0) * 1e9).round() as u64
}

/// A gantry session.
pub(crate) fn write_gantry(
    path: &Path,
    label: Label<'_>,
    o: &Observation,
    runs: &[Run],
) -> Outcome {
    let mut sheet = Sheet::new();
    sheet.markers(runs, label.split);
    for (index, [vx, vy]) in o.commands.iter().enumerate() {
        sheet.add(index as f64 * PERIOD, Entry::Command(VelocityCommand { vx: *vx, vy: *vy }));
    }
    for index in 0..o.turns.len() {
        let time = index as f64 * SAMPLE;
        for (m, motor) in Motor::BOTH.into_iter().enumerate() {
            let message = MotorState {
                position_turns: o.turns[index][m],
                velocity_turns_per_s: o.turns_per_s[index][m],
                torque_target_nm: Some(o.target_nm[index][m]),
                torque_estimate_nm: Some(o.torque_nm[index][m]),
                torque_age_s: None,
            };
            sheet.add(time, Entry::Motor(motor, message));
        }
        let [x, y, vx, vy] = o.carriage[index];
        sheet.add(time, Entry::Carriage(CarriageState { x, y, vx, vy }));
    }
    for frame in &o.frames {
        let message = CameraDetections {
            capture_time_ns: stamp(frame.time),
            left: point(frame.at),
            ..CameraDetections::default()
        };
        sheet.add(frame.time, Entry::Camera(message));
    }
    for (index, [x, y, vx, vy]) in o.state.iter().enumerate() {
        let left = Some(ObjectState { x: *x, y: *y, vx: *vx, vy: *vy });
        let message = BoardState { left, status: 1, ..BoardState::default() };
        sheet.add(index as f64 * PERIOD, Entry::State(message));
    }
    let extra = [
        ("belt_metres_per_turn", "0.04".to_owned()),
        ("home_x", HOME[0].to_string()),
        ("home_y", HOME[1].to_string()),
    ];
    sheet.write(path, label, &extra)
}

/// A session of rolls; the pegs are parked.
pub(crate) fn write_ball(path: &Path, label: Label<'_>, rolls: &[Vec<BallFrame>]) -> Outcome {
    let mut sheet = Sheet::new();
    let runs: Vec<Run> = (0..rolls.len())
        .map(|index| {
            let start = index as f64 * (ROLL + PAUSE);
            Run { pattern: "ball_roll", start, end: start + ROLL }
        })
        .collect();
    sheet.markers(&runs, label.split);
    for (time, at) in rolls.iter().flatten() {
        let message = CameraDetections {
            capture_time_ns: stamp(*time),
            ball: point(*at),
            left: point([0.12, -0.19]),
            right: point([-0.12, 0.19]),
            ..CameraDetections::default()
        };
        sheet.add(*time, Entry::Camera(message));
    }
    sheet.write(path, label, &[])
}

/// A session of the axis, with the whole session as one run.
pub(crate) fn write_axis(path: &Path, label: Label<'_>, trace: &AxisTrace) -> Outcome {
    let mut sheet = Sheet::new();
    let end = trace.force.len() as f64 / RATE;
    sheet.markers(&[Run { pattern: "reference", start: 0.0, end }], label.split);
    for (index, (force, position)) in trace.force.iter().zip(&trace.position).enumerate() {
        let time = index as f64 / RATE;
        let input = AxisInput { value: *force, unit: "N".to_owned() };
        sheet.add(time, Entry::Input(input));
        let output =
            AxisOutput { position: Some(*position), velocity: None, position_unit: "m".to_owned() };
        sheet.add(time, Entry::Output(output));
    }
    sheet.write(path, label, &[])
}
