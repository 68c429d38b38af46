"""The game of `klasktron.envs` in vectorized NumPy: the same rules, ideal actuators, exact observations, no rewards.

`scripts/bench_python.py envs` checks that both agree before it times them. Rules and constants are those of `src/game`:
a control period of 20 ms with four pieces, straight paths between contacts, impacts with restitution, friction and spin,
strikers on their magnets, goal cups into which the ball falls.
"""

import numpy as np

PERIOD_S, PIECES = 0.02, 4
PIECE_S = PERIOD_S / PIECES
HALF_M = np.array([0.16, 0.21])
BALL_M, STRIKER_M = 0.007, 0.0075
TOUCH_M = BALL_M + STRIKER_M
CUP_RADIUS_M, CUP_DISTANCE_M = 0.01905, 0.17
GRAVITY = 9.81
ROLLING = 0.01 * GRAVITY
SPEED, SLEW, SLOWING_M, CLEARANCE_M = 0.4, 10.0, 0.09, 0.0135
# Low and high edge of the field of each player: [player][axis].
LOW = np.array([[-0.16, -0.21], [-0.16, 0.02]])
HIGH = np.array([[0.16, -0.02], [0.16, 0.21]])
REACH_LOW = np.maximum(LOW, -(HALF_M - STRIKER_M))
REACH_HIGH = np.minimum(HIGH, HALF_M - STRIKER_M)
WALL_RESTITUTION, STRIKER_RESTITUTION = 0.85, 0.75
FRICTION, STATIC_FRICTION = 0.09, 0.135
SHARE = 0.012 / (0.012 + 0.0017)
MAGNET, DAMPING_RATIO = 39.5, 0.7
FALL_S = np.sqrt(2 * BALL_M / GRAVITY)
MOST_EVENTS, MOST_STEPS, MOST_STILL_STEPS = 24, 500, 100
OWN_CUPS = np.array([[0.0, -CUP_DISTANCE_M], [0.0, CUP_DISTANCE_M]])
NOTHING, WALLS, MOVERS, EDGE, FALLEN, RIM = -1, 0, 4, 6, 7, 8
WALL_AXIS, WALL_SIGN = np.array([0, 0, 1, 1]), np.array([-1.0, 1.0, -1.0, 1.0])


def dot(a, b):
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]


def oscillator():
    """Matrix from displacement and velocity of a striker on its magnet to those after a piece."""
    damping = DAMPING_RATIO * MAGNET
    turn = np.sqrt(1 - DAMPING_RATIO**2) * MAGNET
    decay = np.exp(-damping * PIECE_S)
    cosine, sine = decay * np.cos(turn * PIECE_S), decay * np.sin(turn * PIECE_S) / turn
    return cosine + damping * sine, sine, -MAGNET**2 * sine, cosine - damping * sine


SWING = oscillator()


def resist(velocity, moves, seconds):
    """Velocity after rolling resistance."""
    speed = np.sqrt(dot(velocity, velocity))
    left = speed - seconds * ROLLING
    factor = np.where(left <= 1e-6, 0.0, left / np.where(speed > 0, speed, 1.0))
    return np.where(moves[:, None], velocity * factor[:, None], velocity)


def time_to_meet(d, w, distance):
    """Time until |d + w t| is `distance`; infinite for never."""
    closing, gap = dot(d, w), dot(d, d) - distance**2
    root = closing**2 - dot(w, w) * gap
    with np.errstate(divide="ignore", invalid="ignore"):
        time = gap / (np.sqrt(np.maximum(root, 0.0)) - closing)
    time = np.where(gap <= 0, 0.0, np.where(root >= 0, time, np.inf))
    return np.where(closing < 0, time, np.inf)


def impact(normal, velocity, spin, restitution):
    """Change of velocity and spin by an impact along `normal`, and whether there is one."""
    tangent = np.stack([normal[:, 1], -normal[:, 0]], 1)
    speed, along = dot(velocity, normal), dot(velocity, tangent)
    slide, bounce = along - spin, (1 + restitution) * speed
    needed = 2 / 7 * np.abs(slide)
    most = np.where(needed <= STATIC_FRICTION * bounce, STATIC_FRICTION, FRICTION) * bounce
    loss = np.clip(2 / 7 * slide, -most, most)
    back = (1 + np.where(speed < 2e-3, 0.0, restitution)) * speed
    change = -normal * back[:, None] - tangent * loss[:, None]
    return change, 2.5 * loss, speed > 0


