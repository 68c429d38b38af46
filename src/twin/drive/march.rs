//! The march of several plants through the commands of one stage, side by side.
//!
//! A plant starts anew after a pause of the recording. So the sequences of runs between such pauses are independent, and
//! those of one plant are simulated side by side, too.

use super::{DriveStage, Outputs, Reader};
use crate::{
    effects::{Motion, both},
    gantry::belts,
    lanes::{self, Lanes, SideBySide},
    twin::{
        MeasuredPath, Plant,
        plant::{Aside, LONGEST_STEP, PlantLanes, StateLanes},
    },
};
use pulp::Simd;
use std::ops::Range;

/// The first steps after a command (s), which takes effect within the first of them.
const FIRST_STEPS: [f64; 4] = [2e-5, 1e-4, 2e-4, 4e-4];

/// One plant and the destination of its predictions.
pub(super) struct Job<'a> {
    pub(super) plant: &'a Plant,
    /// Time by which commands reach each motor later than by the arrivals of the stage (s).
    pub(super) late: [f64; 2],
    /// Radius of the pulleys (m).
    pub(super) radius: f64,
    /// `[channel][sample]`.
    pub(super) predicted: &'a mut Vec<Vec<f64>>,
}

/// Fewest plants that fill all lanes of this processor with `sequences` of runs each.
pub(super) fn width(sequences: usize) -> usize {
    let lanes = lanes::width();
    (1..lanes).find(|plants| (plants * sequences).is_multiple_of(lanes)).unwrap_or(lanes)
}

/// One sequence of runs of one plant.
struct Task {
    job: usize,
    runs: Range<usize>,
}

/// March all plants, of which either all or none have soft belts.
pub(super) fn march(stage: &DriveStage, mut jobs: Vec<Job<'_>>) {
    jobs.iter_mut().flat_map(|job| job.predicted.iter_mut()).for_each(|own| own.fill(f64::NAN));
    let mut sequences = stage.sequences();
    let seconds = |runs: &Range<usize>| {
        stage.starts[runs.clone()].iter().map(|run| run.end - run.time).sum::<f64>()
    };
    // Lanes of similar length finish together.
    sequences.sort_by(|one, other| seconds(other).total_cmp(&seconds(one)));
    let count = jobs.len();
    let of_all = |runs| (0..count).map(move |job| Task { job, runs: Range::clone(runs) });
    let mut tasks: Vec<Task> = sequences.iter().flat_map(of_all).collect();
    lanes::side_by_side(&mut March { stage, jobs: &mut jobs }, &mut tasks);
}

struct March<'a, 'j> {
    stage: &'a DriveStage,
    jobs: &'a mut [Job<'j>],
}

impl SideBySide for March<'_, '_> {
    type Item = Task;

    #[inline(always)]
    fn run<S: Simd>(&mut self, simd: S, tasks: &mut [Task]) {
        let Self { stage, jobs } = self;
        let tasks = &*tasks;
        let plants: Vec<&Plant> = tasks.iter().map(|task| jobs[task.job].plant).collect();
        let lanes = PlantLanes::new(simd, &plants);
        let mut state = StateLanes::new(simd);
        let mut memories: Vec<Vec<f64>> = plants.iter().map(|plant| plant.memory()).collect();
        let mut rails = vec![[Motion::default(); 2]; plants.len()];
        let mut belts: Vec<[Motion; 2]> = plants.iter().map(|plant| plant.belts()).collect();
        let mut aside = Aside { memories: &mut memories, rails: &mut rails, belts: &mut belts };
        let walk = |task: &Task| Walk::new(stage, &jobs[task.job], task.runs.clone());
        let mut walks: Vec<Walk<'_>> = tasks.iter().map(walk).collect();
        let mut dt = Lanes::splat(simd, LONGEST_STEP);
        let mut command = [Lanes::splat(simd, 0.0); 2];
        loop {
            let mut goes_on = false;
            for (lane, (walk, task)) in walks.iter_mut().zip(tasks).enumerate() {
                let job = &mut jobs[task.job];
                let next = walk.next(lane, &mut state, &mut aside.memories[lane], job);
                if walk.before == 0.0 {
                    aside.tell_run_start(lane, walk.run_start_time());
                }
                if let Some(path) = stage.path.as_ref().filter(|_| job.plant.follows_phase()) {
                    aside.tell_measured(lane, walk.measured_ahead(lane, &state, path));
                }
                dt.set(lane, next.unwrap_or(LONGEST_STEP));
                command[0].set(lane, walk.command[0]);
                command[1].set(lane, walk.command[1]);
                goes_on = goes_on || next.is_some();
            }
            if !goes_on {
                return;
            }
            let before = state;
            lanes.step(&mut state, &mut aside, command, dt);
            for (lane, (walk, task)) in walks.iter_mut().zip(tasks).enumerate() {
                walk.read(lane, [&before, &state], dt.get(lane), &mut jobs[task.job]);
            }
        }
    }
}

