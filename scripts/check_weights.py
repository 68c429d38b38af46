#!/usr/bin/env python3
"""Compare exported networks with the outputs that klasktron computed itself.

Usage: check_weights.py DIR [--inputs NAME] [--outputs NAME] [--tolerance NUMBER]

DIR holds model.onnx, model.safetensors, optionally model.pt (TorchScript), and two
float32 arrays: history.npy, the inputs [N, inputs], and velocity.npy, klasktron's
outputs [N, 2], or others named by --inputs and --outputs. Each file is run by its own
software (onnxruntime after onnx's full check, plain numpy in double precision, torch)
and the largest difference is printed, absolute up to 1 and relative above. The exit
code is 1 when one of them is above the tolerance (1e-5), and 2 on wrong usage.
onnxruntime and safetensors are required; onnx and torch are used when installed.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import onnxruntime
from safetensors import safe_open

TOLERANCE = 1e-5


def run_onnx(path, history):
    """Outputs of onnxruntime, after onnx's own checks where onnx is installed."""
    try:
        import onnx
    except ImportError:
        print("onnx is not installed: model.onnx runs without its full check")
    else:
        onnx.checker.check_model(onnx.load(path), full_check=True)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (source,), (sink,) = session.get_inputs(), session.get_outputs()
    return session.run([sink.name], {source.name: history})[0]


def run_safetensors(path, history):
    """Outputs of a plain forward pass in double precision over the stored tensors."""
    with safe_open(path, framework="numpy") as file:
        activation = file.metadata()["activation"]
        tensors = {name: file.get_tensor(name) for name in file.keys()}
    n_hidden = sum(name.startswith("fc") for name in tensors) // 2 - 1
    names = [f"fc{i + 1}" for i in range(n_hidden)] + ["fc_out"]
    value = history.astype(np.float64)
    if "standardize.mean" in tensors:
        limit = tensors["standardize.limit"][0]
        value = (value - tensors["standardize.mean"]) * tensors["standardize.scale"]
        value = np.clip(value, -limit, limit)
    for name in names:
        z = value @ tensors[f"{name}.weight"].T + tensors[f"{name}.bias"]
        value = z if name == "fc_out" else activate(activation, z)
    return value


def activate(name, z):
    """The activation called `name` in klasktron's metadata."""
    if name == "relu":
        return np.maximum(z, 0.0)
    if name == "softsign":
        return z / (1.0 + np.abs(z))
    if name == "elu":
        return np.where(z > 0.0, z, np.expm1(np.minimum(z, 0.0)))
    if name == "tanh":
        return np.tanh(z)
    raise ValueError(f"unknown activation {name!r}, expected relu, softsign, elu or tanh")


def run_torchscript(path, history):
    """Outputs of the loaded TorchScript module, or None without torch."""
    try:
        import torch
    except ImportError:
        return None
    module = torch.jit.load(path, map_location="cpu").eval()
    with torch.inference_mode():
        return module(torch.from_numpy(history)).numpy()


def compare(path, run, history, velocity, tolerance):
    """Print the largest difference for one file; return whether it is acceptable."""
    found = run(str(path), history)
    if found is None:
        print(f"{path.name}: skipped, torch cannot be imported")
        return True
    if found.shape != velocity.shape:
        print(f"{path.name}: output shape {found.shape}, expected {velocity.shape}")
        return False
    # Relative where outputs are above 1: single precision has a fixed number of digits.
    scale = np.maximum(1.0, np.abs(velocity.astype(np.float64)))
    difference = (np.abs(found.astype(np.float64) - velocity) / scale).max()
    # Written so that a difference that is not a number fails as well.
    accepted = bool(difference <= tolerance)
    print(f"{path.name}: largest difference {difference:.2e} {'ok' if accepted else 'TOO LARGE'}")
    return accepted


def parse_arguments():
    """What was typed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("directory", type=Path)
    parser.add_argument("--inputs", default="history.npy")
    parser.add_argument("--outputs", default="velocity.npy")
    parser.add_argument("--tolerance", type=float, default=TOLERANCE)
    return parser.parse_args()


def main():
    """Compare every file in the directory and return the exit code."""
    options = parse_arguments()
    directory = options.directory
    inputs = np.load(directory / options.inputs)
    outputs = np.load(directory / options.outputs)
    checks = {"model.onnx": run_onnx, "model.safetensors": run_safetensors}
    if (directory / "model.pt").exists():
        checks["model.pt"] = run_torchscript
    accepted = [
        compare(directory / name, run, inputs, outputs, options.tolerance)
        for name, run in checks.items()
    ]
    return 0 if all(accepted) else 1


if __name__ == "__main__":
    sys.exit(main())
