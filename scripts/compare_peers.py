#!/usr/bin/env python3
"""Compares `klasktron gap` with three other ways to select the terms of a single axis, on cases with known answers.

    scripts/compare_peers.py PROGRAM OUT_DIR [--real DATA_DIR] [--case NAME]... [--cases synthetic|real]

The others are the lowest validation error over the friction models m1 to m6 of BAM (github.com/Rhoban/bam), forward
selection by the Bayesian information criterion, and sequentially thresholded least squares (PySINDy). They share one
regression: input = sum of terms of the measured motion. Synthetic cases come from the simulator in this script, which
shares no code with klasktron. DATA_DIR holds truth.json as scripts/check_axes.py describes; without it, real cases are
skipped. OUT_DIR receives the recordings, each result and peers.json. Needs numpy, scipy and pysindy.
"""

import argparse
import csv
import fnmatch
import itertools
import json
import math
import subprocess
import sys
from pathlib import Path

import check_axes
import numpy as np
import pysindy
from scipy.signal import butter, sosfiltfilt

RIPPLE = ["drive.ripple.motor", "drive.ripple.pulley", "drive.ripple.belt_tooth"]
LATE = ["drive.delay", "drive.lag1", "drive.current_loop"]

# Terms beside inertia, viscous and Coulomb friction and a constant, with the effects of the catalogue that they stand for.
TERMS = {
    "quadratic": ["drive.friction.quadratic"],
    "asymmetric": ["drive.friction.asymmetric"],
    "stribeck": ["drive.friction.stribeck"],
    "load": ["drive.friction.load"],
    "load_by_direction": ["drive.friction.load"],
    "position_friction": ["drive.friction.position"],
    "stiffness": ["gantry.stiffness"],
    "mass_position": ["gantry.mass_position"],
    "jerk": LATE,
    "thermal": ["drive.friction.thermal_drift"],
    "wave_1": RIPPLE,
    "wave_2": RIPPLE,
}
# Friction models of BAM beside Coulomb and viscous friction.
BAM = {
    "m1": [],
    "m2": ["stribeck"],
    "m3": ["load"],
    "m4": ["stribeck", "load"],
    "m5": ["stribeck", "load", "load_by_direction"],
    "m6": ["stribeck", "load", "load_by_direction", "quadratic"],
}
# Columns of every regression: acceleration, velocity, its sign, constant.
BASE = 4
THRESHOLDS = [0.01, 0.02, 0.05, 0.1, 0.2, 0.4]
PEERS = ["klasktron gap", "lowest validation error (BAM m1 to m6)", "BIC forward selection", "PySINDy STLSQ"]

# ---------------------------------------------------------------- the simulator of the synthetic cases

SIMULATED_HZ = 4000
RECORDED_HZ = 500
SECONDS = 16
MACHINES = {
    "screw": dict(mass=30.0, coulomb=10.0, viscous=80.0, reach=0.15, speed=2.2, noise=0.6, quantum=2e-6, unit="N", length="m"),
    "servo": dict(mass=2e-4, coulomb=0.012, viscous=6e-4, reach=9.0, speed=2.6, noise=7e-4, quantum=4e-4, unit="N m", length="rad"),
}
# Name, machine, hidden effects, groups of right names; None where no list of terms has the effect.
CASES = [
    *[(f"null-{machine}-{seed}", machine, {}, []) for machine in MACHINES for seed in (1, 2, 3)],
    ("quadratic-screw", "screw", {"quadratic": 120.0}, [["drive.friction.quadratic"]]),
    ("quadratic-servo", "servo", {"quadratic": 6e-5}, [["drive.friction.quadratic"]]),
    ("asymmetric-screw", "screw", {"asymmetric": 40.0}, [["drive.friction.asymmetric"]]),
    ("asymmetric-servo", "servo", {"asymmetric": 4e-4}, [["drive.friction.asymmetric"]]),
    ("stribeck-screw", "screw", {"stribeck": 9.0}, [["drive.friction.stribeck"]]),
    ("stribeck-servo", "servo", {"stribeck": 0.012}, [["drive.friction.stribeck"]]),
    ("position-screw", "screw", {"position_friction": 60.0}, [["drive.friction.position"]]),
    ("position-servo", "servo", {"position_friction": 1.2e-3}, [["drive.friction.position"]]),
    ("stiffness-screw", "screw", {"stiffness": 90.0}, [["gantry.stiffness"]]),
    ("stiffness-servo", "servo", {"stiffness": 1.2e-3}, [["gantry.stiffness"]]),
    ("ripple-screw", "screw", {"ripple": (4.0, 0.02)}, [RIPPLE]),
    ("ripple-servo", "servo", {"ripple": (0.006, math.tau / 7)}, [RIPPLE]),
    ("delay-screw", "screw", {"delay": 0.008}, [LATE]),
    ("delay-servo", "servo", {"delay": 0.006}, [LATE]),
    ("null-with-offset", "screw", {"constant": 6.0}, []),
    ("quadratic-and-stiffness", "screw", {"quadratic": 150.0, "stiffness": 120.0},
     [["drive.friction.quadratic"], ["gantry.stiffness"]]),
    ("asymmetric-and-ripple", "servo", {"asymmetric": 4e-4, "ripple": (0.008, math.tau / 7)},
     [["drive.friction.asymmetric"], RIPPLE]),
    ("offset-and-stribeck", "screw", {"constant": 8.0, "stribeck": 10.0}, [["drive.friction.stribeck"]]),
    ("outside-cubic-forwards", "screw", {"cubic_forwards": 600.0}, None),
    ("square-of-position-screw", "screw", {"square": 900.0}, [["drive.friction.position"]]),
    ("square-of-position-servo", "servo", {"square": 4e-4}, [["drive.friction.position"]]),
]


