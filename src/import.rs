//! Import of other software's files into recordings: ROS 2 bags, npz archives, CSV tables, candump
//! logs, logs of servo test benches.
//!
//! Every import writes one MCAP file of the data contract, in the board frame, with the original's
//! name and SHA-256 in its metadata. An [`ImportReport`] lists what was written, skipped and lost.
//! A source without runs gets one run around all of its data. A failed import writes nothing.
//!
//! | source | function | topics |
//! |---|---|---|
//! | bag (`.db3`, `.mcap`, a folder of parts) | [`import_bags`] | commands, motors, carriages, drives, board |
//! | npz of the upstream actuator pipeline | [`import_npz`] | commands, carriage, board |
//! | CSV of any single axis | [`import_csv`] | `/axis/NAME/{input,output}` |
//! | raw log of BAM's servo test bench (JSON) | [`import_bam`] | `/axis/NAME/{input,output}` |
//! | `candump -L` log of the drives' bus | [`import_candump`] | frames, motors, carriages, drives, commands |
//!
//! ```
//! use klasktron::import::{AxisColumns, ImportConfig, import_csv};
//! use klasktron::recording::{ExistingFile, Recording, message::AxisOutput, topic};
//!
//! let dir = tempfile::tempdir()?;
//! let table = dir.path().join("slide.csv");
//! std::fs::write(&table, "t,u,x\n0.0,1.5,0.000\n0.1,1.5,0.002\n")?;
//! let output = dir.path().join("slide.mcap");
//! let columns = AxisColumns::new("t", "u:V").position("x");
//! let config = ImportConfig::new(&output, ExistingFile::Refuse);
//! let report = import_csv(&[table], &columns, &config)?;
//! assert!(!report.is_lossy());
//!
//! let recording = Recording::open(&output)?;
//! let motion = recording.series::<AxisOutput>(&topic::axis_output("axis"))?;
//! assert_eq!(motion.values[1].position, Some(0.002));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bag;
mod bam;
mod bus;
mod candump;
pub mod cdr;
mod csv;
mod drives;
mod error;
pub mod known;
mod npz;
mod report;
pub mod rosmsg;
mod run;
mod sqlite;
mod tape;
mod topics;

pub use bam::import_bam;
pub use candump::import_candump;
pub use csv::{
    AxisColumns, ColumnError, PositionUnit, Quantity, column_names, import_csv, read_columns,
};
pub use error::ImportError;
pub use npz::{GRID_SECONDS, import_npz};
pub use report::{ImportReport, Notice, SkipReason, TopicCount};
pub use run::{ImportConfig, SourceKind, Table, import_bags};
