//! The PPO learner: acting, learning, storing.

use super::{
    Advantages, Gaussian, Moments, NetworkLayout, PpoError, PpoSettings, Rollout, RolloutStep,
    Schedule, Scratch, Spaces,
    batch::{Batch, Units, check_finite, epochs},
    error::expect_size,
    model::Model,
    noise::Noise,
    policy::Policy,
    reflection::Reflection,
    state::LearnerState,
    update::{Passed, Passes, Totals},
};
use crate::nn::Standardizer;
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;

/// Maximum number of rows that are evaluated by the networks at once.
const ACT_ROWS: usize = 128;

/// Networks in training with the optimizer and normalization states.
#[derive(Debug, Clone)]
pub struct Learner {
    settings: PpoSettings,
    spaces: Spaces,
    seed: u64,
    model: Model,
    /// Moments of all observations used for learning.
    observed: Moments,
    /// Moments of all value targets used for learning, one column.
    targets: Moments,
    observations: Standardizer,
    values: Standardizer,
    learning_rate: f32,
    updates: u64,
    noise: Noise,
    /// Reflection under which the task is symmetric.
    reflection: Option<Reflection>,
    /// Buffer reused between updates.
    advantages: Advantages,
    batch: Batch,
}

/// Key of a batch of decisions; its exploration noise depends on nothing else.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepIndex {
    /// Index of the control step since training began; each is used once.
    pub step: u64,
    /// Index of the first environment of the batch.
    pub first_environment: usize,
}

/// Metrics of an update. Losses and norms are means over its minibatches.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UpdateReport {
    /// Index of the update, from 1.
    pub update: u64,
    /// Number of samples in the rollout.
    pub samples: usize,
    /// Negative clipped surrogate objective.
    pub policy_loss: f64,
    /// Half the squared error of the value, clipped where the settings say so.
    pub value_loss: f64,
    /// Bounds loss, without its coefficient.
    pub bounds_loss: f64,
    /// Entropy of the policy (nat).
    pub entropy: f64,
    /// KL divergence from the policy that acted (nat).
    pub kl: f64,
    /// Fraction of samples with a ratio outside the clip range, 0 to 1.
    pub clip_fraction: f64,
    /// Norm of the whole gradient before clipping.
    pub gradient_norm: f64,
    /// Fraction of minibatches with a clipped gradient, 0 to 1.
    pub shortened_fraction: f64,
    /// Explained variance of the value targets by the values of the rollout, at most 1.
    pub explained_variance: f64,
    /// Learning rate at the end of the update.
    pub learning_rate: f32,
    /// Number of epochs begun; fewer than in the settings after early stopping by KL.
    pub epochs: usize,
    /// Number of optimizer steps.
    pub minibatches: usize,
}

impl Learner {
    /// Build a learner with new networks. Equal arguments give equal bytes.
    ///
    /// # Errors
    /// [`PpoError::Setting`] when a setting is outside its range.
    pub fn new(settings: &PpoSettings, spaces: Spaces, seed: u64) -> Result<Self, PpoError> {
        settings.check(spaces)?;
        let model = Model::new(settings, spaces, seed);
        let (observed, targets) = (Moments::new(spaces.observations), Moments::new(1));
        let learner = Self {
            spaces,
            seed,
            model,
            observations: observed.standardizer(settings.observations),
            values: targets.standardizer(settings.values),
            observed,
            targets,
            learning_rate: settings.learning_rate,
            updates: 0,
            noise: Noise::new(seed, "actions"),
            reflection: None,
            advantages: Advantages::default(),
            batch: Batch::default(),
            settings: settings.clone(),
        };
        Ok(learner)
    }

    /// Learn from mirrored experience too: the task is symmetric under `reflection`.
    ///
    /// # Panics
    /// When the reflection has other widths than the learner.
    #[must_use]
    pub fn with_reflection(self, reflection: Reflection) -> Self {
        let found = (reflection.observations.len(), reflection.actions.len());
        let expected = (self.spaces.observations, self.spaces.actions);
        assert!(found == expected, "a reflection of {expected:?} values, not of {found:?}");
        Self { reflection: Some(reflection), ..self }
    }

    /// Resume from a state, with the bytes of uninterrupted training.
    ///
    /// # Errors
    /// [`PpoError::Setting`] as in [`new`](Self::new), and [`PpoError::State`] when the state's
    /// networks have other shapes than the settings give.
    pub fn resume(
        settings: &PpoSettings,
        spaces: Spaces,
        state: &LearnerState,
    ) -> Result<Self, PpoError> {
        let fresh = Self::new(settings, spaces, state.seed)?;
        state.check_fits(&fresh.state())?;
        let networks = (&state.policy, state.critic.as_ref());
        Ok(Self {
            model: Model::resume(settings, networks, &state.deviations),
            observations: state.observed.standardizer(settings.observations),
            values: state.targets.standardizer(settings.values),
            observed: state.observed.clone(),
            targets: state.targets.clone(),
            learning_rate: state.learning_rate,
            updates: state.updates,
            ..fresh
        })
    }

