#!/usr/bin/env python3
"""Read recordings with PyPI's mcap, as any other program would.

Usage: check_mcap.py FILE...

Each file must open by its summary, with chunk checksums right, hold as many messages as
its statistics say, give every protobuf message to mcap-protobuf-support, and name its
schema version in the metadata record klasktron.recording. The exit code is 1 when one
file fails, and 2 on wrong usage.
Needs: pip install mcap mcap-protobuf-support
"""

import argparse
import sys
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory


def check(path):
    """Read the whole file; a sentence about it. Raises ValueError when something is wrong."""
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("no summary")
        undecoded = [
            channel.topic
            for channel in summary.channels.values()
            if channel.message_encoding != "protobuf"
        ]
        if undecoded:
            raise ValueError(f"not protobuf: {', '.join(undecoded)}")
        decoded = sum(1 for _ in reader.iter_decoded_messages())
        expected = summary.statistics.message_count
        if decoded != expected:
            raise ValueError(f"{decoded} messages, but its statistics say {expected}")
        attachments = sum(1 for _ in reader.iter_attachments())
        check_metadata(reader.iter_metadata())
    return f"{decoded} messages on {len(summary.channels)} topics, {attachments} attachments"


def check_metadata(records):
    """Raise ValueError unless the records hold the contract's schema version."""
    versions = [
        record.metadata.get("schema_version")
        for record in records
        if record.name == "klasktron.recording"
    ]
    if versions != ["1"]:
        raise ValueError(f"schema_version in klasktron.recording: {versions}, expected ['1']")


def main():
    """Check every file and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE")
    failed = False
    for path in parser.parse_args().files:
        try:
            print(f"{path.name}: {check(path)}")
        except (OSError, ValueError, McapError) as error:
            print(f"{path.name}: FAILED: {error}")
            failed = True
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
