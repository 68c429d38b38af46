//! Collecting: what to run on the table, the proof beforehand that it may, and the session that
//! drives and records it.
//!
//! A [`Plan`] is a list of runs, each a [`Pattern`](crate::gantry::Pattern) with its length and
//! whether it is to be fitted or to judge. [`prove`] turns it into the motion of every player,
//! moves between runs included, and checks every sample of it against the robot's limits; what is
//! executed is what the [`Proof`] holds. [`plan_page()`] shows it without moving anything.
//!
//! [`run_session`] looks at the bus, references the carriages, arms the drives, proves that they stop
//! by themselves when nobody talks to them, does its [`Work`] and switches off: the legs of a plan, or a
//! stretch that a [`Pilot`] drives by what the camera shows. Whatever ends it is a
//! [`StopReason`], with a [`Reaction`] of its own, in the recording and in the [`SessionReport`].
//!
//! | what | where |
//! |---|---|
//! | runs and their proof | `plan`, `proof`, `plan_page` |
//! | the procedure | `session`: `preflight`, `homing`, `arming`, then legs or a free stretch (`pilot`) |
//! | the loop | `control`: absolute deadlines, latest setpoint only |
//! | safety | `guard` every period, `station` at once, `reason` what is done |
//! | what is known | `watch`: drives, carriages, camera |
//! | the recording | `recorder`: a thread of its own; `report` |
//!
//! ```
//! use klasktron::{collect::{Plan, Schedule, prove}, gantry::Robot, recording::topic::Player};
//! let plan = Plan::from_patterns(&["circle".parse()?, "chirp".parse()?], &Schedule::default())?;
//! let proof = prove(&plan, &Robot::default(), &[Player::Left])?;
//! assert_eq!(proof.runs().len(), 12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arming;
mod control;
mod error;
mod guard;
mod homing;
mod leg;
mod pilot;
mod plan;
mod plan_page;
mod preflight;
mod proof;
mod reason;
mod recorder;
mod report;
mod session;
mod station;
mod watch;

pub use arming::WatchdogPolicy;
pub use control::Lateness;
pub use error::{Breach, Part, PlanError};
pub use homing::{HomingError, HomingPolicy};
pub use leg::{Leg, RunLabel};
pub use pilot::{Carriage, Decision, FreeStretch, Moment, Pilot, Work};
pub use plan::{Plan, PlannedRun, Schedule};
pub use plan_page::{PlanPage, plan_page};
pub use preflight::{Census, CyclicRate, MOST_BUS_LOAD, Problem, bus_load};
pub use proof::{Figures, Proof, ProvenRun, check_reference, prove};
pub use reason::{HotPart, Reaction, StopReason};
pub use report::{PictureToCommand, Progress, SessionReport};
pub use session::{SessionConfig, SessionError, SessionOutput, listen, run_session};
pub use station::RawFrames;
