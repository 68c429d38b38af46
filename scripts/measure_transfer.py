#!/usr/bin/env python3
"""Transfer of policies from their simulation to the virtual rig, over several training seeds.

    python scripts/measure_transfer.py KLASKTRON DEMO OUT [--steps 20e6] [--seeds 3] [--first-seed 0]
        [--seconds 900] [--settings FILE] [--twin FILE] [--arms A,B] [--ablate] [--join OUT ...]

DEMO is the folder of a finished `klasktron demo`: its twin (unless --twin names another one), actuator network, filter and
rig files are used. Every arm is the same learner in another simulation, with the settings of FILE (default: those of the
program). The arm `rig` trains on the rig itself; its simulation is the twin. Each policy plays on the rig and in its own
simulation: the same opponents, both seats, the same serves; one referee scores both. Results in OUT are not computed
again. With --ablate each policy also plays on rigs without one of the demo's hidden effects, and on one without any. With
--join the runs of other finished OUT folders, such as those with other settings, count as further seeds of the same arms;
with --seeds 0 there are no others.

Intervals are 95 %: bootstrap over training seeds, and over the episodes of each seed within (Efron and Tibshirani 1993).
Writes OUT/transfer.json and prints the tables.
"""

import argparse
import json
import math
import subprocess
from pathlib import Path

import numpy as np

ARMS = {
    "ideal": "ideal",
    "randomized": "ideal --randomize",
    "learned": "{demo}/actuator/actuator.mcap",
    "twin": "{twin} --no-sensors",
    "ideal-sensors": "ideal --ekf {demo}/ekf/ekf.json",
    "learned-sensors": "{demo}/actuator/actuator.mcap --ekf {demo}/ekf/ekf.json",
    "twin-sensors": "{twin} --ekf {demo}/ekf/ekf.json",
    "rig": "{twin} --rig {demo}/rigs/match-chaser-left.json --ekf {demo}/ekf/ekf.json",
    "twin-without-history": "{twin} --no-sensors --action-history 0",
}
OPPONENTS = ["stationary", "chaser", "goalkeeper"]
SEATS = ["left", "right"]
CLAIMS = [
    ("twin", "ideal"),
    ("twin", "randomized"),
    ("learned", "ideal"),
    ("learned", "randomized"),
    ("learned-sensors", "ideal-sensors"),
    ("twin-sensors", "twin"),
    ("twin-sensors", "ideal"),
    ("twin-sensors", "ideal-sensors"),
    ("twin", "twin-without-history"),
    ("rig", "ideal"),
    ("rig", "twin-sensors"),
]
DRAWS = 4000
# Keys of the demo's rig file, with the values of an unchanged rig.
HIDDEN = {
    "command delay": ("drive", "command_delay_s"),
    "striker friction": ("peg",),
    "slew limit": ("drive", "slew_turns_per_s2"),
}
ABLATIONS = {f"without {name}": [keys] for name, keys in HIDDEN.items()} | {"without all": list(HIDDEN.values())}


def run(words, out):
    """The JSON that a command prints; kept in `out`."""
    if not out.exists():
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(f"{' '.join(map(str, words))}: status {done.returncode}: {done.stderr}")
        out.write_text(done.stdout, encoding="utf-8")
    return json.loads(out.read_text(encoding="utf-8"))


def rig_file(options, place, opponent, seat):
    """The demo's rig for this match, without the effects that `place` names. That of the chaser stands for opponents that
    the demo does not have."""
    path = options.demo / "rigs" / f"match-{opponent}-{seat}.json"
    path = path if path.exists() else options.demo / "rigs" / f"match-chaser-{seat}.json"
    if place not in ABLATIONS:
        return path
    rig = json.loads(path.read_text(encoding="utf-8"))
    for *outer, key in ABLATIONS[place]:
        group = rig
        for name in outer:
            group = group[name]
        # An absent key has the value of an unchanged rig.
        del group[key]
    changed = options.out / "rigs" / f"{place} {path.name}".replace(" ", "-")
    changed.parent.mkdir(parents=True, exist_ok=True)
    changed.write_text(json.dumps(rig), encoding="utf-8")
    return changed


def train(options, arm, seed):
    folder = options.out / arm / f"seed-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    actuator, *others = ARMS[arm].format(demo=options.demo, twin=options.twin).split()
    words = [options.klasktron, "train", "--actuator", actuator, *others, "--steps", options.steps, "--seed", seed]
    words += ["--settings", options.settings] if options.settings else []
    words += ["--games", 1000, "--output", folder, "--overwrite", "--json"]
    return folder, actuator, run(words, folder / "train.json")