def course(machine, seed, t):
    """Position to follow: a sum of sines whose phases depend on the seed."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, math.tau, 3)
    rates = machine["speed"] * np.array([0.6, 1.37, 3.1])
    sizes = machine["reach"] * np.array([0.6, 0.3, 0.1])
    return sum(size * np.sin(rate * t + phase) for size, rate, phase in zip(sizes, rates, phases))


def resistance(machine, hidden, x, v, t):
    """Force against the motion besides inertia: friction and what is hidden."""
    direction = math.tanh(v / (1e-3 * machine["reach"] * machine["speed"]))
    level = machine["coulomb"] + hidden.get("position_friction", 0.0) * x + hidden.get("square", 0.0) * x * x
    pace = 0.06 * machine["reach"] * machine["speed"]
    level += hidden.get("stribeck", 0.0) * math.exp(-((v / pace) ** 2))
    force = level * direction + machine["viscous"] * v
    force += hidden.get("quadratic", 0.0) * v * abs(v) + hidden.get("asymmetric", 0.0) * abs(v)
    force += hidden.get("cubic_forwards", 0.0) * max(v, 0.0) ** 3
    force += hidden.get("stiffness", 0.0) * x + hidden.get("constant", 0.0)
    if "ripple" in hidden:
        size, period = hidden["ripple"]
        force += size * math.sin(math.tau * x / period + 0.4)
    return force


def simulated(machine, hidden, seed):
    """Time, input and position of one session: a loop with feedforward makes the axis follow its course."""
    dt = 1.0 / SIMULATED_HZ
    count = SECONDS * SIMULATED_HZ
    wanted = course(machine, seed, np.arange(count + 2) * dt)
    late = int(hidden.get("delay", 0.0) * SIMULATED_HZ)
    pace = 12.0 * machine["speed"]
    inputs, positions = np.zeros(count), np.zeros(count)
    x, v = wanted[0], (wanted[1] - wanted[0]) / dt
    for k in range(count):
        speed = (wanted[k + 1] - wanted[k]) / dt
        acceleration = (wanted[k + 2] - 2 * wanted[k + 1] + wanted[k]) / dt**2
        pull = acceleration + 2 * pace * (speed - v) + pace**2 * (wanted[k] - x)
        inputs[k] = machine["mass"] * pull + machine["viscous"] * speed + machine["coulomb"] * np.sign(speed)
        positions[k] = x
        force = inputs[max(k - late, 0)]
        v += dt * (force - resistance(machine, hidden, x, v, k * dt)) / machine["mass"]
        x += dt * v
    every = SIMULATED_HZ // RECORDED_HZ
    rng = np.random.default_rng(1000 + seed)
    inputs = inputs[::every] + machine["noise"] * rng.standard_normal(count // every)
    positions = machine["quantum"] * np.round(positions[::every] / machine["quantum"])
    return np.arange(count // every) / RECORDED_HZ, inputs, positions


def synthetic(out):
    """Cases of the simulator above, as CSV files with what is right about them."""
    for number, (name, kind, hidden, right) in enumerate(CASES):
        machine = MACHINES[kind]
        folder = out / name
        folder.mkdir(parents=True, exist_ok=True)
        files = {"train": [], "validation": []}
        for index, purpose in enumerate(["train", "train", "validation"]):
            path = folder / f"{purpose}-{index}.csv"
            files[purpose].append(path)
            if path.exists():
                continue
            rows = zip(*simulated(machine, hidden, 10 * number + index))
            with open(path, "w", newline="") as file:
                writer = csv.writer(file)
                writer.writerow(["t_s", "input", "position"])
                writer.writerows([repr(float(value)) for value in row] for row in rows)
        columns = {"time": "t_s", "input": "input", "input_unit": machine["unit"], "position": "position",
                   "position_unit": machine["length"], "velocity": None}
        allowed = sorted({one for group in right or [] for one in group})
        yield {"name": name, "group": "synthetic", "files": files, "columns": columns, "wanted": right or [],
               "is_wrong": lambda one, allowed=allowed: one not in allowed}


def real(data):
    """Cases of DATA_DIR without a baseline; names are wanted where every right verdict has one."""
    for case in json.loads((data / "truth.json").read_text()):
        if case["files"].get("baseline"):
            continue
        patterns = case.get("must_not_name", [])
        must_name = set(case["verdict_any_of"]) <= {"named", "ambiguous"}
        files = {purpose: [data / own for own in case["files"].get(purpose, [])] for purpose in ("train", "validation")}
        yield {"name": case["name"], "group": "real", "files": files, "columns": case["columns"],
               "wanted": case.get("must_name_any_of", []) if must_name else [],
               "is_wrong": lambda one, patterns=patterns: any(fnmatch.fnmatch(one, own) for own in patterns)}


# ---------------------------------------------------------------- klasktron gap


def recording(program, case, source, purpose, target):
    """The CSV file `source` as a recording, or None where the import refuses it."""
    columns = case["columns"]
    command = [program, "import", "csv", source, "--time", columns["time"], "--overwrite", "-o", target]
    command += ["--input", f"{columns['input']}:{columns['input_unit']}", "--position-unit", columns["position_unit"]]
    for column in ("position", "velocity"):
        if columns[column]:
            command += [f"--{column}", columns[column]]
    command += ["--split", purpose]
    return target if subprocess.run(command, capture_output=True).returncode == 0 else None


def recordings_of(program, case, folder):
    """The files of one case as recordings in `folder`, or None where the import refuses one."""
    folder.mkdir(parents=True, exist_ok=True)
    recordings = [
        recording(program, case, source, purpose, folder / f"{purpose}-{index}.mcap")
        for purpose in ("train", "validation")
        for index, source in enumerate(case["files"][purpose])
    ]
    return None if None in recordings else recordings


def answer_of(document):
    """Verdict and names of gap.json; each name with what the data cannot distinguish from it."""
    sets = {own["names"][0]: own["names"] for own in document["indistinguishable"]}
    names = [sets.get(own["name"], [own["name"]]) for own in document["effects"]]
    description = document["description"]
    return {"verdict": document["verdict"], "names": names, "description": description and description["equation"]}


def by_gap(program, case, out):
    """The answer of `klasktron gap` to one case."""
    folder = out / case["name"]
    recordings = recordings_of(program, case, folder)
    if recordings is None:
        return {"verdict": "refused", "names": []}
    split = {"train": recordings, "validation": []}
    return answer_of(check_axes.compared(program, split, [], folder / "gap"))


# ---------------------------------------------------------------- the regression of the others


def series(path, columns):
    """Time, input and position of one file at equal steps; a velocity is integrated."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    read = lambda name: np.array([float(row[name] or "nan") for row in rows])
    time, value = read(columns["time"]), read(columns["input"])
    position = read(columns["position"] or columns["velocity"])
    fine = np.isfinite(time + value + position)
    time, value, position = time[fine], value[fine], position[fine]
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    value, position = np.interp(even, time, value), np.interp(even, time, position)
    if not columns["position"]:
        position = np.cumsum(position) * step
    return even - even[0], value, position, step


