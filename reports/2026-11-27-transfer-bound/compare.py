#!/usr/bin/env python3
"""Difference of the net goals per minute on the rig between the same arm of two folders of scripts/measure_transfer.py.

    python compare.py OUT ARM OTHER_OUT OTHER_ARM
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
import measure_transfer as transfer


def policies(out, arm):
    joined = lambda rows: np.concatenate([rows[name] for name in transfer.OPPONENTS])
    return [[joined(rows[0]), joined(rows[1])] for rows in transfer.finished(Path(out), arm)]


out, arm, other_out, other_arm = sys.argv[1:]
better, worse = policies(out, arm), policies(other_out, other_arm)
own = transfer.difference(better, worse, np.random.default_rng(0))
low, high = own["ci95"]
print(
    f"{out} {arm} ({len(better)}) minus {other_out} {other_arm} ({len(worse)}): "
    f"{own['net_goals_per_min']:.2f} ({low:.2f} to {high:.2f}), p = {own['p_value_welch_over_seeds']:.2g}"
)
