//! Games with what their players know: observations, exact or through sensors, and their own
//! previous commands.
//!
//! Training, evaluation, simulated matches and the environments of the Python module step their
//! games here, so a policy plays under the same rules in all of them.

use super::{
    error::GameError,
    games::Games,
    observation::{Observation, ObservationLayout, PreviousCommands},
    outcome::Outcomes,
    sensing::Sensors,
};
use crate::recording::topic::Player;

/// Environments that are stepped together, with what their players know.
#[derive(Debug, Clone)]
pub struct ObservedGames {
    games: Games,
    outcomes: Outcomes,
    /// Camera and estimator; `None` for exact observations.
    sensors: Option<Sensors>,
    /// Previous commands of left and right player in every environment.
    previous: [Vec<PreviousCommands>; 2],
}

/// State of [`ObservedGames`] for a checkpoint.
#[derive(Debug, Clone, PartialEq)]
pub struct ObservedState {
    /// As saved by [`Games::save`].
    pub games: Vec<u8>,
    /// As saved by [`Sensors::save`]; empty without sensors.
    pub sensors: Vec<u8>,
    /// Previous commands of left, then right players, all values of each environment.
    pub previous_commands: Vec<f32>,
}

impl ObservedGames {
    /// `games` in their present state, observed through the sensors of their settings.
    #[must_use]
    pub fn new(games: Games) -> Self {
        let count = games.len();
        let sensors = games.settings().sensors;
        Self {
            sensors: sensors.map(|own| Sensors::new(&own, &games, games.origin())),
            outcomes: Outcomes::new(count),
            previous: [0, 1].map(|_player| vec![PreviousCommands::default(); count]),
            games,
        }
    }

    /// The games.
    #[must_use]
    pub fn games(&self) -> &Games {
        &self.games
    }

    /// Outcomes of the last step.
    #[must_use]
    pub fn outcomes(&self) -> &Outcomes {
        &self.outcomes
    }

    /// Step all environments by one control period; environments whose episode has ended keep their
    /// final state. `commands` are as in [`Games::advance`]. As in a match at a table, nobody moves
    /// while the ball is not seen: those commands become zero.
    ///
    /// # Errors
    /// As [`Games::advance`].
    pub fn advance(&mut self, commands: &mut [[[f32; 2]; 2]]) -> Result<(), GameError> {
        if let Some(sensors) = &self.sensors {
            for (board, commands) in commands.iter_mut().enumerate() {
                if !sensors.is_in_play(board) {
                    *commands = [[0.0; 2]; 2];
                }
            }
        }
        self.games.advance(commands, &mut self.outcomes)?;
        for (board, commands) in commands.iter().enumerate() {
            for (previous, command) in self.previous.iter_mut().zip(commands) {
                previous[board].push(*command);
            }
        }
        if let Some(sensors) = &mut self.sensors {
            sensors.advance(&self.games);
        }
        Ok(())
    }

    /// Begin the next episode in environments whose episode has ended.
    ///
    /// # Errors
    /// As [`Games::restart_ended`].
    pub fn begin_ended(&mut self) -> Result<(), GameError> {
        self.games.restart_ended(&self.outcomes)?;
        for board in 0..self.games.len() {
            let Some(ending) = self.outcomes.ended[board] else { continue };
            self.look_anew(board);
            if !self.games.is_continued(board, ending) {
                self.previous.iter_mut().for_each(|own| own[board] = PreviousCommands::default());
            }
        }
        Ok(())
    }

    /// Put the ball of `board` to `position` (m) with `velocity` (m/s), as [`Games::serve`]; the
    /// players go on.
    pub fn serve(&mut self, board: usize, position: [f64; 2], velocity: [f64; 2]) {
        self.games.serve(board, position, velocity);
        self.look_anew(board);
    }

    fn look_anew(&mut self, board: usize) {
        if let Some(sensors) = &mut self.sensors {
            sensors.begin(board, &self.games);
        }
    }

    /// Observation of `player` in the environment `board`.
    #[must_use]
    pub fn observation(&self, board: usize, player: Player) -> Observation {
        match &self.sensors {
            Some(sensors) => sensors.observation(board, player),
            None => self.games.observation(board, player),
        }
    }

    /// Previous commands of `player` in the environment `board`.
    #[must_use]
    pub fn previous(&self, board: usize, player: Player) -> &PreviousCommands {
        &self.previous[player as usize][board]
    }

    /// Write the observation of `player` in the environment `board` into `row`, `[layout.len()]`.
    pub fn observe(
        &self,
        board: usize,
        player: Player,
        layout: ObservationLayout,
        row: &mut [f32],
    ) {
        let cup_distance = self.games.settings().cup.distance as f32;
        let seen = self.observation(board, player);
        layout.write(&seen, self.previous(board, player), cup_distance, row);
    }

    /// State of all environments, for [`restore`](Self::restore).
    #[must_use]
    pub fn save(&self) -> ObservedState {
        let previous = self.previous.iter().flatten();
        ObservedState {
            games: self.games.save(),
            sensors: self.sensors.as_ref().map_or_else(Vec::new, Sensors::save),
            previous_commands: previous.flat_map(PreviousCommands::values).copied().collect(),
        }
    }

    /// Restore a state that games of the same settings have saved; they continue with identical
    /// results.
    ///
    /// # Errors
    /// When `saved` is of another kind or has another number of environments.
    pub fn restore(&mut self, saved: &ObservedState) -> Result<(), GameError> {
        self.games.restore(&saved.games)?;
        let numbers: Vec<&mut f32> =
            self.previous.iter_mut().flatten().flat_map(PreviousCommands::values_mut).collect();
        let (what, expected) = ("the previous commands of a checkpoint", numbers.len());
        let found = saved.previous_commands.len();
        if found != expected {
            return Err(GameError::Shape { what, found, expected });
        }
        numbers.into_iter().zip(&saved.previous_commands).for_each(|(own, saved)| *own = *saved);
        if let Some(sensors) = &mut self.sensors {
            sensors.restore(&saved.sensors, &self.games)?;
        }
        Ok(())
    }

    /// Measure the time of steps, as [`Games::set_clock`].
    pub fn set_clock(&mut self, clock: super::ClockFn) {
        self.games.set_clock(clock);
    }
}
