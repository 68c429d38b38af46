//! Errors of a plan, with the motion and the time in it.

use crate::{
    gantry::{BeltError, Pattern, RobotError, TrajectoryError},
    recording::topic::Player,
};
use std::fmt;

/// Motion of a plan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part {
    /// Move from the end of the last run, or from home, to the start of a run.
    Approach {
        /// Number of the run.
        run: u32,
    },
    /// Run of the plan.
    Run {
        /// Number of the run.
        run: u32,
        /// Pattern of the run.
        pattern: Pattern,
    },
    /// Move from the end of the last run to home.
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

/// Violation of a limit by a motion.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "the value and its limit, units in the names")]
pub enum Violation {
    /// Path too close to an edge.
    #[error(
        "the path is {edge_m:.4} m inside the workspace (negative: outside), less than \
         limits.tracking_margin_m {margin_m}; move, shorten or shrink the pattern"
    )]
    Position { edge_m: f64, margin_m: f64 },
    /// Stopping distance too long.
    #[error(
        "braking from there ends {edge_m:.4} m inside the workspace (negative: outside), less than \
         limits.tracking_margin_m {margin_m}; slow, shorten or shrink the pattern"
    )]
    Standstill { edge_m: f64, margin_m: f64 },
    /// Speed along one axis too high.
    #[error(
        "{speed_m_per_s:.4} m/s along one axis, more than limits.speed_m_per_s {limit_m_per_s}; lower speed_m_per_s"
    )]
    AxisSpeed { speed_m_per_s: f64, limit_m_per_s: f64 },
    /// Speed too high.
    #[error(
        "{speed_m_per_s:.4} m/s, more than limits.total_speed_m_per_s {limit_m_per_s}; lower speed_m_per_s"
    )]
    TotalSpeed { speed_m_per_s: f64, limit_m_per_s: f64 },
    /// Acceleration too high.
    #[error(
        "{slew_m_per_s2:.3} m/s^2 along one axis, more than limits.slew_m_per_s2 {limit_m_per_s2}; lower speed_m_per_s or the rate"
    )]
    Slew { slew_m_per_s2: f64, limit_m_per_s2: f64 },
    /// Motor speed not finite.
    #[error(
        "the motors would turn at {a_turns_per_s} and {b_turns_per_s} turns/s; correct belt_metres_per_turn"
    )]
    MotorSpeed { a_turns_per_s: f64, b_turns_per_s: f64 },
    /// Motion not at rest at its start or end.
    #[error(
        "it moves at {speed_m_per_s} m/s where it must be at rest; start and end with velocity 0"
    )]
    NotAtRest { speed_m_per_s: f64 },
}

/// Error of a plan.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// Invalid JSON.
    #[error("the plan is not valid: {0}")]
    Syntax(#[from] serde_json::Error),
    /// Number out of range.
    #[error("{name} is {value}; it must lie in {range}")]
    OutOfRange {
        /// Name of the number.
        name: String,
        /// Value given.
        value: f64,
        /// Allowed range.
        range: &'static str,
    },
    /// Empty plan.
    #[error("the plan has no run; give at least one pattern")]
    NoRun,
    /// Two runs with the same number.
    #[error("two runs have number {number}; give each run of a plan a number of its own")]
    NumberTwice {
        /// Number of the runs.
        number: u32,
    },
    /// No player to drive.
    #[error("no player is to be driven; give left, right or both")]
    NoPlayer,
    /// Player without drives in the robot file.
    #[error("the robot file has no drive of the {0} player; choose the other, or add its drives")]
    PlayerWithoutDrives(Player),
    /// Player given twice.
    #[error("the {0} player is given twice; give each player once")]
    PlayerTwice(Player),
    /// Invalid robot file.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// Invalid belt.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// Motion that cannot be generated.
    #[error("{part}, {player} player: {source}")]
    Trajectory {
        /// Motion.
        part: Part,
        /// Player.
        player: Player,
        /// Cause.
        source: Box<TrajectoryError>,
    },
    /// Motion that violates a limit.
    #[error("{part}, {player} player, {time_s:.2} s after its start: {violation}")]
    Violation {
        /// Motion.
        part: Part,
        /// Player.
        player: Player,
        /// Time since the start of the motion (s).
        time_s: f64,
        /// Violation.
        violation: Violation,
    },
}
