//! The connection to a table, real or virtual: its clock, its bus, its camera.
//!
//! `collect` and everything else that drives hardware sees only [`Link`]. `LiveLink` joins a
//! [`Transport`] (SocketCAN, a serial adapter, a network gateway, a log) with the system's clock and
//! a camera socket; the virtual rig is a link of its own, with its own clock, so that procedures run
//! on it unchanged and as fast as it can be computed.
//!
//! Time belongs to the link: a procedure asks for the [`next_event`](Link::next_event) until its next
//! deadline, and gets events in the order of their time, or nothing once the deadline has come.
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
    CameraError, CameraSender, CameraSocket, CameraSpec, CameraSpecError, parse_detections,
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

/// Something that the table said.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A frame on the bus that this program did not send.
    Frame {
        /// When the host saw it.
        received_at: Nanos,
        /// The kernel's or gateway's own time of it, where there is one.
        stamped_at: Option<Nanos>,
        /// The frame.
        frame: Frame,
        /// [`Direction::Sent`] in a replayed log of another program's traffic, else received.
        direction: Direction,
    },
    /// One datagram of the camera (one JSON object, not yet parsed).
    Camera {
        /// When it arrived.
        received_at: Nanos,
        /// Its bytes.
        datagram: Vec<u8>,
    },
    /// Trouble on the bus.
    Fault {
        /// When it was noticed.
        at: Nanos,
        /// What it is.
        fault: BusFault,
    },
    /// The log has been replayed to its end; nothing will follow.
    End,
}

/// Trouble on the bus itself, as the controller or the kernel reports it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BusFault {
    /// An error counter has passed 96.
    ErrorWarning,
    /// An error counter has passed 127: the controller no longer signals errors actively.
    ErrorPassive,
    /// Both counters have come back below 96.
    ErrorActive,
    /// The controller has left the bus.
    BusOff,
    /// The controller was restarted after leaving the bus.
    Restarted,
    /// Nobody acknowledged a frame.
    NoAcknowledge,
    /// A bit, form, stuff or CRC error, or lost arbitration.
    Protocol,
    /// Frames were lost between bus and program, so many when that is known.
    Overrun {
        /// Number lost; 0 when unknown.
        frames: u32,
    },
    /// The interface was taken down, or the adapter or gateway has gone.
    LinkDown,
}

impl BusFault {
    /// Whether driving motors over this bus must end: nothing sent can be relied on any more.
    #[must_use]
    pub fn is_fatal(self) -> bool {
        matches!(self, Self::BusOff | Self::Restarted | Self::LinkDown)
    }
}

/// What a bus can do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "three independent abilities, not states")]
pub struct Capabilities {
    /// Whether remote frames reach the drives; else requests go out as empty data frames.
    pub remote_frames: bool,
    /// Whether trouble on the bus is reported.
    pub error_frames: bool,
    /// Whether anything can be sent.
    pub sending: bool,
}

/// A connection to a table.
pub trait Link {
    /// The link's time.
    fn now(&self) -> Nanos;

    /// Sends one frame.
    ///
    /// # Errors
    /// When the bus does not take it; [`LinkError::Full`] is worth another attempt.
    fn send(&mut self, frame: &Frame) -> Result<(), LinkError>;

    /// The next event before `until`, in order of time; `None` as soon as `until` has come.
    ///
    /// # Errors
    /// When the connection is broken for good.
    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError>;

    /// What the bus can do.
    fn capabilities(&self) -> Capabilities;

    /// What is really the case now, from a simulator that tells; only ever for the recording.
    fn true_state(&self) -> Option<BoardState> {
        None
    }

    /// What of the source could not be delivered, each as a sentence.
    fn losses(&self) -> Vec<String> {
        Vec::new()
    }
}

/// What a transport received.
#[derive(Debug, Clone, PartialEq)]
pub enum Received {
    /// A frame, with the source's own time of it (Unix epoch) and direction when it has them.
    Frame {
        /// The frame.
        frame: Frame,
        /// Time of kernel, gateway or log.
        stamped_at: Option<Nanos>,
        /// Received, except in a log.
        direction: Direction,
    },
    /// Trouble on the bus.
    Fault(BusFault),
    /// Nothing within the time-out.
    Nothing,
    /// The log is at its end.
    End,
}

/// A bus on which frames are sent and received, shared between a receiving and a sending thread.
pub trait Transport: Send + Sync {
    /// Sends one frame now or not at all: frames are never queued here.
    ///
    /// # Errors
    /// As [`Link::send`].
    fn send(&self, frame: &Frame) -> Result<(), LinkError>;

    /// Waits at most `timeout` for the next frame or fault.
    ///
    /// # Errors
    /// When the connection is broken for good.
    fn receive(&self, timeout: Duration) -> Result<Received, LinkError>;

    /// What the bus can do.
    fn capabilities(&self) -> Capabilities;
}

/// Why a link cannot be opened or used. Each message is one sentence that says what to do.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// The transmit queue is full at this moment (ENOBUFS): try again, or drop the old setpoint.
    #[error(
        "the transmit queue of {bus} is full; the bus may be overloaded or nobody acknowledges"
    )]
    Full {
        /// The bus.
        bus: String,
    },
    /// The interface is down.
    #[error(
        "{bus} is down; bring it up with: sudo ip link set {interface} up type can bitrate 250000"
    )]
    Down {
        /// The bus.
        bus: String,
        /// Name of the interface.
        interface: String,
    },
    /// Nothing can be sent into a log.
    #[error("{bus} is a log: it can be listened to (--listen), not driven")]
    ReadOnly {
        /// The bus.
        bus: String,
    },
    /// It cannot be opened, or has broken.
    #[error("{bus}: {what}; {remedy}")]
    Unusable {
        /// The bus.
        bus: String,
        /// What happened.
        what: String,
        /// What to do.
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
