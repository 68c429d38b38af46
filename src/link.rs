//! Connection to a table, real or virtual: its clock, its bus and its camera.
//!
//! `collect` and every other part that drives hardware uses only [`Link`]. `LiveLink` combines a
//! [`Transport`] (SocketCAN, a serial adapter, a network gateway, a log) with the system's clock
//! and a camera socket. The virtual rig is a separate link with its own clock, so that procedures
//! run on it unchanged and as fast as it can be computed.
//!
//! The link owns the time. A procedure requests the [`next_event`](Link::next_event) until its next
//! deadline. It receives events in the order of their time, or `None` once the deadline has come.
//!
//! ```
//! use klasktron::link::{BusSpec, Event, Link, Replay, ReplayLink};
//! let log = std::env::temp_dir().join("klasktron-link-example.log");
//! std::fs::write(&log, "(1.500000) can0 029#000000400000C03F\n").unwrap();
//! let bus: BusSpec = format!("replay:{}", log.display()).parse().unwrap();
//! let BusSpec::Replay(path) = bus else { unreachable!() };
//! let mut link = ReplayLink::new(Replay::open(&path, None).unwrap()).unwrap();
//! let deadline = link.now().after_seconds(0.02);
//! assert!(matches!(link.next_event(deadline).unwrap(), Some(Event::Frame { .. })));
//! ```

pub mod camera;
mod fault;
mod hex;
mod live;
mod outbox;
mod replay;
mod slcan;
#[cfg(target_os = "linux")]
mod socketcan;
mod socketcand;
mod spec;

#[cfg(target_os = "linux")]
pub use self::socketcan::{IdFilter, SocketCan};
pub use self::socketcand::Socketcand;
pub use camera::{
    CameraError, CameraFeed, CameraSender, CameraSocket, CameraSpec, CameraSpecError,
    parse_detections,
};
pub use live::LiveLink;
pub use replay::{Replay, ReplayLink};
pub use slcan::Slcan;
pub use spec::{BusLock, BusSpec, BusSpecError, TransportSpec};

use crate::{
    can::{Direction, Frame},
    recording::message::BoardState,
    units::Nanos,
};
use std::time::Duration;

/// Event from the table.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A frame on the bus that this program did not send.
    Frame {
        /// Time of reception on the host.
        received_at: Nanos,
        /// Time stamp of the kernel or the gateway, if available.
        stamped_at: Option<Nanos>,
        /// The frame.
        frame: Frame,
        /// [`Direction::Sent`] in a replayed log of another program's traffic, else received.
        direction: Direction,
    },
    /// One datagram of the camera (one JSON object, not yet parsed).
    Camera {
        /// Time of arrival.
        received_at: Nanos,
        /// Bytes of the datagram.
        datagram: Vec<u8>,
    },
    /// Fault on the bus.
    Fault {
        /// Time of detection.
        at: Nanos,
        /// Kind of fault.
        fault: BusFault,
    },
    /// End of the log; no event follows.
    End,
}

/// Fault of the bus, as reported by the controller or the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusFault {
    /// An error counter exceeded 96.
    ErrorWarning,
    /// An error counter exceeded 127: the controller no longer signals errors actively.
    ErrorPassive,
    /// Both counters fell below 96.
    ErrorActive,
    /// The controller has left the bus.
    BusOff,
    /// The controller was restarted after leaving the bus.
    Restarted,
    /// No node acknowledged a frame.
    NoAcknowledge,
    /// A bit, form, stuff or CRC error, or lost arbitration.
    Protocol,
    /// Frames were lost between bus and program.
    Overrun {
        /// Number of lost frames; 0 when unknown.
        frames: u32,
    },
    /// The interface was taken down, or the adapter or gateway was disconnected.
    LinkDown,
}

impl BusFault {
    /// Return whether driving motors over this bus must stop, because no sent frame is reliable.
    #[must_use]
    pub fn is_fatal(self) -> bool {
        matches!(self, Self::BusOff | Self::Restarted | Self::LinkDown)
    }
}

