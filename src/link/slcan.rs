//! Serial CAN adapters with the slcan line protocol, on any system.
//!
//! As the host of an adapter, it sends `C`, `S5` and `O` one at a time, because some adapters obey
//! only the first of a packet. It waits briefly for each acknowledgement, which some devices never
//! send. The channel is closed when the transport is dropped. As the device ([`Slcan::serve`]), it
//! offers a virtual table to other software over a pair of pseudo-terminals. Commands are answered
//! like an adapter's, and nothing is sent before the channel is open.
//!
//! Bandwidth: a frame is 22 bytes of text, so at 115200 baud only 520 frames/s fit. USB adapters
//! ignore the baud rate; 1 Mbaud is requested, and a refusal is ignored (pseudo-terminals).
//!
//! Source: see `line.rs` for the protocol. Adapter time stamps (`Z1`) are not supported, because
//! they are relative to the adapter's own clock and wrap each minute.

mod line;

use super::{
    BusFault, Capabilities, LinkError, Received, Transport,
    outbox::{Outbox, Taken},
};
use crate::can::{Direction, Frame};
use line::{FromAdapter, FromHost, LineBuffer};
use serial2::{SerialPort, Settings};
use std::{
    collections::VecDeque,
    io::{self, ErrorKind},
    path::Path,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

const BAUD: u32 = 1_000_000;
/// Longest time to write a frame before it is rejected: a tenth of a control period.
const WRITE_TIMEOUT: Duration = Duration::from_millis(2);
/// Step of the wait for an acknowledgement; the wait takes eight steps.
const ACKNOWLEDGE_STEP: Duration = Duration::from_millis(25);
const ACKNOWLEDGE_STEPS: usize = 8;
/// Bit rates (bit/s) by the digit of the `S` command.
const BIT_RATES: [u32; 9] =
    [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];

/// Command that opens the channel.
const OPEN: &str = "O\r";

/// Role of this end of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    Host,
    Device,
}

/// Serial adapter, or this program in its place.
#[derive(Debug)]
pub struct Slcan {
    bus: String,
    role: Role,
    reader: Mutex<Reader>,
    outbox: Mutex<Outbox<SerialPort>>,
    /// State of the channel, opened by the host; relevant for a device only.
    channel_open: AtomicBool,
}

#[derive(Debug)]
struct Reader {
    port: SerialPort,
    lines: LineBuffer,
    /// Events received before the answer to `O`.
    early: VecDeque<Received>,
    gone: bool,
}

impl Slcan {
    /// Open an adapter at `port` and its channel at `bitrate` (bit/s).
    ///
    /// # Errors
    /// When the device does not exist, cannot be used, or refuses rate or channel.
    pub fn open(port: &Path, bitrate: u32) -> Result<Self, LinkError> {
        let unusable = |what: String, remedy| LinkError::Unusable { bus: name(port), what, remedy };
        let Some(rate) = BIT_RATES.iter().position(|rate| *rate == bitrate) else {
            return Err(unusable(
                format!("slcan adapters do not support {bitrate} bit/s"),
                "take one of 10000, 20000, 50000, 100000, 125000, 250000, 500000, 800000, 1000000",
            ));
        };
        let slcan = Self::with_role(port, Role::Host)?;
        // Input left over from an earlier program is discarded.
        lock(&slcan.reader).port.discard_input_buffer().ok();
        // Adapters refuse this where the channel is closed already.
        slcan.command("C\r")?;
        if slcan.command(&format!("S{rate}\r"))? == Answer::Refused {
            return Err(unusable(
                format!("the adapter refuses {bitrate} bit/s"),
                "unplug it and plug it in again, or take another bit rate",
            ));
        }
        if slcan.command(OPEN)? == Answer::Refused {
            return Err(unusable(
                "the adapter refuses to open its channel".to_owned(),
                "unplug it and plug it in again",
            ));
        }
        Ok(slcan)
    }

    /// Act as the adapter at `port`, so that the program at the other end finds a bus there.
    ///
    /// # Errors
    /// When the device does not exist or cannot be used.
    pub fn serve(port: &Path) -> Result<Self, LinkError> {
        Self::with_role(port, Role::Device)
    }

