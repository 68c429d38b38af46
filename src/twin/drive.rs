//! Prediction of motor motion: the plant, driven by the recorded commands.

mod march;

use super::{Channel, MeasuredPath, Plant, Stage, StageKind, Twin, plant};
use crate::{
    effects::{Axis, Effect, PhaseSeries, both},
    gantry::belts,
};
use march::Job;
use std::{f64::consts::TAU, ops::Range};

/// Time after the start of a run during which the command in force may precede the run (s): the
/// plant runs there, but nothing is compared.
pub(super) const SETTLING: f64 = 0.1;

/// One gantry of one session. Input: commands; output: motor velocities and torques.
#[derive(Debug, Clone)]
pub struct DriveStage {
    /// Time of each command (s).
    pub command_times: Vec<f64>,
    /// Latency from then until each motor has received it (s), as far as it is known.
    pub arrivals: [f64; 2],
    /// Commanded velocity in board coordinates (m/s).
    pub commands: Vec<[f64; 2]>,
    /// Start of each run: time (s), measured position (m) and velocity (m/s).
    pub starts: Vec<RunStart>,
    /// `motor_a.velocity`, `motor_b.velocity` (m/s of belt), and torques (N m) where recorded.
    pub channels: Vec<Channel>,
    /// Output of the plant on each channel.
    pub outputs: Vec<Output>,
    /// Measured path of the carriage, by its motors; `None` where nothing was measured.
    pub path: Option<MeasuredPath>,
}

/// The measured state at the start of a run.
#[derive(Debug, Clone, Copy)]
pub struct RunStart {
    /// Time (s).
    pub time: f64,
    /// End of the run (s).
    pub end: f64,
    /// Position of the carriage (m).
    pub position: [f64; 2],
    /// Its velocity (m/s).
    pub velocity: [f64; 2],
    /// True if nothing was recorded just before, so that the plant starts anew.
    pub fresh: bool,
}

/// An output of the plant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Output {
    /// Position of a motor by its encoder, in metres of belt.
    Position(usize),
    /// Velocity of a motor, in metres of belt.
    Velocity(usize),
    /// Torque of a motor.
    Torque(usize),
}

impl Output {
    /// Index of the motor.
    fn motor(self) -> usize {
        match self {
            Self::Position(motor) | Self::Velocity(motor) | Self::Torque(motor) => motor,
        }
    }
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

    fn feels(&self, effect: &Effect, axis: Axis) -> bool {
        plant::feels(&effect.physics, axis)
    }

    /// The one nuisance group, if given, is the time (s) by which commands reach each motor later than by `arrivals`.
    fn predict(&self, twin: &Twin, nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        self.predict_alone(twin, nuisance, predicted);
    }

    fn predict_each(
        &self,
        twins: &[&Twin],
        nuisance: &[Vec<f64>],
        predicted: &mut [Vec<Vec<f64>>],
    ) -> bool {
        let late = match nuisance {
            [late] => both(|motor| late[motor]),
            _ => [0.0; 2],
        };
        let plants: Vec<Plant> = twins.iter().map(|twin| Plant::new(twin)).collect();
        let all = plants.iter().zip(twins).zip(predicted);
        let (soft, rigid): (Vec<_>, Vec<_>) = all
            .map(|((plant, twin), predicted)| Job {
                plant,
                late,
                radius: twin.belt_metres_per_turn / TAU,
                predicted,
            })
            .partition(|job| job.plant.is_soft());
        march::march(self, soft);
        march::march(self, rigid);
        true
    }

    fn phase_series(&self, residual: &[Vec<f64>]) -> Vec<PhaseSeries> {
        let Some(path) = &self.path else { return Vec::new() };
        let channels = self.channels.iter().zip(&self.outputs).zip(residual);
        let of = |((channel, output), residual): ((&Channel, &Output), &Vec<f64>)| {
            let mut cursor = 0;
            let mut at = |time: &f64| belts(path.carriage(*time, 0.0, 0.0, &mut cursor).position);
            let motor = output.motor();
            let position = channel.times.iter().map(|time| at(time)[motor]).collect();
            PhaseSeries { position, residual: residual.clone(), is_filtered: false }.by_direction()
        };
        channels.flat_map(of).collect()
    }

