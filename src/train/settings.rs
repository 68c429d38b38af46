//! Settings of a training run, in one document. Names are those of the JSON form; unknown keys are
//! errors.

use super::{
    TrainError,
    reward::{Curriculum, RewardSettings},
};
use crate::{
    game::{
        MOST_PREVIOUS_COMMANDS, ObservationKind, ObservationLayout, Randomization, SensorSettings,
    },
    opponent::Scripted,
    ppo::{Imitation, PpoSettings, Reflection, Schedule, Spaces},
};
use serde::{Deserialize, Serialize};
use std::{fs, path::Path};

/// Number of action values: velocity along x and y.
pub const ACTIONS: usize = 2;

/// Settings of a training run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainSettings {
    /// Seed of all random streams.
    pub seed: u64,
    /// Transitions of all environments, at least 1; training continues to the end of an update.
    pub steps: u64,
    /// Number of environments, 2 to 1,000,000.
    pub environments: usize,
    /// Observed values of the state.
    pub observations: ObservationKind,
    /// Number of own previous commands that a policy observes, 0 to 8; 0 in the presets of paper and
    /// upstream.
    #[serde(default)]
    pub action_history: usize,
    /// Settings of the learner.
    pub ppo: PpoSettings,
    /// Transitions after which a linear decay of the learning rate reaches zero, in place of the
    /// learner's own schedule, at least 1; null in the presets of paper and upstream. Later
    /// transitions change nothing. `train --steps` sets both for a new run.
    #[serde(default)]
    pub anneal_transitions: Option<u64>,
    /// Learn from every sample and from its mirror image across the long axis of the board; off in
    /// the presets of paper and upstream.
    #[serde(default)]
    pub mirrored_experience: bool,
    /// Start of training episodes.
    #[serde(default)]
    pub starts: StartSettings,
    /// Reward and reward shaping.
    pub reward: RewardSettings,
    /// Opponents.
    pub opponents: OpponentSettings,
    /// Domain randomization.
    pub randomization: RandomizationKind,
    /// Camera and state estimator between game and players; null for exact, current observations.
    #[serde(default)]
    pub sensors: Option<SensorSettings>,
    /// Play with three biscuits on the board that attach to strikers; two on one striker lose the
    /// point. Players do not observe them.
    #[serde(default)]
    pub biscuits: bool,
    /// Imitation of a scripted player early in training; null in the presets of paper and upstream.
    #[serde(default)]
    pub imitation: Option<ImitationSettings>,
    /// Updates between two checkpoints, at least 1.
    pub checkpoint_updates: u64,
    /// Evaluation at the end.
    pub evaluation: EvaluationSettings,
}

/// Start of training episodes; evaluation games begin with a resting ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StartSettings {
    /// Fraction of the episodes that begin with a moving ball, 0 to 1; 0 in the presets of paper
    /// and upstream.
    pub moving_fraction: f64,
    /// Maximum speed of that ball (m/s), 0 to 10; 1.
    pub ball_speed_m_per_s: f64,
    /// Fraction of the episodes, beyond the half that chance gives, that serve the ball into the
    /// half of the learner, 0 to 1; 0 in the presets of paper and upstream.
    #[serde(default)]
    pub served_fraction: f64,
    /// Fraction of the episodes that begin with a striker close behind the ball on its line to the
    /// other cup, 0 to 1; 0 in the presets of paper and upstream.
    #[serde(default)]
    pub aligned_fraction: f64,
    /// Fraction of the episodes after a goal or a time limit in which the players go on from where
    /// they are, as in a match, 0 to 1; 0.
    #[serde(default)]
    pub continued_fraction: f64,
}

impl Default for StartSettings {
    fn default() -> Self {
        Self {
            moving_fraction: 0.0,
            ball_speed_m_per_s: 1.0,
            served_fraction: 0.0,
            aligned_fraction: 0.0,
            continued_fraction: 0.0,
        }
    }
}

/// Imitation of [`Scripted::Shooter`], which decides for what the learner observes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImitationSettings {
    /// Initial weight of half the squared difference between mean and demonstrated action, 0 to 1000.
    pub coef: f32,
    /// Transitions after which a linear decay of the weight reaches zero, at least 1.
    pub decay_transitions: u64,
}

