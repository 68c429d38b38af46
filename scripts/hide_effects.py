#!/usr/bin/env python3
"""Hides known effects in recordings of a table, to see whether `klasktron gap` names them.

    scripts/hide_effects.py BASE-1.mcap BASE-2.mcap ONE.mcap TWO.mcap OUT_DIR [--case NAME]...

ONE and TWO are recordings of a machine on which nothing has changed since BASE-1 and BASE-2. Each case
changes what they hold of the left player: commands (recorded earlier, scaled, shifted: as if the drive were
late, weak or off), detections (moved, lost, delayed), or the striker behind its carriage (a spring, friction,
play). OUT_DIR receives pairs NAME-1.mcap and NAME-2.mcap and answers.json, for `scripts/check_gap.py`. The
recordings' own dynamics stay what they were, of the machine and no model. Needs mcap-protobuf-support and numpy.
"""

import argparse
import json
import math
import random
import shutil
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

COMMAND = "/striker/left/command"
CARRIAGE = "/striker/left/carriage"
DETECTIONS = "/camera/detections"

STRIKER_KG = 0.012
STEP_S = 1e-4
SMOOTHING_S = 0.01


class Message:
    """One message of a recording, decoded."""

    def __init__(self, schema, channel, message, decoded):
        self.schema, self.channel = schema, channel
        self.log_ns, self.publish_ns = message.log_time, message.publish_time
        self.value = decoded

    def delay(self, seconds):
        """Recorded so much later, with the camera's own stamp."""
        nanoseconds = round(seconds * 1e9)
        self.log_ns += nanoseconds
        self.publish_ns += nanoseconds
        if getattr(self.value, "capture_time_ns", 0):
            self.value.capture_time_ns += nanoseconds


class Tape:
    """A recording that can be changed and written."""

    def __init__(self, path, seed):
        self.random = random.Random(seed)
        with path.open("rb") as file:
            reader = make_reader(file, decoder_factories=[DecoderFactory()])
            self.header = reader.get_header()
            self.metadata = list(reader.iter_metadata())
            self.messages = [Message(*parts) for parts in reader.iter_decoded_messages()]

    def on(self, topic):
        """Messages of a topic, in order of time."""
        return [message for message in self.messages if message.channel.topic == topic]

    def seen(self):
        """Detections that show the left striker."""
        return [own for own in self.on(DETECTIONS) if own.value.HasField("left")]

    def write(self, path):
        """As an MCAP file."""
        with path.open("wb") as file:
            writer = Writer(file)
            writer.start(profile=self.header.profile, library=self.header.library)
            for entry in self.metadata:
                writer.add_metadata(entry.name, dict(entry.metadata))
            schemas, channels = {}, {}
            for own in sorted(self.messages, key=lambda own: own.log_ns):
                schema, channel = own.schema, own.channel
                if schema.id not in schemas:
                    schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
                if channel.id not in channels:
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, schemas[schema.id], dict(channel.metadata)
                    )
                data = own.value.SerializeToString()
                writer.add_message(channels[channel.id], own.log_ns, data, own.publish_ns)
            writer.finish()


def late_drive(seconds):
    """Commands take effect later than recorded."""

    def change(tape):
        for own in tape.on(COMMAND):
            own.delay(-seconds)

    return change


def weak_drive(gain):
    """Motors make `gain` of what is commanded."""

    def change(tape):
        for own in tape.on(COMMAND):
            own.value.vx /= gain
            own.value.vy /= gain

    return change


def offset_drive(metres_per_second):
    """Both motors move on their own, along x."""

    def change(tape):
        for own in tape.on(COMMAND):
            own.value.vx -= metres_per_second

    return change


def late_camera(seconds, drift=0.0):
    """Frames come later, and later by `drift` seconds per second."""

    def change(tape):
        frames = tape.on(DETECTIONS)
        began = frames[0].log_ns
        for own in frames:
            own.delay(seconds + drift * (own.log_ns - began) * 1e-9)

    return change