/// Capabilities of a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "three independent abilities, not states")]
pub struct Capabilities {
    /// Remote frames reach the drives; otherwise requests are sent as empty data frames.
    pub remote_frames: bool,
    /// Faults on the bus are reported.
    pub error_frames: bool,
    /// Frames can be sent.
    pub sending: bool,
}

/// Connection to a table.
pub trait Link {
    /// Return the time of the link.
    fn now(&self) -> Nanos;

    /// Send one frame.
    ///
    /// # Errors
    /// When the bus does not take it; after [`LinkError::Full`] a retry can succeed.
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError>;

    /// Return the next event before `until`, in order of time; `None` as soon as `until` has come.
    ///
    /// # Errors
    /// When the connection is broken permanently.
    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError>;

    /// Return the capabilities of the bus.
    fn capabilities(&self) -> Capabilities;

    /// Return the true state, if the link is a simulator that provides it; only for the recording.
    fn true_state(&self) -> Option<BoardState> {
        None
    }

    /// Return the losses of the source, each as a sentence.
    fn losses(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Result of receiving from a transport.
#[derive(Debug, Clone, PartialEq)]
pub enum Received {
    /// Frame, with the source's time stamp (Unix epoch) and direction if available.
    Frame {
        /// The frame.
        frame: Frame,
        /// Time stamp of kernel, gateway or log.
        stamped_at: Option<Nanos>,
        /// Received, except in a log.
        direction: Direction,
    },
    /// Fault on the bus.
    Fault(BusFault),
    /// Time-out without a frame.
    Nothing,
    /// End of the log.
    End,
}

/// Bus for sending and receiving frames, shared between a receiving and a sending thread.
pub trait Transport: Send + Sync {
    /// Send one frame now or not at all: frames are never queued.
    ///
    /// # Errors
    /// As [`Link::send`].
    fn send(&self, frame: &Frame) -> Result<(), LinkError>;

    /// Wait at most `timeout` for the next frame or fault.
    ///
    /// # Errors
    /// When the connection is broken permanently.
    fn receive(&self, timeout: Duration) -> Result<Received, LinkError>;

    /// Return the capabilities of the bus.
    fn capabilities(&self) -> Capabilities;
}

/// Error of opening or using a link. Each message is one sentence with the remedy.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// Transmit queue full (ENOBUFS): retry, or drop the old setpoint.
    #[error(
        "the transmit queue of {bus} is full; the bus may be overloaded, or no node acknowledges"
    )]
    Full {
        /// Name of the bus.
        bus: String,
    },
    /// Interface down.
    #[error(
        "{bus} is down; bring it up with: sudo ip link set {interface} up type can bitrate 250000"
    )]
    Down {
        /// Name of the bus.
        bus: String,
        /// Name of the interface.
        interface: String,
    },
    /// Attempt to send into a log.
    #[error("{bus} is a log: it can be listened to (--listen), not driven")]
    ReadOnly {
        /// Name of the bus.
        bus: String,
    },
    /// Bus that cannot be opened, or failed.
    #[error("{bus}: {what}; {remedy}")]
    Unusable {
        /// Name of the bus.
        bus: String,
        /// Description of the failure.
        what: String,
        /// Remedy.
        remedy: &'static str,
    },
}

impl std::fmt::Display for BusFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::ErrorWarning => "an error counter has passed 96",
            Self::ErrorPassive => "the controller is error passive",
            Self::ErrorActive => "the controller is error active again",
            Self::BusOff => "the controller has left the bus (bus-off)",
            Self::Restarted => "the controller was restarted after bus-off",
            Self::NoAcknowledge => "nobody acknowledges frames; check wiring, bit rate and supply",
            Self::Protocol => "bit, form, stuff or CRC errors, or lost arbitration",
            Self::Overrun { frames: 0 } => "frames were lost before they could be read",
            Self::Overrun { frames } => {
                return write!(f, "{frames} frames were lost before they could be read");
            }
            Self::LinkDown => "the interface is down or the adapter has gone",
        })
    }
}
