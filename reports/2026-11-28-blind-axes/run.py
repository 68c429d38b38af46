"""Run a program on the cases of a folder and compare the effects it names with those of the simulation.

    python3 run.py PROGRAM CASES OUT

Writes OUT.json: for each case the kind, the truth, the names and the CPU seconds. A name is right if it is the truth or one of
its synonyms, which each case states ("drive.delay/drive.lag1": either).
"""

import json
import resource
import subprocess
import sys
from pathlib import Path


def synonyms(truth, acceptable):
    """For each true effect, the names that count as right."""
    sets = [{"drive." + one if "." not in one else one for one in entry.split(" ")[0].split("/")} for entry in acceptable]
    known = [{"drive.lag1", "drive.delay", "drive.current_loop"}, {"drive.saturation.speed", "drive.saturation.torque_speed"}]
    return {name: {name}.union(*(own for own in sets + known if name in own)) for name in truth}


def main():
    program, cases, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    answers, counts = {}, {}
    for folder in sorted(one for one in cases.iterdir() if (one / "truth.json").exists()):
        case = json.loads((folder / "truth.json").read_text())
        words = json.loads((folder / "import.json").read_text())
        used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        for session in ("s1", "s2"):
            source, recording = folder / f"{session}.csv", folder / f"{session}.mcap"
            subprocess.run([program, "import", "csv", source, *words, "-o", recording, "--overwrite"], check=True, capture_output=True)
        result = folder / "gap"
        recordings = [folder / "s1.mcap", folder / "s2.mcap"]
        subprocess.run([program, "gap", *recordings, "--threads", "1", "-o", result, "--overwrite"], check=False, capture_output=True)
        used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - used
        found = json.loads((result / "gap.json").read_text()) if (result / "gap.json").exists() else {"effects": [], "verdict": "failed"}
        (result / "gap.json").unlink(missing_ok=True)
        names = sorted({one["name"] for one in found["effects"]})
        right = synonyms(case["right"], case["acceptable"])
        wrong = [name for name in names if not any(name in own for own in right.values())]
        missed = [name for name, own in right.items() if not own & set(names)]
        answer = "wrong" if wrong else "missed" if missed else "right"
        kind = case["kind"]
        counts.setdefault(kind, {"right": 0, "missed": 0, "wrong": 0})[answer] += 1
        answers[folder.name] = {"kind": kind, "truth": case["right"], "named": names, "verdict": found["verdict"], "answer": answer, "cpu_s": round(used, 2)}
        print(f"{answer:6s} {folder.name:32s} {found['verdict']:14s} {names}", flush=True)
    counts["cpu_s"] = round(sum(one["cpu_s"] for one in answers.values()), 1)
    out.with_suffix(".json").write_text(json.dumps({"counts": counts, "cases": answers}, indent=1), encoding="utf-8")
    print(json.dumps(counts))


if __name__ == "__main__":
    main()
