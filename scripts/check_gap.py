#!/usr/bin/env python3
"""Runs `klasktron gap` on recordings with known answers and prints what was found.

    scripts/check_gap.py PROGRAM PRACTICE_DIR OUT_DIR [--case NAME]...

PRACTICE_DIR holds pairs NAME-1.mcap, NAME-2.mcap and answers.json, as the gap contract describes or as
`scripts/hide_effects.py` writes them: the base twins come from baseline-{1,2} and ball-baseline-{1,2}, where
the answers list them, every other pair starts from one of them. OUT_DIR receives each result and practice.json.
"""

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path


def run(program, practice, out, name, twin, options=()):
    """gap.json of one pair, with the wall time."""
    folder = out / name
    command = [program, "gap", practice / f"{name}-1.mcap", practice / f"{name}-2.mcap"]
    command += ["--output", folder, "--overwrite", *options]
    if twin:
        command += ["--twin", twin]
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    seconds = time.monotonic() - began
    if done.returncode not in (0, 3):
        sys.exit(f"{name}: status {done.returncode}: {done.stderr}")
    return json.loads((folder / "gap.json").read_text()), seconds


def verdict(found, truths, base):
    """What was found of the truth, and what else was named."""
    named = [effect["name"] for effect in found["effects"]]
    moved = {entry["name"].rsplit(".", 1)[0] for entry in found["parameter_changes"]}
    wanted = [truth["effect"] for truth in truths]
    hit = [name for name in wanted if name in named or (name in base and name in moved)]
    wrong = [name for name in named if name not in wanted]
    return {"wanted": wanted, "found": hit, "other_names": wrong}


def main():
    """Runs all cases and prints one line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("practice", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--case", action="append")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    answers = json.loads((args.practice / "answers.json").read_text())
    bases = {}
    for name in ("baseline", "ball-baseline"):
        if name not in answers:
            continue
        _, seconds = run(args.program, args.practice, args.out, name, None)
        twin = args.out / name / "twin.json"
        bases[name] = {entry["name"] for entry in json.loads(twin.read_text())["effects"]}
        print(f"{name:<16} {seconds:6.1f} s  base twin", flush=True)
    results = []
    for name, truths in answers.items():
        if name in bases or (args.case and name not in args.case):
            continue
        base = "ball-baseline" if name.startswith("ball") else "baseline"
        found, seconds = run(
            args.program, args.practice, args.out, name, args.out / base / "twin.json"
        )
        row = {"case": name, "seconds": round(seconds, 1), "verdict": found["verdict"]}
        row |= verdict(found, truths, bases[base])
        row["effects"] = [
            {key: effect[key] for key in ("name", "location", "parameters")} for effect in found["effects"]
        ]
        row["parameter_changes"] = found["parameter_changes"]
        results.append(row)
        print(
            f"{name:<16} {seconds:6.1f} s  {row['verdict']:<12} wanted {row['wanted']} "
            f"found {row['found']} also named {row['other_names']}",
            flush=True,
        )
        (args.out / "practice.json").write_text(json.dumps(results, indent=1) + "\n")
    missed = [row["case"] for row in results if row["wanted"] != row["found"] or row["other_names"]]
    print("missed or named beside the truth:", ", ".join(missed) or "none")


if __name__ == "__main__":
    main()
