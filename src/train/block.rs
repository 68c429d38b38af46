//! Rollout of a block of environments: decisions of learner and opponents, game steps, rewards.
//!
//! Blocks are the unit of work of the threads. They do not depend on the number of threads, and
//! each owns all state that it changes, so results do not depend on threads either.

use super::{
    curve::Tally,
    environments::Environments,
    pool::{GameResult, Pool, is_scripted, velocity_of},
    reward::{RewardSettings, ShapingForm, Step},
    table::{Tables, across},
};
use crate::{
    game::{ClockFn, Ending, GameError, ObservedState},
    opponent::shoot,
    ppo::{End, Learner, RolloutPart, RolloutStep, StepIndex},
};
use std::ops::Range;

/// Maximum number of environments in a block: their state and one network stay in the processor's
/// caches.
const MOST: usize = 256;
/// Minimum number of blocks, as long as each has 16 environments: work for that many threads.
const BLOCKS: usize = 16;
/// Minimum number of environments in a block: the row count of the matrix kernels.
const LEAST: usize = 16;

/// Ranges of the blocks of `environments` environments.
pub(super) fn ranges(environments: usize) -> Vec<Range<usize>> {
    let size = (environments / BLOCKS).clamp(LEAST, MOST);
    (0..environments).step_by(size).map(|first| first..(first + size).min(environments)).collect()
}

/// Data that all blocks share in one update.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scene<'a> {
    pub(super) learner: &'a Learner,
    pub(super) pool: &'a Pool,
    pub(super) reward: &'a RewardSettings,
    pub(super) seed: u64,
    /// Index of the first control period of the rollout, since training began.
    pub(super) first_step: u64,
    /// Total number of environments.
    pub(super) environments: usize,
    pub(super) clock: ClockFn,
}

/// A block of environments.
#[derive(Debug)]
pub(super) struct Block {
    pub(super) tables: Tables<dyn Environments>,
    /// Opponent in each environment.
    drawn: Vec<u32>,
    /// Return of the current episode in each environment.
    returns: Vec<f32>,
    /// Length of the current episode (control periods).
    lengths: Vec<u32>,
    /// Potential of the shaping in each environment; unused without one.
    potentials: Vec<f32>,
    pub(super) tally: Tally,
    finals: Finals,
}

/// State of a block's environments in the middle of their episodes.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct BlockState {
    /// As saved by [`Games::save`](crate::game::Games::save).
    #[prost(bytes = "vec", tag = "1")]
    pub(super) games: Vec<u8>,
    /// Opponent in each environment.
    #[prost(uint32, repeated, tag = "2")]
    pub(super) drawn: Vec<u32>,
    /// Return of the current episode in each environment.
    #[prost(float, repeated, tag = "3")]
    pub(super) returns: Vec<f32>,
    /// Length of the current episode (control periods).
    #[prost(uint32, repeated, tag = "4")]
    pub(super) lengths: Vec<u32>,
    /// As saved by [`Sensors::save`](crate::game::Sensors::save); empty without sensors.
    #[prost(bytes = "vec", tag = "5")]
    pub(super) sensors: Vec<u8>,
    /// Previous commands of left, then right players, all values of each environment.
    #[prost(float, repeated, tag = "6")]
    pub(super) previous_commands: Vec<f32>,
}

/// Last observations of truncated episodes.
#[derive(Debug, Default)]
struct Finals {
    boards: Vec<usize>,
    rows: Vec<f32>,
    values: Vec<f32>,
}

impl Block {
    /// New environments; the opponents of their first episodes are those of control period `step`.
    pub(super) fn new(tables: Tables<dyn Environments>, pool: &Pool, seed: u64, step: u64) -> Self {
        let count = tables.len();
        let drawn =
            (0..count).map(|row| pool.draw(seed, (tables.first + row) as u64, step)).collect();
        Self {
            drawn,
            returns: vec![0.0; count],
            lengths: vec![0; count],
            potentials: vec![0.0; count],
            tally: Tally::default(),
            finals: Finals::default(),
            tables,
        }
    }

