//! Samples of an update as records, and the order in which minibatches use them.
//!
//! A minibatch accesses samples at random. All values of one sample are stored together, so that an
//! access touches two or three cache lines instead of one in each of eight arrays.

use super::{
    AdvantageNormalization, End, Moments, PpoError, PpoSettings, Rollout, RolloutShape,
    loss::Sample,
    reflection::{
        MOST_SAMPLES, Reflection, StandardReflection, index_of, is_reflected, reflect_half,
    },
    workers::for_each,
};
use crate::{
    nn::{MAX_OUTPUTS, Standardizer},
    seed::Stream,
};
use std::{num::NonZeroUsize, ops::Range};

/// Added to the standard deviation of advantages, as in CleanRL and rl_games.
const ADVANTAGE_EPSILON: f64 = 1e-8;

/// Samples `[samples][stride]`: standardised observation, action, mean, log-probability, advantage,
/// target and old value in the critic's unit, and the demonstrated action where there is one.
#[derive(Debug, Clone, Default)]
pub(super) struct Batch {
    values: Vec<f32>,
    observations: usize,
    actions: usize,
    /// Length of a demonstrated action; 0 without demonstrations.
    demonstrated: usize,
    /// Reflection of marked samples; without one no sample is marked.
    reflection: StandardReflection,
}

/// Signs of the actions of a sample that is not reflected.
const UNREFLECTED: [f32; MAX_OUTPUTS] = [1.0; MAX_OUTPUTS];

/// Advantages and targets of a rollout, and the normalizations of the networks' inputs and values.
pub(super) struct Units<'a> {
    pub(super) advantages: &'a [f32],
    pub(super) targets: &'a [f32],
    pub(super) observations: &'a Standardizer,
    pub(super) values: &'a Standardizer,
    pub(super) reflection: Option<&'a Reflection>,
    /// Whether the rollout has demonstrations.
    pub(super) is_demonstrated: bool,
}

/// One step of the rollout, processed by one thread.
struct Piece<'a> {
    step: usize,
    records: &'a mut [f32],
    observed: &'a mut Result<Moments, PpoError>,
}

impl Batch {
    fn stride(&self) -> usize {
        self.observations + 2 * self.actions + 4 + self.demonstrated
    }

    /// Append the standardised observation of an entry of an epoch to `out`.
    #[inline]
    pub(super) fn observe(&self, entry: u32, out: &mut Vec<f32>) {
        let observation = &self.values[index_of(entry) * self.stride()..][..self.observations];
        if is_reflected(entry) {
            self.reflection.observe(observation, out);
        } else {
            out.extend_from_slice(observation);
        }
    }

    /// All other values of an entry of an epoch.
    #[inline]
    pub(super) fn sample(&self, entry: u32) -> Sample {
        let (stride, index) = (self.stride(), index_of(entry));
        let signs = if is_reflected(entry) { self.reflection.actions() } else { &UNREFLECTED };
        let record = &self.values[index * stride..][self.observations..stride];
        let (actions, record) = record.split_at(self.actions);
        let (old_means, record) = record.split_at(self.actions);
        let signed = |values: &[f32]| {
            let mut signed = *signs;
            signed.iter_mut().zip(values).for_each(|(sign, value)| *sign *= value);
            signed
        };
        Sample {
            actions: signed(actions),
            old_means: signed(old_means),
            old_log_probability: record[0],
            advantage: record[1],
            target: record[2],
            old_value: record[3],
            demonstration: (0 < self.demonstrated).then(|| signed(&record[4..])),
        }
    }

    /// Fill the batch from a rollout and return the moments of its observations. Non-finite numbers
    /// are an error.
    pub(super) fn fill(
        &mut self,
        rollout: &Rollout,
        units: &Units<'_>,
        (threads, update): (NonZeroUsize, u64),
    ) -> Result<Moments, PpoError> {
        let RolloutShape { horizon, environments, spaces } = rollout.shape;
        (self.observations, self.actions) = (spaces.observations, spaces.actions);
        self.demonstrated = if units.is_demonstrated { spaces.actions } else { 0 };
        let reflect = |own| StandardReflection::new(own, units.observations);
        self.reflection = units.reflection.map(reflect).unwrap_or_default();
        let stride = self.stride();
        self.values.resize(rollout.shape.samples() * stride, 0.0);
        let mut observed = vec![Ok(Moments::new(0)); horizon];
        let records = self.values.chunks_exact_mut(environments * stride);
        let pieces = records.zip(&mut observed).enumerate();
        let pieces = pieces.map(|(step, (records, observed))| Piece { step, records, observed });
        for_each(threads, pieces.collect(), |piece: Piece<'_>| {
            *piece.observed = check_step(rollout, piece.step, update).map(|()| {
                fill_step(rollout, units, piece.step, piece.records);
                Moments::of_rows(
                    step_of(&rollout.observations, rollout, piece.step),
                    spaces.observations,
                )
            });
        });
        let mut all = Moments::new(spaces.observations);
        for moments in observed {
            all.merge(&moments?);
        }
        Ok(all)
    }
}

