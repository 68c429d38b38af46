//! Free run of the axis: simulation of its position from the measured input.

use super::{
    AxisStage,
    chain::{Chain, Memory},
    shifted,
    signals::sign,
};
use crate::{effects::Motion, twin::Twin};
use std::ops::Range;

/// Position error of a free-running axis, compared with its measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FreeRun {
    /// RMS of the position error (m or rad).
    pub position_rms: f64,
    /// Largest error (m or rad).
    pub position_worst: f64,
    /// Windows that were run.
    pub windows: usize,
}

impl AxisStage {
    /// Run `twin` from the measured input, restarted from the measured state after each `window`
    /// seconds. The error is reported together with the residual of the input and never fitted: an
    /// integrator accumulates the smallest bias. `None` without a whole window.
    #[must_use]
    pub fn free_run(&self, twin: &Twin, window: f64) -> Option<FreeRun> {
        let chain = Chain::new(twin);
        let length = (window / self.dt).round().max(1.0) as usize;
        let inputs = inputs_of_steps(&chain, &self.raw_input, self.dt);
        let mut course = Course::new(&chain);
        course.settle(inputs.first().copied()?, &self.motion(0, chain.origin));
        let (mut squares, mut worst, mut count, mut windows) = (0.0_f64, 0.0_f64, 0, 0);
        let first = super::LAST * self.factor;
        let end = (self.signals.position.len() + 1).saturating_sub(first + length);
        for begin in (first..end).step_by(length) {
            let is_whole = |own: &Range<usize>| own.start <= begin && begin + length <= own.end;
            if !self.segments.iter().any(is_whole) {
                continue;
            }
            let mut motion = self.motion(begin, chain.origin);
            course.memory.move_to(&motion);
            for (index, input) in inputs.iter().enumerate().skip(begin).take(length) {
                let error = motion.position + chain.origin - self.signals.position[index];
                squares += error * error;
                worst = worst.max(error.abs());
                count += 1;
                motion.time = self.time(index);
                course.step(*input, &mut motion);
            }
            windows += 1;
        }
        (0 < count).then(|| FreeRun {
            position_rms: (squares / f64::from(count)).sqrt(),
            position_worst: worst,
            windows,
        })
    }
}

/// Response of `twin` to the `input` at equal steps: position and velocity at each of them.
///
/// `start` and `dt` are the time of the first input and the step (s), `state` is the initial position and
/// velocity.
pub(in crate::twin) fn respond(
    twin: &Twin,
    (start, dt): (f64, f64),
    input: &[f64],
    state: [f64; 2],
) -> Vec<[f64; 2]> {
    let chain = Chain::new(twin);
    let inputs = inputs_of_steps(&chain, input, dt);
    let mut course = Course::new(&chain);
    let [position, velocity] = state;
    let position = position - chain.origin;
    let mut motion = Motion {
        time: start,
        run_start_time: start,
        dt,
        position,
        velocity,
        position_origin: chain.origin,
        ..Motion::default()
    };
    course.settle(inputs.first().copied().unwrap_or(0.0), &motion);
    let mut states = Vec::with_capacity(input.len());
    for (index, input) in inputs.iter().enumerate() {
        states.push([motion.position + chain.origin, motion.velocity]);
        motion.time = start + dt * index as f64;
        course.step(*input, &mut motion);
    }
    states
}

/// Input of each step of `dt` seconds. A force changes the velocity by its value in the middle of
/// the step; a velocity setpoint is reached at its end.
fn inputs_of_steps(chain: &Chain, input: &[f64], dt: f64) -> Vec<f64> {
    let place = if chain.input_per_velocity == 0.0 { 0.5 } else { 1.0 };
    let inputs = shifted(input, place - chain.delay / dt);
    match &chain.resonance {
        Some(own) => own.forwards(&inputs, dt),
        None => inputs,
    }
}

/// Stepwise simulation of an axis by the midpoint method, of second order where forces are smooth.
struct Course<'c> {
    chain: &'c Chain,
    memory: Memory,
    /// Memory of the trial step to the middle.
    trial: Memory,
}

impl<'c> Course<'c> {
    fn new(chain: &'c Chain) -> Self {
        Self { chain, memory: chain.memory(), trial: chain.memory() }
    }

