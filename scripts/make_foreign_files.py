#!/usr/bin/env python3
"""Write files that other software made, and what klasktron must read from them.

Usage: make_foreign_files.py FOLDER

Bags are written by rosbags, npz files by numpy, candump logs by python-can (PyPI, any recent
version). FOLDER/expected.json lists each case: arguments, exit status, and for each topic the
number of messages with the first and the last. Its numbers are computed here from the motion in
the ROS image frame with the formulas of the upstream software, never with klasktron's.
Then: KLASKTRON_FOREIGN_FILES=FOLDER cargo test --release foreign
"""

import json
import shutil
import sqlite3
import sys
from pathlib import Path

import can
import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

BELT = 0.04
START_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000
STEPS = 100
# Velocity of each carriage in the image frame (m/s), and where it starts (m).
VELOCITY = {"left": (0.10, 0.20), "right": (-0.05, 0.15)}
HOME = {"left": (0.11, 0.10), "right": (0.31, 0.12)}
# Right and left motor of each gantry as node ids; sign of the gantry.
NODES = {"right": (0, 1), "left": (2, 3)}
SIGN = {"right": 1, "left": -1}

STATE = """std_msgs/Header header
klask_interfaces/ObjectState ball
klask_interfaces/ObjectState left_peg
klask_interfaces/ObjectState right_peg
geometry_msgs/Point left_goal_pos
geometry_msgs/Point right_goal_pos
std_msgs/{status} status
"""
OBJECT_STATE = "geometry_msgs/Point position\ngeometry_msgs/Point velocity\n"
CONTROLLER_STATUS = """float32 pos_estimate
float32 vel_estimate
float32 torque_target
float32 torque_estimate
float32 iq_setpoint
float32 iq_measured
uint32 active_errors
uint8 axis_state
uint8 procedure_result
bool trajectory_done_flag
"""
ODRIVE_STATUS = """float32 bus_voltage
float32 bus_current
float32 fet_temperature
float32 motor_temperature
uint32 active_errors
uint32 disarm_reason
"""
CONTROL_MESSAGE = """uint32 control_mode
uint32 input_mode
float32 input_pos
float32 input_vel
float32 input_torque
"""
CAN_FRAME = """std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
"""


def image(player, step):
    """Position of a carriage in the image frame."""
    seconds = step * STEP_NS * 1e-9
    return tuple(h + v * seconds for h, v in zip(HOME[player], VELOCITY[player]))


def board_position(xy):
    return {"x": xy[1] - 0.16, "y": xy[0] - 0.21}


def board_velocity(xy):
    return {"vx": xy[1], "vy": xy[0]}


def drive(player, xy):
    """The upstream commander's turns of the right and the left motor for an image vector."""
    s = SIGN[player]
    return s * (xy[0] + xy[1]) / BELT, s * (xy[1] - xy[0]) / BELT


def moved(player, step):
    return tuple(now - home for now, home in zip(image(player, step), HOME[player]))


def typestore(status, with_header):
    store = get_typestore(Stores.ROS2_HUMBLE)
    odrive = ("std_msgs/Header header\nuint32 node_id\n" if with_header else "") + ODRIVE_STATUS
    types = {}
    for name, text in {
        "klask_interfaces/msg/ObjectState": OBJECT_STATE,
        "klask_interfaces/msg/State": STATE.format(status=status),
        "odrive_can/msg/ControllerStatus": CONTROLLER_STATUS,
        "odrive_can/msg/ODriveStatus": odrive,
        "odrive_can/msg/ControlMessage": CONTROL_MESSAGE,
        "can_msgs/msg/Frame": CAN_FRAME,
    }.items():
        types.update(get_types_from_msg(text, name))
    store.register(types)
    return store


