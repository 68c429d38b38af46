#!/usr/bin/env python3
"""Speed of the virtual rig, and lateness of a live loop at 500 Hz: bench_collect.py KLASKTRON [OUT.json]

Live: the virtual rig runs as a process of its own on a pseudo-terminal (socat), four axes, positions,
torques and setpoints at 500 Hz through slcan for 60 s: 6080 frames/s. The timer's own lateness is measured in the same
minutes by sleeping to absolute deadlines in Python.
"""

import json
import os
import pathlib
import platform
import re
import subprocess
import sys
import tempfile
import time

LIVE_SECONDS = 60
LIVE_HZ = 500


def collect(klasktron, folder, *arguments):
    """Seconds that a session takes, and its report; the session must be complete."""
    out = pathlib.Path(folder) / "out.mcap"
    started = time.perf_counter()
    run = subprocess.run([klasktron, "collect", *arguments, "-o", str(out), "--json", "--overwrite"],
                         capture_output=True, text=True)
    seconds = time.perf_counter() - started
    if run.returncode != 0:
        raise SystemExit(run.stderr)
    return seconds, json.loads(run.stdout), out


def virtual(klasktron, folder):
    """Ten minutes at 50 Hz, and the paper's data set."""
    ten = ["--speed", "max", "--pattern", "circle", "--pattern", "random_walk", "--seconds", "300",
           "--repeat", "1"]
    seconds, report, out = collect(klasktron, folder, *ten)
    figures = {"ten_minutes": {"wall_s": seconds, "samples": report["samples"],
                               "simulated_s": report["duration_s"]}}
    seconds, report, _ = collect(klasktron, folder, "--speed", "max", "--plan", "paper", "--player", "left")
    figures["paper"] = {"wall_s": seconds, "samples": report["samples"], "runs": report["runs_done"],
                        "simulated_s": report["duration_s"]}
    return figures


def timer_lateness():
    """How late this machine wakes from sleeping to absolute deadlines (us)."""
    late = []
    deadline = time.monotonic_ns()
    for _ in range(5 * LIVE_HZ):
        deadline += 1_000_000_000 // LIVE_HZ
        time.sleep(max(0, deadline - time.monotonic_ns()) / 1e9)
        late.append((time.monotonic_ns() - deadline) / 1e3)
    late.sort()
    return {"p50_us": late[len(late) // 2], "p99_us": late[len(late) * 99 // 100], "max_us": late[-1]}


def positions_lost(klasktron, recording):
    """Positions that are missing between the first and the last of each drive, at 500 Hz."""
    run = subprocess.run([klasktron, "info", "--json", str(recording)], capture_output=True, text=True)
    topics = json.loads(run.stdout)["files"][0]["topics"]
    motors = [topic for topic in topics if topic["topic"].startswith("/motor/")]
    if len(motors) != 4:
        raise SystemExit(f"four motors expected, not {len(motors)}")
    return sum(round((topic["last_s"] - topic["first_s"]) * LIVE_HZ) + 1 - topic["messages"]
               for topic in motors)


def live(klasktron, folder):
    """Four axes through slcan on a pseudo-terminal."""
    table, host = (f"{folder}/{name}" for name in ("table", "host"))
    cyclic = {"heartbeat": 100, "encoder": 2, "torques": 2}
    robot = {"can": {"bitrate": 1_000_000, "cyclic_ms": cyclic}}
    rig = {"bus": {"bitrate": 1_000_000}, "drive": {"cyclic_ms": cyclic}}
    (pathlib.Path(folder) / "robot.json").write_text(json.dumps(robot))
    (pathlib.Path(folder) / "rig.json").write_text(json.dumps(rig))
    socat = subprocess.Popen(["socat"] + [f"pty,raw,echo=0,link={end}" for end in (table, host)])
    while not (os.path.exists(table) and os.path.exists(host)):
        time.sleep(0.01)
    with open(f"{folder}/rig.log", "w") as log:
        rig = subprocess.Popen([klasktron, "rig", "--bus", f"slcan:{table}", "--rig", f"{folder}/rig.json"],
                               stdout=subprocess.DEVNULL, stderr=log)
    time.sleep(0.5)
    timer = timer_lateness()
    _, report, out = collect(
        klasktron, folder, "--bus", f"slcan:{host}", "--robot", f"{folder}/robot.json", "--rate-hz",
        str(LIVE_HZ), "--homing", "declared", "--pattern", "circle", "--seconds", str(LIVE_SECONDS), "--raw")
    rig.send_signal(2)
    rig.wait()
    socat.kill()
    said = pathlib.Path(folder, "rig.log").read_text()
    heard, sent, dropped = map(int, re.search(
        r"(\d+) frames received, (\d+) sent, (\d+) given up", said).groups())
    return {"lateness": report["control_loop"], "timer": timer, "setpoints_dropped": report["setpoints_dropped"],
            "frames_sent_by_collect": report["frames_sent"], "frames_received_by_rig": heard,
            "frames_sent_by_rig": sent, "frames_received_by_collect": report["frames_received"],
            "frames_given_up_by_rig": dropped, "positions_lost": positions_lost(klasktron, out)}


def main():
    klasktron = str(pathlib.Path(sys.argv[1]).resolve())
    with tempfile.TemporaryDirectory() as folder:
        figures = {"machine": f"{platform.machine()}, {os.cpu_count()} cores", **virtual(klasktron, folder)}
        figures["live_500_hz"] = live(klasktron, folder)
    text = json.dumps(figures, indent=1)
    print(text)
    if 2 < len(sys.argv):
        pathlib.Path(sys.argv[2]).write_text(text + "\n")


if __name__ == "__main__":
    main()
