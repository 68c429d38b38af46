//! The twin: load, parameters, simulation, residuals.

use crate::{
    arrays::{Length, floats, from_json, pairs, rows, vector},
    error::{raised, refused},
};
use klasktron::{
    effects::Axis,
    gap::compare,
    recording::{ExistingFile, Recording, topic::Player, write_bytes},
    twin::{
        self, Instance, Machine, Plant, Source,
        export::{Target, export},
        sessions_of,
        simulation::{
            AxisInputs, AxisMotion, SimulationError, TableCommands, TableMotion, simulate_axis,
            simulate_table,
        },
    },
};
use numpy::PyArray2;
use pyo3::{
    prelude::*,
    types::{PyDict, PyList},
};
use std::{
    cmp::Ordering,
    path::{Path, PathBuf},
};

/// Name of commands that come from no file, in messages.
const ARRAY: &str = "commands";
/// Period of commands that come without times (s): that of the control loop.
const PERIOD_S: f64 = 0.02;

/// Simulator of a machine: effects of the catalogue with their parameters, as in `twin.json`.
#[pyclass(module = "klasktron", frozen)]
#[derive(Clone)]
pub(crate) struct Twin {
    pub(crate) inner: twin::Twin,
}

/// Options of `Twin.simulate`.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
struct Options<'py> {
    times_s: Option<Bound<'py, PyAny>>,
    dt_s: Option<f64>,
    start: Option<Bound<'py, PyAny>>,
    rate_hz: f64,
    frame_rate_hz: f64,
    unit: Option<String>,
    player: Option<String>,
    axis: Option<String>,
}

