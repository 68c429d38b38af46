//! How good a policy is: games against the scripted players, and a round robin with earlier policies.

use super::{
    Arena, MatchScore, TrainError,
    elo::{self, EloRow, Played},
    pool::{Choice, Opponent, Pool},
    run::Run,
};
use crate::{opponent::Scripted, stats::Interval};
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
    let arena = Arena {
        game: run.game(),
        observations: settings.observations,
        seed: settings.seed ^ JUDGE_SEED,
        threads,
    };
    let learner = Opponent::Policy(Box::new(run.policy()), Choice::Mean);
    let games = settings.evaluation.games_per_opponent;
    let mut opponents = Vec::new();
    for script in Scripted::ALL.into_iter().filter(|_| 0 < games) {
        let score = arena.play(&[learner.clone(), Opponent::Scripted(script)], games)?.score();
        let both = score.both();
        opponents.push(Judged {
            opponent: script.name().to_owned(),
            won_share: both.won_share(),
            won_share_ci95: both.won_share_ci95(),
            score,
        });
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
            pairs.push(([a, b], arena.play(&both, games)?.scores));
        }
    }
    let of_round = |round: usize| {
        pairs.iter().map(move |(players, scores)| Played {
            players: *players,
            score: f64::midpoint(f64::from(scores[round]), 1.0),
        })
    };
    let played: Vec<Played> = (0..games).flat_map(of_round).collect();
    let names: Vec<String> = players.iter().map(|(name, _)| name.clone()).collect();
    Ok(elo::table(&names, &played, arena.seed))
}
