//! Messages of the socketcand protocol: words between `<` and `>`.
//!
//! Source: socketcand `doc/protocol.md` and its `state_raw.c`. Received frames are `< frame 029
//! 1795218329.532654 0000C03F000080BE >` (padded, no spaces). Errors are `< error CLASS time >`
//! with the classes of an error frame in hexadecimal. Sent frames are `< send 2D 8 0 0 20 40 0 0 0
//! 0 >`; an id of eight digits has 29 bits.

use super::super::hex;
use crate::{
    can::{Frame, FrameKind, IdWidth},
    units::{NANOS_PER_SECOND, Nanos},
};
use std::{collections::VecDeque, fmt::Write as _};

/// Longest valid message, with room for the text of an error.
const LONGEST_MESSAGE: usize = 200;
/// Number of decimals of a nanosecond.
const FRACTION_DIGITS: usize = 9;

/// Splitter of a byte stream into messages. Text outside of `<` and `>` and overlong messages are
/// dropped.
#[derive(Debug, Default)]
pub(super) struct MessageBuffer {
    /// Message in progress.
    partial: Option<String>,
    whole: VecDeque<String>,
}

impl MessageBuffer {
    /// Append received bytes.
    pub(super) fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            match (*byte, &mut self.partial) {
                (b'<', _) => self.partial = Some(String::new()),
                (b'>', _) => self.whole.extend(self.partial.take()),
                (_, Some(text)) if text.len() == LONGEST_MESSAGE => self.partial = None,
                (other, Some(text)) => text.push(char::from(other.min(0x7F))),
                (_, None) => {}
            }
        }
    }

    /// Return the next whole message.
    pub(super) fn next_message(&mut self) -> Option<Message> {
        self.whole.pop_front().map(|text| parse(&text))
    }
}

/// Message of a server.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Message {
    Hi,
    Ok,
    Echo,
    Frame {
        frame: Frame,
        stamped_at: Option<Nanos>,
    },
    /// Error on the bus, by its classes.
    BusError {
        classes: u32,
    },
    /// Refusal of a command, in the server's words.
    Refused(String),
    Unknown,
}

fn parse(text: &str) -> Message {
    let words: Vec<&str> = text.split_ascii_whitespace().collect();
    match words.as_slice() {
        ["hi"] => Message::Hi,
        ["ok"] => Message::Ok,
        ["echo"] => Message::Echo,
        ["frame", id, time, data @ ..] => {
            parse_frame(id, time, &data.concat()).unwrap_or(Message::Unknown)
        }
        ["error", classes, time] if parse_time(time).is_some() => {
            let classes = hex::number(classes.as_bytes());
            classes.map_or(Message::Unknown, |classes| Message::BusError { classes })
        }
        ["error", what @ ..] => Message::Refused(what.join(" ")),
        _ => Message::Unknown,
    }
}

fn parse_frame(id: &str, time: &str, data: &str) -> Option<Message> {
    let width =
        if id.len() == hex::EXTENDED_DIGITS { IdWidth::Extended } else { IdWidth::Standard };
    let number = hex::number(id.as_bytes()).filter(|id| hex::id_fits(*id, width))?;
    let data = hex::payload(data.as_bytes())?;
    let frame = Frame { id: number, width, kind: FrameKind::Data, data };
    Some(Message::Frame { frame, stamped_at: parse_time(time) })
}

fn parse_time(text: &str) -> Option<Nanos> {
    let (seconds, fraction) = text.split_once('.')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    if !digits(seconds) || !digits(fraction) || FRACTION_DIGITS < fraction.len() {
        return None;
    }
    let nanos: u64 = format!("{fraction:0<FRACTION_DIGITS$}").parse().ok()?;
    let seconds: u64 = seconds.parse().ok()?;
    Some(Nanos(seconds.checked_mul(NANOS_PER_SECOND)?.checked_add(nanos)?))
}

/// Return the message that sends a data frame; `None` for other frames, which the protocol does not
/// support.
pub(super) fn encode(frame: &Frame) -> Option<String> {
    if frame.kind != FrameKind::Data || !hex::id_fits(frame.id, frame.width) {
        return None;
    }
    let data = frame.data.as_slice();
    let mut text = match frame.width {
        IdWidth::Standard => format!("< send {:X} {} ", frame.id, data.len()),
        IdWidth::Extended => format!("< send {:08X} {} ", frame.id, data.len()),
    };
    for byte in data {
        write!(text, "{byte:X} ").ok()?;
    }
    text.push('>');
    Some(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::can::Payload;
    use proptest::prelude::*;

    fn messages_of(bytes: &[u8]) -> Vec<Message> {
        let mut buffer = MessageBuffer::default();
        buffer.push(bytes);
        std::iter::from_fn(|| buffer.next_message()).collect()
    }

    #[test]
    fn known_messages() {
        let frame = |id: u32, width: IdWidth, data: &[u8]| Frame {
            id,
            width,
            kind: FrameKind::Data,
            data: Payload::new(data).unwrap(),
        };
        let velocity = frame(0x2D, IdWidth::Standard, &[0, 0, 0x20, 0x40, 0, 0, 0, 0]);
        assert_eq!(encode(&velocity).unwrap(), "< send 2D 8 0 0 20 40 0 0 0 0 >");
        let extended = frame(0x2D, IdWidth::Extended, &[]);
        assert_eq!(encode(&extended).unwrap(), "< send 0000002D 0 >");
        assert_eq!(encode(&Frame { kind: FrameKind::Remote, ..velocity }), None);
        let stamped_at = Some(Nanos(1_795_218_329_532_654_000));
        let estimates = frame(0x29, IdWidth::Standard, &[0, 0, 0xC0, 0x3F]);
        for (text, expected) in [
            ("< hi >", Message::Hi),
            ("<ok>", Message::Ok),
            ("noise < echo >", Message::Echo),
            (
                "< frame 029 1795218329.532654 0000C03F >",
                Message::Frame { frame: estimates, stamped_at },
            ),
            (
                "< frame 0000002D 1795218329.532654  >",
                Message::Frame { frame: extended, stamped_at },
            ),
            ("< error 0A8 1795218329.532654 >", Message::BusError { classes: 0xA8 }),
            ("< error could not open bus >", Message::Refused("could not open bus".to_owned())),
            ("< frame 800 1.5 00 >", Message::Unknown),
            ("< frame 029 1.5 001 >", Message::Unknown),
        ] {
            assert_eq!(messages_of(text.as_bytes()), [expected], "{text}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn garbage_is_survived(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
            let mut stream = bytes;
            stream.extend(b"< echo >");
            prop_assert_eq!(messages_of(&stream).pop(), Some(Message::Echo));
        }

        #[test]
        fn messages_survive_any_division(id in 0_u32..0x800, data in proptest::collection::vec(any::<u8>(), 0..=8), width in 1_usize..30) {
            let digits: String = data.iter().map(|byte| format!("{byte:02X}")).collect();
            let mut buffer = MessageBuffer::default();
            for piece in format!("< frame {id:03X} 1.000007 {digits} >").as_bytes().chunks(width) {
                buffer.push(piece);
            }
            let data = Payload::new(&data).unwrap();
            let frame = Frame { id, width: IdWidth::Standard, kind: FrameKind::Data, data };
            let expected = Message::Frame { frame, stamped_at: Some(Nanos(1_000_007_000)) };
            prop_assert_eq!(buffer.next_message(), Some(expected));
        }
    }
}
