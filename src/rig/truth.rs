//! Ground truth of the rig, which a simulator knows and hardware does not.

use crate::{
    can::{AxisErrors, AxisState},
    recording::{
        message::{BoardState, ObjectState},
        topic::Player,
    },
    units::Nanos,
};

/// Position and velocity in the board frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Across (m).
    pub x: f64,
    /// From goal to goal (m).
    pub y: f64,
    /// Across (m/s).
    pub vx: f64,
    /// From goal to goal (m/s).
    pub vy: f64,
}

impl Body {
    pub(super) fn new([x, y]: [f64; 2], [vx, vy]: [f64; 2]) -> Self {
        Self { x, y, vx, vy }
    }

    /// Speed (m/s).
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.vx.hypot(self.vy)
    }
}

/// Carriage and striker of one player.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlayerTruth {
    /// The magnet on the carriage under the board.
    pub carriage: Body,
    /// The striker on the board.
    pub peg: Body,
    /// True if the magnet couples to the striker.
    pub coupled: bool,
}

/// One drive and its motor, in the motor's own direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveTruth {
    /// Node id.
    pub node: u8,
    /// State of the axis.
    pub state: AxisState,
    /// Error flags.
    pub errors: AxisErrors,
    /// Turns since the start.
    pub position_turns: f64,
    /// Speed (turn/s).
    pub velocity_turns_per_s: f64,
    /// Torque of the motor (N m).
    pub torque_newton_metres: f64,
    /// Temperature of the power stage (C).
    pub fet_celsius: f64,
}

/// Bounces of the ball off one striker; a ball that is pushed does not bounce.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Hits {
    /// Number since the start.
    pub count: u32,
    /// Closing speed of the newest one (m/s).
    pub newest_m_per_s: f64,
}

/// Everything at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Truth {
    /// Time of the sample.
    pub time: Nanos,
    /// The player who owns y < 0.
    pub left: PlayerTruth,
    /// The player who owns y > 0.
    pub right: PlayerTruth,
    /// The ball, if there is one.
    pub ball: Option<Body>,
    /// Number of balls in the cup of y < 0 and of y > 0.
    pub goals: [u32; 2],
    /// Number of times that the ball was put on the board, including the first.
    pub serves: u32,
    /// Bounces of the ball off the strikers, left first.
    pub hits: [Hits; 2],
    /// The drives in the order of the configuration.
    pub drives: Vec<DriveTruth>,
}

impl Truth {
    /// Ball and strikers on the board, as a message.
    #[must_use]
    pub fn board_state(&self) -> BoardState {
        let state = |Body { x, y, vx, vy }: Body| ObjectState { x, y, vx, vy };
        BoardState {
            ball: self.ball.map(state),
            left: Some(state(self.left.peg)),
            right: Some(state(self.right.peg)),
            status: 0,
        }
    }

    /// Ground truth of `player`.
    #[must_use]
    pub fn player(&self, player: Player) -> &PlayerTruth {
        match player {
            Player::Left => &self.left,
            Player::Right => &self.right,
        }
    }
}
