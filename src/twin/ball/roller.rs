//! Simulation of the ball between and at the walls.
//!
//! Within a step ([`LONGEST_STEP`], [`LONGEST_WAY`]) the accelerations are constant and the impacts are solved for, so
//! the path depends smoothly on every parameter:
//!
//! ```text
//! velocity  v' = (v + a t - friction of sliding) shortened by r t, and 0 when nothing is left
//! position  x' = x + (v + v') t / 2, or to where it stops
//! impact    n.x = wall + shift - radius   ->   v_n' = -e v_n, v_t' and spin by the effects
//! ```
//!
//! `a` is the sum of [`Physics::Roll`], `r` that of [`Physics::Resistance`]. After an impact the
//! ball still turns as it did before: the contact point slips by the change of velocity. Sliding
//! friction ([`Physics::Slide`]) reduces the velocity by 2/7 of the amount by which it reduces the
//! slip (solid sphere: acceleration `mu g` of the centre, `5/2 mu g` of the surface).
//!
//! The functions of a step are inlined into its caller: as separate ones they pass the ball through memory, which takes
//! a third longer.

use super::{BALL_RADIUS, HALF_BOARD};
use crate::{
    effects::{Ball, CATALOGUE, Change, Domain, Impact, Physics, Regressor, Wall, both},
    twin::Instance,
};

/// Longest step (s): half of a period of a camera with 120 Hz.
const LONGEST_STEP: f64 = 4.2e-3;

/// Longest way of a step through accelerations that depend on the position of the ball (m).
const LONGEST_WAY: f64 = 1e-3;

/// Impacts within one step; beyond it the ball rests against its wall for the rest of the step.
const MOST_IMPACTS: usize = 8;

/// Distance from every wall (m) beyond which there is no impact; more than any shift.
const NEAR_A_WALL: f64 = 0.04;

/// Change of the velocity of a sliding solid sphere, as a fraction of the change of its slip.
const GRIP: f64 = 2.0 / 7.0;

/// Distance over which the direction of a wall is measured (m).
const ALONG: f64 = 1e-3;

/// Most iterations that solve for the time of an impact.
const ITERATIONS: usize = 60;

/// Function of one kind of physics, with the parameters of its instance.
type Law<F> = (F, Vec<f64>);
type RollLaw = fn(&[f64], &Ball) -> [f64; 2];
type BallLaw = fn(&[f64], &Ball) -> f64;
type ImpactLaw = fn(&[f64], &Impact, Change) -> Change;
type WallLaw = fn(&[f64], Wall, f64) -> f64;
type CameraLaw = fn(&[f64], [f64; 2], f64) -> [f64; 2];
type DelayLaw = fn(&[f64], f64) -> f64;
type LaunchLaw = fn(&[f64]) -> f64;

/// Functions of a twin's instances that act on the ball, by kind of physics, in the order of the
/// catalogue. The order in which effects were found therefore does not matter.
#[derive(Default)]
pub(super) struct Rules {
    roll: Vec<Law<RollLaw>>,
    resistance: Vec<Law<BallLaw>>,
    slide: Vec<Law<BallLaw>>,
    launch: Vec<Law<LaunchLaw>>,
    impact: Vec<Law<ImpactLaw>>,
    wall: Vec<Law<WallLaw>>,
    camera: Vec<Law<CameraLaw>>,
    delay: Vec<Law<DelayLaw>>,
    /// `true` where an acceleration depends on the position of the ball.
    depends_on_position: bool,
}

impl Rules {
    pub(super) fn new(instances: &[Instance]) -> Self {
        let place = |instance: &&Instance| {
            CATALOGUE.iter().position(|effect| effect.name == instance.effect.name)
        };
        let mut sorted: Vec<&Instance> = instances.iter().collect();
        sorted.sort_by_key(place);
        let mut rules = Self::default();
        for instance in sorted {
            rules.depends_on_position |= instance.effect.domain == Domain::Ball
                && instance.effect.regressors.contains(&Regressor::Position);
            for equation in instance.effect.physics.equations() {
                rules.add(*equation, instance.numbers());
            }
        }
        rules
    }

