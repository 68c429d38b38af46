//! Sweeps: many runs of one command, on this machine or on a cluster, merged into one table and one
//! page.
//!
//! A [`SweepFile`] has a command, fixed options, a grid or list of options, and seeds. [`Plan`]
//! expands it into [`Point`]s: one command line each, identified by the hash of its settings, the
//! content of its inputs and the version of this crate. An engine runs the points that the
//! [`Store`] does not have: [`run_local`] as child processes of this program, [`run_slurm`] as job
//! arrays. Both use [`run_point`], so their results are the same files, byte for byte. [`Merged`]
//! reads the finished points into a table, a page and a choice.
//!
//! `fit-actuator --ablate` and `train --seeds` build their own [`Plan`] and run it with the same
//! engines.
//!
//! # Invariants
//!
//! - A point gets its final folder name when it is complete; a finished point is never run again.
//! - A process that works on a point holds its claim until it ends, and so does its child. One
//!   engine at a time works in a folder: [`FolderLock`].
//! - An interrupted point is not a failure. `fit-actuator` and `train` resume it.
//! - A failed point stays failed until `--retry`.
//!
//! # Not implemented
//!
//! Adaptive search (the grid is fixed before it begins), other schedulers, and Slurm's accounting,
//! which many clusters do not have.
//!
//! ```
//! use klasktron::sweep::parse;
//! let file = parse("lr.toml".as_ref(), "command = \"train\"\nseeds = 3\n[grid]\nhidden = [[8], [64, 64]]\n")?;
//! assert_eq!(file.seeds, Some(vec![0, 1, 2]));
//! let error = parse("lr.toml".as_ref(), "command = \"trian\"").unwrap_err();
//! assert!(error.to_string().starts_with("lr.toml:1: 'trian' cannot be swept; did you mean 'train'?"));
//! # Ok::<(), klasktron::sweep::SweepError>(())
//! ```

mod choice;
mod command;
mod error;
mod file;
mod local;
mod lock;
mod merge;
mod outcome;
mod page;
mod plan;
mod point;
mod run;
mod slurm;
mod store;

pub use choice::{Choice, Combination, choose, combinations};
pub use command::{Better, OptionKind, OptionSpec, SweptCommand, nearest};
pub use error::{FileFault, SweepError};
pub use file::{Located, NamedAxis, NamedSetting, Setting, SweepFile, parse, read_file};
pub use local::{SweepObserver, run_local};
pub use lock::FolderLock;
pub use merge::{Metric, Row, rows, write_tables};
pub use outcome::{FailedPoint, Merged};
pub use page::page;
pub use plan::{CommandLine, GridAxis, MOST_POINTS, Plan};
pub use point::{InputHashes, Point, hash_of, quoted};
pub use run::{Ended, Runner, run_point};
pub use slurm::{
    Jobs, RetryPolicy, SlurmOutcome, SlurmRequest, TASK_DISK_FULL, TASK_FAILED, TASK_INTERRUPTED,
    batch_script, read_task, request_faults, run_slurm, tasks_in_queue,
};
pub use store::{Failure, LOG_FILE, PointRecord, RESULT_FILE, Store};
