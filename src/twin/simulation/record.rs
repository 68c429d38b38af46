//! Simulated motion as a recording of the data contract, and as CSV.
//!
//! A table has the topics `/striker/PLAYER/command`, `/striker/PLAYER/carriage`, `/motor/PLAYER/a` and `b`
//! and `/camera/detections`; a single axis has `/axis/NAME/input` and `/axis/NAME/output`. Run markers of
//! the recording with the commands are copied. The metadata have `source: simulation`. Attachment:
//! `twin.json`.

use super::{AxisInputs, AxisMotion, TableCommands, TableMotion};
use crate::{
    provenance::Provenance,
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, Recording, RecordingError, RecordingWriter,
        arrival_key,
        message::{
            AxisInput, AxisOutput, CameraDetections, CarriageState, MotorState, Point, RunMarker,
            VelocityCommand,
        },
        topic::{self, Motor, Player},
    },
    twin::Twin,
    units::Nanos,
};
use std::{collections::BTreeMap, fmt::Write as _, path::Path};

/// Origin of a simulated recording: times, markers and metadata.
#[derive(Debug, Clone)]
pub struct RecordInfo {
    /// Log time of the start of the simulation.
    pub origin: Nanos,
    /// Name of the session.
    pub session: String,
    /// Purpose of the session, `train` or `validation`, if the commands have one.
    pub split: Option<String>,
    /// Markers of the runs.
    pub markers: Vec<(Nanos, RunMarker)>,
    /// Name and SHA-256 of the twin and of the commands.
    pub inputs: Vec<(String, String)>,
    /// Program and command line.
    pub provenance: Provenance,
}

impl RecordInfo {
    /// Information on a simulation that starts at time zero, without markers.
    #[must_use]
    pub fn new(session: String, inputs: Vec<(String, String)>, provenance: Provenance) -> Self {
        let markers = Vec::new();
        Self { origin: Nanos(0), session, split: None, markers, inputs, provenance }
    }

    /// The same with times, markers and purpose of the recording that the commands are from.
    ///
    /// # Errors
    /// When a marker does not decode.
    pub fn like(self, recording: &Recording) -> Result<Self, RecordingError> {
        let markers = recording.markers()?;
        Ok(Self {
            origin: recording.time_range().map_or(self.origin, |(first, _)| first),
            split: recording.info("split").map(ToOwned::to_owned),
            markers: markers.times.into_iter().zip(markers.values).collect(),
            ..self
        })
    }

    fn metadata(&self, twin: &Twin) -> BTreeMap<String, String> {
        let mut metadata: BTreeMap<String, String> = [
            ("schema_version", "1"),
            ("source", "simulation"),
            ("robot", "simulation"),
            ("session", &self.session),
            ("command_line", &self.provenance.command_line),
            ("crate_version", self.provenance.crate_version),
            ("git_hash", self.provenance.git_hash),
            ("belt_metres_per_turn", &twin.belt_metres_per_turn.to_string()),
        ]
        .into_iter()
        .map(|(key, value)| (key.to_owned(), value.to_owned()))
        .collect();
        for (index, (name, sha256)) in self.inputs.iter().enumerate() {
            metadata.insert(format!("input_{index}"), name.clone());
            metadata.insert(format!("input_{index}_sha256"), sha256.clone());
        }
        if let Some(split) = &self.split {
            metadata.insert("split".to_owned(), split.clone());
        }
        metadata
    }
}

/// One message on its way into the file.
enum Outgoing {
    Command(VelocityCommand),
    Carriage(CarriageState),
    Motor(MotorState),
    Camera(CameraDetections),
    Marker(RunMarker),
    Input(AxisInput),
    Output(AxisOutput),
}

/// Messages by time, written in the order of their times.
struct Messages {
    origin: Nanos,
    topics: Vec<String>,
    /// Time, index of the topic, message.
    all: Vec<(Nanos, usize, Outgoing)>,
}

impl Messages {
    fn new(info: &RecordInfo) -> Self {
        let markers = info.markers.iter();
        Self {
            origin: info.origin,
            topics: vec![topic::RUN_MARKER.to_owned()],
            all: markers.map(|(time, own)| (*time, 0, Outgoing::Marker(own.clone()))).collect(),
        }
    }

    fn push(&mut self, topic: &str, seconds: f64, message: Outgoing) {
        let known = self.topics.iter().position(|own| own == topic);
        let index = known.unwrap_or_else(|| {
            self.topics.push(topic.to_owned());
            self.topics.len() - 1
        });
        self.all.push((self.origin.after_seconds(seconds), index, message));
    }

    fn write(
        mut self,
        twin: &Twin,
        metadata: BTreeMap<String, String>,
        path: &Path,
        existing: ExistingFile,
    ) -> Result<(), RecordingError> {
        self.all.sort_by_key(|message| message.0);
        let mut writer = RecordingWriter::create(path, existing, FlushPolicy::WhenFull)?;
        writer.metadata(RECORDING_METADATA, metadata)?;
        for (time, index, message) in &self.all {
            let topic = self.topics[*index].as_str();
            match message {
                Outgoing::Command(own) => writer.write(topic, *time, own)?,
                Outgoing::Carriage(own) => writer.write(topic, *time, own)?,
                Outgoing::Motor(own) => writer.write(topic, *time, own)?,
                Outgoing::Camera(own) => writer.write(topic, *time, own)?,
                Outgoing::Marker(own) => writer.write(topic, *time, own)?,
                Outgoing::Input(own) => writer.write(topic, *time, own)?,
                Outgoing::Output(own) => writer.write(topic, *time, own)?,
            }
        }
        let twin = twin.to_json().unwrap_or_default();
        writer.attach("twin.json", "application/json", twin.as_bytes())?;
        writer.finish()
    }
}

