#!/usr/bin/env python3
"""Hides effects in an independent simulator of the table and counts what `klasktron gap` names.

    scripts/check_foreign_rig.py make RIG OUT --seed N [--bases 3]     cases, recordings and answers
    scripts/check_foreign_rig.py run PROGRAM OUT RESULTS [--case NAME]... [--jobs N]

RIG is a folder with `make_data.py`, a simulator that shares no code and no equations with this project: see its
README for the fields of `truth` and `sensor`. `make` draws a machine per base, and per machine a recording pair
without changes (for the base twin), pairs with one effect, with two, and with none but another course. Run it with a Python
that has what RIG needs. `run` calibrates a twin for each base, compares every other pair with it, and prints per case
what was hidden, found and named beside; RESULTS/cases-results.json and RESULTS/summary.json keep the figures.

A case counts as exact when every hidden effect is named (or, where the base twin already has it, its parameter
changed) and nothing else is; as answered when the effects that are named or listed as indistinguishable include all
that were hidden and no effect is named that does not belong to such a set.
"""

import argparse
import concurrent.futures
import json
import random
import resource
import subprocess
import sys
import time
from pathlib import Path

SECONDS = 48


def machine(rng, number):
    """The truth of one machine without hidden effects: the first is the rig's own, the others are drawn."""
    if number == 0:
        return {"coulomb": [1.0, 1.5], "viscous": [2.0, 3.0]}
    return {
        "bridge_mass": round(rng.uniform(0.3, 0.7), 3),
        "carriage_mass": round(rng.uniform(0.15, 0.4), 3),
        "rotor_inertia": round(rng.uniform(2e-5, 8e-5), 7),
        "kp": round(rng.uniform(0.04, 0.09), 4),
        "ki": round(rng.uniform(0.6, 2.0), 3),
        "coulomb": [round(rng.uniform(0.5, 2.5), 2), round(rng.uniform(0.5, 2.5), 2)],
        "viscous": [round(rng.uniform(1.0, 4.0), 2), round(rng.uniform(1.0, 4.0), 2)],
        "accel_limit": round(rng.uniform(8.0, 12.0), 2),
    }


def gantry_effects(rng, base):
    """One draw of every effect of the gantry, the coupling and the camera: name -> (truth, sensor, answers)."""
    low, high = base["coulomb"]
    sign = lambda: rng.choice([-1, 1])
    draw = lambda low, high, digits=4: round(rng.uniform(low, high), digits)
    gain = draw(0.92, 0.975)
    return {
        "delay": ({"delay": draw(0.008, 0.03)}, {}, ["drive.delay"]),
        "slew": ({"accel_limit": draw(3.0, 5.0)}, {}, ["drive.saturation.slew"]),
        "speed": ({"speed_limit": draw(0.25, 0.4)}, {}, ["drive.saturation.speed"]),
        "backlash": ({"backlash": draw(0.0006, 0.0015, 5)}, {}, ["drive.backlash"]),
        "cogging": ({"cogging": draw(0.03, 0.1), "cogging_poles": rng.choice([7, 12, 14, 20])}, {}, ["drive.ripple.motor"]),
        "gain": ({"gain": [gain, gain]}, {}, ["drive.gain"]),
        "gain-a": ({"gain": [gain, 1.0]}, {}, ["drive.gain"]),
        "squareness": ({"skew": sign() * draw(0.012, 0.03)}, {}, ["gantry.squareness"]),
        "tilt": ({"tilt": [sign() * draw(0.4, 1.0), sign() * draw(0.4, 1.0)]}, {}, ["gantry.tilt"]),
        "coulomb": ({"coulomb": [low + draw(2, 5), high + draw(2, 5)]}, {}, ["drive.friction.coulomb"]),
        "viscous": (
            {"viscous": [base["viscous"][0] + draw(4, 9), base["viscous"][1] + draw(4, 9)]},
            {},
            ["drive.friction.viscous"],
        ),
        "stribeck": (
            {"coulomb": [3.0, 4.0], "stribeck": draw(0.6, 1.2), "stribeck_speed": draw(0.02, 0.05)},
            {},
            ["drive.friction.coulomb", "drive.friction.stribeck"],
        ),
        "inertia": (
            {"carriage_mass": base.get("carriage_mass", 0.25) + draw(0.15, 0.4)},
            {},
            ["gantry.inertia"],
        ),
        "belt": ({"belt_stiffness": draw(4e3, 1.2e4, 0)}, {}, ["drive.compliance.belt"]),
        "magnet": ({"magnet_stiffness": draw(20, 70, 1)}, {}, ["coupling.magnet_spring"]),
        "rub": ({"peg_friction": draw(0.3, 0.9), "magnet_stiffness": 600.0}, {}, ["coupling.striker_friction"]),
        "latency": ({}, {"camera_latency": draw(0.012, 0.04)}, ["sensor.camera_latency"]),
        "scale": (
            {},
            {"camera_scale": round(1 + sign() * draw(0.01, 0.025), 4), "camera_rotation": sign() * draw(0.01, 0.03)},
            ["sensor.camera_scale_rotation"],
        ),
        "drop": ({}, {"frame_drop": draw(0.05, 0.2)}, ["sensor.frame_drop"]),
        "jitter": ({}, {"frame_jitter": draw(0.002, 0.005, 5), "stamp_at_capture": True}, ["sensor.frame_jitter"]),
    }