#[pymethods]
impl Twin {
    /// Read a `twin.json`.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        Ok(Self { inner: twin::read_twin(&path).map_err(raised)? })
    }

    /// Read the text of a `twin.json`.
    #[staticmethod]
    fn from_json(text: &str) -> PyResult<Self> {
        Ok(Self { inner: twin::parse_twin(text, "the text").map_err(raised)? })
    }

    /// The plain twin of a machine, `"table"` or `"axis"`, before anything was measured.
    #[staticmethod]
    fn nominal(machine: &str) -> PyResult<Self> {
        let machine = match machine {
            "table" => Machine::Table,
            "axis" => Machine::Axis,
            other => {
                return Err(refused(format!("machine is '{other}'; known are 'table' and 'axis'")));
            }
        };
        Ok(Self { inner: twin::Twin::nominal(machine) })
    }

    /// Text of its `twin.json`.
    fn to_json(&self) -> PyResult<String> {
        self.inner.to_json().map_err(raised)
    }

    /// Write `twin.json`.
    #[pyo3(signature = (path, *, overwrite=false))]
    fn save(&self, path: PathBuf, overwrite: bool) -> PyResult<()> {
        let existing = if overwrite { ExistingFile::Replace } else { ExistingFile::Refuse };
        write_bytes(&path, existing, self.to_json()?.as_bytes()).map_err(raised)
    }

    /// Text of a file for `"mjcf"` or `"isaaclab"`, and what it cannot express, as sentences.
    fn export(&self, target: &str) -> PyResult<(String, Vec<String>)> {
        let target = match target {
            "mjcf" => Target::Mjcf,
            "isaaclab" => Target::IsaacLab,
            other => {
                return Err(refused(format!(
                    "target is '{other}'; known are 'mjcf' and 'isaaclab'"
                )));
            }
        };
        let exported = export(&self.inner, target).map_err(raised)?;
        let missing = exported.inexpressible.iter();
        Ok((exported.text, missing.map(|own| format!("{target} cannot express {own}")).collect()))
    }

    /// `"table"` or `"axis"`.
    #[getter]
    fn machine(&self) -> &'static str {
        match self.inner.machine {
            Machine::Table => "table",
            Machine::Axis => "axis",
        }
    }

    /// Content of its `twin.json` as plain Python objects.
    #[getter]
    fn document<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.to_json()?)
    }

    /// Every parameter as a dictionary: effect, axis, name, value, unit, ci95, source, bounds.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let list = PyList::empty(py);
        for instance in &self.inner.instances {
            for (parameter, value) in instance.effect.parameters.iter().zip(&instance.values) {
                let row = PyDict::new(py);
                row.set_item("effect", instance.effect.name)?;
                row.set_item("axis", instance.axis.to_string())?;
                row.set_item("name", parameter.name)?;
                row.set_item("value", value.value)?;
                row.set_item("unit", parameter.unit)?;
                row.set_item("ci95", value.ci95)?;
                row.set_item("source", source_name(value.source))?;
                row.set_item("bounds", parameter.bounds)?;
                list.append(row)?;
            }
        }
        Ok(list)
    }

    /// Value of `EFFECT.PARAMETER`, such as `drive.delay.delay_s`.
    #[pyo3(signature = (name, axis=None))]
    fn value(&self, name: &str, axis: Option<&str>) -> PyResult<f64> {
        let (instance, parameter) = self.slot(name, axis)?;
        Ok(self.inner.instances[instance].values[parameter].value)
    }

    /// A copy with another value of one parameter.
    #[pyo3(signature = (name, value, axis=None))]
    fn with_value(&self, name: &str, value: f64, axis: Option<&str>) -> PyResult<Self> {
        let (instance, parameter) = self.slot(name, axis)?;
        let own = &self.inner.instances[instance].effect.parameters[parameter];
        let (low, high) = own.bounds;
        if !(low..=high).contains(&value) {
            let unit = own.unit;
            return Err(refused(format!("{name} is {value}; allowed are {low} to {high} {unit}")));
        }
        let mut inner = self.inner.clone();
        inner.instances[instance].values[parameter].value = value;
        inner.instances[instance].values[parameter].ci95 = None;
        Ok(Self { inner })
    }

    /// Simulate open loop; see the stub file for shapes and units.
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        commands: &Bound<'py, PyAny>,
        options: Options<'py>,
    ) -> PyResult<Bound<'py, PyDict>> {
        match self.inner.machine {
            Machine::Table => {
                let commands = self.table_commands(commands, &options)?;
                let motion = py.detach(|| {
                    simulate_table(&self.inner, &commands, options.rate_hz, options.frame_rate_hz)
                });
                table_columns(py, &commands, &motion)
            }
            Machine::Axis => {
                let inputs = self.axis_inputs(commands, &options)?;
                let motion = py.detach(|| simulate_axis(&self.inner, &inputs));
                axis_columns(py, &inputs, motion)
            }
        }
    }

    /// Velocity of the carriage `[n + 1][2]` (m/s) after each of `n` steps of `dt_s` with `commands` `[n][2]` (m/s), from
    /// rest and without the delays of the commands: one step of the plant each, as in the game.
    fn step_plant<'py>(
        &self,
        py: Python<'py>,
        commands: &Bound<'py, PyAny>,
        dt_s: f64,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        if self.inner.machine != Machine::Table {
            let machine = self.inner.machine;
            return Err(refused(format!(
                "step_plant needs the twin of a table, not of a {machine}"
            )));
        }
        let array = floats(commands, ARRAY, &[Length::Any("n"), Length::Exactly(2)])?;
        let commands = pairs::<2>(&array)?;
        let plant = Plant::new(&self.inner);
        let mut state = plant.start();
        let mut velocities = vec![state.velocity];
        for [x, y] in commands {
            plant.step(&mut state, [x + y, x - y], dt_s);
            velocities.push(state.velocity);
        }
        rows(py, &velocities)
    }

    /// Compare with recordings; a list of dictionaries, one per session and signal.
    fn compare<'py>(
        &self,
        py: Python<'py>,
        recordings: Vec<PathBuf>,
    ) -> PyResult<Bound<'py, PyList>> {
        let compared = py.detach(|| {
            let recordings = opened(&recordings)?;
            let sessions = sessions_of(&recordings).map_err(raised)?;
            twin::check_machine(&sessions, Some(&self.inner)).map_err(raised)?;
            Ok::<_, PyErr>(compare(&sessions, &self.inner))
        })?;
        let list = PyList::empty(py);
        for own in compared {
            let signal = PyDict::new(py);
            signal.set_item("rms", own.residual_rms())?;
            signal.set_item("session", own.session)?;
            signal.set_item("split", own.split.to_string())?;
            signal.set_item("stage", own.stage.to_string())?;
            signal.set_item("signal", own.signal)?;
            signal.set_item("unit", own.unit)?;
            signal.set_item("time_s", vector(py, own.times))?;
            signal.set_item("measured", vector(py, own.measured))?;
            signal.set_item("residual", vector(py, own.residual))?;
            list.append(signal)?;
        }
        Ok(list)
    }

    fn __repr__(&self) -> String {
        let mut effects: Vec<&str> =
            self.inner.instances.iter().map(|own| own.effect.name).collect();
        effects.dedup();
        format!("<klasktron.Twin of a {}: {}>", self.machine(), effects.join(", "))
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        other.cast::<Self>().is_ok_and(|other| other.get().inner == self.inner)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        Ok((slf.getattr("from_json")?, (slf.get().to_json()?,)))
    }
}

