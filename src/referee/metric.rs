//! Metrics of matches, with intervals and the values of the paper.

use super::{analysis::Episode, episodes::Outcome};
use crate::{
    recording::topic::Player,
    stats::{Interval, bootstrap_ci95},
};
use serde::Serialize;
use std::collections::BTreeMap;

/// A metric over episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Metric {
    /// Scoring rate: goals per minute of play, of both players.
    ScoringRate,
    /// Length of the episodes that ended with a point (s): seconds per goal.
    EpisodeLength,
    /// Number of blocks and strikes per finished episode, of both players.
    Contacts,
    /// Number of blocks per finished episode.
    Blocks,
    /// Number of strikes per finished episode.
    Strikes,
    /// Number of goal-directed strikes per finished episode.
    GoalDirected,
    /// Possession of the left player.
    PossessionLeft,
    /// Fraction of the points won by the left player.
    WinRateLeft,
    /// Mean speed of the ball (m/s).
    MeanBallSpeed,
    /// 99th percentile of the ball's speed in an episode (m/s).
    TopBallSpeed,
}

impl Metric {
    /// All metrics, in display order.
    pub const ALL: [Self; 10] = [
        Self::ScoringRate,
        Self::EpisodeLength,
        Self::Contacts,
        Self::Blocks,
        Self::Strikes,
        Self::GoalDirected,
        Self::PossessionLeft,
        Self::WinRateLeft,
        Self::MeanBallSpeed,
        Self::TopBallSpeed,
    ];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ScoringRate => "scoring_rate_per_min",
            Self::EpisodeLength => "episode_length_s",
            Self::Contacts => "contacts_per_episode",
            Self::Blocks => "blocks_per_episode",
            Self::Strikes => "strikes_per_episode",
            Self::GoalDirected => "goal_directed_per_episode",
            Self::PossessionLeft => "possession_left",
            Self::WinRateLeft => "win_rate_left",
            Self::MeanBallSpeed => "ball_speed_mean_m_per_s",
            Self::TopBallSpeed => "ball_speed_top_m_per_s",
        }
    }

    /// Name for people, with the unit.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::ScoringRate => "goals per minute of play",
            Self::EpisodeLength => "seconds per goal",
            Self::Contacts => "contacts per episode",
            Self::Blocks => "blocks per episode",
            Self::Strikes => "strikes per episode",
            Self::GoalDirected => "goal-directed hits per episode",
            Self::PossessionLeft => "possession of the left player",
            Self::WinRateLeft => "win rate of the left player",
            Self::MeanBallSpeed => "mean ball speed (m/s)",
            Self::TopBallSpeed => "top ball speed (m/s)",
        }
    }

    /// Mean of table I of the paper (10 games of a human against a robot, each one episode).
    /// Possession and win rate there are those of the robot.
    #[must_use]
    pub fn in_paper(self) -> Option<f64> {
        match self {
            Self::EpisodeLength => Some(31.3),
            Self::Contacts => Some(12.4),
            Self::Blocks => Some(7.4),
            Self::Strikes => Some(5.0),
            Self::GoalDirected => Some(1.8),
            Self::PossessionLeft => Some(0.436),
            Self::WinRateLeft => Some(0.1),
            Self::ScoringRate | Self::MeanBallSpeed | Self::TopBallSpeed => None,
        }
    }

    /// Return whether `episode` is relevant to the metric.
    fn concerns(self, episode: &Episode) -> bool {
        match self {
            Self::ScoringRate => 0.0 < episode.duration(),
            Self::EpisodeLength | Self::WinRateLeft => episode.span.scorer.is_some(),
            Self::Contacts | Self::Blocks | Self::Strikes | Self::GoalDirected => {
                episode.span.outcome != Outcome::Unfinished
            }
            Self::PossessionLeft => episode.possession(Player::Left).is_some(),
            Self::MeanBallSpeed => episode.mean_speed.is_some(),
            Self::TopBallSpeed => episode.top_speed.is_some(),
        }
    }

    /// Episodes that are relevant to the metric.
    #[must_use]
    pub fn of<'a>(self, episodes: impl IntoIterator<Item = &'a Episode>) -> Vec<&'a Episode> {
        episodes.into_iter().filter(|episode| self.concerns(episode)).collect()
    }

    /// Value over `episodes`, all of which are relevant; at least one.
    #[must_use]
    pub fn value(self, episodes: &[&Episode]) -> f64 {
        let mean = |of: &dyn Fn(&Episode) -> f64| {
            episodes.iter().map(|episode| of(episode)).sum::<f64>() / episodes.len() as f64
        };
        let both = |counts: [usize; 2]| (counts[0] + counts[1]) as f64;
        let scored = |episode: &Episode| f64::from(u8::from(episode.span.scorer.is_some()));
        match self {
            Self::ScoringRate => 60.0 * mean(&scored) / mean(&Episode::duration),
            Self::EpisodeLength => mean(&Episode::duration),
            Self::Contacts => mean(&|episode| episode.contacts() as f64),
            Self::Blocks => mean(&|episode| both(episode.blocks)),
            Self::Strikes => mean(&|episode| both(episode.strikes)),
            Self::GoalDirected => mean(&|episode| both(episode.goal_directed)),
            Self::PossessionLeft => {
                mean(&|episode| episode.possession(Player::Left).unwrap_or(f64::NAN))
            }
            Self::WinRateLeft => {
                mean(&|episode| f64::from(u8::from(episode.span.scorer == Some(Player::Left))))
            }
            Self::MeanBallSpeed => mean(&|episode| episode.mean_speed.unwrap_or(f64::NAN)),
            Self::TopBallSpeed => mean(&|episode| episode.top_speed.unwrap_or(f64::NAN)),
        }
    }
}

/// Value of a metric with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figure {
    /// Value; null without an episode.
    pub mean: Option<f64>,
    /// 95 % interval (bootstrap over episodes); null below two episodes.
    pub ci95: Option<[f64; 2]>,
    /// Number of episodes.
    pub n: usize,
}

/// Values of all metrics over `episodes`, by name.
#[must_use]
pub fn summarise<'a>(
    episodes: impl IntoIterator<Item = &'a Episode> + Clone,
    seed: u64,
) -> BTreeMap<&'static str, Figure> {
    let figures = Metric::ALL.into_iter().map(|metric| {
        let concerned = metric.of(episodes.clone());
        let statistic = |drawn: &[&&Episode]| {
            metric.value(&drawn.iter().map(|episode| **episode).collect::<Vec<_>>())
        };
        let interval = bootstrap_ci95(&concerned, seed, statistic);
        let figure = Figure {
            mean: (!concerned.is_empty()).then(|| metric.value(&concerned)),
            ci95: interval.map(|Interval { low, high }| [low, high]),
            n: concerned.len(),
        };
        (metric.name(), figure)
    });
    figures.collect()
}