    /// Complete state for resuming.
    #[must_use]
    pub fn state(&self) -> LearnerState {
        let (policy, critic, deviations) = self.model.parts();
        LearnerState {
            seed: self.seed,
            updates: self.updates,
            learning_rate: self.learning_rate,
            policy,
            critic,
            deviations,
            observed: self.observed.clone(),
            targets: self.targets.clone(),
        }
    }

    /// Settings of the learner.
    #[must_use]
    pub fn settings(&self) -> &PpoSettings {
        &self.settings
    }

    /// Number of updates so far.
    #[must_use]
    pub fn updates(&self) -> u64 {
        self.updates
    }

    /// Copy of the current policy, for opponents, evaluation and export.
    #[must_use]
    pub fn policy(&self) -> Policy {
        let mut network = self.model.policy().stack().network();
        if let (NetworkLayout::Shared, Some(last)) =
            (self.settings.layout, network.layers.last_mut())
        {
            last.outputs = self.spaces.actions;
            last.weight.truncate(last.outputs * last.inputs);
            last.bias.truncate(last.outputs);
        }
        Policy::new(network, self.observations.clone(), self.model.gaussian())
    }

    /// Add `observations`, `[rows][width]`, to the running moments without learning from them. Used
    /// with random play before the first update, so that it does not use unnormalized observations.
    ///
    /// # Errors
    /// [`PpoError::Size`] when the length is not a whole number of rows,
    /// [`PpoError::NonFiniteInput`] when a value is not finite.
    pub fn observe(&mut self, observations: &[f32]) -> Result<(), PpoError> {
        let width = self.spaces.observations;
        expect_size("numbers beyond whole observations", observations.len() % width, 0)?;
        let place = (self.updates + 1, 0, observations.len() / width);
        check_finite("an observation", observations, place)?;
        self.observed.merge(&Moments::of_rows(observations, width));
        self.observations = self.observed.standardizer(self.settings.observations);
        Ok(())
    }

    /// Decide for one step of a range of environments: reads `step.observations`; writes actions,
    /// means, log-probabilities and values. Depends only on the learner, the observations and the
    /// key, so ranges can be divided over threads in any way.
    pub fn act(&self, place: StepIndex, step: &mut RolloutStep<'_>, scratch: &mut Scratch) {
        let Spaces { observations: width, actions } = self.spaces;
        let noise = self.noise.at(place.step);
        let gaussian = self.model.gaussian();
        let rows = step.values.len();
        for first in (0..rows).step_by(ACT_ROWS) {
            let end = rows.min(first + ACT_ROWS);
            self.load(&step.observations[first * width..end * width], scratch);
            self.model.forward(scratch);
            for (row, value) in (first..end).zip(self.model.values(scratch)) {
                step.values[row] = self.values.invert(0, value);
            }
            for (row, mean) in (first..end).zip(self.model.means(scratch)) {
                let range = row * actions..(row + 1) * actions;
                step.means[range.clone()].copy_from_slice(mean);
                let action = &mut step.actions[range];
                noise.act(place.first_environment + row, &gaussian, mean, action);
                step.log_probabilities[row] = gaussian.log_probability(action, mean);
            }
        }
    }

    /// Write the values of `observations`, `[rows][width]`, into `values`, `[rows]`, in units of
    /// reward.
    pub fn values(&self, observations: &[f32], values: &mut [f32], scratch: &mut Scratch) {
        let rows = observations.chunks(ACT_ROWS * self.spaces.observations);
        for (observations, values) in rows.zip(values.chunks_mut(ACT_ROWS)) {
            self.load(observations, scratch);
            self.model.forward_values(scratch);
            for (place, value) in values.iter_mut().zip(self.model.values(scratch)) {
                *place = self.values.invert(0, value);
            }
        }
    }

    fn load(&self, observations: &[f32], scratch: &mut Scratch) {
        let x = &mut scratch.policy.x;
        x.resize(observations.len(), 0.0);
        self.observations.apply(observations, x);
    }

    /// Learn from a full rollout. `last_values`, `[environment]`, are the values of the
    /// observations after its last step. The result does not depend on the number of threads.
    ///
    /// Observation moments are updated at the end: observations are normalized equally when acting
    /// and when learning from them.
    ///
    /// # Errors
    /// [`PpoError::Size`] when the rollout has other spaces, [`PpoError::NonFiniteInput`] and
    /// [`PpoError::NonFiniteLearning`] for a non-finite number. The learner is then unchanged.
    pub fn learn(
        &mut self,
        rollout: &Rollout,
        last_values: &[f32],
        threads: NonZeroUsize,
    ) -> Result<UpdateReport, PpoError> {
        let shape = rollout.shape();
        expect_size(
            "numbers in an observation",
            shape.spaces.observations,
            self.spaces.observations,
        )?;
        expect_size("numbers in an action", shape.spaces.actions, self.spaces.actions)?;
        expect_size("last values", last_values.len(), shape.environments)?;
        let update = self.updates + 1;
        check_finite("a last value", last_values, (update, shape.horizon, shape.environments))?;
        let PpoSettings { gamma, gae_lambda, .. } = self.settings;
        self.advantages.compute(rollout, last_values, gamma, gae_lambda);
        let mut targets = self.targets.clone();
        targets.merge(&Moments::of_rows(&self.advantages.targets, 1));
        let values = targets.standardizer(self.settings.values);
        let units = Units {
            advantages: &self.advantages.advantages,
            targets: &self.advantages.targets,
            observations: &self.observations,
            values: &values,
            reflection: self.reflection.as_ref(),
            is_demonstrated: self.imitates(),
        };
        let seen = self.batch.fill(rollout, &units, (threads, update))?;
        let keys = (self.seed, update, self.reflection.is_some());
        let epochs = epochs(&self.settings, &self.advantages.advantages, keys, threads);
        let passes = Passes {
            settings: &self.settings,
            batch: &self.batch,
            epochs: &epochs,
            old: self.model.gaussian(),
            update,
            threads: threads.get(),
            imitation_coef: self.imitation_coef(),
        };
        let passed = passes.run(&self.model, self.rate())?;
        self.keep(passed, (seen, targets), rollout)
    }

