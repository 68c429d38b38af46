#!/usr/bin/env python3
"""Ablation of the decision thresholds of `klasktron gap`: each rule switched off, or its value halved and doubled.

    scripts/ablate_gap.py PROGRAM OUT [--real DIR] [--practice DIR] [--only SETTING]... [--group NAME]... [--case NAME]...
                          [--minutes LIMIT]

A setting is one or more assignments of `gap --threshold`, such as `min_gain=0`. Cases come from the other scripts:
`synthetic` are the axes of scripts/compare_peers.py, `real` those of DIR as scripts/check_axes.py reads them, `practice`
the pairs of DIR as scripts/check_gap.py reads them. Groups without their DIR are skipped. Cases are run one after the
other. OUT/results.csv has a row per setting and case and is continued, not repeated: a case that it holds is not run again.
OUT/summary.csv compares every setting with the default: exact answers, false and missed names, CPU time, and the exact
McNemar test of the cases that became exact or stopped being so. Needs what scripts/compare_peers.py needs.
"""

import argparse
import csv
import fnmatch
import json
import resource
import sys
import time
from pathlib import Path

import check_axes
import check_gap
import compare_peers
from scipy.stats import binomtest

# Settings per threshold: the rule off where that has a value, then half and twice the value where these differ from it.
SETTINGS = [
    "default",
    "family_error=0.005", "family_error=0.02",
    "confirmation_level=0.5", "confirmation_level=0.0005", "confirmation_level=0.002",
    "min_amplitude=0", "min_amplitude=0.25", "min_amplitude=1",
    "size_ratio=1e9", "size_ratio=1.5", "size_ratio=6",
    "detectability=0", "detectability=2.5", "detectability=10",
    "equal_prediction=0", "equal_prediction=0.00005", "equal_prediction=0.0002",
    "majority=0", "majority=0.25", "majority=1",
    "stronger_ratio=1e9", "stronger_ratio=1", "stronger_ratio=3",
    "single_signal_ratio=1e9", "single_signal_ratio=2", "single_signal_ratio=8",
    "min_gain=0", "min_gain=0.01", "min_gain=0.04",
    "clear_gain=0", "clear_gain=0.05", "clear_gain=0.2",
    "min_gain_map=0", "min_gain_map=0.0025", "min_gain_map=0.01",
    "reference_excess=0", "reference_excess=0.025", "reference_excess=0.1",
    "moved_residual=0", "moved_residual=0.075", "moved_residual=0.3",
    "large_excess=1e9", "large_excess=0.15", "large_excess=0.6",
    "floor_ratio=1", "floor_ratio=3",
    "machine_change=0", "machine_change=0.125", "machine_change=0.5",
    "machine_changes=1e9", "machine_changes=2", "machine_changes=8",
    "model_error=0", "model_error=0.0125", "model_error=0.05",
    "outlier_ratio=1e9", "outlier_ratio=5", "outlier_ratio=20",
    "disturbed_time=1e9", "disturbed_time=0.75", "disturbed_time=3",
    "min_time=0", "min_time=2", "min_time=8",
    "min_samples=0", "min_samples=20", "min_samples=80",
    "min_fraction=0", "min_fraction=0.025", "min_fraction=0.1",
    "clock_drift=1e9", "clock_drift=0.05", "clock_drift=0.2",
]
FIELDS = ["setting", "group", "case", "verdict", "names", "false", "missed", "exact", "cpu_s"]
SUMMARY = ["setting", "group", "cases", "exact", "exact_default", "false", "false_default", "missed", "missed_default",
           "changed", "better", "worse", "mcnemar_p", "changed_ci95_low", "changed_ci95_high", "cpu_s", "cpu_s_default"]


def synthetic(program, args):
    """Cases of scripts/compare_peers.py: name, and the function that answers under options."""
    out = args.out / "synthetic"
    for case in compare_peers.synthetic(out):
        folder = out / case["name"]
        recordings = compare_peers.recordings_of(program, case, folder)

        def answer(options, case=case, folder=folder, recordings=recordings):
            split = {"train": recordings, "validation": []}
            document = check_axes.compared(program, split, options, folder / "gap")
            found = compare_peers.judged(case, compare_peers.answer_of(document)["names"])
            return document["verdict"], found["names"], len(found["wrong"]), found["wanted"] - found["found"]

        yield case["name"], answer


def real(program, args):
    """Cases of scripts/check_axes.py; every error that is no wrong name counts as missed."""
    for case in json.loads((args.real / "truth.json").read_text()):
        folder = args.out / "real" / case["name"]
        folder.mkdir(parents=True, exist_ok=True)
        recordings = check_axes.imported(program, args.real, folder, case, (1.0, 1.0, 1.0))
        if isinstance(recordings, str):
            continue
        twin = check_axes.twin_options(program, recordings, folder)

        def answer(options, case=case, folder=folder, recordings=recordings, twin=twin):
            document = check_axes.compared(program, recordings, [*twin, *options], folder / "out")
            errors = check_axes.errors_of(case, document)
            false = sum(own.startswith("wrong name") for own in errors)
            names = [own["name"] for own in document["effects"]]
            return document["verdict"], names, false, len(errors) - false

        yield case["name"], answer


