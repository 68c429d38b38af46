#!/usr/bin/env python3
"""Time the PPO learner beside plain PyTorch and faer's matrix product, in one run.

Usage: bench_ppo.py [--threads N] [--horizon N] [--repetitions N] [--program FILE] [--out FILE]

Twice, with a fake game of 4096 environments on both sides and minibatches of 4096:
  256-128-64  one network for actor and critic, ELU, 8 epochs (upstream's preset)
  64-64       two networks, ELU, 4 epochs (the paper's preset)
Before anything counts, both sides must find the same losses and the same gradient on the
same minibatch. Sides take turns, so that a change in the machine's load meets both.
Prints environment steps per second, their ratio, and the learner's share of the rate of
faer's own single precision products at the learner's shapes, narrow outputs left out.
PyTorch's part is skipped without torch.
Needs: cargo; pip install torch. --program names the built bench (`cargo bench --bench ppo
--no-run` prints its path) and saves asking cargo for it.
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

NETWORKS = {"256-128-64": ([256, 128, 64], True), "64-64": ([64, 64], False)}
ENVIRONMENTS, OBSERVATIONS, ACTIONS = 4096, 20, 2
LOSS_TOLERANCE = 1e-5
# Of the gradient's norm; ours is read off weights before and after, in single precision.
GRADIENT_TOLERANCE = 1e-3


def import_torch(threads):
    """The module torch on so many threads, or None."""
    try:
        import torch
    except ImportError:
        print("PyTorch skipped: torch cannot be imported (pip install torch)")
        return None
    torch.set_num_threads(threads)
    torch.set_flush_denormal(True)
    torch.manual_seed(0)
    return torch


def find_program():
    """Path of the built bench, built when it is not there."""
    command = ["cargo", "bench", "--bench", "ppo", "--no-run", "--message-format=json"]
    done = subprocess.run(
        command, cwd=bench_tools.ROOT, check=True, stdout=subprocess.PIPE, text=True
    )
    messages = [json.loads(line) for line in done.stdout.splitlines()]
    paths = [m["executable"] for m in messages if m.get("target", {}).get("name") == "ppo"]
    return paths[-1]


class Agent:
    """Actor and critic as plain PyTorch modules."""

    def __init__(self, torch, hidden, shared):
        self.torch, self.shared = torch, shared
        if shared:
            self.trunks = [self.make(hidden, ACTIONS + 1)]
        else:
            self.trunks = [self.make(hidden, ACTIONS), self.make(hidden, 1)]
        self.log_std = torch.nn.Parameter(torch.zeros(ACTIONS))
        self.parameters = [p for t in self.trunks for p in t.parameters()] + [self.log_std]

    def make(self, hidden, outputs):
        """One multi-layer perceptron."""
        nn = self.torch.nn
        layers, width = [], OBSERVATIONS
        for size in hidden:
            layers += [nn.Linear(width, size), nn.ELU()]
            width = size
        return nn.Sequential(*layers, nn.Linear(width, outputs))

    def __call__(self, x):
        """Means and values."""
        if self.shared:
            y = self.trunks[0](x)
            return y[:, :ACTIONS], y[:, ACTIONS]
        return self.trunks[0](x), self.trunks[1](x)[:, 0]

    def distribution(self, means):
        """The policy's distribution."""
        return self.torch.distributions.Normal(means, self.log_std.exp().expand_as(means))


def losses(torch, agent, settings, batch):
    """Policy, value and bounds loss and entropy of a minibatch, as CleanRL and rl_games."""
    x, actions, old_log_probability, advantages, targets, old_values = batch
    means, values = agent(x)
    distribution = agent.distribution(means)
    log_probability = distribution.log_prob(actions).sum(1)
    entropy = distribution.entropy().sum(1).mean()
    ratio = (log_probability - old_log_probability).exp()
    advantages = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    clip = settings["clip_coef"]
    policy = torch.max(-advantages * ratio, -advantages * ratio.clamp(1 - clip, 1 + clip)).mean()
    held = old_values + (values - old_values).clamp(-clip, clip)
    value = 0.5 * torch.max((values - targets) ** 2, (held - targets) ** 2).mean()
    bounds = ((means.abs() - 1.1).clamp(min=0.0) ** 2).sum(1).mean()
    return policy, value, bounds, entropy