def motion(path, columns):
    """Filtered input, position, velocity, acceleration, jerk and time, decimated, without rests."""
    time, value, position, step = series(path, columns)
    low_pass = butter(4, 0.1, output="sos")
    smooth = lambda own: sosfiltfilt(low_pass, own) if len(own) > 40 else own
    slope = lambda own: np.gradient(own, step)
    x = smooth(position)
    v = slope(x)
    a = slope(v)
    rows = np.column_stack([smooth(value), x, v, smooth(a), smooth(slope(a)), time])[50:-50:10]
    return rows[np.abs(rows[:, 2]) > 0.03 * np.std(v)]


def periods(x, rest):
    """Two periods along the position that explain most of a residual."""
    span = np.ptp(x)
    candidates = span / np.geomspace(2.0, 200.0, 400)
    energy = [abs(np.sum(rest * np.exp(1j * math.tau * x / own))) for own in candidates]
    order = np.argsort(energy)[::-1]
    first = candidates[order[0]]
    other = next((candidates[k] for k in order if abs(math.log(candidates[k] / first)) > 0.2), first / 2)
    return [first, other]


class Regression:
    """Terms of training and validation rows, each with unit RMS on the training rows."""

    def __init__(self, case):
        self.train = np.vstack([motion(own, case["columns"]) for own in case["files"]["train"]])
        held = case["files"]["validation"]
        third = len(self.train) * 2 // 3
        self.held = np.vstack([motion(own, case["columns"]) for own in held]) if held else self.train[third:]
        if not held:
            self.train = self.train[:third]
        self.scale = {name: np.std(self.train[:, k]) or 1.0 for k, name in enumerate("uxvajt")}
        self.middle = 0.5 * (self.train[:, 1].max() + self.train[:, 1].min())
        self.periods = None
        base = self.columns(self.train, [])
        weights = np.linalg.lstsq(base, self.train[:, 0], rcond=None)[0]
        self.periods = periods(self.train[:, 1], self.train[:, 0] - base @ weights)

    def columns(self, rows, names):
        """Columns of the base and of the terms called `names`."""
        u, x, v, a, jerk, time = rows.T
        x = (x - self.middle) / self.scale["x"]
        s, v, a = np.sign(v), v / self.scale["v"], a / self.scale["a"]
        wave = lambda index: [f(math.tau * rows[:, 1] / self.periods[index]) for f in (np.sin, np.cos)]
        every = {
            "quadratic": lambda: [v * np.abs(v)],
            "asymmetric": lambda: [np.abs(v)],
            "stribeck": lambda: [s * np.exp(-((v / own) ** 2)) for own in (0.1, 0.3)],
            "load": lambda: [s * np.abs(a)],
            "load_by_direction": lambda: [np.abs(a)],
            "position_friction": lambda: [x * s],
            "stiffness": lambda: [x],
            "mass_position": lambda: [x * a],
            "jerk": lambda: [jerk / self.scale["j"]],
            "thermal": lambda: [s * time / self.scale["t"]],
            "wave_1": lambda: wave(0),
            "wave_2": lambda: wave(1),
        }
        return np.column_stack([a, v, s, np.ones_like(v), *(own for name in names for own in every[name]())])

    def error(self, names):
        """RMS on the validation rows of a fit to the training rows."""
        weights = np.linalg.lstsq(self.columns(self.train, names), self.train[:, 0], rcond=None)[0]
        return float(np.std(self.held[:, 0] - self.columns(self.held, names) @ weights))

    def bic(self, names):
        """Bayesian information criterion on the training rows."""
        columns = self.columns(self.train, names)
        weights = np.linalg.lstsq(columns, self.train[:, 0], rcond=None)[0]
        count = len(columns)
        return count * math.log(np.mean((self.train[:, 0] - columns @ weights) ** 2)) + columns.shape[1] * math.log(count)


