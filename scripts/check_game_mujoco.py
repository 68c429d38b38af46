#!/usr/bin/env python3
"""Rolls and bounces of the game beside MuJoCo: scripts/check_game_mujoco.py

Writes scenarios, lets `cargo test` play them, plays them in MuJoCo, and exits with 1 when the two disagree.
Needs numpy and mujoco.

MuJoCo's contacts are springs and dampers over a quarter of a millisecond, so its restitution is what
such a contact makes of it: it is measured in one square bounce and given to the game, and where there is
friction, with which MuJoCo's solver couples it, in the bounce itself. Everything else (places, times, oblique
bounces, friction and spin, hits on a striker, rolling and sliding) is then predicted, not fitted.
"""

import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

RADIUS_M, MASS_KG = 0.007, 0.0017
STRIKER_RADIUS_M, STRIKER_MASS_KG = 0.0075, 0.012
HALF_BOARD_M = (0.16, 0.21)
GRAVITY = 9.81
STEP_S = 2.5e-6
PERIOD_S = 0.02
# Contacts: stiffness (1/s^2) and damping (1/s) of the acceleration, as MuJoCo's negative solref takes them.
STIFFNESS, DAMPING = 2.0e8, 2.0e3
# Friction must end sliding within a contact, not over several of them.
SLIP_DAMPING = 2.0e4
ASIDE = [[-0.1525, -0.2025], [-0.1525, 0.2025]]

# Largest differences that are agreement. MuJoCo's restitution depends by half a percent on where its steps fall
# in a contact, which is 2 mm over the longest ways here; a contact lasts 0.2 ms and is 0.15 mm deep.
POSITION_M = 2.5e-3
VELOCITY_M_PER_S = 0.012


def model(flat, friction, rolling=0.0, sliding=0.0):
    """A ball between four walls beside a striker: flat (no gravity, spin about z only) or on a floor."""
    hx, hy = HALF_BOARD_M
    contact = (
        f'solref="{-STIFFNESS} {-DAMPING}" solreffriction="-1 {-SLIP_DAMPING}" solimp="0.9999 0.9999 0.001"'
    )
    walls = "".join(
        f'<geom name="w{i}" type="box" pos="{x} {y} 0" size="{sx} {sy} 0.05"/>'
        for i, (x, y, sx, sy) in enumerate(
            [(hx + 0.05, 0, 0.05, 1), (-hx - 0.05, 0, 0.05, 1), (0, hy + 0.05, 1, 0.05), (0, -hy - 0.05, 1, 0.05)]
        )
    )
    joints = (
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>'
        if flat
        else "<freejoint/>"
    )
    slides = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
    floor = "" if flat else f'<geom name="floor" type="plane" size="2 2 1" pos="0 0 {-RADIUS_M}"/>'
    pairs = "".join(
        f'<pair geom1="ball" geom2="{other}" condim="{3 if friction else 1}" friction="{friction} {friction} 0 0 0" {contact}/>'
        for other in ["w0", "w1", "w2", "w3"] + (["striker"] if flat else [])
    )
    if not flat:
        # A stiff floor without bounce: critically damped.
        pairs += (
            f'<pair geom1="ball" geom2="floor" condim="6" friction="{sliding} {sliding} 0 {rolling} {rolling}"'
            ' solref="0.0004 1" solimp="0.9999 0.9999 0.001"/>'
        )
    striker = (
        f'<body name="striker" pos="0 0 0">{slides}<geom name="striker" type="cylinder" size="{STRIKER_RADIUS_M} 0.03"'
        f' mass="{STRIKER_MASS_KG}" contype="0" conaffinity="0"/></body>'
        if flat
        else ""
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP_S}" gravity="0 0 {0 if flat else -GRAVITY}" cone="elliptic"
        impratio="100" integrator="Euler" iterations="200" tolerance="1e-14"/>
        <default><geom contype="0" conaffinity="0"/></default>
        <worldbody>{walls}{floor}<body name="ball">{joints}<geom name="ball" type="sphere" size="{RADIUS_M}"
        mass="{MASS_KG}"/></body>{striker}</worldbody><contact>{pairs}</contact></mujoco>"""
    )


def play(scenario):
    """Times (s), places (m) and velocities (m/s) of the ball, and velocities of the striker, per period."""
    made = model(scenario["flat"], scenario["friction"], scenario["rolling_m"], scenario["sliding"])
    data = mujoco.MjData(made)
    (x, y), (vx, vy) = scenario["ball_position_m"], scenario["ball_velocity_m_per_s"]
    data.qpos[:2] = x, y
    data.qvel[:2] = vx, vy
    if scenario["flat"]:
        data.qpos[3:5] = scenario["striker_positions_m"][0]
    else:
        # It rolls: v = w x r.
        data.qvel[3:6] = -vy / RADIUS_M, vx / RADIUS_M, 0.0
    samples = []
    per_period = round(PERIOD_S / STEP_S)
    for step in range(scenario["steps"] * per_period + 1):
        if step % per_period == 0:
            striker = data.qvel[3:5] if scenario["flat"] else np.zeros(2)
            samples.append(np.concatenate([data.qpos[:2], data.qvel[:2], striker]))
        mujoco.mj_step(made, data)
    return np.array(samples)


def scenario(name, position, velocity, steps, friction=0.0, flat=True, rolling=0.0, sliding=0.0, striker=None):
    strikers = [striker or ASIDE[0], ASIDE[1]]
    return {
        "name": name,
        "flat": flat,
        "friction": friction,
        "rolling_m": rolling,
        "sliding": sliding,
        "ball_position_m": position,
        "ball_velocity_m_per_s": velocity,
        "striker_positions_m": strikers,
        "steps": steps,
    }


def measured_restitution():
    """What MuJoCo's contact gives back of a square bounce at 1 m/s: at a wall, at a striker."""
    wall = play(scenario("", [0.14, 0.0], [1.0, 0.0], 3))[-1]
    striker = play(scenario("", [0.0, -0.05], [0.0, 1.0], 4, striker=[0.0, 0.0]))[-1]
    return float(-wall[2]), float(striker[5] - striker[3])


