//! Matches: policies and scripted players on a table, real or virtual.
//!
//! [`Match`] is the [`Pilot`](crate::collect::Pilot) of a session of [`collect`](crate::collect),
//! which homes, arms, guards and records as in a collection. In every control period (50 Hz):
//!
//! 1. Camera frames since the last period update one [`Estimator`](crate::game::Estimator), the same
//!    as in training with sensors; its estimates are predicted to the current time.
//! 2. Each player gets an observation in its own frame ([`Observation`](crate::game::Observation)):
//!    the board turned by 180 degrees for the right player.
//! 3. The player returns a velocity: the mean action of a policy times its scale, or the rule of a
//!    scripted player.
//! 4. The wall limiter of the game is applied to it at the encoder position of the carriage, with
//!    the workspace of training and with that of the robot file. A policy therefore meets the
//!    limits of its training and never leaves its training workspace.
//! 5. The session applies its own limits: slew, and a speed towards an edge from which the carriage
//!    can stop.
//!
//! # Missing detections
//!
//! | object | observation of the players |
//! |---|---|
//! | ball, for longer than the filter keeps its track | none: both players stop until it is detected again |
//! | ball in a cup for [`IN_CUP_SECONDS`] | none, as after the end of an episode in training |
//! | striker | its carriage by the encoders; if it is not driven, the last detected position, at rest; before the first detection its home position |
//!
//! # Limits
//!
//! A decision uses the current state, not the state at the time when the command takes effect:
//! training has no such delay either, except that of the actuator. Serving is left to people. The score is that of
//! [`LiveReferee`](crate::referee::LiveReferee), which sees no biscuits; [`analyze`](crate::referee::analyze) does.
//!
//! ```
//! use klasktron::{
//!     collect::{Carriage, Moment, Pilot}, ekf::FilterSettings, gantry::Robot, opponent::Scripted,
//!     play::{Match, Seat}, recording::message::{CameraDetections, Point}, units::Nanos,
//! };
//! let seats = [Some(Seat::Scripted(Scripted::Goalkeeper)), None];
//! let mut game = Match::new(seats, &Robot::default(), &FilterSettings::default(), 0)?;
//! let point = |x, y| Some(Point { x, y });
//! let (ball, left, right) = (point(0.1, 0.05), point(0.0, -0.13), point(0.0, 0.1));
//! game.see(Nanos(0), &CameraDetections { ball, left, right, ..CameraDetections::default() });
//! let own = Carriage { position: [0.0, -0.13], velocity: [0.0, 0.0] };
//! let moment = Moment { now: Nanos(8_000_000), step: 0, carriages: [Some(own), None] };
//! let decision = game.decide(&moment);
//! assert!(0.0 < decision.velocities[0][0]);
//! assert_eq!(decision.velocities[1], [0.0, 0.0]);
//! # Ok::<(), klasktron::play::PlayError>(())
//! ```

mod error;
mod pilot;
mod rig_games;
mod score;
mod seat;
mod simulated;
mod table_state;
#[cfg(test)]
mod tests;

pub use crate::game::IN_CUP_SECONDS;
pub use error::PlayError;
pub use pilot::{HOLD_GAIN_PER_S, Match, label};
pub use rig_games::{RigGames, TrainingRig};
pub use score::{MatchFormat, MatchScore};
pub use seat::{Seat, Who, WhoError};
pub use simulated::{SimulatedGoals, SimulatedMatch};
