//! Games between two players: a fixed number from each seat, one episode on each board.
//!
//! Every board plays exactly one episode, so long games count as much as short ones; upstream took the games
//! that finished first.

use super::{
    TrainError,
    pool::Opponent,
    table::{Tables, across, seat},
};
use crate::{
    game::{Asked, Ending, GameError, GameSettings, ObservationKind},
    ppo::for_each,
    recording::topic::Player,
    stats::{Interval, wilson_ci95},
};
use serde::{Deserialize, Serialize};
use std::num::NonZeroUsize;

/// Boards that are played at once by one thread.
const BLOCK: usize = 64;

/// What games have in common.
#[derive(Debug, Clone, Copy)]
pub struct Arena<'a> {
    /// The game; its time limit is that of the games.
    pub game: &'a GameSettings,
    /// What policies see.
    pub observations: ObservationKind,
    /// Starts of episodes come from it.
    pub seed: u64,
    /// Threads; results do not depend on them.
    pub threads: NonZeroUsize,
}

/// Outcomes of games from one seat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Count {
    /// Won by the first player.
    pub won: u64,
    /// Drawn: nobody won in time.
    pub drawn: u64,
    /// Lost.
    pub lost: u64,
}

/// Outcomes of the games of two players.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MatchScore {
    /// Of the first player on the left.
    pub left: Count,
    /// Of the first player on the right.
    pub right: Count,
}

impl Count {
    /// Games with a winner.
    #[must_use]
    pub fn decided(&self) -> u64 {
        self.won + self.lost
    }

    /// Share of the decided games that were won; `None` when none was decided.
    #[must_use]
    pub fn won_share(&self) -> Option<f64> {
        (0 < self.decided()).then(|| self.won as f64 / self.decided() as f64)
    }

    /// 95 % interval of that share.
    #[must_use]
    pub fn won_share_ci95(&self) -> Option<Interval> {
        wilson_ci95(self.won, self.decided())
    }
}

impl MatchScore {
    /// Both seats together.
    #[must_use]
    pub fn both(&self) -> Count {
        Count {
            won: self.left.won + self.right.won,
            drawn: self.left.drawn + self.right.drawn,
            lost: self.left.lost + self.right.lost,
        }
    }
}

/// One game, as the first player sees it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct GameResult {
    /// Won 1, drawn 0, lost -1.
    pub score: i8,
    /// Its length in control periods.
    pub periods: u32,
    /// Times that the first player's striker hit the ball.
    pub hits: u32,
}

/// The games, one of each board, and what the actuators were asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Games {
    /// Even boards: first player on the left; odd ones: on the right.
    pub results: Vec<GameResult>,
    /// All asked, those outside of the training data.
    pub asked: Asked,
}

impl Games {
    /// The outcomes by seat.
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

/// A range of boards for one thread.
struct Part<'a> {
    first: usize,
    results: &'a mut [GameResult],
    outcome: &'a mut Result<Asked, GameError>,
}

impl Arena<'_> {
    /// Plays `count` games between `players`.
    ///
    /// # Errors
    /// When the game refuses its settings or a number.
    pub fn play(&self, players: &[Opponent; 2], count: usize) -> Result<Games, TrainError> {
        let mut results = vec![GameResult::default(); count];
        let mut outcomes = vec![Ok(Asked::default()); count.div_ceil(BLOCK)];
        let parts = results.chunks_mut(BLOCK).zip(&mut outcomes).enumerate();
        let parts = parts
            .map(|(index, (results, outcome))| Part { first: index * BLOCK, results, outcome })
            .collect();
        for_each(self.threads, parts, |part: Part<'_>| {
            *part.outcome = self.play_part(players, part.first, part.results);
        });
        let mut asked = Asked::default();
        for outcome in outcomes {
            let Asked { all, outside } = outcome?;
            asked = Asked { all: asked.all + all, outside: asked.outside + outside };
        }
        Ok(Games { results, asked })
    }

    fn play_part(
        &self,
        players: &[Opponent; 2],
        first: usize,
        results: &mut [GameResult],
    ) -> Result<Asked, GameError> {
        let range = first..first + results.len();
        let mut tables = Tables::new(range, self.game, (self.observations, self.seed, || 0.0))?;
        let mut open = vec![true; results.len()];
        let [all_first, all_second] = [0, 1].map(|player| vec![player; results.len()]);
        for step in 0..u64::from(self.game.most_steps()) {
            let moment = (self.seed, step);
            tables.ask(players, &all_first, moment, |row| seat(first + row));
            tables.ask(players, &all_second, moment, |row| across(seat(first + row)));
            tables.advance()?;
            for (row, (result, open)) in results.iter_mut().zip(&mut open).enumerate() {
                if !*open {
                    continue;
                }
                let player = seat(first + row);
                result.periods += 1;
                result.hits += u32::from(tables.outcomes.hits[row][player as usize]);
                if let Some(ending) = tables.outcomes.ended[row] {
                    *open = false;
                    result.score = score_of(ending, player);
                }
            }
            if !open.contains(&true) {
                break;
            }
            tables.begin_ended()?;
        }
        Ok(tables.asked())
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
            observations: ObservationKind::Standard12,
            seed: 3,
            threads: NonZeroUsize::new(threads).unwrap(),
        };
        let players = [Scripted::Chaser, Scripted::Stationary].map(Opponent::Scripted);
        let games = arena(1).play(&players, 160).unwrap();
        assert_eq!(games, arena(2).play(&players, 160).unwrap());
        let score = games.score();
        for count in [score.left, score.right] {
            assert_eq!(count.won + count.drawn + count.lost, 80);
            assert!(0.8 < count.won_share().unwrap(), "{score:?}");
        }
        let [chaser, stationary] = players;
        let turned = arena(2).play(&[stationary, chaser], 160).unwrap().score().both();
        assert!(turned.won_share().unwrap() < 0.2, "{turned:?}");
    }
}