class Bag:
    def __init__(self, path, *, status="UInt64", frame_id="", plugin=StoragePlugin.SQLITE3,
                 mode=None, version=9, with_header=False, checked=False):
        self.store = typestore(status, with_header)
        self.types = self.store.types
        self.status, self.frame_id, self.with_header = status, frame_id, with_header
        self.suffix = "_checked" if checked else ""
        self.writer = Writer(path, version=version, storage_plugin=plugin)
        if mode is not None:
            self.writer.set_compression(mode, CompressionFormat.ZSTD)
        self.writer.open()
        self.connections = {}

    def write(self, topic, kind, time_ns, message):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        data = self.store.serialize_cdr(message, kind)
        self.writer.write(self.connections[topic], time_ns, data)

    def header(self, time_ns):
        t = self.types
        stamp = t["builtin_interfaces/msg/Time"](sec=time_ns // 10**9, nanosec=time_ns % 10**9)
        return t["std_msgs/msg/Header"](stamp=stamp, frame_id=self.frame_id)

    def vector(self, xy):
        return self.types["geometry_msgs/msg/Vector3"](x=xy[0], y=xy[1], z=0.0)

    def point(self, xy):
        return self.types["geometry_msgs/msg/Point"](x=xy[0], y=xy[1], z=0.0)

    def object(self, position, velocity):
        return self.types["klask_interfaces/msg/ObjectState"](
            position=self.point(position), velocity=self.point(velocity))

    def step(self, step):
        now = START_NS + step * STEP_NS
        t = self.types
        for player in ("left", "right"):
            self.motors(player, step, now)
            layout = t["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
            magnet = t["std_msgs/msg/Float32MultiArray"](
                layout=layout, data=np.array(image(player, step), dtype=np.float32))
            self.write(f"/{player}_player_magnet_position", "std_msgs/msg/Float32MultiArray",
                       now + 500_000, magnet)
        if step % 2:
            return
        for player in ("left", "right"):
            twist = t["geometry_msgs/msg/Twist"](
                linear=self.vector(VELOCITY[player]), angular=self.vector((0.0, 0.0)))
            self.write(f"/cmd_vel/{player}_player{self.suffix}", "geometry_msgs/msg/Twist", now, twist)
        state = t["klask_interfaces/msg/State"](
            header=self.header(now - 3_000_000),
            ball=self.object((0.25, 0.05), (1.5, -0.5)),
            left_peg=self.object(image("left", step), VELOCITY["left"]),
            right_peg=self.object(image("right", step), VELOCITY["right"]),
            left_goal_pos=self.point((0.04, 0.16)),
            right_goal_pos=self.point((0.38, 0.16)),
            status=t[f"std_msgs/msg/{self.status}"](data=5))
        self.write("/board_state", "klask_interfaces/msg/State", now, state)
        text = t["std_msgs/msg/String"](data="not for klasktron")
        self.write("/rosout_text", "std_msgs/msg/String", now, text)

    def motors(self, player, step, now):
        t = self.types
        turns = drive(player, moved(player, step))
        speeds = drive(player, VELOCITY[player])
        for index, node in enumerate(NODES[player]):
            status = t["odrive_can/msg/ControllerStatus"](
                pos_estimate=turns[index], vel_estimate=speeds[index],
                torque_target=0.1 * np.sign(speeds[index]),
                torque_estimate=0.2 * np.sign(speeds[index]),
                iq_setpoint=0.0, iq_measured=0.0, active_errors=0, axis_state=8,
                procedure_result=0, trajectory_done_flag=False)
            self.write(f"/odrive_axis{node}/controller_status", "odrive_can/msg/ControllerStatus",
                       now + node * 100_000, status)
            control = t["odrive_can/msg/ControlMessage"](
                control_mode=2, input_mode=1, input_pos=0.0, input_vel=speeds[index],
                input_torque=0.0)
            self.write(f"/odrive_axis{node}/control_message", "odrive_can/msg/ControlMessage",
                       now, control)
            if step % 10 == 0:
                fields = dict(bus_voltage=24.0 + node, bus_current=1.0, fet_temperature=30.0,
                              motor_temperature=float("nan"), active_errors=0, disarm_reason=0)
                if self.with_header:
                    fields |= dict(header=self.header(now), node_id=node)
                self.write(f"/odrive_axis{node}/odrive_status", "odrive_can/msg/ODriveStatus",
                           now + node * 100_000 + 50_000, t["odrive_can/msg/ODriveStatus"](**fields))


def topics_of(steps, status=5):
    """What the bag's motion is in the board frame."""
    first, last = steps[0], steps[-1]
    fast = [step for step in steps if step % 2 == 0]
    topics = {}

    def add(topic, count, ends):
        topics[topic] = {"count": count, "first": ends[0], "last": ends[1]}

    def message(time_ns, publish_ns=None, **fields):
        return {"log_time": time_ns, "publish_time": publish_ns or time_ns, "fields": fields}

    for player in ("left", "right"):
        at = lambda step: START_NS + step * STEP_NS
        add(f"/striker/{player}/command", len(fast),
            [message(at(s), **board_velocity(VELOCITY[player])) for s in (fast[0], fast[-1])])
        later = max(NODES[player]) * 100_000
        add(f"/striker/{player}/carriage", len(steps),
            [message(at(s) + later, **board_position(image(player, s)),
                     **board_velocity(VELOCITY[player])) for s in (first, last)])
        # a and b by the contract's definition, from the board's motion.
        v = board_velocity(VELOCITY[player])
        for motor, sign, node in (("a", 1, NODES[player][0]), ("b", -1, NODES[player][1])):
            speed = (v["vx"] + sign * v["vy"]) / BELT
            ends = []
            for s in (first, last):
                dx_image, dy_image = moved(player, s)
                ends.append(message(
                    at(s) + node * 100_000,
                    position_turns=(dy_image + sign * dx_image) / BELT,
                    velocity_turns_per_s=speed,
                    torque_target_nm=0.1 * np.sign(speed),
                    torque_estimate_nm=0.2 * np.sign(speed)))
            add(f"/motor/{player}/{motor}", len(steps), ends)
    add("/board/state", len(fast), [message(
        START_NS + s * STEP_NS, START_NS + s * STEP_NS - 3_000_000, status=status,
        **{f"left.{k}": v for k, v in (board_position(image("left", s))
                                       | board_velocity(VELOCITY["left"])).items()},
        **{f"right.{k}": v for k, v in (board_position(image("right", s))
                                        | board_velocity(VELOCITY["right"])).items()},
        **{"ball.x": -0.11, "ball.y": 0.04, "ball.vx": -0.5, "ball.vy": 1.5})
        for s in (fast[0], fast[-1])])
    add("/run/marker", 2, [message(START_NS + first * STEP_NS), message(
        START_NS + last * STEP_NS + 300_000)])
    return topics


def drop_definitions(folder):
    """A bag as Humble and older write it: without the table of definitions."""
    for part in folder.glob("*.db3"):
        database = sqlite3.connect(part)
        database.execute("DROP TABLE message_definitions")
        database.commit()
        database.close()


def split_bag(folder, options):
    """Two parts in one folder, listed in metadata.yaml; part 10 sorts before part 9 by text."""
    folder.mkdir()
    names = ["bag_9.db3", "bag_10.db3"]
    for name, steps in zip(names, (range(0, 50), range(50, STEPS))):
        source = folder.parent / f"{folder.name}.{name}.source"
        write_bag(source, steps, options)
        shutil.move(next(source.glob("*.db3")), folder / name)
        shutil.rmtree(source)
    listed = "".join(f"    - {name}\n" for name in names)
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n"
        f"  relative_file_paths:\n{listed}  compression_format: ''\n  compression_mode: ''\n")


def write_bag(path, steps, options):
    bag = Bag(path, **options)
    for step in steps:
        bag.step(step)
    bag.writer.close()


def bags(folder):
    file, message = CompressionMode.FILE, CompressionMode.MESSAGE
    mcap = dict(plugin=StoragePlugin.MCAP)
    variants = {
        "sqlite_uint64": {},
        "sqlite_uint8_frame_id": dict(status="UInt8", frame_id="board_frame"),
        "sqlite_v8_header_status": dict(version=8, with_header=True, frame_id="abcdefgh"),
        "sqlite_message_zstd": dict(mode=message),
        "sqlite_file_zstd": dict(mode=file, status="UInt8"),
        "sqlite_checked": dict(checked=True),
        "mcap_uint64": mcap | dict(frame_id="x"),
        "mcap_uint8": mcap | dict(status="UInt8"),
        "mcap_storage_zstd": mcap | dict(mode=CompressionMode.STORAGE),
        "mcap_message_zstd": mcap | dict(mode=message, status="UInt8", frame_id="abcd"),
        "mcap_file_zstd": mcap | dict(mode=file),
        "humble_uint64": dict(version=8),
        "humble_uint8_frame_id": dict(version=8, status="UInt8", frame_id="board"),
        "humble_header_status": dict(version=8, with_header=True),
    }
    cases = []
    metadata = {"source": "import", "carriage_origin": "magnet_position",
                "command_gain_left": "1.0000", "command_gain_right": "1.0000",
                "belt_metres_per_turn": "0.04", "split": "train"}
    for name, options in variants.items():
        write_bag(folder / name, range(STEPS), options)
        if name.startswith("humble"):
            drop_definitions(folder / name)
        cases.append({"name": name, "args": ["bag", name], "exit": 0, "metadata": metadata,
                      "says": ["skipped: /rosout_text"], "topics": topics_of(range(STEPS))})
    split_bag(folder / "split", {})
    cases.append({"name": "split", "args": ["bag", "split"], "exit": 0, "metadata": metadata,
                  "says": [], "topics": topics_of(range(STEPS))})
    profile = folder / "validation" / "vel_profile_x_line_20250131_120000_run1"
    profile.parent.mkdir()
    write_bag(profile, range(STEPS), {})
    cases.append({"name": "vel_profile", "args": ["bag", str(profile.relative_to(folder))], "exit": 0,
                  "metadata": metadata | {"split": "validation"}, "says": [],
                  "pattern": "x_line", "topics": topics_of(range(STEPS))})
    guessed = next((folder / "sqlite_uint64").glob("*.db3")).relative_to(folder)
    cases.append({"name": "guessed", "args": [str(guessed)], "exit": 0, "metadata": metadata,
                  "says": [], "topics": topics_of(range(STEPS))})
    cases.append(can_bag(folder))
    return cases


def can_bag(folder):
    """Frames of the bus as can_msgs/Frame."""
    bag = Bag(folder / "can_frames")
    kind = bag.types["can_msgs/msg/Frame"]
    for frame in bus_frames():
        time_ns = START_NS + round(frame.timestamp * 1e9)
        data = np.zeros(8, dtype=np.uint8)
        data[:len(frame.data)] = list(frame.data)
        bag.write("/can0/raw", "can_msgs/msg/Frame", time_ns, kind(
            header=bag.header(time_ns), id=frame.arbitration_id, is_rtr=frame.is_remote_frame,
            is_extended=frame.is_extended_id, is_error=False, dlc=frame.dlc, data=data))
    bag.writer.close()
    return {"name": "can_frames", "args": ["bag", "can_frames"], "exit": 0,
            "metadata": {"carriage_origin": "unknown"}, "says": [], "topics": bus_topics(0)}


def bus_frames():
    """The same motion as frames, timed from 0 s: encoder 100 Hz, setpoints 50 Hz, heartbeat 10 Hz."""
    def frame(seconds, node, command, data, **options):
        return can.Message(timestamp=round(seconds, 6), arbitration_id=node << 5 | command,
                           data=data, is_extended_id=False, **options)

    def floats(*values):
        return np.array(values, dtype="<f4").tobytes()

    frames = []
    for step in range(STEPS):
        now = step * STEP_NS * 1e-9
        for player, nodes in NODES.items():
            turns, speeds = drive(player, moved(player, step)), drive(player, VELOCITY[player])
            for index, node in enumerate(nodes):
                late = now + node * 1e-4
                if step % 10 == 0:
                    frames.append(frame(late, node, 0x17, floats(24.0 + node, 1.0)))
                    heartbeat = (0).to_bytes(4, "little") + bytes([8, 0, 0, 0])
                    frames.append(frame(late + 1e-5, node, 0x01, heartbeat))
                if step % 2 == 0:
                    frames.append(frame(late + 2e-5, node, 0x0D, floats(speeds[index], 0.0),
                                        is_rx=False))
                torque = np.sign(speeds[index])
                frames.append(frame(late + 3e-5, node, 0x1C, floats(0.1 * torque, 0.2 * torque)))
                frames.append(frame(late + 4e-5, node, 0x09, floats(turns[index], speeds[index])))
    frames.append(frame(1.5, 1, 0x17, None, is_remote_frame=True, is_rx=False))
    return sorted(frames, key=lambda message: message.timestamp)


def bus_topics(extra, start=START_NS):
    """The board-frame motion again, positions counted from where the carriage started."""
    topics = topics_of(range(STEPS))
    for name in ("/board/state", "/run/marker"):
        del topics[name]
    frames = bus_frames()
    topics["/can/frames"] = {"count": len(frames) + extra}
    for player, nodes in NODES.items():
        home = board_position(HOME[player])
        for end in ("first", "last"):
            fields = topics[f"/striker/{player}/carriage"][end]
            fields["log_time"] += 40_000
            fields["publish_time"] += 40_000
            for axis in ("x", "y"):
                fields["fields"][axis] -= home[axis]
            command = topics[f"/striker/{player}/command"][end]
            command["log_time"] += max(nodes) * 100_000 + 20_000
            command["publish_time"] = command["log_time"]
            for motor in ("a", "b"):
                topics[f"/motor/{player}/{motor}"][end]["log_time"] += 40_000
                topics[f"/motor/{player}/{motor}"][end]["publish_time"] += 40_000
        for motor, node in zip(("a", "b"), nodes):
            topics[f"/drive/{player}/{motor}"] = {"count": 10, "first": {
                "log_time": START_NS + node * 100_000 + 10_000,
                "publish_time": START_NS + node * 100_000 + 10_000,
                "fields": {"axis_state": 8, "bus_voltage_v": 24.0 + node}}}
    topics["/run/marker"] = {"count": 2}
    return topics


def candump(folder):
    start = START_NS // 10**9
    def write(name, extra):
        with can.CanutilsLogWriter(folder / name, channel="can0") as writer:
            for message in bus_frames() + extra:
                message.timestamp += start
                writer.on_message_received(message)
    write("bus.log", [])
    odd = [
        can.Message(timestamp=2.0, arbitration_id=0x123, data=[1, 2], is_extended_id=True),
        can.Message(timestamp=2.1, is_error_frame=True),
        can.Message(timestamp=2.2, arbitration_id=0x3E1, data=bytes(8), is_extended_id=False),
        can.Message(timestamp=2.3, arbitration_id=0x029, data=bytes(16), is_extended_id=False,
                    is_fd=True),
    ]
    write("odd.log", odd)
    metadata = {"carriage_origin": "unknown", "belt_metres_per_turn": "0.04"}
    return [
        {"name": "bus.log", "args": ["candump", "bus.log"], "exit": 0, "metadata": metadata,
         "says": [], "topics": bus_topics(0)},
        {"name": "bus.log guessed", "args": ["bus.log"], "exit": 0, "metadata": metadata, "says": [],
         "topics": bus_topics(0)},
        {"name": "odd.log", "args": ["candump", "odd.log"], "exit": 3, "metadata": metadata,
         "says": ["1 CAN FD frames", "node 31"], "topics": bus_topics(3)},
    ]


def npz(folder):
    rows = 50
    rng = np.random.default_rng(1)
    names = ["player_pos", "player_vel", "opponent_pos", "opponent_vel", "ball_pos", "ball_vel",
             "player_actions"]
    arrays = {name: rng.uniform(-0.2, 0.2, (rows, 2)).astype(np.float32) for name in names}
    np.savez(folder / "run.npz", **arrays)
    np.savez_compressed(folder / "run_compressed.npz", **arrays)
    np.savez(folder / "run_f64.npz", **{k: v.astype(np.float64) for k, v in arrays.items()})
    np.savez(folder / "fortran.npz", **{k: np.asfortranarray(v) for k, v in arrays.items()})

    def run_topics(sign):
        def pair(name, row, keys):
            return {keys[0]: sign * float(arrays[name][row, 0]), keys[1]: float(arrays[name][row, 1])}
        out = {"/striker/left/command": {"count": rows}, "/striker/left/carriage": {"count": rows},
               "/board/state": {"count": rows}, "/run/marker": {"count": 2}}
        for end, row in (("first", 0), ("last", rows - 1)):
            at = 10**9 + row * 20_000_000
            message = lambda time, fields: {"log_time": time, "publish_time": time, "fields": fields}
            out["/striker/left/command"][end] = message(
                at - 1, pair("player_actions", row, ("vx", "vy")))
            out["/striker/left/carriage"][end] = message(
                at, pair("player_pos", row, ("x", "y")) | pair("player_vel", row, ("vx", "vy")))
            fields = {}
            for prefix, name in (("left", "player"), ("right", "opponent"), ("ball", "ball")):
                fields |= pair(f"{name}_pos", row, (f"{prefix}.x", f"{prefix}.y"))
                fields |= pair(f"{name}_vel", row, (f"{prefix}.vx", f"{prefix}.vy"))
            out["/board/state"][end] = message(at, fields)
        return out

    cases = []
    for name in ("run", "run_compressed", "run_f64", "fortran"):
        for frame, sign in (("sim-mirrored", -1), ("sim", 1)):
            cases.append({"name": f"{name} {frame}", "args": ["npz", f"{name}.npz", "--frame", frame],
                          "exit": 0, "says": [], "topics": run_topics(sign),
                          "metadata": {"velocity_source": "camera filter", "source_frame": frame}})
    cases.append({"name": "npz guessed", "args": ["run.npz"], "exit": 0, "says": [], "metadata": {},
                  "topics": run_topics(-1)})
    count = 20
    past = np.arange(10)
    t = 0.02 * np.arange(count)[:, None]
    wave = lambda times: np.stack([np.sin(times), np.cos(times)], axis=-1).astype(np.float32)
    np.savez(folder / "windows_train.npz",
             X_commands=wave(t - 0.02 * past).reshape(count, 20),
             X_states=(2 * wave(t - 0.02 * past[1:])).reshape(count, 18),
             Y=2 * wave(t + 0.02 * np.arange(3)), Y_prev=np.zeros((count, 3, 2), np.float32),
             commands=wave(t + 0.02 * np.arange(3)))
    end = lambda seconds, gain, time: {"log_time": time, "publish_time": time, "fields": {
        "vx": -gain * np.sin(seconds), "vy": gain * np.cos(seconds)}}
    first, last = 10**9, count * 10**9 + 11 * 20_000_000
    cases.append({
        "name": "windows", "args": ["npz", "windows_train.npz"], "exit": 0,
        "says": ["skipped: array Y_prev", "each window is a run of its own"],
        "metadata": {"split": "train", "carriage_origin": "unknown"}, "pattern": "window",
        "topics": {
            "/striker/left/command": {"count": 12 * count, "first": end(-0.18, 1, first - 1),
                                      "last": end(0.02 * (count - 1) + 0.04, 1, last - 1)},
            "/striker/left/carriage": {"count": 12 * count, "first": end(-0.18, 2, first),
                                       "last": end(0.02 * (count - 1) + 0.04, 2, last)},
            "/run/marker": {"count": 2 * count}}})
    np.savez(folder / "old.npz", obs=np.zeros((3, 12)), actions=np.zeros((3, 2)))
    cases.append({"name": "old layout", "args": ["npz", "old.npz"], "exit": 1,
                  "says": ["holds the arrays actions, obs"], "metadata": {}, "topics": {}})
    return cases


def main():
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)
    cases = bags(folder) + candump(folder) + npz(folder)
    (folder / "expected.json").write_text(json.dumps({"cases": cases}, indent=1, default=float))
    print(f"{len(cases)} cases in {folder}")


if __name__ == "__main__":
    main()
