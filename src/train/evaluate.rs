//! Evaluation of a policy: games against the scripted players, and a round robin with earlier
//! policies.

use super::{
    Arena, MatchScore, TrainError,
    arena::{GameResult, Games},
    elo::{self, EloRow, Played},
    pool::{Choice, Opponent, Pool},
    run::Run,
};
use crate::{
    game::CONTROL_PERIOD,
    opponent::Scripted,
    stats::{Interval, ratio_ci95},
};
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;

/// Name of the evaluated policy in tables.
pub const LEARNER_NAME: &str = "learner";

/// Evaluation against one opponent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OpponentEvaluation {
    /// Name of the opponent.
    pub opponent: String,
    /// The outcomes by the policy's seat.
    pub score: MatchScore,
    /// Win rate of decided games, 0 to 1; null without a decided game.
    pub win_rate: Option<f64>,
    /// 95 % Wilson interval of the win rate.
    pub win_rate_ci95: Option<Interval>,
    /// Goals of the policy per minute of play.
    pub goals_per_min: Estimate,
    /// Goals of the opponent per minute of play.
    pub conceded_goals_per_min: Estimate,
    /// Episode length (s); a game without a winner counts with the time limit.
    pub episode_length_s: Estimate,
    /// Number of hits of the ball by the policy per game.
    pub hits_per_episode: Estimate,
    /// Fraction of the games that the policy loses by an own goal, 0 to 1.
    pub own_goal_fraction: Estimate,
}

/// Mean over games with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean over all games.
    pub mean: f64,
    /// 95 % interval (bootstrap over games).
    pub ci95: Option<Interval>,
}

impl OpponentEvaluation {
    fn new(opponent: String, games: &Games, seed: u64) -> Self {
        let score = games.score();
        let both = score.both();
        let ratio = |above: fn(&GameResult) -> f64, below: fn(&GameResult) -> f64| {
            let (mean, ci95) = ratio_ci95(&games.results, seed, above, below);
            Estimate { mean, ci95 }
        };
        let won = |result: &GameResult| f64::from(result.score.max(0));
        let lost = |result: &GameResult| f64::from((-result.score).max(0));
        let minutes = |result: &GameResult| f64::from(result.periods) * CONTROL_PERIOD / 60.0;
        let seconds = |result: &GameResult| f64::from(result.periods) * CONTROL_PERIOD;
        let one = |_: &GameResult| 1.0;
        Self {
            opponent,
            win_rate: both.win_rate(),
            win_rate_ci95: both.win_rate_ci95(),
            goals_per_min: ratio(won, minutes),
            conceded_goals_per_min: ratio(lost, minutes),
            episode_length_s: ratio(seconds, one),
            hits_per_episode: ratio(|result| f64::from(result.hits), one),
            own_goal_fraction: ratio(|result| f64::from(u8::from(result.own_goal)), one),
            score,
        }
    }
}

/// Evaluation of a policy.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evaluation {
    /// Evaluation against each scripted player.
    pub opponents: Vec<OpponentEvaluation>,
    /// Elo table of the round robin, best first.
    pub elo: Vec<EloRow>,
}

/// Evaluate the policy of `run` with mean actions, as set in its evaluation settings.
///
/// # Errors
/// When a game reaches a non-finite state.
pub fn evaluate(run: &Run, threads: NonZeroUsize) -> Result<Evaluation, TrainError> {
    let settings = run.settings();
    let game = run.evaluation_game();
    let arena = Arena {
        game: &game,
        observations: settings.layout(),
        seed: settings.seed ^ EVALUATION_SEED,
        threads,
    };
    let learner = Opponent::Policy(Box::new(run.policy()), Choice::Mean);
    let games = settings.evaluation.games_per_opponent;
    let mut opponents = Vec::new();
    for script in Scripted::ALL.into_iter().filter(|_| 0 < games) {
        let games = arena.play(&[learner.clone(), Opponent::Scripted(script)], games)?;
        opponents.push(OpponentEvaluation::new(script.name().to_owned(), &games, arena.seed));
    }
    let mut players = vec![(LEARNER_NAME.to_owned(), learner)];
    players.extend(spread(run.pool(), settings.evaluation.pool_players));
    players.extend(Scripted::ALL.map(|s| (s.name().to_owned(), Opponent::Scripted(s))));
    let elo = round_robin(&arena, &players, settings.evaluation.games_per_pair)?;
    Ok(Evaluation { opponents, elo })
}

/// Offset of the evaluation seed, so that no evaluation game begins like a training game.
const EVALUATION_SEED: u64 = 0x6a75_6467_6500_0000;

/// At most `count` policies of the pool, evenly spaced from the oldest to the newest.
fn spread(pool: &Pool, count: usize) -> Vec<(String, Opponent)> {
    let members = pool.state.members.iter().zip(&pool.opponents);
    let policies: Vec<(String, Opponent)> = members
        .filter(|(_, opponent)| matches!(opponent, Opponent::Policy(..)))
        .map(|(member, opponent)| (member.name.clone(), opponent.clone()))
        .collect();
    if policies.len() <= count {
        return policies;
    }
    let last = policies.len() - 1;
    (0..count).map(|index| policies[index * last / (count - 1).max(1)].clone()).collect()
}

/// Round robin: every pair plays `games`, half of them from each seat. Ratings are updated game by
/// game: the first games of all pairs, then the second ones, and so on.
fn round_robin(
    arena: &Arena<'_>,
    players: &[(String, Opponent)],
    games: usize,
) -> Result<Vec<EloRow>, TrainError> {
    if games == 0 {
        return Ok(Vec::new());
    }
    let mut pairs = Vec::new();
    for a in 0..players.len() {
        for b in a + 1..players.len() {
            let both = [players[a].1.clone(), players[b].1.clone()];
            pairs.push(([a, b], arena.play(&both, games)?.results));
        }
    }
    let of_round = |round: usize| {
        pairs.iter().map(move |(players, results)| Played {
            players: *players,
            score: f64::midpoint(f64::from(results[round].score), 1.0),
        })
    };
    let played: Vec<Played> = (0..games).flat_map(of_round).collect();
    let names: Vec<String> = players.iter().map(|(name, _)| name.clone()).collect();
    Ok(elo::table(&names, &played, arena.seed))
}
