//! Every choice of the algorithm, two presets, and the ranges that are allowed.

use super::PpoError;
use crate::nn::{Activation, MAX_OUTPUTS};
use serde::{Deserialize, Serialize};

/// Sizes of one row of observations and of actions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Spaces {
    /// Numbers in one observation, at least 1.
    pub observations: usize,
    /// Numbers in one action, at least 1; at most 4, or 3 with a shared trunk.
    pub actions: usize,
}

/// How actor and critic share their layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NetworkLayout {
    /// Two networks of the same hidden widths.
    Separate,
    /// One network whose last layer gives the means of the actions, then the value.
    Shared,
}

/// How the learning rate moves.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Schedule {
    /// Not at all.
    Fixed,
    /// Linearly to zero.
    Linear {
        /// The update, counted from 0, at which the rate would reach zero; at least 1.
        updates: u64,
    },
    /// After each minibatch: divided by 1.5 above twice the target, multiplied by 1.5 below half
    /// of it, within 1e-6 to 1e-2.
    AdaptiveKl {
        /// Wanted divergence between the policy that acted and the one that learns (nat), above 0.
        target: f32,
    },
}

/// Over what advantages are brought to mean 0 and deviation 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AdvantageNormalization {
    /// They stay as they are.
    Off,
    /// All samples of an update.
    Batch,
    /// Each minibatch.
    Minibatch,
}

/// Running standardisation of observations or values: `(x - mean) / sqrt(variance + epsilon)`,
/// limited to `-limit` to `limit`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Normalization {
    /// Numbers stay as they are.
    Off,
    /// Mean and variance of everything seen so far.
    Running {
        /// Largest magnitude afterwards (deviations), above 0.
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
    /// The larger of that and the one with the value held within the clip coefficient of the old.
    Clipped,
}

/// All settings of the learner. Names are those of the field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PpoSettings {
    /// Whether actor and critic are one network.
    pub layout: NetworkLayout,
    /// Widths of the hidden layers, at least one.
    pub hidden: Vec<usize>,
    /// Between layers.
    pub activation: Activation,
    /// Start of the logarithm of the policy's standard deviation, the same for every action.
    pub initial_log_deviation: f32,
    /// Largest logarithm of it; `None` for no limit. Where actions are clamped to -1 to 1, a deviation above 1
    /// changes little but earns the entropy bonus without end.
    pub most_log_deviation: Option<f32>,
    /// Steps of each environment in one update, at least 1; a proposal to the caller, who makes
    /// the rollout.
    pub horizon: usize,
    /// Passes over the samples of an update, at least 1.
    pub epochs: usize,
    /// Samples in a minibatch, at least 1. A batch that is no multiple is cut into equal parts that
    /// are not larger.
    pub minibatch: usize,
    /// Discount of a reward one step later, 0 to 1.
    pub gamma: f32,
    /// Decay of temporal differences in the advantage, 0 to 1.
    pub gae_lambda: f32,
    /// Learning rate at the start, above 0.
    pub learning_rate: f32,
    /// How it moves.
    pub schedule: Schedule,
    /// Ratios outside `1 - clip` to `1 + clip` earn nothing more; above 0.
    pub clip_coef: f32,
    /// Which loss the critic has.
    pub value_loss: ValueLoss,
    /// Weight of half the squared error of the value, 0 or more.
    pub value_coef: f32,
    /// Weight of the policy's entropy (1/nat), 0 or more.
    pub entropy_coef: f32,
    /// Weight of the squared excess of a mean over 1.1 in magnitude, 0 or more.
    pub bounds_coef: f32,
    /// Largest norm of the whole gradient, above 0; `None` for any.
    pub max_gradient_norm: Option<f32>,
    /// Adam's epsilon, above 0.
    pub adam_epsilon: f32,
    /// Over what advantages are normalised.
    pub advantages: AdvantageNormalization,
    /// Of observations.
    pub observations: Normalization,
    /// Of returns and values, inside the critic.
    pub values: Normalization,
    /// An update ends before a minibatch whose divergence from the policy that acted is above 1.5
    /// times this (nat), above 0; `None` for never.
    pub kl_stop: Option<f32>,
}

impl PpoSettings {
    /// The paper's table II: gamma 0.99, lambda 0.95, rate 3e-4, clip 0.2, minibatch 4096, entropy
    /// 0.01. What the table leaves open is as in CleanRL's `ppo_continuous_action.py`, except for
    /// the networks' ELU, 4 epochs and a deviation of at most 1.
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
        }
    }

    /// Upstream's recipe for rl_games (`klask_ppo_config_with_pretraining.yaml`).
    ///
    /// Not as upstream: single precision throughout instead of mixed, orthogonal initialisation,
    /// shuffled minibatches, and the divergence that moves the rate is counted from the policy that
    /// acted, where rl_games counts from the one before the same minibatch's last visit.
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

    /// Refuses values outside their ranges.
    ///
    /// # Errors
    /// [`PpoError::Setting`] with the first one.
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
