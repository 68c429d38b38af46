//! Lines of the slcan protocol, each ended by a carriage return.
//!
//! | line | meaning |
//! |---|---|
//! | `t` id(3) length data, `T` id(8) ... | data frame, 11- or 29-bit id |
//! | `r` id(3) length, `R` id(8) length | remote frame |
//! | empty, `z`, `Z` | acknowledged |
//! | bell, without a carriage return | refused |
//! | `s` state rx(3) tx(3) | state of the controller: `a`ctive, `w`arning, `p`assive, `b`us-off |
//! | `e` count letters | errors: `a`cknowledge, `b` `B` bit, `c`rc, `f`orm, `s`tuff, `o` `O` overrun |
//! | `C` `O` `L` `S` `s` `V` `v` `N` `F` `Z` `M` `m` | commands of the host |
//!
//! Source: Lawicel CAN232 manual 1.4; status lines as read by Linux `slcan-core.c`. Four digits of
//! adapter time after the data are allowed and dropped. Other lines are unknown and have no effect.

use super::super::{BusFault, hex};
use crate::can::{Frame, FrameKind, IdWidth, MAX_DATA_BYTES, Payload};
use std::{collections::VecDeque, fmt::Write as _};

/// Longest valid line: an extended frame with adapter time.
const LONGEST_LINE: usize = 30;
const TIME_DIGITS: usize = 4;
const BELL: u8 = 0x07;
/// `s`, the state, and two counters of three digits.
const STATE_LINE_BYTES: usize = 8;

/// Refusal of a device.
pub(super) const REFUSAL: &str = "\x07";

/// Splitter of a byte stream into lines. A refusal becomes a line of its own; overlong lines are
/// dropped up to their end.
#[derive(Debug, Default)]
pub(super) struct LineBuffer {
    partial: Vec<u8>,
    overlong: bool,
    lines: VecDeque<Vec<u8>>,
}

impl LineBuffer {
    /// Append received bytes.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match *byte {
                b'\r' => {
                    let line = std::mem::take(&mut self.partial);
                    if !std::mem::take(&mut self.overlong) {
                        self.lines.push_back(line);
                    }
                }
                BELL => {
                    self.partial.clear();
                    self.overlong = false;
                    self.lines.push_back(vec![BELL]);
                }
                b'\n' => {}
                _ if self.partial.len() == LONGEST_LINE => self.overlong = true,
                other => self.partial.push(other),
            }
        }
    }

    /// Return the next whole line, without its end.
    pub(super) fn next_line(&mut self) -> Option<Vec<u8>> {
        self.lines.pop_front()
    }
}

/// Line from an adapter.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FromAdapter {
    Frame(Frame),
    Acknowledged,
    Refused,
    Fault(BusFault),
    Unknown,
}

/// Line from a host.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum FromHost {
    Frame(Frame),
    Open,
    Close,
    /// Bit rate, filters, time stamps: acknowledged by an adapter, without effect on a virtual bus.
    Setting,
    Version,
    SerialNumber,
    StatusFlags,
    /// Empty line between two line ends, which hosts send to finish a torn line.
    Empty,
    Unknown,
}

impl FromHost {
    /// Return the answer of a device.
    pub(super) fn answer(&self) -> &'static str {
        match self {
            Self::Frame(Frame { width: IdWidth::Standard, .. }) => "z\r",
            Self::Frame(Frame { width: IdWidth::Extended, .. }) => "Z\r",
            Self::Open | Self::Close | Self::Setting => "\r",
            Self::Version => "V1013\r",
            Self::SerialNumber => "NKT01\r",
            Self::StatusFlags => "F00\r",
            Self::Empty => "",
            Self::Unknown => REFUSAL,
        }
    }
}

/// Parse a line of an adapter.
pub(super) fn from_adapter(line: &[u8]) -> FromAdapter {
    match line {
        [] | b"z" | b"Z" => FromAdapter::Acknowledged,
        [BELL] => FromAdapter::Refused,
        [b's', ..] => parse_state(line).map_or(FromAdapter::Unknown, FromAdapter::Fault),
        [b'e', ..] => parse_errors(line).map_or(FromAdapter::Unknown, FromAdapter::Fault),
        _ => parse_frame(line).map_or(FromAdapter::Unknown, FromAdapter::Frame),
    }
}

/// Parse a line of a host.
pub(super) fn from_host(line: &[u8]) -> FromHost {
    match line {
        [] => FromHost::Empty,
        b"O" | b"L" => FromHost::Open,
        b"C" => FromHost::Close,
        b"V" | b"v" => FromHost::Version,
        b"N" => FromHost::SerialNumber,
        b"F" => FromHost::StatusFlags,
        [b'S' | b's' | b'Z' | b'M' | b'm', _, ..] => FromHost::Setting,
        _ => parse_frame(line).map_or(FromHost::Unknown, FromHost::Frame),
    }
}

