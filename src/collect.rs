//! Collecting: a plan of runs, proven before anything is armed, driven and recorded with one session.

mod arming;
mod control;
mod guard;
mod homing;
mod preflight;
mod reason;
mod recorder;
mod session;
mod station;
mod watch;

pub use arming::WatchdogPolicy;
pub use control::Lateness;
pub use homing::{HomingError, HomingPolicy};
pub use preflight::{Census, CyclicRate, MOST_BUS_LOAD, Problem, bus_load};
pub use reason::{HotPart, Reaction, StopReason};
pub use session::{
    Leg, Progress, RunLabel, SESSION_METADATA, SessionConfig, SessionError, SessionOutput,
    SessionReport, listen, run_session,
};
pub use station::RawFrames;
