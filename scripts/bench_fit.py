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
# A run of 760 samples has 750 windows of ten samples of history and one to predict.
COMMANDS_PER_RUN = 760
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
    """One `klasktron fit-actuator`; what it cost and its result document."""
    out = Path(tempfile.mkdtemp(dir=folder))
    command = [options.binary, "fit-actuator", *recordings, "--out", out, *extra]
    measured = bench_tools.run_measured([str(part) for part in command])
    return measured, out


def one_step_error(options, recordings, folder):
    """Held-out one-step error of a short fit (m/s); also checks the number of samples."""
    command = [options.binary, "fit-actuator", *recordings, "--out", folder / "check"]
    command += ["--seeds", "1", "--threads", "1", "--epochs", str(EPOCHS[0]), "--json"]
    done = subprocess.run(
        [str(part) for part in command], check=True, stdout=subprocess.PIPE, text=True
    )
    return json.loads(done.stdout)["one_step_rmse_m_per_s"]["median"]


def time_ours(options, recordings, folder):
    """Milliseconds per epoch by batch: medians of repetitions taken in turn."""
    times = {(batch, epochs): [] for batch in BATCHES for epochs in EPOCHS}
    for _ in range(options.repetitions):
        for batch, epochs in times:
            extra = ["--seeds", "1", "--threads", "1"]
            extra += ["--batch", str(batch), "--epochs", str(epochs)]
            measured, _ = fit(options, recordings, folder, extra)
            times[batch, epochs].append(measured.seconds)
    few, many = EPOCHS
    median = {key: statistics.median(values) for key, values in times.items()}
    return {
        batch: 1e3 * (median[batch, many] - median[batch, few]) / (many - few)
        for batch in BATCHES
    }


def time_torch(repetitions):
    """Milliseconds per epoch by batch, or None without torch."""
    try:
        import torch
    except ImportError:
        return None
    torch.set_num_threads(1)
    torch.manual_seed(0)
    x = torch.randn(SAMPLES, SIZES[0])
    y = torch.randn(SAMPLES, SIZES[-1])
    times = {batch: [] for batch in BATCHES}
    for _ in range(repetitions):
        for batch in BATCHES:
            times[batch].append(torch_epoch(torch, x, y, batch))
    return {batch: 1e3 * statistics.median(values) for batch, values in times.items()}


def torch_epoch(torch, x, y, batch):
    """Seconds per epoch of plain PyTorch; one epoch warms up."""
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
    subprocess.run(
        ["cargo", "bench", "--bench", "kernels", "--", "faer_product"],
        cwd=bench_tools.ROOT,
        check=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
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
        measured, _ = fit(options, recordings, folder, extra)
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
        error = one_step_error(options, recordings, folder)
        print(f"held-out one-step error after {EPOCHS[0]} epochs: {1e3 * error:.2f} mm/s")
        if not error <= LARGEST_ONE_STEP_ERROR:
            sys.exit(f"that is above {1e3 * LARGEST_ONE_STEP_ERROR} mm/s: the times would mean nothing")
        before = bench_tools.machine()
        ours = time_ours(options, recordings, folder)
        torch = time_torch(options.repetitions)
        if torch is None:
            print("PyTorch skipped: torch cannot be imported")
        rows = compare(ours, torch, faer_rate())
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
