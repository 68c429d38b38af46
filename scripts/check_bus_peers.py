#!/usr/bin/env python3
"""python-can at the other end of our buses: python scripts/check_bus_peers.py TEST_BINARY

Needs python-can, pyserial and socat. Each exchange runs one test of the integration binary
(tests/it/bus/peers.rs) that plays the other side: every frame comes back under the next id.
"""

import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time

import can

LAST_ID = 0x7FF
PATIENCE_S = 20.0


class Line:
    """Two pseudo-terminals of which each is the other end of the other."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        self.ends = [str(pathlib.Path(self.folder.name, name)) for name in "ab"]
        self.socat = subprocess.Popen(["socat"] + [f"pty,raw,echo=0,link={end}" for end in self.ends])
        while not all(os.path.exists(end) for end in self.ends):
            time.sleep(0.01)
        return self

    def __exit__(self, *_):
        self.socat.kill()
        self.socat.wait()
        self.folder.cleanup()


def start(binary, name, variable, value):
    """The test that plays the other side."""
    return subprocess.Popen(
        [binary, "--exact", f"bus::peers::{name}", "--nocapture"],
        env={**os.environ, variable: value},
        stdout=subprocess.PIPE,
        text=True,
    )


def wait_until_serving(peer):
    for line in peer.stdout:
        if "serving" in line:
            return
    raise SystemExit("the test ended before it served")


def finish(peer, what):
    said, _ = peer.communicate(timeout=PATIENCE_S)
    if peer.returncode != 0 or "skipped" in said:
        raise SystemExit(f"{what}: failed\n{said}")
    print(f"{what}: fine")


def fields(message):
    return (
        message.arbitration_id,
        message.is_extended_id,
        message.is_remote_frame,
        b"" if message.is_remote_frame else bytes(message.data),
    )


def frames(with_remote):
    for count in range(200):
        yield can.Message(arbitration_id=count, is_extended_id=False, data=bytes([count] * (count % 9)))
        yield can.Message(arbitration_id=0x10000000 + count, is_extended_id=True, data=b"\x01\x02")
        if with_remote:
            yield can.Message(arbitration_id=count, is_extended_id=False, is_remote_frame=True)


def demand_echoes(bus, with_remote):
    for message in frames(with_remote):
        bus.send(message)
        echo = bus.recv(PATIENCE_S)
        message.arbitration_id += 1
        if echo is None or fields(echo) != fields(message):
            raise SystemExit(f"sent {message}, got {echo}")
    bus.send(can.Message(arbitration_id=LAST_ID, is_extended_id=False))


def echo(bus):
    while True:
        message = bus.recv(PATIENCE_S)
        if message is None:
            raise SystemExit("nothing arrived from the test")
        if message.arbitration_id == LAST_ID and not message.is_extended_id:
            return
        message.arbitration_id += 1
        bus.send(message)


def check_our_slcan_host(binary):
    with Line() as line:
        with can.Bus(interface="slcan", channel=line.ends[1], bitrate=1000000, sleep_after_open=0.1) as bus:
            peer = start(binary, "peer_slcan_host", "KLASKTRON_PEER_SLCAN_HOST", line.ends[0])
            echo(bus)
            finish(peer, "slcan, python-can as the adapter")


def check_our_slcan_device(binary):
    with Line() as line:
        peer = start(binary, "peer_slcan_device", "KLASKTRON_PEER_SLCAN_DEVICE", line.ends[1])
        wait_until_serving(peer)
        with can.Bus(interface="slcan", channel=line.ends[0], bitrate=1000000, sleep_after_open=0.1) as bus:
            if bus.get_version(1)[0] is None:
                raise SystemExit("the device does not tell its version")
            if bus.get_serial_number(1) != "KT01":
                raise SystemExit("the device does not tell its serial number")
            demand_echoes(bus, with_remote=True)
            finish(peer, "slcan, python-can as the host")


def check_socketcand(binary):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    peer = start(binary, "peer_socketcand_server", "KLASKTRON_PEER_SOCKETCAND", str(port))
    wait_until_serving(peer)
    with can.Bus(interface="socketcand", host="127.0.0.1", port=port, channel="can0") as bus:
        demand_echoes(bus, with_remote=False)
        finish(peer, "socketcand, python-can as the client of the tests' server")


def main():
    binary = sys.argv[1]
    check_our_slcan_host(binary)
    check_our_slcan_device(binary)
    check_socketcand(binary)


if __name__ == "__main__":
    main()
