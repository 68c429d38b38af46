#!/usr/bin/env python3
"""`klasktron collect` as processes, against drives that run elsewhere.

    python scripts/check_collect.py KLASKTRON [NAME...]

Needs socat; the mock drive needs PyPI's odrive-can and python-can. Each check prints one line.
Checks: mock_drive, killed, two_collectors, interrupted, interrupted_twice, disk_full.
"""

import json
import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time

PATIENCE_S = 60.0
CIRCLE = ["--pattern", "circle:radius_m=0.03,speed_m_per_s=0.15"]


class Table:
    """A folder with two pseudo-terminals, each the other's other end, and processes that end with it."""

    def __enter__(self):
        self.folder = tempfile.TemporaryDirectory()
        self.path = pathlib.Path(self.folder.name)
        self.processes = []
        ends = [self.path / "table", self.path / "host"]
        self.start(["socat"] + [f"pty,raw,echo=0,link={end}" for end in ends])
        wait_for(lambda: all(end.exists() for end in ends), "socat")
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            process.kill()
            process.wait()
        self.folder.cleanup()

    def start(self, command, log=None, **options):
        """Starts a process; its output goes to the file `log`."""
        out = open(self.path / log, "w") if log else subprocess.DEVNULL
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT, **options)
        self.processes.append(process)
        return process

    def rig(self, klasktron):
        """The virtual rig on one end; its changes of state are lines of rig.log."""
        self.start([klasktron, "rig", "--bus", f"slcan:{self.path}/table"], "rig.log")
        wait_for(lambda: "the rig is running" in self.read("rig.log"), "the rig")

    def collect(self, klasktron, *more, log="collect.log", out="run.mcap", **options):
        """A collector on the other end."""
        command = [klasktron, "collect", "--bus", f"slcan:{self.path}/host", *CIRCLE]
        if "--seconds" not in more:
            command += ["--seconds", "20"]
        command += ["--homing", "declared", "-o", str(self.path / out), *more]
        return self.start(command, log, **options)

    def read(self, log):
        return (self.path / log).read_text()

    def states(self):
        """Last state and errors of each node of the rig."""
        lines = [json.loads(x) for x in self.read("rig.log").splitlines() if x.startswith("{")]
        return {line["node"]: (line["state"], line["errors"]) for line in lines}

    def wait_until_driving(self):
        """Until the run has begun."""
        wait_for(lambda: "run 1 of" in self.read("collect.log"), "the run")
        time.sleep(1.0)


def wait_for(holds, what):
    """Waits until `holds()`."""
    started = time.monotonic()
    while not holds():
        if PATIENCE_S < time.monotonic() - started:
            raise SystemExit(f"{what}: nothing happened within {PATIENCE_S:.0f} s")
        time.sleep(0.02)


def expect(holds, what, *shown):
    if not holds:
        print(*shown, sep="\n", file=sys.stderr)
        raise SystemExit(f"failed: {what}")


def check_killed(klasktron):
    """kill -9: the drives stop by their watchdog, every flushed message can be recovered."""
    with Table() as table:
        table.rig(klasktron)
        collector = table.collect(klasktron)
        table.wait_until_driving()
        collector.kill()
        killed = time.monotonic()
        off = lambda: all("WATCHDOG" in errors for _, errors in table.states().values())
        wait_for(off, "the watchdogs")
        seconds = time.monotonic() - killed
        expect(seconds < 1.0, f"drives off within 1 s of kill -9, not {seconds:.2f} s")
        partial = table.path / ".run.mcap.partial"
        saved = subprocess.run(
            [klasktron, "recover", str(partial), "-o", str(table.path / "saved.mcap")],
            capture_output=True, text=True)
        expect(saved.returncode == 3, "recover says what was lost", saved.stderr)
        info = subprocess.run([klasktron, "info", "--json", str(table.path / "saved.mcap")],
                              capture_output=True, text=True)
        expect(info.returncode in (0, 3) and "/striker/left/carriage" in info.stdout, "info", info.stderr)
    return f"drives off {seconds:.2f} s after kill -9; {saved.stderr.strip().split(': ', 1)[1]}"


def check_two_collectors(klasktron):
    """The second collector on a bus is refused; the first goes on."""
    with Table() as table:
        table.rig(klasktron)
        table.collect(klasktron)
        table.wait_until_driving()
        second = table.collect(klasktron, log="second.log", out="second.mcap")
        status = second.wait(PATIENCE_S)
        said = table.read("second.log").strip()
        expect(status == 1 and "another klasktron" in said, "the second is refused", status, said)
        states = {state for state, _ in table.states().values()}
        expect(states == {"CLOSED_LOOP_CONTROL"}, "the first goes on", states)
    return said.removeprefix("error: ").replace(str(table.path), "")


def check_interrupted(klasktron):
    """One Ctrl-C: ramp, idle, a complete file, status 3."""
    with Table() as table:
        table.rig(klasktron)
        collector = table.collect(klasktron)
        table.wait_until_driving()
        collector.send_signal(signal.SIGINT)
        status = collector.wait(PATIENCE_S)
        said = table.read("collect.log")
        expect(status == 3 and "stopped: interrupted" in said, "status 3", status, said)
        states = set(table.states().values())
        expect(states == {("IDLE", "none")}, "every drive is idle without an error", states)
        expect((table.path / "run.mcap").exists(), "the recording is there", said)
    return said.strip().splitlines()[-1].replace(str(table.path) + "/", "")