/// Return the line of a frame with its end; `None` for an error frame or an id that is too large.
pub(super) fn encode(frame: &Frame) -> Option<String> {
    let letter = match (frame.kind, frame.width) {
        (FrameKind::Data, IdWidth::Standard) => 't',
        (FrameKind::Data, IdWidth::Extended) => 'T',
        (FrameKind::Remote, IdWidth::Standard) => 'r',
        (FrameKind::Remote, IdWidth::Extended) => 'R',
        (FrameKind::Error, _) => return None,
    };
    if !hex::id_fits(frame.id, frame.width) {
        return None;
    }
    let digits = id_digits(frame.width);
    let data = frame.data.as_slice();
    let mut line = format!("{letter}{:0digits$X}{}", frame.id, data.len());
    for byte in data {
        write!(line, "{byte:02X}").ok()?;
    }
    line.push('\r');
    Some(line)
}

fn id_digits(width: IdWidth) -> usize {
    match width {
        IdWidth::Standard => hex::STANDARD_DIGITS,
        IdWidth::Extended => hex::EXTENDED_DIGITS,
    }
}

fn parse_frame(line: &[u8]) -> Option<Frame> {
    let (letter, rest) = line.split_first()?;
    let (kind, width) = match *letter {
        b't' => (FrameKind::Data, IdWidth::Standard),
        b'T' => (FrameKind::Data, IdWidth::Extended),
        b'r' => (FrameKind::Remote, IdWidth::Standard),
        b'R' => (FrameKind::Remote, IdWidth::Extended),
        _ => return None,
    };
    let (id_text, rest) = rest.split_at_checked(id_digits(width))?;
    let id = hex::number(id_text).filter(|id| hex::id_fits(*id, width))?;
    let (length_text, rest) = rest.split_at_checked(1)?;
    let length = hex::number(length_text)? as usize;
    if MAX_DATA_BYTES < length {
        return None;
    }
    let carried = if kind == FrameKind::Remote { 0 } else { 2 * length };
    let (data_text, time) = rest.split_at_checked(carried)?;
    let is_time = time.len() == TIME_DIGITS && hex::number(time).is_some();
    if !time.is_empty() && !is_time {
        return None;
    }
    let data =
        if kind == FrameKind::Remote { Payload::default() } else { hex::payload(data_text)? };
    Some(Frame { id, width, kind, data })
}

fn parse_state(line: &[u8]) -> Option<BusFault> {
    if line.len() != STATE_LINE_BYTES || !line[2..].iter().all(u8::is_ascii_digit) {
        return None;
    }
    match line[1] {
        b'a' => Some(BusFault::ErrorActive),
        b'w' => Some(BusFault::ErrorWarning),
        b'p' => Some(BusFault::ErrorPassive),
        b'b' => Some(BusFault::BusOff),
        _ => None,
    }
}