    fn add(&mut self, equation: Physics, numbers: Vec<f64>) {
        match equation {
            Physics::Roll(law) => self.roll.push((law, numbers)),
            Physics::Resistance(law) => self.resistance.push((law, numbers)),
            Physics::Slide(law) => self.slide.push((law, numbers)),
            Physics::Launch(law) => self.launch.push((law, numbers)),
            Physics::Impact(law) => self.impact.push((law, numbers)),
            Physics::Wall(law) => self.wall.push((law, numbers)),
            Physics::Camera(law) => self.camera.push((law, numbers)),
            Physics::CameraDelay(law) => self.delay.push((law, numbers)),
            _ => {}
        }
    }

    /// Latency of the camera at `elapsed` seconds of the session (s).
    pub(super) fn age(&self, elapsed: f64) -> f64 {
        self.delay.iter().map(|(law, p)| law(p, elapsed)).sum()
    }

    /// Position at which the camera sees the ball that is at `place`.
    pub(super) fn seen(&self, place: [f64; 2]) -> [f64; 2] {
        self.camera.iter().fold(place, |place, (law, p)| law(p, place, BALL_RADIUS))
    }

    fn shift(&self, wall: Wall, along: f64) -> f64 {
        self.wall.iter().map(|(law, p)| law(p, wall, along)).sum()
    }

    #[inline(always)]
    fn forces(&self, ball: &Ball) -> Forces {
        let mut forces = Forces::default();
        for (law, p) in &self.roll {
            let [x, y] = law(p, ball);
            forces.push = [forces.push[0] + x, forces.push[1] + y];
        }
        forces.resistance = self.resistance.iter().map(|(law, p)| law(p, ball)).sum();
        forces.slide = self.slide.iter().map(|(law, p)| law(p, ball)).sum();
        forces
    }

    /// Distance that the ball can still move towards `wall` from `place` (m).
    fn gap(&self, wall: Wall, place: [f64; 2]) -> f64 {
        let (axis, sign) = wall.outward();
        HALF_BOARD[axis] - BALL_RADIUS - sign * place[axis] + self.shift(wall, place[1 - axis])
    }

    /// Outward normal of `wall` at `place`, a shifted wall being turned by the slope of its shift.
    fn normal(&self, wall: Wall, place: [f64; 2]) -> [f64; 2] {
        let (axis, sign) = wall.outward();
        let along = place[1 - axis];
        let slope =
            (self.shift(wall, along + ALONG) - self.shift(wall, along - ALONG)) / (2.0 * ALONG);
        let length = slope.hypot(1.0);
        let mut normal = [0.0; 2];
        normal[axis] = sign / length;
        normal[1 - axis] = -slope / length;
        normal
    }
}

/// Length of a vector; `hypot` would take several times as long, and nothing here over- or
/// underflows.
fn length(vector: [f64; 2]) -> f64 {
    (vector[0] * vector[0] + vector[1] * vector[1]).sqrt()
}

/// Accelerations of the ball during one step (m/s^2).
#[derive(Clone, Copy, Default)]
struct Forces {
    push: [f64; 2],
    resistance: f64,
    slide: f64,
}

/// State of the ball at one time.
#[derive(Clone, Copy)]
struct Free {
    place: [f64; 2],
    velocity: [f64; 2],
    /// Velocity of the contact point on the board; zero when it rolls (m/s).
    slip: [f64; 2],
}

impl Free {
    /// The ball `t` seconds later under constant `forces`, without walls.
    #[inline(always)]
    fn after(&self, forces: &Forces, t: f64) -> Self {
        let mut velocity = both(|k| self.velocity[k] + forces.push[k] * t);
        let mut slip = self.slip;
        let size = if 0.0 < forces.slide { length(slip) } else { 0.0 };
        if 0.0 < size {
            let part = (forces.slide * t).min(GRIP * size) / size;
            for k in 0..2 {
                velocity[k] -= self.slip[k] * part;
                slip[k] = self.slip[k] * (1.0 - part / GRIP);
            }
        }
        let speed = length(velocity);
        let loss = forces.resistance * t;
        let (kept, moving) = if loss < speed {
            (1.0 - loss / speed, t)
        } else if 0.0 < loss {
            (0.0, t * speed / loss)
        } else {
            (0.0, 0.0)
        };
        velocity = velocity.map(|v| v * kept);
        let place = both(|k| self.place[k] + (self.velocity[k] + velocity[k]) / 2.0 * moving);
        Self { place, velocity, slip }
    }
}