def turned_camera(scale, angle):
    """Places scaled and turned about the middle of the board (rad)."""
    cosine, sine = scale * math.cos(angle), scale * math.sin(angle)

    def change(tape):
        for own in tape.seen():
            place = own.value.left
            place.x, place.y = cosine * place.x - sine * place.y, sine * place.x + cosine * place.y

    return change


def noisy_camera(metres):
    """Places scatter by this, in addition."""

    def change(tape):
        for own in tape.seen():
            own.value.left.x += tape.random.gauss(0, metres)
            own.value.left.y += tape.random.gauss(0, metres)

    return change


def jittering_camera(seconds):
    """Frames show the striker at other times than they say."""

    def change(tape):
        frames = tape.seen()
        times = np.array([own.log_ns for own in frames]) * 1e-9
        places = np.array([(own.value.left.x, own.value.left.y) for own in frames])
        for own, time in zip(frames, times):
            wrong = time + tape.random.gauss(0, seconds)
            own.value.left.x = float(np.interp(wrong, times, places[:, 0]))
            own.value.left.y = float(np.interp(wrong, times, places[:, 1]))

    return change


def lossy_camera(share):
    """Frames that never come."""

    def change(tape):
        tape.messages = [
            own
            for own in tape.messages
            if own.channel.topic != DETECTIONS or share <= tape.random.random()
        ]

    return change


def striker(displaced):
    """The striker stands off its carriage by what `displaced` makes of the carriage's velocities (m/s)."""

    def change(tape):
        path = tape.on(CARRIAGE)
        times = np.array([own.log_ns for own in path]) * 1e-9
        grid = np.arange(times[0], times[-1], STEP_S)
        taps = np.ones(round(SMOOTHING_S / STEP_S)) * STEP_S / SMOOTHING_S
        velocity = [
            np.convolve(np.interp(grid, times, [getattr(own.value, axis) for own in path]), taps, "same")
            for axis in ("vx", "vy")
        ]
        away = displaced(np.array(velocity).T)
        for own in tape.seen():
            now = own.log_ns * 1e-9
            own.value.left.x += float(np.interp(now, grid, away[:, 0]))
            own.value.left.y += float(np.interp(now, grid, away[:, 1]))

    return change


def sprung(stiffness, damping_ratio, friction=0.0):
    """A striker on a spring (N/m) that rubs on the board (N): semi-implicit Euler steps."""
    damping = 2 * damping_ratio * math.sqrt(stiffness * STRIKER_KG)

    def displaced(velocity):
        away, speed, places = np.zeros(2), np.zeros(2), np.zeros_like(velocity)
        for index, carriage in enumerate(velocity):
            speed = speed - STEP_S * (stiffness * away + damping * (speed - carriage)) / STRIKER_KG
            length, stop = math.hypot(*speed), STEP_S * friction / STRIKER_KG
            speed = speed * 0 if length <= stop else speed * (1 - stop / length)
            away = away + STEP_S * (speed - carriage)
            places[index] = away
        return places

    return striker(displaced)


def wobbling(lean, frequency_hz, damping_ratio):
    """A striker that leans by `lean` metres per m/s^2 and swings."""
    natural = 2 * math.pi * frequency_hz

    def displaced(velocity):
        acceleration = np.gradient(velocity, STEP_S, axis=0)
        away, speed, places = np.zeros(2), np.zeros(2), np.zeros_like(velocity)
        for index, push in enumerate(acceleration):
            pull = natural**2 * (away + lean * push) + 2 * damping_ratio * natural * speed
            speed = speed - STEP_S * pull
            away = away + STEP_S * speed
            places[index] = away
        return places

    return striker(displaced)


def loose(width):
    """Play between carriage and striker, along each rail (m)."""

    def displaced(velocity):
        carriage = np.cumsum(velocity, axis=0) * STEP_S
        held, places = carriage[0], np.zeros_like(carriage)
        for index, place in enumerate(carriage):
            held = np.clip(held, place - 0.5 * width, place + 0.5 * width)
            places[index] = held - place
        return places

    return striker(displaced)


