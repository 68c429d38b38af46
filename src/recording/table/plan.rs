//! Columns of a protobuf message, from the descriptor in the recording.
//!
//! Nested messages are flattened with a dot (`ball.x`). A repeated field becomes one column of
//! text, with its elements in brackets. A recursive message is not followed: the inner one stays
//! bytes.

use prost::Message as _;
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorSet,
    field_descriptor_proto::{Label, Type},
};
use std::collections::BTreeMap;

/// Largest depth of nesting; deeper messages stay bytes. Schemas in use are far below.
const MAX_DEPTH: usize = 16;

/// Encoding of a scalar on the wire, with its resulting type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    F64,
    F32,
    /// Varint, two's complement.
    Int,
    /// Varint, two's complement of 32 bits.
    Int32,
    /// Varint, zigzag.
    ZigZag,
    Unsigned,
    Bool,
    Fixed32,
    Fixed64,
    SignedFixed32,
    SignedFixed64,
    Text,
    /// Bytes, groups and recursive messages; shown as hexadecimal digits.
    Bytes,
}

/// Initial value of a column in a present message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// Null until the field occurs.
    Explicit,
    /// Default value, which is omitted on the wire.
    Implicit,
}

/// One column.
#[derive(Debug, Clone)]
pub(super) struct Leaf {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    pub(super) presence: Presence,
    pub(super) repeated: Repeated,
}

/// Repetition of a field in a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Repeated {
    Never,
    Often,
}

/// Destination of a field of one message.
#[derive(Debug, Clone)]
pub(super) enum Target {
    /// Index among the leaves.
    Column(usize),
    /// Nested message.
    Inside(Node),
}

/// One message with the destination of each field.
#[derive(Debug, Clone, Default)]
pub(super) struct Node {
    /// Destinations sorted by field number.
    pub(super) targets: Vec<(u32, Target)>,
}

impl Node {
    pub(super) fn target(&self, number: u32) -> Option<&Target> {
        // Most messages have consecutive field numbers from 1.
        let guess = (number as usize).wrapping_sub(1);
        match self.targets.get(guess) {
            Some((found, target)) if *found == number => Some(target),
            _ => {
                let at = self.targets.binary_search_by_key(&number, |(number, _)| *number).ok()?;
                Some(&self.targets[at].1)
            }
        }
    }
}

/// Selection of the fields that become columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::recording) enum Selection {
    /// All fields.
    Everything,
    /// Single numbers and booleans; no text, bytes and repeated fields.
    Numbers,
}

/// All columns of a message type.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    pub(super) root: Node,
    pub(super) leaves: Vec<Leaf>,
}

impl Plan {
    /// Create the plan of message `full_name` from `descriptors`, a serialised `FileDescriptorSet`;
    /// `None` when it does not define the message.
    pub(super) fn new(full_name: &str, descriptors: &[u8], select: Selection) -> Option<Self> {
        let set = FileDescriptorSet::decode(descriptors).ok()?;
        let mut messages = BTreeMap::new();
        for file in &set.file {
            let scalars = match file.syntax() {
                "proto3" => Presence::Implicit,
                _ => Presence::Explicit,
            };
            let prefix = match file.package() {
                "" => String::new(),
                package => format!(".{package}"),
            };
            collect(&mut messages, &prefix, &file.message_type, scalars);
        }
        let mut planner = Planner { messages, select, leaves: Vec::new(), path: vec![] };
        let root = planner.node(&format!(".{full_name}"), "")?;
        Some(Self { root, leaves: planner.leaves })
    }
}

type Messages<'a> = BTreeMap<String, (&'a DescriptorProto, Presence)>;

fn collect<'a>(
    messages: &mut Messages<'a>,
    prefix: &str,
    types: &'a [DescriptorProto],
    scalars: Presence,
) {
    for message in types {
        let name = format!("{prefix}.{}", message.name());
        collect(messages, &name, &message.nested_type, scalars);
        messages.insert(name, (message, scalars));
    }
}

struct Planner<'a> {
    /// Descriptor by full name with a leading dot, and the presence of its file's scalars.
    messages: Messages<'a>,
    select: Selection,
    leaves: Vec<Leaf>,
    /// Messages in progress, outermost first.
    path: Vec<String>,
}

impl Planner<'_> {
    fn node(&mut self, type_name: &str, prefix: &str) -> Option<Node> {
        if MAX_DEPTH <= self.path.len() || self.path.iter().any(|name| name == type_name) {
            return None;
        }
        let (message, scalars) = *self.messages.get(type_name)?;
        self.path.push(type_name.to_owned());
        let mut node = Node::default();
        for field in &message.field {
            let Ok(number) = u32::try_from(field.number()) else { continue };
            let name = format!("{prefix}{}", field.name());
            if let Some(target) = self.target(field, name, scalars) {
                node.targets.push((number, target));
            }
        }
        node.targets.sort_by_key(|(number, _)| *number);
        self.path.pop();
        Some(node)
    }

    fn target(
        &mut self,
        field: &FieldDescriptorProto,
        name: String,
        scalars: Presence,
    ) -> Option<Target> {
        let repeated = match field.label() {
            Label::Repeated => Repeated::Often,
            Label::Optional | Label::Required => Repeated::Never,
        };
        if field.r#type() == Type::Message
            && repeated == Repeated::Never
            && let Some(inside) = self.node(field.type_name(), &format!("{name}."))
        {
            return Some(Target::Inside(inside));
        }
        let scalar = scalar_of(field.r#type());
        let is_text = matches!(scalar, Scalar::Text | Scalar::Bytes) || repeated == Repeated::Often;
        if is_text && self.select == Selection::Numbers {
            return None;
        }
        let explicit = field.oneof_index.is_some() || field.r#type() == Type::Message;
        let presence = if explicit { Presence::Explicit } else { scalars };
        self.leaves.push(Leaf { name, scalar, presence, repeated });
        Some(Target::Column(self.leaves.len() - 1))
    }
}

fn scalar_of(kind: Type) -> Scalar {
    match kind {
        Type::Double => Scalar::F64,
        Type::Float => Scalar::F32,
        Type::Int64 => Scalar::Int,
        Type::Int32 | Type::Enum => Scalar::Int32,
        Type::Sint32 | Type::Sint64 => Scalar::ZigZag,
        Type::Uint32 | Type::Uint64 => Scalar::Unsigned,
        Type::Bool => Scalar::Bool,
        Type::Fixed32 => Scalar::Fixed32,
        Type::Fixed64 => Scalar::Fixed64,
        Type::Sfixed32 => Scalar::SignedFixed32,
        Type::Sfixed64 => Scalar::SignedFixed64,
        Type::String => Scalar::Text,
        Type::Bytes | Type::Message | Type::Group => Scalar::Bytes,
    }
}
