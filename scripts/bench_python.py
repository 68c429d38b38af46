#!/usr/bin/env python3
"""Time the Python module against other software, in one process and after equality was checked.

Usage: bench_python.py [read] [envs] [simulate] [--minutes 60] [--out FILE]

read      klasktron.read of a recording of 1.5 million messages against PyPI's mcap with protobuf
envs      steps of klasktron.envs per second with random actions, against the same rules in NumPy
simulate  Twin.simulate of a single axis against SciPy's solve_ivp of the same equation
Needs: the wheel of scripts/package_wheel, and pip install mcap protobuf gymnasium scipy
"""

import argparse
import json
import statistics
import sys
import tempfile
import time
from pathlib import Path

import bench_tools
import numpy as np

import klasktron

REPEATS = 5


def timed(function, repeats=REPEATS):
    """Result and fastest and median time (s) of `function`."""
    seconds = []
    for _ in range(repeats):
        begun = time.perf_counter()
        result = function()
        seconds.append(time.perf_counter() - begun)
    return result, min(seconds), statistics.median(seconds)


def read_with_protobuf(path):
    """Columns of every topic, as PyPI's mcap and protobuf give them."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap.reader import make_reader

    classes, columns = {}, {}
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            own = classes.get(schema.id)
            if own is None:
                files = descriptor_pb2.FileDescriptorSet.FromString(schema.data)
                pool = descriptor_pool.DescriptorPool()
                for one in files.file:
                    pool.Add(one)
                own = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
                classes[schema.id] = own
            decoded = own.FromString(message.data)
            topic = columns.setdefault(channel.topic, {"log_time_ns": []})
            topic["log_time_ns"].append(message.log_time)
            for name, value in fields(decoded):
                topic.setdefault(name, []).append(value)
    return {
        topic: {name: np.array(values) for name, values in own.items()}
        for topic, own in columns.items()
    }


def fields(message, prefix=""):
    """Name and value of every scalar field; NaN for an absent one."""
    for field in message.DESCRIPTOR.fields:
        if field.message_type is not None:
            inner = getattr(message, field.name)
            there = message.HasField(field.name)
            for name, value in fields(inner, f"{prefix}{field.name}."):
                yield name, value if there else float("nan")
        elif field.has_presence and not message.HasField(field.name):
            yield prefix + field.name, float("nan")
        else:
            yield prefix + field.name, getattr(message, field.name)


def bench_read(options):
    """Read one recording both ways."""
    from bench_open import write_recording

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "hour.mcap"
        messages = write_recording(path, options.minutes)
        theirs, their_time, _ = timed(lambda: read_with_protobuf(path), 1)
        ours, fastest, median = timed(lambda: klasktron.read(path))
        check_equal(ours, theirs)
    return {
        "messages": messages,
        "read_s": fastest,
        "read_median_s": median,
        "mcap_protobuf_s": their_time,
        "factor": their_time / median,
    }


def check_equal(ours, theirs):
    """Stop unless both readers give the same values."""
    if set(ours) != set(theirs):
        sys.exit(f"topics differ: {sorted(ours)} and {sorted(theirs)}")
    for topic, columns in theirs.items():
        for name, wanted in columns.items():
            found = ours[topic][name]
            if wanted.dtype.kind == "U":
                same = list(found) == list(wanted)
            else:
                same = np.array_equal(found, wanted, equal_nan=True)
            if not same:
                sys.exit(f"{topic} {name} differs")
    print(f"{sum(len(own['log_time_ns']) for own in theirs.values())} messages are equal")


def check_games(count=2048, steps=400):
    """Play the same episodes with `numpy_game` and stop unless both agree: every observation to 1e-4 in at least 90 % of
    the games, and every end at the same step. The games start from single precision, which impacts amplify."""
    import numpy_game
    from klasktron.envs import KlaskVectorEnv

    generator = np.random.default_rng(0)
    envs = KlaskVectorEnv(count, opponent="stationary")
    seen, _ = envs.reset(seed=3)
    game = numpy_game.NumpyGame(count, generator)
    own = seen.astype(np.float64)
    strikers = np.stack([own[:, 0:2], own[:, 4:6]], 1)
    game.place(np.arange(count), own[:, 8:10], own[:, 10:12], strikers)
    live, differ, ended = np.ones(count, bool), np.zeros(count, bool), np.zeros(count, bool)
    for step in range(steps):
        # Towards the ball with noise, so that there are impacts, and random for a while.
        actions = 20 * (seen[:, 8:10] - seen[:, 0:2]) + generator.normal(0, 0.5, (count, 2))
        if 35 < step % 50:
            actions = generator.uniform(-1, 1, (count, 2))
        actions = np.clip(actions, -1, 1).astype(np.float32)
        seen, _, terminated, truncated, infos = envs.step(actions)
        flags = game.step(actions, restart=False)
        over = terminated | truncated
        wanted = seen.copy()
        for row in np.flatnonzero(over):
            wanted[row] = infos["final_obs"][row]
        far = np.abs(game.observations() - wanted).max(1) > 1e-4
        differ |= live & far
        same = live & ~far
        if (same & ((terminated != flags[0]) | (truncated != flags[1]))).any():
            sys.exit(f"an episode ends in one of the games only, step {step}")
        ended |= same & over
        live = same & ~over & ~flags[0] & ~flags[1]
    if 0.1 * count < differ.sum() or ended.sum() < 0.5 * count:
        sys.exit(f"{differ.sum()} of {count} games differ, {ended.sum()} episodes ended alike")
    print(f"{ended.sum()} of {count} episodes end alike, {differ.sum()} games differ by more than 1e-4")


def bench_numpy(actions, steps=40):
    """Steps per second of the same rules in vectorized NumPy."""
    import numpy_game

    game = numpy_game.NumpyGame(actions.shape[1], np.random.default_rng(0))

    def roll():
        for step in range(steps):
            game.step(actions[step % len(actions)])
            game.observations()

    _, _, median = timed(roll)
    return actions.shape[1] * steps / median


def bench_envs(_options):
    """Steps per second with random actions, opponents at rest."""
    from klasktron.envs import KlaskVectorEnv

    check_games()
    count, steps = 4096, 200
    generator = np.random.default_rng(0)
    actions = generator.uniform(-1, 1, (16, count, 2)).astype(np.float32)
    results = {"environments": count}
    for name, copy in (("copied", True), ("zero_copy", False)):
        envs = KlaskVectorEnv(count, opponent="stationary", copy=copy)
        envs.reset(seed=0)

        def roll(envs=envs):
            for step in range(steps):
                envs.step(actions[step % len(actions)])

        _, fastest, median = timed(roll)
        results[f"{name}_steps_per_s"] = count * steps / median
        results[f"{name}_best_steps_per_s"] = count * steps / fastest
    results["numpy_steps_per_s"] = bench_numpy(actions)
    results["factor"] = results["copied_steps_per_s"] / results["numpy_steps_per_s"]
    return results


def bench_simulate(_options):
    """A mass with viscous friction under a force that is linear between samples."""
    from scipy.integrate import solve_ivp

    mass, viscous, dt, count = 2.0, 3.0, 1e-3, 10_001
    twin = klasktron.Twin.nominal("axis").with_value("gantry.inertia.mass_kg", mass)
    twin = twin.with_value("drive.friction.viscous.coefficient_n_s_per_m", viscous)
    times = np.arange(count) * dt
    force = 4.0 * np.sin(2 * np.pi * 1.3 * times) + np.sin(2 * np.pi * 0.2 * times)

    def rate(time_s, state):
        push = np.interp(time_s, times, force)
        return [state[1], (push - viscous * state[1]) / mass]

    def solve():
        return solve_ivp(
            rate, (0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-8, atol=1e-10, max_step=1e-2
        )

    wanted, their_time, _ = timed(solve, 1)
    found, fastest, median = timed(lambda: twin.simulate(force, times_s=times))
    error = np.abs(found["position_m"] - wanted.y[0]).max()
    return {
        "samples": count,
        "simulate_s": fastest,
        "simulate_median_s": median,
        "solve_ivp_s": their_time,
        "factor": their_time / median,
        "largest_position_error_m": error,
        "largest_position_m": np.abs(wanted.y[0]).max(),
    }


BENCHES = {"read": bench_read, "envs": bench_envs, "simulate": bench_simulate}


def main():
    """Run the benches, print, write."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("benches", nargs="*", choices=[*BENCHES, []], help="all by default")
    parser.add_argument("--minutes", type=int, default=60, help="length of the recording")
    parser.add_argument("--out", type=Path, help="write the figures here as JSON")
    options = parser.parse_args()
    document = {"machine": bench_tools.machine()}
    for name in options.benches or BENCHES:
        document[name] = BENCHES[name](options)
        shown = ", ".join(f"{key} {value:.6g}" for key, value in document[name].items())
        print(f"{name}: {shown}")
    if options.out is not None:
        options.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