    /// Return whether the next update learns from [demonstrations](RolloutStep::demonstrations).
    #[must_use]
    pub fn imitates(&self) -> bool {
        0.0 < self.imitation_coef()
    }

    /// Weight of the imitation loss in the next update.
    fn imitation_coef(&self) -> f32 {
        self.settings.imitation.map_or(0.0, |imitation| imitation.coef_after(self.updates))
    }

    /// Learning rate at the start of the next update.
    fn rate(&self) -> f32 {
        match self.settings.schedule {
            Schedule::Fixed | Schedule::AdaptiveKl { .. } => self.learning_rate,
            Schedule::Linear { updates } => {
                let left = 1.0 - self.updates as f64 / updates as f64;
                (f64::from(self.settings.learning_rate) * left.max(0.0)) as f32
            }
        }
    }

    /// Accept the outcome of an update if it is finite.
    fn keep(
        &mut self,
        passed: Passed,
        (seen, targets): (Moments, Moments),
        rollout: &Rollout,
    ) -> Result<UpdateReport, PpoError> {
        let Passed { model, learning_rate, totals } = passed;
        let update = self.updates + 1;
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        if !(model.is_finite() && finite(&targets.squares) && finite(&seen.squares)) {
            let (epoch, minibatch) = (totals.epochs, totals.minibatches);
            let what = "a parameter or moment";
            return Err(PpoError::NonFiniteLearning { update, epoch, minibatch, what });
        }
        self.model = model;
        self.learning_rate = learning_rate;
        self.updates = update;
        self.observed.merge(&seen);
        self.observations = self.observed.standardizer(self.settings.observations);
        self.targets = targets;
        self.values = self.targets.standardizer(self.settings.values);
        let explained = explained_variance(&rollout.values, &self.advantages.targets);
        Ok(report(update, learning_rate, explained, rollout.shape().samples(), &totals))
    }
}

fn report(
    update: u64,
    learning_rate: f32,
    explained_variance: f64,
    samples: usize,
    totals: &Totals,
) -> UpdateReport {
    let by_sample = |sum: f64| sum / totals.samples.max(1) as f64;
    let by_minibatch = |sum: f64| sum / totals.minibatches.max(1) as f64;
    UpdateReport {
        update,
        samples,
        policy_loss: by_sample(totals.sums.policy),
        value_loss: by_sample(totals.sums.value),
        bounds_loss: by_sample(totals.sums.bounds),
        entropy: by_minibatch(totals.entropy),
        kl: by_sample(totals.sums.divergence),
        clip_fraction: by_sample(totals.sums.clipped),
        gradient_norm: by_minibatch(totals.gradient_norm),
        shortened_fraction: by_minibatch(totals.shortened as f64),
        explained_variance,
        learning_rate,
        epochs: totals.epochs,
        minibatches: totals.minibatches,
    }
}

/// Explained variance `1 - var(targets - values) / var(targets)`; 0 when the targets do not vary.
fn explained_variance(values: &[f32], targets: &[f32]) -> f64 {
    let errors: Vec<f32> =
        targets.iter().zip(values).map(|(target, value)| target - value).collect();
    let of = |values: &[f32]| Moments::of_rows(values, 1).variances()[0];
    let all = of(targets);
    if 0.0 < all { 1.0 - of(&errors) / all } else { 0.0 }
}

impl super::noise::StepNoise {
    /// Sample the action of one environment.
    pub(super) fn act(
        self,
        environment: usize,
        gaussian: &Gaussian,
        means: &[f32],
        actions: &mut [f32],
    ) {
        // Two numbers per pair; 4 actions at most.
        const PAIRS: u64 = 2;
        for (pair, (means, actions)) in means.chunks(2).zip(actions.chunks_mut(2)).enumerate() {
            let normal = self.pair(environment as u64 * PAIRS + pair as u64);
            for (index, (mean, action)) in means.iter().zip(actions).enumerate() {
                *action = mean + gaussian.deviation(2 * pair + index) * normal[index];
            }
        }
    }
}
