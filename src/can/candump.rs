//! Lines of `candump -L`: `(seconds.fraction) interface id#data [R|T]`.
//!
//! Source: can-utils `candump` and `log2asc`, python-can's `CanutilsLogWriter`. Three hexadecimal
//! digits are an 11-bit id, eight a 29-bit id; an id with bit 0x20000000 is an error frame. `#R` or
//! `#R8` is a remote request (RTR). A suffix `_9` to `_F` is a raw length code and is dropped. `##`
//! is CAN FD, which the drives do not support. The fraction has six digits, or nine with
//! nanoseconds.

use super::frame::{Direction, Frame, FrameKind, IdWidth, Payload};
use crate::units::{NANOS_PER_SECOND, Nanos};

const ERROR_FLAG: u32 = 0x2000_0000;
const STANDARD_DIGITS: usize = 3;
const EXTENDED_DIGITS: usize = 8;
const LARGEST_STANDARD_ID: u32 = 0x7FF;
const LARGEST_EXTENDED_ID: u32 = 0x1FFF_FFFF;

/// One line of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogLine {
    /// Time of the host; since the Unix epoch unless the log has relative times.
    pub time: Nanos,
    /// Interface, such as `can0`.
    pub interface: String,
    /// The frame.
    pub frame: Frame,
    /// Direction of the frame; `None` when the line does not give it.
    pub direction: Option<Direction>,
}

/// Syntax error in a line.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CandumpError {
    /// The line does not start with a time in parentheses.
    #[error("'{found}' is no time; expected (seconds.fraction) with 1 to 9 decimals")]
    Time {
        /// Text found in its place.
        found: String,
    },
    /// Interface or frame is missing.
    #[error("the line ends before its {what}; expected (seconds.fraction) interface id#data")]
    Incomplete {
        /// Name of the missing part.
        what: &'static str,
    },
    /// The id is not 3 or 8 hexadecimal digits, or too large.
    #[error("'{found}' is no id; expected 3 hexadecimal digits up to 7FF, or 8 up to 1FFFFFFF")]
    Id {
        /// Text found in its place.
        found: String,
    },
    /// The data are not up to 8 pairs of hexadecimal digits.
    #[error(
        "'{found}' are no data; expected up to 8 pairs of hexadecimal digits, or R for a request"
    )]
    Data {
        /// Text found in its place.
        found: String,
    },
    /// A CAN FD frame.
    #[error("the frame is CAN FD; ODrive 0.6.x speaks classic CAN")]
    FlexibleData,
    /// Something after the frame that is neither R nor T.
    #[error("'{found}' follows the frame; expected R, T or the end of the line")]
    Trailing {
        /// Text found in its place.
        found: String,
    },
}

/// Parse one line.
///
/// # Errors
/// When the line is not from a `candump -L` log, or contains a CAN FD frame.
pub fn parse_line(line: &str) -> Result<LogLine, CandumpError> {
    let mut words = line.split_ascii_whitespace();
    let time = parse_time(words.next().unwrap_or_default())?;
    let interface = words.next().ok_or(CandumpError::Incomplete { what: "interface" })?;
    let frame = parse_frame(words.next().ok_or(CandumpError::Incomplete { what: "frame" })?)?;
    let direction = match words.next() {
        None => None,
        Some("R") => Some(Direction::Received),
        Some("T") => Some(Direction::Sent),
        Some(found) => return Err(CandumpError::Trailing { found: found.to_owned() }),
    };
    if let Some(found) = words.next() {
        return Err(CandumpError::Trailing { found: found.to_owned() });
    }
    Ok(LogLine { time, interface: interface.to_owned(), frame, direction })
}

fn parse_time(word: &str) -> Result<Nanos, CandumpError> {
    let wrong = || CandumpError::Time { found: word.to_owned() };
    let inner = word.strip_prefix('(').and_then(|w| w.strip_suffix(')')).ok_or_else(wrong)?;
    let (seconds, fraction) = inner.split_once('.').ok_or_else(wrong)?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    if !digits(seconds) || !digits(fraction) || 9 < fraction.len() {
        return Err(wrong());
    }
    let nanos: u64 = format!("{fraction:0<9}").parse().map_err(|_not_a_number| wrong())?;
    let seconds: u64 = seconds.parse().map_err(|_too_large| wrong())?;
    let whole = seconds.checked_mul(NANOS_PER_SECOND).ok_or_else(wrong)?;
    Ok(Nanos(whole.checked_add(nanos).ok_or_else(wrong)?))
}

fn parse_frame(word: &str) -> Result<Frame, CandumpError> {
    let (id_text, data_text) =
        word.split_once('#').ok_or(CandumpError::Incomplete { what: "'#' and data" })?;
    if data_text.starts_with('#') {
        return Err(CandumpError::FlexibleData);
    }
    let (id, width, is_error) = parse_id(id_text)?;
    let (kind, data) = if let Some(length) = data_text.strip_prefix(['R', 'r']) {
        if !length.bytes().all(|b| b.is_ascii_hexdigit() || b == b'_') {
            return Err(CandumpError::Data { found: data_text.to_owned() });
        }
        (FrameKind::Remote, Payload::default())
    } else {
        (FrameKind::Data, parse_data(data_text)?)
    };
    let kind = if is_error == ErrorMark::Set { FrameKind::Error } else { kind };
    Ok(Frame { id, width, kind, data })
}