impl Twin {
    /// Instance and parameter called `EFFECT.PARAMETER` on `axis`, or on the only one.
    fn slot(&self, name: &str, axis: Option<&str>) -> PyResult<(usize, usize)> {
        let has = |own: &Instance| {
            let rest = name.strip_prefix(own.effect.name)?.strip_prefix('.')?;
            own.effect.parameters.iter().position(|parameter| parameter.name == rest)
        };
        let all: Vec<(usize, usize)> = (0..self.inner.instances.len())
            .filter_map(|index| Some((index, has(&self.inner.instances[index])?)))
            .collect();
        let axis_of = |slot: &(usize, usize)| self.inner.instances[slot.0].axis;
        let axes: Vec<String> = all.iter().map(|slot| axis_of(slot).to_string()).collect();
        let is_wanted = |slot: &&(usize, usize)| is_axis(axis_of(slot), axis);
        match all.iter().filter(is_wanted).collect::<Vec<_>>()[..] {
            [only] => Ok(*only),
            [] if all.is_empty() => Err(refused(format!(
                "the twin has no parameter '{name}'; `Twin.parameters` lists those it has"
            ))),
            _ => {
                let asked = axis.map_or_else(String::new, |axis| format!(", not on '{axis}'"));
                Err(refused(format!(
                    "the twin has {name} on {}{asked}; give the axis",
                    axes.join(", ")
                )))
            }
        }
    }

    fn table_commands(
        &self,
        commands: &Bound<'_, PyAny>,
        options: &Options<'_>,
    ) -> PyResult<TableCommands> {
        let player = match options.player.as_deref() {
            None => None,
            Some("left") => Some(Player::Left),
            Some("right") => Some(Player::Right),
            Some(other) => {
                return Err(refused(format!("player is '{other}'; known are 'left' and 'right'")));
            }
        };
        let mut own = match path_of(commands) {
            Some(path) => {
                let recording = Recording::open(&path).map_err(raised)?;
                TableCommands::from_recording(&recording, player).map_err(raised)?
            }
            None => {
                let array = floats(commands, ARRAY, &[Length::Any("n"), Length::Exactly(2)])?;
                let velocities = pairs::<2>(&array)?;
                let times = times_of(options, velocities.len())?;
                let player = player.unwrap_or(Player::Left);
                TableCommands::new(Path::new(ARRAY), player, times, velocities).map_err(raised)?
            }
        };
        if let Some(start) = &options.start {
            let start = floats(start, "start", &[Length::Exactly(2)])?;
            own.start = pairs::<2>(&start)?[0];
        }
        for (name, rate) in [("rate_hz", options.rate_hz), ("frame_rate_hz", options.frame_rate_hz)]
        {
            if !(1.0..=1000.0).contains(&rate) {
                return Err(refused(format!("{name} is {rate}; allowed are 1 to 1000 Hz")));
            }
        }
        Ok(own)
    }

    fn axis_inputs(
        &self,
        commands: &Bound<'_, PyAny>,
        options: &Options<'_>,
    ) -> PyResult<AxisInputs> {
        let mut own = match path_of(commands) {
            Some(path) => {
                let recording = Recording::open(&path).map_err(raised)?;
                let axis = options.axis.as_deref();
                AxisInputs::from_recording(&recording, axis).map_err(raised)?
            }
            None => {
                let array = floats(commands, ARRAY, &[Length::Any("n")])?;
                let values = array.as_slice()?;
                let times = times_of(options, values.len())?;
                let samples: Vec<(f64, f64)> =
                    times.into_iter().zip(values.iter().copied()).collect();
                let known = self.inner.axis_frame.map_or("N", |frame| frame.scales.input_unit);
                let unit = options.unit.as_deref().unwrap_or(known);
                let made = AxisInputs::new(Path::new(ARRAY), "axis", unit, &samples);
                made.map_err(|error: SimulationError| raised(error))?
            }
        };
        if let Some(start) = &options.start {
            let start = floats(start, "start", &[Length::Exactly(2)])?;
            own.start = pairs::<2>(&start)?[0];
        }
        own.for_twin(&self.inner).map_err(raised)
    }
}