/// Domain randomization.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RandomizationKind {
    /// Equal physics in all episodes.
    Off,
    /// The paper's table III ([`Randomization::paper`]).
    Paper,
}

/// Source of opponents.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OpponentMode {
    /// Enhanced self-play: earlier policies, weighted by [`OpponentSettings::decay`] to the power
    /// of their age.
    Enhanced,
    /// Earlier policies with equal weights.
    Uniform,
    /// The newest policy of the pool.
    Best,
    /// A scripted player.
    Scripted(Scripted),
}

/// Settings of the opponent pool.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OpponentSettings {
    /// Source of opponents.
    pub mode: OpponentMode,
    /// Threshold of the mean score difference over the last [`window_games`](Self::window_games),
    /// above which the policy joins the pool; -1 to 1; 0.7 as in the paper.
    pub update_score: f64,
    /// Number of finished games in that window, at least 1; 1024.
    pub window_games: usize,
    /// Weight of a policy relative to the next newer one, above 0 to 1; 0.9 as in the paper.
    pub decay: f64,
    /// Maximum number of policies in the pool, at least 1; 32, of which the oldest weighs 0.04.
    pub most: usize,
    /// Fraction of the episodes against a scripted player in place of the source of opponents, 0 to
    /// 1; 0 in the presets of paper and upstream.
    #[serde(default)]
    pub scripted_fraction: f64,
    /// Weights with which these players are drawn.
    #[serde(default)]
    pub scripted_weights: ScriptedWeights,
}

/// Weights of the scripted players in training. The random one has none: every untrained policy resembles it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScriptedWeights {
    /// Weight of [`Scripted::Stationary`], 0 to 1000.
    pub stationary: u32,
    /// Weight of [`Scripted::Goalkeeper`], 0 to 1000.
    pub goalkeeper: u32,
    /// Weight of [`Scripted::Chaser`], 0 to 1000.
    pub chaser: u32,
}

impl ScriptedWeights {
    /// Every player with its weight.
    #[must_use]
    pub const fn players(self) -> [(Scripted, u32); 3] {
        [
            (Scripted::Stationary, self.stationary),
            (Scripted::Goalkeeper, self.goalkeeper),
            (Scripted::Chaser, self.chaser),
        ]
    }

    /// Sum of the weights, at least 1 in valid settings.
    #[must_use]
    pub fn total(self) -> u32 {
        self.players().into_iter().fold(0, |sum, (_, weight)| sum.saturating_add(weight))
    }
}

impl Default for ScriptedWeights {
    /// Those of the settings that were written before there was a choice.
    fn default() -> Self {
        Self { stationary: 1, goalkeeper: 2, chaser: 2 }
    }
}

/// Name, value and allowed range of a setting, and whether the value is valid.
type Check = (&'static str, f64, &'static str, bool);

fn at_least_one(name: &'static str, value: u64) -> Check {
    (name, value as f64, "at least 1", 1 <= value)
}

fn fraction(name: &'static str, value: f64) -> Check {
    (name, value, "from 0 to 1", (0.0..=1.0).contains(&value))
}

impl ImitationSettings {
    fn checks(&self) -> [Check; 2] {
        let coef = f64::from(self.coef);
        [
            ("imitation.coef", coef, "from 0 to 1000", (0.0..=1000.0).contains(&coef)),
            at_least_one("imitation.decay_transitions", self.decay_transitions),
        ]
    }
}

impl OpponentSettings {
    fn checks(&self) -> [Check; 9] {
        let weights = self.scripted_weights;
        let weight =
            |name, weight: u32| (name, f64::from(weight), "from 0 to 1000", weight <= 1000);
        [
            (
                "opponents.update_score",
                self.update_score,
                "from -1 to 1",
                (-1.0..=1.0).contains(&self.update_score),
            ),
            at_least_one("opponents.window_games", self.window_games as u64),
            (
                "opponents.decay",
                self.decay,
                "above 0 and at most 1",
                0.0 < self.decay && self.decay <= 1.0,
            ),
            at_least_one("opponents.most", self.most as u64),
            fraction("opponents.scripted_fraction", self.scripted_fraction),
            weight("opponents.scripted_weights.stationary", weights.stationary),
            weight("opponents.scripted_weights.goalkeeper", weights.goalkeeper),
            weight("opponents.scripted_weights.chaser", weights.chaser),
            at_least_one("opponents.scripted_weights (sum)", weights.total().into()),
        ]
    }
}

