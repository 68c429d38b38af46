#!/usr/bin/env python3
"""Make the example recordings of the repository.

Usage: make_example.py OUT_DIR

Writes example-train.mcap and example-validation.mcap, recordings of a simulated gantry
(example_rig.py) with the topics, units and metadata of the data contract, as a
controller with encoders on a bus and a camera would have logged them. The same bytes
come out each time with the same versions of numpy, protobuf, mcap and zstandard.
Needs: pip install numpy protobuf mcap
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import example_rig
from klasktron_mcap import RecordingFile

START_NS = 1_760_000_000_000_000_000
RECEIVE_JITTER = 0.0003  # s
BUS_DELAY = 0.0004  # s from an encoder's sample to the host
CAMERA_DELAY = 0.015  # s from exposure to the host
CAMERA_NOISE = 0.00025  # m
COMMAND_DELAY = 0.0002  # s, most that a command is late on its clock

# Binary places that are kept: 0.24 mm/s, 4 um, 0.06 mm/s and 0.12 mm.
COMMAND_BITS = 12
POSITION_BITS = 18
SPEED_BITS = 14
CAMERA_BITS = 13

LINES = ["x_line", "y_line", "diagonal_up", "diagonal_down"]
TRAIN = LINES + ["circle", "ramp", "random_walk", "random_walk", "circle", "ramp"] + [
    "random_walk",
    "random_walk",
]
VALIDATION = ["diagonal_up", "circle", "ramp", "random_walk"]


@dataclass
class Settings:
    """How a recording is written."""

    session: str
    split: str
    seed: int
    start_ns: int = START_NS
    jitter: bool = True  # late commands and receive times
    camera: bool = True


class Log:
    """Messages of one recording, sorted by log time before they are written."""

    def __init__(self, path, settings):
        self.settings = settings
        self.random = np.random.RandomState(settings.seed + 1)
        self.entries = []
        self.file = RecordingFile(
            path,
            library="klasktron-example",
            info={
                "schema_version": "1",
                "source": "simulation",
                "session": settings.session,
                "split": settings.split,
                "robot": "klasktron-example",
                "belt_metres_per_turn": "0.04",
            },
        )

    def nanos(self, seconds):
        """Time stamp of a moment (s after the start), in steps of 10 us."""
        return self.settings.start_ns + round(seconds * 1e5) * 10_000

    def late(self, seconds, spread):
        """`seconds` and a random delay, when this recording has any."""
        return seconds + (spread * abs(self.random.randn()) if self.settings.jitter else 0.0)

    def add(self, topic, seconds, message, publish_time=None):
        """Keep a message that was logged at `seconds`."""
        self.entries.append((self.nanos(seconds), len(self.entries), topic, message, publish_time))

    def finish(self):
        """Write everything in order of time."""
        with self.file as file:
            for log_time, _, topic, message, publish_time in sorted(self.entries):
                file.write(topic, log_time, message, publish_time)


def rounded(value, bits):
    """`value` to so many binary places; short numbers compress well."""
    return round(value * 2**bits) / 2**bits


def add_marker(log, seconds, run, pattern, phase):
    """The start (0) or end (1) of a run."""
    marker = log.file.messages["RunMarker"](
        run=run, pattern=pattern, phase=phase, split=log.settings.split
    )
    log.add("/run/marker", seconds, marker)


def add_commands(log, start, commands):
    """Commands of one run, [ticks, 2]."""
    message = log.file.messages["VelocityCommand"]
    for tick, (vx, vy) in enumerate(commands):
        seconds = log.late(start + tick * example_rig.COMMAND_PERIOD, COMMAND_DELAY / 3.0)
        log.add("/striker/left/command", seconds, message(vx=rounded(vx, COMMAND_BITS), vy=rounded(vy, COMMAND_BITS)))


def add_carriage(log, start, times, carriage):
    """Encoder readings of one run, [samples, 4]."""
    message = log.file.messages["CarriageState"]
    for time, (x, y, vx, vy) in zip(times, carriage):
        seconds = log.late(start + time + BUS_DELAY, RECEIVE_JITTER)
        x, y = rounded(x, POSITION_BITS), rounded(y, POSITION_BITS)
        vx, vy = rounded(vx, SPEED_BITS), rounded(vy, SPEED_BITS)
        state = message(x=x, y=y, vx=vx, vy=vy)
        log.add("/striker/left/carriage", seconds, state)


def add_frames(log, start, times, striker):
    """Camera detections of one run, [frames, 2]."""
    detections = log.file.messages["CameraDetections"]
    point = log.file.messages["Point"]
    for time, position in zip(times, striker):
        seen = position + CAMERA_NOISE * log.random.randn(2)
        x, y = (rounded(value, CAMERA_BITS) for value in seen)
        captured = log.nanos(start + time)
        frame = detections(capture_time_ns=captured, left=point(x=x, y=y))
        seconds = log.late(start + time + CAMERA_DELAY, RECEIVE_JITTER)
        log.add("/camera/detections", seconds, frame, captured)


def write_motion(path, motion, plan, settings):
    """Write the runs of `motion` one after the other."""
    log = Log(path, settings)
    seconds_of_run = (plan.commands + plan.commands_home) * example_rig.COMMAND_PERIOD
    for run, pattern in enumerate(motion.patterns):
        start = run * seconds_of_run
        add_marker(log, start, run, pattern, 0)
        add_commands(log, start, motion.commands[:, run])
        add_carriage(log, start, motion.carriage_times, motion.carriage[:, run])
        if settings.camera:
            add_frames(log, start, motion.frame_times, motion.striker[:, run])
        # Just before the first command that brings the carriage home.
        end = start + plan.commands * example_rig.COMMAND_PERIOD - 1e-5
        add_marker(log, end, run, pattern, 1)
    log.finish()


def make(path, plan, settings):
    """Simulate and write one recording."""
    write_motion(path, example_rig.simulate(plan), plan, settings)


def main():
    """Write both recordings."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out_dir", type=Path, help="folder for the two recordings")
    out = parser.parse_args().out_dir
    out.mkdir(parents=True, exist_ok=True)
    for split, patterns, commands, seed in [
        ("train", TRAIN, 380, 11),
        ("validation", VALIDATION, 250, 12),
    ]:
        path = out / f"example-{split}.mcap"
        plan = example_rig.Plan(patterns, commands, seed=seed)
        start_ns = START_NS if split == "train" else START_NS + 600_000_000_000
        make(path, plan, Settings(f"example-{split}", split, seed, start_ns))
        print(f"{path}: {path.stat().st_size} bytes, {len(patterns)} runs")


if __name__ == "__main__":
    main()
