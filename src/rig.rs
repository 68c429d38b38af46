//! The virtual rig: four simulated drives behind the very same protocol bytes, with gantries,
//! magnets, strikers, ball and camera.
//!
//! It stands in for the table: procedures that drive hardware run on it unchanged, through
//! [`VirtualLink`], or over a real bus through [`serve()`]. Its physics is its own. It uses no
//! kinematics, actuator model, effect or simulator of this crate, so that whatever is fitted to its
//! recordings shares no line of dynamics with it, and every number of it is hidden in a
//! [`RigConfig`].
//!
//! # Friction
//!
//! Motors and rails: `Fc + (Fs - Fc) exp(-(v/vs)^2) + Fv |v| + Fq v^2` against the motion; the dry
//! part times a ratio when moving backwards, times a swing along the rail, times a slow drift. Motors
//! may have friction in proportion to the tension of their belt, rails an elastic stage before they
//! slip.
//!
//! # What is left out
//!
//! Spin of the ball about the vertical, compliance of the striker in a hit, mass that depends on the
//! place, strikers that fall into cups, biscuits; of the drives: endpoints (SDO), trajectories,
//! calibration and homing procedures.
//!
//! # Example
//!
//! ```
//! use klasktron::can::{Message, encode};
//! use klasktron::link::Link;
//! use klasktron::rig::{RigConfig, Speed, VirtualLink};
//! use klasktron::units::Nanos;
//!
//! let mut rig = VirtualLink::new(RigConfig::default(), Speed::Maximum, Nanos(0)).unwrap();
//! for node in 0..4 {
//!     rig.send(&encode(node, &Message::SetAxisState { state: 8 })).unwrap();
//! }
//! while rig.next_event(Nanos(50_000_000)).unwrap().is_some() {}
//! assert!(rig.truth().drives.iter().all(|drive| drive.state.number() == 8));
//! ```

mod ball;
mod bus;
mod camera;
pub mod config;
mod drive;
mod fault;
mod friction;
mod gantry;
mod magnet;
mod serve;
mod truth;
mod virtual_link;
mod world;

#[cfg(test)]
mod tests;

pub use config::{ConfigError, FaultKind, FaultPlan, FaultStart, RigConfig};
pub use serve::{DriveReport, ServeError, ServeReport, serve};
pub use truth::{Body, DriveTruth, PlayerTruth, Truth};
pub use virtual_link::{Speed, VirtualLink};
pub use world::World;