/// Settings of the evaluation after training.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EvaluationSettings {
    /// Time limit of evaluation games (s); longer than in training, so that most games are decided.
    pub time_limit_s: f64,
    /// Games against each scripted player, half of them from each seat; even.
    pub games_per_opponent: usize,
    /// Games of each pair of the Elo table, half of them from each seat; even; 0 for no table.
    pub games_per_pair: usize,
    /// Number of earlier policies in the Elo table, evenly spaced over the pool.
    pub pool_players: usize,
    /// Number of sample games against the chaser.
    pub sample_games: usize,
}

/// A published set of hyperparameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Preset {
    /// The strongest recipe of this project's sweeps: mirrored experience, shaping by motion,
    /// scripted opponents beside the pool, small batches.
    Tuned,
    /// The paper's table II: 64-64, 4 epochs.
    Paper,
    /// The KlaskTron repository's recipe for rl_games: 256-128-64, 8 epochs.
    Upstream,
}

impl TrainSettings {
    /// Settings of a preset, with 20 million transitions.
    #[must_use]
    pub fn preset(preset: Preset) -> Self {
        if preset == Preset::Tuned {
            return Self::tuned();
        }
        Self {
            seed: 0,
            steps: 20_000_000,
            environments: 4096,
            observations: ObservationKind::Augmented20,
            action_history: 0,
            ppo: match preset {
                // The paper does not state the horizon; short rollouts give four times as many
                // updates.
                Preset::Upstream => PpoSettings::upstream(),
                Preset::Paper | Preset::Tuned => {
                    PpoSettings { horizon: 16, ..PpoSettings::paper() }
                }
            },
            anneal_transitions: None,
            mirrored_experience: false,
            starts: StartSettings::default(),
            reward: RewardSettings::of(Curriculum::DenseBallToGoal),
            opponents: OpponentSettings {
                mode: OpponentMode::Enhanced,
                update_score: 0.7,
                window_games: 1024,
                decay: 0.9,
                most: 32,
                scripted_fraction: 0.0,
                scripted_weights: ScriptedWeights::default(),
            },
            randomization: RandomizationKind::Off,
            sensors: None,
            biscuits: false,
            imitation: None,
            checkpoint_updates: 64,
            evaluation: EvaluationSettings {
                time_limit_s: 30.0,
                games_per_opponent: 1000,
                games_per_pair: 40,
                pool_players: 6,
                sample_games: 4,
            },
        }
    }

    /// Best of the sweep in `reports/2026-11-24-recipe`, which has the figures of each change. The
    /// rewards of motion towards ball and cup, their fast decay and the geometry of a shot in the
    /// observation matter most.
    fn tuned() -> Self {
        let paper = Self::preset(Preset::Paper);
        Self {
            environments: 1024,
            observations: ObservationKind::Shooting31,
            action_history: 3,
            ppo: PpoSettings {
                hidden: vec![128, 64],
                initial_log_deviation: -1.5,
                horizon: 32,
                epochs: 3,
                minibatch: 1024,
                gamma: 0.995,
                learning_rate: 6e-4,
                entropy_coef: 0.0,
                ..PpoSettings::paper()
            },
            anneal_transitions: Some(paper.steps),
            mirrored_experience: true,
            starts: StartSettings {
                moving_fraction: 0.5,
                ball_speed_m_per_s: 1.0,
                served_fraction: 0.3,
                aligned_fraction: 0.3,
                continued_fraction: 0.0,
            },
            reward: RewardSettings::of(Curriculum::Motion),
            opponents: OpponentSettings {
                update_score: 0.3,
                scripted_fraction: 0.5,
                ..paper.opponents
            },
            imitation: Some(ImitationSettings { coef: 1.0, decay_transitions: 3_000_000 }),
            ..paper
        }
    }

