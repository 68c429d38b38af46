//! CAN interface of the Linux kernel (SocketCAN).
//!
//! All error frames are requested and reported as [`BusFault`]s. Each frame has the kernel's
//! receive time (`SO_TIMESTAMPNS`, the system's clock). The receive buffer is enlarged as far as
//! the system allows an ordinary user. The socket's own counter (`SO_MEMINFO`, the same number that
//! `SO_RXQ_OVFL` attaches to frames) counts the frames that the kernel dropped because the buffer
//! was full. Frames sent by this socket are not received by it.
//!
//! Source: Linux `Documentation/networking/can.rst`, `linux/sock_diag.h`. Not supported: CAN FD,
//! and hardware time stamps, whose clock is the adapter's own.

use super::{BusFault, Capabilities, LinkError, Received, Transport, fault::faults_of_error_frame};
use crate::{
    can::{Direction, Frame, FrameKind, IdWidth, Payload},
    units::Nanos,
};
use ::socketcan::{
    CanDataFrame, CanFilter, CanFrame, CanRemoteFrame, CanSocket, EmbeddedFrame, ExtendedId,
    Frame as _, Id, Socket, SocketOptions, StandardId,
};
use std::{
    collections::VecDeque,
    io::{self, ErrorKind},
    sync::{Mutex, MutexGuard, PoisonError},
    time::{Duration, SystemTime, UNIX_EPOCH},
};

/// Receive buffer for 20 000 frames: two seconds of a full bus at 1 Mbit/s. An ordinary user gets
/// at most `net.core.rmem_max`, by default 550 frames: 50 ms.
const RECEIVE_BUFFER_BYTES: usize = 8 << 20;
/// Longest wait of a send for the kernel's buffer (a tick of its clock); the queue of the interface
/// never waits.
const SEND_TIMEOUT: Duration = Duration::from_millis(1);
/// Shortest time-out; a time-out of 0 would wait forever.
const SHORTEST_TIMEOUT: Duration = Duration::from_millis(1);

// `asm-generic/socket.h`, `linux/sock_diag.h`.
const SOL_SOCKET: i32 = 1;
const SO_RCVBUFFORCE: i32 = 33;
const SO_MEMINFO: i32 = 55;
const MEMINFO_DROPS: usize = 8;

// `asm-generic/errno-base.h`, `asm-generic/errno.h`.
const ENXIO: i32 = 6;
const ENODEV: i32 = 19;
const EAFNOSUPPORT: i32 = 97;
const ENETDOWN: i32 = 100;
const ENOBUFS: i32 = 105;

/// Filter that passes frames whose id agrees with `id` in the bits of `mask`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IdFilter {
    /// Id; bit 31 is set for a 29-bit id.
    pub id: u32,
    /// Bits that are compared.
    pub mask: u32,
}

/// Socket on an interface.
#[derive(Debug)]
pub struct SocketCan {
    bus: String,
    interface: String,
    socket: CanSocket,
    receiver: Mutex<Receiver>,
}

#[derive(Debug, Default)]
struct Receiver {
    faults: VecDeque<BusFault>,
    timeout: Duration,
    dropped_frames: u32,
}

impl SocketCan {
    /// Open `interface`. The kernel delivers frames that pass any of `filters`, or all frames
    /// without filters. Error frames are always delivered.
    ///
    /// # Errors
    /// When the kernel has no CAN or no such interface, or the interface is down.
    pub fn open(interface: &str, filters: &[IdFilter]) -> Result<Self, LinkError> {
        let bus = format!("socketcan:{interface}");
        let socket = CanSocket::open(interface)
            .and_then(|socket| set_up(&socket, filters).map(|()| socket))
            .map_err(|error| open_error(interface, &error))?;
        let opened =
            Self { bus, interface: interface.to_owned(), socket, receiver: Mutex::default() };
        // The kernel reports an interface that is down once.
        match opened.socket.as_raw_socket().take_error() {
            Ok(Some(error)) if error.raw_os_error() == Some(ENETDOWN) => Err(opened.down()),
            _ => Ok(opened),
        }
    }