/// Return the most severe of the errors in a line.
fn parse_errors(line: &[u8]) -> Option<BusFault> {
    let count = char::from(*line.get(1)?).to_digit(10)? as usize;
    let letters = line.get(2..2 + count).filter(|letters| !letters.is_empty())?;
    let has = |wanted: &[u8]| letters.iter().any(|letter| wanted.contains(letter));
    if has(b"oO") {
        Some(BusFault::Overrun { frames: 0 })
    } else if has(b"a") {
        Some(BusFault::NoAcknowledge)
    } else if has(b"bBcfs") {
        Some(BusFault::Protocol)
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lines_of(bytes: &[u8]) -> Vec<Vec<u8>> {
        let mut buffer = LineBuffer::default();
        buffer.push(bytes);
        std::iter::from_fn(|| buffer.next_line()).collect()
    }

    #[test]
    fn known_lines_of_an_adapter() {
        let frame = Frame {
            id: 0x029,
            width: IdWidth::Standard,
            kind: FrameKind::Data,
            data: Payload::new(&[0, 0, 0, 0, 0, 0, 0xE0, 0xBF]).unwrap(),
        };
        assert_eq!(encode(&frame).unwrap(), "t0298000000000000E0BF\r");
        for (line, expected) in [
            ("t0298000000000000E0BF", FromAdapter::Frame(frame)),
            ("t0298000000000000e0bf1F40", FromAdapter::Frame(frame)),
            ("", FromAdapter::Acknowledged),
            ("z", FromAdapter::Acknowledged),
            ("Z", FromAdapter::Acknowledged),
            ("\x07", FromAdapter::Refused),
            ("sw096000", FromAdapter::Fault(BusFault::ErrorWarning)),
            ("sp128000", FromAdapter::Fault(BusFault::ErrorPassive)),
            ("sb000256", FromAdapter::Fault(BusFault::BusOff)),
            ("sa000000", FromAdapter::Fault(BusFault::ErrorActive)),
            ("e1a", FromAdapter::Fault(BusFault::NoAcknowledge)),
            ("e3bcf", FromAdapter::Fault(BusFault::Protocol)),
            ("e1o", FromAdapter::Fault(BusFault::Overrun { frames: 0 })),
            ("e1O", FromAdapter::Fault(BusFault::Overrun { frames: 0 })),
            ("e", FromAdapter::Unknown),
            ("e9a", FromAdapter::Unknown),
            ("sx000000", FromAdapter::Unknown),
            ("t02980000", FromAdapter::Unknown),
            ("t8000", FromAdapter::Unknown),
            ("T200000000", FromAdapter::Unknown),
            ("t0299000000000000000000", FromAdapter::Unknown),
            ("V1013", FromAdapter::Unknown),
        ] {
            assert_eq!(from_adapter(line.as_bytes()), expected, "{line}");
        }
    }

    #[test]
    fn a_device_answers_as_adapters_do() {
        for (line, answer) in [
            ("C", "\r"),
            ("S8", "\r"),
            ("s0123", "\r"),
            ("O", "\r"),
            ("V", "V1013\r"),
            ("N", "NKT01\r"),
            ("F", "F00\r"),
            ("t0290", "z\r"),
            ("r0378", "z\r"),
            ("T000000290", "Z\r"),
            ("", ""),
            ("what", REFUSAL),
            ("S", REFUSAL),
        ] {
            assert_eq!(from_host(line.as_bytes()).answer(), answer, "{line}");
        }
    }

    #[test]
    fn torn_overlong_and_foreign_bytes_cost_only_their_own_line() {
        let mut stream = b"\n98t0290\rt0290\r".to_vec();
        stream.extend(std::iter::repeat_n(b'x', 1000));
        stream.extend(b"\rt02\x07z\rr0378\r\nt03");
        let lines = lines_of(&stream);
        let read: Vec<FromAdapter> = lines.iter().map(|line| from_adapter(line)).collect();
        let remote = Frame {
            id: 0x037,
            width: IdWidth::Standard,
            kind: FrameKind::Remote,
            data: Payload::default(),
        };
        let empty = Frame { id: 0x029, kind: FrameKind::Data, ..remote };
        assert_eq!(
            read,
            [
                FromAdapter::Unknown,
                FromAdapter::Frame(empty),
                FromAdapter::Refused,
                FromAdapter::Acknowledged,
                FromAdapter::Frame(remote),
            ]
        );
    }

    fn any_frame() -> impl Strategy<Value = Frame> {
        (0_u32..0x2000_0000, any::<[bool; 2]>(), proptest::collection::vec(any::<u8>(), 0..=8))
            .prop_map(|(id, [standard, remote], data)| Frame {
                id: if standard { id & 0x7FF } else { id },
                width: if standard { IdWidth::Standard } else { IdWidth::Extended },
                kind: if remote { FrameKind::Remote } else { FrameKind::Data },
                data: Payload::new(if remote { &[] } else { &data }).unwrap(),
            })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Frames are received as they were sent, for any division into pieces.
        #[test]
        fn frames_survive_any_division(frames in proptest::collection::vec(any_frame(), 0..20), width in 1_usize..40) {
            let text: String = frames.iter().map(|frame| encode(frame).unwrap()).collect();
            let mut buffer = LineBuffer::default();
            let mut arrived = Vec::new();
            for piece in text.as_bytes().chunks(width) {
                buffer.push(piece);
                while let Some(line) = buffer.next_line() {
                    prop_assert_eq!(from_adapter(&line), FromAdapter::Frame(arrived_frame(&line)));
                    arrived.push(arrived_frame(&line));
                }
            }
            prop_assert_eq!(arrived, frames);
        }

        /// Any bytes: no panic, bounded lines, and the next whole frame is read again.
        #[test]
        fn garbage_is_survived(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let mut stream = bytes;
            stream.extend(b"\rt0290\r");
            let lines = lines_of(&stream);
            for line in &lines {
                prop_assert!(line.len() <= LONGEST_LINE);
                from_adapter(line);
                from_host(line);
            }
            prop_assert!(matches!(from_adapter(lines.last().unwrap()), FromAdapter::Frame(_)));
        }
    }

    fn arrived_frame(line: &[u8]) -> Frame {
        parse_frame(line).unwrap()
    }
}
