//! Collecting: what to run on the table, and the proof beforehand that it may.
//!
//! A [`Plan`] is a list of runs, each a [`Pattern`](crate::gantry::Pattern) with its length and
//! whether it is to be fitted or to judge. [`prove`] turns it into the motion of every player,
//! moves between runs included, and checks every sample of it against the robot's limits; what is
//! executed is what the [`Proof`] holds. [`plan_page`] shows it without moving anything.
//!
//! ```
//! use klasktron::{collect::{Plan, Schedule, prove}, gantry::Robot, recording::topic::Player};
//! let plan = Plan::from_patterns(&["circle".parse()?, "chirp".parse()?], &Schedule::default())?;
//! let proof = prove(&plan, &Robot::default(), &[Player::Left])?;
//! assert_eq!(proof.runs().len(), 12);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod plan;
mod plan_page;
mod proof;

pub use error::{Breach, Part, PlanError};
pub use plan::{Plan, PlannedRun, Schedule, Split};
pub use plan_page::{PlanPage, plan_page};
pub use proof::{Figures, Proof, ProvenRun, check_reference, prove};
