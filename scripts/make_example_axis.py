#!/usr/bin/env python3
"""Makes CSV recordings of a simulated linear axis with known hidden effects: scripts/make_example_axis.py DIR

Writes axis-1.csv and axis-2.csv: two sessions of 40 s at 1 kHz with the columns t_s, force_n and position_m.
The simulator shares no code with klasktron and needs the Python standard library only. The axis follows

    M dv/dt = F - Fv v - Fc sign(v) + disturbance + hidden effects,

under position control, along strokes of several speeds in both directions. `TRUTH` lists the hidden effects under
the names of klasktron's catalogue, each with its size. Equal output for equal versions of Python: the random numbers have fixed seeds.
"""

import collections
import csv
import math
import random
import sys
from pathlib import Path

RATE_HZ = 1000
STEPS_PER_SAMPLE = 10
DURATION_S = 40

MASS_KG = 60.0
VISCOUS_N_S_PER_M = 110.0
COULOMB_N = 16.0

# Hidden effects. The force is held between two samples, which adds half a sample of delay. The ripple has the period
# of one turn of the motor's pulley.
LOAD_FRACTION = 0.1
RIPPLE_N, RIPPLE_PERIOD_M = 4.0, 0.04
DELAY_SAMPLES = 3
PRESLIDING_M = 2e-5
TRUTH = {
    "drive.delay": [(DELAY_SAMPLES + 0.5) / RATE_HZ],
    "drive.friction.load": [LOAD_FRACTION],
    "drive.friction.presliding": [COULOMB_N, PRESLIDING_M],
    "drive.ripple.motor": [RIPPLE_N],
}

# Noise: an encoder with 0.1 um, and a correlated force (AR(1)) that no model explains.
ENCODER_M = 1e-7
DISTURBANCE_N, DISTURBANCE_CORRELATION = 1.0, 0.7

POSITION_GAIN_PER_S = 60.0
VELOCITY_GAIN_N_S_PER_M = 140.0 * MASS_KG
ACCELERATION_M_PER_S2 = 3.0


def stroke(path, length, speed):
    """Append a trapezoidal move of `length` (m) at `speed` (m/s) to the reference `path` (m at 1 kHz)."""
    start, distance = path[-1], abs(length)
    speed = min(speed, math.sqrt(ACCELERATION_M_PER_S2 * distance))
    rise = speed / ACCELERATION_M_PER_S2
    duration = distance / speed + rise
    for step in range(1, math.ceil(duration * RATE_HZ) + 1):
        time = min(step / RATE_HZ, duration)
        left = duration - time
        if time < rise:
            moved = ACCELERATION_M_PER_S2 * time**2 / 2
        elif left < rise:
            moved = distance - ACCELERATION_M_PER_S2 * left**2 / 2
        else:
            moved = speed * (time - rise / 2)
        path.append(start + math.copysign(moved, length))


def reference(draw):
    """Return strokes of 4 to 350 mm/s in both directions with short rests (m at 1 kHz)."""
    path, number = [0.0], 0
    while len(path) < DURATION_S * RATE_HZ:
        slow = number % 4 == 3
        speed = draw.uniform(0.004, 0.03) if slow else draw.uniform(0.05, 0.35)
        length = draw.uniform(0.005, 0.02) if slow else draw.uniform(0.08, 0.22)
        stroke(path, length if number % 2 == 0 else -length, speed)
        path.extend([path[-1]] * int(draw.uniform(0.05, 0.3) * RATE_HZ))
        if abs(path[-1]) > 0.3:
            stroke(path, -path[-1], 0.2)
        number += 1
    return path[: DURATION_S * RATE_HZ]


def ripple(position, phase):
    """Return the torque ripple at the belt (N)."""
    return RIPPLE_N * math.sin(math.tau * position / RIPPLE_PERIOD_M + phase)


class Contact:
    """Dry friction with presliding: bristles that bend before they slide (LuGre model)."""

    stiffness = COULOMB_N / PRESLIDING_M  # N/m
    damping = 0.6 * math.sqrt(stiffness * MASS_KG)  # N s/m

    def __init__(self):
        self.bend = 0.0

    def force(self, velocity, driving, step):
        """Return the friction (N) after one step (s) at `velocity` (m/s) under a driving force (N)."""
        level = COULOMB_N + LOAD_FRACTION * abs(driving)
        decay = step * self.stiffness * abs(velocity) / level
        bend = (self.bend + step * velocity) / (1.0 + decay)
        rate = (bend - self.bend) / step
        self.bend = bend
        return -self.stiffness * bend - self.damping * rate


def session(seed):
    """Yield rows of time (s), force (N) and position (m) of one session."""
    draw = random.Random(seed)
    path = reference(draw)
    phase = draw.uniform(0.0, math.tau)
    step = 1.0 / (RATE_HZ * STEPS_PER_SAMPLE)
    position = velocity = disturbance = seen_before = 0.0
    contact = Contact()
    waiting = collections.deque([0.0] * DELAY_SAMPLES)
    innovation = DISTURBANCE_N * math.sqrt(1.0 - DISTURBANCE_CORRELATION**2)
    for sample, wanted in enumerate(path):
        seen = position + draw.gauss(0.0, ENCODER_M)
        wanted_speed = (path[min(sample + 1, len(path) - 1)] - wanted) * RATE_HZ
        speed = (seen - seen_before) * RATE_HZ if sample else 0.0
        seen_before = seen
        error = POSITION_GAIN_PER_S * (wanted - seen) + wanted_speed - speed
        force = VELOCITY_GAIN_N_S_PER_M * error
        yield sample / RATE_HZ, force, seen
        waiting.append(force)
        acting = waiting.popleft()
        disturbance = DISTURBANCE_CORRELATION * disturbance + draw.gauss(0.0, innovation)
        for _ in range(STEPS_PER_SAMPLE):
            total = acting + disturbance + ripple(position, phase) - VISCOUS_N_S_PER_M * velocity
            total += contact.force(velocity, acting, step)
            velocity += step * total / MASS_KG
            position += step * velocity


def main():
    """Write both sessions."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    folder.mkdir(parents=True, exist_ok=True)
    for seed in (1, 2):
        with (folder / f"axis-{seed}.csv").open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["t_s", "force_n", "position_m"])
            for time, force, position in session(seed):
                writer.writerow([f"{time:.3f}", f"{force:.4f}", f"{position:.8f}"])
        print(f"wrote {folder / f'axis-{seed}.csv'}")


if __name__ == "__main__":
    main()
