//! Data collection: the plan of excitations, its safety check, and the session that drives and
//! records it.
//!
//! A [`Plan`] is a list of runs. Each run is a [`Pattern`](crate::gantry::Pattern) with its length
//! and its split, training or validation. [`check_plan`] computes the motion of every player,
//! including the moves between runs, and checks every sample against the robot's limits. Only the
//! motions of a [`CheckedPlan`] are executed. [`plan_page()`] shows them without moving anything.
//!
//! [`run_session`] checks the bus, references the carriages and arms the drives. It then tests that
//! the drives' watchdogs stop them without commands, executes its [`Work`] and disarms. The work is
//! either the legs of a plan or a free run, in which a [`Pilot`] drives by the camera. Every
//! session ends with a [`StopReason`] and its [`Reaction`], in the recording and in the
//! [`SessionReport`].
//!
//! | task | module |
//! |---|---|
//! | runs and their safety check | `plan`, `safety`, `plan_page` |
//! | procedure | `session`: `preflight`, `homing`, `arming`, then legs or a free run (`pilot`) |
//! | control loop | `control`: absolute deadlines, latest setpoint only |
//! | safety | `guard` in every period, `station` at once, `reason` with the reactions |
//! | state | `watch`: drives, carriages, camera; `traffic`: rates of messages |
//! | recording | `recorder`, on its own thread; `report` |
//!
//! ```
//! use klasktron::{collect::{Plan, Schedule, check_plan}, gantry::Robot, recording::topic::Player};
//! let plan = Plan::from_patterns(&["circle".parse()?, "chirp".parse()?], &Schedule::default())?;
//! let checked = check_plan(&plan, &Robot::default(), &[Player::Left])?;
//! assert_eq!(checked.runs().len(), 12);
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
mod reason;
mod recorder;
mod report;
mod safety;
mod session;
mod station;
mod traffic;
mod watch;

pub use arming::WatchdogPolicy;
pub use control::LoopTiming;
pub use error::{Part, PlanError, Violation};
pub use homing::{HomingError, HomingPolicy};
pub use leg::{Leg, RunLabel, planned_paths};
pub use pilot::{Carriage, Decision, FreeStretch, Moment, Pilot, Work};
pub use plan::{Plan, PlannedRun, Schedule};
pub use plan_page::{PlanPage, plan_page};
pub use preflight::{BusState, MOST_BUS_LOAD, MessageRate, NodeFirmware, Problem, bus_load};
pub use reason::{HotPart, Reaction, StopReason};
pub use report::{ImageToCommand, Progress, SessionReport};
pub use safety::{CheckedPlan, CheckedRun, MotionExtremes, check_plan, check_reference};
pub use session::{SessionConfig, SessionError, SessionOutput, listen, run_session};
pub use station::RawFrames;
pub use traffic::{Arrivals, CameraTraffic, MessageTraffic, NodeTraffic, Traffic};
