//! The demo: the whole pipeline on the virtual rig, as a list of commands and the story of their results.
//!
//! [`Plan`] lists the commands as they would be typed: collect, fit the actuator, tune the filter, close the
//! gap, train four policies in four simulations, let each play on the rig, score. Nothing here runs them: the
//! binary does, and keeps what each printed as a [`Record`]. [`Experiment`] makes the comparison out of the
//! records, [`page()`] the story.
//!
//! The experiment is the KlaskTron paper's central claim: a policy that was trained with the actuator's true
//! behaviour loses less on the table than one that was trained with ideal actuators, randomised or not. Who
//! is better is only said where the interval of the difference shows it.
//!
//! A step that was finished is not run again: its record holds a hash of its command, of all commands before
//! its stage and of the program.
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