/// Write `motion` of `twin` under `commands` as a recording.
///
/// # Errors
/// When the file exists and may not be replaced, or the disk refuses.
pub fn write_table_recording(
    twin: &Twin,
    commands: &TableCommands,
    motion: &TableMotion,
    info: &RecordInfo,
    (path, existing): (&Path, ExistingFile),
) -> Result<(), RecordingError> {
    let player = commands.player;
    let mut messages = Messages::new(info);
    for (time, [vx, vy]) in commands.times.iter().zip(commands.velocities.iter().copied()) {
        let message = Outgoing::Command(VelocityCommand { vx, vy });
        messages.push(&topic::command(player), *time, message);
    }
    for (index, time) in motion.times.iter().enumerate() {
        let ([x, y], [vx, vy]) = (motion.position(index), motion.velocity(index));
        let message = Outgoing::Carriage(CarriageState { x, y, vx, vy });
        messages.push(&topic::carriage(player), *time, message);
        for (k, motor) in Motor::BOTH.into_iter().enumerate() {
            let message = Outgoing::Motor(MotorState {
                position_turns: motion.motor_position[k][index] / twin.belt_metres_per_turn,
                velocity_turns_per_s: motion.motor_velocity[k][index] / twin.belt_metres_per_turn,
                torque_target_nm: None,
                torque_estimate_nm: Some(motion.motor_torque[k][index]),
                torque_age_s: Some(0.0),
            });
            messages.push(&topic::motor(player, motor), *time, message);
        }
    }
    for (time, [x, y]) in motion.frame_times.iter().zip(motion.frames.iter().copied()) {
        let seen = Some(Point { x, y });
        let (left, right) = if player == Player::Left { (seen, None) } else { (None, seen) };
        let capture_time_ns = info.origin.after_seconds(*time).0;
        let frame =
            CameraDetections { capture_time_ns, left, right, ..CameraDetections::default() };
        messages.push(topic::CAMERA_DETECTIONS, *time, Outgoing::Camera(frame));
    }
    let mut metadata = info.metadata(twin);
    for (motor, arrival) in Motor::BOTH.into_iter().zip(commands.arrivals) {
        if arrival != 0.0 {
            metadata.insert(arrival_key(player, motor), arrival.to_string());
        }
    }
    messages.write(twin, metadata, path, existing)
}

/// Write `motion` of `twin` under `inputs` as a recording.
///
/// # Errors
/// When the file exists and may not be replaced, or the disk refuses.
pub fn write_axis_recording(
    twin: &Twin,
    inputs: &AxisInputs,
    motion: &AxisMotion,
    info: &RecordInfo,
    (path, existing): (&Path, ExistingFile),
) -> Result<(), RecordingError> {
    let mut messages = Messages::new(info);
    let [input, output] = [topic::axis_input(&inputs.name), topic::axis_output(&inputs.name)];
    for (index, time) in motion.times.iter().enumerate() {
        let message = AxisInput { value: motion.input[index], unit: inputs.unit.clone() };
        messages.push(&input, *time, Outgoing::Input(message));
        let message = AxisOutput {
            position: Some(motion.position[index]),
            velocity: Some(motion.velocity[index]),
            position_unit: inputs.position_unit.clone(),
        };
        messages.push(&output, *time, Outgoing::Output(message));
    }
    let mut metadata = info.metadata(twin);
    metadata.remove("belt_metres_per_turn");
    messages.write(twin, metadata, path, existing)
}

/// Columns of [`table_csv`].
const TABLE_COLUMNS: &str = "time_s,command_vx_m_per_s,command_vy_m_per_s,carriage_x_m,\
                             carriage_y_m,carriage_vx_m_per_s,carriage_vy_m_per_s,motor_a_velocity_m_per_s,\
                             motor_b_velocity_m_per_s,motor_a_torque_nm,motor_b_torque_nm,striker_x_m,striker_y_m\n";

/// The motion of a table as CSV: one row per sample, the command in force at that time.
#[must_use]
pub fn table_csv(commands: &TableCommands, motion: &TableMotion) -> String {
    let mut text = TABLE_COLUMNS.to_owned();
    let mut next = 0;
    for (index, time) in motion.times.iter().enumerate() {
        while commands.times.get(next).is_some_and(|sent| *sent <= time + 1e-9) {
            next += 1;
        }
        let command = next.checked_sub(1).map_or([0.0; 2], |last| commands.velocities[last]);
        let values = [
            command,
            motion.position(index),
            motion.velocity(index),
            [motion.motor_velocity[0][index], motion.motor_velocity[1][index]],
            [motion.motor_torque[0][index], motion.motor_torque[1][index]],
            motion.striker[index],
        ];
        push_row(&mut text, *time, values.as_flattened());
    }
    text
}

/// The motion of a single axis as CSV, with the unit of each column in its name.
#[must_use]
pub fn axis_csv(inputs: &AxisInputs, motion: &AxisMotion) -> String {
    let input = inputs.column();
    let unit = &inputs.position_unit;
    let mut text = format!("time_s,{input},position_{unit},velocity_{unit}_per_s\n");
    for (index, time) in motion.times.iter().enumerate() {
        let values = [motion.input[index], motion.position[index], motion.velocity[index]];
        push_row(&mut text, *time, &values);
    }
    text
}

/// Add one row: time in nanosecond resolution, values with the digits that identify them.
fn push_row(text: &mut String, time: f64, values: &[f64]) {
    write!(text, "{}", (time * 1e9).round() / 1e9).ok();
    for value in values {
        write!(text, ",{value}").ok();
    }
    text.push('\n');
}