/// Return whether the ball may reach a wall, shifted as far as walls can be, at `place`.
fn near_any_wall(place: [f64; 2]) -> bool {
    (0..2).any(|k| HALF_BOARD[k] - BALL_RADIUS - NEAR_A_WALL < place[k].abs())
}

/// Simulated ball on its roll.
pub(super) struct Roller<'a> {
    rules: &'a Rules,
    ball: Ball,
    slip: [f64; 2],
    spin: f64,
    /// Accelerations during the step before.
    forces_before: Forces,
}

impl<'a> Roller<'a> {
    /// At `start`: x, y (m), vx, vy (m/s); sliding as it is launched, without spin.
    pub(super) fn new(rules: &'a Rules, start: &[f64]) -> Self {
        let number = |k: usize| start.get(k).copied().unwrap_or(0.0);
        let ball = Ball {
            position: [number(0), number(1)],
            velocity: [number(2), number(3)],
            ..Ball::default()
        };
        let launch: f64 = rules.launch.iter().map(|(law, p)| law(p)).sum();
        let slip = ball.velocity.map(|v| launch * v);
        Self { rules, ball, slip, spin: 0.0, forces_before: Forces::default() }
    }

    /// Continue in the middle of a roll without slip: the remaining slip is unknown.
    pub(super) fn rolls_without_slip(&mut self) {
        self.slip = [0.0; 2];
    }

    /// Set the positions of the strikers from now on.
    pub(super) fn strikers(&mut self, strikers: [Option<[f64; 2]>; 2]) {
        self.ball.strikers = strikers;
    }

    pub(super) fn place(&self) -> [f64; 2] {
        self.ball.position
    }

    /// Velocity (m/s).
    #[cfg(test)]
    pub(super) fn velocity(&self) -> [f64; 2] {
        self.ball.velocity
    }

    /// Twice the kinetic energy per mass (m^2/s^2): of the motion, the rolling and the spin.
    #[cfg(test)]
    pub(super) fn energy(&self) -> f64 {
        let square = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
        let rolling = both(|k| self.ball.velocity[k] - self.slip[k]);
        square(self.ball.velocity) + 0.4 * (square(rolling) + self.spin * self.spin)
    }