#[derive(PartialEq, Eq)]
enum ErrorMark {
    Set,
    Clear,
}

fn parse_id(text: &str) -> Result<(u32, IdWidth, ErrorMark), CandumpError> {
    let wrong = || CandumpError::Id { found: text.to_owned() };
    if !text.bytes().all(|b| b.is_ascii_hexdigit()) {
        return Err(wrong());
    }
    let id = u32::from_str_radix(text, 16).map_err(|_not_hexadecimal| wrong())?;
    match text.len() {
        STANDARD_DIGITS if id <= LARGEST_STANDARD_ID => {
            Ok((id, IdWidth::Standard, ErrorMark::Clear))
        }
        EXTENDED_DIGITS if id & ERROR_FLAG != 0 => {
            Ok((id & LARGEST_EXTENDED_ID, IdWidth::Extended, ErrorMark::Set))
        }
        EXTENDED_DIGITS if id <= LARGEST_EXTENDED_ID => {
            Ok((id, IdWidth::Extended, ErrorMark::Clear))
        }
        _ => Err(wrong()),
    }
}

fn parse_data(text: &str) -> Result<Payload, CandumpError> {
    let wrong = || CandumpError::Data { found: text.to_owned() };
    let digits = match text.split_once('_') {
        Some((digits, code)) if code.len() == 1 && code.bytes().all(|b| b.is_ascii_hexdigit()) => {
            digits
        }
        Some(_) => return Err(wrong()),
        None => text,
    };
    // candump separates bytes with dots on request; cansend accepts them too.
    let digits: Vec<u8> = digits.bytes().filter(|b| *b != b'.').collect();
    if !digits.len().is_multiple_of(2) {
        return Err(wrong());
    }
    let nibble = |digit: u8| char::from(digit).to_digit(16).map(|value| value as u8);
    let bytes: Option<Vec<u8>> =
        digits.chunks_exact(2).map(|pair| Some(nibble(pair[0])? << 4 | nibble(pair[1])?)).collect();
    bytes.and_then(|bytes| Payload::new(&bytes)).ok_or_else(wrong)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn six_and_nine_digits_and_both_directions() {
        let line = parse_line("(1690000000.123456) can0 029#000000400000C03F").unwrap();
        assert_eq!(line.time, Nanos(1_690_000_000_123_456_000));
        assert_eq!((line.interface.as_str(), line.direction), ("can0", None));
        assert_eq!(line.frame.id, 0x029);
        assert_eq!(line.frame.data.as_slice(), [0, 0, 0, 0x40, 0, 0, 0xC0, 0x3F]);
        let line = parse_line("(0000000001.000000007) vcan0 00D# T").unwrap();
        assert_eq!((line.time, line.direction), (Nanos(1_000_000_007), Some(Direction::Sent)));
        let line = parse_line("(1.5) c 7FF#01 R\r").unwrap();
        assert_eq!((line.time.0, line.direction), (1_500_000_000, Some(Direction::Received)));
    }

    #[test]
    fn requests_extended_ids_error_frames_and_length_codes() {
        for (word, kind, width, id) in [
            ("037#R", FrameKind::Remote, IdWidth::Standard, 0x037),
            ("037#R8", FrameKind::Remote, IdWidth::Standard, 0x037),
            ("00000123#11", FrameKind::Data, IdWidth::Extended, 0x123),
            ("20000080#0000000000000000", FrameKind::Error, IdWidth::Extended, 0x80),
            ("20000080#", FrameKind::Error, IdWidth::Extended, 0x80),
            ("123#1122334455667788_E", FrameKind::Data, IdWidth::Standard, 0x123),
            ("123#R8_9", FrameKind::Remote, IdWidth::Standard, 0x123),
        ] {
            let frame = parse_line(&format!("(1.0) can0 {word}")).unwrap().frame;
            assert_eq!((frame.kind, frame.width, frame.id), (kind, width, id), "{word}");
        }
    }

    #[test]
    fn faults_name_what_was_found() {
        for (line, message) in [
            ("hello", "'hello' is no time; expected (seconds.fraction) with 1 to 9 decimals"),
            (
                "(1.0)",
                "the line ends before its interface; expected (seconds.fraction) interface id#data",
            ),
            ("(1.0) can0 123##1AA", "the frame is CAN FD; ODrive 0.6.x speaks classic CAN"),
            (
                "(1.0) can0 FFF#",
                "'FFF' is no id; expected 3 hexadecimal digits up to 7FF, or 8 up to 1FFFFFFF",
            ),
            (
                "(1.0) can0 123#1",
                "'1' are no data; expected up to 8 pairs of hexadecimal digits, or R for a request",
            ),
            ("(1.0) can0 123#11 X", "'X' follows the frame; expected R, T or the end of the line"),
        ] {
            assert_eq!(parse_line(line).unwrap_err().to_string(), message);
        }
        assert!(parse_line("(99999999999999.0) can0 123#11").is_err(), "beyond the clock's range");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn any_text_is_parsed_or_refused(line in "\\PC{0,60}", tail in "[0-9A-FR#_. ]{0,30}") {
            parse_line(&line).ok();
            parse_line(&format!("(1.0) can0 {tail}")).ok();
        }
    }
}