    fn down(&self) -> LinkError {
        LinkError::Down { bus: self.bus.clone(), interface: self.interface.clone() }
    }

    fn broken(&self, what: String) -> LinkError {
        LinkError::Unusable {
            bus: self.bus.clone(),
            what,
            remedy: "check whether the adapter is plugged in, and start anew",
        }
    }

    fn receiver(&self) -> MutexGuard<'_, Receiver> {
        self.receiver.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn set_timeout(&self, receiver: &mut Receiver, timeout: Duration) -> Result<(), LinkError> {
        let timeout = timeout.max(SHORTEST_TIMEOUT);
        if receiver.timeout != timeout {
            self.socket
                .set_read_timeout(timeout)
                .map_err(|error| self.broken(format!("the time-out cannot be set ({error})")))?;
            receiver.timeout = timeout;
        }
        Ok(())
    }

    /// Return the number of frames that the kernel dropped since the last call.
    fn newly_dropped(&self, receiver: &mut Receiver) -> u32 {
        let mut info = [0; 4 * (MEMINFO_DROPS + 1)];
        let length = self.socket.get_socket_option_bytes(SOL_SOCKET, SO_MEMINFO, &mut info);
        // Kernels before 4.12 have no such counter.
        if !length.is_ok_and(|length| length == info.len()) {
            return 0;
        }
        let [.., a, b, c, d] = info;
        let total = u32::from_ne_bytes([a, b, c, d]);
        total.wrapping_sub(std::mem::replace(&mut receiver.dropped_frames, total))
    }
}

/// Set all options of a socket.
fn set_up(socket: &CanSocket, filters: &[IdFilter]) -> io::Result<()> {
    socket.set_error_filter_accept_all()?;
    socket.set_recv_timestamp(true)?;
    socket.set_write_timeout(SEND_TIMEOUT)?;
    if !filters.is_empty() {
        let filters: Vec<CanFilter> =
            filters.iter().map(|filter| CanFilter::new(filter.id, filter.mask)).collect();
        socket.set_filters(&filters)?;
    }
    // Where neither succeeds in full, the buffer overflows sooner, which is reported.
    if socket
        .set_socket_option_int(SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BUFFER_BYTES as i32)
        .is_err()
    {
        socket.as_raw_socket().set_recv_buffer_size(RECEIVE_BUFFER_BYTES).ok();
    }
    Ok(())
}

fn open_error(interface: &str, error: &io::Error) -> LinkError {
    let bus = format!("socketcan:{interface}");
    let (what, remedy) = match error.raw_os_error() {
        Some(ENODEV) => (
            format!("there is no interface {interface}"),
            "plug the adapter in and check with: ip link (a kernel without CAN shows none)",
        ),
        Some(EAFNOSUPPORT) => (
            "this kernel has no CAN".to_owned(),
            "load it with: sudo modprobe can_raw, or use a serial adapter or gateway as --bus",
        ),
        _ => (format!("the interface cannot be opened ({error})"), "check with: ip -details link"),
    };
    LinkError::Unusable { bus, what, remedy }
}

impl Transport for SocketCan {
    fn send(&self, frame: &Frame) -> Result<(), LinkError> {
        let frame = to_kernel(frame).ok_or_else(|| LinkError::Unusable {
            bus: self.bus.clone(),
            what: format!("{:?} frame {:03X} cannot be sent", frame.kind, frame.id),
            remedy: "send data or remote frames with 11 or 29 bits of id",
        })?;
        self.socket.write_frame(&frame).map_err(|error| match error.raw_os_error() {
            Some(ENOBUFS) => LinkError::Full { bus: self.bus.clone() },
            Some(ENETDOWN) => self.down(),
            Some(ENXIO | ENODEV) => self.broken("the adapter was disconnected".to_owned()),
            _ if is_pause(&error) => LinkError::Full { bus: self.bus.clone() },
            _ => self.broken(format!("sending failed ({error})")),
        })
    }

