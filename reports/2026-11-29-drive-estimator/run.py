#!/usr/bin/env python3
"""What `gap` identifies in the two recordings of the demo, made with several seeds of the virtual table.

    python3 run.py PROGRAM OUT [--no-torques] [--seed N]...

Records both sessions as `klasktron demo` does, with the hidden effects of its rig, and runs `gap` on them. Prints the added
effects, masses and loop parameters of each seed, and writes them to OUT/results.json.
"""

import argparse
import json
import subprocess
from pathlib import Path

PATTERNS = ("circle", "x_line", "y_line", "ramp", "random_walk", "chirp", "step_ladder", "creep")
HIDDEN = {"drive": {"command_delay_s": 0.02, "slew_turns_per_s2": 160.0}, "peg": {"left": {"friction_n": 0.6}, "right": {"friction_n": 0.6}}}


def record(program, folder, name, seed, torques):
    """One session of the demo."""
    rig = json.loads(json.dumps(HIDDEN)) | {"seed": seed}
    if torques:
        rig["drive"]["cyclic_ms"] = {"torques": 10}
    (folder / f"{name}.json").write_text(json.dumps(rig))
    patterns = [option for pattern in PATTERNS for option in ("--pattern", pattern)]
    command = [program, "collect", "--speed", "max", "--rig", folder / f"{name}.json", *patterns, "--seconds", "6"]
    command += ["--validation-every", "0", "--seed", str(seed), "--output", folder / f"{name}.mcap", "--overwrite", "--quiet"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def identified(program, folder):
    """Added effects and parameters of the final twin."""
    recordings = [folder / "monday.mcap", folder / "tuesday.mcap"]
    command = [program, "gap", *recordings, "--output", folder / "gap", "--overwrite", "--quiet"]
    done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    if done.returncode not in (0, 3):
        raise SystemExit(f"gap ended with status {done.returncode} in {folder}")
    found = json.loads((folder / "gap" / "gap.json").read_text())
    twin = json.loads((folder / "gap" / "twin.json").read_text())
    of = lambda name: [own for own in twin["effects"] if own["name"] == name]
    values = lambda own: {one["name"]: one["value"] for one in own["parameters"]}
    return {
        "effects": [{"name": own["name"], "location": own["location"]} | values(own) for own in found["effects"]],
        "mass_kg": {own["location"]: values(own)["mass_kg"] for own in of("gantry.inertia")},
        "velocity_loop": values(of("drive.velocity_loop")[0]),
        "warnings": found["warnings"],
    }


def main():
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program")
    parser.add_argument("out", type=Path)
    parser.add_argument("--no-torques", action="store_true", help="the drives do not report their torques")
    parser.add_argument("--seed", type=int, action="append", required=True)
    args = parser.parse_args()
    results = {}
    for seed in args.seed:
        folder = args.out / str(seed)
        folder.mkdir(parents=True, exist_ok=True)
        for name, own in (("monday", seed), ("tuesday", seed + 1)):
            record(args.program, folder, name, own, not args.no_torques)
        results[seed] = found = identified(args.program, folder)
        effects = ", ".join(f"{own['name']} on {own['location']}" for own in found["effects"])
        masses = {axis: round(mass, 1) for axis, mass in found["mass_kg"].items()}
        print(f"{seed}: {effects}; masses {masses} kg", flush=True)
        (args.out / "results.json").write_text(json.dumps(results, indent=1) + "\n")


if __name__ == "__main__":
    main()
