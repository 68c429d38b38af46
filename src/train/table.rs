//! Environments in play: observations and commands of both players.
//!
//! Shared by training and evaluation, so that a policy plays the same game in both.

use super::{
    environments::Environments,
    pool::{Opponent, Question},
};
use crate::{
    game::{
        GameError, GameSettings, Games, Observation, ObservationLayout, ObservedGames,
        ObservedState,
    },
    ppo::Scratch,
    recording::topic::Player,
};
use std::{borrow::Cow, ops::Range};

/// The opposite player.
pub(super) fn across(player: Player) -> Player {
    match player {
        Player::Left => Player::Right,
        Player::Right => Player::Left,
    }
}

/// Seat of the learner, or of the first of two players: left in environments of even number, right
/// in the others.
pub(crate) fn seat(board: usize) -> Player {
    if board.is_multiple_of(2) { Player::Left } else { Player::Right }
}

/// A range of environments with its buffers.
#[derive(Debug)]
pub(super) struct Tables<E: ?Sized = ObservedGames> {
    /// Number of the first environment.
    pub(super) first: usize,
    pub(super) observed: Box<E>,
    layout: ObservationLayout,
    /// Observations of left and right player, `[boards][width]`.
    seen: [Vec<f32>; 2],
    /// Commands by `[boards][left, right]` (m/s, each player's frame).
    pub(super) commands: Vec<[[f32; 2]; 2]>,
    /// Speed of a full action (m/s).
    pub(super) speed: f32,
    hand: Hand,
    pub(super) scratch: Scratch,
}

/// Buffers for the queries of one opponent.
#[derive(Debug, Default)]
struct Hand {
    /// Environments by opponent, then by number.
    order: Vec<u32>,
    boards: Vec<u32>,
    rows: Vec<f32>,
    velocities: Vec<[f32; 2]>,
    actions: Vec<f32>,
}

impl Tables<ObservedGames> {
    /// The environments `range`, at the start of their first episode.
    pub(super) fn new(
        range: Range<usize>,
        settings: &GameSettings,
        (layout, seed): (ObservationLayout, u64),
    ) -> Result<Self, GameError> {
        let observed = ObservedGames::new(Games::range(range.clone(), settings, seed)?);
        Ok(Self::over(Box::new(observed), range, settings, layout))
    }
}

impl<E: Environments + ?Sized> Tables<E> {
    /// The environments `range`, which are `observed`.
    pub(super) fn over(
        observed: Box<E>,
        range: Range<usize>,
        settings: &GameSettings,
        layout: ObservationLayout,
    ) -> Self {
        let count = range.len();
        let mut tables = Self {
            first: range.start,
            observed,
            layout,
            seen: [0, 1].map(|_player| vec![0.0; count * layout.len()]),
            commands: vec![[[0.0; 2]; 2]; count],
            speed: settings.limits.speed as f32,
            hand: Hand::default(),
            scratch: Scratch::default(),
        };
        tables.look();
        tables
    }

    /// Restore saved environments.
    pub(super) fn restore(&mut self, saved: &ObservedState) -> Result<(), GameError> {
        self.observed.restore(saved)?;
        self.look();
        Ok(())
    }

    pub(super) fn len(&self) -> usize {
        self.commands.len()
    }

    /// Seat of the first player in the `row`-th environment.
    pub(super) fn seat(&self, row: usize) -> Player {
        seat(self.first + row)
    }

    /// Observation of `player` in the `row`-th environment.
    pub(super) fn seen(&self, row: usize, player: Player) -> &[f32] {
        let width = self.layout.len();
        &self.seen[player as usize][row * width..(row + 1) * width]
    }

    /// Exact observation of `player` in the `row`-th environment, for rewards.
    pub(super) fn exact(&self, row: usize, player: Player) -> Observation {
        self.observed.exact(row, player)
    }

    /// Observations of the first players, `[boards][width]`.
    pub(super) fn copy_first_seats(&self, rows: &mut [f32]) {
        for (row, out) in rows.chunks_exact_mut(self.layout.len()).enumerate() {
            out.copy_from_slice(self.seen(row, self.seat(row)));
        }
    }

    /// Let opponents decide for the players given by `seat_of` in every environment; `drawn` is
    /// the index of the opponent in each environment, and `opponent_of` finds it.
    pub(super) fn ask<'a>(
        &mut self,
        opponent_of: &dyn Fn(u32) -> Cow<'a, Opponent>,
        drawn: &[u32],
        (seed, step): (u64, u64),
        seat_of: impl Fn(usize) -> Player,
    ) {
        let mut hand = std::mem::take(&mut self.hand);
        hand.order.clear();
        hand.order.extend(0..drawn.len() as u32);
        hand.order.sort_unstable_by_key(|row| (drawn[*row as usize], *row));
        let Hand { order, boards, rows, velocities, actions } = &mut hand;
        for group in order.chunk_by(|a, b| drawn[*a as usize] == drawn[*b as usize]) {
            boards.clear();
            rows.clear();
            for row in group.iter().map(|row| *row as usize) {
                boards.push((self.first + row) as u32);
                rows.extend_from_slice(self.seen(row, seat_of(row)));
            }
            velocities.resize(group.len(), [0.0; 2]);
            let opponent = opponent_of(drawn[group[0] as usize]);
            let question = Question { seed, step, boards, rows, speed: self.speed };
            opponent.decide(&question, velocities, (&mut self.scratch, actions));
            for (row, velocity) in group.iter().zip(velocities.iter()) {
                self.commands[*row as usize][seat_of(*row as usize) as usize] = *velocity;
            }
        }
        self.hand = hand;
    }

    /// Step all environments by one control period; environments whose episode has ended keep their
    /// final state.
    pub(super) fn advance(&mut self) -> Result<(), GameError> {
        self.observed.advance(&mut self.commands)?;
        self.look();
        Ok(())
    }

    /// Begin the next episode in environments whose episode has ended.
    pub(super) fn begin_ended(&mut self) -> Result<(), GameError> {
        self.observed.begin_ended()?;
        for row in 0..self.len() {
            if self.observed.outcomes().ended[row].is_some() {
                self.look_at(row);
            }
        }
        Ok(())
    }

    /// Observations of both players in one environment.
    fn look_at(&mut self, row: usize) {
        let width = self.layout.len();
        for player in Player::BOTH {
            let seen = &mut self.seen[player as usize][row * width..(row + 1) * width];
            self.observed.observe(row, player, self.layout, seen);
        }
    }

    fn look(&mut self) {
        (0..self.len()).for_each(|row| self.look_at(row));
    }
}
