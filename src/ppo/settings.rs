//! Settings of PPO, two presets, and the allowed ranges.

use super::PpoError;
use crate::nn::{Activation, MAX_OUTPUTS};
use serde::{Deserialize, Serialize};

/// Widths of observations and actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spaces {
    /// Length of one observation, at least 1.
    pub observations: usize,
    /// Length of one action, at least 1; at most 4, or 3 with a shared trunk.
    pub actions: usize,
}

/// Network architecture of actor and critic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkLayout {
    /// Two networks of the same hidden widths.
    Separate,
    /// One network whose last layer gives the means of the actions, then the value.
    Shared,
}

/// Schedule of the learning rate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Constant.
    Fixed,
    /// Linear decay to zero.
    Linear {
        /// Index of the update, from 0, at which the rate would reach zero; at least 1.
        updates: u64,
    },
    /// Adaptive to the KL divergence after each minibatch: divided by 1.5 above twice the target,
    /// multiplied by 1.5 below half of it, within 1e-6 to 1e-2.
    AdaptiveKl {
        /// Target KL divergence between the policy that acted and the one that learns (nat), above
        /// 0.
        target: f32,
    },
}

/// Samples over which advantages are normalized to mean 0 and standard deviation 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AdvantageNormalization {
    /// No normalization.
    Off,
    /// All samples of an update.
    Batch,
    /// Each minibatch.
    Minibatch,
}

/// Running normalization of observations or values: `(x - mean) / sqrt(variance + epsilon)`,
/// clipped to `-limit` to `limit`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalization {
    /// No normalization.
    Off,
    /// Mean and variance of all samples so far.
    Running {
        /// Maximum magnitude after normalization (standard deviations), above 0.
        limit: f32,
        /// Added to the variance, above 0.
        epsilon: f32,
    },
}

/// Loss of the critic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ValueLoss {
    /// Half the squared error.
    Squared,
    /// The larger of that and the loss of the value clipped to within the clip coefficient of the
    /// old value.
    Clipped,
}

/// Imitation of a demonstrator, which decides for what the learner observes, with a weight that
/// decays linearly to zero (Schmitt et al., "Kickstarting Deep Reinforcement Learning", 2018).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Imitation {
    /// Initial weight of half the squared difference of mean and demonstrated action, 0 or more.
    pub coef: f32,
    /// Index of the update, from 0, at which the weight is zero.
    pub updates: u64,
}

impl Imitation {
    /// Weight in the update that follows `updates` others.
    pub(super) fn coef_after(self, updates: u64) -> f32 {
        let left = 1.0 - updates as f64 / self.updates as f64;
        (f64::from(self.coef) * left.max(0.0)) as f32
    }
}

/// Settings of the learner, with the usual names of PPO implementations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PpoSettings {
    /// Separate or shared networks of actor and critic.
    pub layout: NetworkLayout,
    /// Widths of the hidden layers, at least one.
    pub hidden: Vec<usize>,
    /// Activation function between layers.
    pub activation: Activation,
    /// Initial log standard deviation of the policy, the same for every action.
    pub initial_log_deviation: f32,
    /// Maximum log standard deviation; `None` for no limit. If actions are clamped to -1 to 1, a
    /// standard deviation above 1 changes little but increases the entropy bonus without bound.
    pub most_log_deviation: Option<f32>,
    /// Steps of each environment in one update, at least 1; the caller builds the rollout with it.
    pub horizon: usize,
    /// Number of epochs (passes over the samples of an update), at least 1.
    pub epochs: usize,
    /// Number of samples in a minibatch, at least 1. Other batch sizes than its multiples are split
    /// into equal, smaller parts.
    pub minibatch: usize,
    /// Discount factor per step, 0 to 1.
    pub gamma: f32,
    /// GAE lambda, 0 to 1.
    pub gae_lambda: f32,
    /// Initial learning rate, above 0.
    pub learning_rate: f32,
    /// Schedule of the learning rate.
    pub schedule: Schedule,
    /// Clip coefficient of the probability ratio; above 0.
    pub clip_coef: f32,
    /// Loss of the critic.
    pub value_loss: ValueLoss,
    /// Weight of half the squared error of the value, 0 or more.
    pub value_coef: f32,
    /// Weight of the policy's entropy (1/nat), 0 or more.
    pub entropy_coef: f32,
    /// Weight of the squared excess of a mean over 1.1 in magnitude, 0 or more.
    pub bounds_coef: f32,
    /// Maximum norm of the whole gradient, above 0; `None` for no limit.
    pub max_gradient_norm: Option<f32>,
    /// Adam's epsilon, above 0.
    pub adam_epsilon: f32,
    /// Normalization of advantages.
    pub advantages: AdvantageNormalization,
    /// Normalization of observations.
    pub observations: Normalization,
    /// Normalization of returns and values, inside the critic.
    pub values: Normalization,
    /// Early stopping: an update ends before a minibatch whose KL divergence from the policy that
    /// acted is above 1.5 times this (nat), above 0; `None` for never.
    pub kl_stop: Option<f32>,
    /// Imitation of a demonstrator; set by the caller, who knows when it ends, and not stored.
    #[serde(skip)]
    pub imitation: Option<Imitation>,
}