def practice(program, args):
    """Cases of scripts/check_gap.py; base twins are those of the default."""
    answers = json.loads((args.practice / "answers.json").read_text())
    out = args.out / "practice"
    bases = {}
    for name in ("baseline", "ball-baseline"):
        twin = out / name / "twin.json"
        if name in answers and not twin.exists():
            check_gap.run(program, args.practice, out, name, None)
        if twin.exists():
            bases[name] = {entry["name"] for entry in json.loads(twin.read_text())["effects"]}
    for name, truths in answers.items():
        if name in bases:
            continue
        base = "ball-baseline" if name.startswith("ball") else "baseline"

        def answer(options, name=name, truths=truths, base=base):
            twin = out / base / "twin.json"
            document, _ = check_gap.run(program, args.practice, out, name, twin, options)
            found = check_gap.verdict(document, truths, bases[base])
            names = [own["name"] for own in document["effects"]]
            return document["verdict"], names, len(found["other_names"]), len(found["wanted"]) - len(found["found"])

        yield name, answer


GROUPS = {"synthetic": synthetic, "real": real, "practice": practice}


def cpu_seconds():
    """CPU time of all child processes so far (s)."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def options_of(setting):
    """Options of `gap` for a setting."""
    return [] if setting == "default" else [word for one in setting.split() for word in ("--threshold", one)]


def read_rows(path):
    """Rows of results.csv."""
    if not path.exists():
        return []
    with open(path, newline="") as file:
        return list(csv.DictReader(file))


def run_group(args, group, rows, until):
    """Runs what results.csv lacks of one group, setting by setting, and appends to it."""
    cases = [own for own in GROUPS[group](args.program, args)
             if not args.case or any(fnmatch.fnmatch(own[0], pattern) for pattern in args.case)]
    settings = list(dict.fromkeys(["default", *args.only])) if args.only else SETTINGS
    done = {(row["setting"], row["group"], row["case"]) for row in rows}
    path = args.out / "results.csv"
    is_new = not path.exists()
    with open(path, "a", newline="") as file:
        writer = csv.DictWriter(file, FIELDS)
        if is_new:
            writer.writeheader()
        for setting in settings:
            for name, answer in cases:
                if (setting, group, name) in done:
                    continue
                if until < time.monotonic():
                    return
                began = cpu_seconds()
                verdict, names, false, missed = answer(options_of(setting))
                row = dict(zip(FIELDS, [setting, group, name, verdict, " ".join(names), false, missed,
                                        int(false == 0 and missed == 0), round(cpu_seconds() - began, 2)]))
                writer.writerow(row)
                file.flush()
                rows.append({key: str(value) for key, value in row.items()})
            print(group, setting, flush=True)


def compared(setting, group, rows):
    """One line of the summary: a setting against the default on the cases that both answered."""
    of = lambda which: {row["case"]: row for row in rows if (row["setting"], row["group"]) == (which, group)}
    own, base = of(setting), of("default")
    pairs = [(own[name], base[name]) for name in own if name in base]
    total = lambda key, k: sum(float(pair[k][key]) for pair in pairs)
    changed = sum(any(one[key] != other[key] for key in ("verdict", "names")) for one, other in pairs)
    better = sum(int(one["exact"]) > int(other["exact"]) for one, other in pairs)
    worse = sum(int(one["exact"]) < int(other["exact"]) for one, other in pairs)
    p_value = binomtest(better, better + worse).pvalue if better + worse else 1.0
    interval = binomtest(changed, len(pairs)).proportion_ci()
    counts = [int(total(key, k)) for key in ("exact", "false", "missed") for k in (0, 1)]
    return dict(zip(SUMMARY, [setting, group, len(pairs), *counts, changed, better, worse, round(p_value, 4),
                              round(interval.low, 3), round(interval.high, 3),
                              round(total("cpu_s", 0), 1), round(total("cpu_s", 1), 1)]))


def main():
    """Runs what is missing and writes the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("out", type=Path)
    parser.add_argument("--real", type=Path)
    parser.add_argument("--practice", type=Path)
    parser.add_argument("--only", action="append")
    parser.add_argument("--group", action="append", choices=list(GROUPS))
    parser.add_argument("--case", action="append")
    parser.add_argument("--minutes", type=float, default=1e9)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    rows = read_rows(args.out / "results.csv")
    until = time.monotonic() + 60 * args.minutes
    for group in args.group or GROUPS:
        folder = getattr(args, group, args.out)
        if folder is None or not folder.exists():
            print(f"skipped: {group} cases, since --{group} names no folder")
            continue
        run_group(args, group, rows, until)
    lines = list(dict.fromkeys((row["setting"], row["group"]) for row in rows))
    with open(args.out / "summary.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, SUMMARY)
        writer.writeheader()
        writer.writerows(compared(*own, rows) for own in lines if own[0] != "default")


if __name__ == "__main__":
    sys.exit(main())
