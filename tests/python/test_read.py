"""Recordings and bags as arrays, compared with what the program exports."""

import csv
import math
import sqlite3
import struct
import warnings

import numpy as np
import pytest

import klasktron


def exported(program, recording, topic, folder):
    """Columns of `topic` as the program exports them: text by name."""
    path = folder / "topic.csv"
    program("export", recording, "--to", "csv", "--topic", topic, "-o", path)
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


@pytest.mark.parametrize(
    "topic", ["/striker/left/command", "/striker/left/carriage", "/camera/detections", "/run/marker"]
)
def test_columns_are_those_of_the_export(program, train, tmp_path, topic):
    wanted = exported(program, train, topic, tmp_path)
    found = klasktron.read(train)[topic]
    assert list(found) == list(wanted)
    for name, texts in wanted.items():
        column = found[name]
        assert len(column) == len(texts) == found.count
        if column.dtype == object:
            assert list(column) == texts
        else:
            values = [math.nan if text == "" else float(text) for text in texts]
            assert np.array_equal(column.astype(float), values, equal_nan=True), name


def test_runs_split_the_recording(train):
    recording = klasktron.read(train)
    assert recording.info["session"] == "example-train"
    assert len(recording.runs) == 12
    commands = recording["/striker/left/command"]
    parts = [commands.during(run) for run in recording.runs]
    assert all(0 < part.count for part in parts)
    assert sum(part.count for part in parts) <= commands.count
    first = recording.runs[0]
    assert first.split == "train"
    times = parts[0].log_time_ns
    assert first.start_ns <= times[0] <= times[-1] < first.end_ns
    # Views: nothing is copied.
    assert np.shares_memory(parts[0]["vx"], commands["vx"])
    assert commands.time_s[0] == 0.0 and commands.time_s.dtype == np.float64


def test_only_the_asked_topics_are_read(train):
    assert list(klasktron.read(train, "/striker/left/command")) == ["/striker/left/command"]
    with pytest.raises(klasktron.KlasktronError, match="/nothing"):
        klasktron.read(train, ["/nothing"])
    with pytest.raises(KeyError, match="/camera/detections"):
        klasktron.read(train)["/nothing"]


def test_a_recording_that_ends_early_gives_a_warning_and_its_beginning(train, tmp_path):
    whole = klasktron.read(train)
    short = tmp_path / "short.mcap"
    data = train.read_bytes()
    short.write_bytes(data[: len(data) // 2])
    with pytest.warns(UserWarning, match="cut off at byte .*`klasktron recover") as caught:
        part = klasktron.read(short)
    assert caught[0].filename == __file__
    assert part.warnings == [str(caught[0].message)]
    assert 0 < part.count < whole.count
    for topic, columns in part.items():
        for name, column in columns.items():
            assert np.array_equal(column, whole[topic][name][: len(column)], equal_nan=column.dtype.kind == "f")


def test_a_whole_recording_gives_no_warning(train):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert klasktron.read(train).warnings == []


def test_other_files_are_refused_with_the_sentence_of_the_program(program, tmp_path):
    path = tmp_path / "noise.mcap"
    path.write_bytes(b"no recording")
    said = program("info", path, accepted=(1,)).stderr
    with pytest.raises(klasktron.KlasktronError) as caught:
        klasktron.read(path)
    assert str(caught.value) in said
    assert isinstance(caught.value, ValueError)


def twist(x, y):
    """A geometry_msgs/msg/Twist as CDR."""
    return b"\0\1\0\0" + struct.pack("<6d", x, y, 0, 0, 0, 0)


def test_a_bag_comes_in_the_board_frame(program, tmp_path):
    path = tmp_path / "bag.db3"
    with sqlite3.connect(path) as bag:
        bag.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        bag.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
            "timestamp INTEGER NOT NULL, data BLOB NOT NULL)"
        )
        bag.execute("INSERT INTO topics VALUES (1, '/cmd_vel/left_player', 'geometry_msgs/msg/Twist', 'cdr', '')")
        for index in range(3):
            row = (1, 1_700_000_000_000_000_000 + index * 20_000_000, twist(0.1 * index, 0.2))
            bag.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    bag.close()
    output = tmp_path / "imported.mcap"
    program("import", path, "-o", output, accepted=(0, 3))
    wanted = klasktron.read(output)
    found = klasktron.read(path)
    assert found.path == str(path)
    assert set(found) == set(wanted) and "/striker/left/command" in found
    for topic in wanted:
        for name in wanted[topic]:
            assert np.array_equal(found[topic][name], wanted[topic][name])
    # Image frame (x right along the long side, y down) to board frame: vx = vy_img, vy = vx_img.
    assert np.allclose(found["/striker/left/command"]["vy"], [0.0, 0.1, 0.2])


def test_pandas_takes_a_topic_as_it_is(train):
    pandas = pytest.importorskip("pandas")
    commands = klasktron.read(train)["/striker/left/command"]
    frame = pandas.DataFrame(commands)
    assert list(frame.columns) == ["log_time_ns", "publish_time_ns", "vx", "vy"]
    assert len(frame) == commands.count
