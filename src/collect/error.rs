//! Why a plan cannot be driven, and where in it.

use crate::{
    gantry::{BeltError, Pattern, RobotError, TrajectoryError},
    recording::topic::Player,
};
use std::fmt;

/// Which motion of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// From where the last run ended, or home, to the start of a run.
    Approach {
        /// Which run.
        run: u32,
    },
    /// The run itself.
    Run {
        /// Which run.
        run: u32,
        /// What is driven.
        pattern: Pattern,
    },
    /// From the end of the last run home.
    Home,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Approach { run } => write!(f, "the move to the start of run {run}"),
            Self::Run { run, pattern } => write!(f, "run {run} ({pattern})"),
            Self::Home => f.write_str("the move home"),
        }
    }
}

/// A limit that a motion passes.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the value and its limit, units in the names")]
pub enum Breach {
    /// The path itself comes too near an edge.
    #[error(
        "the path is {edge_m:.4} m inside the window (negative: outside), less than \
         limits.tracking_margin_m {margin_m}; move, shorten or shrink the pattern"
    )]
    Position { edge_m: f64, margin_m: f64 },
    /// It could not stop in time.
    #[error(
        "braking from there ends {edge_m:.4} m inside the window (negative: outside), less than \
         limits.tracking_margin_m {margin_m}; slow, shorten or shrink the pattern"
    )]
    Standstill { edge_m: f64, margin_m: f64 },
    /// Too fast along one axis.
    #[error(
        "{speed_m_per_s:.4} m/s along one axis, more than limits.speed_m_per_s {limit_m_per_s}; lower speed_m_per_s"
    )]
    AxisSpeed { speed_m_per_s: f64, limit_m_per_s: f64 },
    /// Too fast.
    #[error(
        "{speed_m_per_s:.4} m/s, more than limits.total_speed_m_per_s {limit_m_per_s}; lower speed_m_per_s"
    )]
    TotalSpeed { speed_m_per_s: f64, limit_m_per_s: f64 },
    /// Too abrupt.
    #[error(
        "{slew_m_per_s2:.3} m/s^2 along one axis, more than limits.slew_m_per_s2 {limit_m_per_s2}; lower speed_m_per_s or the rate"
    )]
    Slew { slew_m_per_s2: f64, limit_m_per_s2: f64 },
    /// A motor speed that is no number.
    #[error(
        "the motors would turn at {a_turns_per_s} and {b_turns_per_s} turns/s; correct belt_metres_per_turn"
    )]
    MotorSpeed { a_turns_per_s: f64, b_turns_per_s: f64 },
    /// It does not begin and end at rest.
    #[error("it moves at {speed_m_per_s} m/s where it must rest; begin and end with velocity 0")]
    NotAtRest { speed_m_per_s: f64 },
}

/// Why a plan cannot be driven.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// It is no JSON of this form.
    #[error("the plan is not understood: {0}")]
    Syntax(#[from] serde_json::Error),
    /// A number out of its range.
    #[error("{name} is {value}; it must lie in {range}")]
    OutOfRange {
        /// Which.
        name: String,
        /// What was given.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// It is empty.
    #[error("the plan has no run; give at least one pattern")]
    NoRun,
    /// One number for two runs.
    #[error("two runs have number {number}; give each run of a plan a number of its own")]
    NumberTwice {
        /// Which.
        number: u32,
    },
    /// Nobody to drive.
    #[error("no player is to be driven; name left, right or both")]
    NoPlayer,
    /// Not a player of this robot.
    #[error("the robot file has no drive of the {0} player; choose the other, or add its drives")]
    PlayerWithoutDrives(Player),
    /// A player twice.
    #[error("the {0} player is named twice; name each player once")]
    PlayerTwice(Player),
    /// The robot file.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The belt.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// A motion cannot be made.
    #[error("{part}, {player} player: {source}")]
    Trajectory {
        /// Which motion.
        part: Part,
        /// Whose.
        player: Player,
        /// Why.
        source: Box<TrajectoryError>,
    },
    /// A motion passes a limit.
    #[error("{part}, {player} player, {time_s:.2} s after its start: {breach}")]
    Breach {
        /// Which motion.
        part: Part,
        /// Whose.
        player: Player,
        /// When in it (s).
        time_s: f64,
        /// What.
        breach: Breach,
    },
}