class NumpyGame:
    """Many games; positions (m) and velocities (m/s) in the board frame."""

    def __init__(self, count, generator):
        self.generator = generator
        self.ball, self.velocity = np.zeros((count, 2)), np.zeros((count, 2))
        self.spin, self.over_cup = np.zeros(count), np.full(count, -1.0)
        shape = (count, 2, 2)
        self.led, self.led_velocity, self.command = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.recoil, self.recoil_velocity = np.zeros(shape), np.zeros(shape)
        self.steps, self.still = np.zeros(count, int), np.zeros(count, int)
        self.begin(np.arange(count))

    def begin(self, rows):
        """Begin an episode in these games."""
        count = len(rows)
        if count == 0:
            return
        draw = self.generator.uniform
        strikers = np.stack([draw(-0.1, 0.1, (count, 2)), -draw(0.03, 0.14, (count, 2))], 2)
        strikers[:, 1] *= -1
        ball = np.stack([draw(-0.15, 0.15, count), draw(0.03, 0.1, count) * np.sign(draw(-1, 1, count))], 1)
        for _ in range(32):
            way = ball[:, None] - strikers
            bad = np.flatnonzero((dot(way, way) <= TOUCH_M**2).any(1))
            if len(bad) == 0:
                break
            ball[bad, 0] = draw(-0.15, 0.15, len(bad))
        self.place(rows, ball, np.zeros((count, 2)), strikers)

    def place(self, rows, ball, velocity, strikers):
        """Put ball and strikers of these games; the strikers rest."""
        self.ball[rows], self.velocity[rows], self.led[rows] = ball, velocity, strikers
        self.spin[rows], self.over_cup[rows], self.steps[rows], self.still[rows] = 0.0, -1.0, 0, 0
        for own in (self.led_velocity, self.command, self.recoil, self.recoil_velocity):
            own[rows] = 0.0

    def observations(self):
        """Standard values of the left player, `[count][12]`."""
        places, speeds = self.led + self.recoil, self.led_velocity + self.recoil_velocity
        parts = [places[:, 0], speeds[:, 0], places[:, 1], speeds[:, 1], self.ball, self.velocity]
        return np.concatenate(parts, 1).astype(np.float32)

    def step(self, actions, restart=True):
        """Step with actions of the left player; the right one rests. Goals, own goals, a ball at rest and the time limit
        end episodes: flags `terminated` and `truncated`."""
        ways = self.lead(np.clip(actions, -1, 1).astype(np.float64) * SPEED)
        terminated = np.zeros(len(self.ball), bool)
        busy = self.play_quiet(ways)
        if len(busy):
            terminated[busy] = self.play_pieces(busy, ways[:, busy])
        self.steps += 1
        moves = dot(self.velocity, self.velocity) >= 0.005**2
        self.still = np.where(moves, 0, self.still + 1)
        terminated |= self.still >= MOST_STILL_STEPS
        truncated = ~terminated & (self.steps >= MOST_STEPS)
        if restart:
            self.begin(np.flatnonzero(terminated | truncated))
        return terminated, truncated

    def lead(self, wanted):
        """Positions of the magnets at the ends of the pieces, `[pieces + 1][count][player][axis]`."""
        target = np.stack([wanted, np.zeros_like(wanted)], 1)
        step = SLEW * PERIOD_S
        self.command = self.command + np.clip(target - self.command, -step, step)

        def cap(distance):
            room = np.maximum(distance - CLEARANCE_M, 0.0)
            return np.where(distance > STRIKER_M + SLOWING_M, np.inf, SPEED * room / SLOWING_M)

        velocity = np.clip(self.command, -cap(self.led - LOW), cap(HIGH - self.led))
        times = PIECE_S * np.arange(PIECES + 1)[:, None, None, None]
        ways = np.clip(self.led + velocity * times, REACH_LOW, REACH_HIGH)
        ways[0] = self.led
        free = self.led + velocity * PERIOD_S
        self.led_velocity = np.where(np.abs(ways[-1] - free) < 1e-12, velocity, 0.0)
        self.led = ways[-1].copy()
        return ways

    def play_quiet(self, ways):
        """Play games without any possible contact in one piece; the rows of the others."""
        moves = dot(self.velocity, self.velocity) > 0
        velocity = resist(self.velocity, moves, PERIOD_S / 2)
        end = self.ball + velocity * PERIOD_S
        quiet = (self.over_cup == -1.0) & (np.abs(end) <= HALF_M - BALL_M).all(1)
        quiet &= ~(self.recoil.any((1, 2)) | self.recoil_velocity.any((1, 2)))
        ball_way = PERIOD_S * np.abs(velocity).sum(1)
        own_way = np.abs(ways - ways[0]).sum(3).max(0)
        way = self.ball[:, None] - ways[0]
        quiet &= (dot(way, way) > (TOUCH_M + ball_way[:, None] + own_way) ** 2).all(1)
        way = ways[0] - OWN_CUPS
        quiet &= (dot(way, way) > (CUP_RADIUS_M + own_way) ** 2).all(1)
        way = np.stack([self.ball[:, 0], np.abs(self.ball[:, 1]) - CUP_DISTANCE_M], 1)
        quiet &= dot(way, way) > (CUP_RADIUS_M + ball_way) ** 2
        after = resist(velocity, dot(velocity, velocity) > 0, PERIOD_S / 2)
        self.ball = np.where(quiet[:, None], end, self.ball)
        self.velocity = np.where(quiet[:, None], after, self.velocity)
        return np.flatnonzero(~quiet)

    def play_pieces(self, rows, ways):
        """Play the games `rows` in pieces; whether each has ended with a goal or an own goal."""
        ended = np.zeros(len(rows), bool)
        places = ways[0] + self.recoil[rows]
        for piece in range(PIECES):
            on = np.flatnonzero(~ended)
            own = rows[on]
            self.push(own, PIECE_S / 2 if piece == 0 else PIECE_S)
            before = places[on]
            after, taken = self.play_piece(own, before, ways[piece + 1][on])
            places[on] = after
            way, start = after - before, before - OWN_CUPS
            square = dot(way, way)
            share = np.clip(-dot(start, way) / np.where(square > 0, square, 1.0), 0.0, 1.0)
            near = start + way * share[..., None]
            stop = taken | (dot(near, near) < CUP_RADIUS_M**2).any(1)
            self.led[own[stop]] = ways[piece + 1][on[stop]]
            ended[on[stop]] = True
        self.push(rows[~ended], PIECE_S / 2)
        return ended

    def push(self, rows, seconds):
        velocity = self.velocity[rows]
        moves = (self.over_cup[rows] == -1.0) & (dot(velocity, velocity) > 0)
        self.velocity[rows] = resist(velocity, moves, seconds)

    def play_piece(self, rows, places, ends):
        """One piece of the games `rows`: positions of the strikers after it, and whether the ball was taken."""
        recoil, speed = self.recoil[rows], self.recoil_velocity[rows]
        a, b, c, d = SWING
        recoil, speed = a * recoil + b * speed, c * recoil + d * speed
        home = (np.abs(recoil) + np.abs(speed)).sum(2) < 1e-9
        recoil[home], speed[home] = 0.0, 0.0
        movers = Movers(places.copy(), (ends + recoil - places) / PIECE_S)
        taken = self.drift(rows, movers)
        self.recoil[rows], self.recoil_velocity[rows] = recoil + movers.moved, speed + movers.kicked
        return movers.place, taken

    def drift(self, rows, movers):
        """Straight paths and contacts of a piece; whether the ball was taken."""
        taken, left = np.zeros(len(rows), bool), np.full(len(rows), PIECE_S)
        on = np.arange(len(rows))
        for _ in range(MOST_EVENTS):
            times, events = self.first_events(rows[on], movers, on, left[on])
            self.advance(rows[on], movers, on, times)
            left[on] -= times
            meets = events != NOTHING
            on, events = on[meets], events[meets]
            if len(on) == 0:
                return taken
            self.meet(rows, movers, on, events, taken)
            # The strikers of a ball that is taken complete the piece.
            done = on[taken[on]]
            movers.advance(done, left[done])
            on = on[~taken[on]]
        movers.advance(on, left[on])
        return taken

    def first_events(self, rows, movers, on, left):
        """Time and kind of the first event of each game; the rest of the piece and NOTHING without one."""
        ball, velocity = self.ball[rows], self.velocity[rows]
        times = np.full((9, len(rows)), np.inf)
        end = ball + velocity * left[:, None]
        for wall, (axis, sign) in enumerate(zip(WALL_AXIS, WALL_SIGN)):
            room = HALF_M[axis] - BALL_M
            now, after = room - sign * ball[:, axis], room - sign * end[:, axis]
            meets = (after < 0) & (now > after)
            gap = np.where(meets, now - after, 1.0)
            times[wall] = np.where(meets, np.where(now <= 0, 0.0, left * now / gap), np.inf)
        for player in range(2):
            d, w = ball - movers.place[on, player], velocity - movers.velocity[on, player]
            times[MOVERS + player] = time_to_meet(d, w, TOUCH_M)
        d = ball - np.stack([np.zeros(len(rows)), np.copysign(CUP_DISTANCE_M, ball[:, 1])], 1)
        over, square = self.over_cup[rows], dot(velocity, velocity)
        free = over == -1.0
        rest = (dot(d, d) < CUP_RADIUS_M**2) & (square == 0)
        times[EDGE] = np.where(free, np.where(rest, 0.0, time_to_meet(d, velocity, CUP_RADIUS_M)), np.inf)
        times[FALLEN] = np.where(free, np.inf, np.maximum(FALL_S - over, 0.0))
        out, inside = dot(d, velocity), np.maximum(CUP_RADIUS_M**2 - dot(d, d), 0.0)
        leave = (np.sqrt(out**2 + square * inside) - out) / np.where(square > 0, square, 1.0)
        times[RIM] = np.where(free | (square == 0), np.inf, leave)
        events = np.argmin(times, 0)
        first = times[events, np.arange(len(rows))]
        late = ~(first <= left)
        return np.where(late, left, first), np.where(late, NOTHING, events)

    def advance(self, rows, movers, on, times):
        self.ball[rows] += self.velocity[rows] * times[:, None]
        over = self.over_cup[rows]
        self.over_cup[rows] = np.where(over == -1.0, over, over + times)
        movers.advance(on, times)

    def meet(self, rows, movers, on, events, taken):
        """Resolve one event of each game."""
        hit = events < MOVERS
        own, wall = rows[on[hit]], events[hit]
        normal = np.zeros((len(own), 2))
        normal[np.arange(len(own)), WALL_AXIS[wall]] = WALL_SIGN[wall]
        change, spin, real = impact(normal, self.velocity[own], self.spin[own], WALL_RESTITUTION)
        self.velocity[own[real]] += change[real]
        self.spin[own[real]] += spin[real]
        hit = (events == MOVERS) | (events == MOVERS + 1)
        self.strike(rows[on[hit]], movers, on[hit], events[hit] - MOVERS)
        self.over_cup[rows[on[events == EDGE]]] = 0.0
        taken[on[events == FALLEN]] = True
        at_rim = on[events == RIM]
        taken[at_rim] = ~self.cross_rim(rows[at_rim])

    def strike(self, rows, movers, on, players):
        way = movers.place[on, players] - self.ball[rows]
        normal = way / np.sqrt(dot(way, way))[:, None]
        relative = self.velocity[rows] - movers.velocity[on, players]
        change, spin, real = impact(normal, relative, self.spin[rows], STRIKER_RESTITUTION)
        change, spin, rows, on, players = (own[real] for own in (change, spin, rows, on, players))
        self.velocity[rows] += SHARE * change
        self.spin[rows] += SHARE * spin
        movers.velocity[on, players] += (SHARE - 1) * change
        movers.kicked[on, players] += (SHARE - 1) * change

    def cross_rim(self, rows):
        """Whether each ball climbs over the far rim of its cup."""
        ball, over = self.ball[rows], self.over_cup[rows]
        d = ball - np.stack([np.zeros(len(rows)), np.copysign(CUP_DISTANCE_M, ball[:, 1])], 1)
        outwards = d / np.sqrt(dot(d, d))[:, None]
        radial, sunk = dot(self.velocity[rows], outwards), 0.5 * GRAVITY * over**2
        sine = 1 - sunk / BALL_M
        pivot = radial * sine - GRAVITY * over * np.sqrt(np.maximum(1 - sine**2, 0.0))
        rest = pivot**2 - 2 * GRAVITY * sunk
        leaves = (sunk < BALL_M) & (pivot > 0) & (rest >= 0)
        own = rows[leaves]
        faster = np.sqrt(rest[leaves]) - radial[leaves]
        self.velocity[own] += outwards[leaves] * faster[:, None]
        self.over_cup[own] = -1.0
        return leaves


class Movers:
    """Strikers during a piece."""

    def __init__(self, place, velocity):
        self.place, self.velocity = place, velocity
        self.kicked, self.moved = np.zeros_like(place), np.zeros_like(place)

    def advance(self, on, times):
        seconds = times[:, None, None]
        self.place[on] += self.velocity[on] * seconds
        self.moved[on] += self.kicked[on] * seconds
