//! Environments that training steps.

use crate::{
    game::{
        ActuatorQueries, ClockFn, GameError, Observation, ObservationLayout, ObservedGames,
        ObservedState, Outcomes, StepTimes,
    },
    recording::topic::Player,
};
use std::{fmt, ops::Range};

/// Environments with what their players know. A period of training is
/// [`advance`](Self::advance), then [`begin_ended`](Self::begin_ended).
pub trait Environments: fmt::Debug + Send {
    /// Step all environments by one control period; environments whose episode has ended keep their
    /// final state. `commands` are those of left and right player in every environment (m/s, each
    /// player's own frame).
    ///
    /// # Errors
    /// When an environment cannot go on.
    fn advance(&mut self, commands: &mut [[[f32; 2]; 2]]) -> Result<(), GameError>;

    /// Begin the next episode in environments whose episode has ended.
    ///
    /// # Errors
    /// When an environment cannot go on.
    fn begin_ended(&mut self) -> Result<(), GameError>;

    /// Outcomes of the last step.
    fn outcomes(&self) -> &Outcomes;

    /// Write the observation of `player` in the environment `board` into `row`, `[layout.len()]`.
    fn observe(&self, board: usize, player: Player, layout: ObservationLayout, row: &mut [f32]);

    /// Exact observation, for rewards.
    fn exact(&self, board: usize, player: Player) -> Observation;

    /// State for a checkpoint; `None` where it cannot be saved.
    fn save(&self) -> Option<ObservedState>;

    /// Restore a saved state.
    ///
    /// # Errors
    /// When `saved` is of another kind or has another number of environments.
    fn restore(&mut self, saved: &ObservedState) -> Result<(), GameError>;

    /// Queries of the actuator model so far.
    fn queries(&self) -> ActuatorQueries;

    /// Time spent in steps.
    fn spent(&self) -> StepTimes;
}

/// Builder of environments other than simulated games.
pub trait EnvironmentSource: fmt::Debug + Send + Sync {
    /// Build the environments `range` of all; `clock` measures the time of their steps.
    ///
    /// # Errors
    /// When they cannot be built.
    fn build(
        &self,
        range: Range<usize>,
        clock: ClockFn,
    ) -> Result<Box<dyn Environments>, GameError>;
}

impl Environments for ObservedGames {
    fn advance(&mut self, commands: &mut [[[f32; 2]; 2]]) -> Result<(), GameError> {
        self.advance(commands)
    }

    fn begin_ended(&mut self) -> Result<(), GameError> {
        self.begin_ended()
    }

    fn outcomes(&self) -> &Outcomes {
        self.outcomes()
    }

    fn observe(&self, board: usize, player: Player, layout: ObservationLayout, row: &mut [f32]) {
        self.observe(board, player, layout, row);
    }

    fn exact(&self, board: usize, player: Player) -> Observation {
        self.games().observation(board, player)
    }

    fn save(&self) -> Option<ObservedState> {
        Some(self.save())
    }

    fn restore(&mut self, saved: &ObservedState) -> Result<(), GameError> {
        self.restore(saved)
    }

    fn queries(&self) -> ActuatorQueries {
        self.games().queries()
    }

    fn spent(&self) -> StepTimes {
        self.games().spent()
    }
}
