//! Decoder of CDR messages by their definition, never by fixed offsets.
//!
//! Source: OMG DDS-XTypes 1.3, section 7.4. Each message starts with four bytes: representation
//! (big-endian `u16`) and options. Classic CDR aligns to at most 8 bytes, XCDR2 to at most 4,
//! always counted from the end of those four bytes. XCDR2 puts a length before collections of
//! strings and messages, and its delimited form before every message. Parameter lists (mutable
//! types) are refused: no ROS 2 message uses them.

use super::rosmsg::{Arity, Field, Kind, Schema};

/// Length of the header of every message.
pub const HEADER_BYTES: usize = 4;
/// Largest number of pad bytes after the last field, which round the payload up to four.
pub const MOST_PAD_BYTES: usize = 3;
/// Largest nesting depth of messages; ROS messages stay far below.
const MOST_DEPTH: usize = 32;

/// One value, or a structure of values.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Boolean.
    Bool(bool),
    /// Signed integer.
    Int(i64),
    /// Unsigned integer.
    Uint(u64),
    /// Floating-point number.
    Float(f64),
    /// String; bytes that are not UTF-8 are replaced.
    Text(String),
    /// Sequence or array.
    List(Vec<Value>),
    /// Sequence or array of bytes.
    Bytes(Vec<u8>),
    /// Message: names and values in the order of the definition.
    Message(Vec<(String, Value)>),
}

/// Error of decoding a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// Message shorter than its header.
    #[error("{length} bytes, fewer than the 4 of a CDR header")]
    NoHeader {
        /// Number of bytes.
        length: usize,
    },
    /// Unsupported representation.
    #[error("CDR representation 0x{representation:04X} is not supported; expected CDR or XCDR2")]
    Representation {
        /// First two bytes.
        representation: u16,
    },
    /// Message ends inside a field.
    #[error("the {length} bytes end inside field '{field}'")]
    TooShort {
        /// Number of bytes.
        length: usize,
        /// Field.
        field: String,
    },
    /// Message longer than its definition.
    #[error(
        "{left} bytes of {length} remain after the last field; the message has another definition"
    )]
    TooLong {
        /// Number of bytes.
        length: usize,
        /// Number of remaining bytes.
        left: usize,
    },
    /// Field missing or of another type.
    #[error("the message has no {expected} '{path}'")]
    Field {
        /// Path of the field.
        path: String,
        /// Expected type.
        expected: &'static str,
    },
    /// Messages nested too deeply.
    #[error("messages are nested more than 32 deep")]
    Depth,
}

impl Value {
    /// Return the value at `path`, names joined by dots.
    ///
    /// # Errors
    /// When the value is missing.
    pub fn at(&self, path: &str) -> Result<&Self, CdrError> {
        path.split('.')
            .try_fold(self, |value, name| match value {
                Self::Message(fields) => fields.iter().find(|(n, _)| n == name).map(|(_, v)| v),
                _ => None,
            })
            .ok_or_else(|| CdrError::Field { path: path.to_owned(), expected: "field" })
    }

    /// Return the number at `path`, of any numeric type.
    ///
    /// # Errors
    /// When the value is missing or not a number.
    pub fn number(&self, path: &str) -> Result<f64, CdrError> {
        match self.at(path)? {
            Self::Float(value) => Ok(*value),
            Self::Int(value) => Ok(*value as f64),
            Self::Uint(value) => Ok(*value as f64),
            _ => Err(CdrError::Field { path: path.to_owned(), expected: "number" }),
        }
    }

    /// Return the integer at `path`, if it is not negative.
    ///
    /// # Errors
    /// When the value is missing or not an unsigned integer.
    pub fn unsigned(&self, path: &str) -> Result<u64, CdrError> {
        let wrong = || CdrError::Field { path: path.to_owned(), expected: "unsigned integer" };
        match self.at(path)? {
            Self::Uint(value) => Ok(*value),
            Self::Int(value) => u64::try_from(*value).map_err(|_negative| wrong()),
            Self::Bool(value) => Ok(u64::from(*value)),
            _ => Err(wrong()),
        }
    }
}

/// Read a whole message; up to three pad bytes may follow it.
///
/// # Errors
/// When the bytes do not match the definition exactly.
pub fn read_message(schema: &Schema, bytes: &[u8]) -> Result<Value, CdrError> {
    let (header, body) =
        bytes.split_at_checked(HEADER_BYTES).ok_or(CdrError::NoHeader { length: bytes.len() })?;
    let mut reader = Reader { body, at: 0, ..Reader::of_header([header[0], header[1]])? };
    let value = reader.message(schema, &schema.root, MOST_DEPTH)?;
    let left = body.len() - reader.at;
    if MOST_PAD_BYTES < left {
        return Err(CdrError::TooLong { length: bytes.len(), left });
    }
    Ok(value)
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Endian {
    Little,
    Big,
}

/// Parts that are preceded by a length (DHEADER).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Delimiting {
    /// No parts: classic CDR.
    Nothing,
    /// Collections whose elements are not primitive: plain XCDR2.
    Collections,
    /// Messages as well: delimited XCDR2.
    Messages,
}

