//! Actuator models: from commands to motion, ideal, learned, or by the equations of a twin.
//!
//! Every actuator returns the path of each striker's magnet over one control period, as positions
//! at the ends of its pieces. It works in the player's own frame, so that one model serves both
//! seats: the right gantry is taken as a copy of the left one turned by 180 degrees.

mod learned;
mod twin;

use super::{
    body::{StrikerState, add, along, scale, subtract},
    error::{GameError, within},
    games::ActuatorQueries,
    settings::{CONTROL_PERIOD, CommandLimits, GameSettings, LimiterPlace},
};
use crate::{
    actuator::ActuatorNetwork, gantry::PerPlayer, gantry::Rectangle, twin::Machine, twin::Twin,
};
use learned::Learned;
use twin::TwinDrives;

/// Longest step of a twin's drives by default (s).
const TWIN_STEP: f64 = 2e-3;

/// Actuator model.
#[derive(Debug, Clone)]
pub enum Actuation {
    /// The velocity equals the command without delay.
    Ideal,
    /// A network fitted to recordings predicts the next velocity from the history of commands and
    /// velocities; the velocity is interpolated linearly between two samples.
    Learned(Box<ActuatorNetwork>),
    /// Drives, gantry and coupling of a twin, the same for both players.
    Twin {
        /// The twin with its effects.
        twin: Box<Twin>,
        /// Longest integration step (s); 0.002 by [`Actuation::twin`], at most 0.005.
        step: f64,
    },
}

impl Actuation {
    /// Actuator of the drives of `twin` with the default step.
    #[must_use]
    pub fn twin(twin: Twin) -> Self {
        Self::Twin { twin: Box::new(twin), step: TWIN_STEP }
    }

    /// Actuator of a fitted network.
    #[must_use]
    pub fn learned(model: ActuatorNetwork) -> Self {
        Self::Learned(Box::new(model))
    }

    /// Name: `ideal`, `learned` or `twin`.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Ideal => "ideal",
            Self::Learned(_) => "learned",
            Self::Twin { .. } => "twin",
        }
    }

    pub(super) fn check(&self, limiter: LimiterPlace) -> Result<(), GameError> {
        let Self::Twin { twin, step } = self else { return Ok(()) };
        if twin.machine != Machine::Table {
            return Err(GameError::NotATable { machine: twin.machine.to_string() });
        }
        if limiter == LimiterPlace::Motion {
            return Err(GameError::LimiterBehindTwin);
        }
        within("actuation.twin step_s", *step, 1e-5, 5e-3)
    }
}

/// Actuators of all environments with their state.
#[derive(Debug, Clone)]
pub(super) enum Actuators {
    Ideal,
    Learned(Box<Learned>),
    Twin(Box<TwinDrives>),
}

/// Input and output of the actuators for one chunk of environments.
pub(super) struct Leading<'a> {
    /// First environment of the chunk.
    pub(super) first: usize,
    /// Commands after all limits, board frame (m/s).
    pub(super) commands: &'a [[[f64; 2]; 2]],
    /// Strikers of the chunk.
    pub(super) strikers: &'a mut [[StrikerState; 2]],
    /// Positions of the magnets (m), `[board][player][piece + 1]`; the first is the current one.
    pub(super) ways: &'a mut [[f64; 2]],
    pub(super) travel: &'a Travel,
}

/// Parameters common to all actuators.
#[derive(Debug, Clone)]
pub(super) struct Travel {
    pub(super) limits: CommandLimits,
    /// Lower and upper limit of each player's carriage (m).
    pub(super) reach: [[[f64; 2]; 2]; 2],
    pub(super) pieces: usize,
}

impl Travel {
    /// Travel limits from the workspace and from the board, for strikers of `radius` (m); `half`
    /// are half of the board's sides (m).
    pub(super) fn new(limits: CommandLimits, half: [f64; 2], radius: f64, pieces: usize) -> Self {
        let PerPlayer { left, right } = limits.field;
        let reach = [left, right].map(|field: Rectangle| {
            let inside = |low: f64, high: f64, half: f64| {
                let edge = half - radius;
                [low.clamp(-edge, edge), high.clamp(-edge, edge)]
            };
            [
                inside(field.x_min_m, field.x_max_m, half[0]),
                inside(field.y_min_m, field.y_max_m, half[1]),
            ]
        });
        Self { limits, reach, pieces }
    }

