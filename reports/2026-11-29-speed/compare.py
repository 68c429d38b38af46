#!/usr/bin/env python3
"""Processor time of `gap` with several programs, one after the other on the same pairs of recordings.

    python3 compare.py PRACTICE OUT --program PROGRAM [--program PROGRAM]... --case NAME [--case NAME]...

PRACTICE holds pairs NAME-1.mcap and NAME-2.mcap, with baseline or ball-baseline among them, as for `scripts/check_gap.py`.
Each program runs on one core and starts from its own base twin. Prints user and system seconds, and writes them to OUT/cpu.json.
"""

import argparse
import json
import resource
import subprocess
import sys
from pathlib import Path


def has_option(program, option):
    """Whether `gap` of this program, which may be an early one, has the option."""
    shown = subprocess.run([program, "gap", "--help"], capture_output=True, text=True, check=True)
    return option in shown.stdout


def measured(program, practice, name, twin, folder):
    """CPU seconds of one pair, and the effects that are added."""
    output = "--output" if has_option(program, "--output") else "--out"
    command = ["taskset", "--cpu-list", "0", program, "gap", practice / f"{name}-1.mcap", practice / f"{name}-2.mcap", output, folder]
    command += ["--overwrite"] if has_option(program, "--overwrite") else []
    command += ["--twin", twin] if twin else []
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(command, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode not in (0, 3):
        sys.exit(f"{program} {name}: status {done.returncode}: {done.stderr}")
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = json.loads((folder / "gap.json").read_text())
    return {"cpu_s": round(seconds, 1), "effects": [one["name"] for one in found["effects"]]}


def main():
    """Measures every case with every program in turn."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("practice", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--program", action="append", required=True)
    parser.add_argument("--case", action="append", required=True)
    args = parser.parse_args()
    results = {}
    bases = {"ball-baseline" if name.startswith("ball") else "baseline" for name in args.case}
    for name in sorted(bases) + [name for name in args.case if name not in bases]:
        for program in args.program:
            base = "ball-baseline" if name.startswith("ball") else "baseline"
            own = args.out / Path(program).name
            twin = None if name in bases else own / base / "twin.json"
            folder = own / name
            folder.parent.mkdir(parents=True, exist_ok=True)
            result = measured(program, args.practice, name, twin, folder)
            results.setdefault(name, {})[Path(program).name] = result
            print(f"{name:<16} {Path(program).name:<12} {result['cpu_s']:6.1f} s {result['effects']}", flush=True)
            (args.out / "cpu.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
