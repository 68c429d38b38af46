#!/usr/bin/env python3
"""Time the actuator fit beside PyTorch and beside faer's matrix product, in one run.

Usage: bench_fit.py [--full] [--out FILE]

All on one thread, with a 40-64-64-64-2 network and 37,500 training samples:
  klasktron  the real command, `klasktron fit-actuator --seeds 1 --threads 1`, with two
             numbers of epochs; the difference in time over the difference in epochs
  PyTorch    eager, tensors in memory, permuted indices, Adam; skipped without torch
  faer       rate of a (batch x 64) (64 x 64) product from `cargo bench`
The recording is made here by the simulator of make_example.py. Before anything counts,
the fitted network must predict its held-out runs. --full adds 8 seeds x 1000 epochs
and the whole ablation on all cores, with peak memory.
Needs: cargo build --release; pip install numpy protobuf mcap, and torch where possible
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import bench_tools
import example_rig
import make_example

SAMPLES = 37_500
BATCHES = (256, 1024)
SIZES = (40, 64, 64, 64, 2)
RUNS, HELD_OUT_RUNS = 50, 10
# A run of 760 samples has 750 windows of ten samples of history and one to predict; its
# first command comes before its first encoder reading, so that the grid starts at the second.
SAMPLES_PER_RUN = 760
COMMANDS_PER_RUN = SAMPLES_PER_RUN + 1
# Both draw 100 points of the held-out curve, so that its cost is not in the difference.
EPOCHS = (100, 300)
TORCH_EPOCHS = 5
LARGEST_ONE_STEP_ERROR = 0.005  # m/s, held out
PATTERNS = list(example_rig.PATTERNS) + ["random_walk"]


def flop_per_sample():
    """Operations of one training step for one sample: products of the forward pass, the
    weight gradients and the input gradients of all layers but the first."""
    layers = [2 * inputs * outputs for inputs, outputs in zip(SIZES, SIZES[1:])]
    return 3 * sum(layers) - layers[0]


def make_recordings(folder):
    """Write the recordings to fit; their paths."""
    paths = []
    for split, runs, seed in [("train", RUNS, 21), ("validation", HELD_OUT_RUNS, 22)]:
        patterns = [PATTERNS[run % len(PATTERNS)] for run in range(runs)]
        plan = example_rig.Plan(patterns, COMMANDS_PER_RUN, seed=seed)
        settings = make_example.Settings(
            f"bench-{split}", split, seed, jitter=False, camera=False
        )
        path = folder / f"{split}.mcap"
        make_example.make(path, plan, settings)
        paths.append(path)
    return paths


def fit(options, recordings, folder, extra):
    """One `klasktron fit-actuator` into a fresh folder, and what it cost."""
    out = Path(tempfile.mkdtemp(dir=folder))
    return bench_tools.run_measured(
        [options.binary, "fit-actuator", *recordings, "--output", out, *extra]
    )


def check_fit(options, recordings, folder):
    """Fit shortly; stop unless the samples are as many and the outputs as right as they should
    be. Returns the held-out one-step error (m/s)."""
    command = [options.binary, "fit-actuator", *recordings, "--output", folder / "check"]
    command += ["--seeds", "1", "--threads", "1", "--epochs", str(EPOCHS[0]), "--json"]
    done = subprocess.run(
        [str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True
    )
    result = json.loads(done.stdout)
    samples = result["train"]["samples"]
    if samples != RUNS * SAMPLES_PER_RUN:
        sys.exit(f"{samples} samples on the grid, expected {RUNS * SAMPLES_PER_RUN}")
    error = result["one_step_rmse_m_per_s"]["median"]
    print(f"held-out one-step error after {EPOCHS[0]} epochs: {1e3 * error:.2f} mm/s")
    if not error <= LARGEST_ONE_STEP_ERROR:
        sys.exit(f"above {1e3 * LARGEST_ONE_STEP_ERROR} mm/s: the times would mean nothing")
    return error


def measure(options, recordings, folder):
    """Everything in turn, so that a change in the machine's load meets all of them; medians:
    ms per epoch of ours and of PyTorch (None without torch), GFLOP/s of faer, by batch."""
    torch = import_torch()
    ours = {(batch, epochs): [] for batch in BATCHES for epochs in EPOCHS}
    theirs = {batch: [] for batch in BATCHES}
    faer = {batch: [] for batch in BATCHES}
    for _ in range(options.repetitions):
        for (batch, epochs), seconds in ours.items():
            extra = ["--seeds", "1", "--threads", "1"]
            extra += ["--batch", str(batch), "--epochs", str(epochs)]
            seconds.append(fit(options, recordings, folder, extra).seconds)
        for batch, seconds in theirs.items():
            if torch is not None:
                seconds.append(torch_epoch(torch, batch))
        for batch, rate in faer_rate().items():
            faer[batch].append(rate)
    return (
        {batch: ms_per_epoch(ours, batch) for batch in BATCHES},
        torch and {batch: 1e3 * statistics.median(theirs[batch]) for batch in BATCHES},
        {batch: statistics.median(faer[batch]) for batch in BATCHES},
    )


def ms_per_epoch(seconds, batch):
    """Difference in time over difference in epochs."""
    few, many = EPOCHS
    difference = statistics.median(seconds[batch, many]) - statistics.median(seconds[batch, few])
    return 1e3 * difference / (many - few)


def import_torch():
    """The module torch on one thread, or None."""
    try:
        import torch
    except ImportError:
        print("PyTorch skipped: torch cannot be imported")
        return None
    torch.set_num_threads(1)
    torch.manual_seed(0)
    return torch


def torch_epoch(torch, batch):
    """Seconds per epoch of plain PyTorch; one epoch warms up."""
    x = torch.randn(SAMPLES, SIZES[0])
    y = torch.randn(SAMPLES, SIZES[-1])
    layers = []
    for inputs, outputs in zip(SIZES, SIZES[1:]):
        layers += [torch.nn.Linear(inputs, outputs), torch.nn.ReLU()]
    model = torch.nn.Sequential(*layers[:-1])
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-3)
    loss_of = torch.nn.MSELoss()
    for epoch in range(TORCH_EPOCHS + 1):
        if epoch == 1:
            start = time.perf_counter()
        order = torch.randperm(SAMPLES)
        for first in range(0, SAMPLES, batch):
            chosen = order[first : first + batch]
            optimiser.zero_grad()
            loss_of(model(x[chosen]), y[chosen]).backward()
            optimiser.step()
    return (time.perf_counter() - start) / TORCH_EPOCHS


def faer_rate():
    """GFLOP/s of faer's product by number of rows, measured now by criterion."""
    only = f"faer_product/({'|'.join(str(rows) for rows in BATCHES)})$"
    done = subprocess.run(
        ["cargo", "bench", "--bench", "kernels", "--", only],
        cwd=bench_tools.ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    if done.returncode != 0:
        sys.exit(f"cargo bench failed:\n{done.stderr}")
    rates = {}
    for rows in BATCHES:
        folder = bench_tools.target_dir() / "criterion" / "faer_product" / str(rows) / "new"
        estimates = json.loads((folder / "estimates.json").read_text(encoding="utf-8"))
        nanoseconds = estimates["median"]["point_estimate"]
        rates[rows] = 2 * rows * 64 * 64 / nanoseconds
    return rates


def compare(ours, torch, faer):
    """One row of figures for each batch."""
    rows = []
    for batch in BATCHES:
        rate = flop_per_sample() * SAMPLES / (ours[batch] * 1e6)
        row = {
            "batch": batch,
            "ours_ms_per_epoch": ours[batch],
            "ours_gflop_per_s": rate,
            "faer_gflop_per_s": faer[batch],
            "share_of_faer_percent": 100.0 * rate / faer[batch],
        }
        if torch is not None:
            row["torch_ms_per_epoch"] = torch[batch]
            row["torch_over_ours"] = torch[batch] / ours[batch]
        rows.append(row)
    return rows


def print_rows(rows):
    """The comparison as a table."""
    print("batch   ours ms  PyTorch ms   ratio   ours GFLOP/s  faer GFLOP/s  share")
    for row in rows:
        torch = f"{row['torch_ms_per_epoch']:>10.1f}" if "torch_ms_per_epoch" in row else f"{'-':>10}"
        ratio = f"{row['torch_over_ours']:>6.1f}x" if "torch_over_ours" in row else f"{'-':>7}"
        print(
            f"{row['batch']:>5}  {row['ours_ms_per_epoch']:>8.2f}  {torch} {ratio}"
            f"  {row['ours_gflop_per_s']:>13.1f} {row['faer_gflop_per_s']:>13.1f}"
            f"  {row['share_of_faer_percent']:>4.0f} %"
        )


def time_full(options, recordings, folder):
    """Wall time and peak memory of the two long jobs."""
    figures = {}
    for name, extra in [("seeds_8", []), ("ablation", ["--ablate"])]:
        extra = ["--seeds", "8", "--epochs", "1000", *extra]
        measured = fit(options, recordings, folder, extra)
        figures[name] = {"seconds": measured.seconds, "peak_mb": measured.peak_mb}
        print(f"{name}: {measured.seconds:.1f} s, peak memory {measured.peak_mb:.0f} MB")
    return figures


def parse_arguments():
    """What was typed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--binary", type=Path, default=bench_tools.default_binary())
    parser.add_argument("--repetitions", type=int, default=3, help="of each timing")
    parser.add_argument("--full", action="store_true", help="8 seeds and the ablation as well")
    parser.add_argument("--out", type=Path, help="write the figures here as JSON")
    options = parser.parse_args()
    if not options.binary.exists():
        sys.exit(f"{options.binary} does not exist; run: cargo build --release")
    return options


def main():
    """Check, time, print, write."""
    options = parse_arguments()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recordings = make_recordings(folder)
        error = check_fit(options, recordings, folder)
        before = bench_tools.machine()
        rows = compare(*measure(options, recordings, folder))
        print_rows(rows)
        document = {
            "samples": SAMPLES,
            "machine_before": before,
            "machine_after": bench_tools.machine(),
            "one_step_rmse_m_per_s": error,
            "rows": rows,
        }
        if options.full:
            document["full"] = time_full(options, recordings, folder)
    if options.out is not None:
        options.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