    /// Restore the environments of `tables` from a checkpoint.
    pub(super) fn restore(
        mut tables: Tables<dyn Environments>,
        state: &BlockState,
    ) -> Result<Self, GameError> {
        let BlockState { games, sensors, previous_commands, .. } = state.clone();
        tables.restore(&ObservedState { games, sensors, previous_commands })?;
        for found in [state.drawn.len(), state.returns.len(), state.lengths.len()] {
            let (what, expected) = ("the environments of a checkpoint", tables.len());
            if found != expected {
                return Err(GameError::Shape { what, found, expected });
            }
        }
        let BlockState { drawn, returns, lengths, .. } = state.clone();
        let (tally, finals) = (Tally::default(), Finals::default());
        let potentials = vec![0.0; tables.len()];
        Ok(Self { drawn, returns, lengths, potentials, tally, finals, tables })
    }

    /// State of the environments for a checkpoint; `None` where it cannot be saved.
    pub(super) fn state(&self) -> Option<BlockState> {
        let ObservedState { games, sensors, previous_commands } = self.tables.observed.save()?;
        Some(BlockState {
            games,
            sensors,
            previous_commands,
            drawn: self.drawn.clone(),
            returns: self.returns.clone(),
            lengths: self.lengths.clone(),
        })
    }

    /// Remove the oldest `count` opponents; the oldest remaining one replaces them in running
    /// episodes.
    pub(super) fn forget_opponents(&mut self, count: usize) {
        self.drawn
            .iter_mut()
            .filter(|own| !is_scripted(**own))
            .for_each(|own| *own = own.saturating_sub(count as u32));
    }

    /// Play this block's part of the rollout. `last_values` receives the learner's values of the
    /// observations after the last step.
    pub(super) fn play(
        &mut self,
        scene: &Scene<'_>,
        part: RolloutPart<'_>,
        last_values: &mut [f32],
    ) -> Result<(), GameError> {
        let mut rows = Vec::new();
        self.weigh_states(scene, |_row| true);
        for (number, mut step) in part.steps.into_iter().enumerate() {
            let number = scene.first_step + number as u64;
            self.decide(scene, number, &mut step);
            self.tables.advance()?;
            self.pay(scene, number, &mut step);
            self.tables.begin_ended()?;
            self.weigh_states(scene, |ended| ended);
            rows.resize(step.observations.len(), 0.0);
        }
        self.tables.copy_first_seats(&mut rows);
        scene.learner.values(&rows, last_values, &mut self.tables.scratch);
        Ok(())
    }

    /// Compute the potentials of environments by whether their episode has ended in the last step.
    fn weigh_states(&mut self, scene: &Scene<'_>, chosen: impl Fn(bool) -> bool) {
        if scene.reward.form != ShapingForm::Potential {
            return;
        }
        for row in 0..self.tables.len() {
            if chosen(self.tables.observed.outcomes().ended[row].is_some()) {
                let seen = self.tables.exact(row, self.tables.seat(row));
                self.potentials[row] = scene.reward.closeness(&seen.0);
            }
        }
    }

    /// Choose the commands of learner and opponents.
    fn decide(&mut self, scene: &Scene<'_>, number: u64, step: &mut RolloutStep<'_>) {
        let begun = (scene.clock)();
        let tables = &mut self.tables;
        tables.copy_first_seats(step.observations);
        let place = StepIndex { step: number, first_environment: tables.first };
        scene.learner.act(place, step, &mut tables.scratch);
        for (row, action) in step.actions.chunks_exact(2).enumerate() {
            let seat = tables.seat(row);
            tables.commands[row][seat as usize] = velocity_of(action, tables.speed);
        }
        if scene.learner.imitates() {
            demonstrate(step, tables.speed);
        }
        let first = tables.first;
        let other = |row: usize| across(super::table::seat(first + row));
        tables.ask(&|drawn| scene.pool.opponent(drawn), &self.drawn, (scene.seed, number), other);
        self.tally.spent.policy += (scene.clock)() - begun;
    }