def by_validation_error(regression):
    """Terms of the friction model of BAM with the lowest validation error."""
    return min(BAM.values(), key=regression.error)


def by_bic(regression):
    """Forward selection over all terms."""
    chosen = []
    while True:
        rest = [name for name in TERMS if name not in chosen]
        best = min(rest, key=lambda name: regression.bic([*chosen, name]), default=None)
        if best is None or regression.bic(chosen) <= regression.bic([*chosen, best]):
            return chosen
        chosen.append(best)


def by_stlsq(regression):
    """Sequentially thresholded least squares over all terms, the threshold by the lowest validation error."""
    names = list(TERMS)
    widths = [regression.columns(regression.train[:2], [name]).shape[1] - BASE for name in names]
    owner = ["base"] * BASE + [name for name, width in zip(names, widths) for _ in range(width)]
    columns = regression.columns(regression.train, names)
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0] = 1.0
    target = regression.scale["u"]
    best = None
    for threshold in THRESHOLDS:
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-6)
        optimizer.fit(columns / scale, (regression.train[:, 0] / target)[:, None])
        weights = optimizer.coef_[0] / scale * target
        error = np.std(regression.held[:, 0] - regression.columns(regression.held, names) @ weights)
        if best is None or error < best[0]:
            best = (error, weights)
    kept = {own for own, weight in zip(owner, best[1]) if weight != 0.0}
    return [name for name in names if name in kept]