    fn receive(&self, timeout: Duration) -> Result<Received, LinkError> {
        let mut receiver = self.receiver();
        if let Some(fault) = receiver.faults.pop_front() {
            return Ok(Received::Fault(fault));
        }
        self.set_timeout(&mut receiver, timeout)?;
        let read = self.socket.read_frame_with_timestamps();
        let dropped = self.newly_dropped(&mut receiver);
        if 0 < dropped {
            receiver.faults.push_back(BusFault::Overrun { frames: dropped });
        }
        match read {
            Ok((CanFrame::Error(error), _)) => {
                receiver.faults.extend(faults_of_error_frame(error.error_bits(), error.data()));
                Ok(receiver.faults.pop_front().map_or(Received::Nothing, Received::Fault))
            }
            Ok((frame, times)) => Ok(Received::Frame {
                frame: from_kernel(&frame),
                stamped_at: times.socket.and_then(since_epoch),
                direction: Direction::Received,
            }),
            Err(error) if is_pause(&error) => {
                Ok(receiver.faults.pop_front().map_or(Received::Nothing, Received::Fault))
            }
            Err(error) => match error.raw_os_error() {
                Some(ENETDOWN | ENODEV) => Ok(Received::Fault(BusFault::LinkDown)),
                _ => Err(self.broken(format!("receiving failed ({error})"))),
            },
        }
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { remote_frames: true, error_frames: true, sending: true }
    }
}

fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

fn since_epoch(time: SystemTime) -> Option<Nanos> {
    let since = time.duration_since(UNIX_EPOCH).ok()?;
    Some(Nanos(u64::try_from(since.as_nanos()).ok()?))
}

/// Convert a frame for the kernel; `None` for error frames and ids that are too large.
fn to_kernel(frame: &Frame) -> Option<CanFrame> {
    let id: Id = match frame.width {
        IdWidth::Standard => StandardId::new(u16::try_from(frame.id).ok()?)?.into(),
        IdWidth::Extended => ExtendedId::new(frame.id)?.into(),
    };
    match frame.kind {
        FrameKind::Data => CanDataFrame::new(id, frame.data.as_slice()).map(CanFrame::Data),
        FrameKind::Remote => CanRemoteFrame::new_remote(id, 0).map(CanFrame::Remote),
        FrameKind::Error => None,
    }
}

fn from_kernel(frame: &CanFrame) -> Frame {
    let (kind, data) = match frame {
        CanFrame::Data(data) => (FrameKind::Data, Payload::new(data.data()).unwrap_or_default()),
        CanFrame::Remote(_) => (FrameKind::Remote, Payload::default()),
        CanFrame::Error(error) => {
            (FrameKind::Error, Payload::new(error.data()).unwrap_or_default())
        }
    };
    let width = if frame.is_extended() { IdWidth::Extended } else { IdWidth::Standard };
    Frame { id: frame.raw_id(), width, kind, data }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_interface_that_is_not_there_says_what_to_do() {
        let missing = SocketCan::open("nocan7", &[]).unwrap_err().to_string();
        assert_eq!(
            missing,
            "socketcan:nocan7: there is no interface nocan7; plug the adapter in and check with: ip \
             link (a kernel without CAN shows none)"
        );
        // The loopback interface exists, but is not a CAN interface.
        let foreign = SocketCan::open("lo", &[]).unwrap_err().to_string();
        assert!(foreign.starts_with("socketcan:lo: "), "{foreign}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn frames_survive_the_kernels_form(id in 0_u32..0x2000_0000, [standard, remote] in any::<[bool; 2]>(), data in proptest::collection::vec(any::<u8>(), 0..=8)) {
            let frame = Frame {
                id: if standard { id & 0x7FF } else { id },
                width: if standard { IdWidth::Standard } else { IdWidth::Extended },
                kind: if remote { FrameKind::Remote } else { FrameKind::Data },
                data: Payload::new(if remote { &[] } else { &data }).unwrap(),
            };
            prop_assert_eq!(from_kernel(&to_kernel(&frame).unwrap()), frame);
        }
    }
}
