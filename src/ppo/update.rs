//! Epochs over a batch: gradients by several threads, with the same bytes for any number.
//!
//! A minibatch is divided into lanes of at most [`LANE_ROWS`] samples. The gradient of a lane is
//! summed by one thread in the order of its samples; lanes are then added in their own order, a
//! block of parameters at a time. Neither sum depends on the assignment to threads. Every thread
//! has its own copy of both networks and applies the same Adam step to it, so that no thread waits
//! for another one's update.

use super::{
    Gaussian, PpoError, PpoSettings, Schedule,
    barrier::Barrier,
    batch::{Batch, Epoch, Minibatch, parts},
    loss::{LossSums, LossTerms},
    model::{Model, Scratch, clip_scale},
};
use crate::nn::{MAX_OUTPUTS, flushing_denormals};
use std::{
    ops::Range,
    sync::{
        PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

/// Maximum number of samples of one lane, which one thread processes at a time.
const LANE_ROWS: usize = 512;

/// Maximum number of samples evaluated at once: their activations stay in a second-level cache.
const TILE_ROWS: usize = 128;

/// Number of parameters that one thread sums over the lanes at a time.
const BLOCK: usize = 2048;

/// Early stopping: factor on the KL limit, as in Stable-Baselines3.
const KL_STOP_FACTOR: f64 = 1.5;

/// Bounds and factor of the adaptive learning rate (rl_games, `schedulers.py`,
/// `AdaptiveScheduler`).
const RATE_BOUNDS: [f32; 2] = [1e-6, 1e-2];
const RATE_FACTOR: f32 = 1.5;

/// Inputs of the epochs other than the model.
pub(super) struct Passes<'a> {
    pub(super) settings: &'a PpoSettings,
    pub(super) batch: &'a Batch,
    pub(super) epochs: &'a [Epoch],
    /// Policy that acted.
    pub(super) old: Gaussian,
    /// Index of this update, from 1.
    pub(super) update: u64,
    pub(super) threads: usize,
    /// Weight of the imitation loss.
    pub(super) imitation_coef: f32,
}

/// Results of the epochs.
pub(super) struct Passed {
    pub(super) model: Model,
    pub(super) learning_rate: f32,
    pub(super) totals: Totals,
}

/// Sums over the minibatches used for learning.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Totals {
    pub(super) minibatches: usize,
    /// Number of epochs begun.
    pub(super) epochs: usize,
    pub(super) samples: usize,
    pub(super) sums: LossSums,
    pub(super) entropy: f64,
    pub(super) gradient_norm: f64,
    /// Number of minibatches with a clipped gradient.
    pub(super) shortened: usize,
}

/// Gradient and losses of a lane.
#[derive(Default)]
struct Lane {
    gradient: Vec<f32>,
    sums: LossSums,
}

/// A range of parameters, summed over the lanes.
struct Block {
    values: Vec<f32>,
    squares: f64,
}

/// Data shared by the threads.
struct Shared<'a> {
    passes: &'a Passes<'a>,
    lanes: Vec<RwLock<Lane>>,
    blocks: Vec<RwLock<Block>>,
    /// Next lane to process, in even and odd minibatches.
    next: [AtomicUsize; 2],
    barrier: Barrier,
}

fn read<T>(lock: &RwLock<T>) -> RwLockReadGuard<'_, T> {
    lock.read().unwrap_or_else(PoisonError::into_inner)
}

fn write<T>(lock: &RwLock<T>) -> RwLockWriteGuard<'_, T> {
    lock.write().unwrap_or_else(PoisonError::into_inner)
}

impl Passes<'_> {
    /// Run all epochs over the batch, starting from `model` and `learning_rate`, which are not
    /// changed.
    pub(super) fn run(&self, model: &Model, learning_rate: f32) -> Result<Passed, PpoError> {
        let size = model.parameter_count();
        let largest = self.epochs.iter().flat_map(|epoch| {
            epoch.minibatches.iter().map(|minibatch| epoch.samples(minibatch).len())
        });
        let lanes = largest.max().unwrap_or(0).div_ceil(LANE_ROWS);
        let lane = || RwLock::new(Lane { gradient: vec![0.0; size], sums: LossSums::default() });
        let block = |range: Range<usize>| {
            RwLock::new(Block { values: vec![0.0; range.len()], squares: 0.0 })
        };
        let shared = Shared {
            passes: self,
            lanes: (0..lanes).map(|_| lane()).collect(),
            blocks: blocks(size).map(block).collect(),
            next: Default::default(),
            barrier: Barrier::new(self.threads),
        };
        let work = |index: usize| {
            let model = model.clone();
            let shared = &shared;
            move || {
                let _attendance = shared.barrier.attend();
                flushing_denormals(|| Worker::new(shared, index, model, learning_rate).run())
            }
        };
        thread::scope(|scope| {
            for index in 1..self.threads {
                scope.spawn(work(index));
            }
            work(0)()
        })
    }
}

