//! Gantry under the board: two motors, one belt and one carriage for each player.
//!
//! [`CoreXy`] implements the forward and inverse kinematics. [`MotorSeat`] assigns a drive to a
//! motor of a player, with its sign. [`Robot`] is the robot file with its limits. [`Pattern`] is an
//! excitation and [`Reference`] the commanded motion of one run.
//!
//! ```
//! use klasktron::gantry::CoreXy;
//! let gantry = CoreXy::default();
//! let turns = gantry.motors_from_board([0.4, 0.0]); // 0.4 m/s across
//! assert_eq!([turns.a, turns.b], [10.0, 10.0]);
//! assert_eq!(gantry.board_from_motors(turns), [0.4, 0.0]);
//! ```

mod kinematics;
mod limits;
mod reports;
mod robot;
mod trajectory;

pub use kinematics::{
    BELT_METRES_PER_TURN, BeltError, CoreXy, KLASKTRON_SEATS, MotorPair, MotorSeat, belts, rails,
};
pub use limits::{Limits, Rectangle};
pub use reports::{DriveHealth, DriveReport, DriveReports, MOST_PAIR_SECONDS};
pub use robot::{
    BoardEntry, BusConfig, CyclicPeriods, PerPlayer, Point, Robot, RobotError, Timeouts,
};
pub use trajectory::{
    Heading, Pattern, Reference, Sampling, Setpoint, Slope, TRANSFER_SLACK_M, TrajectoryError, Turn,
};
