#!/usr/bin/env python3
"""The live view of klasktron with a WebSocket client of other authors.

    python scripts/check_live.py KLASKTRON [--seconds S]

Needs PyPI's websockets, protobuf and mcap. A session at 500 Hz runs on the virtual table three times: without a live
view, with a viewer that reads everything, and with a viewer that has subscribed to everything and never reads.
Prints the lateness of the control loop of each. Every received message must be in the recording, and decode with the
schema that was advertised. A viewer that stalls may not cause more missed deadlines than a session without one, up to
1 % of the periods, which a shared computer misses by itself.
"""

import argparse
import asyncio
import base64
import json
import re
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import mcap.reader
import websockets
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PATIENCE_S = 60.0
RATE_HZ = 500
ATTEMPTS = 5
# A viewer that stalls reads until it has subscribed to these topics.
STALLS_AFTER = {"/collect/tick", "/scene", "/camera/detections", "/striker/left/carriage"}
SUBPROTOCOLS = ["foxglove.sdk.v1", "foxglove.websocket.v1"]


class Stopped(Exception):
    """A session that did not complete."""


class Viewer:
    """Subscribes to every channel and keeps what comes."""

    def __init__(self, connection):
        self.connection = connection
        self.channels = {}
        self.messages = []

    async def read(self, stalls=False):
        async for frame in self.connection:
            if isinstance(frame, str):
                await self.answer(json.loads(frame))
                topics = {own["topic"] for own in self.channels.values()}
                if stalls and STALLS_AFTER <= topics:
                    return
            else:
                opcode, subscription, time = struct.unpack_from("<BIQ", frame)
                if opcode != 1:
                    raise SystemExit(f"failed: opcode {opcode}")
                self.messages.append((self.channels[subscription]["topic"], time, frame[13:]))

    async def answer(self, message):
        if message["op"] != "advertise":
            return
        entries = []
        for channel in message["channels"]:
            self.channels[channel["id"]] = channel
            entries.append({"id": channel["id"], "channelId": channel["id"]})
        await self.connection.send(json.dumps({"op": "subscribe", "subscriptions": entries}))

    def decoder(self, topic):
        """Message class of the schema that was advertised for a topic."""
        channel = next(own for own in self.channels.values() if own["topic"] == topic)
        files = descriptor_pb2.FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