# ---------------------------------------------------------------- counting


def judged(case, names):
    """Which wanted groups are among `names` (lists of equivalent effects), and which names are false."""
    groups = case["wanted"]
    found = sum(any(set(group) & set(own) for own in names) for group in groups)
    wrong = sorted({own[0] for own in names if all(case["is_wrong"](one) for one in own)})
    return {"wanted": len(groups), "found": found, "names": [own[0] for own in names], "wrong": wrong}


def answers(program, case, out):
    """The answer of every peer to one case."""
    found = by_gap(program, case, out)
    rows = {PEERS[0]: judged(case, found["names"]) | {"verdict": found["verdict"],
                                                      "description": found.get("description")}}
    try:
        regression = Regression(case)
        chosen = [by_validation_error(regression), by_bic(regression), by_stlsq(regression)]
    except (ValueError, np.linalg.LinAlgError) as error:
        return rows | {peer: judged(case, []) | {"error": str(error)} for peer in PEERS[1:]}
    for peer, terms in zip(PEERS[1:], chosen):
        rows[peer] = judged(case, [TERMS[name] for name in terms])
    return rows


def table(rows, group):
    """One line per peer: effects found, cases with a false name, false names, and nulls with a name."""
    own = [row for row in rows if row["group"] == group]
    lines = [f"| {group}: {len(own)} cases | effects found | exact | cases with a false name | false names |",
             "|---|---|---|---|---|"]
    for peer in PEERS:
        all_of = [row["answers"][peer] for row in own]
        wanted, found = sum(one["wanted"] for one in all_of), sum(one["found"] for one in all_of)
        exact = sum(one["found"] == one["wanted"] and not one["wrong"] for one in all_of)
        false = sum(bool(one["wrong"]) for one in all_of)
        count = sum(len(one["wrong"]) for one in all_of)
        lines.append(f"| {peer} | {found} of {wanted} | {exact} of {len(own)} | {false} of {len(own)} | {count} |")
    return "\n".join(lines)


def main():
    """Runs all cases and prints a table for each group."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("out", type=Path)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--case", action="append")
    parser.add_argument("--cases", choices=["synthetic", "real"])
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    cases = [] if args.cases == "real" else [synthetic(args.out / "synthetic")]
    if args.real and (args.real / "truth.json").exists():
        cases += [] if args.cases == "synthetic" else [real(args.real)]
    else:
        print("skipped: real cases, since --real names no folder with truth.json")
    rows = []
    for case in itertools.chain(*cases):
        if args.case and not any(fnmatch.fnmatch(case["name"], own) for own in args.case):
            continue
        own = answers(args.program, case, args.out / case["group"])
        rows.append({"case": case["name"], "group": case["group"], "answers": own})
        print(case["name"], flush=True)
        for peer, one in own.items():
            print(f"    {peer:<40}{one['found']} of {one['wanted']}, false: {', '.join(one['wrong']) or 'none'}"
                  f" {one.get('verdict', '')} {one.get('description') or ''}", flush=True)
    (args.out / "peers.json").write_text(json.dumps(rows, indent=1) + "\n")
    for group in sorted({row["group"] for row in rows}, reverse=True):
        print(f"\n{table(rows, group)}")


if __name__ == "__main__":
    sys.exit(main())
