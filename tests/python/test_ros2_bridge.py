"""Camera bridge of ROS 2 (`scripts/ros2_camera_bridge.py`), with stubs of rclpy and of the message types."""

import importlib.util
import json
import math
import socket
import sys
from types import ModuleType, SimpleNamespace

import pytest
from conftest import ROOT

STAMP_S, STAMP_NS = 1_700_000_000, 123_456_789


@pytest.fixture(scope="module")
def bridge():
    """The script as a module; it imports rclpy only in `main`."""
    path = ROOT / "scripts" / "ros2_camera_bridge.py"
    spec = importlib.util.spec_from_file_location("ros2_camera_bridge", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def header(sec=STAMP_S, nanosec=STAMP_NS):
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=nanosec), frame_id="camera_frame")


def state(ball, left=(0.1, 0.16), right=(0.3, 0.2), **stamp):
    def own(at):
        return SimpleNamespace(position=SimpleNamespace(x=at[0], y=at[1], z=0.0))

    return SimpleNamespace(header=header(**stamp), ball=own(ball), left_peg=own(left), right_peg=own(right))


def detection(name, score, x, y):
    hypothesis = SimpleNamespace(class_id=name, score=score)
    box = SimpleNamespace(center=SimpleNamespace(position=SimpleNamespace(x=x, y=y, z=0.0)))
    return SimpleNamespace(results=[SimpleNamespace(hypothesis=hypothesis)], bbox=box)


def test_a_state_becomes_a_datagram_in_the_board_frame_with_the_time_of_its_header(bridge):
    board = bridge.Board("image", 0.32, 0.42)
    sent = json.loads(bridge.datagram(state((0.21, 0.16)), bridge.positions_of_state, board))
    assert sent["capture_time_ns"] == STAMP_S * 10**9 + STAMP_NS
    assert sent["ball"] == pytest.approx({"x": 0.0, "y": 0.0})
    assert sent["left"] == pytest.approx({"x": 0.0, "y": -0.11})
    assert sent["right"] == pytest.approx({"x": 0.04, "y": 0.09})


def test_objects_without_a_position_are_null_and_missing_stamps_zero(bridge):
    board = bridge.Board("board", 0.32, 0.42)
    message = state((math.nan, 0.0), left=(7.0, 0.0), sec=-1, nanosec=0)
    sent = json.loads(bridge.datagram(message, bridge.positions_of_state, board))
    assert sent == {"capture_time_ns": 0, "ball": None, "left": None, "right": {"x": 0.3, "y": 0.2}}


def test_of_several_detections_the_most_probable_counts(bridge):
    found = [detection("ball", 0.4, 9.0, 9.0), detection("ball", 0.9, 0.1, -0.05), detection("hand", 1.0, 0, 0)]
    message = SimpleNamespace(header=header(), detections=found)
    sent = json.loads(bridge.datagram(message, bridge.positions_of_detections, bridge.Board("board", 0.32, 0.42)))
    assert (sent["ball"], sent["left"]) == ({"x": 0.1, "y": -0.05}, None)


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--to", "9870"], "'9870' is no address; write HOST:PORT"),
        (["--to", "localhost:70000"], "a port from 1 to 65535"),
        (["--long-side-m", "42"], "'42' is no side of a board; write metres"),
    ],
)
def test_mistakes_are_usage_errors(bridge, capsys, words, sentence):
    with pytest.raises(SystemExit) as error:
        bridge.arguments(words)
    assert error.value.code == 2
    assert sentence in capsys.readouterr().err


def stub_rclpy(monkeypatch, messages, asked):
    """A rclpy whose `spin` delivers `messages` and is then interrupted."""
    rclpy, qos, package, types = (ModuleType(name) for name in ("rclpy", "rclpy.qos", "klask_interfaces", "msg"))

    class Node:
        def create_subscription(self, kind, topic, callback, profile):
            asked.append((kind, topic, profile))
            self.callback = callback

        def get_logger(self):
            return SimpleNamespace(warning=lambda text, **_: asked.append(text))

        def destroy_node(self):
            asked.append("destroyed")

    def spin(node):
        for message in messages:
            node.callback(message)
        raise KeyboardInterrupt

    qos.qos_profile_sensor_data = "sensor data"
    types.State = object
    rclpy.init, rclpy.spin, rclpy.try_shutdown = (lambda: None), spin, (lambda: asked.append("shut down"))
    rclpy.create_node = lambda name: Node()
    for name, module in (("rclpy", rclpy), ("rclpy.qos", qos), ("klask_interfaces", package),
                         ("klask_interfaces.msg", types)):
        monkeypatch.setitem(sys.modules, name, module)


def test_the_node_forwards_every_message_by_udp_and_ends_with_ctrl_c(bridge, monkeypatch):
    asked = []
    stub_rclpy(monkeypatch, [state((0.21, 0.16)), state((0.22, 0.16))], asked)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(10.0)
        bridge.main(["--to", f"127.0.0.1:{receiver.getsockname()[1]}"])
        received = [json.loads(receiver.recv(65536)) for _ in range(2)]
    assert [own["ball"]["y"] for own in received] == pytest.approx([0.0, 0.01])
    assert asked == [(object, "/board_state", "sensor data"), "destroyed", "shut down"]


def test_without_ros_it_says_what_to_source(bridge, monkeypatch):
    monkeypatch.setitem(sys.modules, "rclpy", None)
    with pytest.raises(SystemExit, match="rclpy cannot be imported .* source the setup file of ROS 2"):
        bridge.main([])