/// Values of one step.
fn step_of<'a>(values: &'a [f32], rollout: &Rollout, step: usize) -> &'a [f32] {
    let size = values.len() / rollout.shape.horizon;
    &values[step * size..(step + 1) * size]
}

fn check_step(rollout: &Rollout, step: usize, update: u64) -> Result<(), PpoError> {
    let environments = rollout.shape.environments;
    let check = |what, values| check_finite(what, values, (update, step, environments));
    check("an observation", step_of(&rollout.observations, rollout, step))?;
    check("an action", step_of(&rollout.actions, rollout, step))?;
    check("the mean of an action", step_of(&rollout.means, rollout, step))?;
    check("a log-probability", step_of(&rollout.log_probabilities, rollout, step))?;
    check("the reward", step_of(&rollout.rewards, rollout, step))?;
    check("a demonstrated action", step_of(&rollout.demonstrations, rollout, step))?;
    check("the value", step_of(&rollout.values, rollout, step))?;
    let finals = step_of(&rollout.final_values, rollout, step);
    let ends = &rollout.ends[step * environments..];
    let cut_off = |place: &usize| ends[*place] == End::Truncated && !finals[*place].is_finite();
    match (0..environments).find(cut_off) {
        None => Ok(()),
        Some(environment) => {
            Err(PpoError::NonFiniteInput { update, what: "a final value", step, environment })
        }
    }
}

/// Check that all of `values`, those of all environments, are finite.
pub(super) fn check_finite(
    what: &'static str,
    values: &[f32],
    (update, step, environments): (u64, usize, usize),
) -> Result<(), PpoError> {
    match values.iter().position(|value| !value.is_finite()) {
        None => Ok(()),
        Some(place) => {
            let environment = place * environments / values.len();
            Err(PpoError::NonFiniteInput { update, what, step, environment })
        }
    }
}

fn fill_step(rollout: &Rollout, units: &Units<'_>, step: usize, records: &mut [f32]) {
    let RolloutShape { environments, spaces, .. } = rollout.shape;
    let observations = step_of(&rollout.observations, rollout, step);
    let actions = step_of(&rollout.actions, rollout, step);
    let means = step_of(&rollout.means, rollout, step);
    let demonstrations = step_of(&rollout.demonstrations, rollout, step);
    let records = records.chunks_exact_mut(records.len() / environments);
    for (environment, record) in records.enumerate() {
        let index = step * environments + environment;
        let row = environment * spaces.observations..(environment + 1) * spaces.observations;
        let (observation, record) = record.split_at_mut(spaces.observations);
        units.observations.apply(&observations[row], observation);
        let row = environment * spaces.actions..(environment + 1) * spaces.actions;
        let (action, record) = record.split_at_mut(spaces.actions);
        action.copy_from_slice(&actions[row.clone()]);
        let (mean, record) = record.split_at_mut(spaces.actions);
        mean.copy_from_slice(&means[row.clone()]);
        if units.is_demonstrated {
            record[4..].copy_from_slice(&demonstrations[row]);
        }
        record[0] = rollout.log_probabilities[index];
        record[1] = units.advantages[index];
        units.values.apply(&[units.targets[index]], &mut record[2..3]);
        units.values.apply(&[rollout.values[index]], &mut record[3..4]);
    }
}

/// Split `total` into parts that differ by at most one and are not above `largest`.
pub(super) fn parts(total: usize, largest: usize) -> Vec<Range<usize>> {
    let count = total.div_ceil(largest);
    (0..count).map(|i| i * total / count..(i + 1) * total / count).collect()
}

/// One epoch: a pass over all samples.
#[derive(Debug, Clone, Default)]
pub(super) struct Epoch {
    order: Vec<u32>,
    pub(super) minibatches: Vec<Minibatch>,
}

/// One minibatch of an epoch.
#[derive(Debug, Clone)]
pub(super) struct Minibatch {
    range: Range<usize>,
    /// Mean that is subtracted from its advantages.
    pub(super) advantage_mean: f32,
    /// Factor that its advantages are multiplied by.
    pub(super) advantage_scale: f32,
}

impl Epoch {
    /// Indices of the samples of a minibatch.
    pub(super) fn samples(&self, minibatch: &Minibatch) -> &[u32] {
        &self.order[minibatch.range.clone()]
    }
}