/// Progress of one plant through a sequence of runs.
struct Walk<'a> {
    stage: &'a DriveStage,
    reader: Reader<'a>,
    /// Delay from a command until each motor executes it (s).
    delays: [f64; 2],
    /// Delay of the torque that each drive reports (s).
    torque_ages: [f64; 2],
    cursors: [usize; 2],
    /// Index in the measured path.
    path_cursor: usize,
    /// Runs that have not begun, the one that began last, and whether it continues.
    ahead: Range<usize>,
    run: usize,
    is_running: bool,
    /// Command in force (m/s of belt), and the steps until the next one.
    command: [f64; 2],
    steps: Steps,
    /// Length of the step before (s); 0 where a run has just begun.
    before: f64,
}

impl<'a> Walk<'a> {
    fn new(stage: &'a DriveStage, job: &Job<'_>, runs: Range<usize>) -> Self {
        let dead = job.plant.delays();
        Self {
            stage,
            reader: Reader::new(stage),
            delays: both(|motor| stage.arrivals[motor] + job.late[motor] + dead[motor]),
            torque_ages: job.plant.torque_ages(),
            cursors: [0; 2],
            path_cursor: 0,
            run: runs.start,
            ahead: runs,
            is_running: false,
            command: [0.0; 2],
            steps: Steps::none(),
            before: 0.0,
        }
    }

    /// Length of the next step (s); `None` at the end.
    #[inline(always)]
    fn next<S: Simd>(
        &mut self,
        lane: usize,
        state: &mut StateLanes<S>,
        memory: &mut [f64],
        job: &mut Job<'_>,
    ) -> Option<f64> {
        loop {
            if let Some(step) = self.steps.next() {
                return Some(step);
            }
            if !self.is_running {
                self.begin(lane, state, memory, job)?;
            }
            let run = &self.stage.starts[self.run];
            let time = state.time.get(lane);
            if time < run.end {
                let (command, until) = self.stage.command_at(time, self.delays, &mut self.cursors);
                self.command = command;
                self.steps = Steps::of((until.min(run.end) - time).max(1e-9));
            } else {
                let last = self.outputs(lane, state, self.before, job);
                self.reader.finish(self.run, &last, job.predicted);
                self.is_running = false;
            }
        }
    }

    /// Distance of each measured motor ahead of the simulated one in `lane` (m of belt).
    fn measured_ahead<S: Simd>(
        &mut self,
        lane: usize,
        state: &StateLanes<S>,
        path: &MeasuredPath,
    ) -> [f64; 2] {
        let time = state.time.get(lane);
        let measured = path.carriage(time, LONGEST_STEP, 0.0, &mut self.path_cursor).position;
        let [simulated, ..] = state.motion(lane);
        belts(both(|index| measured[index] - simulated[index]))
    }

    /// Time at which the run began (s).
    fn run_start_time(&self) -> f64 {
        self.stage.starts[self.run].time
    }

    /// Begin the next run; `None` after the last.
    fn begin<S: Simd>(
        &mut self,
        lane: usize,
        state: &mut StateLanes<S>,
        memory: &mut [f64],
        job: &Job<'_>,
    ) -> Option<()> {
        let index = self.ahead.next()?;
        let run = &self.stage.starts[index];
        if run.fresh || index == 0 {
            let mut fresh = job.plant.start();
            fresh.time = run.time;
            fresh.place(run.position, run.velocity);
            state.put(lane, &fresh);
            memory.fill(0.0);
            state.put_remembered(lane, job.plant, memory);
            self.cursors = [0; 2];
        } else {
            state.put_at(lane, run.position);
        }
        self.reader.begin(index);
        (self.run, self.is_running, self.before) = (index, true, 0.0);
        Some(())
    }

