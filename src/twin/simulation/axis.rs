//! Open-loop simulation of a single axis: force-like input to position and velocity.

use super::{SimulationError, check_length};
use crate::{
    recording::{
        Recording,
        message::{AxisInput, AxisOutput},
        topic::{self, Player},
    },
    stats::median,
    twin::{
        Machine, Twin,
        axis::{position_unit, resampled, respond, unit_of},
    },
};
use std::path::Path;

/// Longest integration step (s).
const LONGEST_STEP: f64 = 1e-3;
/// Largest number of samples.
const MOST_SAMPLES: f64 = 1e7;

/// Columns of the input of a single axis in tables, with their units.
pub const INPUT_COLUMNS: [(&str, &str); 6] = [
    ("force_n", "N"),
    ("torque_nm", "N m"),
    ("current_a", "A"),
    ("voltage_v", "V"),
    ("setpoint_m_per_s", "m/s"),
    ("setpoint_rad_per_s", "rad/s"),
];

/// Inputs of a single axis, linear between samples.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisInputs {
    /// Name of the axis in its topics.
    pub name: String,
    /// Unit of the input: N, N m, A, V, m/s or rad/s.
    pub unit: String,
    /// Unit of the position: m or rad.
    pub position_unit: String,
    /// Time of each input since the simulation began (s), increasing.
    pub times: Vec<f64>,
    /// Values, in `unit`.
    pub values: Vec<f64>,
    /// Initial position and velocity (m and m/s, or rad and rad/s).
    pub start: [f64; 2],
}

impl AxisInputs {
    /// Check inputs of the axis `name` from the file `path`, which starts at rest at the origin.
    ///
    /// # Errors
    /// When there are too few, a value is not finite, they last too long, or the unit is another.
    pub fn new(
        path: &Path,
        name: &str,
        unit: &str,
        samples: &[(f64, f64)],
    ) -> Result<Self, SimulationError> {
        let unit = unit_of(unit, name)?;
        if samples.len() < 2 {
            return Err(SimulationError::TooFew { path: path.to_owned(), found: samples.len() });
        }
        check_length(path, samples[samples.len() - 1].0 - samples[0].0)?;
        if let Some((time, _)) = samples.iter().find(|(_, value)| !value.is_finite()) {
            return Err(SimulationError::NotFinite { path: path.to_owned(), time: *time });
        }
        Ok(Self {
            name: name.to_owned(),
            unit: unit.to_owned(),
            position_unit: position_unit("", unit).to_owned(),
            times: samples.iter().map(|sample| sample.0).collect(),
            values: samples.iter().map(|sample| sample.1).collect(),
            start: [0.0; 2],
        })
    }

    /// Column of the input in tables, with its unit.
    #[must_use]
    pub fn column(&self) -> &'static str {
        let own = INPUT_COLUMNS.iter().find(|(_, unit)| *unit == self.unit);
        own.map_or("input", |own| own.0)
    }

    /// These inputs for `twin`, with the unit of its position.
    ///
    /// # Errors
    /// When the input of the twin has another unit.
    pub fn for_twin(self, twin: &Twin) -> Result<Self, SimulationError> {
        let Some(frame) = twin.axis_frame else { return Ok(self) };
        let (expected, position_unit) = (frame.scales.input_unit, frame.scales.position_unit);
        if self.unit != expected {
            let Self { name, unit, .. } = self;
            return Err(SimulationError::OtherUnit { name, unit, expected });
        }
        Ok(Self { position_unit: position_unit.to_owned(), ..self })
    }

    /// Inputs of an axis in a recording: of `axis`, or of the only one. The simulation starts at the
    /// first measured state, or at rest at the origin.
    ///
    /// # Errors
    /// When a message does not decode, the axis is not there, or its inputs cannot be simulated.
    pub fn from_recording(
        recording: &Recording,
        axis: Option<&str>,
    ) -> Result<Self, SimulationError> {
        let name = chosen(recording, axis)?;
        let (origin, _) = recording.time_range().unwrap_or_default();
        let inputs = recording.series::<AxisInput>(&topic::axis_input(&name))?;
        let unit = inputs.values.first().map_or("", |first| first.unit.as_str());
        let mut samples: Vec<(f64, f64)> =
            inputs.iter().map(|(time, own)| (time.seconds_since(origin), own.value)).collect();
        samples.dedup_by(|later, earlier| later.0 <= earlier.0);
        let own = Self::new(&recording.path, &name, unit, &samples)?;
        let outputs = recording.series::<AxisOutput>(&topic::axis_output(&name))?;
        let Some(first) = outputs.values.first() else { return Ok(own) };
        let position_unit = match first.position_unit.as_str() {
            "" => own.position_unit.clone(),
            given => given.to_owned(),
        };
        let start = [first.position.unwrap_or(0.0), first.velocity.unwrap_or(0.0)];
        Ok(Self { position_unit, start, ..own })
    }
}

