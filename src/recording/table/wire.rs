//! Decoder of the protobuf wire format by a [`Plan`], without generated code, for any schema.
//!
//! Format: <https://protobuf.dev/programming-guides/encoding/>. Unknown fields are skipped.

use super::plan::{Leaf, Node, Plan, Presence, Repeated, Scalar, Target};
use crate::recording::hexadecimal;
use std::fmt::Write as _;

/// One value of one row.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Cell {
    Null,
    F64(f64),
    F32(f32),
    Int(i64),
    Unsigned(u64),
    Bool(bool),
    Text(String),
}

/// Error of a message that does not match its schema.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(super) enum WireError {
    #[error("it ends in the middle of a field")]
    CutOff,
    #[error("field {0} has another wire type than its schema says")]
    WrongWireType(u32),
    #[error("wire type {0} does not exist")]
    UnknownWireType(u8),
    #[error("field {0} is not UTF-8")]
    NotUtf8(u32),
}

/// Decode one message into `row`, which has one cell per leaf of `plan`.
pub(super) fn decode_row(plan: &Plan, bytes: &[u8], row: &mut [Cell]) -> Result<(), WireError> {
    row.fill(Cell::Null);
    decode_node(plan, &plan.root, bytes, row)
}

fn decode_node(
    plan: &Plan,
    node: &Node,
    mut bytes: &[u8],
    row: &mut [Cell],
) -> Result<(), WireError> {
    set_defaults(plan, node, row);
    while !bytes.is_empty() {
        let key = varint(&mut bytes)?;
        let number = u32::try_from(key >> 3).map_err(|_too_large| WireError::CutOff)?;
        let value = value(&mut bytes, (key & 7) as u8)?;
        match (node.target(number), value) {
            (None, _) => {}
            (Some(Target::Inside(inside)), Value::Bytes(inner)) => {
                decode_node(plan, inside, inner, row)?;
            }
            (Some(Target::Inside(_)), _) => return Err(WireError::WrongWireType(number)),
            (Some(Target::Column(at)), value) => {
                put(&plan.leaves[*at], number, value, &mut row[*at])?;
            }
        }
    }
    Ok(())
}

fn set_defaults(plan: &Plan, node: &Node, row: &mut [Cell]) {
    for (_, target) in &node.targets {
        if let Target::Column(at) = target {
            // A message in two parts keeps the content of the first part.
            if row[*at] == Cell::Null {
                row[*at] = default_of(&plan.leaves[*at]);
            }
        }
    }
}

fn default_of(leaf: &Leaf) -> Cell {
    match (leaf.repeated, leaf.presence, leaf.scalar) {
        (Repeated::Often, _, _) => Cell::Text("[]".to_owned()),
        (_, Presence::Explicit, _) => Cell::Null,
        (_, _, Scalar::F64) => Cell::F64(0.0),
        (_, _, Scalar::F32) => Cell::F32(0.0),
        (_, _, Scalar::Bool) => Cell::Bool(false),
        (_, _, Scalar::Unsigned | Scalar::Fixed32 | Scalar::Fixed64) => Cell::Unsigned(0),
        (_, _, Scalar::Text | Scalar::Bytes) => Cell::Text(String::new()),
        (_, _, Scalar::Int | Scalar::Int32 | Scalar::ZigZag) => Cell::Int(0),
        (_, _, Scalar::SignedFixed32 | Scalar::SignedFixed64) => Cell::Int(0),
    }
}

/// Value on the wire.
#[derive(Clone, Copy)]
enum Value<'a> {
    Varint(u64),
    Fixed32([u8; 4]),
    Fixed64([u8; 8]),
    Bytes(&'a [u8]),
}

fn varint(bytes: &mut &[u8]) -> Result<u64, WireError> {
    let mut value = 0_u64;
    for shift in (0..70).step_by(7) {
        let (first, rest) = bytes.split_first().ok_or(WireError::CutOff)?;
        *bytes = rest;
        value |= u64::from(first & 0x7f).checked_shl(shift).unwrap_or(0);
        if *first < 0x80 {
            return Ok(value);
        }
    }
    Err(WireError::CutOff)
}

fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Result<&'a [u8], WireError> {
    let (head, rest) = bytes.split_at_checked(count).ok_or(WireError::CutOff)?;
    *bytes = rest;
    Ok(head)
}

fn array<const N: usize>(bytes: &mut &[u8]) -> Result<[u8; N], WireError> {
    let (head, rest) = bytes.split_first_chunk().ok_or(WireError::CutOff)?;
    *bytes = rest;
    Ok(*head)
}