    /// Read the samples that were measured during a step of `dt` seconds between two states.
    #[inline(always)]
    fn read<S: Simd>(
        &mut self,
        lane: usize,
        step: [&StateLanes<S>; 2],
        dt: f64,
        job: &mut Job<'_>,
    ) {
        let end = step[1].time.get(lane);
        let middle = end - 0.5 * dt;
        let told = [middle + self.torque_ages[0], middle + self.torque_ages[1]];
        if self.is_running && self.reader.is_due(end, told) {
            let before = self.outputs(lane, step[0], self.before, job);
            let after = self.outputs(lane, step[1], dt, job);
            self.reader.read(self.run, [&before, &after], job.predicted);
        }
        self.before = dt;
    }

    /// Outputs that can be compared after a step of `dt` seconds.
    fn outputs<'j, S: Simd>(
        &self,
        lane: usize,
        state: &StateLanes<S>,
        dt: f64,
        job: &Job<'j>,
    ) -> Outputs<'j> {
        let time = state.time.get(lane);
        Outputs {
            plant: job.plant,
            time,
            middle: time - 0.5 * dt,
            motion: state.motion(lane),
            lag: state.lag(lane),
            radius: job.radius,
        }
    }
}

/// Steps (s) that make up a span after a command. The first ones are short, because the force bends
/// there and is interpolated between the middles of two steps, which would round the bend off.
struct Steps {
    first: [f64; FIRST_STEPS.len()],
    /// Number of the first steps that are over.
    taken: usize,
    /// Length of the others, and how many of them are left.
    rest: f64,
    left: usize,
}

impl Steps {
    fn none() -> Self {
        Self { first: FIRST_STEPS, taken: FIRST_STEPS.len(), rest: 0.0, left: 0 }
    }

    /// The steps of `span` seconds.
    fn of(span: f64) -> Self {
        let mut left = span;
        let first = FIRST_STEPS.map(|step| {
            let step = step.min(left);
            left -= step;
            step
        });
        let count = (left / LONGEST_STEP).ceil();
        Self { first, taken: 0, rest: left / count.max(1.0), left: count as usize }
    }
}

impl Iterator for Steps {
    type Item = f64;

    #[inline(always)]
    fn next(&mut self) -> Option<f64> {
        while let Some(step) = self.first.get(self.taken) {
            self.taken += 1;
            if 0.0 < *step {
                return Some(*step);
            }
        }
        self.left = self.left.checked_sub(1)?;
        Some(self.rest)
    }
}

#[cfg(test)]
mod tests {
    use super::{Range, width};
    use crate::{
        effects::{Axis, Domain},
        twin::{Channel, DriveStage, Output, Stage, Twin, drive::RunStart},
    };

    /// Two runs with a jump of the position between them, and a third after a pause.
    fn stage() -> DriveStage {
        let starts = [(0.0, 0.35, true), (0.35, 0.6, false), (1.0, 1.4, true)];
        let starts: Vec<RunStart> = starts
            .into_iter()
            .map(|(time, end, fresh)| {
                let position = [0.01 * time, -0.02];
                RunStart { time, end, position, velocity: [0.0, 0.1], fresh }
            })
            .collect();
        let times: Vec<f64> = (0..140).map(|k| 0.0004 + 0.01 * f64::from(k)).collect();
        let within = |start: &RunStart| {
            times.partition_point(|time| *time < start.time)
                ..times.partition_point(|time| *time < start.end)
        };
        let channel = || Channel {
            signal: String::new(),
            unit: "1",
            domain: Domain::Drive,
            axis: "a",
            rate_hz: 100.0,
            times: times.clone(),
            measured: vec![0.0; times.len()],
            runs: starts.iter().map(within).collect(),
        };
        let swing = |k: u32| {
            let phase = 0.7 * f64::from(k * k % 23);
            [0.6 * phase.sin(), if k % 11 < 3 { 0.0 } else { 0.5 * phase.cos() }]
        };
        DriveStage {
            command_times: (0..70).map(|k| 0.02 * f64::from(k)).collect(),
            arrivals: [0.0, 0.001],
            commands: (0..70).map(swing).collect(),
            channels: vec![channel(), channel(), channel()],
            outputs: vec![Output::Velocity(0), Output::Torque(1), Output::Position(1)],
            starts,
            path: None,
        }
    }