def ball_effects(rng):
    """One draw of every effect of the ball and the walls."""
    sign = lambda: rng.choice([-1, 1])
    draw = lambda low, high, digits=4: round(rng.uniform(low, high), digits)
    return {
        "ball-rolling": ({"rolling": draw(0.018, 0.03)}, {}, ["ball.rolling_resistance"]),
        "ball-drag": ({"air_drag": draw(0.1, 0.3)}, {}, ["ball.air_drag"]),
        "ball-tilt": ({"tilt": [sign() * draw(0.002, 0.006, 5), sign() * draw(0.002, 0.006, 5)]}, {}, ["ball.tilt"]),
        "ball-sag": ({"sag": sign() * draw(0.02, 0.05)}, {}, ["ball.board_curvature"]),
        "ball-restitution": ({"restitution": draw(0.65, 0.78)}, {}, ["impact.wall_restitution"]),
        "ball-slope": ({"restitution_slope": draw(0.08, 0.2)}, {}, ["impact.wall_restitution_speed"]),
        "ball-wall": ({"wall_friction": draw(0.05, 0.2)}, {}, ["impact.wall_friction_spin"]),
    }


def pairs(rng, effects, count):
    """Two effects at once that do not write the same field."""
    names = list(effects)
    chosen = []
    while len(chosen) < count:
        one, two = rng.sample(names, 2)
        fields = lambda name: set(effects[name][0]) | set(effects[name][1])
        if fields(one) & fields(two) or {"gain", "speed"} & {one, two} and "gain-a" in (one, two):
            continue
        truth, sensor = {**effects[one][0], **effects[two][0]}, {**effects[one][1], **effects[two][1]}
        chosen.append((f"{one}+{two}", (truth, sensor, effects[one][2] + effects[two][2])))
    return chosen


def cases(seed, bases):
    """All cases of one seed."""
    rng = random.Random(seed)
    made = []

    def add(name, base, truth, sensor, answer, kind, group):
        made.append({
            "name": name, "kind": kind, "seed": seed * 1000 + len(made), "sessions": 2, "seconds": SECONDS,
            "truth": {**base, **truth}, "sensor": sensor, "answer": answer, "base": group,
        })  # fmt: skip

    for number in range(bases):
        base = machine(rng, number)
        group = f"m{number}"
        add(f"{group}-base", base, {}, {}, [], "gantry", None)
        effects = gantry_effects(rng, base)
        for name, (truth, sensor, answer) in [*effects.items(), *pairs(rng, effects, 5)]:
            add(f"{group}-{name}", base, truth, sensor, answer, "gantry", f"{group}-base")
        for name, sensor in (("slow", {"max_speed": 0.3}), ("fast", {"max_speed": 0.65}), ("runs", {"runs": 4})):
            add(f"{group}-null-{name}", base, {}, sensor, [], "gantry", f"{group}-base")
        ball = {} if number == 0 else {"rolling": round(rng.uniform(0.008, 0.016), 4), "restitution": round(rng.uniform(0.75, 0.9), 3)}
        add(f"{group}-ball-base", ball, {}, {}, [], "ball", None)
        effects = ball_effects(rng)
        for name, (truth, sensor, answer) in [*effects.items(), *pairs(rng, effects, 2)]:
            add(f"{group}-{name}", ball, truth, sensor, answer, "ball", f"{group}-ball-base")
        add(f"{group}-ball-null", ball, {}, {}, [], "ball", f"{group}-ball-base")
    return made


def make(rig, out, seed, bases, only):
    """Writes cases.json, and the recordings in parts, so that a stopped run goes on where it was."""
    out.mkdir(parents=True, exist_ok=True)
    made = cases(seed, bases)
    (out / "cases.json").write_text(json.dumps(made, indent=1) + "\n")
    for case in made:
        done = out / f"{case['name']}-2.mcap"
        if done.exists() or (only and case["name"] not in only):
            continue
        folder = out / "making"
        part = out / "part.json"
        part.write_text(json.dumps([{key: value for key, value in case.items() if key != "base"}]))
        subprocess.run([sys.executable, rig / "make_data.py", folder, part], check=True, stdout=subprocess.DEVNULL)
        for number in (1, 2):
            (folder / f"{case['name']}-{number}.mcap").rename(out / f"{case['name']}-{number}.mcap")
        print(case["name"], flush=True)