def whole(settings, parts):
    """The loss that is minimised."""
    policy, value, bounds, entropy = parts
    return (
        policy
        + settings["value_coef"] * value
        + settings["bounds_coef"] * bounds
        - settings["entropy_coef"] * entropy
    )


def check_same(torch, name, program, folder):
    """Stop unless both sides find the same losses and gradient; returns our settings."""
    path = Path(folder) / "sample.json"
    subprocess.run([program, "sample", name, path], check=True)
    found = json.loads(path.read_text(encoding="utf-8"))
    settings = found["settings"]
    if torch is None:
        return settings
    agent = Agent(torch, *NETWORKS[name])
    ours = []
    with torch.no_grad():
        for trunk, layers, after in zip(agent.trunks, found["networks"], found["networks_after"]):
            linear = [m for m in trunk if isinstance(m, torch.nn.Linear)]
            for module, old, new in zip(linear, layers, after):
                for parameter, key in [(module.weight, "weight"), (module.bias, "bias")]:
                    parameter.copy_(torch.tensor(old[key]).reshape(parameter.shape))
                    ours.append(torch.tensor(old[key]).double() - torch.tensor(new[key]).double())
        agent.log_std.copy_(torch.tensor(found["log_deviations"]))
        old, new = found["log_deviations"], found["log_deviations_after"]
        ours.append(torch.tensor(old).double() - torch.tensor(new).double())
    x = torch.tensor(found["observations"]).reshape(-1, OBSERVATIONS)
    x = (x - torch.tensor(found["standardize_mean"])) * torch.tensor(found["standardize_scale"])
    actions = torch.tensor(found["actions"]).reshape(-1, ACTIONS)
    values, rewards = torch.tensor(found["values"]), torch.tensor(found["rewards"])
    log_probabilities = torch.tensor(found["log_probabilities"])
    parts = losses(
        torch, agent, settings, (x, actions, log_probabilities, rewards - values, rewards, values)
    )
    report = found["report"]
    names = ["policy_loss", "value_loss", "bounds_loss", "entropy"]
    for key, theirs in zip(names, parts):
        if not abs(report[key] - theirs.item()) <= LOSS_TOLERANCE:
            sys.exit(f"{name}: {key} is {report[key]} here, {theirs.item()} in PyTorch")
    whole(settings, parts).backward()
    theirs = torch.cat([p.grad.flatten().double() for p in agent.parameters])
    difference = (torch.cat([g.flatten() for g in ours]) - theirs).norm() / theirs.norm()
    print(f"{name}: same losses, gradients differ by {difference:.1e} of their norm")
    if not difference <= GRADIENT_TOLERANCE:
        sys.exit(f"above {GRADIENT_TOLERANCE}: the times would mean nothing")
    return settings


