//! Hexadecimal digits of the ASCII protocols: parsing and formatting.

use crate::can::{IdWidth, MAX_DATA_BYTES, Payload};

/// Number of digits of an 11-bit id.
pub(super) const STANDARD_DIGITS: usize = 3;
/// Number of digits of a 29-bit id.
pub(super) const EXTENDED_DIGITS: usize = 8;
const LARGEST_STANDARD_ID: u32 = 0x7FF;
const LARGEST_EXTENDED_ID: u32 = 0x1FFF_FFFF;

/// Parse up to eight digits.
pub(super) fn number(digits: &[u8]) -> Option<u32> {
    if digits.is_empty() || EXTENDED_DIGITS < digits.len() {
        return None;
    }
    digits.iter().try_fold(0_u32, |sum, digit| Some(sum << 4 | nibble(*digit)?))
}

/// Return whether an id fits its width.
pub(super) fn id_fits(id: u32, width: IdWidth) -> bool {
    match width {
        IdWidth::Standard => id <= LARGEST_STANDARD_ID,
        IdWidth::Extended => id <= LARGEST_EXTENDED_ID,
    }
}

/// Parse pairs of digits to bytes, at most eight.
pub(super) fn payload(digits: &[u8]) -> Option<Payload> {
    if !digits.len().is_multiple_of(2) || 2 * MAX_DATA_BYTES < digits.len() {
        return None;
    }
    let bytes: Option<Vec<u8>> = digits
        .chunks_exact(2)
        .map(|pair| Some((nibble(pair[0])? << 4 | nibble(pair[1])?) as u8))
        .collect();
    Payload::new(&bytes?)
}

fn nibble(digit: u8) -> Option<u32> {
    char::from(digit).to_digit(16)
}
