"""A small simulated gantry that makes example recordings.

It shares nothing with klasktron: other language, own equations, own patterns. Many
gantries step side by side as numpy arrays [2, runs], one run each.

One belt motor is a = x + y, the other b = x - y (m of belt). Each has a drive with
  ramp      the set speed follows the command at SLEW at most
  observer  belt position in steps of the encoder, speed from a tracking filter
  loop      force = P (set - speed) + I integral, at most LARGEST_FORCE
and the carriage answers
  M dv/dt = F - VISCOUS v - COULOMB tanh(v / STICK_SPEED),  Fx = fa + fb, Fy = fa - fb.
The striker above the board follows the carriage with the time constant STRIKER_LAG.
Units are SI; x and y as in the board frame of the left player.
"""

import math
from dataclasses import dataclass

import numpy as np

STEP = 1.0 / 4000.0  # s, one pass of the velocity loop
COMMAND_PERIOD = 0.02  # s
STEPS_PER_COMMAND = 80
CARRIAGE_STEPS = (12, 52)  # of each command period: 100 Hz, not in phase with the commands
STEPS_PER_FRAME = 4000.0 / 120.0

MASS = np.array([[1.9], [2.4]])  # kg, x: carriage and rotors; y: with the bridge
VISCOUS = np.array([[3.0], [3.6]])  # N s/m
COULOMB = np.array([[1.4], [2.0]])  # N
STICK_SPEED = 0.004  # m/s
LARGEST_FORCE = 14.0  # N of one motor at the belt
SLEW = 8.0  # m/s2 of belt
GAIN_P = 120.0  # N s/m
GAIN_I = 1000.0  # N/m
ENCODER_STEP = 0.04 / 16384  # m of belt, 14 bits a turn
OBSERVER_SPEED = 500.0  # rad/s
STRIKER_LAG = 0.006  # s
LATENCY = 0.0075  # s from sending a command to its effect
LATENCY_SPREAD = 0.0003  # s
LARGEST_SPEED = 0.5  # m/s

HOME = np.array([-0.005, -0.11])
# Where the striker may be, m: the left field less the clearance of the peg.
LIMITS = ((-0.1415, 0.1315), (-0.1965, -0.0235))
WALL_MARGIN = 0.018  # m, travelled before a command takes effect
WALL_BRAKING = 4.0  # m/s2

BELTS = np.array([[1.0, 1.0], [1.0, -1.0]])  # (x, y) to (a, b); twice its own inverse


class Gantries:
    """Gantries side by side; every state is an array [2, runs]."""

    def __init__(self, runs):
        self.position = np.repeat(HOME[:, None], runs, axis=1)
        self.velocity = np.zeros((2, runs))
        self.striker = self.position.copy()
        self.command = np.zeros((2, runs))
        self.set_speed = np.zeros((2, runs))
        self.integral = np.zeros((2, runs))
        self.seen = BELTS @ self.position
        self.seen_speed = np.zeros((2, runs))

    def step(self):
        """One pass of the velocity loop."""
        wanted = BELTS @ self.command
        self.set_speed += np.clip(wanted - self.set_speed, -SLEW * STEP, SLEW * STEP)
        self.observe()
        error = self.set_speed - self.seen_speed
        force = GAIN_P * error + self.integral
        limited = np.clip(force, -LARGEST_FORCE, LARGEST_FORCE)
        # The integral rests while the force is at its limit.
        self.integral += np.where(force == limited, GAIN_I * STEP * error, 0.0)
        friction = VISCOUS * self.velocity + COULOMB * np.tanh(self.velocity / STICK_SPEED)
        self.velocity += STEP * (BELTS @ limited - friction) / MASS
        self.position += STEP * self.velocity
        self.striker += STEP / STRIKER_LAG * (self.position - self.striker)

    def observe(self):
        """The drives' tracking filters on the quantised belt positions."""
        counted = np.floor(BELTS @ self.position / ENCODER_STEP) * ENCODER_STEP
        error = counted - self.seen
        self.seen += STEP * (self.seen_speed + 2.0 * OBSERVER_SPEED * error)
        self.seen_speed += STEP * OBSERVER_SPEED**2 * error

    def measured(self):
        """Carriage as the encoders tell it: x, y, vx, vy, each [runs]."""
        return np.concatenate([BELTS @ self.seen, BELTS @ self.seen_speed]) / 2.0


class Line:
    """Back and forth between two points, each leg at a speed of its own."""

    def __init__(self, random, start, end):
        self.random = random
        self.start = np.array(start)
        leg = np.array(end) - self.start
        self.length = math.hypot(*leg)
        self.along = leg / self.length
        self.sign = 1.0
        self.speed = draw_speed(random)

    def command(self, _time, position):
        """Velocity now wanted."""
        offset = position - self.start
        travelled = float(offset @ self.along)
        if (travelled - self.length / 2.0) * self.sign > self.length / 2.0:
            self.sign = -self.sign
            self.speed = draw_speed(self.random)
        aside = offset - travelled * self.along
        return self.sign * self.speed * self.along - 4.0 * aside


class Ramp(Line):
    """A line on which the speed rises and falls steadily."""

    def __init__(self, random, start, end):
        super().__init__(random, start, end)
        self.period = random.uniform(0.5, 2.5)

    def command(self, time, position):
        """Velocity now wanted."""
        self.speed = 0.5 * abs(2.0 * ((time / self.period) % 1.0) - 1.0)
        return super().command(time, position)