    fn positions_along(&self, axis: Axis, _twin: &Twin) -> Vec<f64> {
        let positions = self.path.iter().flat_map(MeasuredPath::positions);
        match axis {
            Axis::X => positions.map(|position| position[0]).collect(),
            Axis::Y => positions.map(|position| position[1]).collect(),
            _ => Vec::new(),
        }
    }

    fn lot(&self, twin: &Twin) -> usize {
        usize::from(twin.instances.iter().any(|own| own.spring().is_some()))
    }

    fn width(&self) -> usize {
        march::width(self.sequences().len().max(1))
    }
}

impl DriveStage {
    /// Sequences of runs, each of which begins with a plant that starts anew.
    fn sequences(&self) -> Vec<Range<usize>> {
        let count = self.starts.len();
        let is_first = |run: &usize| *run == 0 || self.starts[*run].fresh;
        let mut firsts: Vec<usize> = (0..count).filter(is_first).collect();
        firsts.push(count);
        firsts.windows(2).map(|pair| pair[0]..pair[1]).filter(|runs| !runs.is_empty()).collect()
    }

    /// Motor commands in force at `time`, each sent its own `delay` before, and the time until
    /// which both are in force (s).
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

/// State of a plant after one step, from which its outputs are read.
struct Outputs<'a> {
    plant: &'a Plant,
    /// End of the step (s).
    time: f64,
    /// Its middle (s), whose force the drives report.
    middle: f64,
    /// Position (m), velocity (m/s) and acceleration (m/s^2) of the carriage; forces of the motors (N of belt).
    motion: [[f64; 2]; 4],
    /// Lag of each filter of the velocity estimators, by motor (m/s of belt).
    lag: [[f64; 2]; 2],
    /// Radius of the pulleys (m).
    radius: f64,
}

impl Outputs<'_> {
    /// Time of `output` (s).
    #[inline(always)]
    fn time(&self, output: Output) -> f64 {
        match output {
            Output::Position(_) | Output::Velocity(_) => self.time,
            Output::Torque(motor) => self.middle + self.plant.torque_ages()[motor],
        }
    }

    /// Value of `output` (m or m/s of belt, N m).
    fn value(&self, output: Output) -> f64 {
        let [position, velocity, _, force] = self.motion;
        match output {
            Output::Position(motor) => self.plant.reported_position(motor, position),
            Output::Velocity(motor) => {
                self.plant.reported_velocity(motor, [position, velocity], self.lag)
            }
            Output::Torque(motor) => force[motor] * self.radius,
        }
    }

    /// Second derivative of `output` in the step that ends here, after one that ended at `before`,
    /// as far as it is known. For a force it is zero: a force is interpolated between the middles
    /// of two steps, across any bend.
    fn bend(&self, before: &Self, output: Output) -> f64 {
        match output {
            Output::Position(motor) => belts(self.motion[2])[motor],
            Output::Velocity(motor) => {
                let rate = |at: &Self| at.plant.reported_rate(motor, at.lag);
                (rate(self) - rate(before)) / (self.time - before.time)
            }
            Output::Torque(_) => 0.0,
        }
    }
}

/// Reads the plant at the times of the measured samples.
struct Reader<'a> {
    stage: &'a DriveStage,
    /// Next sample of each channel, and its time (s), infinite after the last one of the run.
    next: Vec<usize>,
    due: Vec<f64>,
    /// Earliest of these times among positions and velocities, and among the torques of each motor (s).
    first_due: f64,
    torque_due: [f64; 2],
}

impl<'a> Reader<'a> {
    fn new(stage: &'a DriveStage) -> Self {
        let count = stage.channels.len();
        let (next, due) = (vec![0; count], vec![f64::INFINITY; count]);
        Self { stage, next, due, first_due: f64::INFINITY, torque_due: [f64::INFINITY; 2] }
    }

    fn begin(&mut self, run: usize) {
        for (index, channel) in self.stage.channels.iter().enumerate() {
            self.go_to(channel.runs[run].start, index, run);
        }
        self.find_first();
    }

    /// Return whether a sample lies before the end of a step at `time`, whose middle the motors
    /// report at `told` (s).
    #[inline(always)]
    fn is_due(&self, time: f64, told: [f64; 2]) -> bool {
        self.first_due <= time || self.torque_due[0] <= told[0] || self.torque_due[1] <= told[1]
    }