def check_interrupted_twice(klasktron):
    """Two times Ctrl-C: emergency stop of every node."""
    with Table() as table:
        table.rig(klasktron)
        collector = table.collect(klasktron)
        table.wait_until_driving()
        collector.send_signal(signal.SIGINT)
        collector.send_signal(signal.SIGTERM)  # another signal, so that none is merged with the first
        status = collector.wait(PATIENCE_S)
        said = table.read("collect.log")
        expect(status == 3, "status 3", status, said)
        wait_for(lambda: {state for state, _ in table.states().values()} == {"IDLE"}, "idle")
        errors = {errors for _, errors in table.states().values()}
        expect(errors == {"ESTOP_REQUESTED"}, "every drive is stopped", errors, said)
        expect((table.path / "run.mcap").exists(), "the recording is there", said)
    return "every drive reports ESTOP_REQUESTED"


def check_disk_full(klasktron):
    """When the disk takes no more, the session ends and says where what was written is."""
    with tempfile.TemporaryDirectory() as folder:
        def small_files():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

        command = [klasktron, "collect", "--bus", "virtual", "--speed", "max", *CIRCLE]
        ended = subprocess.run([*command, "-o", f"{folder}/run.mcap"], preexec_fn=small_files,
                               capture_output=True, text=True)
        said = ended.stderr.strip()
        expect(ended.returncode == 3, "status 3", ended.returncode, said)
        expect("the recording failed" in said, "the reason", said)
        partial = re.search(r"the unfinished recording is (\S+);", said)
        expect(partial and os.path.getsize(partial[1]) > 100_000, "what was written is kept", said)
        saved = subprocess.run([klasktron, "recover", partial[1], "-o", f"{folder}/saved.mcap"],
                               capture_output=True, text=True)
        expect(saved.returncode == 3, "it can be recovered", saved.stderr)
    stopped = next(line for line in said.splitlines() if line.startswith("stopped"))
    return stopped.replace(folder + "/", "")


MOCK = """
import sys, threading
import can
import odrive_can.mock as mock
import odrive_can.utils as utils

# Two drives of odrive-can on one serial line: each has a bus of its own inside this process, and
# what passes on the line passes on both.
mock.get_dbc = lambda: utils.get_dbc("odrive-cansimple-0.6.10")
line = can.Bus(interface="slcan", channel=sys.argv[1], bitrate=250000, sleep_after_open=0.1)
inside = can.Bus(interface="virtual", channel="drives", receive_own_messages=False)

def bridge(source, target):
    for message in source:
        target.send(message)

for pair in ((line, inside), (inside, line)):
    threading.Thread(target=bridge, args=pair, daemon=True).start()
for node in (2, 3):
    bus = can.Bus(interface="virtual", channel="drives")
    drive = mock.ODriveCANMock(node, can_bus=bus)
    drive.set_rate_of_change(1000.0)
    threading.Thread(target=drive.start, daemon=True).start()
print("the drives run", flush=True)
threading.Event().wait()
"""

# The mock's heartbeat comes every 200 ms, its position every 100 ms and late, and it has two drives.
MOCK_ROBOT = {
    "name": "odrive-can mock",
    "drives": [{"node": 2, "player": "left", "motor": "a", "sign": -1},
               {"node": 3, "player": "left", "motor": "b", "sign": -1}],
    "limits": {"following_error_m": 0.1},
    "timeouts": {"heartbeat_s": 1.0, "encoder_s": 0.6, "arming_s": 5.0},
    "can": {"cyclic_ms": {"heartbeat": 200, "encoder": 100}},
}


def check_mock_drive(klasktron):
    """Drives that nobody here wrote: two mocks of PyPI's odrive-can over slcan."""
    with Table() as table:
        (table.path / "robot.json").write_text(json.dumps(MOCK_ROBOT))
        environment = {**os.environ, "LOGLEVEL": "ERROR"}
        table.start([sys.executable, "-c", MOCK, f"{table.path}/table"], "mock.log", env=environment)
        wait_for(lambda: "the drives run" in table.read("mock.log"), "the mock drives")
        # The mock has no watchdog and says that its firmware is 0.0.0.
        collector = table.collect(klasktron, "--robot", f"{table.path}/robot.json", "--seconds", "5",
                                  "--watchdog", "none", "--accept-firmware", "0.0.0", "--raw")
        status = collector.wait(PATIENCE_S)
        said = table.read("collect.log")
        # Its positions come as asyncio's sleep lets them, so some may be missed (status 3).
        done = status in (0, 3) and "1 of 1 runs" in said and "stopped" not in said
        expect(done, "the run is done", status, said, table.read("mock.log"))
        export = [klasktron, "export", f"{table.path}/run.mcap", "--to", "csv", "--topic",
                  "/motor/left/a", "--output", f"{table.path}/motor.csv"]
        subprocess.run(export, check=True, capture_output=True)
        rows = (table.path / "motor.csv").read_text().splitlines()
        column = rows[0].split(",").index("velocity_turns_per_s")
        speeds = [abs(float(row.split(",")[column])) for row in rows[1:]]
        # 0.15 m/s on a circle: a motor turns at most 0.15 sqrt(2) / 0.04 = 5.3 turns/s.
        expect(4.0 < max(speeds) < 6.5, "the drives follow", max(speeds), said)
    return f"fastest motor {max(speeds):.2f} turns/s; {said.strip().splitlines()[-1].split(': ', 1)[1]}"


CHECKS = {name.removeprefix("check_"): check for name, check in list(globals().items())
          if name.startswith("check_")}


def main():
    klasktron = str(pathlib.Path(sys.argv[1]).resolve())
    for name in sys.argv[2:] or CHECKS:
        print(f"{name}: {CHECKS[name](klasktron)}", flush=True)


if __name__ == "__main__":
    main()
