//! Match in a training simulation, recorded like one at a table.
//!
//! Simulation and table are comparable only under equal conditions. A simulated match therefore
//! takes its serves, and the waiting times before them, from a rig file. Both recordings are scored
//! by the same [`referee`](crate::referee), which also calls own goals: a striker that passes over its own cup
//! ends no episode here, nor on the virtual rig. The physics is that of the simulation alone.

use super::{PlayError, Seat, pilot::scripted_speed};
use crate::{
    game::{CONTROL_PERIOD, GameSettings, Games, ObservedGames, StrikerOverCup},
    gantry::Robot,
    opponent,
    ppo::Scratch,
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
        topic::{BOARD_STATE, Player},
    },
    rig::{RigConfig, Serves},
    units::Nanos,
};
use std::{collections::BTreeMap, path::Path};

/// Longest episode of a simulated match (s): none ends by itself.
const NO_LIMIT_S: f64 = 3600.0;

/// Speed below which the ball counts as at rest (m/s), as on the rig.
const STILL_SPEED: f64 = 0.005;

/// Goals of a simulated match by the scorer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct SimulatedGoals {
    /// Points of the left player.
    pub left: u32,
    /// Points of the right player.
    pub right: u32,
}

/// A match of two players in a simulation.
pub struct SimulatedMatch {
    seats: [Seat; 2],
    observed: ObservedGames,
    serves: Serves,
    /// Control periods between the end of an episode and the next serve.
    pause: usize,
    /// Control periods at rest before the next serve; `None` for never.
    patience: Option<usize>,
    seed: u64,
    speed: f32,
    scratch: Scratch,
}

impl SimulatedMatch {
    /// Match of `seats`, left first, in `game`. Serves and waiting times are those of `rig`, the
    /// home points those of `robot`; `seed` is that of the random player.
    ///
    /// # Errors
    /// When a seat is empty, or a setting of the game is outside its range.
    pub fn new(
        seats: [Option<Seat>; 2],
        game: &GameSettings,
        (robot, rig): (&Robot, &RigConfig),
        seed: u64,
    ) -> Result<Self, PlayError> {
        let [Some(left), Some(right)] = seats else { return Err(PlayError::EmptySeat) };
        let mut game = game.clone();
        game.episode.time_limit = NO_LIMIT_S;
        game.episode.still_limit = NO_LIMIT_S;
        game.cup.striker = StrikerOverCup::Passes;
        let mut serves = Serves::new(&rig.ball, rig.seed);
        let [ball, velocity] = serves.next().ok_or(PlayError::NoServe)?;
        let mut games = Games::new(1, &game, seed)?;
        let home =
            Player::BOTH.map(|player| [robot.home.of(player).x_m, robot.home.of(player).y_m]);
        games.set_positions(0, ball, velocity, home);
        let periods = |seconds: f64| (seconds / CONTROL_PERIOD).round() as usize;
        let still = rig.ball.put_back_still_after_s;
        Ok(Self {
            speed: scripted_speed(&game.limits, robot),
            seats: [left, right],
            pause: periods(rig.ball.put_back_after_s),
            patience: (0.0 < still).then(|| periods(still)),
            serves,
            observed: ObservedGames::new(games),
            seed,
            scratch: Scratch::default(),
        })
    }

    /// Play for `seconds` and record the true state of every control period as `/board/state`.
    ///
    /// # Errors
    /// When the file cannot be written, or the game reaches a state that is not finite.
    pub fn record(
        &mut self,
        seconds: f64,
        metadata: BTreeMap<String, String>,
        (path, existing): (&Path, ExistingFile),
    ) -> Result<SimulatedGoals, PlayError> {
        let mut writer = RecordingWriter::create(path, existing, FlushPolicy::WhenFull)?;
        writer.metadata(RECORDING_METADATA, metadata)?;
        let mut goals = SimulatedGoals::default();
        let (mut waiting, mut still) = (None, 0);
        for step in 0..(seconds / CONTROL_PERIOD).round() as u64 {
            self.write(step, &mut writer)?;
            if let Some(left) = waiting.take() {
                match left {
                    0 => self.serve(),
                    _ => waiting = Some(left - 1),
                }
                continue;
            }
            self.step(step)?;
            let [vx, vy] = self.observed.games().snapshot(0).ball_velocity;
            still = if vx.hypot(vy) < STILL_SPEED { still + 1 } else { 0 };
            if let Some(ending) = self.observed.outcomes().ended[0] {
                match ending.winner() {
                    Some(Player::Left) => goals.left += 1,
                    Some(Player::Right) => goals.right += 1,
                    None => {}
                }
                (waiting, still) = (Some(self.pause), 0);
            } else if self.patience.is_some_and(|patience| patience <= still) {
                self.serve();
                still = 0;
            }
        }
        writer.finish()?;
        Ok(goals)
    }

    fn write(&self, step: u64, writer: &mut RecordingWriter) -> Result<(), RecordingError> {
        let period_ns = (CONTROL_PERIOD * 1e9) as u64;
        writer.write(
            BOARD_STATE,
            Nanos(step * period_ns),
            &self.observed.games().snapshot(0).message(),
        )
    }

    /// Put the ball back to its next start.
    fn serve(&mut self) {
        if let Some([ball, velocity]) = self.serves.next() {
            self.observed.serve(0, ball, velocity);
        }
    }

    fn step(&mut self, step: u64) -> Result<(), PlayError> {
        let mut commands = [[0.0; 2]; 2];
        for (player, command) in Player::BOTH.into_iter().zip(&mut commands) {
            let seen = self.observed.observation(0, player);
            *command = match &self.seats[player as usize] {
                Seat::Scripted(script) => {
                    let moment = opponent::Moment { seed: self.seed, board: player as u64, step };
                    script.velocity(&seen.0, moment, self.speed)
                }
                Seat::Policy { policy, .. } => {
                    policy.velocity(&seen, self.observed.previous(0, player), &mut self.scratch)
                }
            };
        }
        Ok(self.observed.advance(&mut [commands])?)
    }
}