    fn with_role(port: &Path, role: Role) -> Result<Self, LinkError> {
        let opened = open_port(port).and_then(|mut reader| {
            reader.set_read_timeout(ACKNOWLEDGE_STEP)?;
            let mut writer = reader.try_clone()?;
            writer.set_write_timeout(WRITE_TIMEOUT)?;
            Ok((reader, writer))
        });
        let (reader, writer) = opened.map_err(|error| open_error(port, &error))?;
        Ok(Self {
            bus: name(port),
            role,
            reader: Mutex::new(Reader {
                port: reader,
                lines: LineBuffer::default(),
                early: VecDeque::new(),
                gone: false,
            }),
            outbox: Mutex::new(Outbox::new(writer)),
            channel_open: AtomicBool::new(false),
        })
    }

    /// Send a command and wait briefly for its answer, which may never come.
    fn command(&self, text: &str) -> Result<Answer, LinkError> {
        self.write(text.as_bytes())?;
        let mut reader = lock(&self.reader);
        for _ in 0..ACKNOWLEDGE_STEPS {
            if reader.fill(ACKNOWLEDGE_STEP) == Filled::Gone {
                return Err(self.gone());
            }
            while let Some(line) = reader.lines.next_line() {
                match line::from_adapter(&line) {
                    FromAdapter::Acknowledged => return Ok(Answer::Acknowledged),
                    FromAdapter::Refused => return Ok(Answer::Refused),
                    // Only an open channel reports bus events.
                    other if text == OPEN => reader.early.extend(of_adapter(other)),
                    _ => {}
                }
            }
        }
        Ok(Answer::None)
    }

    fn write(&self, line: &[u8]) -> Result<(), LinkError> {
        match lock(&self.outbox).send(line) {
            Ok(Taken::Whole) => Ok(()),
            Ok(Taken::Nothing) => Err(LinkError::Full { bus: self.bus.clone() }),
            Err(_lost) => Err(self.gone()),
        }
    }

    fn gone(&self) -> LinkError {
        LinkError::Unusable {
            bus: self.bus.clone(),
            what: "the adapter was disconnected".to_owned(),
            remedy: "plug it in again and start anew",
        }
    }

    /// Execute one line of the host; return the frame that it sends on the bus, if any.
    fn serve_line(&self, text: &[u8]) -> Option<Received> {
        let command = line::from_host(text);
        let is_open = self.channel_open.load(Ordering::Relaxed);
        let accepted = match command {
            FromHost::Frame(_) => is_open,
            _ => true,
        };
        match command {
            FromHost::Open => self.channel_open.store(true, Ordering::Relaxed),
            FromHost::Close => self.channel_open.store(false, Ordering::Relaxed),
            _ => {}
        }
        let answer = if accepted { command.answer() } else { line::REFUSAL };
        // An answer that does not fit is lost, as on a real line; the host does not rely on it.
        self.write(answer.as_bytes()).ok();
        match command {
            FromHost::Frame(frame) if accepted => Some(received(frame)),
            _ => None,
        }
    }

    /// Interpret one line; return its event, if any.
    fn interpret(&self, text: &[u8]) -> Option<Received> {
        match self.role {
            Role::Host => of_adapter(line::from_adapter(text)),
            Role::Device => self.serve_line(text),
        }
    }
}

/// Answer of an adapter to a command.
#[derive(Debug, PartialEq, Eq)]
enum Answer {
    Acknowledged,
    Refused,
    None,
}

impl Transport for Slcan {
    fn send(&self, frame: &Frame) -> Result<(), LinkError> {
        if self.role == Role::Device && !self.channel_open.load(Ordering::Relaxed) {
            // An adapter whose channel is closed drops frames of the bus.
            return Ok(());
        }
        let text = line::encode(frame).ok_or_else(|| LinkError::Unusable {
            bus: self.bus.clone(),
            what: format!("{:?} frame {:03X} cannot be sent", frame.kind, frame.id),
            remedy: "send data or remote frames with 11 or 29 bits of id",
        })?;
        self.write(text.as_bytes())
    }

