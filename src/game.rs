//! KLASK in two dimensions, thousands of boards at once: the game in which policies learn.
//!
//! [`Games`] holds the boards as arrays, one per kind of thing (balls, strikers, physics, clocks), and plays
//! all of them one control period (20 ms, 50 Hz) per [`Games::step`]. Nothing is allocated in a step. A board
//! depends on the seed, its number and its episode only, so the same seed gives the same bytes however boards
//! are divided over threads: each thread plays a [`Games::range`] of its own. [`Games::save`] and
//! [`Games::restore`] let an interrupted training go on as if it had not been.
//!
//! ```
//! use klasktron::{
//!     game::{GameSettings, Games, ObservationKind, Outcomes},
//!     recording::topic::Player,
//! };
//! let mut games = Games::new(256, &GameSettings::default(), 7)?;
//! let mut outcomes = Outcomes::new(games.len());
//! let kind = ObservationKind::Augmented20;
//! let mut seen = vec![0.0; games.len() * kind.len()];
//! for _ in 0..50 {
//!     games.observe(Player::Left, kind, &mut seen)?;
//!     // The left player runs after the ball, the right one stands.
//!     let chase = |row: &[f32]| [[4.0 * (row[8] - row[0]), 4.0 * (row[9] - row[1])], [0.0, 0.0]];
//!     let commands: Vec<_> = seen.chunks_exact(kind.len()).map(chase).collect();
//!     games.step(&commands, &mut outcomes)?;
//! }
//! assert!((0..games.len()).any(|board| games.snapshot(board).ball_velocity != [0.0, 0.0]));
//! # Ok::<(), klasktron::game::GameError>(())
//! ```
//!
//! # Frames, units, shapes
//!
//! SI units and radians; the board frame of [`crate::board`] inside, and at the players' side each player's
//! own frame: the board frame for the left player (y < 0), the board turned by 180 degrees for the right one.
//!
//! | what | shape | unit |
//! |---|---|---|
//! | commands | `[boards][left, right][x, y]`, `f32` | m/s, each in its player's frame |
//! | [`Games::observe`] | `[boards][12 or 20]`, `f32` | m, m/s, rad ([`Sight`]) |
//! | [`Outcomes`] | one entry per board, players left, right | m/s |
//!
//! # What happens in a control period
//!
//! 1. A command is clamped to 0.4 m/s, slew-limited, and held back before walls ([`CommandLimits`]).
//! 2. The actuator ([`Actuation`]) leads each striker's magnet through the period: at once; by a fitted
//!    network, all carriages of 64 boards in one product per layer; or by the drives, gantry and coupling of
//!    a [`crate::twin::Twin`].
//! 3. The period is cut into [`GameSettings::pieces`]. In each, the forces of the catalogue
//!    ([`crate::effects`]) push the ball, and all contacts on its straight way are solved for in their order:
//!    walls, moving strikers, biscuits, rims of cups. Nothing is tunnelled through at any speed.
//! 4. The episode ends with a goal, a striker over its own cup, two biscuits on a striker, or the time limit;
//!    the next one begins at once.
//!
//! # What is modelled
//!
//! - Rolling resistance, tilt, curvature, drag, attraction by magnets, sliding after impacts: the laws of the
//!   effects in [`BallSettings`], which [`GameSettings::with_twin`] takes from a twin.
//! - Impacts with restitution (also one that falls with speed), Coulomb friction at rest and while sliding,
//!   and spin about the vertical; walls that stand elsewhere or crooked.
//! - Strikers of finite mass: a hit pushes them from their magnet, on which they swing back
//!   ([`StrikerSettings`]).
//! - Cups into which a ball falls or over whose rim it comes out again ([`CupSettings`], [`sure_fall_speed`]).
//! - Biscuits ([`BiscuitSettings`]), off by default as in the paper.
//! - Physics that differ from episode to episode ([`Randomization::paper`]), off by default.
//!
//! # What is not
//!
//! The third dimension (jumping balls, heights of strikers); the shape of the cup below its rim; rotation of
//! strikers; effects of a hit on the carriage; biscuits that touch each other or fall into cups; wear.
//! Observations are exact and of this instant: the place for a model of the camera is in [`Sight`].

mod actuation;
mod biscuit;
mod body;
mod command;
mod contact;
mod cup;
mod error;
mod games;
mod laws;
mod motion;
mod observation;
mod outcome;
mod period;
mod randomization;
mod settings;
mod state;

pub use actuation::Actuation;
pub use cup::sure_fall_speed;
pub use error::GameError;
pub use games::{Asked, Clockwork, Games, Snapshot, Spent};
pub use observation::{ObservationKind, Sight, turned};
pub use outcome::{Ending, Outcomes};
pub use randomization::{BoardPhysics, Randomization, Surface};
pub use settings::{
    BallSettings, BiscuitSettings, CONTROL_PERIOD, CommandLimits, CupRule, CupSettings,
    EpisodeSettings, GameSettings, LimiterPlace, StrikerSettings,
};

#[cfg(test)]
mod tests;
