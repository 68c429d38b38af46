//! How good a policy is: games against the scripted players, and a round robin with earlier policies.

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

/// Name of the judged policy in tables.
pub const LEARNER_NAME: &str = "learner";

/// Games against one opponent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Judged {
    /// Who.
    pub opponent: String,
    /// The outcomes by the policy's seat.
    pub score: MatchScore,
    /// Share of the decided games that the policy won.
    pub won_share: Option<f64>,
    /// Its 95 % interval (Wilson).
    pub won_share_ci95: Option<Interval>,
    /// Points of the policy per minute of play.
    pub scored_per_min: Estimate,
    /// Points of the opponent per minute of play.
    pub conceded_per_min: Estimate,
    /// Length of a game (s); one that nobody wins counts with its limit.
    pub episode_length_s: Estimate,
    /// Hits of the ball by the policy in a game.
    pub hits_per_episode: Estimate,
}

/// A figure over games.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Over all games.
    pub mean: f64,
    /// Its 95 % interval (bootstrap over games).
    pub ci95: Option<Interval>,
}

impl Judged {
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
            won_share: both.won_share(),
            won_share_ci95: both.won_share_ci95(),
            scored_per_min: ratio(won, minutes),
            conceded_per_min: ratio(lost, minutes),
            episode_length_s: ratio(seconds, one),
            hits_per_episode: ratio(|result| f64::from(result.hits), one),
            score,
        }
    }
}

/// All of it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Against each scripted player.
    pub opponents: Vec<Judged>,
    /// The round robin, best first.
    pub elo: Vec<EloRow>,
}

/// Judges the policy of `run` by its means, as its settings say.
///
/// # Errors
/// When a game leaves the range of numbers.
pub fn judge(run: &Run, threads: NonZeroUsize) -> Result<Verdict, TrainError> {
    let settings = run.settings();
    let game = run.judging_game();
    let arena = Arena {
        game: &game,
        observations: settings.observations,
        seed: settings.seed ^ JUDGE_SEED,
        threads,
    };
    let learner = Opponent::Policy(Box::new(run.policy()), Choice::Mean);
    let games = settings.evaluation.games_per_opponent;
    let mut opponents = Vec::new();
    for script in Scripted::ALL.into_iter().filter(|_| 0 < games) {
        let games = arena.play(&[learner.clone(), Opponent::Scripted(script)], games)?;
        opponents.push(Judged::new(script.name().to_owned(), &games, arena.seed));
    }
    let mut players = vec![(LEARNER_NAME.to_owned(), learner)];
    players.extend(spread(run.pool(), settings.evaluation.pool_players));
    players.extend(Scripted::ALL.map(|s| (s.name().to_owned(), Opponent::Scripted(s))));
    let elo = round_robin(&arena, &players, settings.evaluation.games_per_pair)?;
    Ok(Verdict { opponents, elo })
}

/// So that no game of the judgement begins like one of training.
const JUDGE_SEED: u64 = 0x6a75_6467_6500_0000;

/// At most `count` policies of the pool, evenly spread from the oldest to the newest.
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

/// Every pair plays `games`, half of them from each seat; rated game by game, the first of all pairs, then
/// the second.
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
