//! Demo: the whole pipeline on the virtual rig, as a list of commands and a report of their
//! results.
//!
//! [`Plan`] lists the commands as typed: collect, fit the actuator, tune the filter, close the gap,
//! train six policies in six simulations, let each play on the rig, score. The binary runs them
//! and keeps the printed documents as [`Record`]s. [`Experiment`] computes the comparison from the
//! records; [`page()`] writes the report.
//!
//! The experiment is the central claim of the KlaskTron paper: a policy trained with an accurate
//! actuator model loses less performance on the table than one trained with ideal actuators,
//! randomized or not. A difference is claimed only if its 95 % interval excludes 0.
//!
//! A step starts when the steps whose results it reads are done. A finished step is not run again: its record holds
//! a hash of its command, of the commands whose results it reads and of the program.
//!
//! ```
//! use klasktron::demo::{Plan, Size};
//! let plan = Plan::new(Size::Quick, 0);
//! assert_eq!(plan.stages[0].chapter.title(), "Collect");
//! assert!(plan.stages[0].steps[0].line().starts_with("klasktron collect --speed max"));
//! ```

mod experiment;
mod page;
mod pictures;
mod plan;
mod record;

pub use experiment::{Contest, Difference, Estimate, Experiment};
pub use page::{Pictures, Story, page};
pub use pictures::pictures;
pub use plan::{
    HIDDEN, OPPONENTS, POLICIES, Plan, PolicyKind, SEATS, Size, Stage, Step, match_name,
};
pub use record::{Record, begin};
