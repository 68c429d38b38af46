//! One classic CAN frame.

use crate::recording::message::{CanFrame, can_frame};

/// Largest number of data bytes of a classic frame.
pub const MAX_DATA_BYTES: usize = 8;

/// Up to eight data bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Payload {
    bytes: [u8; MAX_DATA_BYTES],
    length: u8,
}

impl Payload {
    /// Create a payload of up to eight bytes; `None` when there are more.
    #[must_use]
    pub fn new(data: &[u8]) -> Option<Self> {
        let mut bytes = [0; MAX_DATA_BYTES];
        bytes.get_mut(..data.len())?.copy_from_slice(data);
        Some(Self { bytes, length: data.len() as u8 })
    }

    /// Return the data bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.bytes[..usize::from(self.length)]
    }
}

/// Kind of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameKind {
    /// Data frame.
    Data,
    /// Remote request for the data frame of the same id (RTR).
    Remote,
    /// Error frame of the bus; the id holds its classes.
    Error,
}

/// Width of a frame's id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IdWidth {
    /// 11 bits.
    Standard,
    /// 29 bits.
    Extended,
}

/// Direction of a frame, seen from the host.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// From the bus.
    Received,
    /// To the bus.
    Sent,
}

/// One frame, without its time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// The id without flag bits; 11 or 29 bits by `width`.
    pub id: u32,
    /// Width of the id.
    pub width: IdWidth,
    /// Data, remote request or error.
    pub kind: FrameKind,
    /// The data; empty in a remote frame.
    pub data: Payload,
}

impl Frame {
    /// Convert the frame into the recorded message.
    #[must_use]
    pub fn recorded(&self, direction: Direction) -> CanFrame {
        let direction = match direction {
            Direction::Sent => can_frame::Direction::Sent,
            Direction::Received => can_frame::Direction::Received,
        };
        CanFrame {
            id: self.id,
            extended: self.width == IdWidth::Extended,
            remote: self.kind == FrameKind::Remote,
            error: self.kind == FrameKind::Error,
            data: self.data.as_slice().to_vec(),
            direction: direction.into(),
        }
    }
}