    /// Compute the rewards and ends of the last step.
    fn pay(&mut self, scene: &Scene<'_>, number: u64, step: &mut RolloutStep<'_>) {
        let transitions = number * scene.environments as u64;
        let left = scene.reward.shaping_left(transitions);
        let gamma = scene.learner.settings().gamma;
        self.finals.boards.clear();
        self.finals.rows.clear();
        for row in 0..self.tables.len() {
            let player = self.tables.seat(row);
            let seen = self.tables.exact(row, player);
            let outcomes = self.tables.observed.outcomes();
            let ended = outcomes.ended[row];
            let hit_speed = outcomes.hit_speeds[row][player as usize];
            let is_hit = outcomes.hits[row][player as usize];
            let potential = (self.potentials[row], gamma);
            let made = Step { seen: &seen.0, ended, player, hit_speed, potential };
            let reward = scene.reward.of_step(&made, left);
            if scene.reward.form == ShapingForm::Potential {
                self.potentials[row] = scene.reward.closeness(&seen.0);
            }
            step.rewards[row] = reward;
            step.ends[row] = match ended {
                None => End::Running,
                Some(Ending::TimeLimit) => End::Truncated,
                Some(_) => End::Terminal,
            };
            if step.ends[row] == End::Truncated {
                self.finals.boards.push(row);
                self.finals.rows.extend_from_slice(self.tables.seen(row, player));
            }
            self.returns[row] += reward;
            self.lengths[row] += 1;
            self.tally.hits += u64::from(is_hit);
            if let Some(ending) = ended {
                self.finish_episode(scene, (row, number), ending);
            }
        }
        self.value_finals(scene, step);
    }

    fn finish_episode(&mut self, scene: &Scene<'_>, (row, number): (usize, u64), ending: Ending) {
        let player = self.tables.seat(row);
        let score = match ending.winner() {
            Some(winner) if winner == player => 1,
            Some(_) => -1,
            None => 0,
        };
        self.tally.results.push(GameResult { opponent: self.drawn[row], score });
        self.tally.returns += f64::from(std::mem::take(&mut self.returns[row]));
        self.tally.episode_steps += u64::from(std::mem::take(&mut self.lengths[row]));
        self.tally.own_goals += u64::from(score < 0 && !matches!(ending, Ending::Goal { .. }));
        let board = (self.tables.first + row) as u64;
        self.drawn[row] = scene.pool.draw(scene.seed, board, number + 1);
    }

    fn value_finals(&mut self, scene: &Scene<'_>, step: &mut RolloutStep<'_>) {
        let Finals { boards, rows, values } = &mut self.finals;
        if boards.is_empty() {
            return;
        }
        let begun = (scene.clock)();
        values.resize(boards.len(), 0.0);
        scene.learner.values(rows, values, &mut self.tables.scratch);
        for (row, value) in boards.iter().zip(values.iter()) {
            step.final_values[*row] = *value;
        }
        self.tally.spent.policy += (scene.clock)() - begun;
    }
}

/// Write the actions of the scripted shooter for the observations of `step`.
fn demonstrate(step: &mut RolloutStep<'_>, speed: f32) {
    let width = step.observations.len() / step.values.len();
    let observations = step.observations.chunks_exact(width);
    for (seen, action) in observations.zip(step.demonstrations.chunks_exact_mut(2)) {
        action.copy_from_slice(&shoot(seen, speed).map(|component| component / speed));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_every_board_once_and_do_not_ask_for_threads() {
        for (environments, count, largest) in
            [(2, 1, 2), (40, 3, 16), (512, 16, 32), (4096, 16, 256), (16_384, 64, 256)]
        {
            let ranges = ranges(environments);
            assert_eq!(ranges.len(), count, "{environments}");
            assert_eq!(ranges.iter().map(Range::len).max(), Some(largest));
            let boards: Vec<usize> = ranges.into_iter().flatten().collect();
            assert_eq!(boards, (0..environments).collect::<Vec<_>>());
        }
    }
}
