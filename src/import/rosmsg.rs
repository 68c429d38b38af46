//! Parser of ROS 2 message definitions (`ros2msg`). One text has the root definition first and
//! every used type after a line of `=`, each introduced by `MSG: package/Type`.
//!
//! Source: the ROS 2 interface description (design.ros2.org, "Interface definition using .msg").
//! Both `package/Type` and `package/msg/Type` are supported. A bare `Type` belongs to the package
//! of its definition, and `Header` to `std_msgs`. Constants and default values have no bytes and
//! are skipped. An empty message is one byte on the wire, as every ROS 2 generator writes it.
//! Services and actions (`---`) are refused.

use std::collections::BTreeMap;

/// Type of one value of a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Kind {
    /// Boolean, one byte.
    Bool,
    /// Signed integer of this many bytes.
    Int(usize),
    /// Unsigned integer of this many bytes.
    Uint(usize),
    /// Floating-point number of this many bytes.
    Float(usize),
    /// String of UTF-8 bytes.
    Text,
    /// String of 16-bit code units.
    WideText,
    /// Another message, by its full name `package/Type`.
    Message(String),
}

/// Number of values of a field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arity {
    /// One value.
    One,
    /// Fixed number of values, without a count on the wire.
    Fixed(usize),
    /// Variable number of values with a count on the wire; a bound changes nothing on the wire.
    Sequence,
}

/// One field of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Name.
    pub name: String,
    /// Type of each value.
    pub kind: Kind,
    /// Number of values.
    pub arity: Arity,
}

/// Message type with every type that it uses.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Schema {
    /// Full name of the root, `package/Type`.
    pub root: String,
    fields: BTreeMap<String, Vec<Field>>,
}

/// Error of a definition.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RosMsgError {
    /// Service or action.
    #[error("line {line} of the definition is '---': services and actions are not messages")]
    Service {
        /// Line, from 1.
        line: usize,
    },
    /// Line that declares nothing.
    #[error("line {line} of the definition, '{text}', is neither a field nor a constant")]
    Line {
        /// Line, from 1.
        line: usize,
        /// Text of the line.
        text: String,
    },
    /// Used type without a definition.
    #[error("the definition uses '{name}' without defining it")]
    Undefined {
        /// Missing type.
        name: String,
    },
    /// Type that contains itself.
    #[error("'{name}' contains itself")]
    Recursive {
        /// The type.
        name: String,
    },
}

impl Schema {
    /// Parse the definition of `root` (`package/Type` or `package/msg/Type`) and its parts.
    ///
    /// # Errors
    /// See [`RosMsgError`].
    pub fn parse(root: &str, text: &str) -> Result<Self, RosMsgError> {
        let root = short_name(root);
        let mut fields: BTreeMap<String, Vec<Field>> = BTreeMap::new();
        let mut current = root.clone();
        fields.insert(current.clone(), Vec::new());
        let mut after_separator = false;
        for (number, raw) in text.lines().enumerate() {
            let line = without_comment(raw).trim();
            if is_separator(line) {
                after_separator = true;
            } else if let Some(name) = line.strip_prefix("MSG:").filter(|_| after_separator) {
                current = short_name(name.trim());
                fields.insert(current.clone(), Vec::new());
                after_separator = false;
            } else if line == "---" {
                return Err(RosMsgError::Service { line: number + 1 });
            } else if !line.is_empty() {
                let wrong = || RosMsgError::Line { line: number + 1, text: line.to_owned() };
                if let Some(field) = parse_field(line, &current).ok_or_else(wrong)? {
                    fields.entry(current.clone()).or_default().push(field);
                }
            }
        }
        add_builtin_times(&mut fields);
        let schema = Self { root, fields };
        schema.check(&schema.root, &mut Vec::new(), &mut Vec::new())?;
        Ok(schema)
    }

    /// Return the fields of the type called `name`; empty for a message without fields.
    #[must_use]
    pub fn fields_of(&self, name: &str) -> &[Field] {
        self.fields.get(name).map_or(&[], Vec::as_slice)
    }

    /// Check for types that are missing or contain themselves. `open` are the types around `name`.
    fn check<'a>(
        &'a self,
        name: &'a str,
        open: &mut Vec<&'a str>,
        done: &mut Vec<&'a str>,
    ) -> Result<(), RosMsgError> {
        if done.contains(&name) {
            return Ok(());
        }
        if open.contains(&name) {
            return Err(RosMsgError::Recursive { name: name.to_owned() });
        }
        let undefined = || RosMsgError::Undefined { name: name.to_owned() };
        let fields = self.fields.get(name).ok_or_else(undefined)?;
        open.push(name);
        for field in fields {
            if let Kind::Message(part) = &field.kind {
                self.check(part, open, done)?;
            }
        }
        open.pop();
        done.push(name);
        Ok(())
    }
}

/// Return `package/Type` for `package/msg/Type` and `package/Type`.
#[must_use]
pub fn short_name(name: &str) -> String {
    let mut parts = name.split('/').filter(|part| !part.is_empty());
    match (parts.next(), parts.next_back()) {
        (Some(package), Some(kind)) => format!("{package}/{kind}"),
        (Some(alone), None) => alone.to_owned(),
        _ => String::new(),
    }
}

fn is_separator(line: &str) -> bool {
    4 <= line.len() && line.bytes().all(|byte| byte == b'=')
}

/// Return the line up to a `#` outside of quotes.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    for (at, character) in line.char_indices() {
        match (quote, character) {
            (None, '#') => return &line[..at],
            (None, '"' | '\'') => quote = Some(character),
            (Some(open), _) if open == character => quote = None,
            _ => {}
        }
    }
    // An apostrophe in a comment opens a quote that never closes; fall back to the first '#'.
    if quote.is_some() { line.split('#').next().unwrap_or_default() } else { line }
}