    /// Go on to the `sample` of channel `index` in `run`.
    fn go_to(&mut self, sample: usize, index: usize, run: usize) {
        let channel = &self.stage.channels[index];
        let is_in_run = sample < channel.runs[run].end;
        self.next[index] = sample;
        self.due[index] = if is_in_run { channel.times[sample] } else { f64::INFINITY };
    }

    /// Find the earliest of the next samples.
    fn find_first(&mut self) {
        (self.first_due, self.torque_due) = (f64::INFINITY, [f64::INFINITY; 2]);
        for (output, due) in self.stage.outputs.iter().zip(&self.due) {
            let first = match *output {
                Output::Position(_) | Output::Velocity(_) => &mut self.first_due,
                Output::Torque(motor) => &mut self.torque_due[motor],
            };
            *first = first.min(*due);
        }
    }

    /// Read the samples between the outputs of two steps.
    fn read(&mut self, run: usize, step: [&Outputs<'_>; 2], predicted: &mut [Vec<f64>]) {
        for (index, output) in self.stage.outputs.iter().enumerate() {
            let [start, end] = step.map(|at| at.time(*output));
            if end < self.due[index] {
                continue;
            }
            let [from, to] = step.map(|at| at.value(*output));
            let bend = step[1].bend(step[0], *output);
            while self.due[index] <= end {
                let share = ((self.due[index] - start) / (end - start)).clamp(0.0, 1.0);
                let sag = 0.5 * bend * share * (1.0 - share) * (end - start).powi(2);
                predicted[index][self.next[index]] = from + share * (to - from) - sag;
                self.go_to(self.next[index] + 1, index, run);
            }
        }
        self.find_first();
    }

    /// Read the remaining samples of a run after its last step.
    fn finish(&mut self, run: usize, last: &Outputs<'_>, predicted: &mut [Vec<f64>]) {
        for (index, output) in self.stage.outputs.iter().enumerate() {
            while self.due[index] <= last.time {
                predicted[index][self.next[index]] = last.value(*output);
                self.go_to(self.next[index] + 1, index, run);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, Domain},
        twin::{Instance, Machine, Source},
    };

    /// Mass on both axes of the carriage (kg).
    const MASS: f64 = 2.4;

    /// A frictionless table whose loops are critically damped, at `omega` (rad/s), with commands that are
    /// `delay` seconds late and ramps of `slope` (m/s^2 of belt).
    fn table(omega: f64, delay: f64, slope: f64) -> Twin {
        let mut twin = Twin::nominal(Machine::Table);
        twin.instances.retain(|own| !own.effect.name.starts_with("drive.friction"));
        let mut set = |name: &str, values: &[f64]| {
            twin.instances.retain(|own| own.effect.name != name);
            let effect = crate::effects::find(name).unwrap();
            twin.instances.push(Instance::new(effect, Axis::Motors, values, Source::Nominal));
        };
        set("drive.velocity_loop", &[omega / TAU, 1.0, 0.0, 0.0, 0.0]);
        set("drive.saturation.slew", &[slope]);
        set("drive.delay", &[delay]);
        for instance in &mut twin.instances {
            if instance.effect.name == "gantry.inertia" {
                instance.values[0].value = MASS;
            }
        }
        twin
    }

    /// The same with a delay of `age` (s) as `parameter` of its loops.
    fn aged(mut twin: Twin, parameter: &str, age: f64) -> Twin {
        let gains = twin.instances.iter_mut().find(|own| own.effect.name == "drive.velocity_loop");
        let gains = gains.unwrap();
        let of = gains.effect.parameters.iter().position(|own| own.name == parameter);
        gains.values[of.unwrap()].value = age;
        twin
    }

    fn channel(signal: &str, times: &[f64]) -> Channel {
        let run = 0..times.len();
        Channel {
            signal: signal.to_owned(),
            unit: "1",
            domain: Domain::Drive,
            axis: "a",
            rate_hz: 100.0,
            times: times.to_vec(),
            measured: vec![0.0; times.len()],
            runs: vec![run],
        }
    }

    /// Times at which the sensors are read (s).
    fn sampled() -> Vec<f64> {
        (1..40).map(|k| 0.0103 + 0.0007 * f64::from(k)).collect()
    }

    /// Response of the first motor to a command of 1 m/s along x at 0.01 s: velocities and torques.
    fn answers(twin: &Twin, times: &[f64]) -> [Vec<f64>; 2] {
        answers_to(twin, [1.0, 0.0], 0, times)
    }

    /// Response of `motor` to a command of `velocity` (m/s) at 0.01 s: velocities and torques.
    fn answers_to(twin: &Twin, velocity: [f64; 2], motor: usize, times: &[f64]) -> [Vec<f64>; 2] {
        predicted(&stage(velocity, motor, times), twin, &[])
    }

    /// Stage on which `motor` is measured after a command of `velocity` (m/s) at 0.01 s.
    fn stage(velocity: [f64; 2], motor: usize, times: &[f64]) -> DriveStage {
        DriveStage {
            command_times: vec![0.0, 0.01],
            arrivals: [0.0; 2],
            commands: vec![[0.0, 0.0], velocity],
            starts: vec![RunStart {
                time: 0.0,
                end: times.last().expect("a time") + 0.01,
                position: [0.0; 2],
                velocity: [0.0; 2],
                fresh: true,
            }],
            channels: vec![channel("velocity", times), channel("torque", times)],
            outputs: vec![Output::Velocity(motor), Output::Torque(motor)],
            path: None,
        }
    }

    /// Prediction of `stage`, with nuisance parameters: velocities and torques.
    fn predicted(stage: &DriveStage, twin: &Twin, nuisance: &[Vec<f64>]) -> [Vec<f64>; 2] {
        let mut predicted = vec![vec![0.0; stage.channels[0].times.len()]; 2];
        stage.predict(twin, nuisance, &mut predicted);
        predicted.try_into().expect("two channels")
    }

    /// A drive keeps its gains with a larger mass. With twice the mass, the natural frequency and
    /// the damping ratio of the loop are smaller by the root of two.
    #[test]
    fn the_gains_of_a_loop_do_not_follow_the_mass() {
        let omega = 120.0;
        let loaded = |omega: f64, damping: f64, tuned: Option<f64>| {
            let mut twin = table(omega, 0.0, 5.0);
            twin.controller_reference_mass = tuned;
            for instance in &mut twin.instances {
                match instance.effect.name {
                    "gantry.inertia" => instance.values[0].value = 2.0 * MASS,
                    "drive.velocity_loop" => instance.values[1].value = damping,
                    _ => {}
                }
            }
            answers(&twin, &sampled())
        };
        let root = 2.0_f64.sqrt();
        let [kept, equal, other] = [
            loaded(omega, 1.0, Some(MASS)),
            loaded(omega / root, 1.0 / root, None),
            loaded(omega, 1.0, None),
        ];
        let apart = |one: &[Vec<f64>; 2], two: &[Vec<f64>; 2]| {
            one[0].iter().zip(&two[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
        };
        assert!(apart(&kept, &equal) < 1e-12, "{}", apart(&kept, &equal));
        assert!(1e-3 < apart(&kept, &other), "{}", apart(&kept, &other));
    }

    /// Closed form of a PI loop that follows a ramp from rest. The error is `r t exp(-w t)`, so the
    /// velocity is `r t (1 - exp(-w t))` and the force `m r (1 - (1 - w t) exp(-w t))`.
    #[test]
    fn velocity_and_torque_are_those_of_the_closed_form_at_every_sample() {
        let (omega, delay, slope) = (120.0, 0.0079, 17.0);
        let age = 4e-4;
        let twin = aged(table(omega, delay, slope), "torque_report_delay_s", age);
        let times = sampled();
        let [velocities, torques] = answers(&twin, &times);
        // Along x both motors pull: each moves half of the mass, in metres of belt, which equal
        // those along the axis.
        let force = 0.5 * MASS * slope * twin.belt_metres_per_turn / TAU;
        for (k, time) in times.iter().enumerate() {
            let t = (time - 0.01 - delay).max(0.0);
            let velocity = slope * t * (1.0 - (-omega * t).exp());
            let then = omega * (t - age).max(0.0);
            let torque = force * (1.0 - (1.0 - then) * (-then).exp());
            let (seen, felt) = (velocities[k], torques[k]);
            // Half of the noise of a sensor.
            assert!((seen - velocity).abs() < 2.5e-4, "{t} s: {seen} not {velocity} m/s");
            assert!((felt - torque).abs() < 0.01 * force, "{t} s: {felt} not {torque} N m");
        }
    }

    /// Velocity and force (m/s, N) at each of `times` (s after the command) of a mass behind a PI loop on a phase-locked
    /// loop with the time constant `time` (s), under a ramp of `slope` (m/s^2): their equations in small steps.
    fn by_its_equations(omega: f64, slope: f64, time: f64, times: &[f64]) -> Vec<[f64; 2]> {
        const TINY: f64 = 1e-7;
        let mass = 0.5 * MASS;
        let (mut position, mut velocity, mut integral) = (0.0, 0.0, 0.0);
        let (mut estimated_position, mut estimated_velocity) = (0.0, 0.0);
        let (mut all, mut now, mut force) = (Vec::new(), 0.0, 0.0);
        for until in times {
            while now < *until {
                let error = slope * now - estimated_velocity;
                integral += TINY * error;
                force = mass * (2.0 * omega * error + omega * omega * integral);
                let ahead: f64 = position - estimated_position;
                estimated_position += TINY * (estimated_velocity + 2.0 * ahead / time);
                estimated_velocity += TINY * ahead / (time * time);
                position += TINY * velocity;
                velocity += TINY * force / mass;
                now += TINY;
            }
            all.push([estimated_velocity, force]);
        }
        all
    }

    #[test]
    fn a_loop_on_an_estimator_does_what_its_equations_say() {
        let (omega, slope) = (90.0, 17.0);
        for time in [3e-4, 1e-3, 2e-3] {
            let twin = aged(table(omega, 0.0, slope), "estimator_time_constant_s", time);
            let times = sampled();
            let [velocities, torques] = answers(&twin, &times);
            let after: Vec<f64> = times.iter().map(|own| own - 0.01).collect();
            let expected = by_its_equations(omega, slope, time, &after);
            let radius = twin.belt_metres_per_turn / TAU;
            let most = 0.5 * MASS * slope * radius;
            for (k, [velocity, force]) in expected.into_iter().enumerate() {
                let (seen, felt) = (velocities[k], torques[k]);
                // Half of the noise of a sensor.
                assert!((seen - velocity).abs() < 2.5e-4, "{time} s: {seen} not {velocity} m/s");
                let torque = force * radius;
                assert!((felt - torque).abs() < 0.01 * most, "{time} s: {felt} not {torque} N m");
            }
        }
    }

    /// With one mass on both axes, the motors do not affect each other, so a later frame is a dead
    /// time of its motor alone.
    #[test]
    fn a_motor_that_hears_its_command_later_moves_later() {
        let [sooner, later] = [table(120.0, 0.002, 17.0), table(120.0, 0.005, 17.0)];
        let times = sampled();
        for (motor, twin) in [(0, &sooner), (1, &later)] {
            let frames = [0.0, 0.003];
            let at_once = stage([1.0, 0.0], motor, &times);
            let with_frames =
                predicted(&DriveStage { arrivals: frames, ..at_once.clone() }, &sooner, &[]);
            assert_eq!(predicted(&at_once, &sooner, &[frames.to_vec()]), with_frames);
            let dead = answers_to(twin, [1.0, 0.0], motor, &times);
            let apart = |k: usize| (with_frames[0][k] - dead[0][k]).abs();
            let worst = (0..times.len()).map(apart).fold(0.0, f64::max);
            assert!(worst < 2.5e-4, "motor {motor}: {worst} m/s");
        }
    }

    /// The same loop with a delayed velocity, by small steps of the definition with a memory of
    /// velocities.
    #[test]
    fn a_loop_that_sees_old_velocities_swings_as_its_definition_does() {
        let (omega, slope, age) = (120.0, 17.0, 3e-4);
        let twin = aged(table(omega, 0.0, slope), "feedback_delay_s", age);
        let times = sampled();
        let [seen, _] = answers(&twin, &times);
        let [fresh, _] = answers(&table(omega, 0.0, slope), &times);
        let (steps, dt) = (60_000_usize, 1e-6);
        let mut velocity = vec![0.0; steps];
        let (mut travelled, mut setpoint) = (0.0, 0.0_f64);
        for step in 10_000..steps - 1 {
            setpoint = (setpoint + slope * dt).min(1.0);
            let error = setpoint - velocity[step - (age / dt) as usize];
            travelled += error * dt;
            let pull = 2.0 * omega * error + omega * omega * travelled;
            velocity[step + 1] = velocity[step] + pull * dt;
        }
        let at = |time: f64| velocity[(time / dt).round() as usize];
        let worst = |own: &[f64]| {
            times.iter().zip(own).fold(0.0_f64, |most, (t, v)| most.max((v - at(*t)).abs()))
        };
        // Half of the noise of a sensor, and far less than the effect of the delay.
        assert!(worst(&seen) < 2.5e-4, "{} m/s", worst(&seen));
        assert!(8.0 * worst(&seen) < worst(&fresh), "{} m/s", worst(&fresh));
    }

    /// A motor that runs out of force at speed, by small steps of the definition. The loop stops
    /// integrating where it demands more than the limit that it knows, and recovers without the
    /// integral that it would have accumulated.
    #[test]
    fn a_loop_at_its_limit_stops_integrating() {
        let (omega, slope, most, top) = (60.0, 17.0, 22.0, 1.6);
        let mut twin = table(omega, 0.0, slope);
        let limit = crate::effects::find("drive.saturation.torque_speed").unwrap();
        twin.instances.push(Instance::new(limit, Axis::Motors, &[most, top], Source::Nominal));
        let times: Vec<f64> = (1..300).map(|k| 0.0103 + 0.0007 * f64::from(k)).collect();
        let [seen, _] = answers(&twin, &times);
        let simulated = |stops: bool| -> Vec<f64> {
            let (dt, mass) = (1e-6, 0.5 * MASS);
            let (mut velocity, mut setpoint, mut integral) = (0.0_f64, 0.0_f64, 0.0);
            let mut at = Vec::new();
            for step in 10_000..230_000 {
                let time = f64::from(step) * dt;
                setpoint = (setpoint + slope * dt).min(1.0);
                let error = setpoint - velocity;
                let demand = mass * 2.0 * omega * error + integral;
                if !stops || demand.abs() <= most || demand * error < 0.0 {
                    integral += mass * omega * omega * error * dt;
                }
                let left = if 0.0 < demand * velocity { 1.0 - velocity.abs() / top } else { 1.0 };
                velocity += dt * demand.clamp(-most * left, most * left) / mass;
                if times.get(at.len()).is_some_and(|next| *next <= time) {
                    at.push(velocity);
                }
            }
            at
        };
        let worst =
            |own: &[f64]| seen.iter().zip(own).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        let (right, wrong) = (worst(&simulated(true)), worst(&simulated(false)));
        // The switch falls anywhere within a step; the effect of the accumulated integral is far
        // larger.
        assert!(right < 4e-3 && 50.0 * right < wrong, "{right} and {wrong} m/s");
    }

    /// Along one axis both motors pull on one mass, by small steps of the definition. The mass on
    /// the other axis counts in the gains only.
    #[test]
    fn each_rail_answers_with_its_own_mass() {
        let (omega, slope, masses) = (60.0, 17.0, [2.0, 3.0]);
        let mut twin = table(omega, 0.0, slope);
        let inertias = twin.instances.iter_mut().filter(|own| own.effect.name == "gantry.inertia");
        for (instance, mass) in inertias.zip(masses) {
            instance.values[0].value = mass;
        }
        let times = sampled();
        let [seen, _] = answers(&twin, &times);
        let (dt, gains) = (1e-6, 0.25 * (masses[0] + masses[1]));
        let (mut velocity, mut travelled, mut setpoint) = (0.0_f64, 0.0_f64, 0.0_f64);
        let mut worst = 0.0_f64;
        let mut next = 0;
        for step in 10_000..60_000 {
            setpoint = (setpoint + slope * dt).min(1.0);
            let error = setpoint - velocity;
            travelled += error * dt;
            let force = gains * (2.0 * omega * error + omega * omega * travelled);
            velocity += 2.0 * force / masses[0] * dt;
            if times.get(next).is_some_and(|time| *time <= f64::from(step) * dt) {
                worst = worst.max((seen[next] - velocity).abs());
                next += 1;
            }
        }
        assert!(next == times.len() && worst < 2.5e-4, "{worst} m/s");
    }

    /// On a diagonal, one motor turns and the other is held, partly by its own friction and partly
    /// by that of the guides. The reference is by small steps of the definition, with friction as a
    /// very steep line.
    #[test]
    fn friction_at_a_motor_that_is_held_leaves_the_rails_theirs() {
        let (omega, slope, speed, on_rails, at_motors) = (60.0, 17.0, 0.2, [2.0, 3.0], 0.5);
        let mut twin = table(omega, 0.0, slope);
        let friction = crate::effects::find("drive.friction.coulomb").unwrap();
        let mut rub = |axis, level| {
            twin.instances.push(Instance::new(friction, axis, &[level], Source::Nominal));
        };
        rub(Axis::X, on_rails[0]);
        rub(Axis::Y, on_rails[1]);
        rub(Axis::Motors, at_motors);
        let times: Vec<f64> = (0..40).map(|k| 0.1003 + 0.005 * f64::from(k)).collect();
        let felt = both(|motor| answers_to(&twin, [speed; 2], motor, &times)[1].clone());
        let (dt, gains, creep) = (1e-6, 0.5 * MASS, 1e-5);
        let line = |level: f64, velocity: f64| -level * (velocity / creep).clamp(-1.0, 1.0);
        let (mut velocity, mut travelled, mut setpoint) = ([0.0_f64; 2], [0.0_f64; 2], 0.0_f64);
        let (mut off, mut next) = ([0.0_f64; 2], 0);
        for step in 10_000..310_000 {
            setpoint = (setpoint + slope * dt).min(2.0 * speed);
            let along = belts(velocity);
            let error = [setpoint - along[0], -along[1]];
            travelled = both(|m| travelled[m] + error[m] * dt);
            let force = both(|m| gains * (2.0 * omega * error[m] + omega * omega * travelled[m]));
            if times.get(next).is_some_and(|time| *time <= f64::from(step) * dt) {
                let told = both(|m| felt[m][next] / (twin.belt_metres_per_turn / TAU));
                off = both(|m| off[m] + (told[m] - force[m]) / times.len() as f64);
                next += 1;
            }
            let pull = belts(both(|m| force[m] + line(at_motors, along[m])));
            velocity = both(|rail| {
                velocity[rail] + dt * (pull[rail] + line(on_rails[rail], velocity[rail])) / MASS
            });
        }
        assert!(off.iter().all(|off| off.abs() < 0.02 * at_motors), "{off:?} N");
    }

    /// A motor first crosses half of its backlash with its rotor alone, and then takes the load
    /// along: by small steps of the definition.
    #[test]
    fn a_motor_feels_its_own_play_and_not_that_of_a_rail() {
        let (omega, slope, width, mass) = (60.0, 17.0, 3e-3, 0.5 * MASS);
        let (load_mass, rotor) = (0.11 * mass, 0.89 * mass);
        let with_play = |axis| {
            let mut twin = table(omega, 0.0, slope);
            let play = crate::effects::find("drive.backlash").unwrap();
            twin.instances.push(Instance::new(play, axis, &[width, 50.0], Source::Nominal));
            twin
        };
        let times: Vec<f64> = (1..300).map(|k| 0.0103 + 0.0007 * f64::from(k)).collect();
        let [seen, _] = answers(&with_play(Axis::Motors), &times);
        let [rigid, _] = answers(&table(omega, 0.0, slope), &times);
        assert_eq!(answers(&with_play(Axis::Guides), &times)[0], rigid);
        let dt = 1e-6;
        let (mut motor, mut load, mut ahead) = (0.0_f64, 0.0_f64, 0.0_f64);
        let (mut setpoint, mut integral) = (0.0_f64, 0.0_f64);
        let mut worst = [0.0_f64; 2];
        let mut next = 0;
        for step in 10_000..230_000 {
            setpoint = (setpoint + slope * dt).min(1.0);
            let error = setpoint - motor;
            integral += mass * omega * omega * error * dt;
            let beyond = ahead - ahead.clamp(-0.5 * width, 0.5 * width);
            let damping = 2.0 * 0.28 * (5e5 * load_mass).sqrt() * (motor - load);
            let pull = if beyond == 0.0 { 0.0 } else { 5e5 * beyond + damping };
            motor += dt * (mass * 2.0 * omega * error + integral - pull) / rotor;
            load += dt * pull / load_mass;
            ahead += dt * (motor - load);
            if times.get(next).is_some_and(|time| *time <= f64::from(step) * dt) {
                worst[0] = worst[0].max((seen[next] - motor).abs());
                worst[1] = worst[1].max((rigid[next] - motor).abs());
                next += 1;
            }
        }
        // The effect of an impact lasts through a step of the loop.
        assert!(worst[0] < 0.01 && 3.0 * worst[0] < worst[1], "{worst:?} m/s");
    }

    /// With one soft belt, the other belt swings alike if it hardly stretches and if it is rigid,
    /// also with friction.
    #[test]
    fn beside_a_soft_belt_a_rigid_one_is_the_limit_of_a_stiff_one() {
        let find = |name| crate::effects::find(name).unwrap();
        let mut rigid = table(120.0, 0.0, 17.0);
        let add = |twin: &mut Twin, name, axis, values: &[f64]| {
            twin.instances.push(Instance::new(find(name), axis, values, Source::Nominal));
        };
        add(&mut rigid, "drive.friction.coulomb", Axis::Guides, &[3.0]);
        add(&mut rigid, "drive.compliance.belt", Axis::A, &[3.5e-5, 0.98, 0.03]);
        let mut stiff = rigid.clone();
        add(&mut stiff, "drive.compliance.belt", Axis::B, &[2.1e-6, 0.98, 0.03]);
        let times = sampled();
        let (ours, theirs) = (answers(&rigid, &times), answers(&stiff, &times));
        let apart = |k: usize| {
            let both = ours[k].iter().zip(&theirs[k]);
            both.fold(0.0_f64, |most, (own, other)| most.max((own - other).abs()))
        };
        // Noise of a sensor.
        assert!(apart(0) < 5e-4, "{} m/s", apart(0));
        assert!(apart(1) < 1.5e-3, "{} N m", apart(1));
    }

    #[test]
    fn an_eccentric_pulley_and_encoder_repeat_with_the_belt_of_the_machine() {
        const METRES_PER_TURN: f64 = 0.05;
        let of = |name: &str, values: &[f64]| {
            let mut twin = table(120.0, 0.0, 17.0);
            twin.belt_metres_per_turn = METRES_PER_TURN;
            let effect = crate::effects::find(name).unwrap();
            twin.instances.push(Instance::new(effect, Axis::A, values, Source::Nominal));
            twin
        };
        let times = sampled();
        let [_, pulley] = answers(&of("drive.ripple.pulley", &[0.7, -0.4]), &times);
        let [_, motor] = answers(&of("drive.ripple.motor", &[0.7, -0.4, METRES_PER_TURN]), &times);
        for (pulley, motor) in pulley.iter().zip(&motor) {
            assert!((pulley - motor).abs() < 1e-9, "{pulley} N m, not {motor} N m");
        }
        let plant = Plant::new(&of("sensor.encoder_eccentricity", &[5e-5, 2e-5]));
        let error = |travel: f64| plant.reported_position(0, [travel, 0.0]) - travel;
        assert!((error(0.013) - error(0.013 + METRES_PER_TURN)).abs() < 1e-12);
        assert!((error(0.0125) - 5e-5).abs() < 1e-12, "a quarter of a turn: {} m", error(0.0125));
    }

    /// The smallest compliance of a fit is a quarter of that of a usual belt: "without" must be rigid.
    #[test]
    fn an_effect_set_to_null_does_nothing_though_null_is_outside_the_bounds_of_a_fit() {
        for name in ["drive.compliance.belt", "drive.backlash"] {
            let effect = crate::effects::find(name).unwrap();
            let mut twin = table(120.0, 0.0, 17.0);
            let without = answers(&twin, &sampled());
            twin.instances.push(Instance::new(
                effect,
                Axis::Motors,
                effect.probes[0],
                Source::Fitted,
            ));
            assert!(Plant::new(&twin).is_soft(), "{name}");
            let slot = crate::twin::Slot { instance: twin.instances.len() - 1, parameter: 0 };
            twin.set_to_null(slot);
            assert!(!Plant::new(&twin).is_soft(), "{name}");
            assert_eq!(answers(&twin, &sampled()), without, "{name}");
        }
    }
}
