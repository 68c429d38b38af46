#!/usr/bin/env python3
"""Overhead of klasktron sweep: scripts/bench_sweep.py PROGRAM [--slurm] [--json FILE]

- local: a sweep of `eval` over a short match with one worker, beside the same commands typed one after the
  other; the difference by point (ms). To reach: 50.
- ten thousand points: planned, listed and, with points that are finished already, merged into table and page.
- with --slurm (SLURM_CONF set, as by scripts/slurm_lab): 10,000 points submitted in arrays, held, so that nothing
  runs; seconds by array. To reach: 1, and at most 10 for listing, submitting and merging together.

Only time on the clock is measured; the finished points of the second part are copies of one result.
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
MATCH = ROOT / "tests/data/example-match.mcap"
POINTS = 10_000


def run(*command, cwd, status=(0,)):
    """Seconds that `command` took, and what it said."""
    start = time.perf_counter()
    done = subprocess.run([str(word) for word in command], cwd=cwd, capture_output=True, text=True)
    elapsed = time.perf_counter() - start
    if done.returncode not in status:
        sys.exit(f"{command}: status {done.returncode}: {done.stderr[-2000:]}")
    return elapsed, done.stdout + done.stderr


def sweep_file(folder, name, seeds):
    path = folder / name
    path.write_text(f'command = "eval"\ninputs = ["match.mcap"]\nseeds = {seeds}\n')
    return path


def overhead_by_point(program, folder, points=40, repeats=3):
    """Milliseconds by point beside the command itself: median of `repeats` pairs, one worker."""
    file = sweep_file(folder, "local.toml", points)
    differences = []
    for repeat in range(repeats):
        out = folder / f"local-{repeat}"
        swept, _ = run(program, "sweep", file, "--workers", 1, "--output", out, cwd=folder)
        typed = 0.0
        for seed in range(points):
            hand = folder / "hand"
            elapsed, _ = run(
                program, "eval", "match.mcap", "--seed", seed, "--output", hand, "--overwrite", "--json", cwd=folder
            )
            typed += elapsed
        differences.append(1e3 * (swept - typed) / points)
    differences.sort()
    return {"points": points, "repeats": repeats, "ms_by_point": differences[repeats // 2],
            "ms_by_point_lowest": differences[0], "ms_by_point_highest": differences[-1]}


def ten_thousand(program, folder, slurm):
    file = sweep_file(folder, "many.toml", POINTS)
    out = folder / "many"
    listed, text = run(program, "sweep", file, "--output", out, "--dry-run", cwd=folder)
    assert f"{POINTS} points, of which 0 are finished" in text, text[-200:]
    result = {"points": POINTS, "listed_s": listed}
    if slurm:
        result |= submitted(program, folder, file, out)
    # The very same command, with everything finished: only reading, table and page are left.
    finish_all(folder, out)
    merged, text = run(program, "sweep", file, "--output", out, cwd=folder)
    assert f"{POINTS} of {POINTS} points are kept" in text, text[-500:]
    rows = (out / "table.csv").read_text().count("\n") - 1
    assert rows == POINTS, rows
    result["merged_s"] = merged
    result["together_s"] = sum(result.get(key, 0.0) for key in ["listed_s", "submitted_s", "merged_s"])
    return result


def submitted(program, folder, file, out):
    """Held arrays of all points; the submitting process is sent away as soon as it has submitted."""
    start = time.perf_counter()
    child = subprocess.Popen(
        [str(program), "sweep", str(file), "--engine", "slurm", "--output", str(out), "--sbatch-line=--hold"],
        cwd=folder, stderr=subprocess.PIPE, text=True,
    )
    arrays, tasks, lines = 0, 0, []
    for line in child.stderr:
        lines.append(line)
        if line.startswith("submitted job"):
            arrays += 1
            tasks += int(line.rsplit(" ", 1)[1])
        if arrays and "waiting" in line:
            break
    elapsed = time.perf_counter() - start
    child.send_signal(2)
    child.stderr.read()
    child.wait()
    if not arrays:
        sys.exit("".join(lines))
    jobs = json.loads((out / "slurm/jobs.json").read_text())
    ids = [array["job"] for one in jobs["submissions"] for array in one["arrays"]]
    subprocess.run(["scancel", *ids], check=True)
    for _ in range(200):
        if not subprocess.run(["squeue", "-h"], capture_output=True, text=True).stdout:
            break
        time.sleep(0.1)
    return {"arrays": arrays, "tasks": tasks, "submitted_s": elapsed, "s_by_array": elapsed / arrays}


def finish_all(folder, out):
    """Gives every point of the plan the result of one: what merging reads is of the usual size."""
    one = folder / "one"
    run(folder / "program", "sweep", sweep_file(folder, "one.toml", 1), "--output", one, cwd=folder)
    made = next(path for path in (one / "points").iterdir() if not path.name.startswith("."))
    record = json.loads((made / "point.json").read_text())
    result = (made / "result.json").read_bytes()
    for line in plan_of(folder):
        point = out / "points" / line["hash"]
        point.mkdir(parents=True, exist_ok=True)
        mine = record | {"hash": line["hash"], "command_line": line["command_line"]}
        (point / "point.json").write_text(json.dumps(mine))
        (point / "result.json").write_bytes(result)


def plan_of(folder):
    """Hashes of all points, from a list that the Slurm engine writes: a Slurm that takes everything is played."""
    fake = folder / "fake"
    fake.mkdir()
    texts = {
        "sbatch": "echo 1",
        "squeue": "echo 'slurm_load_jobs error: Invalid job id specified' >&2; exit 1",
        "scontrol": f"echo 'MaxArraySize = {POINTS + 1}'; echo 'MaxJobCount = {10 * POINTS}'",
    }
    for name, text in texts.items():
        (fake / name).write_text(f"#!/bin/sh\n{text}\n")
        (fake / name).chmod(0o755)
    listed = folder / "listed"
    subprocess.run(
        [str(folder / "program"), "sweep", "many.toml", "--engine", "slurm", "--output", str(listed)],
        cwd=folder, capture_output=True, env={"PATH": f"{fake}:/usr/bin:/bin"}, timeout=300,
    )
    text = (listed / "slurm/points-001.jsonl").read_text()
    return [json.loads(line) for line in text.splitlines()]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("program", type=pathlib.Path)
    parser.add_argument("--slurm", action="store_true")
    parser.add_argument("--json", type=pathlib.Path)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        shutil.copy(MATCH, folder / "match.mcap")
        program = folder / "program"
        shutil.copy(args.program, program)
        figures = {
            "local": overhead_by_point(program, folder),
            "ten_thousand": ten_thousand(program, folder, args.slurm),
        }
    print(json.dumps(figures, indent=2))
    if args.json:
        args.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
