#!/usr/bin/env python3
"""Hides effects in an independent simulator of single axes and counts what `klasktron gap` identifies.

    scripts/check_simulated_axes.py make OUT [--seed N] [--case NAME]...
    scripts/check_simulated_axes.py run PROGRAM OUT RESULTS [--case NAME]... [--jobs N]

The simulator shares no code and no equations with this project. An axis is a mass under closed-loop position control,
integrated with a fixed step of 50 us. `make` simulates all cases at once, in about 5 minutes of CPU time. It writes
OUT/NAME-1.csv and OUT/NAME-2.csv, the two sessions of each case, and OUT/cases.json with the truth and the accepted
answers of all cases. NAME may be a pattern such as 's*'. A case made alone has the same numbers as in the whole set.
Another seed has other motions, disturbances and noise, and masses and frictions that differ by factors of 0.7 to 1.4.

`run` imports the CSV files of the cases that were made, runs `gap` on them and prints one line per case. Cases with a
base case start from its twin, which the same run makes first. RESULTS receives recordings, results, logs,
cases-results.json and summary.json. The counts have exact Clopper-Pearson 95 % intervals.

Each case has an accepted answer:
- `verdict_any_of`: the accepted verdicts;
- `must_name_any_of`: groups of effects; gap must identify one effect of each group, or change a parameter of it;
- `may_name`: further accepted effects.
A case is `wrong` if gap identifies any other effect, `right` if verdict and effects are accepted, and `not right`
otherwise. An effect that gap only lists as indistinguishable does not count. A null case contains no effect.

The input is a force (N), torque (N m), voltage (V), current (A) or velocity setpoint (m/s, rad/s), the position is in m
or rad. Parameters of an axis use these units, Hz and s. The mass of a gear motor on volts, for example, is in V s^2/rad.
An axis with a velocity loop has a velocity setpoint as input; its mass and forces are in kg and N, or in kg m^2 and
N m. Needs numpy and scipy.
"""

import argparse
import concurrent.futures
import fnmatch
import json
import os
import subprocess
import sys
import zlib
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.signal import butter, lfilter, sosfiltfilt
from scipy.stats import binomtest

SECONDS = 40  # length of a session
SESSIONS = 2
GRID_HZ = 1000  # rate of reference, disturbance and output
SUBSTEPS = 20  # integration steps per grid sample
STEP = 50e-6  # integration step (s)
DAMPING_RATIO = 0.8  # of the position controller
DISTURBANCE_SAMPLES = 5.0  # correlation time of the random force (grid samples)
ENCODER_NOISE = 0.3  # standard deviation before rounding, in encoder steps
TURN = 2 * np.pi  # rad
DEGREES = 180 / np.pi


# Reference motion: each function returns `count` positions at GRID_HZ within +-`reach` and about +-`speed`.


def faded(count):
    """Time (s) and a window with edges of 0.7 s."""
    time = np.arange(count) / GRID_HZ
    return time, np.minimum(1, np.minimum(time / 0.7, (time[-1] - time) / 0.7))


def limited(signal, reach, speed):
    """The signal scaled to the reach, or to 1.3 times the speed."""
    fastest = np.abs(np.gradient(signal) * GRID_HZ).max()
    return signal * min(reach / np.abs(signal).max(), 1.3 * speed / fastest)


def chirp(count, reach, speed, rng, low=0.1, high=4):
    """Exponential chirp from low to high (Hz)."""
    time, window = faded(count)
    end, rise = time[-1], np.log(high / low)
    phase = 2 * np.pi * low * end / rise * (np.exp(rise * time / end) - 1)
    frequency = low * np.exp(rise * time / end)
    return window * np.minimum(reach, speed / (2 * np.pi * frequency)) * np.sin(phase)


def multisine(count, reach, speed, rng, low=0.1, high=4):
    """Nine sines between low and high (Hz) with random phases."""
    time, window = faded(count)
    frequencies = np.exp(np.linspace(np.log(low), np.log(high), 9)) * rng.uniform(0.9, 1.1, 9)
    signal = sum(np.sin(2 * np.pi * own * time + rng.uniform(0, 6.28)) * own**-0.9 for own in frequencies)
    return window * limited(signal, reach, speed)


def noise(count, reach, speed, rng, low=0.1, high=4):
    """Random motion in the band from low to high (Hz)."""
    _, window = faded(count)
    band = butter(2, [low, high], "band", fs=GRID_HZ, output="sos")
    signal = sosfiltfilt(band, rng.standard_normal(count + 8000))[4000:-4000]
    return window * limited(signal, reach, speed)


def moves(count, reach, speed, rng, acceleration=None):
    """Point-to-point moves with trapezoidal speed and dwells of 0.05 to 0.4 s."""
    acceleration = acceleration or speed / 0.25
    positions = [0.0]
    while len(positions) < count:
        start = positions[-1]
        distance = rng.uniform(-reach, reach) - start
        top = speed * rng.uniform(0.25, 1)
        top = min(top, np.sqrt(acceleration * abs(distance)) + 1e-12)
        ramp = top / acceleration
        duration = abs(distance) / top + ramp
        time = np.minimum(np.arange(1, int(duration * GRID_HZ) + 2) / GRID_HZ, duration)
        braking = abs(distance) - acceleration * (duration - time) ** 2 / 2
        path = np.where(time < duration - ramp, top * (time - ramp / 2), braking)
        path = np.where(time < ramp, acceleration * time**2 / 2, path)
        positions.extend(start + np.sign(distance) * path)
        positions.extend([positions[-1]] * int(rng.uniform(0.05, 0.4) * GRID_HZ))
    time, _ = faded(count)
    return np.array(positions[:count]) * np.minimum(1, time[-1] - time)


def slow_moves(count, reach, speed, rng):
    """Short moves at 1.5 to 6 % of the speed, almost without ramps."""
    return moves(count, reach * 0.3, speed * 0.06, rng, acceleration=speed)