/// Parse a field: `Some(None)` for a constant, `None` for a line that declares nothing.
fn parse_field(line: &str, inside: &str) -> Option<Option<Field>> {
    let (type_text, rest) = line.split_once(|c: char| c.is_ascii_whitespace())?;
    let rest = rest.trim();
    let name_length =
        rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_')).unwrap_or(rest.len());
    let (name, tail) = rest.split_at(name_length);
    if name.is_empty() || name.starts_with(|c: char| c.is_ascii_digit()) {
        return None;
    }
    let (element, arity) = parse_arity(type_text)?;
    let kind = parse_kind(element, inside)?;
    let tail = tail.trim_start();
    if tail.starts_with('=') {
        return Some(None); // a constant
    }
    Some(Some(Field { name: name.to_owned(), kind, arity }))
}

fn parse_arity(text: &str) -> Option<(&str, Arity)> {
    let Some((element, bracket)) = text.split_once('[') else { return Some((text, Arity::One)) };
    let size = bracket.strip_suffix(']')?;
    if size.is_empty() {
        return Some((element, Arity::Sequence));
    }
    match size.strip_prefix("<=") {
        Some(bound) => bound.parse::<usize>().ok().map(|_bound| (element, Arity::Sequence)),
        None => Some((element, Arity::Fixed(size.parse().ok()?))),
    }
}

fn parse_kind(text: &str, inside: &str) -> Option<Kind> {
    let (base, bound) = match text.split_once("<=") {
        Some((base, bound)) => (base, Some(bound)),
        None => (text, None),
    };
    if let Some(bound) = bound {
        bound.parse::<usize>().ok()?;
    }
    Some(match base {
        "bool" => Kind::Bool,
        "byte" | "char" | "uint8" => Kind::Uint(1),
        "int8" => Kind::Int(1),
        "int16" => Kind::Int(2),
        "uint16" => Kind::Uint(2),
        "int32" => Kind::Int(4),
        "uint32" => Kind::Uint(4),
        "int64" => Kind::Int(8),
        "uint64" => Kind::Uint(8),
        "float32" => Kind::Float(4),
        "float64" => Kind::Float(8),
        "string" => Kind::Text,
        "wstring" => Kind::WideText,
        _ if bound.is_some() => return None,
        "Header" => Kind::Message("std_msgs/Header".to_owned()),
        "time" => Kind::Message("builtin_interfaces/Time".to_owned()),
        "duration" => Kind::Message("builtin_interfaces/Duration".to_owned()),
        _ if !base.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'/') => {
            return None;
        }
        _ if base.contains('/') => Kind::Message(short_name(base)),
        _ => {
            let package = inside.split('/').next().unwrap_or_default();
            Kind::Message(format!("{package}/{base}"))
        }
    })
}

/// Add the definitions of the two time types, which some bags lack.
fn add_builtin_times(fields: &mut BTreeMap<String, Vec<Field>>) {
    let field = |name: &str, kind| Field { name: name.to_owned(), kind, arity: Arity::One };
    for name in ["builtin_interfaces/Time", "builtin_interfaces/Duration"] {
        fields
            .entry(name.to_owned())
            .or_insert_with(|| vec![field("sec", Kind::Int(4)), field("nanosec", Kind::Uint(4))]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const EVERYTHING: &str = "\
# a comment with an apostrophe: the robot's
std_msgs/Header header
Part part   # trailing
other_pkg/msg/Thing[] things
float64[3] fixed
string<=12[<=4] names
wstring wide
uint8 LIMIT=200
string GREETING=\"a # b\"
int32 with_default 42
byte[<=8] raw
================================================================================
MSG: my_pkg/Part
bool yes
====
MSG: other_pkg/Thing
====
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
";

    #[test]
    fn every_case_of_the_language() {
        let schema = Schema::parse("my_pkg/msg/Root", EVERYTHING).unwrap();
        assert_eq!(schema.root, "my_pkg/Root");
        let fields = schema.fields_of("my_pkg/Root");
        let names: Vec<&str> = fields.iter().map(|field| field.name.as_str()).collect();
        assert_eq!(
            names,
            ["header", "part", "things", "fixed", "names", "wide", "with_default", "raw"]
        );
        assert_eq!(fields[1].kind, Kind::Message("my_pkg/Part".into()));
        assert_eq!((&fields[3].kind, fields[3].arity), (&Kind::Float(8), Arity::Fixed(3)));
        assert_eq!((&fields[4].kind, fields[4].arity), (&Kind::Text, Arity::Sequence));
        assert_eq!(schema.fields_of("other_pkg/Thing"), []);
        assert_eq!(schema.fields_of("builtin_interfaces/Time").len(), 2);
    }

    #[test]
    fn faults_are_named() {
        let error = |text| Schema::parse("p/T", text).unwrap_err().to_string();
        assert_eq!(
            error("int32 a\n---\nint32 b\n"),
            "line 2 of the definition is '---': services and actions are not messages"
        );
        assert_eq!(error("Missing m"), "the definition uses 'p/Missing' without defining it");
        assert_eq!(error("T again"), "'p/T' contains itself");
        assert_eq!(
            error("int32"),
            "line 1 of the definition, 'int32', is neither a field nor a constant"
        );
        assert_eq!(
            error("int32[x] a"),
            "line 1 of the definition, 'int32[x] a', is neither a field nor a constant"
        );
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]

        #[test]
        fn any_text_is_parsed_or_refused(text in "([a-zA-Z0-9_/<=\\[\\] #'\"\n]|MSG: |====\n|int32 a\n){0,80}") {
            Schema::parse("p/T", &text).ok();
        }
    }
}