    /// The same settings for a run of `steps` transitions: an annealed learning rate reaches zero at its end.
    #[must_use]
    pub fn for_steps(self, steps: u64) -> Self {
        let anneal_transitions = self.anneal_transitions.map(|_planned| steps);
        Self { steps, anneal_transitions, ..self }
    }

    /// Settings of the learner in this run: with the schedules of
    /// [`anneal_transitions`](Self::anneal_transitions) and [`imitation`](Self::imitation).
    #[must_use]
    pub fn learner(&self) -> PpoSettings {
        let updates = |transitions: u64| transitions.div_ceil(self.transitions_per_update());
        let annealed = |transitions| Schedule::Linear { updates: updates(transitions) };
        let schedule = self.anneal_transitions.map_or(self.ppo.schedule, annealed);
        let imitation = self.imitation.map(|ImitationSettings { coef, decay_transitions }| {
            Imitation { coef, updates: updates(decay_transitions) }
        });
        PpoSettings { schedule, imitation, ..self.ppo.clone() }
    }

    /// Symmetry of the game across the long axis of the board, if it is learned from.
    #[must_use]
    pub fn reflection(&self) -> Option<Reflection> {
        let reflection =
            || Reflection { observations: self.layout().mirror_signs(), actions: vec![-1, 1] };
        self.mirrored_experience.then(reflection)
    }

    /// Read settings.
    ///
    /// # Errors
    /// When the file cannot be read, a key is unknown or missing, or a value is outside its range.
    pub fn read(path: &Path) -> Result<Self, TrainError> {
        let error = |source| TrainError::Settings { path: path.to_owned(), source };
        let text = fs::read_to_string(path).map_err(|io| error(serde_json::Error::io(io)))?;
        serde_json::from_str(&text).map_err(error)
    }

