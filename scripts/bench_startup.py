#!/usr/bin/env python3
"""Size and start-up time of the program, as JSON: scripts/bench_startup.py [PROGRAM]

`--help` of the program and of a subcommand, 50 runs each, started from an empty folder; the goal is a median
under 20 ms. The stripped size is that of a copy.
"""

import json
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_tools import default_binary

RUNS = 50
GOAL_MS = 20.0


def times_ms(program, arguments, folder):
    """How long each of the runs takes (ms)."""
    times = []
    for _ in range(RUNS):
        begun = time.perf_counter()
        subprocess.run([program, *arguments], cwd=folder, stdout=subprocess.DEVNULL, check=True)
        times.append(1e3 * (time.perf_counter() - begun))
    return times


def stripped_bytes(program, folder):
    """Size without symbols."""
    if shutil.which("strip") is None:
        return None
    copy = folder / "stripped"
    subprocess.run(["strip", "-o", copy, program], check=True)
    return copy.stat().st_size


def main():
    program = Path(sys.argv[1] if 1 < len(sys.argv) else default_binary()).resolve()
    version = subprocess.run([program, "--version"], capture_output=True, text=True, check=True)
    result = {
        "version": version.stdout.strip(),
        "bytes": program.stat().st_size,
        "goal_ms": GOAL_MS,
        "runs": RUNS,
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        result["stripped_bytes"] = stripped_bytes(program, folder)
        for arguments in (["--help"], ["train", "--help"], ["--version"]):
            times = times_ms(program, arguments, folder)
            result[" ".join(arguments)] = {
                "median_ms": round(statistics.median(times), 2),
                "fastest_ms": round(min(times), 2),
                "slowest_ms": round(max(times), 2),
            }
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
