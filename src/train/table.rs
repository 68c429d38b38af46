//! Environments in play: observations and commands of both players.
//!
//! Shared by training and evaluation, so that a policy plays the same game in both.

use super::pool::{Opponent, Question};
use crate::{
    game::{
        ActuatorQueries, ClockFn, GameError, GameSettings, Games, ObservationKind,
        ObservationLayout, Outcomes, PreviousCommands, Sensors,
    },
    ppo::Scratch,
    recording::topic::Player,
};
use std::ops::Range;

/// The opposite player.
pub(super) fn across(player: Player) -> Player {
    match player {
        Player::Left => Player::Right,
        Player::Right => Player::Left,
    }
}

/// Seat of the learner, or of the first of two players: left in environments of even number, right
/// in the others.
pub(super) fn seat(board: usize) -> Player {
    if board.is_multiple_of(2) { Player::Left } else { Player::Right }
}

/// Values that rewards are computed from.
const EXACT: ObservationKind = ObservationKind::Standard12;

/// A range of environments with its buffers.
#[derive(Debug)]
pub(super) struct Tables {
    /// Number of the first environment.
    pub(super) first: usize,
    pub(super) games: Games,
    pub(super) outcomes: Outcomes,
    /// Camera and estimator; `None` for exact observations.
    sensors: Option<Sensors>,
    /// Exact standard values of left and right player, `[boards][12]`, with sensors only.
    exact: [Vec<f32>; 2],
    layout: ObservationLayout,
    /// Previous commands of left and right player in every environment.
    previous: [Vec<PreviousCommands>; 2],
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

impl Tables {
    /// The environments `range`, at the start of their first episode.
    pub(super) fn new(
        range: Range<usize>,
        settings: &GameSettings,
        (layout, seed, clock): (ObservationLayout, u64, ClockFn),
    ) -> Result<Self, GameError> {
        let count = range.len();
        let mut games = Games::range(range.clone(), settings, seed)?;
        games.set_clock(clock);
        let sensors = settings
            .sensors
            .as_ref()
            .map(|sensors| Sensors::new(sensors, &games, (range.start, seed)));
        let exact = if sensors.is_some() { count * EXACT.len() } else { 0 };
        let mut tables = Self {
            first: range.start,
            sensors,
            exact: [vec![0.0; exact], vec![0.0; exact]],
            games,
            outcomes: Outcomes::new(count),
            layout,
            previous: [0, 1].map(|_player| vec![PreviousCommands::default(); count]),
            seen: [0, 1].map(|_player| vec![0.0; count * layout.len()]),
            commands: vec![[[0.0; 2]; 2]; count],
            speed: settings.limits.speed as f32,
            hand: Hand::default(),
            scratch: Scratch::default(),
        };
        tables.look();
        Ok(tables)
    }

    /// Restore saved environments, sensors and previous commands.
    pub(super) fn restore(
        &mut self,
        games: &[u8],
        sensors: &[u8],
        previous: &[f32],
    ) -> Result<(), GameError> {
        self.games.restore(games)?;
        let numbers: Vec<&mut f32> =
            self.previous.iter_mut().flatten().flat_map(PreviousCommands::values_mut).collect();
        let (what, expected) = ("the previous commands of a checkpoint", numbers.len());
        if previous.len() != expected {
            return Err(GameError::Shape { what, found: previous.len(), expected });
        }
        numbers.into_iter().zip(previous).for_each(|(own, saved)| *own = *saved);
        if let Some(own) = &mut self.sensors {
            own.restore(sensors, &self.games)?;
        }
        self.look();
        Ok(())
    }

    /// State of the sensors for a checkpoint; empty without sensors.
    pub(super) fn save_sensors(&self) -> Vec<u8> {
        self.sensors.as_ref().map_or_else(Vec::new, Sensors::save)
    }

    /// Previous commands of all environments for a checkpoint.
    pub(super) fn save_previous(&self) -> Vec<f32> {
        let mut all = self.previous.clone();
        all.iter_mut().flatten().flat_map(|own| own.values_mut().to_vec()).collect()
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

    /// Exact standard values of `player` in the `row`-th environment, for rewards.
    pub(super) fn exact(&self, row: usize, player: Player) -> &[f32] {
        if self.sensors.is_none() {
            return self.seen(row, player);
        }
        let width = EXACT.len();
        &self.exact[player as usize][row * width..(row + 1) * width]
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
        opponent_of: &dyn Fn(u32) -> &'a Opponent,
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
        if let Some(sensors) = &self.sensors {
            // As in a match at a table, nobody moves while the ball is not seen.
            for (row, commands) in self.commands.iter_mut().enumerate() {
                if !sensors.is_in_play(row) {
                    *commands = [[0.0; 2]; 2];
                }
            }
        }
        for (row, commands) in self.commands.iter().enumerate() {
            for (previous, command) in self.previous.iter_mut().zip(commands) {
                previous[row].push(*command);
            }
        }
        self.games.advance(&self.commands, &mut self.outcomes)?;
        if let Some(sensors) = &mut self.sensors {
            sensors.advance(&self.games);
        }
        self.look();
        Ok(())
    }

    /// Begin the next episode in environments whose episode has ended.
    pub(super) fn begin_ended(&mut self) -> Result<(), GameError> {
        self.games.restart_ended(&self.outcomes)?;
        for row in 0..self.len() {
            if self.outcomes.ended[row].is_none() {
                continue;
            }
            if let Some(sensors) = &mut self.sensors {
                sensors.begin(row, &self.games);
            }
            self.previous.iter_mut().for_each(|own| own[row] = PreviousCommands::default());
            self.look_at(row);
        }
        Ok(())
    }

    /// Queries of the actuator models in these environments.
    pub(super) fn queries(&self) -> ActuatorQueries {
        self.games.queries()
    }

    /// Observations of both players in one environment.
    fn look_at(&mut self, row: usize) {
        let (width, exact) = (self.layout.len(), EXACT.len());
        for player in Player::BOTH {
            let seen = &mut self.seen[player as usize][row * width..(row + 1) * width];
            let (state, commands) = seen.split_at_mut(self.layout.state.len());
            self.previous[player as usize][row].write(commands);
            let Some(sensors) = &self.sensors else {
                self.games.observe_board(row, player, self.layout.state, state);
                continue;
            };
            let cup_distance = self.games.settings().cup.distance as f32;
            sensors.observation(row, player).write(self.layout.state, cup_distance, state);
            let exact = &mut self.exact[player as usize][row * exact..(row + 1) * exact];
            self.games.observe_board(row, player, EXACT, exact);
        }
    }

    fn look(&mut self) {
        (0..self.len()).for_each(|row| self.look_at(row));
    }
}