fn value<'a>(bytes: &mut &'a [u8], wire_type: u8) -> Result<Value<'a>, WireError> {
    match wire_type {
        0 => varint(bytes).map(Value::Varint),
        1 => array(bytes).map(Value::Fixed64),
        2 => {
            let length = varint(bytes)?;
            let length = usize::try_from(length).map_err(|_too_large| WireError::CutOff)?;
            take(bytes, length).map(Value::Bytes)
        }
        5 => array(bytes).map(Value::Fixed32),
        other => Err(WireError::UnknownWireType(other)),
    }
}

fn put(leaf: &Leaf, number: u32, value: Value<'_>, cell: &mut Cell) -> Result<(), WireError> {
    if leaf.repeated == Repeated::Never {
        *cell = scalar(leaf.scalar, number, value)?;
        return Ok(());
    }
    match (wire_type_of(leaf.scalar), value) {
        (2, _) | (_, Value::Varint(_) | Value::Fixed32(_) | Value::Fixed64(_)) => {
            append(cell, &scalar(leaf.scalar, number, value)?);
        }
        (packed_type, Value::Bytes(mut packed)) => {
            while !packed.is_empty() {
                let element = self::value(&mut packed, packed_type)?;
                append(cell, &scalar(leaf.scalar, number, element)?);
            }
        }
    }
    Ok(())
}

fn wire_type_of(scalar: Scalar) -> u8 {
    match scalar {
        Scalar::F64 | Scalar::Fixed64 | Scalar::SignedFixed64 => 1,
        Scalar::F32 | Scalar::Fixed32 | Scalar::SignedFixed32 => 5,
        Scalar::Text | Scalar::Bytes => 2,
        Scalar::Int | Scalar::Int32 | Scalar::ZigZag | Scalar::Unsigned | Scalar::Bool => 0,
    }
}

fn scalar(scalar: Scalar, number: u32, value: Value<'_>) -> Result<Cell, WireError> {
    Ok(match (scalar, value) {
        (Scalar::F64, Value::Fixed64(bits)) => Cell::F64(f64::from_le_bytes(bits)),
        (Scalar::Fixed64, Value::Fixed64(bits)) => Cell::Unsigned(u64::from_le_bytes(bits)),
        (Scalar::SignedFixed64, Value::Fixed64(bits)) => Cell::Int(i64::from_le_bytes(bits)),
        (Scalar::F32, Value::Fixed32(bits)) => Cell::F32(f32::from_le_bytes(bits)),
        (Scalar::Fixed32, Value::Fixed32(bits)) => Cell::Unsigned(u32::from_le_bytes(bits).into()),
        (Scalar::SignedFixed32, Value::Fixed32(bits)) => Cell::Int(i32::from_le_bytes(bits).into()),
        (Scalar::Int, Value::Varint(bits)) => Cell::Int(bits as i64),
        (Scalar::Int32, Value::Varint(bits)) => Cell::Int(i64::from(bits as i32)),
        (Scalar::ZigZag, Value::Varint(bits)) => {
            Cell::Int((bits >> 1) as i64 ^ -((bits & 1) as i64))
        }
        (Scalar::Unsigned, Value::Varint(bits)) => Cell::Unsigned(bits),
        (Scalar::Bool, Value::Varint(bits)) => Cell::Bool(bits != 0),
        (Scalar::Bytes, Value::Bytes(bytes)) => Cell::Text(hexadecimal(bytes)),
        (Scalar::Text, Value::Bytes(bytes)) => {
            let text = std::str::from_utf8(bytes).map_err(|_invalid| WireError::NotUtf8(number))?;
            Cell::Text(text.to_owned())
        }
        _ => return Err(WireError::WrongWireType(number)),
    })
}

/// Append an element to the text of a repeated field: `[]`, `[1]`, `[1, 2]`.
fn append(cell: &mut Cell, element: &Cell) {
    let Cell::Text(text) = cell else { return };
    text.pop();
    if 1 < text.len() {
        text.push_str(", ");
    }
    // Writing to a String does not fail.
    match element {
        Cell::Null => Ok(()),
        Cell::F64(value) => write!(text, "{value}"),
        Cell::F32(value) => write!(text, "{value}"),
        Cell::Int(value) => write!(text, "{value}"),
        Cell::Unsigned(value) => write!(text, "{value}"),
        Cell::Bool(value) => write!(text, "{value}"),
        Cell::Text(value) => write!(text, "{value:?}"),
    }
    .ok();
    text.push(']');
}