def gap(program, data, results, case):
    """gap.json of one case and its wall time; CPU times of parallel cases cannot be told apart."""
    name, base = case["name"], case["base"]
    folder = results / name
    command = [program, "gap", data / f"{name}-1.mcap", data / f"{name}-2.mcap", "--quiet", "--overwrite"]
    command += ["--output", folder] + (["--twin", results / base / "twin.json"] if base else [])
    began = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in (0, 3):
        return None, time.monotonic() - began, done.stderr.strip()
    return json.loads((folder / "gap.json").read_text()), time.monotonic() - began, ""


def judge(found, case):
    """What was named, against what was hidden."""
    named = [effect["name"] for effect in found["effects"]]
    moved = {entry["name"].rsplit(".", 1)[0] for entry in found["parameter_changes"]}
    sets = [set(group["names"]) for group in found["indistinguishable"]]
    wanted = case["answer"]
    has = lambda name: name in named or name in moved
    allowed = set(wanted).union(*[group for group in sets if group & set(wanted)]) if wanted else set()
    wrong = [name for name in named if name not in wanted]
    return {
        "case": case["name"],
        "hidden": wanted,
        "verdict": found["verdict"],
        "named": named,
        "changed": sorted(moved),
        "indistinguishable": [sorted(group) for group in sets],
        "missed": [name for name in wanted if not has(name)],
        "wrong": wrong,
        "exact": not wrong and all(map(has, wanted)),
        "answered": all(has(name) or any(name in group for group in sets) for name in wanted)
        and all(name in allowed for name in named),
    }


def run(program, data, results, only, jobs):
    """Bases first, then every other case."""
    results.mkdir(parents=True, exist_ok=True)
    every = [case for case in json.loads((data / "cases.json").read_text()) if (data / f"{case['name']}-2.mcap").exists()]
    wanted = [case for case in every if case["base"] and (not only or any(case["name"].startswith(o) for o in only))]
    needed = {case["base"] for case in wanted}
    rows = []
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        bases = [case for case in every if case["name"] in needed and not (results / case["name"] / "twin.json").exists()]
        for case, (found, seconds, error) in zip(bases, pool.map(lambda case: gap(program, data, results, case), bases)):
            if found is None:
                sys.exit(f"{case['name']}: {error}")
            print(f"{case['name']:<28} {seconds:6.1f} s  base twin: {[e['name'] for e in found['effects']]}", flush=True)
        for case, (found, seconds, error) in zip(wanted, pool.map(lambda case: gap(program, data, results, case), wanted)):
            if found is None:
                row = {"case": case["name"], "hidden": case["answer"], "error": error, "exact": False, "answered": False, "wrong": [], "missed": case["answer"]}
            else:
                row = judge(found, case)
            row["seconds"] = round(seconds, 1)
            rows.append(row)
            mark = "ok     " if row["exact"] else "set    " if row["answered"] else "WRONG  " if row["wrong"] else "missed "
            print(f"{mark}{row['case']:<28} {seconds:6.1f} s  hidden {row['hidden']} named {row.get('named')} changed {row.get('changed')} sets {row.get('indistinguishable')} {row.get('verdict')}", flush=True)
            (results / "cases-results.json").write_text(json.dumps(rows, indent=1) + "\n")
    single, both, null = ([row for row in rows if len(row["hidden"]) == n] for n in (1, 2, 0))
    share = lambda part, key: f"{sum(bool(row[key]) for row in part)} of {len(part)}"
    summary = {
        "single_exact": share(single, "exact"), "single_answered": share(single, "answered"),
        "two_exact": share(both, "exact"), "two_answered": share(both, "answered"),
        "wrong_name": share(rows, "wrong"), "null_wrong": share(null, "wrong"),
        "cpu_seconds": round(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, 1),
    }  # fmt: skip
    (results / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    print(json.dumps(summary, indent=1))


def main():
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    maker = commands.add_parser("make")
    maker.add_argument("rig", type=Path)
    maker.add_argument("out", type=Path)
    maker.add_argument("--seed", type=int, required=True)
    maker.add_argument("--bases", type=int, default=3)
    maker.add_argument("--case", action="append")
    runner = commands.add_parser("run")
    runner.add_argument("program")
    runner.add_argument("data", type=Path)
    runner.add_argument("results", type=Path)
    runner.add_argument("--case", action="append", help="names that start with this")
    runner.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if args.command == "make":
        make(args.rig, args.out, args.seed, args.bases, args.case)
    else:
        run(args.program, args.data, args.results, args.case, args.jobs)


if __name__ == "__main__":
    main()