def reference(case, rng):
    """Position, velocity and acceleration of a session: the parts of its motion in equal times, low-pass filtered."""
    count, parts = SECONDS * GRID_HZ, case["motion"]
    lengths = [count // len(parts)] * len(parts)
    lengths[-1] += count - sum(lengths)
    joined = np.concatenate([
        part(length, case["reach"], case["speed"], rng) for part, length in zip(parts, lengths)
    ])  # fmt: skip
    position = sosfiltfilt(butter(2, case["low_pass_hz"], fs=GRID_HZ, output="sos"), joined)
    velocity = np.gradient(position) * GRID_HZ
    return position, velocity, np.gradient(velocity) * GRID_HZ


# Elements of an axis. `own` has the parameters of the lanes with that element as arrays, their indices `lanes`, and the
# `memory` of the element, zero at the start. `now` has the arrays of all lanes. A lane is one session of one case.

# Input chain: input before -> input after the element.


def slew_limit(own, now, force):
    """Limit of the rate of change (1/s)."""
    own.memory += np.clip(force - own.memory, -own.rate * STEP, own.rate * STEP)
    return own.memory


def dead_band(own, now, force):
    """No effect below the width; above it, the part `lost` of the width is subtracted."""
    return np.where(np.abs(force) < own.width, 0, force - own.lost * own.width * np.sign(force))


def lag(own, now, force):
    """First-order lag with a time constant (s)."""
    own.memory += (force - own.memory) * (1 - np.exp(-STEP / own.time))
    return own.memory


def saturation(own, now, force):
    """Symmetric limit of the input."""
    return np.clip(force, -own.limit, own.limit)


def torque_speed(own, now, force):
    """Limit that falls to zero at a speed while the motor drives."""
    velocity = now.velocity[own.lanes]
    falling = own.torque * np.maximum(0, 1 - np.abs(velocity) / own.speed)
    limit = np.where(force * velocity > 0, falling, own.torque)
    return np.clip(force, -limit, limit)


def velocity_loop(own, now, setpoint):
    """Force of a velocity loop; its gains per mass are in 1/s and 1/s^2."""
    error = setpoint - now.velocity[own.lanes]
    own.memory += STEP * own.integral * error
    return now.mass[own.lanes] * (own.proportional * error + own.memory)


# Load: force on the mass.


def quadratic_drag(own, now):
    """Drag that grows with the square of the speed."""
    velocity = now.velocity[own.lanes]
    return -own.coefficient * velocity * np.abs(velocity)


def spring(own, now):
    """Linear spring about a rest position."""
    return -own.stiffness * (now.position[own.lanes] - own.rest)


def gravity(own, now):
    """Pendulum that hangs down at zero."""
    return -own.torque * np.sin(now.position[own.lanes])


def cogging(own, now):
    """Sine of the position with `per_turn` periods."""
    return own.amplitude * np.sin(own.per_turn * now.position[own.lanes] + own.phase)


def end_stop(own, now):
    """Spring that acts above the position `start`."""
    return -own.stiffness * np.maximum(now.position[own.lanes] - own.start, 0)


def mass_slope(own, now):
    """Mass that changes linearly with position: sets the inertia and returns the force of its derivative."""
    mass = now.mass[own.lanes]
    now.inertia[own.lanes] = mass * (1 + own.slope * now.position[own.lanes])
    return -0.5 * mass * own.slope * now.velocity[own.lanes] ** 2


def second_mass(own, now):
    """Load mass behind a spring with damping, or behind backlash, in which the contact never pulls."""
    twist = now.position[own.lanes] - own.position
    half = own.backlash / 2
    pressed = np.where(twist > half, twist - half, np.where(twist < -half, twist + half, 0.0))
    force = own.stiffness * pressed + own.damping * (now.velocity[own.lanes] - own.velocity) * (np.abs(twist) >= half)
    pushing = np.where(pressed > 0, np.maximum(force, 0), np.where(pressed < 0, np.minimum(force, 0), 0))
    force = np.where(half > 0, pushing, force)
    own.velocity = stopped(own.velocity + STEP * force / own.mass, STEP * own.coulomb / own.mass)
    own.position += STEP * own.velocity
    return -force


def bristles(own, now):
    """LuGre friction, implicit in its deflection; it replaces the Coulomb friction of the lane."""
    velocity = now.velocity[own.lanes]
    relaxation = STEP * own.stiffness * np.abs(velocity) / now.friction[own.lanes]
    deflection = (own.memory + STEP * velocity) / (1 + relaxation)
    force = own.stiffness * deflection + own.damping * (deflection - own.memory) / STEP
    own.memory = deflection
    return -force


# Friction: what is added to the force that a sliding mass feels.


def stribeck(own, now):
    """More friction at low speed, Gaussian."""
    return own.extra * np.exp(-((now.velocity[own.lanes] / own.speed) ** 2))


def asymmetry(own, now):
    """Differences between the two directions: positive less negative."""
    return 0.5 * (own.viscous * now.velocity[own.lanes] + own.coulomb * now.direction[own.lanes])


def load_friction(own, now):
    """Fraction of the absolute driving force."""
    return own.fraction * np.abs(now.drive[own.lanes])


def friction_slope(own, now):
    """Linear in the position."""
    return own.slope * now.position[own.lanes]


def warm_up(own, now):
    """Change that approaches its full value with a time constant (s)."""
    return own.change * (1 - np.exp(-now.time / own.time))


INPUT_CHAIN = [slew_limit, dead_band, lag, saturation, torque_speed, velocity_loop]
LOADS = [quadratic_drag, spring, gravity, cogging, end_stop, mass_slope, second_mass]
SLIDING = [asymmetry, load_friction, friction_slope, warm_up]
# Scalar parameters of an axis: viscous and Coulomb friction, standard deviation of the random force, gain of the input,
# constant force, delay of the input (s), bandwidth of the controller (Hz).
SCALARS = {
    "mass": 1, "viscous": 0, "coulomb": 0, "disturbance": 0, "gain": 1, "constant": 0, "delay": 0, "bandwidth": 3,
}  # fmt: skip


def stopped(velocity, change):
    """The velocity after Coulomb friction, which takes at most `change` and never reverses it."""
    return np.sign(velocity) * np.maximum(np.abs(velocity) - change, 0)


def elements(functions, axes):
    """The functions that some lane needs, with the parameters of these lanes."""
    chosen = []
    for function in functions:
        name = function.__name__
        lanes = np.array([index for index, axis in enumerate(axes) if name in axis], dtype=int)
        if len(lanes):
            own = SimpleNamespace(lanes=lanes, memory=np.zeros(len(lanes)))
            for key in axes[lanes[0]][name]:
                setattr(own, key, np.array([float(axes[lane][name][key]) for lane in lanes]))
            chosen.append((function, own))
    return chosen


class Axes:
    """All lanes, one array element each, between two integration steps."""

    def __init__(self, lanes):
        axes = [lane["axis"] for lane in lanes]
        known = {function.__name__ for function in [*INPUT_CHAIN, *LOADS, *SLIDING, bristles, stribeck]} | set(SCALARS)
        assert all(set(axis) <= known for axis in axes), "unknown parameter"
        for name, usual in SCALARS.items():
            setattr(self, name, np.array([float(axis.get(name, usual)) for axis in axes]))
        self.chain, self.loads, self.sliding = (elements(own, axes) for own in (INPUT_CHAIN, LOADS, SLIDING))
        self.bristles, self.stribeck = elements([bristles], axes), elements([stribeck], axes)
        self.second_masses = [own for function, own in self.loads if function is second_mass]
        for own in self.second_masses:
            own.position, own.velocity = np.zeros(len(own.lanes)), np.zeros(len(own.lanes))
        bandwidth = 2 * np.pi * self.bandwidth
        self.stiffness, self.damping = self.mass * bandwidth**2, 2 * DAMPING_RATIO * bandwidth * self.mass
        self.has_velocity_loop = np.array(["velocity_loop" in axis for axis in axes])
        self.stiffness[self.has_velocity_loop] = bandwidth[self.has_velocity_loop]
        self.damping[self.has_velocity_loop] = 0
        self.hold = np.array([lane["hold"] for lane in lanes])
        self.delay_steps = np.round(self.delay / STEP).astype(int)
        self.past = np.zeros((self.delay_steps.max() + 1, len(lanes)))
        self.every = np.arange(len(lanes))
        self.held, self.position, self.velocity = (np.zeros(len(lanes)) for _ in range(3))

    def command(self, feedforward, position, velocity):
        """Command of the controller: feedforward with PD feedback, or with P feedback for a velocity setpoint."""
        return feedforward + self.stiffness * (position - self.position) + self.damping * (velocity - self.velocity)

    def sampled(self, command, grid):
        """Zero-order hold of the lanes that have one; `grid` is the grid sample at its first step, None otherwise."""
        if not self.hold.any():
            return command
        holds = self.hold > 0
        if grid is not None:
            taken = holds & (grid % np.maximum(self.hold, 1) == 0)
            self.held[taken] = command[taken]
        return np.where(holds, self.held, command)

    def driven(self, command, number):
        """Force of the drive: delay, input chain and gain."""
        self.past[number % len(self.past)] = command
        force = self.past[(number - self.delay_steps) % len(self.past), self.every]
        for function, own in self.chain:
            force[own.lanes] = function(own, self, force[own.lanes])
        return force * self.gain

    def step(self, command, disturbance, number):
        """One integration step; Coulomb friction acts last and can stop the mass."""
        self.time = number * STEP
        self.drive = self.driven(command, number)
        self.inertia = self.mass.copy()
        force = self.drive + self.constant + disturbance - self.viscous * self.velocity
        for function, own in self.loads:
            force[own.lanes] += function(own, self)
        self.friction = self.coulomb.copy()
        for function, own in self.stribeck:
            self.friction[own.lanes] += function(own, self)
        for function, own in self.bristles:
            force[own.lanes] += function(own, self)
            self.friction[own.lanes] = 0
        free = self.velocity + STEP * force / self.inertia
        self.direction = np.sign(free)
        for function, own in self.sliding:
            self.friction[own.lanes] += function(own, self)
        velocity = stopped(free, STEP * np.maximum(self.friction, 0) / self.inertia)
        self.position = self.position + STEP * 0.5 * (self.velocity + velocity)
        self.velocity = velocity

    def measured(self):
        """Position at the encoder, which is on the motor or on the load."""
        position = self.position.copy()
        for own in self.second_masses:
            position[own.lanes] = np.where(own.encoder_on_load > 0, own.position, position[own.lanes])
        return position


def disturbances(lanes, count):
    """Random force of each lane: first-order low-pass noise, an array of count x lanes."""
    kept = np.exp(-1 / DISTURBANCE_SAMPLES)
    made = []
    for lane in lanes:
        white = np.random.default_rng(lane["seed"] + 77).standard_normal(count) * np.sqrt(1 - kept**2)
        made.append(lfilter([1], [1, -kept], white) * float(lane["axis"].get("disturbance", 0)))
    return np.stack(made, 1)


def simulate(lanes, count):
    """Commands and measured positions at GRID_HZ, arrays of count x lanes."""
    axes = Axes(lanes)
    position, velocity, acceleration = (np.stack([lane["reference"][k] for lane in lanes], 1) for k in range(3))
    feedforward = np.where(axes.has_velocity_loop, velocity, axes.mass * acceleration + axes.viscous * velocity)
    disturbance = disturbances(lanes, count)
    commands, positions = np.zeros((count, len(lanes))), np.zeros((count, len(lanes)))
    for grid in range(count):
        following = min(grid + 1, count - 1)
        rise = (feedforward[following] - feedforward[grid]) / SUBSTEPS
        for substep in range(SUBSTEPS):
            part = substep / SUBSTEPS
            between = lambda values: values[grid] * (1 - part) + values[following] * part
            command = axes.command(feedforward[grid] + rise * substep, between(position), between(velocity))
            command = axes.sampled(command, grid if substep == 0 else None)
            if substep == 0:
                commands[grid], positions[grid] = command, axes.measured()
            axes.step(command, disturbance[grid], grid * SUBSTEPS + substep)
    return commands, positions


# Cases: accepted answers, machines and the list.


def answer(verdicts, must=(), may=()):
    """Accepted answer; a group of `must` is a text such as 'drive.lag1 or drive.current_loop'."""
    return {"verdict_any_of": verdicts, "must_name_any_of": [own.split(" or ") for own in must], "may_name": list(may)}


def named(*groups):
    """One effect of each group must be identified."""
    return answer(["named", "ambiguous"], must=groups)


def or_named(verdict, *effects):
    """The verdict, or any of the effects."""
    return answer([verdict, "named", "ambiguous"], may=effects)


def changed(effect):
    """The effect, or a change of it where the base twin has a part of it, such as the delay of a zero-order hold."""
    return answer(["named", "ambiguous", "refit_only"], must=[effect])


NONE = answer(["none"])
UNEXPLAINED = answer(["unexplained"])
REFIT = answer(["refit_only"])

RICH = [moves, partial(chirp, high=6), slow_moves, multisine, partial(noise, low=0.3, high=5), slow_moves]
GENTLE = [
    moves, partial(chirp, low=0.05, high=1.5), slow_moves, partial(multisine, low=0.05, high=1.2),
    partial(noise, high=1.2), moves,
]  # fmt: skip
CREEPING = [slow_moves, moves, slow_moves, partial(chirp, low=0.2, high=3), slow_moves, moves]
FINE = [moves, slow_moves, partial(multisine, low=0.3, high=9), slow_moves, partial(noise, low=1, high=10), slow_moves]
FINE_SHORT = [moves, slow_moves, partial(multisine, low=0.3, high=6), slow_moves, slow_moves]
HEATING = [slow_moves, moves, slow_moves, multisine, slow_moves, moves]
OTHER = [multisine, moves, partial(noise, low=0.3, high=5)]


def fast(high):
    """Motion for resonances up to `high` (Hz)."""
    return [moves, partial(chirp, low=0.3, high=high), slow_moves, partial(noise, low=1, high=high), moves]


# A machine: units of input and position, axis, reach (position units) and speed (per s) of the motion, parts of the
# motion, low-pass filter of the reference (Hz), sampling rate (Hz), encoder step (position units), standard deviation
# of the noise of the recorded input, factor of the recorded position, changes in the second session, base case.
COMMON = {"position_unit": "rad", "motion": RICH, "low_pass_hz": 12.0, "scale": 1.0, "second": {}, "base": None}
STAGE = {
    **COMMON, "unit": "N", "position_unit": "m", "reach": 0.25, "speed": 0.6, "rate": 500, "encoder": 1e-6,
    "input_noise": 0.4, "axis": {"mass": 12, "viscous": 15, "coulomb": 6, "disturbance": 0.4},
}  # fmt: skip
GEAR_MOTOR = {
    **COMMON, "unit": "V", "reach": 6, "speed": 12, "rate": 200, "encoder": TURN / 8192, "input_noise": 0.03,
    "axis": {"mass": 0.08, "viscous": 0.35, "coulomb": 0.6, "disturbance": 0.03},
}  # fmt: skip
CURRENT_JOINT = {
    **COMMON, "unit": "A", "reach": 1.5, "speed": 6, "rate": 1000, "encoder": 1e-5, "input_noise": 0.03,
    "axis": {"mass": 0.02, "viscous": 0.05, "coulomb": 0.3, "disturbance": 0.02},
}  # fmt: skip
TORQUE_JOINT = {
    **COMMON, "unit": "N m", "reach": 2, "speed": 4, "rate": 250, "encoder": TURN / 65536, "input_noise": 0.04,
    "axis": {"mass": 0.4, "viscous": 0.3, "coulomb": 0.4, "disturbance": 0.04},
}  # fmt: skip
FAN = {
    **COMMON, "unit": "N m", "motion": GENTLE, "low_pass_hz": 4.0, "rate": 100, "input_noise": 0.05, "scale": 1 / TURN,
}  # fmt: skip


CARRIAGE = {
    **COMMON, "unit": "m/s", "position_unit": "m", "reach": 0.25, "speed": 0.6, "rate": 500, "encoder": 2e-6,
    "input_noise": 0.001, "axis": {
        "mass": 4, "viscous": 6, "coulomb": 8, "disturbance": 0.4, "bandwidth": 1,
        "velocity_loop": {"proportional": 80, "integral": 0}},
}  # fmt: skip
WHEEL = {
    **COMMON, "unit": "rad/s", "reach": 8, "speed": 15, "rate": 200, "encoder": TURN / 16384, "input_noise": 0.01,
    "axis": {
        "mass": 0.02, "viscous": 0.01, "coulomb": 0.15, "disturbance": 0.01, "bandwidth": 1,
        "velocity_loop": {"proportional": 40, "integral": 0}},
}  # fmt: skip


def case(name, truth, accepted, machine, axis=None, **changes):
    """A machine with other axis parameters and other fields; the name seeds its random numbers."""
    fields = {**machine, **changes, "axis": {**machine.get("axis", {}), **(axis or {})}}
    return {"name": name, "truth": truth, "null": truth.startswith("null"), "answer": accepted, **fields}


def body(mass, viscous, coulomb, disturbance, **others):
    """Parameters of an axis."""
    return {"mass": mass, "viscous": viscous, "coulomb": coulomb, "disturbance": disturbance, **others}


def null_cases():
    """Axes without any effect."""
    return [
        case("n1_lin", "null: linear stage", NONE, STAGE),
        case("n2_dcV", "null: zero-order hold, 2048 counts", NONE, GEAR_MOTOR, encoder=TURN / 2048, input_noise=0.02,
             zero_order_hold=True),
        case("n3_jA", "null: position in degrees", NONE, CURRENT_JOINT, scale=DEGREES),
        case("n4_turn", "null: position in turns, validation with 3 times the noise and another motion", NONE, FAN,
             body(0.5, 0.8, 1.2, 0.05), reach=10, speed=8, encoder=TURN / 65536,
             second={"input_noise": 0.15, "motion": [moves, slow_moves]}),
        case("n6_creep", "null: creeping, dwells", NONE, STAGE, body(8, 12, 5, 0.1), reach=0.15, speed=0.3,
             motion=CREEPING, rate=200, encoder=5e-6, input_noise=0.2),
        case("n7_dwell", "null: dwells", NONE, CURRENT_JOINT, body(0.03, 0.04, 0.35, 0.005), reach=2, speed=4,
             motion=[moves, slow_moves, multisine, moves], rate=250, encoder=TURN / 16384, input_noise=0.02),
        case("n8_zoh", "null: zero-order hold, a delay of 0.5 ms", NONE, TORQUE_JOINT, body(0.2, 0.3, 0.8, 0.02),
             reach=1.5, rate=1000, encoder=1e-5, input_noise=0.03, zero_order_hold=True),
        case("n9_white", "null: no disturbance, position in degrees", NONE, CURRENT_JOINT, {"disturbance": 0},
             scale=DEGREES),
        case("n10_load", "null: low noise", NONE, STAGE, body(3, 4, 1.5, 0.03), reach=0.1, speed=0.3,
             motion=[noise, slow_moves, moves, multisine, slow_moves], encoder=5e-7, input_noise=0.03),
        case("n11_vnoise", "null: 1000 counts", NONE, GEAR_MOTOR, body(0.1, 0.6, 0.9, 0.02), reach=8, speed=6,
             motion=GENTLE, rate=100, encoder=TURN / 1000, low_pass_hz=4.0),
    ]  # fmt: skip


def friction_cases():
    """One effect: friction."""
    return [
        case("s01_asym", "asymmetric friction, 10 N and 20 N s/m, position in mm", named("drive.friction.asymmetric"),
             STAGE, body(25, 60, 12, 0.5, asymmetry={"coulomb": 10, "viscous": 20}), input_noise=0.5, scale=1000),
        case("s02_strib", "Stribeck 0.6 N m, 0.15 rad/s", named("drive.friction.stribeck"), TORQUE_JOINT,
             body(0.15, 0.2, 0.8, 0.02, stribeck={"extra": 0.6, "speed": 0.15}), reach=1.5, speed=3, rate=500,
             encoder=2e-5, input_noise=0.02),
        case("s03_lugre", "LuGre 8 N, 200 um", named("drive.friction.presliding"), STAGE,
             body(10, 20, 8, 0.15, bristles={"stiffness": 8 / 200e-6, "damping": 400}), reach=0.2, speed=0.4,
             motion=FINE, rate=1000, encoder=1e-7, input_noise=0.2),
        case("s04_dahl", "Dahl 0.8 V, 0.02 rad", named("drive.friction.presliding"), GEAR_MOTOR,
             body(0.05, 0.2, 0.8, 0.02, bristles={"stiffness": 40, "damping": 0}), reach=3, speed=8, rate=500,
             encoder=1e-4),
        case("s11_quad", "quadratic drag 0.03 N m s^2/rad^2, position in turns", named("drive.friction.quadratic"), FAN,
             body(0.5, 0.2, 0.3, 0.03, quadratic_drag={"coefficient": 0.03}), reach=40, speed=15, encoder=TURN / 4096),
        case("s21_load", "load friction 0.3", named("drive.friction.load"), TORQUE_JOINT,
             {"load_friction": {"fraction": 0.3}}),
        case("s23_fpos", "friction 12 N + 35 N/m * position", named("drive.friction.position"), STAGE,
             {"coulomb": 12, "friction_slope": {"slope": 35}}, rate=250, encoder=2e-6),
        case("s24_therm", "friction falls by 0.7 of 1.2 N m within 12 s", named("drive.friction.thermal_drift"),
             TORQUE_JOINT, body(0.1, 0.2, 1.2, 0.03, warm_up={"change": -0.7, "time": 12}), motion=HEATING,
             input_noise=0.03),
        # A part of the base model: half of the difference of the directions equals an offset.
        case("s31_asymC", "asymmetric Coulomb friction, 9 and 3 N", NONE, STAGE,
             {"asymmetry": {"coulomb": 6, "viscous": 0}}, rate=250, encoder=2e-6),
    ]  # fmt: skip


def drive_cases():
    """One effect: the input chain."""
    lags = "drive.lag1 or drive.current_loop"
    slew = or_named("unexplained", "drive.saturation.slew")
    return [
        case("s06_db", "dead band 1.5 V", named("drive.input_deadband"), GEAR_MOTOR,
             {"dead_band": {"width": 1.5, "lost": 1}}),
        case("s30_dbjump", "dead band 1.6 V with a jump", named("drive.input_deadband"), GEAR_MOTOR,
             {"dead_band": {"width": 1.6, "lost": 0}, "bandwidth": 2}, rate=250, encoder=TURN / 16384),
        case("s07_delay", "delay 8 ms, and 1 ms of the zero-order hold", named("drive.delay"), CURRENT_JOINT,
             {"delay": 0.008}, rate=500, encoder=2e-5, input_noise=0.02, zero_order_hold=True),
        case("s18_lat", "latency 12 ms of the position", named("drive.delay"), STAGE, latency_ms=12),
        case("s08_lag", "lag 15 ms", named(lags), STAGE, {"lag": {"time": 0.015}}, rate=250),
        case("s29_lag3", "lag 4 ms", named(lags), CURRENT_JOINT, {"lag": {"time": 0.004}},
             motion=[moves, partial(chirp, low=0.5, high=12), partial(noise, low=1, high=12), slow_moves],
             encoder=5e-6, input_noise=0.02, low_pass_hz=25.0),
        case("s09_slew", "slew limit 60 V/s", slew, GEAR_MOTOR, {"slew_limit": {"rate": 60}, "bandwidth": 1.5},
             speed=10, rate=250),
        case("s32_slew2", "slew limit 150 V/s", slew, GEAR_MOTOR, {"slew_limit": {"rate": 150}, "bandwidth": 2},
             speed=10, rate=500, encoder=TURN / 65536, low_pass_hz=15.0),
        case("s10_sat", "saturation 5.5 V", named("drive.saturation.speed or drive.saturation.torque_speed"),
             GEAR_MOTOR, {"saturation": {"limit": 5.5}, "bandwidth": 2}, speed=14),
        case("s25_tspd", "torque limit 2.2 A that falls to zero at 18 rad/s", named("drive.saturation.torque_speed"),
             CURRENT_JOINT, {"torque_speed": {"torque": 2.2, "speed": 18}, "bandwidth": 2}, reach=3, speed=9, rate=250,
             encoder=TURN / 65536),
    ]  # fmt: skip


def load_cases():
    """One effect: forces of the position, and a second mass."""
    backlash, waves = or_named("unexplained", "drive.backlash"), ("gantry.gravity", "drive.ripple.motor", "gantry.stiffness")
    small = {"stiffness": 500, "damping": 0.5}
    soft = {"backlash": 0, "encoder_on_load": False}
    return [
        case("s12_spring", "spring 150 N/m about 0.03 m", named("gantry.stiffness"), STAGE,
             body(5, 10, 2, 0.2, spring={"stiffness": 150, "rest": 0.03}), reach=0.2, speed=0.5, rate=200,
             input_noise=0.3, low_pass_hz=6.0),
        case("s13_stop", "end stop above 0.17 m, 5 N/mm, position in mm", named("gantry.endstop"), STAGE,
             {"end_stop": {"stiffness": 5000, "start": 0.17}}, rate=1000, scale=1000),
        case("s14_cog", "cogging 0.15 A, 14 per turn, position in turns", named("drive.ripple.motor"), CURRENT_JOINT,
             {"cogging": {"amplitude": 0.15, "per_turn": 14, "phase": 0.7}}, reach=3, encoder=2e-6, scale=1 / TURN),
        case("s15_pend", "pendulum 4 N m, to 137 degrees", or_named("unexplained", *waves), TORQUE_JOINT,
             body(0.3, 0.1, 0.3, 0.03, gravity={"torque": 4}), reach=2.4, rate=200, input_noise=0.03),
        case("s28_pend40", "pendulum 3 N m, to 40 degrees, position in degrees", or_named("unexplained", *waves),
             TORQUE_JOINT, body(0.2, 0.1, 0.2, 0.02, gravity={"torque": 3}), reach=0.7, speed=2.5, encoder=1e-5,
             input_noise=0.02, scale=DEGREES),
        # A part of the base model: a constant force is an offset.
        case("s17_tilt", "constant force -20 N", NONE, STAGE, {"constant": -20}, rate=250, encoder=5e-6),
        case("s22_mpos", "inertia 0.4 * (1 + 0.22 * position)", named("gantry.mass_position"), TORQUE_JOINT,
             {"mass_slope": {"slope": 0.22}}),
        case("s05_backl", "backlash 0.03 rad, encoder on the motor", backlash, TORQUE_JOINT,
             body(0.02, 0.02, 0.1, 0.005, second_mass={
                 "mass": 0.03, "coulomb": 0.15, "backlash": 0.03, "encoder_on_load": False, **small}),
             speed=5, rate=1000, input_noise=0.01),
        case("s26_blload", "backlash 0.05 rad, encoder on the load", backlash, TORQUE_JOINT,
             body(0.03, 0.02, 0.1, 0.005, second_mass={
                 "mass": 0.02, "coulomb": 0.2, "backlash": 0.05, "encoder_on_load": True, **small}),
             rate=500, encoder=1e-5, input_noise=0.01),
        case("s16_2mass", "two masses, resonance 6 Hz, encoder on the motor", named("drive.compliance.belt"), TORQUE_JOINT,
             body(0.05, 0.1, 0.2, 0.01, second_mass={
                 "mass": 0.1, "coulomb": 0, "stiffness": 47, "damping": 0.05, **soft}),
             reach=1.5, motion=fast(12), rate=500, encoder=1e-5, input_noise=0.01, low_pass_hz=20.0),
        case("s27_flload", "two masses, resonance 6.3 Hz, encoder on the load", named("drive.compliance.belt"), TORQUE_JOINT,
             body(0.1, 0.1, 0.2, 0.01, second_mass={
                 "mass": 0.08, "coulomb": 0.05, "stiffness": 70, "damping": 0.08, **soft, "encoder_on_load": True}),
             reach=1.5, motion=fast(8), rate=500, encoder=1e-5, input_noise=0.01, low_pass_hz=20.0),
    ]  # fmt: skip


def record_cases():
    """A flaw of the record instead of the axis."""
    return [
        case("s19_jit", "time jitter of 25 % of a sample", answer(["none", "unexplained"]), GEAR_MOTOR, jitter=0.25),
        case("s20_drop", "3 % of the rows and 3 times 0.2 s dropped", NONE, STAGE, dropped=0.03),
    ]  # fmt: skip


def pair_cases():
    """Two effects."""
    return [
        case("t1_delcog", "delay 6 ms, cogging 0.15 A, 9 per turn", named("drive.delay", "drive.ripple.motor"),
             CURRENT_JOINT, {"delay": 0.006, "cogging": {"amplitude": 0.15, "per_turn": 9, "phase": 0}}, reach=3,
             encoder=2e-6),
        case("t2_spq", "spring 60 N/m, quadratic drag 25 N s^2/m^2",
             named("gantry.stiffness", "drive.friction.quadratic"), STAGE,
             body(5, 4, 2, 0.2, spring={"stiffness": 60, "rest": 0}, quadratic_drag={"coefficient": 25}), speed=0.8,
             rate=200, input_noise=0.3, low_pass_hz=6.0),
        case("t3_tildb", "dead band 1.5 V, constant force 1 V",
             named("drive.input_deadband", "gantry.tilt or drive.offset"), GEAR_MOTOR,
             {"dead_band": {"width": 1.5, "lost": 1}, "constant": 1}, rate=250, encoder=TURN / 16384),
        case("t4_quadcog", "quadratic drag 0.01 A s^2/rad^2, cogging 0.12 A, 6 per turn",
             named("drive.friction.quadratic", "drive.ripple.motor"), CURRENT_JOINT,
             body(0.02, 0.03, 0.2, 0.01, quadratic_drag={"coefficient": 0.01},
                  cogging={"amplitude": 0.12, "per_turn": 6, "phase": 0}),
             reach=8, speed=10, rate=500, input_noise=0.02),
        case("t5_lustr", "LuGre 8 N, 100 um, Stribeck 5 N, 0.01 m/s",
             named("drive.friction.presliding", "drive.friction.stribeck"), STAGE,
             body(10, 20, 8, 0.1, bristles={"stiffness": 8 / 100e-6, "damping": 300},
                  stribeck={"extra": 5, "speed": 0.01}),
             reach=0.2, speed=0.3, motion=FINE_SHORT, rate=1000, encoder=1e-7, input_noise=0.15),
    ]  # fmt: skip


def twin_cases():
    """A linear stage, and changes of it that gap compares with its twin."""
    after = {**STAGE, "base": "b0_base"}
    return [
        case("b0_base", "null: base of the twin", NONE, STAGE),
        case("b1_null", "null: other motion and noise", NONE, after, motion=OTHER, input_noise=0.6),
        case("b2_mass", "mass 12 -> 16.2 kg", answer(["refit_only", "named", "ambiguous"], must=["gantry.inertia"]),
             after, {"mass": 16.2}),
        case("b3_coul", "Coulomb friction 6 -> 11 N", answer(["refit_only"], must=["drive.friction.coulomb"]), after,
             {"coulomb": 11}),
        case("b4_gain", "gain 1 -> 0.8", or_named("refit_only", "drive.gain"), after, {"gain": 0.8}),
        case("b5_scale", "scale of the position 1.12", REFIT, after, scale=1.12),
        case("b6_mtest", "mass 16.2 kg in the validation session only", UNEXPLAINED, STAGE,
             second={"axis": {"mass": 16.2}}),
        case("b7_delay", "delay 10 ms", changed("drive.delay"), after, {"delay": 0.01}),
        case("b8_tilt", "constant force -8 N", or_named("refit_only", "gantry.tilt", "drive.offset"), after,
             {"constant": -8}),
        case("b9_asym", "asymmetric Coulomb friction, 9 and 3 N",
             or_named("refit_only", "drive.offset", "drive.friction.asymmetric"), after,
             {"asymmetry": {"coulomb": 6, "viscous": 0}}),
    ]  # fmt: skip


def velocity_cases():
    """Axes with a velocity setpoint."""
    after = {**CARRIAGE, "base": "v0_base"}
    loop = lambda proportional, integral: {"velocity_loop": {"proportional": proportional, "integral": integral}}
    return [
        case("v0_base", "null: velocity setpoint, proportional loop", NONE, CARRIAGE),
        case("v1_wheel", "null: proportional loop of a wheel", NONE, WHEEL),
        case("v2_hold", "null: zero-order hold", NONE, WHEEL, rate=250, zero_order_hold=True),
        case("v3_fast", "null: fast loop with integral action", NONE, CARRIAGE,
             loop(600, 90000)),
        case("v4_loop", "null: loop of 6 Hz with damping ratio 0.7", NONE, WHEEL, loop(53, 1420)),
        case("v5_loop", "null: loop of 10 Hz with damping ratio 2", NONE, CARRIAGE, loop(251, 3950)),
        case("v6_delay", "delay 20 ms", named("drive.delay"), CARRIAGE, {"delay": 0.02}),
        case("v7_band", "dead band 0.05 m/s", named("drive.input_deadband"), CARRIAGE,
             {"coulomb": 1, "dead_band": {"width": 0.05, "lost": 0}}),
        case("v8_limit", "limit of the setpoint 9 rad/s", named("drive.saturation.speed"), WHEEL,
             {"saturation": {"limit": 9}}),
        case("v9_slew", "slew limit 60 rad/s^2", named("drive.saturation.slew"), WHEEL, {"slew_limit": {"rate": 60}}),
        case("v10_strib", "Stribeck 0.3 N m, 0.4 rad/s", named("drive.friction.stribeck"), WHEEL,
             {"stribeck": {"extra": 0.3, "speed": 0.4}}),
        case("v11_cog", "cogging 0.15 N m, 11 per turn", named("drive.ripple.motor"), WHEEL,
             {"cogging": {"amplitude": 0.15, "per_turn": 11, "phase": 0.4}}, speed=6),
        case("v12_spring", "spring 150 N/m", named("gantry.stiffness"), CARRIAGE,
             {"spring": {"stiffness": 150, "rest": 0}}),
        case("v13_scale", "scale of the position 0.85",
             answer(["refit_only", "named", "ambiguous"], must=["drive.gain or drive.friction.viscous"]), after,
             scale=0.85),
        case("v14_slow", "proportional gain 80 -> 40 1/s",
             answer(["refit_only"], must=["drive.velocity_controller"]), after, loop(40, 0)),
        case("v15_null", "null: other motion and noise", NONE, after, motion=OTHER, input_noise=0.002),
        case("v16_late", "delay 15 ms after the base", changed("drive.delay"), after, {"delay": 0.015}),
        case("v17_two", "delay 15 ms, dead band 0.06 m/s", named("drive.delay", "drive.input_deadband"), CARRIAGE,
             {"coulomb": 1, "delay": 0.015, "dead_band": {"width": 0.06, "lost": 0}}),
    ]  # fmt: skip


def all_cases():
    """The cases in the order in which they are made and run."""
    parts = [null_cases, friction_cases, drive_cases, load_cases, record_cases, twin_cases, pair_cases, velocity_cases]
    return [own for part in parts for own in part()]


# Making.


def session_of(case, number):
    """The case as it is in its session `number`, 0 or 1."""
    changes = case["second"] if number == 1 else {}
    return {**case, **changes, "axis": {**case["axis"], **changes.get("axis", {})}}


def varied(axis, machine, variant):
    """The axis with another mass and other frictions; a base case and its changes have the same factors."""
    if variant == 0:
        return axis
    rng = np.random.default_rng([variant, zlib.crc32(machine.encode())])
    factors = {name: np.exp(rng.uniform(np.log(0.7), np.log(1.4))) for name in ("mass", "viscous", "coulomb")}
    return {**axis, **{name: axis[name] * factors[name] for name in factors if name in axis}}


def lane_of(case, number, variant):
    """One session for the simulator; `hold` is the period of the zero-order hold in grid samples, or 0."""
    seed = (zlib.crc32(case["name"].encode()) % 100000 + variant * 100003) * 10 + number
    session = session_of(case, number)
    session["axis"] = varied(session["axis"], case["base"] or case["name"], variant)
    hold = GRID_HZ // session["rate"] if session.get("zero_order_hold") else 0
    path = reference(session, np.random.default_rng(seed))
    return {"case": session, "number": number, "axis": session["axis"], "hold": hold, "seed": seed, "reference": path}


def recorded(lane, command, position):
    """Rows of time (s), input and position as the instruments record them."""
    case, rng = lane["case"], np.random.default_rng(lane["seed"] + 5)
    rate, encoder = case["rate"], case["encoder"]
    grid = np.arange(len(command)) / GRID_HZ
    time = np.arange(0, len(command) - 1, GRID_HZ // rate) / GRID_HZ
    sampled = time
    if "jitter" in case:
        sampled = time + rng.uniform(-case["jitter"], case["jitter"], len(time)) / rate
    command = np.interp(sampled, grid, command) + rng.standard_normal(len(time)) * case["input_noise"]
    position = np.interp(sampled - case.get("latency_ms", 0) / 1000, grid, position)
    counts = np.round((position + rng.standard_normal(len(time)) * encoder * ENCODER_NOISE) / encoder)
    rows = np.stack([time, command, counts * encoder * case["scale"]], 1)
    if "dropped" not in case:
        return rows
    kept = rng.uniform(size=len(time)) > case["dropped"]
    for start in rng.integers(500, len(time) - 500, 3):
        kept[start : start + rate // 5] = False
    return rows[kept]


def selected(cases, patterns):
    """The cases that match a pattern, or all."""
    chosen = [own for own in cases if not patterns or any(fnmatch.fnmatch(own["name"], p) for p in patterns)]
    return chosen or sys.exit("no case matches")


def make(out, patterns, variant):
    """Writes cases.json, simulates the chosen cases and writes their sessions."""
    out.mkdir(parents=True, exist_ok=True)
    cases = all_cases()
    fields = ("name", "truth", "null", "unit", "position_unit", "base", "axis", "answer")
    listed = [{field: own[field] for field in fields} for own in cases]
    (out / "cases.json").write_text(json.dumps(listed, indent=1) + "\n")
    lanes = [lane_of(own, number, variant) for own in selected(cases, patterns) for number in range(SESSIONS)]
    commands, positions = simulate(lanes, SECONDS * GRID_HZ)
    for index, lane in enumerate(lanes):
        path = out / f"{lane['case']['name']}-{lane['number'] + 1}.csv"
        with open(path, "w") as file:
            file.write("t,u,pos\n")
            for time, command, position in recorded(lane, commands[:, index], positions[:, index]):
                file.write(f"{time:.10g},{command:.7g},{position:.11g}\n")
        print(path, flush=True)


# Running.


def timed(command, log):
    """Runs a command: exit status and its own CPU time (s), which is right for parallel commands as well."""
    with open(log, "a") as file:
        process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, usage.ru_utime + usage.ru_stime


def gap(program, data, results, case):
    """gap.json of one case, or None if a command failed, and the CPU time of gap (s)."""
    folder = results / case["name"]
    folder.mkdir(parents=True, exist_ok=True)
    log = folder / "log.txt"
    log.unlink(missing_ok=True)
    recordings = []
    for number in range(1, SESSIONS + 1):
        name = f"{case['name']}-{number}"
        recordings.append(folder / f"{name}.mcap")
        command = [program, "import", "csv", data / f"{name}.csv", "--time", "t", "--input", f"u:{case['unit']}"]
        command += ["--position", "pos", "--position-unit", case["position_unit"], "-o", recordings[-1], "--overwrite"]
        if timed(command, log)[0]:
            return None, 0.0
    command = [program, "gap", *recordings, "-o", folder / "gap", "--overwrite", "--threads", "1", "--quiet"]
    command += ["--twin", results / case["base"] / "gap" / "twin.json"] if case["base"] else []
    status, seconds = timed(command, log)
    return (json.loads((folder / "gap" / "gap.json").read_text()) if status in (0, 3) else None), seconds


def judged(case, found, seconds):
    """The result of one case; a failed command counts as not right."""
    found = found or {"verdict": "failed, see log.txt", "effects": [], "parameter_changes": []}
    names = [effect["name"] for effect in found["effects"]]
    changes = [change["name"] for change in found["parameter_changes"]]
    wanted = case["answer"]
    accepted = {name for group in wanted["must_name_any_of"] for name in group} | set(wanted["may_name"])
    present = {*names, *(change.rsplit(".", 1)[0] for change in changes)}
    wrong = [name for name in names if name not in accepted]
    complete = all(present & set(group) for group in wanted["must_name_any_of"])
    right = found["verdict"] in wanted["verdict_any_of"] and complete
    return {
        "case": case["name"], "null": case["null"], "truth": case["truth"], "answer": wanted,
        "grade": "wrong" if wrong else "right" if right else "not right", "verdict": found["verdict"], "names": names,
        "wrong_names": wrong, "changed": changes, "cpu_s": round(seconds, 1),
    }  # fmt: skip


def counted(rows, condition):
    """Cases that meet the condition, of n, with the exact Clopper-Pearson 95 % interval of their fraction."""
    count = sum(map(condition, rows))
    if not rows:
        return {"count": 0, "n": 0, "ci95": None}
    interval = binomtest(count, len(rows)).proportion_ci()
    return {"count": count, "n": len(rows), "ci95": [round(interval.low, 3), round(interval.high, 3)]}


def summarized(rows):
    """The counts of all cases."""
    has_wrong_name = lambda row: bool(row["wrong_names"])
    return {
        "nulls_with_wrong_name": counted([row for row in rows if row["null"]], has_wrong_name),
        "right": counted(rows, lambda row: row["grade"] == "right"),
        "cases_with_wrong_name": counted(rows, has_wrong_name),
        "wrong_names": sum(len(row["wrong_names"]) for row in rows),
        "cpu_s": round(sum(row["cpu_s"] for row in rows), 1),
    }


def run(program, data, results, patterns, jobs):
    """Base cases first, then the others; a base that was not chosen is run, but not counted."""
    results.mkdir(parents=True, exist_ok=True)
    listed = json.loads((data / "cases.json").read_text())
    made = {own["name"]: own for own in listed if (data / f"{own['name']}-{SESSIONS}.csv").exists()}
    chosen = selected(made.values(), patterns)
    bases = {own["base"] for own in chosen if own["base"]}
    if bases - set(made):
        sys.exit(f"missing base case in {data}: {', '.join(bases - set(made))}")
    rows = []
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        for part in ([made[name] for name in bases], [own for own in chosen if own["name"] not in bases]):
            for own, (found, seconds) in zip(part, pool.map(partial(gap, program, data, results), part)):
                if found is None and own["name"] in bases:
                    sys.exit(f"{own['name']}: no twin, see {results / own['name'] / 'log.txt'}")
                if own not in chosen:
                    continue
                row = judged(own, found, seconds)
                rows.append(row)
                print(f"{row['grade']:<10}{row['case']:<12}{seconds:5.1f} s  {row['truth']} -> {row['verdict']} "
                      f"{', '.join(row['names'] + row['changed'])}", flush=True)  # fmt: skip
                (results / "cases-results.json").write_text(json.dumps(rows, indent=1) + "\n")
    summary = summarized(rows)
    (results / "summary.json").write_text(json.dumps(summary, indent=1) + "\n")
    for name, value in summary.items():
        own = value if isinstance(value, dict) else None
        print(f"{name}: " + (f"{own['count']} of {own['n']}, 95 % interval {own['ci95']}" if own else f"{value}"))


def main():
    """Parses the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    maker = commands.add_parser("make", help="simulate the cases")
    maker.add_argument("out", type=Path)
    maker.add_argument("--case", action="append", help="name or pattern (repeatable)")
    maker.add_argument("--seed", type=int, default=0, help="seed of motions, noise and axes")
    runner = commands.add_parser("run", help="run gap on the cases")
    runner.add_argument("program")
    runner.add_argument("data", type=Path)
    runner.add_argument("results", type=Path)
    runner.add_argument("--case", action="append", help="name or pattern (repeatable)")
    runner.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if args.command == "make":
        make(args.out, args.case, args.seed)
    else:
        run(args.program, args.data, args.results, args.case, args.jobs)


if __name__ == "__main__":
    main()