    /// Begin as if `input` had been constant for long.
    fn settle(&mut self, input: f64, motion: &Motion) {
        self.chain.settle_input(&mut self.memory, input, motion);
    }

    /// Advance `motion` by its time step, on which `input` acts.
    fn step(&mut self, input: f64, motion: &mut Motion) {
        let (steps, dt, before) = (self.chain.steps(), motion.dt, motion.velocity);
        motion.dt /= f64::from(steps);
        (0..steps).for_each(|_| self.substep(input, motion));
        motion.dt = dt;
        motion.acceleration = (motion.velocity - before) / dt;
    }

    fn substep(&mut self, input: f64, motion: &mut Motion) {
        self.trial.copy_from(&self.memory);
        let mut ahead = *motion;
        advance(self.chain, &mut self.trial, (input, motion), &mut ahead);
        let middle = Motion {
            time: motion.time + 0.5 * motion.dt,
            position: 0.5 * (motion.position + ahead.position),
            velocity: 0.5 * (motion.velocity + ahead.velocity),
            ..ahead
        };
        advance(self.chain, &mut self.memory, (input, &middle), motion);
    }
}

/// Advance `motion` by its time step with the forces at the motion `at`. Friction removes at most
/// the whole velocity.
fn advance(chain: &Chain, memory: &mut Memory, (input, at): (f64, &Motion), motion: &mut Motion) {
    let mut at = Motion { mass: chain.mass(at).max(f64::MIN_POSITIVE), ..*at };
    at.force = chain.force(memory, input, &at);
    let loads = chain.loads(memory, &at);
    let before = motion.velocity;
    // The velocity after the step: inertia * (velocity - before) = force_of(velocity) + forces - friction.
    let inertia = loads.mass / motion.dt;
    let resistance = inertia + chain.input_per_velocity;
    let standing = Motion { velocity: 0.0, ..at };
    let free = (inertia * before + chain.force_of(memory, at.force, &standing) + loads.forces)
        / resistance;
    let loss = (loads.level(at.velocity).max(0.0) / resistance).min(free.abs());
    (motion.force, motion.mass) = (at.force, at.mass);
    motion.velocity = free - loss * sign(free);
    chain.integrate(memory, at.force - motion.velocity, motion.dt);
    motion.acceleration = (motion.velocity - before) / motion.dt;
    motion.position += 0.5 * motion.dt * (before + motion.velocity);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::twin::Machine;

    /// A mass with viscous friction under a sinusoidal force, against its closed form: `m v' = F sin(w t) - c v`.
    #[test]
    fn half_of_the_step_has_a_quarter_of_the_error() {
        const MASS: f64 = 2.0;
        const VISCOUS: f64 = 3.0;
        const FORCE: f64 = 4.0;
        const OMEGA: f64 = 8.0;
        let mut twin = Twin::nominal(Machine::Axis);
        for instance in &mut twin.instances {
            match instance.effect.name {
                "gantry.inertia" => instance.values[0].value = MASS,
                "drive.friction.viscous" => instance.values[0].value = VISCOUS,
                _ => {}
            }
        }
        let rate = VISCOUS / MASS;
        let size = FORCE / MASS / (rate * rate + OMEGA * OMEGA);
        let velocity = |t: f64| {
            let (sine, cosine) = (OMEGA * t).sin_cos();
            size * (rate * sine - OMEGA * cosine + OMEGA * (-rate * t).exp())
        };
        let worst = |dt: f64| {
            let time = |index: usize| dt * index as f64;
            let count = (5.0 / dt).round() as usize;
            let input: Vec<f64> = (0..count).map(|k| FORCE * (OMEGA * time(k)).sin()).collect();
            let states = respond(&twin, (0.0, dt), &input, [0.0; 2]);
            let errors =
                states.iter().enumerate().map(|(k, own)| (own[1] - velocity(time(k))).abs());
            errors.fold(0.0, f64::max)
        };
        let [coarse, fine] = [worst(2e-3), worst(1e-3)];
        assert!(fine < 1e-5 * size * OMEGA, "{fine} m/s");
        assert!((3.5..4.5).contains(&(coarse / fine)), "{coarse} and {fine} m/s");
    }
}
