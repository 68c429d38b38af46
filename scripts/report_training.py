#!/usr/bin/env python3
"""Evaluation and learning curves of several policies: report_training.py OUT POLICY.mcap...

Writes OUT/evaluation.json (games against each scripted player, out of the summaries in the files) and
OUT/curves.png. Needs mcap, mcap-protobuf-support and matplotlib from PyPI."""

import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

CURVES = [
    ("score against the pool", lambda d: (d.won - d.lost) / d.games if d.games else None),
    ("length of an episode (s)", lambda d: d.mean_episode_s),
    ("hits per minute", lambda d: d.hits_per_minute),
    ("entropy (nat)", lambda d: d.entropy),
]
OPPONENTS = ["random", "stationary", "goalkeeper", "chaser", "shooter"]


def read(path):
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        found = {one.name: one.data for one in reader.iter_attachments()}
        messages = reader.iter_decoded_messages(topics=["/train/update"])
        return json.loads(found["summary.json"]), [message for *_, message in messages]


def evaluation(summary):
    row = {"seed": summary["settings"]["seed"], "transitions": summary["transitions"]}
    row["entropy_coef"] = summary["settings"]["ppo"]["entropy_coef"]
    row["actuator"] = summary["actuator"]["kind"]
    row["commit"] = summary["provenance"]["git_hash"]
    for judged in summary["evaluation"]["opponents"]:
        sides = [judged["score"]["left"], judged["score"]["right"]]
        count = {key: sum(side[key] for side in sides) for key in ("won", "drawn", "lost")}
        keys = ("win_rate", "win_rate_ci95", "goals_per_min", "conceded_goals_per_min")
        row[judged["opponent"]] = count | {key: judged[key] for key in keys}
    return row


def main():
    out, *policies = map(pathlib.Path, sys.argv[1:])
    out.mkdir(parents=True, exist_ok=True)
    runs = [read(path) for path in policies]
    rows = [evaluation(summary) for summary, _ in runs]
    (out / "evaluation.json").write_text(json.dumps(rows, indent=1) + "\n")
    figure, axes = plt.subplots(2, 2, figsize=(10, 6), constrained_layout=True)
    for axis, (title, value) in zip(axes.flat, CURVES):
        for summary, updates in runs:
            points = [(d.transitions / 1e6, value(d)) for d in updates]
            points = [(x, y) for x, y in points if y is not None]
            axis.plot(*zip(*points), lw=0.8, label=f"seed {summary['settings']['seed']}")
        axis.set(title=title, xlabel="transitions (million)")
        axis.grid(alpha=0.3)
    axes.flat[0].legend()
    figure.savefig(out / "curves.png", dpi=90)
    for row in rows:
        shares = (f"{name} {100 * row[name]['win_rate']:.1f} %" for name in OPPONENTS)
        print(f"seed {row['seed']}:", ", ".join(shares))


if __name__ == "__main__":
    main()
