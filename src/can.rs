//! CAN bus of the drives: frames, the ODrive CANSimple codec and its enumerations, and logs of
//! `candump`.
//!
//! Everything here is pure: bytes or text in, values out. Transports are in the module `link`.
//!
//! ```
//! use klasktron::can::{Message, candump};
//! let line = candump::parse_line("(1.500000) can0 029#000000400000C03F").unwrap();
//! let decoded = klasktron::can::decode(&line.frame).unwrap();
//! assert_eq!(decoded.node, 1);
//! assert_eq!(
//!     decoded.message,
//!     Message::EncoderEstimates { position_turns: 2.0, velocity_turns_per_s: 1.5 }
//! );
//! ```

pub mod candump;
mod codec;
mod frame;
mod odrive;

pub use codec::{
    BROADCAST_NODE, CodecError, Command, Decoded, Message, TrajectoryState, decode, encode,
};
pub use frame::{Direction, Frame, FrameKind, IdWidth, MAX_DATA_BYTES, Payload};
pub use odrive::{AxisErrors, AxisState, ControlMode, InputMode, ProcedureResult};