    /// Advances to `time` (s since the roll began); a time that has passed changes nothing.
    #[inline(always)]
    pub(super) fn advance_to(&mut self, time: f64) {
        let start = self.ball.time;
        let span = time - start;
        if span <= 0.0 {
            return;
        }
        let mut steps = span / LONGEST_STEP;
        if self.rules.depends_on_position {
            steps = steps.max(span * length(self.ball.velocity) / LONGEST_WAY);
        }
        let steps = (steps * (1.0 - 1e-9)).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(span / steps);
        }
        self.ball.time = time;
    }

    #[inline(always)]
    fn step(&mut self, dt: f64) {
        let mut left = dt;
        for _ in 0..MOST_IMPACTS {
            let forces = self.forces(left);
            let now = self.free();
            let end = now.after(&forces, left);
            let is_near = near_any_wall(end.place);
            let impact = is_near.then(|| self.first_impact(&now, &end, &forces, left)).flatten();
            let Some((time, wall)) = impact else {
                self.commit(end, left);
                return;
            };
            self.commit(now.after(&forces, time), time);
            self.bounce(wall);
            left -= time;
        }
        self.rest_against_walls(left);
    }

    #[inline(always)]
    fn free(&self) -> Free {
        Free { place: self.ball.position, velocity: self.ball.velocity, slip: self.slip }
    }

    /// Forces in the middle of the next `span` seconds, which the ball reaches under those of the step before.
    #[inline(always)]
    fn forces(&mut self, span: f64) -> Forces {
        let half = 0.5 * span;
        let Free { place, velocity, .. } = self.free().after(&self.forces_before, half);
        let mut middle = Ball { position: place, velocity, ..self.ball };
        middle.time += half;
        middle.since_impact += half;
        self.forces_before = self.rules.forces(&middle);
        self.forces_before
    }

    #[inline(always)]
    fn commit(&mut self, free: Free, span: f64) {
        self.ball.position = free.place;
        self.ball.velocity = free.velocity;
        self.slip = free.slip;
        self.ball.time += span;
        self.ball.since_impact += span;
    }

    /// Time and wall of the first impact within `span` seconds.
    #[inline(never)]
    fn first_impact(
        &self,
        now: &Free,
        end: &Free,
        forces: &Forces,
        span: f64,
    ) -> Option<(f64, Wall)> {
        let mut first: Option<(f64, Wall)> = None;
        for wall in Wall::ALL {
            let gap = self.rules.gap(wall, end.place);
            if 0.0 <= gap {
                continue;
            }
            let normal = self.rules.normal(wall, end.place);
            if end.velocity[0] * normal[0] + end.velocity[1] * normal[1] <= 0.0 {
                continue;
            }
            let time = self.contact_time(
                wall,
                [self.rules.gap(wall, now.place), gap],
                |t| now.after(forces, t).place,
                span,
            );
            if first.is_none_or(|(earliest, _)| time < earliest) {
                first = Some((time, wall));
            }
        }
        first
    }

    /// Solves `gap(place_at(t)) = 0` in `0..span`: regula falsi after Illinois. A ball that is
    /// already beyond the wall hits it at once.
    fn contact_time(
        &self,
        wall: Wall,
        gaps: [f64; 2],
        place_at: impl Fn(f64) -> [f64; 2],
        span: f64,
    ) -> f64 {
        let ([mut low, mut high], [mut gap_low, mut gap_high]) = ([0.0, span], gaps);
        if gap_low <= 0.0 {
            return 0.0;
        }
        let mut time = f64::NAN;
        for _ in 0..ITERATIONS {
            let before = time;
            time = high - gap_high * (high - low) / (gap_high - gap_low);
            let gap = self.rules.gap(wall, place_at(time));
            if gap == 0.0 || (time - before).abs() <= 1e-16 {
                break;
            }
            if 0.0 < gap {
                if low == before {
                    gap_high /= 2.0;
                }
                (low, gap_low) = (time, gap);
            } else {
                if high == before {
                    gap_low /= 2.0;
                }
                (high, gap_high) = (time, gap);
            }
        }
        time
    }

    fn bounce(&mut self, wall: Wall) {
        let normal = self.rules.normal(wall, self.ball.position);
        let tangent = [normal[1], -normal[0]];
        let before = self.ball.velocity;
        let along = |direction: [f64; 2]| before[0] * direction[0] + before[1] * direction[1];
        let (normal_speed, tangential_velocity) = (along(normal), along(tangent));
        if normal_speed <= 0.0 {
            return;
        }
        let impact = Impact { wall, normal_speed, tangential_velocity, spin: self.spin };
        let unchanged = Change { restitution: 1.0, tangential_velocity, spin: self.spin };
        let change =
            self.rules.impact.iter().fold(unchanged, |change, (law, p)| law(p, &impact, change));
        for k in 0..2 {
            let after = change.tangential_velocity * tangent[k]
                - change.restitution * normal_speed * normal[k];
            self.slip[k] += after - before[k];
            self.ball.velocity[k] = after;
        }
        self.spin = change.spin;
        self.ball.since_impact = 0.0;
    }

    /// Complete a step in which the ball chatters against a wall: it only moves along the wall.
    fn rest_against_walls(&mut self, span: f64) {
        for wall in Wall::ALL {
            let normal = self.rules.normal(wall, self.ball.position);
            let velocity = self.ball.velocity;
            let outwards = velocity[0] * normal[0] + velocity[1] * normal[1];
            if self.rules.gap(wall, self.ball.position) < 1e-6 {
                self.ball.velocity = both(|k| velocity[k] - outwards * normal[k]);
            }
        }
        let forces = Forces { push: [0.0; 2], ..self.forces(span) };
        self.commit(self.free().after(&forces, span), span);
    }
}