def play(options, folder, actuator):
    """Score of all matches of one policy at each place: the rig, its own simulation, and the rigs of an ablation."""
    policy = folder / "policy.mcap"
    places = ["rig", "simulation", *(ABLATIONS if options.ablate else [])]
    for place in places:
        (folder / place).mkdir(exist_ok=True)
        for opponent in OPPONENTS:
            for seat in SEATS:
                left, right = (policy, opponent) if seat == "left" else (opponent, policy)
                words = [options.klasktron, "play", "--speed", "max", "--rig", rig_file(options, place, opponent, seat)]
                if place == "simulation":
                    words += ["--simulation", actuator]
                else:
                    words += ["--ekf", options.demo / "ekf/ekf.json"]
                recording = folder / place / f"{opponent}-{seat}.mcap"
                words += ["--left", left, "--right", right, "--seconds", options.seconds, "--seed", 0]
                words += ["--output", recording, "--overwrite", "--json"]
                run(words, folder / place / f"{opponent}-{seat}.json")
    scores = {}
    for place in places:
        words = [options.klasktron, "eval", folder / place, "--output", folder / f"eval-{place}", "--overwrite", "--json"]
        scores[place] = run(words, folder / f"eval-{place}.json")
    for recording in folder.glob("*/*.mcap"):
        recording.unlink()
    return scores


def episodes(score, opponent):
    """Minutes, goals, conceded goals and contacts of every episode against one opponent, [episodes][4]."""
    rows = []
    for match in score["matches"]:
        name = Path(match["file"]).stem
        for seat in SEATS:
            if name != f"{opponent}-{seat}":
                continue
            for one in match["episodes"]:
                scorer = one["scorer"]
                minutes = (one["end_s"] - one["start_s"]) / 60
                rows.append([minutes, scorer == seat, scorer not in (None, seat), one["contacts"]])
    return np.array(rows, dtype=float).reshape(-1, 4)


def both_places(scores):
    """Episodes of one policy against each opponent, on the rig and in its simulation."""
    return [{name: episodes(scores[place], name) for name in OPPONENTS} for place in ("rig", "simulation")]


def finished(out, arm):
    """Episodes of every policy of an arm in a finished folder."""
    for folder in sorted((out / arm).glob("seed-*")):
        read = lambda place: json.loads((folder / f"eval-{place}.json").read_text(encoding="utf-8"))
        yield both_places({place: read(place) for place in ("rig", "simulation")})


def drawn(seeds, generator):
    """Sums over a bootstrap sample of the seeds and of the episodes of each: [places][4]."""
    chosen = generator.integers(len(seeds), size=len(seeds))
    sums = np.zeros((2, 4))
    for index in chosen:
        for place, rows in enumerate(seeds[index]):
            if len(rows):
                sums[place] += rows[generator.integers(len(rows), size=len(rows))].sum(axis=0)
    return sums


def whole(seeds):
    return np.array([sum(one[place].sum(axis=0) for one in seeds) for place in (0, 1)])


def interval(values):
    values = [value for value in values if math.isfinite(value)]
    return [float(own) for own in np.quantile(values, [0.025, 0.975])] if values else None


def ratio(sums):
    rig, simulation = sums
    return (rig[1] / rig[0]) / (simulation[1] / simulation[0]) if simulation[1] else math.nan


def net(sums):
    return (sums[0][1] - sums[0][2]) / sums[0][0]


def result(seeds, generator):
    """Rates and transfer ratio of one arm against one or all opponents."""
    sums, samples = whole(seeds), [drawn(seeds, generator) for _ in range(DRAWS)]
    rate = lambda own, place: own[place][1] / own[place][0]
    return {
        "simulated_goals_per_min": rate(sums, 1),
        "goals_per_min": rate(sums, 0),
        "goals_per_min_ci95": interval([rate(own, 0) for own in samples]),
        "conceded_goals_per_min": sums[0][2] / sums[0][0],
        "transfer_ratio": ratio(sums),
        "transfer_ratio_ci95": interval([ratio(own) for own in samples]),
        "net_goals_per_min": net(sums),
        "net_goals_per_min_by_seed": [net(whole([one])) for one in seeds],
        "contacts_per_episode": sums[0][3] / sum(len(one[0]) for one in seeds),
        "episode_length_s": 60 * sums[0][0] / sum(len(one[0]) for one in seeds),
    }


def difference(better, worse, generator):
    """Net goals per minute of one arm minus another, with Welch's t-test over seeds."""
    from scipy import stats

    samples = [net(drawn(better, generator)) - net(drawn(worse, generator)) for _ in range(DRAWS)]
    by_seed = [[net(whole([one])) for one in own] for own in (better, worse)]
    p_value = float(stats.ttest_ind(*by_seed, equal_var=False).pvalue) if len(better) > 1 else None
    return {
        "net_goals_per_min": net(whole(better)) - net(whole(worse)),
        "ci95": interval(samples),
        "p_value_welch_over_seeds": p_value,
    }


