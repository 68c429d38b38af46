//! Rollout buffer: observations, actions and rewards of many environments over several steps.

use super::Spaces;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// End of a step in one environment.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum End {
    /// The episode continues.
    #[default]
    Running,
    /// The episode reached a terminal state: the value after it is 0.
    Terminal,
    /// The episode was truncated by its time limit: the value of its last observation is
    /// bootstrapped, which the caller puts into [`RolloutStep::final_values`].
    Truncated,
}

/// Numbers of steps and environments, with their spaces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RolloutShape {
    /// Number of steps per environment, at least 1.
    pub horizon: usize,
    /// Number of environments, at least 1.
    pub environments: usize,
    /// Widths of observation and action.
    pub spaces: Spaces,
}

impl RolloutShape {
    /// Number of samples: steps times environments.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.horizon * self.environments
    }
}

/// Buffer of one update, `[horizon][environment]` and, where it applies, `[width]`; allocated once
/// and refilled for each update.
#[derive(Debug, Clone)]
pub struct Rollout {
    pub(super) shape: RolloutShape,
    pub(super) observations: Vec<f32>,
    pub(super) actions: Vec<f32>,
    pub(super) means: Vec<f32>,
    pub(super) log_probabilities: Vec<f32>,
    pub(super) values: Vec<f32>,
    pub(super) rewards: Vec<f32>,
    pub(super) ends: Vec<End>,
    pub(super) final_values: Vec<f32>,
    pub(super) demonstrations: Vec<f32>,
}

/// One step of a range of environments, `[environment]` or `[environment][width]`.
#[derive(Debug)]
pub struct RolloutStep<'a> {
    /// Observations before the step; written by the caller before
    /// [`Learner::act`](super::Learner::act).
    pub observations: &'a mut [f32],
    /// Sampled, unclipped actions; written by `act`. The caller's environment clips its own copy.
    pub actions: &'a mut [f32],
    /// Mean actions; written by `act`.
    pub means: &'a mut [f32],
    /// Log density of the actions (nat); written by `act`.
    pub log_probabilities: &'a mut [f32],
    /// Value of the observations, in units of reward; written by `act`.
    pub values: &'a mut [f32],
    /// Reward of the step; written by the caller.
    pub rewards: &'a mut [f32],
    /// End of the step; written by the caller in every step.
    pub ends: &'a mut [End],
    /// Value of the last observation of an episode that was truncated in this step; written by the
    /// caller, from [`Learner::values`](super::Learner::values). Read only there.
    pub final_values: &'a mut [f32],
    /// Actions of the demonstrator for the observations; written by the caller and read only while
    /// [`Learner::imitates`](super::Learner::imitates).
    pub demonstrations: &'a mut [f32],
}

/// All steps of a range of environments, for one thread.
#[derive(Debug)]
pub struct RolloutPart<'a> {
    /// Index of the first environment of the range.
    pub first_environment: usize,
    /// Steps, `[horizon]`.
    pub steps: Vec<RolloutStep<'a>>,
}

impl Rollout {
    /// Empty buffer.
    #[must_use]
    pub fn new(shape: RolloutShape) -> Self {
        let samples = shape.samples();
        Self {
            shape,
            observations: vec![0.0; samples * shape.spaces.observations],
            actions: vec![0.0; samples * shape.spaces.actions],
            means: vec![0.0; samples * shape.spaces.actions],
            log_probabilities: vec![0.0; samples],
            values: vec![0.0; samples],
            rewards: vec![0.0; samples],
            ends: vec![End::Running; samples],
            final_values: vec![0.0; samples],
            demonstrations: vec![0.0; samples * shape.spaces.actions],
        }
    }

    /// Numbers of steps and environments.
    #[must_use]
    pub fn shape(&self) -> RolloutShape {
        self.shape
    }

    /// Rewards, `[horizon][environment]`.
    #[must_use]
    pub fn rewards(&self) -> &[f32] {
        &self.rewards
    }

    /// End of each step, `[horizon][environment]`.
    #[must_use]
    pub fn ends(&self) -> &[End] {
        &self.ends
    }

