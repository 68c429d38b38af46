//! Log of `candump -L` in place of a bus.
//!
//! [`Replay`] delivers its frames immediately, in order, with the log's time stamps and directions.
//! [`ReplayLink`] wraps it as a [`Link`] whose time is the log's, so that a procedure runs through
//! a log at reading speed. Error frames of the log become faults; invalid lines are skipped and
//! counted.

use super::{
    BusFault, Capabilities, Event, Link, LinkError, Received, Transport,
    fault::faults_of_error_frame,
};
use crate::{
    can::{Direction, Frame, FrameKind, candump},
    units::Nanos,
};
use std::{
    collections::VecDeque,
    fs::File,
    io::{BufRead, BufReader},
    path::Path,
    sync::{Mutex, MutexGuard, PoisonError},
    time::Duration,
};

/// Log that is being read.
#[derive(Debug)]
pub struct Replay {
    bus: String,
    interface: Option<String>,
    tape: Mutex<Tape>,
}

#[derive(Debug)]
struct Tape {
    lines: BufReader<File>,
    /// Faults of an error frame that are not delivered yet.
    faults: VecDeque<(Nanos, BusFault)>,
    skipped_lines: u64,
}

/// Content and time of a line.
#[derive(Debug, Clone, PartialEq)]
enum Entry {
    Frame { at: Nanos, frame: Frame, direction: Direction },
    Fault { at: Nanos, fault: BusFault },
    End,
}

impl Replay {
    /// Open the log at `path`, with the frames of `interface` only, or of all interfaces.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn open(path: &Path, interface: Option<&str>) -> Result<Self, LinkError> {
        let bus = format!("replay:{}", path.display());
        let file = File::open(path).map_err(|error| LinkError::Unusable {
            bus: bus.clone(),
            what: format!("the log cannot be opened ({error})"),
            remedy: "give a file that candump -L wrote",
        })?;
        let lines = BufReader::new(file);
        let tape = Tape { lines, faults: VecDeque::new(), skipped_lines: 0 };
        Ok(Self { bus, interface: interface.map(str::to_owned), tape: Mutex::new(tape) })
    }

    /// Return the number of invalid lines so far, including CAN FD frames. Empty lines do not
    /// count.
    #[must_use]
    pub fn skipped_lines(&self) -> u64 {
        self.tape().skipped_lines
    }

    fn tape(&self) -> MutexGuard<'_, Tape> {
        self.tape.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn next_entry(&self) -> Result<Entry, LinkError> {
        let mut tape = self.tape();
        let mut bytes = Vec::new();
        loop {
            if let Some((at, fault)) = tape.faults.pop_front() {
                return Ok(Entry::Fault { at, fault });
            }
            bytes.clear();
            let read = tape.lines.read_until(b'\n', &mut bytes);
            let count = read.map_err(|error| LinkError::Unusable {
                bus: self.bus.clone(),
                what: format!("reading the log failed ({error})"),
                remedy: "copy the file to another disk",
            })?;
            if count == 0 {
                return Ok(Entry::End);
            }
            let text = String::from_utf8_lossy(&bytes);
            if text.trim().is_empty() {
                continue;
            }
            let Ok(line) = candump::parse_line(&text) else {
                tape.skipped_lines += 1;
                continue;
            };
            if self.interface.as_ref().is_some_and(|wanted| *wanted != line.interface) {
                continue;
            }
            let (at, frame) = (line.time, line.frame);
            if frame.kind == FrameKind::Error {
                let faults = faults_of_error_frame(frame.id, frame.data.as_slice());
                tape.faults.extend(faults.into_iter().map(|fault| (at, fault)));
            } else {
                let direction = line.direction.unwrap_or(Direction::Received);
                return Ok(Entry::Frame { at, frame, direction });
            }
        }
    }

    fn read_only(&self) -> LinkError {
        LinkError::ReadOnly { bus: self.bus.clone() }
    }
}

const LOG: Capabilities = Capabilities { remote_frames: false, error_frames: true, sending: false };

impl Transport for Replay {
    fn send(&self, _frame: &Frame) -> Result<(), LinkError> {
        Err(self.read_only())
    }

    fn receive(&self, _timeout: Duration) -> Result<Received, LinkError> {
        Ok(match self.next_entry()? {
            Entry::Frame { at, frame, direction } => {
                Received::Frame { frame, stamped_at: Some(at), direction }
            }
            Entry::Fault { fault, .. } => Received::Fault(fault),
            Entry::End => Received::End,
        })
    }

    fn capabilities(&self) -> Capabilities {
        LOG
    }
}

/// Log as a connection to a table. Its time is that of the last event, or the last deadline. It
/// starts at the first line and never runs backwards.
#[derive(Debug)]
pub struct ReplayLink {
    replay: Replay,
    now: Nanos,
    /// Next entry; `None` after the end was reported.
    next: Option<Entry>,
}

