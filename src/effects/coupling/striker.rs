//! Striker on the spring of its magnet, with friction on the board: one step of several strikers side by side.

use crate::{
    effects::{
        both,
        oscillator::OscillatorLanes,
        physics::{Carriage, Striker},
    },
    lanes::{Lanes, Mask, select},
};
use pulp::{Scalar, Simd};

/// Largest phase of the oscillator in one integration step (rad).
///
/// Displacements are then within 35 um of those with much shorter steps (see the tests).
const TURN: f64 = 0.5;

/// Largest number of integration steps within one step of the carriage.
const MOST_STEPS: f64 = 32.0;

/// Number of internal states: the displacement of the striker from the magnet, then its velocity on the board.
pub(super) const STATES: usize = 4;

/// Strikers of several simulations, which may be without one.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StrikerLanes<S: Simd> {
    simd: S,
    exist: Mask<S>,
    /// Deceleration by friction (m/s^2).
    friction: Lanes<S>,
    /// Angular frequency at zero displacement (1/s), and its square.
    natural: Lanes<S>,
    natural_squared: Lanes<S>,
    /// Half of the damping per mass (1/s).
    damping: Lanes<S>,
    /// Reciprocal of the squared displacement of the largest force (1/m^2).
    per_softening_squared: Lanes<S>,
    /// Stiffness (N/m), damping (N s/m) and mass (kg).
    stiffness: Lanes<S>,
    resistance: Lanes<S>,
    mass: Lanes<S>,
}

/// Motion of several carriages at the end of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CarriageLanes<S: Simd> {
    /// Length of the step (s).
    pub(crate) dt: Lanes<S>,
    /// Velocity (m/s).
    pub(crate) velocity: [Lanes<S>; 2],
    /// Acceleration over the step (m/s^2).
    pub(crate) acceleration: [Lanes<S>; 2],
}

impl<S: Simd> CarriageLanes<S> {
    /// Put velocity and acceleration of a `carriage` into `lane`.
    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, carriage: &Carriage) {
        for axis in 0..2 {
            self.velocity[axis].set(lane, carriage.velocity[axis]);
            self.acceleration[axis].set(lane, carriage.acceleration[axis]);
        }
    }
}

impl CarriageLanes<Scalar> {
    /// Motion of one carriage.
    pub(crate) fn alone(carriage: &Carriage) -> Self {
        let of = |value: f64| Lanes::splat(Scalar, value);
        Self {
            dt: of(carriage.dt),
            velocity: carriage.velocity.map(of),
            acceleration: carriage.acceleration.map(of),
        }
    }
}

/// Displacement of several strikers from their magnets (m), and their velocity on the board (m/s).
#[derive(Debug, Clone, Copy)]
pub(crate) struct StateLanes<S: Simd> {
    pub(crate) away: [Lanes<S>; 2],
    speed: [Lanes<S>; 2],
}

impl<S: Simd> StateLanes<S> {
    /// All on their magnets, at rest.
    #[inline(always)]
    pub(crate) fn at_rest(simd: S) -> Self {
        let nothing = [Lanes::splat(simd, 0.0); 2];
        Self { away: nothing, speed: nothing }
    }

    /// Put the states in a `memory` into `lane`.
    #[inline(always)]
    pub(crate) fn put(&mut self, lane: usize, memory: &[f64]) {
        let [x, y] = &mut self.away;
        let [u, v] = &mut self.speed;
        for (own, value) in [x, y, u, v].into_iter().zip(memory) {
            own.set(lane, *value);
        }
    }

    /// Get the states in `lane` into the `memory`.
    #[inline(always)]
    pub(crate) fn get(&self, lane: usize, memory: &mut [f64]) {
        let Self { away: [x, y], speed: [u, v] } = self;
        for (own, value) in [x, y, u, v].into_iter().zip(memory) {
            *value = own.get(lane);
        }
    }

    /// This in the lanes in which `is_ours`, the `other` elsewhere.
    #[inline(always)]
    fn or(self, is_ours: Mask<S>, other: Self) -> Self {
        Self {
            away: select(is_ours, self.away, other.away),
            speed: select(is_ours, self.speed, other.speed),
        }
    }
}

/// One integration step of the magnets.
struct Part<S: Simd> {
    /// Its length (s).
    h: Lanes<S>,
    /// Velocity at its start and at its end (m/s).
    before: [Lanes<S>; 2],
    after: [Lanes<S>; 2],
    /// Acceleration (m/s^2).
    acceleration: [Lanes<S>; 2],
}

impl<S: Simd> Part<S> {
    /// The one that ends `left` seconds before the step of the `carriage`.
    #[inline(always)]
    fn new(carriage: &CarriageLanes<S>, h: Lanes<S>, left: Lanes<S>) -> Self {
        let CarriageLanes { velocity, acceleration, .. } = *carriage;
        let after = both(
            #[inline(always)]
            |axis| velocity[axis] - acceleration[axis] * left,
        );
        let before = both(
            #[inline(always)]
            |axis| after[axis] - acceleration[axis] * h,
        );
        Self { h, before, after, acceleration }
    }
}