/// Whether `axis` is the one called `name`.
fn is_axis(axis: Axis, name: Option<&str>) -> bool {
    name.is_none_or(|name| axis.to_string() == name)
}

fn source_name(source: Source) -> &'static str {
    match source {
        Source::Nominal => "nominal",
        Source::Known => "known",
        Source::Fitted => "fitted",
    }
}

/// A path, where `value` is one.
fn path_of(value: &Bound<'_, PyAny>) -> Option<PathBuf> {
    value.extract().ok()
}

/// Time of each of `count` commands, in increasing order (s).
fn times_of(options: &Options<'_>, count: usize) -> PyResult<Vec<f64>> {
    let Some(times) = &options.times_s else {
        let dt = options.dt_s.unwrap_or(PERIOD_S);
        if !(0.0 < dt && dt.is_finite()) {
            return Err(refused(format!("dt_s is {dt}; allowed are numbers above 0")));
        }
        return Ok((0..count).map(|index| index as f64 * dt).collect());
    };
    let times = floats(times, "times_s", &[Length::Exactly(count)])?;
    let times = times.as_slice()?;
    let in_order = |pair: &[f64]| pair[0].partial_cmp(&pair[1]) == Some(Ordering::Less);
    let wrong = times.windows(2).position(|pair| !in_order(pair));
    if let Some(index) = wrong {
        let [before, after] = [times[index], times[index + 1]];
        return Err(refused(format!(
            "times_s[{}] is {after} after {before}; times must increase",
            index + 1
        )));
    }
    let origin = times.first().copied().unwrap_or(0.0);
    Ok(times.iter().map(|time| time - origin).collect())
}

/// Recordings in the order of `paths`.
pub(crate) fn opened(paths: &[PathBuf]) -> PyResult<Vec<Recording>> {
    paths.iter().map(|path| Recording::open(path).map_err(raised)).collect()
}

fn table_columns<'py>(
    py: Python<'py>,
    commands: &TableCommands,
    motion: &TableMotion,
) -> PyResult<Bound<'py, PyDict>> {
    let samples = 0..motion.times.len();
    let mut next = 0;
    let mut in_force = Vec::with_capacity(samples.len());
    for time in &motion.times {
        while commands.times.get(next).is_some_and(|sent| *sent <= time + 1e-9) {
            next += 1;
        }
        in_force.push(next.checked_sub(1).map_or([0.0; 2], |last| commands.velocities[last]));
    }
    let each = |of: &dyn Fn(usize) -> [f64; 2]| samples.clone().map(of).collect::<Vec<_>>();
    let motors = |of: &[Vec<f64>; 2]| each(&|index| [of[0][index], of[1][index]]);
    let columns = PyDict::new(py);
    columns.set_item("time_s", vector(py, motion.times.clone()))?;
    columns.set_item("command_m_per_s", rows(py, &in_force)?)?;
    columns.set_item("carriage_m", rows(py, &each(&|index| motion.position(index)))?)?;
    columns.set_item("carriage_m_per_s", rows(py, &each(&|index| motion.velocity(index)))?)?;
    columns.set_item("motor_m", rows(py, &motors(&motion.motor_position))?)?;
    columns.set_item("motor_m_per_s", rows(py, &motors(&motion.motor_velocity))?)?;
    columns.set_item("motor_torque_nm", rows(py, &motors(&motion.motor_torque))?)?;
    columns.set_item("striker_m", rows(py, &motion.striker)?)?;
    columns.set_item("frame_time_s", vector(py, motion.frame_times.clone()))?;
    columns.set_item("frame_striker_m", rows(py, &motion.frames)?)?;
    Ok(columns)
}

fn axis_columns<'py>(
    py: Python<'py>,
    inputs: &AxisInputs,
    motion: AxisMotion,
) -> PyResult<Bound<'py, PyDict>> {
    let unit = &inputs.position_unit;
    let columns = PyDict::new(py);
    columns.set_item("time_s", vector(py, motion.times))?;
    columns.set_item(inputs.column(), vector(py, motion.input))?;
    columns.set_item(format!("position_{unit}"), vector(py, motion.position))?;
    columns.set_item(format!("velocity_{unit}_per_s"), vector(py, motion.velocity))?;
    Ok(columns)
}
