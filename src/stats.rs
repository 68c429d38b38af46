//! Plain statistics: summaries, and bootstrap intervals over whole runs.

mod bootstrap;

pub use bootstrap::{Interval, bootstrap_ci95};
