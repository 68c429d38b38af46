//! Network gateway with socketcand, such as a Raspberry Pi at the table: ASCII over TCP.
//!
//! The server sends a greeting, receives the interface, and is switched to raw mode. It sends `ok`
//! to the switch before its socket exists, and frames sent at once would be lost. The answer to `<
//! echo >` confirms that it is ready.
//!
//! Limits of the protocol: no remote frames in either direction, error classes without details,
//! time stamps of the server. A missing acknowledgement or a full queue is not reported.
//!
//! Source: socketcand `doc/protocol.md`; undocumented behaviour was measured on the server.

mod message;

use super::{
    BusFault, Capabilities, LinkError, Received, Transport,
    fault::faults_of_error_frame,
    outbox::{Outbox, Taken},
};
use crate::can::{Direction, Frame};
use message::{Message, MessageBuffer};
use std::{
    collections::VecDeque,
    io::{self, ErrorKind, Read},
    net::{TcpStream, ToSocketAddrs},
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest time of the server for each step of the greeting.
const GREETING_TIMEOUT: Duration = Duration::from_secs(3);
/// Longest time to write a frame before it is rejected: a tenth of a control period.
const WRITE_TIMEOUT: Duration = Duration::from_millis(2);
/// Shortest time-out of a socket.
const SHORTEST_TIMEOUT: Duration = Duration::from_millis(1);
const START_SERVER: &str = "start it there, for example: socketcand -i can0";

/// Connection to a gateway.
#[derive(Debug)]
pub struct Socketcand {
    bus: String,
    reader: Mutex<Reader>,
    outbox: Mutex<Outbox<TcpStream>>,
}

#[derive(Debug)]
struct Reader {
    stream: TcpStream,
    messages: MessageBuffer,
    faults: VecDeque<BusFault>,
    gone: bool,
}

impl Socketcand {
    /// Connect to `server` (`host:port`) and open its `interface`.
    ///
    /// # Errors
    /// When the server does not answer, or refuses the interface.
    pub fn open(server: &str, interface: &str) -> Result<Self, LinkError> {
        let bus = format!("socketcand:{server}/{interface}");
        let unusable =
            |what: String, remedy| LinkError::Unusable { bus: bus.clone(), what, remedy };
        let stream = connect(server).map_err(|error| {
            unusable(format!("no answer from {server} ({error})"), START_SERVER)
        })?;
        let broken =
            |error: io::Error| unusable(format!("the connection broke ({error})"), START_SERVER);
        stream.set_nodelay(true).map_err(broken)?;
        stream.set_read_timeout(Some(GREETING_TIMEOUT)).map_err(broken)?;
        stream.set_write_timeout(Some(WRITE_TIMEOUT)).map_err(broken)?;
        let writer = stream.try_clone().map_err(broken)?;
        let mut reader = Reader {
            stream,
            messages: MessageBuffer::default(),
            faults: VecDeque::new(),
            gone: false,
        };
        let mut outbox = Outbox::new(writer);
        for (request, expected) in [
            (String::new(), Message::Hi),
            (format!("< open {interface} >"), Message::Ok),
            ("< rawmode >".to_owned(), Message::Ok),
            ("< echo >".to_owned(), Message::Echo),
        ] {
            outbox.send(request.as_bytes()).map_err(broken)?;
            reader.expect(&expected).map_err(|what| unusable(what, "check the server's log"))?;
        }
        Ok(Self { bus, reader: Mutex::new(reader), outbox: Mutex::new(outbox) })
    }

    fn gone(&self) -> LinkError {
        LinkError::Unusable {
            bus: self.bus.clone(),
            what: "the gateway was disconnected".to_owned(),
            remedy: "check whether it runs and is connected, and start anew",
        }
    }
}

impl Transport for Socketcand {
    fn send(&self, frame: &Frame) -> Result<(), LinkError> {
        let text = message::encode(frame).ok_or_else(|| LinkError::Unusable {
            bus: self.bus.clone(),
            what: format!(
                "{:?} frame {:03X} cannot be sent through a gateway",
                frame.kind, frame.id
            ),
            remedy: "send data frames; an empty one is a request, like a remote frame",
        })?;
        match lock(&self.outbox).send(text.as_bytes()) {
            Ok(Taken::Whole) => Ok(()),
            Ok(Taken::Nothing) => Err(LinkError::Full { bus: self.bus.clone() }),
            Err(_lost) => Err(self.gone()),
        }
    }

    fn receive(&self, timeout: Duration) -> Result<Received, LinkError> {
        let mut reader = lock(&self.reader);
        for round in 0..2 {
            if let Some(received) = reader.next() {
                return Ok(received);
            }
            if reader.gone {
                return Err(self.gone());
            }
            if round == 0 && reader.fill(timeout).is_err() {
                return Ok(Received::Fault(BusFault::LinkDown));
            }
        }
        Ok(Received::Nothing)
    }

    fn capabilities(&self) -> Capabilities {
        Capabilities { remote_frames: false, error_frames: true, sending: true }
    }
}

/// End of the connection.
#[derive(Debug)]
struct Gone;

impl Reader {
    /// Read once, waiting at most `timeout`.
    fn fill(&mut self, timeout: Duration) -> Result<(), Gone> {
        let mut bytes = [0; 4096];
        let timeout = timeout.max(SHORTEST_TIMEOUT);
        let set = self.stream.set_read_timeout(Some(timeout));
        match set.and_then(|()| self.stream.read(&mut bytes)) {
            Ok(count) if 0 < count => {
                self.messages.push(&bytes[..count]);
                Ok(())
            }
            Err(error) if is_pause(&error) => Ok(()),
            Ok(_) | Err(_) => {
                self.gone = true;
                Err(Gone)
            }
        }
    }

    /// Return the next received frame or fault.
    fn next(&mut self) -> Option<Received> {
        loop {
            if let Some(fault) = self.faults.pop_front() {
                return Some(Received::Fault(fault));
            }
            match self.messages.next_message()? {
                Message::Frame { frame, stamped_at } => {
                    return Some(Received::Frame {
                        frame,
                        stamped_at,
                        direction: Direction::Received,
                    });
                }
                Message::BusError { classes } => {
                    self.faults.extend(faults_of_error_frame(classes, &[]));
                }
                _ => {}
            }
        }
    }

    /// Wait for one step of the greeting; return what failed.
    fn expect(&mut self, expected: &Message) -> Result<(), String> {
        loop {
            while let Some(message) = self.messages.next_message() {
                match message {
                    Message::Refused(words) => return Err(format!("the server refuses: {words}")),
                    message if message == *expected => return Ok(()),
                    _ => {}
                }
            }
            let mut bytes = [0; 4096];
            match self.stream.read(&mut bytes) {
                Ok(0) => return Err("the server closed the connection".to_owned()),
                Ok(count) => self.messages.push(&bytes[..count]),
                Err(error) if is_pause(&error) => {
                    return Err(format!("the server does not send {expected:?}"));
                }
                Err(error) => return Err(format!("the connection broke ({error})")),
            }
        }
    }
}

fn is_pause(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Connect to the first address of `server` that answers.
fn connect(server: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
    for address in server.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_TIMEOUT) {
            Ok(stream) => return Ok(stream),
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