struct Reader<'a> {
    body: &'a [u8],
    at: usize,
    endian: Endian,
    most_alignment: usize,
    delimiting: Delimiting,
}

impl<'a> Reader<'a> {
    fn of_header(header: [u8; 2]) -> Result<Self, CdrError> {
        let representation = u16::from_be_bytes(header);
        // The lowest bit is set for little endian. XCDR2 has two sets of numbers: that of RTPS 2.5 (6 to 9) and that of earlier drafts (0x10 to 0x15).
        let (most_alignment, delimiting) = match representation & !1 {
            0x00 => (8, Delimiting::Nothing),
            0x06 | 0x10 => (4, Delimiting::Collections),
            0x08 | 0x14 => (4, Delimiting::Messages),
            _ => return Err(CdrError::Representation { representation }),
        };
        let endian = if representation & 1 == 1 { Endian::Little } else { Endian::Big };
        Ok(Self { body: &[], at: 0, endian, most_alignment, delimiting })
    }

    fn take(&mut self, count: usize, field: &str) -> Result<&'a [u8], CdrError> {
        let end = self.at.checked_add(count);
        let bytes = end.and_then(|end| self.body.get(self.at..end)).ok_or_else(|| {
            CdrError::TooShort { length: self.body.len() + HEADER_BYTES, field: field.to_owned() }
        })?;
        self.at += count;
        Ok(bytes)
    }

    /// Return the bits of the next number of `size` bytes (1, 2, 4 or 8), aligned.
    fn bits(&mut self, size: usize, field: &str) -> Result<u64, CdrError> {
        let alignment = size.min(self.most_alignment);
        let pad = self.at.next_multiple_of(alignment) - self.at;
        self.take(pad, field)?;
        let bytes = self.take(size, field)?;
        let shift_in = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
        Ok(match self.endian {
            Endian::Big => bytes.iter().fold(0, shift_in),
            Endian::Little => bytes.iter().rev().fold(0, shift_in),
        })
    }

    fn count(&mut self, field: &str) -> Result<usize, CdrError> {
        Ok(self.bits(4, field)? as usize)
    }

    fn message(&mut self, schema: &Schema, name: &str, depth: usize) -> Result<Value, CdrError> {
        let depth = depth.checked_sub(1).ok_or(CdrError::Depth)?;
        if self.delimiting == Delimiting::Messages {
            self.count(name)?;
        }
        let fields = schema.fields_of(name);
        if fields.is_empty() {
            self.take(1, name)?; // every generator gives an empty message one byte
        }
        let read = |field: &Field| Ok((field.name.clone(), self.field(schema, field, depth)?));
        Ok(Value::Message(fields.iter().map(read).collect::<Result<_, _>>()?))
    }

    fn field(&mut self, schema: &Schema, field: &Field, depth: usize) -> Result<Value, CdrError> {
        if field.arity == Arity::One {
            return self.one(schema, field, depth);
        }
        let primitive = !matches!(field.kind, Kind::Message(_) | Kind::Text | Kind::WideText);
        if Delimiting::Collections <= self.delimiting && !primitive {
            self.count(&field.name)?;
        }
        let count = match field.arity {
            Arity::Fixed(count) => count,
            _ => self.count(&field.name)?,
        };
        if field.kind == Kind::Uint(1) {
            return Ok(Value::Bytes(self.take(count, &field.name)?.to_vec()));
        }
        // No reservation by `count`: it is trusted only as far as there are bytes, and each value takes at least one.
        let mut values = Vec::new();
        for _ in 0..count {
            values.push(self.one(schema, field, depth)?);
        }
        Ok(Value::List(values))
    }

    fn one(&mut self, schema: &Schema, field: &Field, depth: usize) -> Result<Value, CdrError> {
        let name = &field.name;
        Ok(match &field.kind {
            Kind::Bool => Value::Bool(self.bits(1, name)? != 0),
            Kind::Uint(size) => Value::Uint(self.bits(*size, name)?),
            Kind::Int(size) => {
                let unused = 64 - 8 * *size as u32;
                Value::Int((self.bits(*size, name)? << unused) as i64 >> unused)
            }
            Kind::Float(4) => Value::Float(f64::from(f32::from_bits(self.bits(4, name)? as u32))),
            Kind::Float(_) => Value::Float(f64::from_bits(self.bits(8, name)?)),
            Kind::Text => self.text(name)?,
            Kind::WideText => self.wide_text(name)?,
            Kind::Message(part) => self.message(schema, part, depth)?,
        })
    }

    /// Read a string: a count of bytes that includes the closing NUL, then the bytes.
    fn text(&mut self, field: &str) -> Result<Value, CdrError> {
        let count = self.count(field)?;
        let bytes = self.take(count, field)?;
        let bytes = bytes.strip_suffix(b"\0").unwrap_or(bytes);
        Ok(Value::Text(String::from_utf8_lossy(bytes).into_owned()))
    }

    /// Read a wide string: a count of bytes, then 16-bit units without closing NUL.
    fn wide_text(&mut self, field: &str) -> Result<Value, CdrError> {
        let bytes = self.count(field)?;
        let mut units = Vec::new();
        for _ in 0..bytes / 2 {
            units.push(self.bits(2, field)? as u16);
        }
        Ok(Value::Text(String::from_utf16_lossy(&units)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn schema(text: &str) -> Schema {
        Schema::parse("p/T", text).unwrap()
    }

    #[test]
    fn alignment_counts_from_the_end_of_the_header() {
        let schema = schema("uint8 a\nfloat64 b\nstring c\nint16 d");
        let mut bytes = vec![0, 1, 0, 0, 7, 0, 0, 0, 0, 0, 0, 0];
        bytes.extend(1.5_f64.to_le_bytes());
        bytes.extend([3, 0, 0, 0, b'h', b'i', 0, 0]);
        bytes.extend((-2_i16).to_le_bytes());
        let value = read_message(&schema, &bytes).unwrap();
        assert_eq!(value.number("b"), Ok(1.5));
        assert_eq!(value.at("c"), Ok(&Value::Text("hi".into())));
        assert_eq!(value.number("d"), Ok(-2.0));
        bytes.extend([0, 0, 0]);
        assert!(read_message(&schema, &bytes).is_ok(), "three pad bytes");
        bytes.push(0);
        assert_eq!(
            read_message(&schema, &bytes),
            Err(CdrError::TooLong { length: bytes.len(), left: 4 })
        );
    }

    #[test]
    fn big_endian_and_xcdr2() {
        let numbers = schema("uint32 a\nfloat64 b");
        let mut big = vec![0, 0, 0, 0, 0, 0, 0, 9, 0, 0, 0, 0];
        big.extend(2.5_f64.to_be_bytes());
        assert_eq!(read_message(&numbers, &big).unwrap().number("b"), Ok(2.5));
        // XCDR2 aligns the f64 to four bytes only.
        let mut second = vec![0, 7, 0, 0, 9, 0, 0, 0];
        second.extend(2.5_f64.to_le_bytes());
        assert_eq!(read_message(&numbers, &second).unwrap().number("b"), Ok(2.5));
        // A collection of strings is preceded by its own length.
        let texts = schema("string[] names");
        let bytes = [0, 7, 0, 0, 10, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, b'x', 0];
        let value = read_message(&texts, &bytes).unwrap();
        assert_eq!(value.at("names"), Ok(&Value::List(vec![Value::Text("x".into())])));
        let parameter_list = read_message(&texts, &[0, 3, 0, 0, 0]).unwrap_err();
        assert!(parameter_list.to_string().contains("0x0003"));
    }

    #[test]
    fn nested_empty_and_wide() {
        let schema = schema(
            "E nothing\nP[2] two\nwstring w\n====\nMSG: p/E\n====\nMSG: p/P\nint8 v\nbool b",
        );
        let bytes = [0, 1, 0, 0, 0, 0xFF, 1, 2, 0, 0, 0, 0, 4, 0, 0, 0, b'o', 0, b'k', 0];
        let value = read_message(&schema, &bytes).unwrap();
        let Value::List(two) = value.at("two").unwrap() else { panic!("a list") };
        assert_eq!(two[0].number("v"), Ok(-1.0));
        assert_eq!(two[0].unsigned("b"), Ok(1));
        assert_eq!(value.at("w"), Ok(&Value::Text("ok".into())));
        assert!(value.number("two.v").is_err() && value.number("w").is_err());
    }

    #[test]
    fn counts_beyond_the_bytes_are_refused_at_once() {
        let error = read_message(&schema("float64[] v"), &[0, 1, 0, 0, 255, 255, 255, 255]);
        assert_eq!(error, Err(CdrError::TooShort { length: 8, field: "v".into() }));
        let error = read_message(&schema("float64[4000000000] v"), &[0, 1, 0, 0]);
        assert!(error.is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn any_bytes_are_read_or_refused(
            representation in 0_u8..0x16,
            bytes in proptest::collection::vec(any::<u8>(), 0..200),
        ) {
            let schema = schema("P[] p\nstring s\nwstring[<=3] w\nuint8[] b\n====\nMSG: p/P\nE e\nint64 i\n====\nMSG: p/E\n");
            read_message(&schema, &bytes).ok();
            let mut headed = vec![0, representation, 0, 0];
            headed.extend(bytes);
            read_message(&schema, &headed).ok();
        }
    }
}
