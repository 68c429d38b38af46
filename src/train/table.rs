//! Boards in play: what both players see, and what they are told to do.
//!
//! Shared by training and by evaluation, so that a policy meets the same game in both.

use super::pool::{Opponent, Question};
use crate::{
    game::{Asked, Clockwork, GameError, GameSettings, Games, ObservationKind, Outcomes},
    ppo::Scratch,
    recording::topic::Player,
};
use std::ops::Range;

/// The player across the board.
pub(super) fn across(player: Player) -> Player {
    match player {
        Player::Left => Player::Right,
        Player::Right => Player::Left,
    }
}

/// Where the learner, or the first of two players, sits: left on boards of even number, right on the others.
pub(super) fn seat(board: usize) -> Player {
    if board.is_multiple_of(2) { Player::Left } else { Player::Right }
}

/// A range of boards with its buffers.
#[derive(Debug)]
pub(super) struct Tables {
    /// Number of the first board.
    pub(super) first: usize,
    pub(super) games: Games,
    pub(super) outcomes: Outcomes,
    kind: ObservationKind,
    /// What left and right see, `[boards][width]`.
    seen: [Vec<f32>; 2],
    /// `[boards][left, right]` (m/s, each player's frame)
    pub(super) commands: Vec<[[f32; 2]; 2]>,
    /// Speed of a full action (m/s).
    pub(super) speed: f32,
    hand: Hand,
    pub(super) scratch: Scratch,
}

/// Buffers for the questions to one opponent.
#[derive(Debug, Default)]
struct Hand {
    /// Boards by opponent, then by number.
    order: Vec<u32>,
    boards: Vec<u32>,
    rows: Vec<f32>,
    velocities: Vec<[f32; 2]>,
    actions: Vec<f32>,
}

impl Tables {
    /// The boards `range`, at the start of their first episode.
    pub(super) fn new(
        range: Range<usize>,
        settings: &GameSettings,
        (kind, seed, clock): (ObservationKind, u64, Clockwork),
    ) -> Result<Self, GameError> {
        let count = range.len();
        let mut games = Games::range(range.clone(), settings, seed)?;
        games.lend_clock(clock);
        let mut tables = Self {
            first: range.start,
            games,
            outcomes: Outcomes::new(count),
            kind,
            seen: [vec![0.0; count * kind.len()], vec![0.0; count * kind.len()]],
            commands: vec![[[0.0; 2]; 2]; count],
            speed: settings.limits.speed as f32,
            hand: Hand::default(),
            scratch: Scratch::default(),
        };
        tables.look()?;
        Ok(tables)
    }

    /// Puts back boards that were kept.
    pub(super) fn restore(&mut self, games: &[u8]) -> Result<(), GameError> {
        self.games.restore(games)?;
        self.look()
    }

    pub(super) fn len(&self) -> usize {
        self.commands.len()
    }

    /// Where the first player sits on the `row`-th board.
    pub(super) fn seat(&self, row: usize) -> Player {
        seat(self.first + row)
    }

    /// What `player` sees of the `row`-th board.
    pub(super) fn seen(&self, row: usize, player: Player) -> &[f32] {
        let width = self.kind.len();
        &self.seen[player as usize][row * width..(row + 1) * width]
    }

    /// What the first players see, `[boards][width]`.
    pub(super) fn copy_first_seats(&self, rows: &mut [f32]) {
        for (row, out) in rows.chunks_exact_mut(self.kind.len()).enumerate() {
            out.copy_from_slice(self.seen(row, self.seat(row)));
        }
    }

    /// Lets `opponents` decide for the players that `seat_of` names on every board; `drawn` says which of
    /// them plays there.
    pub(super) fn ask(
        &mut self,
        opponents: &[Opponent],
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
            let opponent = &opponents[drawn[group[0] as usize] as usize];
            let question = Question { seed, step, boards, rows, speed: self.speed };
            opponent.decide(&question, velocities, (&mut self.scratch, actions));
            for (row, velocity) in group.iter().zip(velocities.iter()) {
                self.commands[*row as usize][seat_of(*row as usize) as usize] = *velocity;
            }
        }
        self.hand = hand;
    }

    /// Plays one control period; boards whose episode has ended stand as it ended.
    pub(super) fn advance(&mut self) -> Result<(), GameError> {
        self.games.advance(&self.commands, &mut self.outcomes)?;
        self.look()
    }

    /// Begins the next episode where one has ended.
    pub(super) fn begin_ended(&mut self) -> Result<(), GameError> {
        self.games.restart_ended(&self.outcomes)?;
        let width = self.kind.len();
        for row in (0..self.len()).filter(|row| self.outcomes.ended[*row].is_some()) {
            for player in Player::BOTH {
                let seen = &mut self.seen[player as usize][row * width..(row + 1) * width];
                self.games.observe_board(row, player, self.kind, seen);
            }
        }
        Ok(())
    }

    /// What the actuators were asked on these boards.
    pub(super) fn asked(&self) -> Asked {
        self.games.asked()
    }

    fn look(&mut self) -> Result<(), GameError> {
        for player in Player::BOTH {
            self.games.observe(player, self.kind, &mut self.seen[player as usize])?;
        }
        Ok(())
    }
}