def scenarios():
    """Rolls, square and oblique bounces, long rows of bounces, hits on a striker, slides after bounces."""
    rolling = 0.02 * 7.0 / 5.0 * RADIUS_M
    yield scenario("roll to rest", [-0.1, 0.0], [0.2, 0.0], 60, flat=False, rolling=rolling, sliding=0.5)
    yield scenario("oblique roll", [-0.1, -0.1], [0.25, 0.2], 60, flat=False, rolling=rolling, sliding=0.5)
    yield scenario("square bounce", [0.0, 0.05], [2.0, 0.0], 10)
    yield scenario("into a corner and out", [0.1, 0.1], [1.0, 1.3], 20)
    for degrees in (15, 35, 55, 75):
        a = math.radians(degrees)
        for friction in (0.05, 0.2, 0.6):
            velocity = [1.5 * math.cos(a), 1.5 * math.sin(a)]
            yield scenario(f"bounce at {degrees} degrees, friction {friction}", [0.1, -0.1], velocity, 8, friction)
    yield scenario("four walls", [0.05, 0.02], [1.4, 0.9], 25)
    for offset in (0.0, 0.3, -0.6, 0.9):
        x = offset * (RADIUS_M + STRIKER_RADIUS_M)
        name = f"hit on a striker, offset {offset}"
        for friction in (0.0, 0.2):
            start = [0.05 + x, -0.15]
            yield scenario(f"{name}, friction {friction}", start, [0.0, 1.0], 4, friction, striker=[0.05, -0.1])
    yield scenario("slide after a square bounce", [0.1, 0.0], [1.0, 0.0], 20, flat=False, sliding=0.2)
    yield scenario("slide after an oblique bounce", [0.1, 0.0], [1.0, 0.6], 15, flat=False, sliding=0.15)


def own_restitution(one, theirs):
    """What MuJoCo gave back in the one bounce of a scenario with friction: its solver couples the two."""
    _, (vx, vy) = one["ball_position_m"], one["ball_velocity_m_per_s"]
    end = theirs[-1]
    if not one["name"].startswith("hit"):
        return -end[2] / vx if end[2] < 0.0 else 1.0
    offset = one["ball_position_m"][0] - one["striker_positions_m"][0][0]
    reach = RADIUS_M + STRIKER_RADIUS_M
    normal = np.array([-offset, math.sqrt(reach**2 - offset**2)]) / reach
    return float((end[4:6] - end[2:4]) @ normal / (vy * normal[1]))


def game_settings(one, theirs, walls, striker):
    """The same as the game's effects."""
    if one["friction"]:
        walls = striker = own_restitution(one, theirs)
    effects = [["impact.wall_restitution", [walls]], ["impact.wall_friction_spin", [one["friction"], 0.0]]]
    if one["rolling_m"]:
        effects.append(["ball.rolling_resistance", [one["rolling_m"] * 5.0 / 7.0 / RADIUS_M, 0.0]])
    if one["sliding"]:
        effects.append(["ball.sliding_phase", [one["sliding"], 0.0]])
    return {
        "effects": effects,
        "striker_effects": [["impact.wall_restitution", [striker]], ["impact.wall_friction_spin", [one["friction"], 0.0]]],
        **{key: one[key] for key in ("ball_position_m", "ball_velocity_m_per_s", "striker_positions_m", "steps")},
    }


def played_by_the_game(settings):
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        (folder / "scenarios.json").write_text(json.dumps(settings))
        command = ["cargo", "test", "--release", "--test", "it", "game::trajectories_for_another_engine"]
        environment = {**os.environ, "KLASKTRON_GAME_DIR": str(folder)}
        subprocess.run(command, check=True, env=environment, cwd=Path(__file__).parent.parent, stdout=subprocess.DEVNULL)
        return json.loads((folder / "trajectories.json").read_text())


def compare(theirs, ours):
    """Largest differences in place (m) and velocity (m/s); during a contact of MuJoCo's there is no velocity."""
    position = np.array([sample["ball_position_m"] for sample in ours])
    velocity = np.array([sample["ball_velocity_m_per_s"] for sample in ours])
    away = np.linalg.norm(position - theirs[:, :2], axis=1).max()
    change = np.linalg.norm(velocity - theirs[:, 2:4], axis=1)
    clear = np.min(np.array(HALF_BOARD_M) - RADIUS_M - np.abs(position), axis=1) > 2e-3
    return away, change[clear].max()


def main():
    walls, striker = measured_restitution()
    print(f"restitution of MuJoCo's contact: {walls:.4f} at a wall, {striker:.4f} at a striker")
    chosen = list(scenarios())
    theirs = [play(one) for one in chosen]
    settings = [game_settings(one, other, walls, striker) for one, other in zip(chosen, theirs)]
    ours = played_by_the_game(settings)
    bad = 0
    for one, other, played in zip(chosen, theirs, ours):
        away, change = compare(other, played)
        agrees = away < POSITION_M and change < VELOCITY_M_PER_S
        bad += not agrees
        print(f"{'agrees  ' if agrees else 'DIFFERS '} {1e3 * away:7.3f} mm {1e3 * change:8.2f} mm/s  {one['name']}")
    print(f"{len(chosen) - bad} of {len(chosen)} scenarios agree within {1e3 * POSITION_M} mm and {1e3 * VELOCITY_M_PER_S} mm/s")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
