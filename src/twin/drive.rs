//! Commands to motor motion: the plant, driven by the recorded commands.

use super::{
    Channel, Plant, PlantState, Stage, StageKind, Twin,
    plant::{self, LONGEST_STEP},
};
use crate::{
    effects::{Effect, both},
    gantry::belts,
};
use std::f64::consts::TAU;

/// Time after the start of a run in which the recorded command may stem from before it (s): there
/// the plant runs but nothing is compared.
pub(super) const SETTLING: f64 = 0.1;

/// One gantry of one session: commands in, motor velocities and torques out.
#[derive(Debug, Clone)]
pub struct DriveStage {
    /// Time of each command (s).
    pub command_times: Vec<f64>,
    /// Commanded velocity in board coordinates (m/s).
    pub commands: Vec<[f64; 2]>,
    /// Start of each run: time (s), measured position (m) and velocity (m/s).
    pub starts: Vec<RunStart>,
    /// `motor_a.velocity`, `motor_b.velocity` (m/s of belt), and torques (N m) where recorded.
    pub channels: Vec<Channel>,
    /// Which output each channel is.
    pub outputs: Vec<Output>,
}

/// The measured state at the start of a run.
#[derive(Debug, Clone, Copy)]
pub struct RunStart {
    /// Time (s).
    pub time: f64,
    /// End of the run (s).
    pub end: f64,
    /// Place of the carriage (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// Whether nothing was recorded just before, so that the plant starts anew.
    pub fresh: bool,
}

/// An output of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// Velocity of a motor, in metres of belt.
    Velocity(usize),
    /// Torque of a motor.
    Torque(usize),
}

impl Stage for DriveStage {
    fn kind(&self) -> StageKind {
        StageKind::Drive
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, effect: &Effect) -> bool {
        plant::calls(&effect.physics)
    }

    fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let plant = Plant::new(twin);
        let mut state = plant.start();
        let radius = twin.belt_per_turn / TAU;
        let mut reader = Reader { stage: self, radius, next: vec![0; self.channels.len()] };
        for values in predicted.iter_mut() {
            values.fill(f64::NAN);
        }
        let delays = plant.delays();
        let mut cursors = [0_usize; 2];
        for (index, run) in self.starts.iter().enumerate() {
            if run.fresh || index == 0 {
                state = plant.start();
                state.time = run.time;
                state.place(run.position, run.velocity);
                cursors = [0; 2];
            } else {
                state.position = run.position;
            }
            reader.begin(index);
            let mut before = Outputs::of(&plant, &state, 0.0);
            while state.time < run.end {
                let (command, until) = self.command_at(state.time, delays, &mut cursors);
                let span = (until.min(run.end) - state.time).max(1e-9);
                let steps = (span / LONGEST_STEP).ceil();
                let dt = span / steps;
                for _ in 0..steps as usize {
                    plant.step(&mut state, command, dt);
                    let after = Outputs::of(&plant, &state, dt);
                    reader.read(index, [&before, &after], predicted);
                    before = after;
                }
            }
            reader.finish(index, &before, predicted);
        }
    }
}

impl DriveStage {
    /// Motor commands in force at `time`, each its own `delay` ago, and until when they are.
    fn command_at(&self, time: f64, delays: [f64; 2], cursors: &mut [usize; 2]) -> ([f64; 2], f64) {
        let mut until = f64::INFINITY;
        let command = both(|motor| {
            let sent = time - delays[motor] + 1e-9;
            let cursor = &mut cursors[motor];
            while *cursor < self.command_times.len() && self.command_times[*cursor] <= sent {
                *cursor += 1;
            }
            if let Some(next) = self.command_times.get(*cursor) {
                until = until.min(next + delays[motor]);
            }
            let index = cursor.checked_sub(1);
            index.map_or(0.0, |index| belts(self.commands[index])[motor])
        });
        (command, until.max(time + 1e-6))
    }
}

/// What can be compared after one step.
struct Outputs {
    /// End of the step (s).
    time: f64,
    /// Velocity of each motor then, as its encoder reports it (m/s of belt).
    velocity: [f64; 2],
    /// Middle of the step (s).
    middle: f64,
    /// Force of each motor then (N of belt).
    force: [f64; 2],
}

impl Outputs {
    /// Of `state` after a step of `dt` seconds.
    fn of(plant: &Plant, state: &PlantState, dt: f64) -> Self {
        Self {
            time: state.time,
            velocity: plant.reported(state),
            middle: state.time - 0.5 * dt,
            force: state.force,
        }
    }

    /// Time and value of `output` (m/s of belt, or N m with pulleys of `radius` metres).
    fn get(&self, output: Output, radius: f64) -> (f64, f64) {
        match output {
            Output::Velocity(motor) => (self.time, self.velocity[motor]),
            Output::Torque(motor) => (self.middle, self.force[motor] * radius),
        }
    }
}

/// Reads the plant at the times of the measured samples.
struct Reader<'a> {
    stage: &'a DriveStage,
    radius: f64,
    next: Vec<usize>,
}

impl Reader<'_> {
    fn begin(&mut self, run: usize) {
        for (next, channel) in self.next.iter_mut().zip(&self.stage.channels) {
            *next = channel.runs[run].start;
        }
    }

    /// Reads what lies between two steps' outputs.
    fn read(&mut self, run: usize, step: [&Outputs; 2], predicted: &mut [Vec<f64>]) {
        for (index, channel) in self.stage.channels.iter().enumerate() {
            let output = self.stage.outputs[index];
            let [(start, from), (end, to)] = step.map(|at| at.get(output, self.radius));
            let next = &mut self.next[index];
            while *next < channel.runs[run].end && channel.times[*next] <= end {
                let share = ((channel.times[*next] - start) / (end - start)).clamp(0.0, 1.0);
                predicted[index][*next] = from + share * (to - from);
                *next += 1;
            }
        }
    }

    /// Reads what is left of a run after its last step.
    fn finish(&mut self, run: usize, last: &Outputs, predicted: &mut [Vec<f64>]) {
        for (index, channel) in self.stage.channels.iter().enumerate() {
            let (_, value) = last.get(self.stage.outputs[index], self.radius);
            let next = &mut self.next[index];
            while *next < channel.runs[run].end && channel.times[*next] <= last.time {
                predicted[index][*next] = value;
                *next += 1;
            }
        }
    }
}
