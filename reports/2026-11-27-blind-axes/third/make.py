"""Writes the recordings of all cases of the module MODULE: data/ID-1.csv and data/ID-2.csv, with ./sim.

    gcc -O2 -o sim sim.c -lm
    for module in cases cases2 cases3 cases4; do python3 make.py $module; done

The first three sets begin with a kick: their reference has a velocity from the first sample on.
"""

import importlib
import subprocess
import sys
import zlib
from pathlib import Path

[name] = sys.argv[1:]
Path("data").mkdir(exist_ok=True)
module = importlib.import_module(name)
for case in module.C:
    words = f"{module.AX[case['axis']]['p']} {case['mod']} {case['course']}".split()
    values = dict(word.split("=") for word in words)
    values["kick"] = int(name != "cases4")
    for session in (1, 2):
        values["seed"] = zlib.crc32(f"{case['id']}{session}".encode()) % 100000 + 1
        with open(f"data/{case['id']}-{session}.csv", "w") as table:
            arguments = [f"{key}={value}" for key, value in values.items()]
            subprocess.run(["./sim", *arguments], stdout=table, stderr=subprocess.DEVNULL, check=True)
