"""Recordings of the data contract, written from Python with PyPI's mcap and protobuf.

The message classes are built at run time from datasets_schema/klasktron.proto, so no
protoc is needed. Only the part of proto3 that the file uses is understood: messages
with optional or plain fields and enums inside them. Anything else is an error.
"""

import re
from pathlib import Path

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import CompressionType, Writer

PROTO = Path(__file__).resolve().parent.parent / "datasets_schema" / "klasktron.proto"

SCALARS = {
    "double": descriptor_pb2.FieldDescriptorProto.TYPE_DOUBLE,
    "float": descriptor_pb2.FieldDescriptorProto.TYPE_FLOAT,
    "uint32": descriptor_pb2.FieldDescriptorProto.TYPE_UINT32,
    "uint64": descriptor_pb2.FieldDescriptorProto.TYPE_UINT64,
    "int64": descriptor_pb2.FieldDescriptorProto.TYPE_INT64,
    "bool": descriptor_pb2.FieldDescriptorProto.TYPE_BOOL,
    "string": descriptor_pb2.FieldDescriptorProto.TYPE_STRING,
    "bytes": descriptor_pb2.FieldDescriptorProto.TYPE_BYTES,
}

CHUNK_BYTES = 1 << 20


class ProtoText:
    """The tokens of a .proto file, read from the front."""

    def __init__(self, text):
        without_comments = re.sub(r"//[^\n]*", "", text)
        self.tokens = re.findall(r'"[^"]*"|[\w.]+|[^\s\w]', without_comments)

    def take(self):
        """The next token."""
        return self.tokens.pop(0)

    def expect(self, *wanted):
        """Take the tokens `wanted`, in this order."""
        for token in wanted:
            found = self.take()
            if found != token:
                raise ValueError(f"expected {token!r} in the schema, found {found!r}")

    def is_next(self, token):
        """Whether `token` comes next; it is then taken."""
        if self.tokens and self.tokens[0] == token:
            self.take()
            return True
        return False


def parse_file(text, name):
    """The FileDescriptorProto of a .proto file."""
    source = ProtoText(text)
    source.expect("syntax", "=", '"proto3"', ";", "package")
    package = source.take()
    source.expect(";")
    file = descriptor_pb2.FileDescriptorProto(name=name, package=package, syntax="proto3")
    while source.tokens:
        source.expect("message")
        parse_message(source, file.message_type.add(), package)
    return file


def parse_message(source, message, package):
    """Fill `message` from its name to its closing brace."""
    message.name = source.take()
    source.expect("{")
    while not source.is_next("}"):
        if source.is_next("enum"):
            parse_enum(source, message.enum_type.add())
        else:
            parse_field(source, message, package)


def parse_enum(source, enum):
    """Fill `enum` from its name to its closing brace."""
    enum.name = source.take()
    source.expect("{")
    while not source.is_next("}"):
        value = enum.value.add(name=source.take())
        source.expect("=")
        value.number = int(source.take())
        source.expect(";")


def parse_field(source, message, package):
    """Add one field to `message`."""
    optional = source.is_next("optional")
    labels = descriptor_pb2.FieldDescriptorProto
    label = labels.LABEL_REPEATED if source.is_next("repeated") else labels.LABEL_OPTIONAL
    kind = source.take()
    field = message.field.add(name=source.take(), label=label)
    source.expect("=")
    field.number = int(source.take())
    source.expect(";")
    if kind in SCALARS:
        field.type = SCALARS[kind]
    elif any(enum.name == kind for enum in message.enum_type):
        field.type = descriptor_pb2.FieldDescriptorProto.TYPE_ENUM
        field.type_name = f".{package}.{message.name}.{kind}"
    else:
        field.type = descriptor_pb2.FieldDescriptorProto.TYPE_MESSAGE
        field.type_name = f".{package}.{kind}"
    if optional:
        # proto3 keeps presence in a oneof of its own.
        field.proto3_optional = True
        field.oneof_index = len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{field.name}")


def load_schema(path=PROTO):
    """Message classes by short name, and the serialised FileDescriptorSet."""
    file = parse_file(path.read_text(encoding="utf-8"), path.name)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    classes = {
        message.name: message_factory.GetMessageClass(
            pool.FindMessageTypeByName(f"{file.package}.{message.name}")
        )
        for message in file.message_type
    }
    return classes, descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()


class RecordingFile:
    """A recording being written; messages are given in order of their log time."""

    def __init__(self, path, library, info):
        """Start `path`; `info` becomes the metadata record klasktron.recording."""
        self.messages, self.descriptors = load_schema()
        self.stream = open(path, "wb")
        self.writer = Writer(
            self.stream, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD
        )
        self.writer.start(profile="klasktron", library=library)
        self.writer.add_metadata("klasktron.recording", info)
        self.schemas = {}
        self.channels = {}
        self.counts = {}

    def write(self, topic, log_time, message, publish_time=None):
        """Write one message; times in ns."""
        channel = self.channels.get(topic)
        if channel is None:
            channel = self.add_channel(topic, message.DESCRIPTOR.full_name)
        sequence = self.counts[topic]
        self.counts[topic] = sequence + 1
        self.writer.add_message(
            channel,
            log_time=log_time,
            data=message.SerializeToString(),
            publish_time=log_time if publish_time is None else publish_time,
            sequence=sequence,
        )

    def add_channel(self, topic, schema):
        """Declare `topic` with its schema and return the channel."""
        if schema not in self.schemas:
            self.schemas[schema] = self.writer.register_schema(
                name=schema, encoding="protobuf", data=self.descriptors
            )
        channel = self.writer.register_channel(
            topic=topic, message_encoding="protobuf", schema_id=self.schemas[schema]
        )
        self.channels[topic] = channel
        self.counts[topic] = 0
        return channel

    def finish(self):
        """Write summary and footer."""
        self.writer.finish()
        self.stream.close()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.finish()
