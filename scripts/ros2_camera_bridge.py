#!/usr/bin/env python3
"""Forward detections of a ROS 2 topic to klasktron, as UDP datagrams with the capture time of the header.

    python3 ros2_camera_bridge.py --topic /board_state --to 127.0.0.1:9870

Needs rclpy and the package of the message. `klasktron collect --camera udp:127.0.0.1:9870` receives the datagrams; their
definition is the documentation of the module `link::camera`.

Message types:
    klask_interfaces/msg/State             ball, left_peg, right_peg with position; the KlaskTron stack
    vision_msgs/msg/Detection3DArray       class_id ball, left or right; centre of the box in metres
"""

import argparse
import importlib
import json
import math
import socket
import sys

OBJECTS = ("ball", "left", "right")
# Largest coordinate that klasktron accepts (m).
FARTHEST_M = 1.0


def capture_time_ns(stamp):
    """Nanoseconds since the epoch; 0, the mark for "no stamp", for an empty or negative one."""
    return max(int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec), 0)


def positions_of_state(message):
    """Positions by object in a klask_interfaces/State."""
    objects = {"ball": message.ball, "left": message.left_peg, "right": message.right_peg}
    return {name: (own.position.x, own.position.y) for name, own in objects.items()}


def positions_of_detections(message):
    """Positions by object in a vision_msgs/Detection3DArray; of several with one name the most probable."""
    best = {}
    for detection in message.detections:
        for result in detection.results:
            name, score = result.hypothesis.class_id, result.hypothesis.score
            if name in OBJECTS and (name not in best or best[name][0] < score):
                centre = detection.bbox.center.position
                best[name] = (score, (centre.x, centre.y))
    return {name: position for name, (_, position) in best.items()}


READERS = {
    "klask_interfaces/msg/State": positions_of_state,
    "vision_msgs/msg/Detection3DArray": positions_of_detections,
}


class Board:
    """Transform from the frame of the messages into the board frame."""

    def __init__(self, frame, short_side_m, long_side_m):
        self.frame, self.short_side_m, self.long_side_m = frame, short_side_m, long_side_m

    def position(self, x, y):
        """Board frame: origin at the centre, x across, y from goal to goal. Image frame: origin at a corner, x along
        the long side, y down."""
        if self.frame == "board":
            return x, y
        return y - self.short_side_m / 2, x - self.long_side_m / 2


def datagram(message, read, board):
    """One message as a datagram. An object that is missing, not finite or outside of any table is null."""
    content = {"capture_time_ns": capture_time_ns(message.header.stamp)}
    positions = read(message)
    for name in OBJECTS:
        point = None
        if name in positions:
            x, y = board.position(*positions[name])
            if all(math.isfinite(own) and abs(own) <= FARTHEST_M for own in (x, y)):
                point = {"x": x, "y": y}
        content[name] = point
    return json.dumps(content, separators=(",", ":")).encode()


def address(text):
    """HOST:PORT as a pair."""
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65536:
        raise argparse.ArgumentTypeError(f"'{text}' is no address; write HOST:PORT with a port from 1 to 65535")
    return host, int(port)


def length(text):
    """Side of a board (m)."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value <= 10.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no side of a board; write metres above 0 and up to 10")
    return value


def arguments(words):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--topic", default="/board_state", help="topic of the detections (default: /board_state)")
    parser.add_argument("--type", choices=sorted(READERS), default="klask_interfaces/msg/State")
    parser.add_argument("--to", type=address, default=("127.0.0.1", 9870), metavar="HOST:PORT",
                        help="address of --camera udp:HOST:PORT (default: 127.0.0.1:9870)")
    parser.add_argument("--frame", choices=("image", "board"), default="image",
                        help="frame of the messages: corner of the image, or centre of the board (default: image)")
    parser.add_argument("--short-side-m", type=length, default=0.32, help="side across (default: 0.32)")
    parser.add_argument("--long-side-m", type=length, default=0.42, help="side from goal to goal (default: 0.42)")
    return parser.parse_args(words)


def message_class(name):
    """Class of a message type such as klask_interfaces/msg/State."""
    package, folder, own = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.{folder}"), own)
    except (ImportError, AttributeError) as error:
        sys.exit(f"the message type {name} cannot be loaded ({error}); source the workspace that builds {package}")


def main(words=None):
    own = arguments(words)
    try:
        import rclpy
        from rclpy.qos import qos_profile_sensor_data
    except ImportError as error:
        sys.exit(f"rclpy cannot be imported ({error}); source the setup file of ROS 2, such as /opt/ros/humble/setup.bash")
    read, board = READERS[own.type], Board(own.frame, own.short_side_m, own.long_side_m)
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    rclpy.init()
    node = rclpy.create_node("klasktron_camera_bridge")
    # A lost datagram costs one frame, so a socket that is full or has no receiver is no error.
    out.setblocking(False)

    def forward(message):
        try:
            out.sendto(datagram(message, read, board), own.to)
        except OSError as error:
            node.get_logger().warning(f"a frame was not sent to {own.to[0]}:{own.to[1]}: {error}",
                                      throttle_duration_sec=5.0)

    # Best effort with a short queue: an old frame is worth less than the next one.
    node.create_subscription(message_class(own.type), own.topic, forward, qos_profile_sensor_data)
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