fn blocks(size: usize) -> impl Iterator<Item = Range<usize>> {
    (0..size).step_by(BLOCK).map(move |start| start..size.min(start + BLOCK))
}

/// One thread of the epochs.
struct Worker<'a> {
    shared: &'a Shared<'a>,
    index: usize,
    model: Model,
    learning_rate: f32,
    scratch: Scratch,
    totals: Totals,
}

/// Decision to continue with the epochs or to stop.
#[derive(PartialEq)]
enum Next {
    Minibatch,
    End,
}

impl<'a> Worker<'a> {
    fn new(shared: &'a Shared<'a>, index: usize, model: Model, learning_rate: f32) -> Self {
        let (scratch, totals) = Default::default();
        Self { shared, index, model, learning_rate, scratch, totals }
    }

    fn run(mut self) -> Result<Passed, PpoError> {
        let passes = self.shared.passes;
        let mut turn = 0;
        'passes: for (epoch_number, epoch) in passes.epochs.iter().enumerate() {
            self.totals.epochs += 1;
            for (number, minibatch) in epoch.minibatches.iter().enumerate() {
                let next = self.minibatch(epoch, minibatch, turn);
                turn += 1;
                let next = next.map_err(|what| PpoError::NonFiniteLearning {
                    update: passes.update,
                    epoch: epoch_number + 1,
                    minibatch: number + 1,
                    what,
                })?;
                if next == Next::End {
                    break 'passes;
                }
            }
        }
        let Self { model, learning_rate, totals, .. } = self;
        Ok(Passed { model, learning_rate, totals })
    }

    /// Gradient, optimizer step and learning rate of one minibatch; an error names the non-finite
    /// value.
    fn minibatch(
        &mut self,
        epoch: &Epoch,
        minibatch: &Minibatch,
        turn: usize,
    ) -> Result<Next, &'static str> {
        let settings = self.shared.passes.settings;
        let samples = epoch.samples(minibatch);
        let lanes = parts(samples.len(), LANE_ROWS);
        self.gradients(samples, &lanes, minibatch, turn);
        self.shared.barrier.wait();
        let mut sums = LossSums::default();
        for lane in &self.shared.lanes[..lanes.len()] {
            sums.add(&read(lane).sums);
        }
        let divergence = sums.divergence / samples.len() as f64;
        // Every thread has the same sums and therefore makes the same decision.
        if settings.kl_stop.is_some_and(|limit| KL_STOP_FACTOR * f64::from(limit) < divergence) {
            return Ok(Next::End);
        }
        self.add_lanes(lanes.len(), turn);
        self.shared.barrier.wait();
        let slopes =
            sums.log_deviation_slopes.map(|slope| slope - f64::from(settings.entropy_coef));
        let norm = self.take_gradient(&slopes);
        if !norm.is_finite() {
            return Err("the gradient");
        }
        let scale = clip_scale(norm, settings.max_gradient_norm);
        self.note(samples.len(), &sums, norm, scale);
        self.model.update(&slopes, (self.learning_rate, scale), settings);
        self.learning_rate = adapted(self.learning_rate, settings.schedule, divergence);
        Ok(Next::Minibatch)
    }

    /// Process lanes until none is left.
    fn gradients(
        &mut self,
        samples: &[u32],
        lanes: &[Range<usize>],
        minibatch: &Minibatch,
        turn: usize,
    ) {
        let Passes { settings, old, imitation_coef, .. } = *self.shared.passes;
        let terms = LossTerms {
            advantage_mean: minibatch.advantage_mean,
            advantage_scale: minibatch.advantage_scale,
            imitation_coef,
            weight: (samples.len() as f32).recip(),
            ..LossTerms::new(settings, self.model.gaussian(), old)
        };
        let next = &self.shared.next[turn % 2];
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(range) = lanes.get(number) else { break };
            let mut lane = write(&self.shared.lanes[number]);
            self.lane(&mut lane, &samples[range.clone()], &terms);
        }
    }

    fn lane(&mut self, lane: &mut Lane, samples: &[u32], terms: &LossTerms) {
        let batch = self.shared.passes.batch;
        lane.gradient.fill(0.0);
        lane.sums = LossSums::default();
        for tile in parts(samples.len(), TILE_ROWS) {
            let samples = samples[tile].iter().copied();
            let x = &mut self.scratch.policy.x;
            x.clear();
            samples.clone().for_each(|entry| batch.observe(entry, x));
            let samples = samples.map(|entry| batch.sample(entry));
            let target = (lane.gradient.as_mut_slice(), &mut lane.sums);
            self.model.accumulate(terms, samples, target, &mut self.scratch);
        }
    }

    /// Sum this thread's blocks over the lanes, in the order of the lanes.
    fn add_lanes(&self, lanes: usize, turn: usize) {
        // No thread takes lanes now, and all have left the counter of the next minibatch.
        self.shared.next[(turn + 1) % 2].store(0, Ordering::Relaxed);
        let lanes: Vec<_> = self.shared.lanes[..lanes].iter().map(read).collect();
        let ranges = blocks(self.model.parameter_count());
        let blocks = ranges.zip(&self.shared.blocks).skip(self.index);
        for (range, block) in blocks.step_by(self.shared.passes.threads) {
            let mut block = write(block);
            let (first, others) = lanes.split_first().expect("a minibatch has samples");
            block.values.copy_from_slice(&first.gradient[range.clone()]);
            for lane in others {
                let added = &lane.gradient[range.clone()];
                block.values.iter_mut().zip(added).for_each(|(sum, value)| *sum += value);
            }
            block.squares = squares(&block.values);
        }
    }

    /// Copy the blocks into the model's gradient; returns the norm of the whole gradient.
    fn take_gradient(&mut self, slopes: &[f64; MAX_OUTPUTS]) -> f64 {
        let actions = self.model.gaussian().actions();
        let mut squares: f64 = slopes[..actions].iter().map(|slope| slope * slope).sum();
        let [mut policy, mut critic] = self.model.gradients_mut();
        for block in &self.shared.blocks {
            let block = read(block);
            let (first, second) = block.values.split_at(policy.len().min(block.values.len()));
            let (place, rest) = policy.split_at_mut(first.len());
            place.copy_from_slice(first);
            policy = rest;
            let (place, rest) = critic.split_at_mut(second.len());
            place.copy_from_slice(second);
            critic = rest;
            squares += block.squares;
        }
        squares.sqrt()
    }

    fn note(&mut self, samples: usize, sums: &LossSums, norm: f64, scale: f32) {
        self.totals.minibatches += 1;
        self.totals.samples += samples;
        self.totals.sums.add(sums);
        self.totals.entropy += f64::from(self.model.gaussian().entropy());
        self.totals.gradient_norm += norm;
        self.totals.shortened += usize::from(scale < 1.0);
    }
}

