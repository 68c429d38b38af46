//! A fitted actuator network.

use crate::{
    arrays::{Length, floats, pairs, rows},
    error::{raised, refused},
};
use klasktron::{
    actuator::{AXES, ActuatorNetwork, Run, StoredActuator, VelocityModel, read_actuator},
    recording::Recording,
    units::Nanos,
};
use numpy::PyArray2;
use pyo3::prelude::*;
use std::{collections::BTreeMap, path::PathBuf};

/// Network of an `actuator.mcap`: past commands and velocities to the next velocity.
#[pyclass(module = "klasktron", frozen)]
pub(crate) struct ActuatorNet {
    stored: StoredActuator,
}

#[pymethods]
impl ActuatorNet {
    /// Read an `actuator.mcap` of `klasktron fit-actuator`.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        let recording = Recording::open(&path).map_err(raised)?;
        Ok(Self { stored: read_actuator(&recording).map_err(raised)? })
    }

    /// Samples of command and velocity history that the network takes.
    #[getter]
    fn history_steps(&self) -> usize {
        self.model().layout.history_steps
    }

    /// `"klasktron"` or `"klask-rl"`.
    #[getter]
    fn layout(&self) -> String {
        self.model().layout.kind.to_string()
    }

    /// Settings of its fit.
    #[getter]
    fn metadata(&self) -> BTreeMap<String, String> {
        self.stored.metadata.clone()
    }

    /// The network as ONNX.
    #[getter]
    fn onnx(&self) -> &[u8] {
        &self.stored.onnx
    }

    /// Predict one step ahead at each sample; see the stub file.
    fn predict<'py>(
        &self,
        py: Python<'py>,
        commands: &Bound<'py, PyAny>,
        velocities: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let run = self.run_of(commands, velocities)?;
        let history = self.history_steps();
        let starts: Vec<usize> = (history - 1..run.commands.len() - 1).collect();
        let predicted = py.detach(|| self.model().simulate(&run, &starts, 1));
        rows(py, &predicted)
    }

    /// Simulate free-running; see the stub file.
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        commands: &Bound<'py, PyAny>,
        velocities: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let commands = floats(commands, "commands", &[Length::Any("n"), Length::Exactly(AXES)])?;
        let commands = pairs::<AXES>(&commands)?;
        let history = self.history_steps();
        let known = [Length::Exactly(history), Length::Exactly(AXES)];
        let mut known = pairs::<AXES>(&floats(velocities, "velocities", &known)?)?;
        self.check_length(commands.len())?;
        known.resize(commands.len(), [0.0; AXES]);
        let run = run_with(commands, known);
        let steps = run.commands.len() - history;
        let predicted = py.detach(|| self.model().simulate(&run, &[history - 1], steps));
        rows(py, &predicted)
    }

    fn __repr__(&self) -> String {
        let history = self.history_steps();
        format!("<klasktron.ActuatorNet, layout {}, {history} steps of history>", self.layout())
    }
}

impl ActuatorNet {
    fn model(&self) -> &ActuatorNetwork {
        &self.stored.model
    }

    fn run_of(&self, commands: &Bound<'_, PyAny>, velocities: &Bound<'_, PyAny>) -> PyResult<Run> {
        let commands = floats(commands, "commands", &[Length::Any("n"), Length::Exactly(AXES)])?;
        let commands = pairs::<AXES>(&commands)?;
        let expected = [Length::Exactly(commands.len()), Length::Exactly(AXES)];
        let velocities = pairs::<AXES>(&floats(velocities, "velocities", &expected)?)?;
        self.check_length(commands.len())?;
        Ok(run_with(commands, velocities))
    }

    fn check_length(&self, found: usize) -> PyResult<()> {
        let least = self.history_steps() + 1;
        if least <= found {
            return Ok(());
        }
        Err(refused(format!(
            "commands has {found} samples; the network needs at least {least}: its history and one to predict"
        )))
    }
}

fn run_with(commands: Vec<[f64; AXES]>, velocities: Vec<[f64; AXES]>) -> Run {
    Run {
        path: PathBuf::new(),
        file: 0,
        number: 0,
        pattern: String::new(),
        split: None,
        start: Nanos(0),
        commands,
        velocities,
    }
}
