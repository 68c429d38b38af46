//! The virtual rig: four simulated drives with the same protocol bytes as hardware, with gantries,
//! magnets, strikers, ball and camera.
//!
//! It replaces the table: procedures for hardware run on it unchanged, through [`VirtualLink`], or
//! over a real bus through [`serve()`]. Its physics is independent. It uses no kinematics, actuator
//! model, effect or simulator of this crate, so that a model fitted to its recordings shares no
//! line of dynamics with it. All its parameters are in a [`RigConfig`], which fits do not see.
//!
//! # Friction
//!
//! Motors and guides: `Fc + (Fs - Fc) exp(-(v/vs)^2) + Fv |v| + Fq v^2` against the motion. The dry
//! part is multiplied by a ratio when moving backwards, by a position-dependent factor along the
//! guide, and by a slow drift. Motors may have friction in proportion to the tension of their belt;
//! guides may have an elastic presliding stage.
//!
//! # Not modelled
//!
//! Spin of the ball about the vertical, compliance of the striker in an impact, position-dependent
//! mass, strikers that fall into cups, biscuits. Of the drives: endpoints (SDO), trajectories,
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
pub mod draw;
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

pub use ball::Serves;
pub use config::{ConfigError, FaultKind, FaultPlan, FaultStart, RigConfig};
pub use draw::{Artist, Scene};
pub use serve::{DriveReport, ServeError, ServeReport, Shown, serve};
pub use truth::{Body, DriveTruth, Hits, PlayerTruth, Truth};
pub use virtual_link::{Speed, VIRTUAL_START, VirtualLink, Vision};
pub use world::World;

/// Length of a vector whose components are far from the limits of `f64`: for those, `f64::hypot` takes several times as
/// long.
fn length([x, y]: [f64; 2]) -> f64 {
    (x * x + y * y).sqrt()
}