impl ReplayLink {
    /// Create a link at the first line of `replay`.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn new(replay: Replay) -> Result<Self, LinkError> {
        let next = replay.next_entry()?;
        let now = match next {
            Entry::Frame { at, .. } | Entry::Fault { at, .. } => at,
            Entry::End => Nanos(0),
        };
        Ok(Self { replay, now, next: Some(next) })
    }

    /// Return the number of skipped lines, as [`Replay::skipped_lines`].
    #[must_use]
    pub fn skipped_lines(&self) -> u64 {
        self.replay.skipped_lines()
    }

    /// Advance to the next line, and return the event of this one.
    fn take(&mut self, event: Event, at: Nanos) -> Result<Option<Event>, LinkError> {
        self.next = Some(self.replay.next_entry()?);
        self.now = self.now.max(at);
        Ok(Some(event))
    }
}

impl Link for ReplayLink {
    fn now(&self) -> Nanos {
        self.now
    }

    fn send(&mut self, _frame: &Frame) -> Result<(), LinkError> {
        Err(self.replay.read_only())
    }

    fn next_event(&mut self, until: Nanos) -> Result<Option<Event>, LinkError> {
        match self.next {
            Some(Entry::Frame { at, frame, direction }) if at < until => {
                let stamped_at = Some(at);
                self.take(Event::Frame { received_at: at, stamped_at, frame, direction }, at)
            }
            Some(Entry::Fault { at, fault }) if at < until => {
                self.take(Event::Fault { at, fault }, at)
            }
            Some(Entry::End) => {
                self.next = None;
                Ok(Some(Event::End))
            }
            _ => {
                self.now = self.now.max(until);
                Ok(None)
            }
        }
    }

    fn losses(&self) -> Vec<String> {
        match self.skipped_lines() {
            0 => Vec::new(),
            lines => vec![format!("{lines} lines of the log could not be parsed")],
        }
    }

    fn capabilities(&self) -> Capabilities {
        LOG
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    const TEXT: &str = "(100.000000) can0 029#000000400000C03F R\n\
                        \n\
                        what is this\n\
                        (100.010000) can1 029#0000000000000000\n\
                        (100.020000000) can0 02D#0000204000000000 T\n\
                        (100.020500) can0 20000040#0000000000000000\n\
                        (100.030000) can0 037#R\n";

    fn log(text: &str, interface: Option<&str>) -> Replay {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(text.as_bytes()).unwrap();
        Replay::open(file.path(), interface).unwrap()
    }

    #[test]
    fn frames_come_at_once_in_order_with_their_times() {
        let replay = log(TEXT, Some("can0"));
        let mut seen = Vec::new();
        loop {
            match replay.receive(Duration::ZERO).unwrap() {
                Received::Frame { frame, stamped_at, direction } => {
                    seen.push((frame.id, stamped_at.unwrap().0 / 1_000_000, direction));
                }
                Received::Fault(fault) => assert_eq!(fault, BusFault::BusOff),
                Received::End => break,
                Received::Nothing => panic!("a log never waits"),
            }
        }
        let (received, sent) = (Direction::Received, Direction::Sent);
        assert_eq!(
            seen,
            [(0x029, 100_000, received), (0x02D, 100_020, sent), (0x037, 100_030, received)]
        );
        assert_eq!(replay.skipped_lines(), 1);
        assert_eq!(replay.receive(Duration::ZERO).unwrap(), Received::End);
        let frame = Frame {
            id: 0x029,
            width: crate::can::IdWidth::Standard,
            kind: FrameKind::Remote,
            data: crate::can::Payload::default(),
        };
        assert!(matches!(Transport::send(&replay, &frame), Err(LinkError::ReadOnly { .. })));
    }

    #[test]
    fn the_links_time_is_the_logs() {
        let mut link = ReplayLink::new(log(TEXT, None)).unwrap();
        assert_eq!(link.now(), Nanos(100_000_000_000));
        let until = Nanos(100_015_000_000);
        assert!(matches!(link.next_event(until).unwrap(), Some(Event::Frame { .. })));
        assert!(matches!(link.next_event(until).unwrap(), Some(Event::Frame { .. })));
        assert_eq!(link.now(), Nanos(100_010_000_000));
        assert_eq!(link.next_event(until).unwrap(), None);
        assert_eq!(link.now(), until);
        assert_eq!(link.next_event(Nanos(0)).unwrap(), None, "a deadline in the past");
        assert_eq!(link.now(), until, "time does not run backwards");
        let far = Nanos(u64::MAX);
        let events: Vec<Event> = std::iter::from_fn(|| link.next_event(far).unwrap()).collect();
        let fault = Event::Fault { at: Nanos(100_020_500_000), fault: BusFault::BusOff };
        assert_eq!(events.len(), 4);
        assert_eq!(events[1], fault);
        assert_eq!(events[3], Event::End);
        assert_eq!(link.skipped_lines(), 1);
    }

    #[test]
    fn an_empty_log_ends_and_a_missing_one_says_so() {
        let mut link = ReplayLink::new(log("", None)).unwrap();
        assert_eq!(link.next_event(Nanos(1)).unwrap(), Some(Event::End));
        assert_eq!(link.next_event(Nanos(2)).unwrap(), None);
        let error = Replay::open(Path::new("/no/such.log"), None).unwrap_err().to_string();
        assert!(error.starts_with("replay:/no/such.log: the log cannot be opened ("), "{error}");
        assert!(error.ends_with("; give a file that candump -L wrote"), "{error}");
    }
}