class Torch:
    """Plain PyTorch at the same game, as CleanRL writes it but without its bookkeeping."""

    def __init__(self, torch, name, horizon, settings):
        self.torch, self.horizon, self.settings = torch, horizon, settings
        self.agent = Agent(torch, *NETWORKS[name])
        self.optimiser = torch.optim.Adam(self.agent.parameters, lr=1e-4, eps=1e-5)
        self.state = torch.rand(ENVIRONMENTS, OBSERVATIONS) * 2 - 1
        self.epochs = {"256-128-64": 8, "64-64": 4}[name]

    def update(self):
        """Seconds of playing and of learning."""
        start = time.perf_counter()
        rollout = self.play()
        middle = time.perf_counter()
        self.learn(*rollout)
        return middle - start, time.perf_counter() - middle

    def play(self):
        """A rollout, [horizon][environment]."""
        torch, shape = self.torch, (self.horizon, ENVIRONMENTS)
        observations = torch.empty(*shape, OBSERVATIONS)
        actions = torch.empty(*shape, ACTIONS)
        log_probabilities, rewards, values = (torch.empty(shape) for _ in range(3))
        x = self.state
        with torch.no_grad():
            for step in range(self.horizon):
                observations[step] = x
                means, values[step] = self.agent(x)
                distribution = self.agent.distribution(means)
                actions[step] = distribution.sample()
                log_probabilities[step] = distribution.log_prob(actions[step]).sum(1)
                x = x * 0.95
                x[:, :2] += 0.1 * actions[step].clamp(-1, 1)
                rewards[step] = -x[:, 0].abs()
            last_values = self.agent(x)[1]
        self.state = x
        return observations, actions, log_probabilities, rewards, values, last_values

    def learn(self, observations, actions, log_probabilities, rewards, values, last_values):
        """Advantages, then epochs of minibatches."""
        torch, settings = self.torch, self.settings
        gamma, decay = settings["gamma"], settings["gamma"] * settings["gae_lambda"]
        advantages, carried = torch.empty_like(rewards), 0.0
        following = last_values
        for step in reversed(range(self.horizon)):
            delta = rewards[step] + gamma * following - values[step]
            carried = delta + decay * carried
            advantages[step], following = carried, values[step]
        batch = [
            observations.reshape(-1, OBSERVATIONS),
            actions.reshape(-1, ACTIONS),
            log_probabilities.flatten(),
            advantages.flatten(),
            (advantages + values).flatten(),
            values.flatten(),
        ]
        size = settings["minibatch"]
        for _ in range(self.epochs):
            order = torch.randperm(len(batch[0]))
            for first in range(0, len(order), size):
                chosen = order[first : first + size]
                parts = losses(torch, self.agent, settings, [column[chosen] for column in batch])
                self.optimiser.zero_grad()
                whole(settings, parts).backward()
                torch.nn.utils.clip_grad_norm_(self.agent.parameters, 0.5)
                self.optimiser.step()


def measure(options, torch, name, program, folder):
    """Medians of one network as a row of figures."""
    settings = check_same(torch, name, program, folder)
    theirs = torch and Torch(torch, name, options.horizon, settings)
    if theirs:
        theirs.update()
    rows, ratios = [], []
    command = [program, "time", name, str(options.threads), str(options.horizon)]
    for _ in range(options.repetitions):
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        row = json.loads(done.stdout)
        seconds = row["act_seconds"] + row["learn_seconds"]
        row["steps_per_s"] = row["samples"] / seconds
        row["learn_share_percent"] = 100.0 * row["learn_seconds"] / seconds
        row["share_of_faer_percent"] = 100.0 * row["learner_gflop_per_s"] / row["faer_gflop_per_s"]
        if theirs:
            played, learned = theirs.update()
            row["torch_steps_per_s"] = row["samples"] / (played + learned)
            row["torch_learn_seconds"] = learned
            row["ratio"] = row["steps_per_s"] / row["torch_steps_per_s"]
        row.pop("report")
        rows.append(row)
    return {key: statistics.median(row[key] for row in rows) for key in rows[0]}


def print_row(name, row):
    """One line of the table."""
    torch = f"{row['torch_steps_per_s']:>9.0f} {row['ratio']:>6.2f}x" if "ratio" in row else "-"
    print(
        f"{name:>10}  {row['steps_per_s']:>9.0f}  {torch:>17}  {row['learn_share_percent']:>5.0f} %"
        f"  {row['learner_gflop_per_s']:>8.1f}  {row['faer_gflop_per_s']:>6.1f}"
        f"  {row['share_of_faer_percent']:>4.0f} %"
    )


def parse_arguments():
    """What was typed."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--horizon", type=int, default=32, help="steps in one update")
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--program", help="the built bench")
    parser.add_argument("--out", type=Path, help="write the figures here as JSON")
    return parser.parse_args()


def main():
    """Check, time, print, write."""
    options = parse_arguments()
    program = options.program or find_program()
    torch = import_torch(options.threads)
    before = bench_tools.machine()
    figures = {}
    with tempfile.TemporaryDirectory() as folder:
        for name in NETWORKS:
            figures[name] = measure(options, torch, name, program, folder)
    print("   network    steps/s  PyTorch   ratio  learning  GFLOP/s    faer  share")
    for name, row in figures.items():
        print_row(name, row)
    if options.out is not None:
        document = {
            "threads": options.threads,
            "horizon": options.horizon,
            "machine_before": before,
            "machine_after": bench_tools.machine(),
            "networks": figures,
        }
        options.out.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