    /// JSON document of the settings.
    #[must_use]
    pub fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).unwrap_or_else(|_plain| unreachable!("plain data"))
    }

    /// Observation of the players.
    #[must_use]
    pub fn layout(&self) -> ObservationLayout {
        ObservationLayout { state: self.observations, commands: self.action_history }
    }

    /// Widths of observation and action.
    #[must_use]
    pub fn spaces(&self) -> Spaces {
        Spaces { observations: self.layout().len(), actions: ACTIONS }
    }

    /// Number of transitions per update.
    #[must_use]
    pub fn transitions_per_update(&self) -> u64 {
        (self.environments * self.ppo.horizon) as u64
    }

    /// Updates until [`steps`](Self::steps) are reached.
    #[must_use]
    pub fn updates(&self) -> u64 {
        self.steps.div_ceil(self.transitions_per_update())
    }

    /// Ranges of the domain randomization.
    #[must_use]
    pub fn randomization_ranges(&self) -> Option<Randomization> {
        match self.randomization {
            RandomizationKind::Off => None,
            RandomizationKind::Paper => Some(Randomization::paper()),
        }
    }

    /// Check that every value is in its range.
    ///
    /// # Errors
    /// The first value outside its range.
    pub fn check(&self) -> Result<(), TrainError> {
        self.ppo.check(self.spaces())?;
        let Self { opponents, evaluation, .. } = self;
        let even = |name, value: usize| (name, value as f64, "even", value.is_multiple_of(2));
        let environments = self.environments;
        let limit = evaluation.time_limit_s;
        let checks = [
            at_least_one("steps", self.steps),
            (
                "environments",
                environments as f64,
                "from 2 to 1000000",
                (2..=1_000_000).contains(&environments),
            ),
            at_least_one("anneal_transitions", self.anneal_transitions.unwrap_or(1)),
            at_least_one("checkpoint_updates", self.checkpoint_updates),
            (
                "action_history",
                self.action_history as f64,
                "from 0 to 8",
                self.action_history <= MOST_PREVIOUS_COMMANDS,
            ),
            fraction("starts.moving_fraction", self.starts.moving_fraction),
            fraction("starts.served_fraction", self.starts.served_fraction),
            fraction("starts.aligned_fraction", self.starts.aligned_fraction),
            fraction("starts.continued_fraction", self.starts.continued_fraction),
            (
                "starts.ball_speed_m_per_s",
                self.starts.ball_speed_m_per_s,
                "from 0 to 10",
                (0.0..=10.0).contains(&self.starts.ball_speed_m_per_s),
            ),
            (
                "evaluation.time_limit_s",
                limit,
                "from 0.02 to 3600",
                (0.02..=3600.0).contains(&limit),
            ),
            even("evaluation.games_per_opponent", evaluation.games_per_opponent),
            even("evaluation.games_per_pair", evaluation.games_per_pair),
        ];
        let imitation = self.imitation.iter().flat_map(|own| own.checks());
        let mut all = checks.into_iter().chain(opponents.checks()).chain(imitation);
        if let Some((name, value, range, _)) = all.find(|(.., is_valid)| !is_valid) {
            return Err(TrainError::Setting { name, value, range });
        }
        self.reward
            .wrong()
            .map_or(Ok(()), |(name, value, range)| Err(TrainError::Setting { name, value, range }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_come_back_from_json_and_unknown_keys_do_not_pass() {
        for preset in [Preset::Paper, Preset::Upstream, Preset::Tuned] {
            let settings = TrainSettings::preset(preset);
            settings.check().unwrap();
            let json = settings.to_json();
            assert_eq!(serde_json::from_str::<TrainSettings>(&json).unwrap(), settings);
            for (key, typo) in
                [("\"steps\"", "\"step\""), ("\"gamma\"", "\"gama\""), ("\"decay\"", "\"dcay\"")]
            {
                let error = serde_json::from_str::<TrainSettings>(&json.replace(key, typo));
                assert!(error.unwrap_err().to_string().contains("unknown field"), "{typo}");
            }
            // A number as text, which YAML 1.1 makes of an unquoted 1e-7, is rejected.
            let text = json.replace("\"window_games\": 1024", "\"window_games\": \"1024\"");
            assert_ne!(text, json);
            assert!(serde_json::from_str::<TrainSettings>(&text).is_err());
        }
    }

    #[test]
    fn what_cannot_be_is_named_with_its_range() {
        let refused = |change: &dyn Fn(&mut TrainSettings)| {
            let mut settings = TrainSettings::preset(Preset::Paper);
            change(&mut settings);
            settings.check().unwrap_err().to_string()
        };
        for (change, expected) in [
            (
                &(|s: &mut TrainSettings| s.environments = 1) as &dyn Fn(&mut TrainSettings),
                "setting environments is 1; it must be from 2 to 1000000",
            ),
            (
                &|s| s.opponents.decay = 0.0,
                "opponents.decay is 0; it must be above 0 and at most 1",
            ),
            (&|s| s.opponents.update_score = f64::NAN, "opponents.update_score is NaN"),
            (
                &|s| s.opponents.scripted_weights.chaser = 1001,
                "opponents.scripted_weights.chaser is 1001; it must be from 0 to 1000",
            ),
            (
                &|s| {
                    s.opponents.scripted_weights =
                        ScriptedWeights { stationary: 0, goalkeeper: 0, chaser: 0 };
                },
                "opponents.scripted_weights (sum) is 0; it must be at least 1",
            ),
            (
                &|s| {
                    s.imitation = Some(ImitationSettings { coef: -1.0, decay_transitions: 1 });
                },
                "imitation.coef is -1; it must be from 0 to 1000",
            ),
            (&|s| s.evaluation.games_per_pair = 3, "games_per_pair is 3; it must be even"),
            (&|s| s.reward.cup_scale_m = 0.0, "reward.cup_scale_m is 0; it must be above 0"),
            (&|s| s.reward.progress = f32::NAN, "reward.progress is NaN"),
            (&|s| s.ppo.gamma = 1.5, "gamma is 1.5"),
        ] {
            let found = refused(change);
            assert!(found.contains(expected), "{found}");
        }
    }

    #[test]
    fn steps_are_reached_by_whole_updates() {
        let settings = TrainSettings::preset(Preset::Paper);
        assert_eq!(settings.transitions_per_update(), 65_536);
        assert_eq!(settings.updates(), 306);
    }
}
