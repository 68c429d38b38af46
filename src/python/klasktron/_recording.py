"""Recordings as NumPy arrays."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _klasktron
from ._warnings import warn_all

StrPath = str | os.PathLike[str]


@dataclass(frozen=True)
class Run:
    """One scripted run between its markers.

    `split` is `"train"`, `"validation"` or None; times are log times in nanoseconds, the end excluded.
    """

    number: int
    pattern: str
    split: str | None
    start_ns: int
    end_ns: int


class Topic(dict[str, NDArray[Any]]):
    """Columns of one topic by name, all of one length, in order of log time.

    `log_time_ns` and `publish_time_ns` (uint64) come first, then every field of the schema; a field of a nested message
    is `ball.x`. Units are in the names or in the schema. A missing optional value is NaN; a column of integers with one
    is float64. Text is an array of objects; bytes are hexadecimal digits; repeated fields are text in brackets.

    `pandas.DataFrame(topic)` and `polars.DataFrame(topic)` take it as it is.
    """

    def __init__(self, name: str, schema: str, columns: Mapping[str, NDArray[Any]]) -> None:
        super().__init__(columns)
        self.name = name
        self.schema = schema

    @property
    def log_time_ns(self) -> NDArray[np.uint64]:
        """Time of reception of each message, or of sending for a command (ns)."""
        return self["log_time_ns"]

    @property
    def time_s(self) -> NDArray[np.float64]:
        """Log times since the first message of the topic (s)."""
        times = self["log_time_ns"]
        return (times - times[0]) * 1e-9 if len(times) else times.astype(np.float64)

    @property
    def count(self) -> int:
        """Number of messages."""
        return len(self["log_time_ns"])

    def during(self, run: Run) -> Topic:
        """Return the messages of `run`, as views of these columns."""
        times = self["log_time_ns"]
        first, last = np.searchsorted(times, np.array([run.start_ns, run.end_ns], np.uint64))
        own = {name: column[first:last] for name, column in self.items()}
        return Topic(self.name, self.schema, own)

    def __repr__(self) -> str:
        fields = ", ".join(name for name in self if not name.endswith("_time_ns"))
        return f"<klasktron.Topic {self.name}: {self.count} messages of {self.schema} ({fields})>"


class Recording(Mapping[str, Topic]):
    """Topics of a recording by name, with its runs and metadata.

    `metadata` are the metadata records by name, `info` is the record `klasktron.recording`. `attachments` are bytes by
    name. `warnings` are the sentences on lost parts of a damaged file, `skipped` those on topics that are no tables.
    """

    def __init__(self, path: StrPath, parts: dict[str, Any]) -> None:
        self.path = os.fspath(path)
        schemas = parts["schemas"]
        self._topics = {
            name: Topic(name, schemas[name], columns) for name, columns in parts["topics"].items()
        }
        self.runs = [Run(**run) for run in parts["runs"]]
        self.metadata: dict[str, dict[str, str]] = parts["metadata"]
        self.attachments: dict[str, bytes] = parts["attachments"]
        self.sha256: str = parts["sha256"]
        self.profile: str = parts["profile"]
        self.warnings: list[str] = parts["warnings"]
        self.skipped: list[str] = parts["skipped"]

    @property
    def info(self) -> dict[str, str]:
        """Session, split, source and robot of the recording, as far as it has them."""
        return self.metadata.get("klasktron.recording", {})

    @property
    def count(self) -> int:
        """Number of messages of all topics."""
        return sum(topic.count for topic in self.values())

    def __getitem__(self, name: str) -> Topic:
        try:
            return self._topics[name]
        except KeyError:
            known = ", ".join(self._topics) or "none"
            raise KeyError(f"{self.path}: no topic {name}; the topics are {known}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._topics)

    def __len__(self) -> int:
        return len(self._topics)

    def __repr__(self) -> str:
        return f"<klasktron.Recording {self.path}: {self.count} messages on {len(self)} topics>"


def read(path: StrPath, topics: Sequence[str] | None = None) -> Recording:
    """Read a recording (MCAP) or a ROS 2 bag of the KlaskTron stack into NumPy arrays.

    Args:
        path: An MCAP file; a bag as `.db3`, `.mcap` or a folder of parts. A bag is converted to the board frame, as
            `klasktron import` does.
        topics: Names of the topics to read; all by default.

    Raises:
        KlasktronError: If the file cannot be read, is no recording, or lacks one of `topics`.

    A file that ends early or is damaged gives what it holds, and a `UserWarning` on what is lost.
    """
    if isinstance(topics, str):
        topics = [topics]
    parts = _klasktron.read_columns(path, None if topics is None else list(topics))
    warn_all(parts["warnings"])
    return Recording(path, parts)