class Circle:
    """Round and round, each half turn at a speed of its own."""

    def __init__(self, random, centre, radius):
        self.random = random
        self.centre = np.array(centre)
        self.radius = radius
        self.turning = random.choice([-1.0, 1.0])
        self.until = 0.0
        self.speed = 0.0

    def command(self, time, position):
        """Velocity now wanted."""
        if time >= self.until:
            self.speed = draw_speed(self.random)
            self.until = time + math.pi * self.radius / self.speed
        radial = position - self.centre
        distance = max(math.hypot(*radial), 1e-3)
        radial = radial / distance
        tangent = self.turning * np.array([-radial[1], radial[0]])
        return self.speed * tangent + 8.0 * (self.radius - distance) * radial


class RandomWalk:
    """A new random velocity every tenth to half second."""

    def __init__(self, random):
        self.random = random
        self.until = 0.0
        self.velocity = np.zeros(2)

    def command(self, time, _position):
        """Velocity now wanted."""
        if time >= self.until:
            self.until = time + self.random.uniform(0.1, 0.5)
            angle = self.random.uniform(0.0, 2.0 * math.pi)
            speed = self.random.uniform(0.0, LARGEST_SPEED)
            self.velocity = speed * np.array([math.cos(angle), math.sin(angle)])
        return self.velocity


def draw_speed(random):
    """A speed between slow and the largest."""
    return random.uniform(0.05, LARGEST_SPEED)


PATTERNS = {
    "x_line": lambda random: Line(random, (-0.09, -0.11), (0.08, -0.11)),
    "y_line": lambda random: Line(random, (-0.005, -0.155), (-0.005, -0.065)),
    "diagonal_up": lambda random: Line(random, (-0.07, -0.155), (0.06, -0.065)),
    "diagonal_down": lambda random: Line(random, (-0.07, -0.065), (0.06, -0.155)),
    "circle": lambda random: Circle(random, (-0.005, -0.11), random.uniform(0.025, 0.05)),
    "ramp": lambda random: Ramp(
        random, *random.choice([((-0.09, -0.11), (0.08, -0.11)), ((-0.03, -0.155), (0.02, -0.065))])
    ),
    "random_walk": RandomWalk,
}


def kept_inside(velocity, position):
    """`velocity` with its speed limited, and slow enough to stop before the limits."""
    speed = math.hypot(*velocity)
    result = [v * min(1.0, LARGEST_SPEED / max(speed, 1e-9)) for v in velocity]
    for axis, (low, high) in enumerate(LIMITS):
        up = math.sqrt(2.0 * WALL_BRAKING * max(high - WALL_MARGIN - position[axis], 0.0))
        down = math.sqrt(2.0 * WALL_BRAKING * max(position[axis] - low - WALL_MARGIN, 0.0))
        result[axis] = min(max(result[axis], -down), up)
    return result


def towards_home(position):
    """Velocity that brings the carriage home."""
    velocity = 8.0 * (HOME - position)
    return velocity * min(1.0, 0.3 / max(math.hypot(*velocity), 1e-9))


@dataclass
class Plan:
    """What the gantries are to do, all for the same time."""

    patterns: list  # name of each run
    commands: int  # of each run
    commands_home: int = 30  # after it, to be home for the next
    seed: int = 0


@dataclass
class Motion:
    """What happened, by run; times in s from the start of the run."""

    patterns: list
    commands: np.ndarray  # [commands, runs, 2]
    carriage_times: np.ndarray  # [samples]
    carriage: np.ndarray  # [samples, runs, 4]: x, y, vx, vy
    frame_times: np.ndarray  # [frames]
    striker: np.ndarray  # [frames, runs, 2]


def simulate(plan):
    """Carry out `plan` from home, every run on a gantry of its own."""
    random = np.random.RandomState(plan.seed)
    sources = [PATTERNS[name](RandomSource(random)) for name in plan.patterns]
    gantries = Gantries(len(sources))
    commands, carriage, striker, frame_times = [], [], [], []
    for tick in range(plan.commands + plan.commands_home):
        measured = gantries.measured()
        wanted = np.array(
            [
                kept_inside(
                    source.command(tick * COMMAND_PERIOD, measured[:2, run])
                    if tick < plan.commands
                    else towards_home(measured[:2, run]),
                    measured[:2, run],
                )
                for run, source in enumerate(sources)
            ]
        )
        commands.append(wanted)
        delays = LATENCY + LATENCY_SPREAD * np.clip(random.randn(len(sources)), -3.0, 3.0)
        arrivals = np.round(delays / STEP).astype(int)
        for step in range(STEPS_PER_COMMAND):
            arrived = arrivals == step
            if arrived.any():
                gantries.command = np.where(arrived, wanted.T, gantries.command)
            number = tick * STEPS_PER_COMMAND + step
            if step in CARRIAGE_STEPS:
                carriage.append(gantries.measured().T)
            if number >= len(frame_times) * STEPS_PER_FRAME:
                frame_times.append(number * STEP)
                striker.append(gantries.striker.T.copy())
            gantries.step()
    carriage_times = [
        tick * COMMAND_PERIOD + step * STEP
        for tick in range(len(commands))
        for step in CARRIAGE_STEPS
    ]
    return Motion(
        patterns=plan.patterns,
        commands=np.array(commands),
        carriage_times=np.array(carriage_times),
        carriage=np.array(carriage),
        frame_times=np.array(frame_times),
        striker=np.array(striker),
    )


class RandomSource:
    """The draws that patterns need, from numpy's frozen generator (same on every version)."""

    def __init__(self, random):
        self.random = random

    def uniform(self, low, high):
        """A number between `low` and `high`."""
        return low + (high - low) * self.random.random_sample()

    def choice(self, items):
        """One of `items`."""
        return items[int(self.random.random_sample() * len(items))]
