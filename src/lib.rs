//! System identification and sim-to-real for the KlaskTron table, and for any velocity-, force- or
//! voltage-driven axis.
//!
//! # The way of the data
//!
//! 1. A recording is an MCAP file of the data contract (`datasets_schema/`): commands, motors,
//!    carriage, camera, markers of runs. What labs already have comes in through [`import`].
//!    New ones are made by [`collect`]: a proven plan is driven over a [`link`] to a real table or to
//!    the virtual [`rig`].
//! 2. [`recording::Recording::open`] reads any MCAP file, a damaged one as far as it goes, and
//!    [`recording::inspect`] says what is in it and what is doubtful.
//! 3. [`actuator::load`] puts the runs on the 50 Hz grid of the control loop and divides them, by
//!    run or session and never inside a run, into those that are fitted and those that judge.
//! 4. [`actuator::fit_all`] fits networks on the kernels of [`nn`], in parallel, each kept when it
//!    is finished.
//! 5. [`actuator::Study`] judges them beside simpler models on the runs that they have not seen.
//! 6. `actuator.mcap` holds traces, figures and weights; `index.html` shows them; `klasktron
//!    export` hands weights and tables to other software.
//! 7. [`twin`] simulates the measured chain out of the [`effects`] of a catalogue; [`gap`] compares it
//!    with recordings link by link, fits it, finds what is missing and adds it: `twin.json`,
//!    `gap.json`, a page and the compared signals as `gap.mcap`.
//! 8. [`ekf`] turns detections into places and velocities, tunes its noise on recordings and says
//!    whether it is as sure as it may be: `ekf.json`, a page and estimates beside detections.
//! 9. [`referee`] finds the events of a match and scores it: `score.json`, tables, `events.mcap` and a
//!    page with a replay.
//! 10. [`train`] lets policies play against themselves in the [`game`], on ideal, fitted or calibrated
//!     actuators, and learn from it with [`ppo`]: `policy.mcap` and a page.
//! 11. [`play`] lets them, or scripted players, play on a real table or the [`rig`]: a recording that
//!     the [`referee`] scores.
//!
//! # Rooms
//!
//! A room is a module with a front door; it may use rooms of lower layers only, which
//! `tests/it/architecture.rs` enforces.
//!
//! | layer | room | purpose |
//! |---|---|---|
//! | 0 words | [`units`] | the time stamp and its conversions |
//! | | [`seed`] | one user seed, many named independent streams |
//! | | [`stats`] | summaries, bootstrap intervals |
//! | | [`parallel`] | independent work on several cores |
//! | | [`report`] | pages of sections, tables and pictures |
//! | | [`provenance`] | how a result was made |
//! | 1 things | [`board`] | geometry and frames of the table |
//! | | [`recording`] | messages in and out of MCAP; inspect, recover, tables |
//! | | [`nn`] | small networks: kernels, gradients, Adam, file formats |
//! | 2 things that step | [`can`] | frames of the bus and the ODrive codec |
//! | | [`gantry`] | CoreXY kinematics, limits, the robot file |
//! | | [`link`] | the connection to a table: clock, bus, camera |
//! | | [`rig`] | the virtual rig: simulated drives, gantries, ball and camera behind a link |
//! | | [`actuator`] | command history to motion: models, fits, judgement |
//! | | [`effects`] | the catalogue of physical effects: one small file each |
//! | | [`twin`] | the simulator made of them, and its links in a recording |
//! | | [`ekf`] | the state estimate: filter, tuning, consistency |
//! | | [`game`] | KLASK in two dimensions, thousands of boards as arrays |
//! | | [`opponent`] | scripted players: stationary, random, goalkeeper, chaser |
//! | | [`ppo`] | Proximal Policy Optimization on small networks |
//! | 3 procedures | [`import`] | bags, npz, CSV and candump logs to recordings |
//! | | [`collect`] | a plan of runs, its proof, and the session that drives and records it |
//! | | [`gap`] | where twin and recording disagree, and the name of what is missing |
//! | | [`referee`] | the events of a match and its score |
//! | | [`train`] | self-play: rewards, opponents, ratings, `policy.mcap` |
//! | | [`play`] | a match on a table: pictures to estimates to decisions to commands |
//! | | [`sweep`] | many runs of one command, here or on Slurm: points, store, table, page |
//! | | [`demo`] | the whole pipeline as a list of commands, and its story |
//! | 4 binary | `cli`, `commands` | arguments, typed or set in `klasktron.toml`; one `run` per subcommand |
//!
//! # Invariants
//!
//! - SI units inside; at every boundary (flag, field, plot) the unit is in the name.
//! - Recorded time is an integer count of nanoseconds. The system's clock is read only where a real
//!   table is: in `link`'s live connection and in `rig` when it runs in real time.
//! - Equal inputs and seeds give equal bytes, whatever the number of threads.
//! - What is written appears under its name only when it is complete.
//! - A recording that is marked for validation is never fitted.

pub mod parallel;
pub mod provenance;
pub mod report;
pub mod seed;
pub mod stats;
pub mod units;

pub mod board;
pub mod nn;
pub mod recording;

pub mod actuator;
pub mod can;
pub mod effects;
pub mod ekf;
pub mod game;
pub mod gantry;
pub mod link;
pub mod opponent;
pub mod ppo;
pub mod rig;
pub mod twin;

pub mod collect;
pub mod demo;
pub mod gap;
pub mod import;
pub mod play;
pub mod referee;
pub mod sweep;
pub mod train;
