//! Playing: policies and scripted players on a table, real or virtual.
//!
//! [`Match`] is the [`Pilot`](crate::collect::Pilot) of a session of [`collect`](crate::collect), which homes,
//! arms, guards and records as ever. In every control period (50 Hz):
//!
//! 1. Pictures since the last period go into one [`BoardFilter`](crate::ekf::BoardFilter); its estimates of ball
//!    and strikers are moved ahead to now.
//! 2. Each player sees them in its own frame ([`Sight`](crate::game::Sight)): the board turned by 180 degrees for
//!    the right one.
//! 3. It answers with a velocity: the mean action of a policy times its scale, or what the rule of a scripted
//!    player says.
//! 4. That passes the wall limiter of the game at the carriage's place by its encoders, once within the field of
//!    training and once within that of the robot file, so a policy meets on the table what it met in training
//!    and goes nowhere it never was.
//! 5. The session adds its own limits: slew, and never faster towards an edge than the carriage can stop.
//!
//! # What is not seen
//!
//! | what | what the players see |
//! |---|---|
//! | the ball, for longer than the filter believes in it | nothing: both stand until it is seen again |
//! | the ball in a cup for [`IN_CUP_SECONDS`] | nothing, as when an episode of training has ended |
//! | a striker | its carriage by the encoders; where that is not driven, the last place at which it was seen, at rest; before the first sight its home point |
//!
//! # Left out on purpose
//!
//! A decision is for now, not for the moment when a command takes effect: in training there is no such delay
//! either, except that of the actuator. Biscuits, and who serves, are for people.
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
//! game.see(Nanos(0), &CameraDetections { capture_time_ns: 0, ball, left, right });
//! let own = Carriage { position: [0.0, -0.13], velocity: [0.0, 0.0] };
//! let moment = Moment { now: Nanos(8_000_000), step: 0, carriages: [Some(own), None] };
//! let decision = game.decide(&moment);
//! assert!(0.0 < decision.velocities[0][0]);
//! assert_eq!(decision.velocities[1], [0.0, 0.0]);
//! # Ok::<(), klasktron::play::PlayError>(())
//! ```

mod error;
mod pilot;
mod seat;
#[cfg(test)]
mod tests;

pub use error::PlayError;
pub use pilot::{IN_CUP_SECONDS, Match, label};
pub use seat::{Seat, Who, WhoError};