impl<S: Simd> StrikerLanes<S> {
    /// The striker with its mass (kg) `of` each simulation; `None` where none has one.
    #[inline(always)]
    pub(crate) fn new(simd: S, of: impl Fn(usize) -> Option<(Striker, f64)>) -> Option<Self> {
        let first = (0..S::F64_LANES).find_map(&of)?;
        let exist = Mask::from_fn(simd, |lane| of(lane).is_some());
        Some(Self::of(simd, |lane| of(lane).unwrap_or(first), exist))
    }

    #[inline(always)]
    fn of(simd: S, of: impl Fn(usize) -> (Striker, f64), exist: Mask<S>) -> Self {
        let number = |get: fn(Striker, f64) -> f64| {
            Lanes::from_fn(simd, |lane| {
                let (own, mass) = of(lane);
                get(own, mass)
            })
        };
        Self {
            simd,
            exist,
            friction: number(|own, mass| own.friction / mass),
            natural: number(|own, mass| (own.stiffness / mass).sqrt()),
            natural_squared: number(|own, mass| own.stiffness / mass),
            damping: number(|own, mass| own.damping_ratio * (own.stiffness / mass).sqrt()),
            per_softening_squared: number(|own, _| 1.0 / (own.softening * own.softening)),
            stiffness: number(|own, _| own.stiffness),
            resistance: number(|own, mass| 2.0 * own.damping_ratio * (own.stiffness * mass).sqrt()),
            mass: number(|_, mass| mass),
        }
    }

    /// Ratio of the secant stiffness at the displacement `away` (m) to that at zero.
    #[inline(always)]
    fn softened(&self, away: [Lanes<S>; 2]) -> Lanes<S> {
        1.0 / (1.0 + self.per_softening_squared * (away[0] * away[0] + away[1] * away[1]))
    }

    /// Strikers after a step of their carriages.
    #[inline(always)]
    pub(crate) fn step(&self, state: &mut StateLanes<S>, carriage: &CarriageLanes<S>) {
        let one = Lanes::splat(self.simd, 1.0);
        let most = Lanes::splat(self.simd, MOST_STEPS);
        let phase = ((1.0 / TURN) * (self.natural * carriage.dt)).min(most);
        let mut steps = one;
        loop {
            let is_short = steps.less_than(phase) & self.exist;
            if !is_short.any() {
                break;
            }
            steps = is_short.select(one + steps, steps);
        }
        let h = carriage.dt / steps;
        let decay = OscillatorLanes::decay(self.damping * h);
        let mut step = one;
        loop {
            let goes_on = step.at_most(steps) & self.exist;
            if !goes_on.any() {
                return;
            }
            let part = Part::new(carriage, h, carriage.dt - h * step);
            *state = self.part(*state, &part, decay).or(goes_on, *state);
            step = one + step;
        }
    }

    /// Strikers after one integration step. `decay` is that of a free oscillator over the step.
    #[inline(always)]
    fn part(&self, state: StateLanes<S>, part: &Part<S>, decay: Lanes<S>) -> StateLanes<S> {
        let StateLanes { away, speed } = state;
        let Part { h, before, after, .. } = *part;
        let nothing = Lanes::splat(self.simd, 0.0);
        let square = self.softened(away) * self.natural_squared;
        let pull = both(
            #[inline(always)]
            |axis| square * away[axis] + 2.0 * self.damping * (speed[axis] - before[axis]),
        );
        let is_at_rest = speed[0].equals(nothing)
            & speed[1].equals(nothing)
            & (pull[0] * pull[0] + pull[1] * pull[1]).at_most(self.friction * self.friction);
        let stays = StateLanes {
            away: both(
                #[inline(always)]
                |axis| away[axis] - 0.5 * h * (before[axis] + after[axis]),
            ),
            speed,
        };
        if is_at_rest.all() {
            return stays;
        }
        let spring = OscillatorLanes::with_decay(square, self.damping, h, decay);
        stays.or(is_at_rest, self.slides(state, part, &spring))
    }

