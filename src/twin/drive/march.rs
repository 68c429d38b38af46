//! The march of several plants through the commands of one stage, side by side.

use super::{DriveStage, Outputs, Reader};
use crate::{
    effects::{Motion, both},
    gantry::belts,
    twin::{
        MeasuredPath, Plant,
        lanes::Lanes,
        plant::{Aside, LONGEST_STEP, PlantLanes, StateLanes},
    },
};
use pulp::{Arch, Simd, WithSimd};

/// The first steps after a command (s), which takes effect within the first of them.
const FIRST_STEPS: [f64; 4] = [2e-5, 1e-4, 2e-4, 4e-4];

/// One plant and the destination of its predictions.
pub(super) struct Job<'a> {
    pub(super) plant: &'a Plant,
    /// Radius of the pulleys (m).
    pub(super) radius: f64,
    /// `[channel][sample]`.
    pub(super) predicted: &'a mut Vec<Vec<f64>>,
}

/// Number of plants that march at once on this processor.
pub(super) fn width() -> usize {
    struct Width;

    impl WithSimd for Width {
        type Output = usize;

        #[inline(always)]
        fn with_simd<S: Simd>(self, _simd: S) -> usize {
            S::F64_LANES
        }
    }

    Arch::new().dispatch(Width)
}

/// March all plants, of which either all or none have soft belts.
pub(super) fn side_by_side(stage: &DriveStage, mut jobs: Vec<Job<'_>>) {
    let width = width();
    // A vector takes about as long as a quarter of its lanes one after the other.
    let few = width.div_ceil(4);
    for jobs in jobs.chunks_mut(width) {
        if jobs.len() <= few {
            jobs.chunks_mut(1).for_each(|jobs| March { stage, jobs }.with_simd(pulp::Scalar));
        } else {
            Arch::new().dispatch(March { stage, jobs });
        }
    }
}

/// As many plants as there are lanes, or fewer.
struct March<'a, 'j> {
    stage: &'a DriveStage,
    jobs: &'a mut [Job<'j>],
}

impl WithSimd for March<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { stage, jobs } = self;
        let plants: Vec<&Plant> = jobs.iter().map(|job| job.plant).collect();
        let lanes = PlantLanes::new(simd, &plants);
        let mut state = StateLanes::new(simd);
        let mut memories: Vec<Vec<f64>> = plants.iter().map(|plant| plant.memory()).collect();
        let mut rails = vec![[Motion::default(); 2]; plants.len()];
        let mut belts: Vec<[Motion; 2]> = plants.iter().map(|plant| plant.belts()).collect();
        let mut aside = Aside { memories: &mut memories, rails: &mut rails, belts: &mut belts };
        let mut walks: Vec<Walk<'_>> = jobs.iter().map(|job| Walk::new(stage, job)).collect();
        jobs.iter_mut().flat_map(|job| job.predicted.iter_mut()).for_each(|own| own.fill(f64::NAN));
        let mut dt = Lanes::splat(simd, LONGEST_STEP);
        let mut command = [Lanes::splat(simd, 0.0); 2];
        loop {
            let mut goes_on = false;
            for (lane, (walk, job)) in walks.iter_mut().zip(jobs.iter_mut()).enumerate() {
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
            for (lane, (walk, job)) in walks.iter_mut().zip(jobs.iter_mut()).enumerate() {
                walk.read(lane, [&before, &state], dt.get(lane), job);
            }
        }
    }
}

/// Progress of one plant through the runs of a stage.
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
    /// Number of runs that have begun, and whether the last of them continues.
    begun: usize,
    is_running: bool,
    /// Command in force (m/s of belt), and the steps until the next one.
    command: [f64; 2],
    steps: Steps,
    /// Length of the step before (s); 0 where a run has just begun.
    before: f64,
}

impl<'a> Walk<'a> {
    fn new(stage: &'a DriveStage, job: &Job<'_>) -> Self {
        let dead = job.plant.delays();
        Self {
            stage,
            reader: Reader::new(stage, job.radius),
            delays: [stage.arrivals[0] + dead[0], stage.arrivals[1] + dead[1]],
            torque_ages: job.plant.torque_ages(),
            cursors: [0; 2],
            path_cursor: 0,
            begun: 0,
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
            let run = &self.stage.starts[self.begun - 1];
            let time = state.time.get(lane);
            if time < run.end {
                let (command, until) = self.stage.command_at(time, self.delays, &mut self.cursors);
                self.command = command;
                self.steps = Steps::of((until.min(run.end) - time).max(1e-9));
            } else {
                let last = self.outputs(lane, state, self.before, job);
                self.reader.finish(self.begun - 1, &last, job.predicted);
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
        self.begun.checked_sub(1).map_or(0.0, |run| self.stage.starts[run].time)
    }

    /// Begins the next run; `None` after the last.
    fn begin<S: Simd>(
        &mut self,
        lane: usize,
        state: &mut StateLanes<S>,
        memory: &mut [f64],
        job: &Job<'_>,
    ) -> Option<()> {
        let run = self.stage.starts.get(self.begun)?;
        if run.fresh || self.begun == 0 {
            let mut fresh = job.plant.start();
            fresh.time = run.time;
            fresh.place(run.position, run.velocity);
            state.put(lane, &fresh);
            memory.fill(0.0);
            state.put_bends(lane, job.plant, memory);
            self.cursors = [0; 2];
        } else {
            state.put_at(lane, run.position);
        }
        self.reader.begin(self.begun);
        (self.begun, self.is_running, self.before) = (self.begun + 1, true, 0.0);
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
            self.reader.read(self.begun - 1, [&before, &after], job.predicted);
        }
        self.before = dt;
    }

    /// Outputs that can be compared after a step of `dt` seconds.
    fn outputs<S: Simd>(
        &self,
        lane: usize,
        state: &StateLanes<S>,
        dt: f64,
        job: &Job<'_>,
    ) -> Outputs {
        Outputs::of(job.plant, [state.time.get(lane), dt], state.motion(lane))
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
    use crate::{
        effects::{Axis, Domain, find},
        twin::{
            Channel, DriveStage, Instance, Machine, Output, Source, Stage, Twin, drive::RunStart,
        },
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

    /// The plain table with `effects`, each on an axis with its values.
    fn with(effects: &[(&str, Axis, &[f64])]) -> Twin {
        let mut twin = Twin::nominal(Machine::Table);
        for (name, axis, numbers) in effects {
            let effect = find(name).unwrap();
            twin.instances.push(Instance::new(effect, *axis, numbers, Source::Nominal));
        }
        twin
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
        let rough = ("drive.friction.position", Axis::X, &[0.0, 0.0, 0.3, 0.0, 0.07][..]);
        let loaded = ("drive.friction.load", Axis::B, &[0.05][..]);
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
            &[rough],
            &[loaded, heavy],
        ];
        lists.iter().map(|list| with(list)).collect()
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
