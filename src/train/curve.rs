//! Metrics of each update, and the time profile of training.

use super::pool::GameResult;
use crate::ppo::UpdateReport;
use serde::{Deserialize, Serialize};

/// Sums of one block over one update.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    /// Finished games, in their order.
    pub(super) results: Vec<GameResult>,
    /// Sum of the returns of finished episodes.
    pub(super) returns: f64,
    /// Control periods of the finished episodes.
    pub(super) episode_steps: u64,
    /// Number of hits of the ball by the learner.
    pub(super) hits: u64,
    /// Number of own goals: games lost by a striker over its own cup or by two biscuits.
    pub(super) own_goals: u64,
    pub(super) spent: Thinking,
}

/// Time of decisions (s).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Thinking {
    pub(super) policy: f64,
}

/// Metrics of one update.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvePoint {
    /// Index of the update, from 1.
    pub update: u64,
    /// Transitions of all environments, up to and including this update.
    pub transitions: u64,
    /// Number of finished games.
    pub games: u64,
    /// Games won by the learner.
    pub won: u64,
    /// Games lost by the learner.
    pub lost: u64,
    /// Games lost by an own goal.
    pub own_goals: u64,
    /// Mean episode return, shaping included; 0 without games.
    pub mean_return: f64,
    /// Mean episode length (s); 0 without games.
    pub mean_episode_s: f64,
    /// Hits of the ball by the learner per minute.
    pub hits_per_minute: f64,
    /// Mean running Elo rating of the learner.
    pub elo: f64,
    /// Number of opponents in the pool.
    pub pool: u64,
    /// Factor of the reward shaping, 1 decaying to 0.
    pub shaping_left: f64,
    /// Losses and other metrics of the learner.
    pub learning: UpdateReport,
}

impl CurvePoint {
    /// Mean score difference of the finished games, -1 to 1; `None` without games.
    #[must_use]
    pub fn score(&self) -> Option<f64> {
        (0 < self.games).then(|| (self.won as f64 - self.lost as f64) / self.games as f64)
    }

    /// All plotted metrics by name; the part before the slash is the group.
    #[must_use]
    pub fn figures(&self) -> [(&'static str, f64); 17] {
        let games = self.games.max(1) as f64;
        let learning = &self.learning;
        [
            ("play/return", self.mean_return),
            ("play/score", self.score().unwrap_or(0.0)),
            ("play/win_rate", self.won as f64 / games),
            ("play/own_goal_fraction", self.own_goals as f64 / games),
            ("play/episode_s", self.mean_episode_s),
            ("play/hits_per_minute", self.hits_per_minute),
            ("play/elo", self.elo),
            ("play/pool", self.pool as f64),
            ("play/shaping_left", self.shaping_left),
            ("losses/policy", learning.policy_loss),
            ("losses/value", learning.value_loss),
            ("losses/entropy", learning.entropy),
            ("losses/kl", learning.kl),
            ("losses/clip_fraction", learning.clip_fraction),
            ("losses/gradient_norm", learning.gradient_norm),
            ("losses/explained_variance", learning.explained_variance),
            ("losses/learning_rate", f64::from(learning.learning_rate)),
        ]
    }
}

/// Time profile of training: thread seconds, except for `wall_s`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct TimeShares {
    /// Wall-clock time (s).
    pub wall_s: f64,
    /// Ball, contacts, rules.
    pub physics_s: f64,
    /// Commands and actuators.
    pub actuator_s: f64,
    /// Decisions of learner and opponents.
    pub policy_s: f64,
    /// Updates of the networks.
    pub learning_s: f64,
    /// Observations, rewards, bookkeeping and waiting.
    pub other_s: f64,
    /// Number of transitions in that time.
    pub transitions: u64,
}

impl TimeShares {
    /// Transitions per second of wall-clock time; 0 before any time has passed.
    #[must_use]
    pub fn transitions_per_s(&self) -> f64 {
        if 0.0 < self.wall_s { self.transitions as f64 / self.wall_s } else { 0.0 }
    }

    /// Names and fractions of all thread time, 0 to 1.
    #[must_use]
    pub fn shares(&self) -> [(&'static str, f64); 5] {
        let parts = [
            ("physics", self.physics_s),
            ("actuator", self.actuator_s),
            ("policy", self.policy_s),
            ("learning", self.learning_s),
            ("other", self.other_s),
        ];
        let total: f64 = parts.iter().map(|(_, seconds)| seconds).sum();
        parts.map(|(name, seconds)| (name, if 0.0 < total { seconds / total } else { 0.0 }))
    }
}