impl PpoSettings {
    /// The paper's table II: gamma 0.99, lambda 0.95, learning rate 3e-4, clip 0.2, minibatch 4096,
    /// entropy 0.01. Settings that the table leaves open are those of CleanRL's
    /// `ppo_continuous_action.py`, except for the networks' ELU, 4 epochs and a standard deviation
    /// of at most 1.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            layout: NetworkLayout::Separate,
            hidden: vec![64, 64],
            activation: Activation::Elu,
            initial_log_deviation: 0.0,
            most_log_deviation: Some(0.0),
            horizon: 64,
            epochs: 4,
            minibatch: 4096,
            gamma: 0.99,
            gae_lambda: 0.95,
            learning_rate: 3e-4,
            schedule: Schedule::Fixed,
            clip_coef: 0.2,
            value_loss: ValueLoss::Clipped,
            value_coef: 0.5,
            entropy_coef: 0.01,
            bounds_coef: 0.0,
            max_gradient_norm: Some(0.5),
            adam_epsilon: 1e-5,
            advantages: AdvantageNormalization::Minibatch,
            observations: Normalization::Running { limit: 10.0, epsilon: 1e-8 },
            values: Normalization::Off,
            kl_stop: None,
            imitation: None,
        }
    }

    /// Upstream's hyperparameters for rl_games (`klask_ppo_config_with_pretraining.yaml`).
    ///
    /// Differences to upstream: single precision throughout instead of mixed, orthogonal
    /// initialization, and shuffled minibatches. The KL divergence of the adaptive rate is relative
    /// to the policy that acted; in rl_games it is relative to the one before the same minibatch's
    /// last use.
    #[must_use]
    pub fn upstream() -> Self {
        let running = Normalization::Running { limit: 5.0, epsilon: 1e-5 };
        Self {
            layout: NetworkLayout::Shared,
            hidden: vec![256, 128, 64],
            most_log_deviation: None,
            horizon: 128,
            epochs: 8,
            gamma: 0.996,
            learning_rate: 1e-4,
            schedule: Schedule::AdaptiveKl { target: 0.01 },
            value_coef: 2.0,
            entropy_coef: 0.0,
            bounds_coef: 1e-7,
            max_gradient_norm: Some(0.4),
            adam_epsilon: 1e-8,
            advantages: AdvantageNormalization::Batch,
            observations: running,
            values: running,
            ..Self::paper()
        }
    }

    /// Check that every value is in its range.
    ///
    /// # Errors
    /// [`PpoError::Setting`] for the first value outside its range.
    pub fn check(&self, spaces: Spaces) -> Result<(), PpoError> {
        let outputs = match self.layout {
            NetworkLayout::Separate => spaces.actions,
            NetworkLayout::Shared => spaces.actions + 1,
        };
        let narrowest = self.hidden.iter().min().copied().unwrap_or(0);
        at_least_one("observations", spaces.observations)?;
        at_least_one("actions", spaces.actions)?;
        within("outputs of the network", outputs as f32, 1.0, MAX_OUTPUTS as f32)?;
        at_least_one("hidden", narrowest)?;
        at_least_one("horizon", self.horizon)?;
        at_least_one("epochs", self.epochs)?;
        at_least_one("minibatch", self.minibatch)?;
        within("initial_log_deviation", self.initial_log_deviation, -10.0, 10.0)?;
        if let Some(most) = self.most_log_deviation {
            within("most_log_deviation", most, self.initial_log_deviation, 10.0)?;
        }
        within("gamma", self.gamma, 0.0, 1.0)?;
        within("gae_lambda", self.gae_lambda, 0.0, 1.0)?;
        for (name, value) in [
            ("value_coef", self.value_coef),
            ("entropy_coef", self.entropy_coef),
            ("bounds_coef", self.bounds_coef),
        ] {
            within(name, value, 0.0, f32::MAX)?;
        }
        self.check_positive()
    }

    fn check_positive(&self) -> Result<(), PpoError> {
        let mut positive = vec![
            ("learning_rate", self.learning_rate),
            ("clip_coef", self.clip_coef),
            ("adam_epsilon", self.adam_epsilon),
        ];
        positive.extend(self.max_gradient_norm.map(|value| ("max_gradient_norm", value)));
        positive.extend(self.kl_stop.map(|value| ("kl_stop", value)));
        match self.schedule {
            Schedule::AdaptiveKl { target } => positive.push(("schedule.target", target)),
            Schedule::Linear { updates: 0 } => at_least_one("schedule.updates", 0)?,
            Schedule::Fixed | Schedule::Linear { .. } => {}
        }
        for (normalization, limit_name, epsilon_name) in [
            (self.observations, "observations.limit", "observations.epsilon"),
            (self.values, "values.limit", "values.epsilon"),
        ] {
            if let Normalization::Running { limit, epsilon } = normalization {
                positive.extend([(limit_name, limit), (epsilon_name, epsilon)]);
            }
        }
        positive
            .into_iter()
            .try_for_each(|(name, value)| within(name, value, f32::MIN_POSITIVE, f32::MAX))
    }
}

fn at_least_one(name: &'static str, value: usize) -> Result<(), PpoError> {
    within(name, value as f32, 1.0, f32::MAX)
}

fn within(name: &'static str, value: f32, low: f32, high: f32) -> Result<(), PpoError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(PpoError::Setting { name, value, low, high })
}
