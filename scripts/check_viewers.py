#!/usr/bin/env python3
"""What PlotJuggler demands of a recording: scripts/check_viewers.py FILE...

Not PlotJuggler itself. Its MCAP loader and Protobuf parser (plotjuggler_plugins/DataLoadMCAP and ParserProtobuf of
its repository) do these steps, which are done here with Google's Protobuf library for Python: the summary is there
without a scan, each channel's encoding is `protobuf`, its schema is a FileDescriptorSet whose files can be added one
by one and which holds the message by its full name, each message parses, and a first field that is called
`timestamp` would be taken for the time.
"""

import sys

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader


def message_class(schema):
    """The class of a schema's messages, built as PlotJuggler builds it."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    descriptor = pool.FindMessageTypeByName(schema.name)
    assert all(field.name != "timestamp" for field in descriptor.fields), schema.name
    return message_factory.GetMessageClass(descriptor)


def check(path):
    with open(path, "rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None and summary.statistics is not None, f"{path}: no summary"
        classes = {}
        for channel in summary.channels.values():
            assert channel.message_encoding == "protobuf", f"{path}: {channel.topic}"
            classes[channel.id] = message_class(summary.schemas[channel.schema_id])
        messages = 0
        for _, channel, message in reader.iter_messages():
            classes[channel.id].FromString(message.data)
            messages += 1
        assert messages == summary.statistics.message_count, path
        print(f"{path}: {messages} messages on {len(classes)} topics")


def main():
    for path in sys.argv[1:]:
        check(path)


if __name__ == "__main__":
    main()