# The changes of each case, and what gap should find.
CASES = {
    "nothing": ([], []),
    "delay": ([late_drive(0.005)], [{"effect": "drive.delay", "delay_s": 0.005}]),
    "delay-small": ([late_drive(0.001)], [{"effect": "drive.delay", "delay_s": 0.001}]),
    "gain": ([weak_drive(0.97)], [{"effect": "drive.gain", "gain": 0.97}]),
    "gain-small": ([weak_drive(0.99)], [{"effect": "drive.gain", "gain": 0.99}]),
    "offset": ([offset_drive(0.01)], [{"effect": "drive.offset", "offset_m_per_s": 0.01}]),
    "latency": ([late_camera(0.004)], [{"effect": "sensor.camera_latency", "latency_s": 0.004}]),
    "latency-small": ([late_camera(0.001)], [{"effect": "sensor.camera_latency", "latency_s": 0.001}]),
    "skew": ([late_camera(0.0, 3e-4)], [{"effect": "sensor.clock_skew", "skew": 3e-4}]),
    "rotation": (
        [turned_camera(1.0, 0.01)],
        [{"effect": "sensor.camera_scale_rotation", "rotation_rad": 0.01}],
    ),
    "scale": ([turned_camera(1.005, 0.0)], [{"effect": "sensor.camera_scale_rotation", "scale": 1.005}]),
    "noise": ([noisy_camera(3e-4)], [{"effect": "sensor.noise_model", "added_rms_m": 3e-4}]),
    "jitter": ([jittering_camera(0.001)], [{"effect": "sensor.frame_jitter", "rms_s": 0.001}]),
    "losses": ([lossy_camera(0.08)], [{"effect": "sensor.frame_drop", "fraction": 0.08}]),
    "play": ([loose(4e-4)], [{"effect": "drive.backlash", "width_m": 4e-4}]),
    "play-small": ([loose(1.5e-4)], [{"effect": "drive.backlash", "width_m": 1.5e-4}]),
    "spring": ([sprung(60.0, 0.2)], [{"effect": "coupling.magnet_spring", "stiffness_n_per_m": 60.0}]),
    "spring-stiff": ([sprung(300.0, 0.1)], [{"effect": "coupling.magnet_spring", "stiffness_n_per_m": 300.0}]),
    "rubbing": (
        [sprung(400.0, 0.1, 0.15)],
        [{"effect": "coupling.striker_friction", "force_n": 0.15, "stiffness_n_per_m": 400.0}],
    ),
    "rubbing-soft": (
        [sprung(100.0, 0.2, 0.05)],
        [{"effect": "coupling.striker_friction", "force_n": 0.05, "stiffness_n_per_m": 100.0}],
    ),
    "wobble": ([wobbling(5e-5, 14.0, 0.08)], [{"effect": "coupling.striker_wobble", "lean_s2": 5e-5}]),
    "gain-rotation": (
        [weak_drive(0.97), turned_camera(1.0, 0.01)],
        [
            {"effect": "drive.gain", "gain": 0.97},
            {"effect": "sensor.camera_scale_rotation", "rotation_rad": 0.01},
        ],
    ),
    "delay-spring": (
        [late_drive(0.004), sprung(100.0, 0.2)],
        [
            {"effect": "drive.delay", "delay_s": 0.004},
            {"effect": "coupling.magnet_spring", "stiffness_n_per_m": 100.0},
        ],
    ),
}


def main():
    """Writes the pairs and the answers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("recordings", nargs=4, type=Path, metavar="MCAP")
    parser.add_argument("out", type=Path)
    parser.add_argument("--case", action="append", choices=CASES)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    *base, one, two = args.recordings
    for session, path in enumerate(base, 1):
        shutil.copyfile(path, args.out / f"baseline-{session}.mcap")
    names = args.case or list(CASES)
    for name in names:
        changes, _ = CASES[name]
        for session, path in enumerate((one, two), 1):
            tape = Tape(path, f"{name} {session}")
            for change in changes:
                change(tape)
            tape.write(args.out / f"{name}-{session}.mcap")
        print(name, flush=True)
    answers = {"baseline": []} | {name: CASES[name][1] for name in names}
    (args.out / "answers.json").write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