/// Name of the axis `axis` in `recording`, or of its only one.
fn chosen(recording: &Recording, axis: Option<&str>) -> Result<String, SimulationError> {
    let name_of = |topic: &str| {
        let name = topic.strip_prefix("/axis/")?.strip_suffix("/input")?;
        Some(name.to_owned()).filter(|name| !name.is_empty())
    };
    let filled = recording.channels.iter().filter(|own| !own.messages.is_empty());
    let mut names: Vec<String> = filled.filter_map(|own| name_of(&own.topic)).collect();
    names.sort();
    names.dedup();
    names.retain(|name| axis.is_none_or(|wanted| wanted == name));
    match names.len() {
        1 => Ok(names.remove(0)),
        0 => {
            let path = recording.path.clone();
            let commands = Player::BOTH.map(topic::command);
            let is_table = commands.iter().any(|topic| 0 < recording.count(topic));
            if is_table {
                let (commands, twin) = (Machine::Table, Machine::Axis);
                return Err(SimulationError::OtherMachine { path, commands, twin });
            }
            let expected = topic::axis_input(axis.unwrap_or("NAME"));
            Err(SimulationError::NoCommands { path, expected })
        }
        _ => Err(SimulationError::SeveralAxes { path: recording.path.clone(), names }),
    }
}

/// Simulated motion of a single axis.
#[derive(Debug, Clone, PartialEq)]
pub struct AxisMotion {
    /// Times of the samples (s), at equal steps.
    pub times: Vec<f64>,
    /// Input at each of them.
    pub input: Vec<f64>,
    /// Position (m or rad).
    pub position: Vec<f64>,
    /// Velocity (m/s or rad/s).
    pub velocity: Vec<f64>,
}

/// Simulate `twin` under `inputs`, sampled at the median step of the inputs.
#[must_use]
pub fn simulate_axis(twin: &Twin, inputs: &AxisInputs) -> AxisMotion {
    let steps: Vec<f64> = inputs.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    // Time stamps are whole nanoseconds.
    let step = (median(&steps).unwrap_or(0.0) * 1e9).round() * 1e-9;
    let [first, last] = [inputs.times[0], inputs.times[inputs.times.len() - 1]];
    let step = step.max((last - first) / MOST_SAMPLES);
    let samples = ((last - first) / step + 1e-6) as usize + 1;
    let within = (step / LONGEST_STEP - 1e-9).ceil().max(1.0) as usize;
    let dt = step / within as f64;
    let pairs: Vec<(f64, f64)> =
        inputs.times.iter().copied().zip(inputs.values.iter().copied()).collect();
    let fine = resampled(&pairs, first, dt, (samples - 1) * within + 1);
    let motion = respond(twin, (first, dt), &fine, inputs.start);
    let kept = || (0..samples).map(|index| index * within);
    AxisMotion {
        times: (0..samples).map(|index| first + step * index as f64).collect(),
        input: kept().map(|index| fine[index]).collect(),
        position: kept().map(|index| motion[index][0]).collect(),
        velocity: kept().map(|index| motion[index][1]).collect(),
    }
}