def session(klasktron, folder, name, seconds, live, rate_hz=RATE_HZ):
    command = [klasktron, "collect", "--rate-hz", str(rate_hz), "--pattern", "circle", "--seconds", str(seconds)]
    command += ["--player", "left", "--json", "--overwrite", "-o", f"{folder}/{name}.mcap"]
    return subprocess.Popen(command + (["--live", "foxglove:0"] if live else []),
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def address_of(process):
    for line in process.stderr:
        found = re.search(r"ws://\S+", line)
        if found:
            return found[0]
    raise SystemExit("failed: the program printed no address")


def connect(address, stalls=False):
    options = {"max_queue": None, "max_size": None, "compression": None, "ping_interval": None}
    if stalls:
        # Its buffers are small, and nothing reads them.
        host, port = address[len("ws://"):].split(":")
        own = socket.socket()
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.connect((host, int(port)))
        options |= {"sock": own, "max_queue": 1}
    return websockets.connect(address, subprotocols=SUBPROTOCOLS, **options)


def check_session(status, out, err):
    """A shared computer may miss deadlines (status 3), but nothing else may stop a session."""
    if status not in (0, 3) or json.loads(out)["stop"] != "completed":
        raise Stopped(f"the session ended with status {status}\n{err}")


async def watch(klasktron, folder, name, seconds, viewers):
    """A session with viewers: `viewers` says of each whether it stalls. The report, and the first viewer."""
    process = session(klasktron, folder, name, seconds, bool(viewers))
    address = address_of(process) if viewers else None
    own, tasks, connections = [], [], []
    for stalls in viewers:
        connection = await connect(address, stalls)
        connections.append(connection)
        own.append(Viewer(connection))
        tasks.append(asyncio.create_task(own[-1].read(stalls)))
    loop = asyncio.get_running_loop()
    out, err = await loop.run_in_executor(None, process.communicate)
    for stalls, task in zip(viewers, tasks):
        if not stalls:
            await asyncio.wait_for(task, PATIENCE_S)
    for connection in connections:
        connection.transport.abort()
    check_session(process.returncode, out, err)
    return json.loads(out), own, err


def watch_patiently(*args):
    """A session that a busy computer has stopped is repeated."""
    for _ in range(ATTEMPTS):
        try:
            return asyncio.run(watch(*args))
        except Stopped as stopped:
            reason = stopped
    raise SystemExit(f"failed: {ATTEMPTS} sessions in a row were stopped\n{reason}")


def check_messages(path, viewer):
    """Every received message is in the recording with its time and content, and decodes."""
    with open(path, "rb") as stream:
        written = {(channel.topic, message.log_time, message.data)
                   for _, channel, message in mcap.reader.make_reader(stream).iter_messages()}
    foreign = [own for own in viewer.messages if own not in written]
    if foreign:
        raise SystemExit(f"failed: {len(foreign)} messages are not in the recording, the first on {foreign[0][0]}")
    topics = sorted({topic for topic, _, _ in viewer.messages})
    wanted = {"/striker/left/carriage", "/striker/left/command", "/motor/left/a", "/collect/tick", "/scene"}
    if not wanted <= set(topics):
        raise SystemExit(f"failed: nothing came on {sorted(wanted - set(topics))}")
    classes = {topic: viewer.decoder(topic) for topic in topics}
    entities = set()
    for topic, _, data in viewer.messages:
        message = classes[topic].FromString(data)
        if topic == "/scene":
            entities |= {entity.id for entity in message.entities}
    if not {"board", "carriage_left", "path_left", "estimate_left"} <= entities:
        raise SystemExit(f"failed: the scene has only {sorted(entities)}")
    return len(viewer.messages), len(written), len(topics)


def check_nonsense(klasktron, folder):
    """Connections that are no viewers are closed, and the session goes on."""
    process = session(klasktron, folder, "nonsense", 4, True, 50)
    host, port = address_of(process)[len("ws://"):].split(":")
    browser = b"GET / HTTP/1.1\r\nHost: localhost\r\nUser-Agent: browser\r\n\r\n"
    for request in (browser, b"\x00" * 2000, b"GET", bytes(range(256)) * 8):
        with socket.create_connection((host, int(port)), PATIENCE_S) as own:
            own.sendall(request)
            own.shutdown(socket.SHUT_WR)
            try:
                while own.recv(4096):
                    pass
            except ConnectionResetError:
                pass
    second = subprocess.run([klasktron, "replay", "tests/data/example-match.mcap", "--live", f"foxglove:{port}"],
                            capture_output=True, text=True)
    if second.returncode != 1 or second.stderr.count("\n") != 1 or "another program uses port" not in second.stderr:
        raise SystemExit(f"failed: a port in use, status {second.returncode}: {second.stderr}")
    out, err = process.communicate()
    check_session(process.returncode, out, err)
    return second.stderr.strip().removeprefix("error: ").replace(port, "PORT")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("klasktron")
    parser.add_argument("--seconds", type=int, default=20)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        reports = {}
        for name, viewers in (("no live view", []), ("a viewer that reads", [False]),
                              ("a viewer that stalls", [True]), ("both", [False, True])):
            file = name.replace(" ", "-")
            report, own, err = watch_patiently(args.klasktron, folder, file, args.seconds, viewers)
            reports[name] = report["control_loop"]
            lost = re.search(r"live view: (\d+) messages were dropped", err)
            if True in viewers and not lost:
                raise SystemExit(f"failed: {name}: no message was dropped, so nothing has stalled\n{err}")
            reports[name]["dropped"] = int(lost[1]) if lost else 0
            if viewers and not viewers[0]:
                sent, written, topics = check_messages(f"{folder}/{file}.mcap", own[0])
                print(f"{name}: {sent} of {written} recorded messages on {topics} topics came and decode")
        print(f"lateness of a control loop at {RATE_HZ} Hz, {args.seconds} s, virtual table in real time:")
        for name, own in reports.items():
            print(f"  {name:22} {own['periods']:6} periods, {own['missed_deadlines']:4} missed; lateness "
                  f"{own['lateness_p50_us']:5.0f} us (median), {own['lateness_p99_us']:6.0f} us (99 %), "
                  f"{own['lateness_max_us']:6.0f} us (largest); {own['dropped']} messages dropped for viewers")
        without = reports["no live view"]["missed_deadlines"]
        for name in ("a viewer that stalls", "both"):
            allowed = without + reports[name]["periods"] // 100
            if allowed < reports[name]["missed_deadlines"]:
                raise SystemExit(f"failed: {name}: {reports[name]['missed_deadlines']} missed deadlines, {without} without")
        print("nonsense closes its own connection;", check_nonsense(args.klasktron, folder))


if __name__ == "__main__":
    sys.exit(main())