def ablated(seeds, generator):
    """Change of the net goals per minute on a rig without some effects: the same policies and serves, [without, with]."""
    from scipy import stats

    of_change = lambda sums: net(sums) - net(sums[::-1])
    by_seed = [of_change(whole([one])) for one in seeds]
    return {
        "net_goals_per_min": net(whole(seeds)),
        "change": of_change(whole(seeds)),
        "change_ci95": interval([of_change(drawn(seeds, generator)) for _ in range(DRAWS)]),
        "change_by_seed": by_seed,
        "p_value_paired_t_over_seeds": float(stats.ttest_1samp(by_seed, 0).pvalue) if len(by_seed) > 1 else None,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("klasktron", type=Path)
    parser.add_argument("demo", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--steps", default="20e6")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--seconds", type=int, default=900)
    parser.add_argument("--settings", type=Path)
    parser.add_argument("--twin", type=Path)
    parser.add_argument("--arms", default=",".join(ARMS))
    parser.add_argument("--ablate", action="store_true")
    parser.add_argument("--join", type=Path, nargs="+", default=[])
    options = parser.parse_args()
    options.twin = options.twin or options.demo / "gap/twin.json"
    generator = np.random.default_rng(0)
    options.out.mkdir(parents=True, exist_ok=True)
    document = {"steps": options.steps, "seeds": options.seeds, "seconds": options.seconds, "arms": {}, "differences": {}}
    document["joined"] = [str(out) for out in options.join]
    data, changed = {}, {}
    for seed in range(options.first_seed, options.first_seed + options.seeds):
        for arm in options.arms.split(","):
            folder, actuator, trained = train(options, arm, seed)
            scores = play(options, folder, actuator)
            data.setdefault(arm, []).append(both_places(scores))
            for place in scores.keys() & ABLATIONS.keys():
                joined = lambda score: np.concatenate([episodes(score, name) for name in OPPONENTS])
                pair = [joined(scores[place]), joined(scores["rig"])]
                changed.setdefault(arm, {}).setdefault(place, []).append(pair)
            document["arms"].setdefault(arm, {}).setdefault("transitions_per_s", []).append(trained["transitions_per_s"])
            print(f"{arm}, seed {seed}: done", flush=True)
    pooled = {}
    for arm in options.arms.split(","):
        seeds = data.get(arm, []) + [own for out in options.join for own in finished(out, arm)]
        if not seeds:
            continue
        each = {name: [[rows[0][name], rows[1][name]] for rows in seeds] for name in OPPONENTS}
        joined = lambda rows: np.concatenate([rows[name] for name in OPPONENTS])
        pooled[arm] = [[joined(rows[0]), joined(rows[1])] for rows in seeds]
        each["all"] = pooled[arm]
        document["arms"].setdefault(arm, {}).update({name: result(own, generator) for name, own in each.items()})
    for better, worse in CLAIMS:
        if better in pooled and worse in pooled:
            document["differences"][f"{better} minus {worse}"] = difference(pooled[better], pooled[worse], generator)
    for arm, places in changed.items():
        own = {place: ablated(places[place], generator) for place in ABLATIONS}
        document.setdefault("ablation", {})[arm] = own
    (options.out / "transfer.json").write_text(json.dumps(document, indent=1), encoding="utf-8")
    show(document)


def show(document):
    print("\n| policy | opponent | goals per minute, simulation | on the rig | conceded | transfer ratio |\n|---|---|---|---|---|---|")
    for arm, own in document["arms"].items():
        for name in [*OPPONENTS, "all"]:
            one = own[name]
            of = lambda key, form, scale=1: f"{scale * one[key]:{form}} ({' to '.join(format(scale * end, form) for end in one[key + '_ci95'] or [])})"
            rates = f"{one['simulated_goals_per_min']:.2f} | {of('goals_per_min', '.2f')} | {one['conceded_goals_per_min']:.2f}"
            print(f"| {arm} | {name} | {rates} | {of('transfer_ratio', '.0f', 100)} % |")
    print("\n| net goals per minute on the rig | difference | p, Welch over seeds |\n|---|---|---|")
    for name, one in document["differences"].items():
        low, high = one["ci95"]
        print(f"| {name} | {one['net_goals_per_min']:.2f} ({low:.2f} to {high:.2f}) | {p_value(one['p_value_welch_over_seeds'])} |")
    if "ablation" in document:
        print("\n| policy | rig | net goals per minute | change | p, paired over seeds |\n|---|---|---|---|---|")
    for arm, places in document.get("ablation", {}).items():
        for place, one in places.items():
            low, high = one["change_ci95"]
            change = f"{one['change']:.2f} ({low:.2f} to {high:.2f})"
            print(f"| {arm} | {place} | {one['net_goals_per_min']:.2f} | {change} | {p_value(one['p_value_paired_t_over_seeds'])} |")


def p_value(value):
    return "" if value is None else f"{value:.2g}"


if __name__ == "__main__":
    main()