    /// Twins with rigid belts, with soft ones and with backlash, and every kind of function.
    fn twins() -> Vec<Twin> {
        let rubs = ("drive.friction.presliding", Axis::Guides, &[1.5, 1e-4, 1e-3, 20.0][..]);
        let held = ("drive.friction.coulomb", Axis::Motors, &[0.7][..]);
        let soft = ("drive.compliance.belt", Axis::Motors, &[2e-5, 0.98, 0.05][..]);
        let play = ("drive.backlash", Axis::Motors, &[4e-4, 50.0][..]);
        let limit = ("drive.saturation.torque_speed", Axis::Motors, &[6.0, 2.0][..]);
        let late = ("drive.delay", Axis::A, &[0.0033][..]);
        let round = ("sensor.encoder_eccentricity", Axis::A, &[2e-4, 1e-4][..]);
        let spring = ("coupling.striker_friction", Axis::Whole, &[0.05, 40.0, 0.2, 0.02][..]);
        let damped = ("coupling.striker_friction", Axis::Whole, &[0.2, 4000.0, 4.0, 0.5][..]);
        let rough = ("drive.friction.position", Axis::X, &[0.0, 0.0, 0.3, 0.0, 0.07][..]);
        let loaded = ("drive.friction.load", Axis::B, &[0.05][..]);
        let wave = ("drive.ripple.motor", Axis::Motors, &[0.4, -0.3, 1.7e-3][..]);
        let turns = ("drive.ripple.pulley", Axis::B, &[0.2, 0.5][..]);
        let heavy = ("gantry.mass_position", Axis::X, &[0.5, 0.0][..]);
        let lists: &[&[(&str, Axis, &[f64])]] = &[
            &[],
            &[rubs],
            &[soft, rubs, held],
            &[held, late],
            &[play],
            &[soft, late, limit],
            &[play, rubs, held, limit],
            &[held, rubs],
            &[("drive.backlash", Axis::A, &[2e-4, 20.0]), held],
            &[round, limit],
            &[soft],
            &[spring],
            &[damped, rubs],
            &[rough],
            &[loaded, heavy],
            &[wave, held],
            &[turns, wave, rubs],
        ];
        lists.iter().map(|list| Twin::table_with(list)).collect()
    }

    /// `stage` with the runs of one sequence only.
    fn only(stage: &DriveStage, runs: &Range<usize>) -> DriveStage {
        let mut own = stage.clone();
        own.starts = stage.starts[runs.clone()].to_vec();
        for channel in &mut own.channels {
            channel.runs = channel.runs[runs.clone()].to_vec();
        }
        own
    }

    #[test]
    fn a_sequence_of_runs_does_not_depend_on_the_others() {
        let (stage, twins) = (stage(), twins());
        let sequences = stage.sequences();
        assert_eq!(sequences, [0..2, 2..3]);
        for twin in &twins {
            let predict = |stage: &DriveStage| {
                let mut predicted = vec![vec![0.0; 140]; 3];
                stage.predict(twin, &[], &mut predicted);
                predicted
            };
            let whole = predict(&stage);
            for runs in &sequences {
                let alone = predict(&only(&stage, runs));
                let pairs = whole.iter().flatten().zip(alone.iter().flatten());
                let mut known = 0;
                for (whole, alone) in pairs.filter(|(_, alone)| alone.is_finite()) {
                    assert_eq!(whole.to_bits(), alone.to_bits());
                    known += 1;
                }
                assert!(100 < known, "{known}");
            }
        }
    }

    #[test]
    fn as_few_plants_as_fill_all_lanes_are_simulated_at_once() {
        let lanes = width(1);
        assert_eq!(width(lanes), 1);
        assert_eq!(width(3 * lanes), 1);
        assert_eq!(width(3), lanes, "no fewer than all lanes give a whole number of vectors");
    }

    #[test]
    fn side_by_side_every_plant_moves_as_it_does_alone() {
        let (stage, twins) = (stage(), twins());
        let all: Vec<&Twin> = twins.iter().collect();
        let blank = || vec![vec![0.0; 140]; 3];
        let mut together = vec![blank(); all.len()];
        assert!(stage.predict_each(&all, &[], &mut together));
        let bits = |all: &[Vec<f64>]| -> Vec<Vec<u64>> {
            all.iter().map(|own| own.iter().map(|value| value.to_bits()).collect()).collect()
        };
        for (index, twin) in twins.iter().enumerate() {
            let mut alone = blank();
            stage.predict(twin, &[], &mut alone);
            assert_eq!(bits(&alone), bits(&together[index]), "twin {index}");
            assert!(together[index].iter().flatten().filter(|own| own.is_finite()).count() > 250);
            let same = twins[..index]
                .iter()
                .enumerate()
                .find(|(other, _)| bits(&together[*other]) == bits(&together[index]));
            assert!(same.is_none(), "twin {index} moves as another one");
        }
    }
}
