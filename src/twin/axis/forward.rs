//! The axis run free: from its measured input to its position.

use super::{AxisStage, chain::Chain, shifted, sign};
use crate::{effects::Motion, twin::Twin};
use std::ops::Range;

/// How far a free-running axis strays from its measured position.
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
    /// Runs `twin` from the measured input, anew from the measured state after each `window`
    /// seconds. To report beside the input's residual, never to fit: an integrator piles up the
    /// smallest bias. `None` without a whole window.
    #[must_use]
    pub fn free_run(&self, twin: &Twin, window: f64) -> Option<FreeRun> {
        let chain = Chain::new(twin);
        let length = (window / self.dt).round().max(1.0) as usize;
        // The input in the middle of each step.
        let inputs = shifted(&self.raw_input, 0.5 - chain.delay / self.dt);
        let mut memory = chain.memory();
        chain.settle_input(&mut memory, inputs.first().copied()?, &self.motion(0, chain.origin));
        let (mut squares, mut worst, mut count, mut windows) = (0.0_f64, 0.0_f64, 0, 0);
        let first = super::ENDS * self.factor;
        let end = (self.position.len() + 1).saturating_sub(first + length);
        for begin in (first..end).step_by(length) {
            let is_whole = |own: &Range<usize>| own.start <= begin && begin + length <= own.end;
            if !self.segments.iter().any(is_whole) {
                continue;
            }
            let mut motion = self.motion(begin, chain.origin);
            for (index, input) in inputs.iter().enumerate().skip(begin).take(length) {
                let error = motion.position + chain.origin - self.position[index];
                squares += error * error;
                worst = worst.max(error.abs());
                count += 1;
                motion.time = self.time(index);
                motion.force = chain.force(&mut memory, *input, &motion);
                step(&chain, &mut memory, &mut motion);
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
    // The input in the middle of each step.
    let middle = shifted(input, 0.5 - chain.delay / dt);
    let mut memory = chain.memory();
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
    chain.settle_input(&mut memory, middle.first().copied().unwrap_or(0.0), &motion);
    let mut states = Vec::with_capacity(input.len());
    for (index, input) in middle.iter().enumerate() {
        states.push([motion.position + chain.origin, motion.velocity]);
        motion.time = start + dt * index as f64;
        motion.force = chain.force(&mut memory, *input, &motion);
        step(&chain, &mut memory, &mut motion);
    }
    states
}

/// One step: friction takes away at most the whole velocity.
fn step(chain: &Chain, memory: &mut super::chain::Memory, motion: &mut Motion) {
    motion.mass = chain.mass(motion).max(f64::MIN_POSITIVE);
    let (forces, level) = chain.loads(memory, motion);
    let before = motion.velocity;
    let free = before + motion.dt * (motion.force + forces) / motion.mass;
    let loss = (motion.dt * level.max(0.0) / motion.mass).min(free.abs());
    motion.velocity = free - loss * sign(free);
    motion.acceleration = (motion.velocity - before) / motion.dt;
    motion.position += 0.5 * motion.dt * (before + motion.velocity);
}
