//! Messages of the data contract, generated from `datasets_schema/klasktron.proto`, and the
//! compatibility check of a file's own schema.

use prost::Message as _;
use prost_types::{DescriptorProto, FileDescriptorSet};

/// Rust types of `datasets_schema/klasktron.proto`; each field states its unit.
#[expect(missing_docs, reason = "generated code repeats the comments of the proto file")]
#[expect(clippy::doc_markdown, reason = "generated code")]
pub mod message {
    include!("../../datasets_schema/klasktron.rs");
}

/// Serialised `FileDescriptorSet` in every schema record of a recording.
pub const FILE_DESCRIPTOR_SET: &[u8] = include_bytes!("../../datasets_schema/klasktron.fds");

/// Encoding of schema records and of channels.
pub const PROTOBUF: &str = "protobuf";

/// Difference between a file's schema and the contract's schema of the same name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum SchemaDifference {
    /// Schema record that is not a `FileDescriptorSet`.
    #[error("its schema record is not a FileDescriptorSet")]
    NotADescriptor,
    /// Schema record without the message.
    #[error("its schema record does not define {message}")]
    MessageMissing {
        /// Full name of the message.
        message: String,
    },
    /// Field number with another meaning.
    #[error(
        "field {number} is '{found}' ({found_type}), the contract has '{expected}' ({expected_type})"
    )]
    Field {
        /// Field number.
        number: i32,
        /// Name in the file.
        found: String,
        /// Type in the file.
        found_type: String,
        /// Name in the contract.
        expected: String,
        /// Type in the contract.
        expected_type: String,
    },
}

/// Check that `descriptors`, a file's schema record for `message` (full name), agrees with the
/// contract in every common field number. Missing and additional fields are allowed, since the
/// contract only ever adds fields.
///
/// # Errors
/// The first field that differs.
pub fn check_compatible(message: &str, descriptors: &[u8]) -> Result<(), SchemaDifference> {
    if descriptors == FILE_DESCRIPTOR_SET {
        return Ok(());
    }
    let found = FileDescriptorSet::decode(descriptors)
        .map_err(|_not_protobuf| SchemaDifference::NotADescriptor)?;
    let expected = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET)
        .map_err(|_not_protobuf| SchemaDifference::NotADescriptor)?;
    let missing = || SchemaDifference::MessageMissing { message: message.to_owned() };
    let found = find_message(&found, message).ok_or_else(missing)?;
    let expected = find_message(&expected, message).ok_or_else(missing)?;
    for field in &expected.field {
        let Some(other) = found.field.iter().find(|f| f.number() == field.number()) else {
            continue;
        };
        if other.name() != field.name() || other.r#type() != field.r#type() {
            return Err(SchemaDifference::Field {
                number: field.number(),
                found: other.name().to_owned(),
                found_type: type_name(other),
                expected: field.name().to_owned(),
                expected_type: type_name(field),
            });
        }
    }
    Ok(())
}

fn type_name(field: &prost_types::FieldDescriptorProto) -> String {
    field.r#type().as_str_name().trim_start_matches("TYPE_").to_lowercase()
}

fn find_message<'a>(set: &'a FileDescriptorSet, full_name: &str) -> Option<&'a DescriptorProto> {
    set.file.iter().find_map(|file| {
        let name = full_name.strip_prefix(file.package())?.strip_prefix('.')?;
        file.message_type.iter().find(|message| message.name() == name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edited(edit: impl Fn(&mut prost_types::FieldDescriptorProto)) -> Vec<u8> {
        let mut set = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).unwrap();
        let message = set.file[0].message_type.iter_mut().find(|m| m.name() == "VelocityCommand");
        edit(&mut message.unwrap().field[1]);
        set.encode_to_vec()
    }

    /// The generated descriptor is that of the proto file as it is now: `scripts/generate_schema` renews it.
    #[test]
    fn the_descriptor_has_the_fields_of_the_proto_file() {
        let text = include_str!("../../datasets_schema/klasktron.proto");
        let (mut message, mut fields) = (String::new(), Vec::new());
        for line in text.lines().map(str::trim) {
            let words: Vec<&str> = line.split_whitespace().collect();
            if let ["message", name, ..] = words[..] {
                message = name.to_owned();
            } else if let Some(equals) = words.iter().position(|word| *word == "=")
                && let Ok(number) = words[equals + 1].trim_end_matches(';').parse::<i32>()
                && 2 <= equals
            {
                fields.push((message.clone(), words[equals - 1].to_owned(), number));
            }
        }
        let set = FileDescriptorSet::decode(FILE_DESCRIPTOR_SET).unwrap();
        let described = set.file[0].message_type.iter().flat_map(|message| {
            let name = message.name().to_owned();
            message.field.iter().map(move |f| (name.clone(), f.name().to_owned(), f.number()))
        });
        assert_eq!(described.collect::<Vec<_>>(), fields);
        assert!(40 < fields.len());
    }

    #[test]
    fn the_contract_agrees_with_itself_and_with_fewer_or_more_fields() {
        for number in [2, 99] {
            let file = edited(|field| field.number = Some(number));
            assert_eq!(check_compatible("klasktron.VelocityCommand", &file), Ok(()));
        }
    }

    #[test]
    fn a_renamed_or_retyped_field_is_named() {
        let renamed = edited(|field| field.name = Some("speed".into()));
        let error = check_compatible("klasktron.VelocityCommand", &renamed).unwrap_err();
        assert_eq!(
            error.to_string(),
            "field 2 is 'speed' (double), the contract has 'vy' (double)"
        );
        let retyped = edited(|field| field.r#type = Some(2));
        let error = check_compatible("klasktron.VelocityCommand", &retyped).unwrap_err();
        assert!(error.to_string().contains("'vy' (float)"), "{error}");
    }

    #[test]
    fn foreign_bytes_are_refused() {
        let error = check_compatible("klasktron.VelocityCommand", b"\xff\xff").unwrap_err();
        assert_eq!(error, SchemaDifference::NotADescriptor);
    }
}
