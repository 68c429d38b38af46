#!/usr/bin/env python3
"""Runs `klasktron gap` on CSV recordings of single axes with known answers and prints what was found.

    scripts/check_axes.py PROGRAM DATA_DIR OUT_DIR [--case NAME]... [--scale INPUT,POSITION,TIME]...

DATA_DIR holds truth.json, a list of cases: name, files (train, validation, baseline), columns, verdict_any_of,
must_name_any_of, must_not_name, parameters and confidence. Each --scale repeats every case with the columns
multiplied by these factors, which must not change verdict or names. OUT_DIR receives the recordings, each result
and axes.json.
"""

import argparse
import csv
import fnmatch
import json
import subprocess
import sys
import time
from pathlib import Path


def scaled_copy(source, target, columns, scale):
    """CSV file with input, position (or velocity) and time multiplied by the factors of scale."""
    by_input, by_position, by_time = scale
    factor = {
        columns["input"]: by_input,
        columns["position"]: by_position,
        columns["velocity"]: by_position / by_time,
        columns["time"]: by_time,
    }
    with open(source, newline="") as file:
        rows = list(csv.reader(file))
    names = rows[0]
    with open(target, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in rows[1:]:
            values = [repr(float(value) * factor.get(name, 1.0)) for name, value in zip(names, row)]
            writer.writerow(values)


def imported(program, data, folder, case, scale):
    """Recordings of each purpose, or the error of the import."""
    columns = case["columns"]
    recordings = {}
    for purpose in ("baseline", "train", "validation"):
        recordings[purpose] = []
        for number, name in enumerate(case["files"].get(purpose, [])):
            source = data / name
            if scale != (1.0, 1.0, 1.0):
                source = folder / f"{purpose}-{number}.csv"
                scaled_copy(data / name, source, columns, scale)
            target = folder / f"{purpose}-{number}.mcap"
            command = [program, "import", "csv", source, "--time", columns["time"]]
            command += ["--input", f"{columns['input']}:{columns['input_unit']}"]
            for column in ("position", "velocity"):
                if columns[column]:
                    command += [f"--{column}", columns[column]]
            command += ["--position-unit", columns["position_unit"], "--overwrite", "-o", target]
            command += ["--split", "validation" if purpose == "validation" else "train"]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                return done.stderr.strip()
            recordings[purpose].append(target)
    return recordings


def refused(summary):
    """The document of a case that the program refuses."""
    empty = {key: [] for key in ("effects", "indistinguishable", "parameter_changes", "residuals")}
    return {"verdict": "refused", **empty, "description": None, "summary": summary}


def twin_options(program, recordings, folder):
    """The option that begins with the twin of the baseline, where there is one."""
    if not recordings["baseline"]:
        return []
    base = [program, "gap", *recordings["baseline"], "-o", folder / "base", "--overwrite"]
    subprocess.run(base, capture_output=True, text=True)
    return ["--twin", folder / "base" / "twin.json"]


def compared(program, recordings, options, folder):
    """gap.json of `recordings` with the written twin, or a verdict 'refused' with the program's sentence."""
    command = [program, "gap", *recordings["train"], *recordings["validation"], *options]
    done = subprocess.run([*command, "-o", folder, "--overwrite"], capture_output=True, text=True)
    if done.returncode not in (0, 3):
        return refused(done.stderr.strip())
    document = json.loads((folder / "gap.json").read_text())
    written = folder / "twin.json"
    document["twin"] = json.loads(written.read_text()) if written.exists() else None
    return document


def found_in(program, data, out, case, scale):
    """The document of one case: gap.json, or a verdict 'refused' with the program's sentence."""
    folder = out / f"{case['name']}@{','.join(f'{own:g}' for own in scale)}"
    folder.mkdir(parents=True, exist_ok=True)
    recordings = imported(program, data, folder, case, scale)
    if isinstance(recordings, str):
        return refused(recordings)
    return compared(program, recordings, twin_options(program, recordings, folder), folder / "out")


def values(document):
    """Parameters of the final twin by dotted name."""
    twin = document.get("twin") or {"effects": []}
    return {
        f"{effect['name']}.{parameter['name']}": parameter["value"]
        for effect in twin["effects"]
        for parameter in effect["parameters"]
    }


def errors_of(case, document):
    """What of the answer is wrong, as short texts."""
    errors = []
    named = [effect["name"] for effect in document["effects"]]
    sets = [own["names"] for own in document.get("indistinguishable", [])]
    either = named + [name for own in sets for name in own]
    verdict = document["verdict"]
    if verdict not in case["verdict_any_of"]:
        errors.append(f"verdict {verdict}, right are {', '.join(case['verdict_any_of'])}")
    if verdict in ("named", "ambiguous"):
        for wanted in case.get("must_name_any_of", []):
            if not set(wanted) & set(either):
                errors.append(f"none of {', '.join(wanted)} is named")
    for pattern in case.get("must_not_name", []):
        errors += [f"wrong name {name}" for name in named if fnmatch.fnmatch(name, pattern)]
    if verdict in ("named", "ambiguous", "refit_only", "none"):
        own = values(document)
        for name, truth in case.get("parameters", {}).items():
            condition = truth.get("only_if_named", False)
            effect = name.rsplit(".", 1)[0]
            wanted = condition if isinstance(condition, list) else [effect]
            if condition and not any(fnmatch.fnmatch(other, one) for other in named for one in wanted):
                continue
            right = [truth["value"], *truth.get("or_values", [])]
            near = lambda value: any(
                abs(value - one) <= truth["tolerance_fraction"] * abs(one) for one in right
            )
            got = [value for key, value in own.items() if fnmatch.fnmatch(key, name)]
            for other in truth.get("or_instead", []):
                factor, key = other.split(" * ") if " * " in other else ("1", other)
                got += [float(factor) * own[key]] if key in own else []
            if not any(near(value) for value in got):
                errors.append(f"{name} is {', '.join(f'{v:.4g}' for v in got) or 'absent'}, not {truth['value']}")
    return errors


def main():
    """Runs all cases and prints one line each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("program")
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--case", action="append")
    parser.add_argument("--scale", action="append", default=[])
    args = parser.parse_args()
    cases = json.loads((args.data / "truth.json").read_text())
    scales = [(1.0, 1.0, 1.0), *(tuple(map(float, own.split(","))) for own in args.scale)]
    rows = []
    for case in cases:
        if args.case and not any(fnmatch.fnmatch(case["name"], own) for own in args.case):
            continue
        plain = None
        for scale in scales:
            began = time.monotonic()
            document = found_in(args.program, args.data, args.out, case, scale)
            seconds = time.monotonic() - began
            answer = (document["verdict"], [effect["name"] for effect in document["effects"]])
            if plain is None:
                plain = answer
                errors = errors_of(case, document)
            else:
                errors = [] if answer == plain else [f"changed by the units {scale}: {answer}"]
            rows.append({"case": case["name"], "scale": scale, "confidence": case["confidence"],
                         "verdict": answer[0], "named": answer[1], "errors": errors,
                         "seconds": round(seconds, 1), "summary": document["summary"]})
            print(f"{'wrong' if errors else 'right':<6}{case['name']:<46}{seconds:5.1f} s  {case['confidence']:<7}"
                  f"{answer[0]} {answer[1]} {'; '.join(errors)}", flush=True)
    right = sum(not row["errors"] for row in rows)
    print(f"{right} of {len(rows)} right")
    (args.out / "axes.json").write_text(json.dumps(rows, indent=1) + "\n")
    return 0 if right == len(rows) else 3


if __name__ == "__main__":
    sys.exit(main())
