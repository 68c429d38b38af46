//! Vectorized simulation of the game KLASK in two dimensions, in which policies are trained.
//!
//! [`Games`] holds the state of all environments as arrays, one per component (balls, strikers,
//! physics, clocks), and advances all of them by one control period (20 ms, 50 Hz) per
//! [`Games::step`]. A step allocates nothing. An environment depends only on the seed, its number
//! and its episode. Equal seeds therefore give equal bytes for any division over threads: each
//! thread steps a [`Games::range`] of its own. [`Games::save`] and [`Games::restore`] let an
//! interrupted training continue with identical results.
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
//! SI units and radians. The simulation uses the board frame of [`crate::board`]; players use their
//! own frame. That of the left player (y < 0) is the board frame, that of the right player is turned
//! by 180 degrees.
//!
//! | quantity | shape | unit |
//! |---|---|---|
//! | commands | `[environments][left, right][x, y]`, `f32` | m/s, each in its player's frame |
//! | [`Games::observe`] | `[environments][12 or 20]`, `f32` | m, m/s, rad ([`Observation`]) |
//! | [`Outcomes`] | one entry per environment, players left, right | m/s |
//!
//! # Order of computation in a control period
//!
//! 1. Commands are clamped to 0.4 m/s, slew-limited, and reduced near walls ([`CommandLimits`]).
//! 2. The actuator ([`Actuation`]) moves each striker's magnet through the period. It is ideal, a
//!    fitted network, or the drives, gantry and coupling of a [`crate::twin::Twin`]. The network
//!    takes one matrix product per layer for all carriages of 64 environments.
//! 3. The period is divided into [`GameSettings::pieces`]. In each, the forces of the catalogue
//!    ([`crate::effects`]) accelerate the ball, and all contacts on its straight path are solved in
//!    order of time: walls, moving strikers, biscuits, rims of cups. No contact is missed
//!    (tunnelling) at any speed.
//! 4. The episode ends with a goal, an own goal (a striker over its own cup or two biscuits on a
//!    striker), or the time limit. The next episode begins at once.
//!
//! # Modelled effects
//!
//! - Rolling resistance, tilt, curvature, drag, attraction by magnets, sliding after impacts: the
//!   effects in [`BallSettings`], which [`GameSettings::with_twin`] takes from a twin.
//! - Impacts with restitution (constant or decreasing with speed), static and kinetic Coulomb
//!   friction, and spin about the vertical; displaced or tilted walls.
//! - Strikers of finite mass: an impact displaces them from their magnet, to which they return as a
//!   damped oscillator with friction on the board ([`StrikerSettings`], with a twin those of its coupling).
//! - Cups that capture a ball or release it over the rim ([`CupSettings`], [`sure_fall_speed`]).
//! - Biscuits ([`BiscuitSettings`]), off by default as in the paper.
//! - Domain randomization: physics drawn per episode ([`Randomization::paper`]), off by default.
//!
//! # Not modelled
//!
//! - The third dimension: jumping balls, heights of strikers, the shape of the cup below its rim.
//! - Rotation of strikers, reaction of an impact on the carriage, and wear.
//! - Contacts between biscuits, and biscuits in cups.
//! - Blur, distortion and outliers of the camera. Observations are exact and current without
//!   [`GameSettings::sensors`], and those of a camera model with the state estimator with it.

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
mod observed;
mod outcome;
mod period;
mod randomization;
mod recoil;
mod sensing;
mod settings;
mod state;

pub use actuation::Actuation;
pub use cup::sure_fall_speed;
pub use error::GameError;
pub use games::{ActuatorQueries, ClockFn, Games, Snapshot, StepTimes};
pub use observation::{
    MOST_PREVIOUS_COMMANDS, Observation, ObservationKind, ObservationLayout, PreviousCommands,
    turned,
};
pub use observed::{ObservedGames, ObservedState};
pub use outcome::{Ending, Outcomes};
pub use randomization::{BoardPhysics, Randomization, Surface};
pub use sensing::{Estimator, IN_CUP_SECONDS, Seen, SensorSettings, Sensors};
pub use settings::{
    BallSettings, BiscuitSettings, CONTROL_PERIOD, CommandLimits, CupRule, CupSettings,
    EpisodeSettings, GameSettings, LimiterPlace, StrikerOverCup, StrikerSettings,
};

#[cfg(test)]
mod tests;