    /// Length of a piece (s).
    pub(super) fn piece(&self) -> f64 {
        CONTROL_PERIOD / self.pieces as f64
    }

    /// Clamp `place` (m) to the travel of `player`.
    pub(super) fn clamp(&self, player: usize, place: [f64; 2]) -> [f64; 2] {
        let [[x_low, x_high], [y_low, y_high]] = self.reach[player];
        [place[0].clamp(x_low, x_high), place[1].clamp(y_low, y_high)]
    }

    /// Fill the path of a magnet whose velocity changes linearly from `start` to `end` (m/s), up to
    /// the end of its travel.
    fn roll(
        &self,
        player: usize,
        striker: &mut StrikerState,
        [start, end]: [[f64; 2]; 2],
        way: &mut [[f64; 2]],
    ) {
        let h = self.piece();
        let gain = scale(subtract(end, start), 0.5 / CONTROL_PERIOD);
        for (piece, place) in way.iter_mut().enumerate() {
            let time = piece as f64 * h;
            let free = along(along(striker.led, start, time), gain, time * time);
            *place = if piece == 0 { striker.led } else { self.clamp(player, free) };
        }
        let last = way[self.pieces];
        let free = along(striker.led, add(start, end), 0.5 * CONTROL_PERIOD);
        striker.led_velocity = [0, 1].map(|k| {
            // An axis at the end of its travel is at rest.
            if (last[k] - free[k]).abs() < 1e-12 { end[k] } else { 0.0 }
        });
        striker.led = last;
        striker.carriage = last;
    }
}

impl Actuators {
    /// Actuators of `count` environments.
    pub(super) fn new(settings: &GameSettings, travel: &Travel, count: usize) -> Self {
        match &settings.actuation {
            Actuation::Ideal => Self::Ideal,
            Actuation::Learned(model) => {
                Self::Learned(Box::new(Learned::new(model, settings.coverage.as_ref(), count)))
            }
            Actuation::Twin { twin, step } => {
                Self::Twin(Box::new(TwinDrives::new(twin, *step, travel, count)))
            }
        }
    }

    /// Put both carriages of `board` at rest at the positions of its strikers.
    pub(super) fn restart(&mut self, board: usize, strikers: &mut [StrikerState; 2]) {
        match self {
            Self::Ideal => {}
            Self::Learned(learned) => learned.restart(board),
            Self::Twin(drives) => drives.restart(board, strikers),
        }
    }

    pub(super) fn queries(&self) -> ActuatorQueries {
        match self {
            Self::Ideal | Self::Twin(_) => ActuatorQueries::default(),
            Self::Learned(learned) => learned.queries(),
        }
    }

    /// Move the strikers of one chunk through one control period.
    pub(super) fn lead(&mut self, leading: &mut Leading<'_>) {
        match self {
            Self::Ideal => lead_ideally(leading),
            Self::Learned(learned) => learned.lead(leading),
            Self::Twin(drives) => drives.lead(leading),
        }
    }
}

fn lead_ideally(leading: &mut Leading<'_>) {
    let stride = leading.travel.pieces + 1;
    let ways = leading.ways.chunks_exact_mut(2 * stride);
    for ((strikers, commands), ways) in leading.strikers.iter_mut().zip(leading.commands).zip(ways)
    {
        let each = strikers.iter_mut().zip(commands).zip(ways.chunks_exact_mut(stride));
        for (player, ((striker, command), way)) in each.enumerate() {
            leading.travel.roll(player, striker, [*command; 2], way);
        }
    }
}

/// Transform a vector between the board frame and the frame of `player`, in either direction.
pub(super) fn turned(player: usize, [x, y]: [f64; 2]) -> [f64; 2] {
    if player == 0 { [x, y] } else { [-x, -y] }
}
