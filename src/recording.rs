//! Messages in and out of MCAP files, by the data contract in `datasets_schema/`.
//!
//! [`Recording::open`] reads any MCAP file into memory, a damaged one as far as possible.
//! [`RecordingWriter`] writes to a temporary name and renames the complete file. [`inspect`]
//! summarizes a recording and checks its data quality. [`recover`] saves the readable part of a
//! truncated file. [`table`] converts topics into columns for other software.
//!
//! ```
//! use klasktron::recording::{ExistingFile, FlushPolicy, Recording, RecordingWriter, topic};
//! use klasktron::recording::message::VelocityCommand;
//! use klasktron::units::Nanos;
//!
//! let dir = tempfile::tempdir()?;
//! let path = dir.path().join("run.mcap");
//! let mut writer = RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull)?;
//! let left = topic::command(topic::Player::Left);
//! writer.write(&left, Nanos(20_000_000), &VelocityCommand { vx: 0.1, vy: -0.2 })?;
//! writer.finish()?;
//!
//! let recording = Recording::open(&path)?;
//! let commands = recording.series::<VelocityCommand>(&left)?;
//! assert_eq!(commands.values[0].vy, -0.2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod arrival;
mod atomic;
mod belt;
mod error;
mod folder;
mod frame_times;
pub mod inspect;
mod load;
pub mod recover;
mod runs;
mod scan;
mod schema;
mod split;
pub mod table;
pub mod topic;
mod writer;

pub use arrival::arrival_key;
pub use atomic::{ExistingFile, partial_name, write_atomically, write_bytes};
pub use belt::{BELT_KEY, BELT_METRES_PER_TURN};
pub use error::RecordingError;
pub use folder::files_in;
pub use frame_times::FrameTimes;
pub use load::{Attachment, Channel, MessageIndex, Recording, Series, hexadecimal, sha256_of_file};
pub use runs::MarkedRun;
pub use scan::{Loss, MAGIC};
pub use schema::{FILE_DESCRIPTOR_SET, PROTOBUF, SchemaDifference, check_compatible, message};
pub use split::Split;
pub use writer::{
    FlushPolicy, Observer, PROFILE, RECORDING_METADATA, RawSchema, RecordingWriter,
    SESSION_COMPLETED, SESSION_METADATA,
};