    fn receive(&self, timeout: Duration) -> Result<Received, LinkError> {
        let mut reader = lock(&self.reader);
        if let Some(early) = reader.early.pop_front() {
            return Ok(early);
        }
        for round in 0..2 {
            while let Some(text) = reader.lines.next_line() {
                if let Some(received) = self.interpret(&text) {
                    return Ok(received);
                }
            }
            if reader.gone {
                return Err(self.gone());
            }
            if round == 0 && reader.fill(timeout) == Filled::Gone {
                return Ok(Received::Fault(BusFault::LinkDown));
            }
        }
        Ok(Received::Nothing)
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { remote_frames: true, error_frames: self.role == Role::Host, sending: true }
    }
}

impl Drop for Slcan {
    fn drop(&mut self) {
        if self.role == Role::Host && !lock(&self.reader).gone {
            // The adapter may be disconnected; nothing remains to be done then.
            self.write(b"C\r").ok();
        }
    }
}

/// Result of a read.
#[derive(Debug, PartialEq, Eq)]
enum Filled {
    Something,
    Nothing,
    Gone,
}

impl Reader {
    /// Read once, waiting at most `timeout`.
    fn fill(&mut self, timeout: Duration) -> Filled {
        // The port counts whole milliseconds.
        let timeout = Duration::from_millis(timeout.as_micros().div_ceil(1000) as u64);
        let mut bytes = [0; 4096];
        let read = self.port.set_read_timeout(timeout).and_then(|()| self.port.read(&mut bytes));
        match read {
            Ok(count) if 0 < count => {
                self.lines.push(&bytes[..count]);
                Filled::Something
            }
            Err(error) if is_pause(&error) => Filled::Nothing,
            Ok(_) | Err(_) => {
                self.gone = true;
                Filled::Gone
            }
        }
    }
}

fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Open and set up a port: raw, at high speed if possible, with the terminal-ready signal if
/// available.
fn open_port(port: &Path) -> io::Result<SerialPort> {
    let fast = |mut settings: Settings| {
        settings.set_raw();
        settings.set_baud_rate(BAUD)?;
        Ok(settings)
    };
    let as_it_is = |mut settings: Settings| {
        settings.set_raw();
        Ok(settings)
    };
    let opened =
        SerialPort::open(port, fast).or_else(|_too_fast| SerialPort::open(port, as_it_is))?;
    // Pseudo-terminals have no such signal; adapters that need it have one.
    opened.set_dtr(true).ok();
    Ok(opened)
}

fn open_error(port: &Path, error: &io::Error) -> LinkError {
    let (what, remedy) = match error.kind() {
        ErrorKind::NotFound => {
            ("there is no such device".to_owned(), "plug the adapter in, or check its device name")
        }
        ErrorKind::PermissionDenied => (
            "permission denied".to_owned(),
            "join its group (often: sudo usermod -aG dialout $USER) and log in again",
        ),
        _ => (
            format!("it cannot be used as a serial port ({error})"),
            "give the device of an slcan adapter, such as /dev/ttyACM0",
        ),
    };
    LinkError::Unusable { bus: name(port), what, remedy }
}

fn name(port: &Path) -> String {
    format!("slcan:{}", port.display())
}

fn received(frame: Frame) -> Received {
    Received::Frame { frame, stamped_at: None, direction: Direction::Received }
}

fn of_adapter(line: FromAdapter) -> Option<Received> {
    match line {
        FromAdapter::Frame(frame) => Some(received(frame)),
        FromAdapter::Fault(fault) => Some(Received::Fault(fault)),
        // Once the channel is open, a refusal concerns a frame.
        FromAdapter::Refused => Some(Received::Fault(BusFault::Overrun { frames: 1 })),
        FromAdapter::Acknowledged | FromAdapter::Unknown => None,
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_opened_says_what_to_do() {
        let missing = Slcan::open(Path::new("/dev/no-such-tty"), 250_000).unwrap_err().to_string();
        assert_eq!(
            missing,
            "slcan:/dev/no-such-tty: there is no such device; plug the adapter in, or check its \
             device name"
        );
        let rate = Slcan::open(Path::new("/dev/null"), 83_333).unwrap_err().to_string();
        assert!(rate.contains("slcan adapters do not support 83333 bit/s; take one of 10000"));
        let file = tempfile::NamedTempFile::new().unwrap();
        let no_tty = Slcan::serve(file.path()).unwrap_err().to_string();
        assert!(no_tty.contains("it cannot be used as a serial port"), "{no_tty}");
    }
}
