//! Sample games, stored step by step.

use super::{
    TrainError,
    pool::Opponent,
    table::{Tables, across, seat},
};
use crate::{
    game::{Ending, GameSettings, ObservationLayout, Snapshot, turned},
    recording::topic::Player,
};
use std::borrow::Cow;

/// One step of a game.
#[derive(Debug, Clone)]
pub struct Moment {
    /// State before the commands take effect.
    pub board: Snapshot,
    /// Commands of left and right (m/s, board frame).
    pub commands: [[f64; 2]; 2],
}

/// A complete game.
#[derive(Debug, Clone)]
pub struct SampleGame {
    /// Seat of the first player.
    pub seat: Player,
    /// Steps of the game; the last one has no commands.
    pub moments: Vec<Moment>,
    /// End of the game.
    pub ending: Ending,
}

/// Play the games 0 to `count` between `players`; the seats alternate.
///
/// # Errors
/// When a game reaches a non-finite state.
pub fn play_samples(
    (game, observations): (&GameSettings, ObservationLayout),
    players: &[Opponent; 2],
    (count, seed): (usize, u64),
) -> Result<Vec<SampleGame>, TrainError> {
    (0..count).map(|number| play_one((game, observations), players, (number, seed))).collect()
}

fn play_one(
    (game, observations): (&GameSettings, ObservationLayout),
    players: &[Opponent; 2],
    (number, seed): (usize, u64),
) -> Result<SampleGame, TrainError> {
    let mut tables = Tables::new(number..number + 1, game, (observations, seed))?;
    let own = seat(number);
    let mut moments = Vec::new();
    for step in 0.. {
        let player = |index: u32| Cow::Borrowed(&players[index as usize]);
        tables.ask(&player, &[0], (seed, step), |_row| own);
        tables.ask(&player, &[1], (seed, step), |_row| across(own));
        let commands = Player::BOTH
            .map(|player| turned(player, tables.commands[0][player as usize].map(f64::from)));
        moments.push(Moment { board: tables.observed.games().snapshot(0), commands });
        tables.advance()?;
        if let Some(ending) = tables.observed.outcomes().ended[0] {
            moments.push(Moment {
                board: tables.observed.games().snapshot(0),
                commands: [[0.0; 2]; 2],
            });
            return Ok(SampleGame { seat: own, moments, ending });
        }
    }
    unreachable!("a game has a time limit")
}
