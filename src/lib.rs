//! System identification and sim-to-real for the KlaskTron table, and for any single axis driven by
//! velocity, force or voltage.
//!
//! # Data flow
//!
//! 1. A recording is an MCAP file of the data contract (`datasets_schema/`): commands, motors,
//!    carriages, camera detections and markers of runs. [`import`] converts existing data.
//!    [`collect`] records new data: it drives a safety-checked plan over a [`link`] on a real table
//!    or on the virtual [`rig`].
//! 2. [`recording::Recording::open`] reads any MCAP file, a damaged one as far as possible.
//!    [`recording::inspect`] summarizes it and checks its data quality.
//! 3. [`actuator::load`] resamples the runs on the 50 Hz grid of the control loop. It splits whole
//!    runs or sessions, never parts of a run, into training and held-out data.
//! 4. [`actuator::fit_all`] fits networks on the kernels of [`nn`] in parallel, and stores each
//!    finished fit.
//! 5. [`actuator::Study`] evaluates the fits on held-out runs and compares them with baselines.
//! 6. `actuator.mcap` has traces, metrics and weights, and `index.html` shows them. `klasktron
//!    export` writes weights and tables for other software.
//! 7. [`twin`] simulates the measured chain from the [`effects`] of a catalogue. [`gap`] compares it
//!    with recordings stage by stage, calibrates it, detects missing effects and adds them. The
//!    results are `twin.json`, `gap.json`, a page and the compared signals in `gap.mcap`.
//! 8. [`ekf`] estimates positions and velocities from detections, tunes its noise covariances on
//!    recordings and tests its consistency (NIS). The results are `ekf.json`, a page and estimates.
//! 9. [`referee`] detects the events of a match and scores it: `score.json`, tables, `events.mcap`
//!    and a page with a replay.
//! 10. [`train`] trains policies by self-play in the [`game`] with [`ppo`], on ideal, fitted or
//!     calibrated actuators: `policy.mcap` and a page.
//! 11. [`play`] runs policies or scripted players on a real table or on the [`rig`]. The [`referee`]
//!     scores the recording.
//!
//! # Modules
//!
//! Each module has one public interface file. A module uses modules of lower layers only, which
//! `tests/it/architecture.rs` enforces.
//!
//! | layer | module | purpose |
//! |---|---|---|
//! | 0 basics | [`units`] | time stamps and their conversions |
//! | | [`seed`] | independent named random streams from one user seed |
//! | | [`stats`] | summaries, bootstrap intervals, permutation tests |
//! | | [`parallel`] | parallel work on independent items |
//! | | `lanes` | simulations side by side in the vectors of the processor |
//! | | [`report`] | pages of sections, tables and plots |
//! | | [`provenance`] | command line, version and commit of a result |
//! | 1 data | [`board`] | geometry and coordinate frames of the table |
//! | | [`recording`] | messages in and out of MCAP; inspection, recovery, tables |
//! | | [`nn`] | small networks: kernels, gradients, Adam, file formats |
//! | 2 models | [`can`] | frames of the bus and the ODrive codec |
//! | | [`gantry`] | CoreXY kinematics, limits, the robot file |
//! | | [`link`] | connection to a table: clock, bus, camera |
//! | | [`live`] | live view: WebSocket server for Foxglove |
//! | | [`scene`] | three-dimensional scene of a recording, for viewers |
//! | | [`rig`] | virtual rig: simulated drives, gantries, ball and camera behind a link |
//! | | [`camera`] | images to positions: calibration, colours, detector, sources of frames |
//! | | [`actuator`] | actuator models from command history to motion: fits and evaluation |
//! | | [`effects`] | catalogue of physical effects, one small file each |
//! | | [`twin`] | simulator composed of effects, and its stages in a recording |
//! | | [`ekf`] | state estimation: filter, tuning, consistency |
//! | | [`game`] | KLASK in two dimensions, thousands of environments as arrays |
//! | | [`opponent`] | scripted players: stationary, random, goalkeeper, chaser |
//! | | [`ppo`] | Proximal Policy Optimization on small networks |
//! | 3 procedures | [`import`] | bags, npz, CSV and candump logs to recordings |
//! | | [`collect`] | plan of runs, its safety check, and the recorded session |
//! | | [`gap`] | discrepancies between twin and recording, and the missing effects |
//! | | [`referee`] | events of a match and its score |
//! | | [`train`] | self-play: rewards, opponents, ratings, `policy.mcap` |
//! | | [`play`] | match on a table: camera frames, estimates, decisions, commands |
//! | | [`sweep`] | many runs of one command, locally or on Slurm: points, store, table, page |
//! | | [`demo`] | complete pipeline as a list of commands, with a summary page |
//! | 4 binary | `cli`, `commands` | arguments, typed or set in `klasktron.toml`; one `run` per subcommand |
//!
//! # Invariants
//!
//! - SI units inside; at every boundary (flag, field, plot) the unit is in the name.
//! - Recorded time is an integer count of nanoseconds. Only `link`'s live connection, `camera`'s live
//!   sources, `live` and `rig` in real time read the system's clock.
//! - Equal inputs and seeds give equal bytes for any number of threads.
//! - An output file appears under its name only when it is complete.
//! - A recording that is marked for validation is never fitted.

mod lanes;
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
pub mod camera;
pub mod can;
pub mod effects;
pub mod ekf;
pub mod game;
pub mod gantry;
pub mod link;
pub mod live;
pub mod opponent;
pub mod ppo;
pub mod rig;
pub mod scene;
pub mod twin;

pub mod collect;
pub mod demo;
pub mod gap;
pub mod import;
pub mod play;
pub mod referee;
pub mod sweep;
pub mod train;
