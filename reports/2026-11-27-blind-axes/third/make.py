"""Writes the recordings of all cases of the module MODULE: data/ID-1.csv and data/ID-2.csv, with SIMULATOR.

    gcc -O2 -o sim sim.c -lm && gcc -O2 -o sim4 sim4.c -lm
    for module in cases cases2 cases3; do python3 make.py $module ./sim; done
    python3 make.py cases4 ./sim4
"""

import importlib
import subprocess
import sys
import zlib
from pathlib import Path

name, simulator = sys.argv[1:]
Path("data").mkdir(exist_ok=True)
module = importlib.import_module(name)
for case in module.C:
    words = f"{module.AX[case['axis']]['p']} {case['mod']} {case['course']}".split()
    values = dict(word.split("=") for word in words)
    for session in (1, 2):
        values["seed"] = zlib.crc32(f"{case['id']}{session}".encode()) % 100000 + 1
        with open(f"data/{case['id']}-{session}.csv", "w") as table:
            arguments = [f"{key}={value}" for key, value in values.items()]
            subprocess.run([simulator, *arguments], stdout=table, stderr=subprocess.DEVNULL, check=True)