/// All epochs of an update; each is shuffled by its own random stream, so that they can be built in
/// any order.
pub(super) fn epochs(
    settings: &PpoSettings,
    advantages: &[f32],
    (seed, update, reflected): (u64, u64, bool),
    threads: NonZeroUsize,
) -> Vec<Epoch> {
    debug_assert!(advantages.len() <= MOST_SAMPLES, "an index leaves room for its mark");
    let over_all = scaling(advantages.iter().copied());
    let mut epochs = vec![Epoch::default(); settings.epochs];
    for_each(threads, epochs.iter_mut().enumerate().collect(), |(number, epoch)| {
        let mut order: Vec<u32> = (0..advantages.len() as u32).collect();
        Stream::new(seed, &format!("minibatches {update} {number}")).shuffle(&mut order);
        if reflected {
            reflect_half(&mut order);
        }
        epoch.minibatches = parts(order.len(), settings.minibatch)
            .into_iter()
            .map(|range| {
                let own = order[range.clone()].iter().map(|index| advantages[index_of(*index)]);
                let (advantage_mean, advantage_scale) = match settings.advantages {
                    AdvantageNormalization::Off => (0.0, 1.0),
                    AdvantageNormalization::Batch => over_all,
                    AdvantageNormalization::Minibatch => scaling(own),
                };
                Minibatch { range, advantage_mean, advantage_scale }
            })
            .collect();
        epoch.order = order;
    });
    epochs
}

/// Mean, and inverse sample standard deviation (with `n - 1`); a single advantage is not changed.
fn scaling(advantages: impl Iterator<Item = f32> + Clone) -> (f32, f32) {
    let count = advantages.clone().count() as f64;
    if count < 2.0 {
        return (0.0, 1.0);
    }
    let mean = advantages.clone().map(f64::from).sum::<f64>() / count;
    let squares: f64 = advantages.map(|advantage| (f64::from(advantage) - mean).powi(2)).sum();
    let deviation = (squares / (count - 1.0)).sqrt();
    (mean as f32, (deviation + ADVANTAGE_EPSILON).recip() as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_even_and_complete() {
        assert_eq!(parts(5000, 4096), [0..2500, 2500..5000]);
        assert_eq!(parts(8192, 4096), [0..4096, 4096..8192]);
        assert_eq!(parts(7, 3), [0..2, 2..4, 4..7]);
        assert_eq!(parts(2, 1), [0..1, 1..2]);
    }

    #[test]
    fn every_epoch_visits_every_sample_once_in_its_own_order() {
        let settings = PpoSettings { epochs: 3, minibatch: 40, ..PpoSettings::paper() };
        let advantages: Vec<f32> = (0..100).map(|i| (i * i) as f32).collect();
        let make = |update, threads| {
            epochs(&settings, &advantages, (9, update, false), NonZeroUsize::new(threads).unwrap())
        };
        let found = make(4, 1);
        assert_eq!(found.len(), 3);
        for epoch in &found {
            let mut visited: Vec<u32> =
                epoch.minibatches.iter().flat_map(|m| epoch.samples(m).to_vec()).collect();
            visited.sort_unstable();
            assert_eq!(visited, (0..100).collect::<Vec<_>>());
        }
        assert_ne!(found[0].order, found[1].order);
        assert_ne!(found[0].order, make(5, 1)[0].order);
        assert_eq!(found[2].order, make(4, 3)[2].order);
    }

    #[test]
    fn advantages_are_normalised_over_what_the_setting_says() {
        let advantages = [1.0, 2.0, 3.0, 10.0, 20.0, 30.0];
        for (kind, mean_of_first) in [
            (AdvantageNormalization::Off, 0.0),
            (AdvantageNormalization::Batch, 11.0),
            (AdvantageNormalization::Minibatch, f32::NAN),
        ] {
            let settings =
                PpoSettings { epochs: 1, minibatch: 3, advantages: kind, ..PpoSettings::paper() };
            let epoch = &epochs(&settings, &advantages, (1, 1, false), NonZeroUsize::MIN)[0];
            for minibatch in &epoch.minibatches {
                let own: Vec<f32> =
                    epoch.samples(minibatch).iter().map(|i| advantages[*i as usize]).collect();
                let expected = match kind {
                    AdvantageNormalization::Minibatch => own.iter().sum::<f32>() / 3.0,
                    _ => mean_of_first,
                };
                assert!((minibatch.advantage_mean - expected).abs() < 1e-5, "{kind:?}");
            }
        }
        // 1, 2, 3: mean 2, deviation 1 with n - 1.
        let (mean, scale) = scaling([1.0, 2.0, 3.0].into_iter());
        assert!((mean - 2.0).abs() < 1e-6 && (scale - 1.0).abs() < 1e-6);
        // Equal advantages are not scaled to infinity.
        assert!(scaling([5.0; 4].into_iter()).1.is_finite());
    }
}
