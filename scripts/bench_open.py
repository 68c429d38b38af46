#!/usr/bin/env python3
"""Time how long a one-hour recording of 1.5 million messages takes to open.

Usage: bench_open.py [--minutes 60] [--out FILE]

The recording is written here with PyPI's mcap. Timed are `klasktron info --json`, which
opens and decodes everything, and `klasktron fit-actuator --epochs 1`, which opens,
resamples, fits one epoch, judges and writes its report.
Needs: cargo build --release; pip install protobuf mcap
"""

import argparse
import json
import math
import sys
import tempfile
from pathlib import Path

import bench_tools
from klasktron_mcap import RecordingFile

START_NS = 1_760_000_000_000_000_000
RUN_SECONDS = 60
# One period of 60 ms: (offset in ms, topic) of each message, 25 messages in all, so that
# an hour of 60,000 periods is 1.5 million: commands at 50 Hz, carriage and both motors
# at 100 Hz, camera at 66.7 Hz.
COMMAND, CARRIAGE, MOTOR_A, MOTOR_B, CAMERA = range(5)
PERIOD_MS = 60
PERIOD = sorted(
    [(offset, COMMAND) for offset in (0, 20, 40)]
    + [(offset + 3, kind) for offset in range(0, 60, 10) for kind in (CARRIAGE, MOTOR_A, MOTOR_B)]
    + [(offset + 6, CAMERA) for offset in (0, 15, 30, 45)]
)


class Source:
    """Messages of a carriage that follows slow sines after 30 ms."""

    def __init__(self, file):
        self.file = file
        kinds = ["VelocityCommand", "CarriageState", "MotorState", "MotorState", "CameraDetections"]
        self.messages = [file.messages[kind]() for kind in kinds]
        self.topics = [
            "/striker/left/command",
            "/striker/left/carriage",
            "/motor/left/a",
            "/motor/left/b",
            "/camera/detections",
        ]

    def write(self, milliseconds, kind):
        """Write one message."""
        time = milliseconds * 1e-3
        log_time = START_NS + milliseconds * 1_000_000
        message = self.messages[kind]
        if kind == COMMAND:
            message.vx, message.vy = velocity(time)
        else:
            self.fill_motion(message, kind, time - 0.03)
        self.file.write(self.topics[kind], log_time, message)

    def fill_motion(self, message, kind, time):
        """Measured motion at `time`."""
        (x, y), (vx, vy) = position(time), velocity(time)
        if kind == CARRIAGE:
            message.x, message.y, message.vx, message.vy = x, y, vx, vy
        elif kind == CAMERA:
            message.capture_time_ns = START_NS + round((time + 0.03) * 1e9) - 6_000_000
            message.left.x, message.left.y = x, y
        else:
            sign = 1.0 if kind == MOTOR_A else -1.0
            message.position_turns = (x + sign * y) / 0.04
            message.velocity_turns_per_s = (vx + sign * vy) / 0.04


def velocity(time):
    """Velocity of the sines (m/s)."""
    return 0.3 * math.cos(5.1 * time), 0.3 * math.cos(7.3 * time + 0.4 * math.sin(0.1 * time))


def position(time):
    """Position of the sines (m), near enough to the integral."""
    return 0.3 / 5.1 * math.sin(5.1 * time), -0.11 + 0.3 / 7.3 * math.sin(7.3 * time)


def write_recording(path, minutes):
    """Write the recording; the number of its messages."""
    info = {"schema_version": "1", "source": "simulation", "session": "bench-open"}
    info |= {"robot": "klasktron-example", "belt_metres_per_turn": "0.04"}
    periods_of_run = RUN_SECONDS * 1000 // PERIOD_MS
    with RecordingFile(path, "klasktron-example", info) as file:
        source = Source(file)
        marker = file.messages["RunMarker"]
        for run in range(minutes):
            start = run * RUN_SECONDS * 1000
            for phase, at in [(0, start), (1, start + RUN_SECONDS * 1000)]:
                if phase == 1:
                    for period in range(periods_of_run):
                        for offset, kind in PERIOD:
                            source.write(start + period * PERIOD_MS + offset, kind)
                message = marker(run=run, pattern="random_walk", phase=phase)
                file.write("/run/marker", START_NS + at * 1_000_000 - phase, message)
        return sum(file.counts.values())


def main():
    """Write the recording, time the commands, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", type=Path, default=bench_tools.default_binary())
    parser.add_argument("--minutes", type=int, default=60, help="length of the recording")
    parser.add_argument("--out", type=Path, help="write the figures here as JSON")
    options = parser.parse_args()
    if not options.binary.exists():
        sys.exit(f"{options.binary} does not exist; run: cargo build --release")
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "hour.mcap"
        messages = write_recording(path, options.minutes)
        megabytes = path.stat().st_size / 1e6
        print(f"{messages} messages, {options.minutes} min, {megabytes:.1f} MB")
        document = {"messages": messages, "megabytes": megabytes}
        document["machine"] = bench_tools.machine()
        fit = ["fit-actuator", path, "--output", Path(name) / "fit"]
        fit += ["--epochs", "1", "--seeds", "1", "--threads", "1"]
        # Status 3 is a finished command that has something to remark.
        for title, command in [("info", ["info", path, "--json"]), ("fit", fit)]:
            measured = bench_tools.run_measured([options.binary, *command], accepted=(0, 3))
            document[title] = {"seconds": measured.seconds, "peak_mb": measured.peak_mb}
            print(f"{title}: {measured.seconds:.2f} s, peak memory {measured.peak_mb:.0f} MB")
    if options.out is not None:
        options.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
