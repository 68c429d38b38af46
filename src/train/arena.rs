//! Evaluation games between two players: a fixed number from each seat, one episode per
//! environment.
//!
//! Each environment plays exactly one episode, so long games have the same weight as short ones;
//! upstream counted the games that finished first.

use super::{
    TrainError,
    pool::Opponent,
    table::{Tables, across, seat},
};
use crate::{
    game::{ActuatorQueries, Ending, GameError, GameSettings, ObservationLayout},
    ppo::for_each,
    recording::topic::Player,
    stats::{Interval, wilson_ci95},
};
use serde::{Deserialize, Serialize};
use std::{borrow::Cow, num::NonZeroUsize};

/// Number of environments that one thread steps together.
const BLOCK: usize = 64;

/// Settings shared by all games.
#[derive(Debug, Clone, Copy)]
pub struct Arena<'a> {
    /// The game, with the time limit of the evaluation.
    pub game: &'a GameSettings,
    /// Observations of policies.
    pub observations: ObservationLayout,
    /// Seed of the episode starts.
    pub seed: u64,
    /// Number of threads; results do not depend on it.
    pub threads: NonZeroUsize,
}

/// Outcomes of games from one seat, for the first player.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Count {
    /// Games won.
    pub won: u64,
    /// Games drawn: no winner within the time limit.
    pub drawn: u64,
    /// Games lost.
    pub lost: u64,
}

/// Outcomes of the games of two players, for the first one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MatchScore {
    /// Games in which the first player is left.
    pub left: Count,
    /// Games in which the first player is right.
    pub right: Count,
}

impl Count {
    /// Number of decided games (with a winner).
    #[must_use]
    pub fn decided(&self) -> u64 {
        self.won + self.lost
    }

    /// Win rate of decided games, 0 to 1; `None` without a decided game.
    #[must_use]
    pub fn win_rate(&self) -> Option<f64> {
        (0 < self.decided()).then(|| self.won as f64 / self.decided() as f64)
    }

    /// 95 % Wilson interval of the win rate.
    #[must_use]
    pub fn win_rate_ci95(&self) -> Option<Interval> {
        wilson_ci95(self.won, self.decided())
    }
}

impl MatchScore {
    /// Sum over both seats.
    #[must_use]
    pub fn both(&self) -> Count {
        Count {
            won: self.left.won + self.right.won,
            drawn: self.left.drawn + self.right.drawn,
            lost: self.left.lost + self.right.lost,
        }
    }
}

/// Result of one game for the first player.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GameResult {
    /// Score: 1 won, 0 drawn, -1 lost.
    pub score: i8,
    /// Length (control periods).
    pub periods: u32,
    /// Number of hits of the ball by the first player's striker.
    pub hits: u32,
    /// Lost by an own goal: striker over the own cup, or two biscuits on it.
    pub own_goal: bool,
}

/// Results of all games, and the queries of the actuator models.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Games {
    /// Results by environment; the first player is left in even ones, right in odd ones.
    pub results: Vec<GameResult>,
    /// Queries of the actuator models.
    pub queries: ActuatorQueries,
}

impl Games {
    /// Outcomes by seat.
    #[must_use]
    pub fn score(&self) -> MatchScore {
        let mut score = MatchScore { left: Count::default(), right: Count::default() };
        for (board, result) in self.results.iter().enumerate() {
            let count = match seat(board) {
                Player::Left => &mut score.left,
                Player::Right => &mut score.right,
            };
            match result.score {
                1 => count.won += 1,
                0 => count.drawn += 1,
                _ => count.lost += 1,
            }
        }
        score
    }
}

/// A range of environments for one thread.
struct Part<'a> {
    first: usize,
    results: &'a mut [GameResult],
    outcome: &'a mut Result<ActuatorQueries, GameError>,
}

impl Arena<'_> {
    /// Play `count` games between `players`.
    ///
    /// # Errors
    /// When the game rejects its settings or a value.
    pub fn play(&self, players: &[Opponent; 2], count: usize) -> Result<Games, TrainError> {
        let mut results = vec![GameResult::default(); count];
        let mut outcomes = vec![Ok(ActuatorQueries::default()); count.div_ceil(BLOCK)];
        let parts = results.chunks_mut(BLOCK).zip(&mut outcomes).enumerate();
        let parts = parts
            .map(|(index, (results, outcome))| Part { first: index * BLOCK, results, outcome })
            .collect();
        for_each(self.threads, parts, |part: Part<'_>| {
            *part.outcome = self.play_part(players, part.first, part.results);
        });
        let mut queries = ActuatorQueries::default();
        for outcome in outcomes {
            let part = outcome?;
            queries = ActuatorQueries {
                total: queries.total + part.total,
                extrapolated: queries.extrapolated + part.extrapolated,
            };
        }
        Ok(Games { results, queries })
    }

    fn play_part(
        &self,
        players: &[Opponent; 2],
        first: usize,
        results: &mut [GameResult],
    ) -> Result<ActuatorQueries, GameError> {
        let range = first..first + results.len();
        let mut tables = Tables::new(range, self.game, (self.observations, self.seed))?;
        let mut open = vec![true; results.len()];
        let [all_first, all_second] = [0, 1].map(|player| vec![player; results.len()]);
        for step in 0..u64::from(self.game.most_steps()) {
            let moment = (self.seed, step);
            let player = |index: u32| Cow::Borrowed(&players[index as usize]);
            tables.ask(&player, &all_first, moment, |row| seat(first + row));
            tables.ask(&player, &all_second, moment, |row| across(seat(first + row)));
            tables.advance()?;
            for (row, (result, open)) in results.iter_mut().zip(&mut open).enumerate() {
                if !*open {
                    continue;
                }
                let player = seat(first + row);
                result.periods += 1;
                let outcomes = tables.observed.outcomes();
                result.hits += u32::from(outcomes.hits[row][player as usize]);
                if let Some(ending) = outcomes.ended[row] {
                    *open = false;
                    result.score = score_of(ending, player);
                    result.own_goal = result.score < 0 && !matches!(ending, Ending::Goal { .. });
                }
            }
            if !open.contains(&true) {
                break;
            }
            tables.begin_ended()?;
        }
        Ok(tables.observed.games().queries())
    }
}

fn score_of(ending: Ending, player: Player) -> i8 {
    ending.winner().map_or(0, |winner| if winner == player { 1 } else { -1 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::opponent::Scripted;

    #[test]
    fn scripted_players_are_judged_alike_from_both_seats_and_on_any_threads() {
        let game = GameSettings::default();
        let arena = |threads| Arena {
            game: &game,
            observations: crate::game::ObservationKind::Standard12.into(),
            seed: 3,
            threads: NonZeroUsize::new(threads).unwrap(),
        };
        let players = [Scripted::Chaser, Scripted::Stationary].map(Opponent::Scripted);
        let games = arena(1).play(&players, 160).unwrap();
        assert_eq!(games, arena(2).play(&players, 160).unwrap());
        let score = games.score();
        for count in [score.left, score.right] {
            assert_eq!(count.won + count.drawn + count.lost, 80);
            assert!(0.8 < count.win_rate().unwrap(), "{score:?}");
        }
        let [chaser, stationary] = players;
        let turned = arena(2).play(&[stationary, chaser], 160).unwrap().score().both();
        assert!(turned.win_rate().unwrap() < 0.2, "{turned:?}");
    }
}