/// Sum of squares: single precision in 64 columns, which suits vector units, then double.
fn squares(values: &[f32]) -> f64 {
    const COLUMNS: usize = 64;
    let mut sums = [0.0f32; COLUMNS];
    let (rows, rest) = values.as_chunks::<COLUMNS>();
    for row in rows {
        for (sum, value) in sums.iter_mut().zip(row) {
            *sum += value * value;
        }
    }
    sums.iter()
        .chain(rest.iter().map(|value| value * value).collect::<Vec<_>>().iter())
        .map(|sum| f64::from(*sum))
        .sum()
}

fn adapted(learning_rate: f32, schedule: Schedule, divergence: f64) -> f32 {
    let Schedule::AdaptiveKl { target } = schedule else { return learning_rate };
    let target = f64::from(target);
    if 2.0 * target < divergence {
        (learning_rate / RATE_FACTOR).max(RATE_BOUNDS[0])
    } else if divergence < 0.5 * target {
        (learning_rate * RATE_FACTOR).min(RATE_BOUNDS[1])
    } else {
        learning_rate
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_follows_the_divergence_within_its_bounds() {
        let schedule = Schedule::AdaptiveKl { target: 0.01 };
        for (rate, divergence, expected) in [
            (3e-4, 0.021, 2e-4),
            (3e-4, 0.019, 3e-4),
            (3e-4, 0.006, 3e-4),
            (3e-4, 0.004, 4.5e-4),
            (1e-2, 0.0, 1e-2),
            (1e-6, 1.0, 1e-6),
        ] {
            let found = adapted(rate, schedule, divergence);
            assert!((found - expected).abs() < 1e-9, "{rate} {divergence}: {found}");
        }
        assert_eq!(adapted(3e-4, Schedule::Fixed, 1.0).to_bits(), 3e-4f32.to_bits());
    }

    #[test]
    fn squares_are_summed_over_all_columns_and_the_rest() {
        let values: Vec<f32> = (0..130).map(|i| i as f32).collect();
        // Sum of squares up to n: n (n + 1) (2 n + 1) / 6.
        assert!((squares(&values) - f64::from(129 * 130 * 259 / 6)).abs() < 1e-6);
        assert!(squares(&[0.0, f32::NAN]).is_nan());
    }
}