    /// Strikers after one integration step in which they move on the board, on a `spring`.
    #[inline(always)]
    fn slides(
        &self,
        StateLanes { away, speed }: StateLanes<S>,
        Part { before, after, acceleration, .. }: &Part<S>,
        spring: &OscillatorLanes<S>,
    ) -> StateLanes<S> {
        let nothing = Lanes::splat(self.simd, 0.0);
        let per_square = 1.0 / spring.stiffness();
        let swung = both(
            #[inline(always)]
            |axis| {
                let rest = -acceleration[axis] * per_square;
                let (from_rest, rate) = spring.step(away[axis] - rest, speed[axis] - before[axis]);
                [rest + from_rest, rate + after[axis]]
            },
        );
        // Friction opposes the velocity that the step would reach without it: at low speeds its direction changes
        // within a step.
        let [[_, x], [_, y]] = swung;
        let least = Lanes::splat(self.simd, f64::MIN_POSITIVE);
        let per_speed = 1.0 / (x * x + y * y).sqrt().max(least);
        let along = [x * per_speed, y * per_speed];
        let (displaced, sped_up) = spring.response();
        let held_back = self.friction * per_square;
        let [[x, u], [y, v]] = both(
            #[inline(always)]
            |axis| {
                let held_back = held_back * along[axis];
                [swung[axis][0] - displaced * held_back, swung[axis][1] - sped_up * held_back]
            },
        );
        // Friction stops the striker and does not reverse it.
        let is_stopped = (u * along[0] + v * along[1]).at_most(nothing);
        StateLanes { away: [x, y], speed: select(is_stopped, [nothing; 2], [u, v]) }
    }

    /// Force on the carriages after a step (N) in addition to that of the striker's mass: k d + 2 z sqrt(k m) d' + m a.
    #[inline(always)]
    pub(crate) fn hold_back(
        &self,
        state: &StateLanes<S>,
        carriage: &CarriageLanes<S>,
    ) -> [Lanes<S>; 2] {
        let nothing = Lanes::splat(self.simd, 0.0);
        let stiffness = self.stiffness * self.softened(state.away);
        both(
            #[inline(always)]
            |axis| {
                let rate = state.speed[axis] - carriage.velocity[axis];
                let inertia = self.mass * carriage.acceleration[axis];
                let force = stiffness * state.away[axis] + self.resistance * rate + inertia;
                self.exist.select(force, nothing)
            },
        )
    }
}

impl StrikerLanes<Scalar> {
    /// One striker of this mass (kg).
    pub(crate) fn alone(striker: Striker, mass: f64) -> Self {
        Self::of(Scalar, |_| (striker, mass), Mask::from_fn(Scalar, |_| true))
    }

    /// Position of the one striker (m) after a step of its `carriage`; `memory` holds its states.
    pub(crate) fn striker(&self, memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        let mut state = StateLanes::at_rest(Scalar);
        state.put(0, memory);
        self.step(&mut state, &CarriageLanes::alone(carriage));
        state.get(0, memory);
        both(|axis| carriage.position[axis] + memory[axis])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    const MASS: f64 = 0.012;

    /// Velocity (m/s) of a carriage that reverses along both axes, at `time` (s).
    fn velocity(time: f64) -> [f64; 2] {
        [0.2 * (TAU * 2.0 * time).sin(), 0.15 * (TAU * 3.3 * time).cos()]
    }

    /// Displacements of the striker (m) after each of 1500 milliseconds, each simulated in `parts`.
    fn displacements(striker: Striker, parts: u32) -> Vec<[f64; 2]> {
        let own = StrikerLanes::alone(striker, MASS);
        let dt = 1e-3 / f64::from(parts);
        let mut memory = [0.0; STATES];
        let mut found = Vec::new();
        for step in 1..=1500 * parts {
            let time = dt * f64::from(step);
            let [before, after] = [velocity(time - dt), velocity(time)];
            let acceleration = both(|axis| (after[axis] - before[axis]) / dt);
            let carriage = Carriage {
                dt,
                velocity: after,
                acceleration,
                striker_mass: MASS,
                ..Carriage::default()
            };
            own.striker(&mut memory, &carriage);
            if step % parts == 0 {
                found.push([memory[0], memory[1]]);
            }
        }
        found
    }

    #[test]
    fn steps_of_a_millisecond_agree_with_much_shorter_ones() {
        /// A tenth of the noise of a camera (m).
        const SMALL: f64 = 3.5e-5;
        const PARTS: u32 = 100;
        let strikers = [
            [0.1, 400.0, 0.1, 0.002],
            [0.4, 800.0, 0.3, 1.0],
            [0.5, 2500.0, 0.3, 0.02],
            [0.2, 5000.0, 1.0, 1.0],
            [0.1, 3000.0, 0.05, 0.02],
            [0.05, 200.0, 0.1, 0.005],
        ];
        for own in strikers {
            let [friction, stiffness, damping_ratio, softening] = own;
            let striker = Striker { friction, stiffness, damping_ratio, softening };
            let pairs = displacements(striker, 1).into_iter().zip(displacements(striker, PARTS));
            let apart = pairs.map(|(one, other)| (one[0] - other[0]).hypot(one[1] - other[1]));
            let worst = apart.fold(0.0, f64::max);
            assert!(worst < SMALL, "{own:?}: {worst}");
        }
    }
}