    /// The buffer as one part.
    pub fn whole(&mut self) -> RolloutPart<'_> {
        let environments = self.shape.environments;
        self.split(std::slice::from_ref(&(0..environments))).remove(0)
    }

    /// Split the buffer into parts of contiguous environments, one per thread.
    ///
    /// # Panics
    /// When `ranges` do not cover all environments in order.
    pub fn split(&mut self, ranges: &[Range<usize>]) -> Vec<RolloutPart<'_>> {
        let mut end = 0;
        for range in ranges {
            assert!(range.start == end && range.start <= range.end, "{ranges:?} in order");
            end = range.end;
        }
        assert!(end == self.shape.environments, "{ranges:?} cover every environment");
        let mut parts: Vec<RolloutPart<'_>> = ranges
            .iter()
            .map(|range| RolloutPart { first_environment: range.start, steps: Vec::new() })
            .collect();
        let spaces = self.shape.spaces;
        for mut rest in self.steps() {
            for (part, range) in parts.iter_mut().zip(ranges) {
                let (taken, left) = rest.split_at(range.len(), spaces);
                part.steps.push(taken);
                rest = left;
            }
        }
        parts
    }

    /// The steps, each with all environments.
    fn steps(&mut self) -> impl Iterator<Item = RolloutStep<'_>> {
        let RolloutShape { environments, spaces, .. } = self.shape;
        let observations = self.observations.chunks_exact_mut(environments * spaces.observations);
        let actions = self.actions.chunks_exact_mut(environments * spaces.actions);
        let means = self.means.chunks_exact_mut(environments * spaces.actions);
        let log_probabilities = self.log_probabilities.chunks_exact_mut(environments);
        let values = self.values.chunks_exact_mut(environments);
        let rewards = self.rewards.chunks_exact_mut(environments);
        let ends = self.ends.chunks_exact_mut(environments);
        let final_values = self.final_values.chunks_exact_mut(environments);
        let demonstrations = self.demonstrations.chunks_exact_mut(environments * spaces.actions);
        let policy = observations.zip(actions).zip(means).zip(log_probabilities).zip(values);
        policy.zip(rewards.zip(ends).zip(final_values.zip(demonstrations))).map(
            |(policy, ((rewards, ends), (final_values, demonstrations)))| {
                let ((((observations, actions), means), log_probabilities), values) = policy;
                RolloutStep {
                    observations,
                    actions,
                    means,
                    log_probabilities,
                    values,
                    rewards,
                    ends,
                    final_values,
                    demonstrations,
                }
            },
        )
    }
}

impl<'a> RolloutStep<'a> {
    /// Split into the first `count` environments and the others.
    fn split_at(self, count: usize, spaces: Spaces) -> (Self, Self) {
        let (observations, observations_left) =
            self.observations.split_at_mut(count * spaces.observations);
        let (actions, actions_left) = self.actions.split_at_mut(count * spaces.actions);
        let (means, means_left) = self.means.split_at_mut(count * spaces.actions);
        let (log_probabilities, log_left) = self.log_probabilities.split_at_mut(count);
        let (values, values_left) = self.values.split_at_mut(count);
        let (rewards, rewards_left) = self.rewards.split_at_mut(count);
        let (ends, ends_left) = self.ends.split_at_mut(count);
        let (final_values, final_left) = self.final_values.split_at_mut(count);
        let (demonstrations, demonstrations_left) =
            self.demonstrations.split_at_mut(count * spaces.actions);
        let first = Self {
            observations,
            actions,
            means,
            log_probabilities,
            values,
            rewards,
            ends,
            final_values,
            demonstrations,
        };
        let left = RolloutStep {
            observations: observations_left,
            actions: actions_left,
            means: means_left,
            log_probabilities: log_left,
            values: values_left,
            rewards: rewards_left,
            ends: ends_left,
            final_values: final_left,
            demonstrations: demonstrations_left,
        };
        (first, left)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_the_columns_of_their_environments() {
        let spaces = Spaces { observations: 2, actions: 1 };
        let mut rollout = Rollout::new(RolloutShape { horizon: 3, environments: 5, spaces });
        for part in rollout.split(&[0..2, 2..2, 2..5]) {
            for (number, step) in part.steps.into_iter().enumerate() {
                for (row, reward) in step.rewards.iter_mut().enumerate() {
                    *reward = (10 * number + part.first_environment + row) as f32;
                    step.observations[2 * row + 1] = *reward;
                }
            }
        }
        let expected: Vec<f32> =
            (0..3).flat_map(|step| (0..5).map(move |env| (10 * step + env) as f32)).collect();
        assert_eq!(rollout.rewards(), expected);
        let seconds: Vec<f32> = rollout.observations.iter().skip(1).step_by(2).copied().collect();
        assert_eq!(seconds, expected);
        assert_eq!(rollout.whole().steps.len(), 3);
    }

    #[test]
    #[should_panic(expected = "cover every environment")]
    fn a_forgotten_environment_is_an_error() {
        let spaces = Spaces { observations: 1, actions: 1 };
        Rollout::new(RolloutShape { horizon: 1, environments: 3, spaces }).split(&[0..1, 1..2]);
    }
}
