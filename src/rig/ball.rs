//! Ball dynamics: rolling, walls, strikers, cups.
//!
//! Rolling without slip: deceleration `c g + b v + k v^2` against the motion, and `5/7 g` times the
//! slope of the board (tilt, crown). Impacts: `u' = -e u` along the normal with `e = e0 - e1 u`.
//! The tangential impulse is at most `mu` times the normal one (Coulomb). It is also at most 2/7 of
//! the impulse that would end the sliding: a solid sphere leaves the contact rolling. After an
//! impact the ball may slide until it rolls again, and the magnets may attract it. Spin about the
//! vertical is neglected. Motion within a step is swept: the earliest contact is found by solving
//! for its time, so no contact is missed.

use super::{
    config::{BallConfig, CupConfig, Launch},
    length,
    magnet::Peg,
    truth::Hits,
};
use crate::seed::Stream;

const GRAVITY: f64 = 9.81;
/// Fraction of gravity along a slope that accelerates a solid sphere.
const ROLLING: f64 = 5.0 / 7.0;
/// Fraction of the slip that a sphere can lose before it rolls.
const GRIP: f64 = 2.0 / 7.0;
/// Normal speed below which an impact does not bounce (m/s).
const LEAST_BOUNCE: f64 = 0.005;
/// Maximum number of impacts within one step; the rest of the step is then lost.
const MOST_IMPACTS: usize = 8;
/// Speed below which the ball counts as at rest (m/s).
const STILL: f64 = 0.005;

/// State of the ball, with its surroundings.
#[derive(Debug, Clone)]
pub(super) struct Ball {
    /// Position (m); `None` without a ball.
    pub(super) place: Option<[f64; 2]>,
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// Number of balls in the cup of y < 0 and of y > 0.
    pub(super) goals: [u32; 2],
    /// Number of times that the ball was put on the board.
    pub(super) served: u32,
    /// Bounces off the strikers, left first.
    pub(super) hits: [Hits; 2],
    in_cup_s: Option<f64>,
    still_since_s: Option<f64>,
    next_launch_s: f64,
    config: BallConfig,
    cups: CupConfig,
    half_board: [f64; 2],
    /// Lower and upper limit of its centre (m).
    reach: [[f64; 2]; 2],
    /// Surface velocity relative to the centre at the board, reversed (m/s): equals the velocity
    /// when rolling.
    spin: [f64; 2],
    launches: Stream,
    serves: Serves,
}

/// Serves of a ball: first position and velocity, from the start in the configuration with its
/// random displacement. Equal configurations and seeds give equal serves, so that a simulated
/// match begins every episode as a match on the rig does.
#[derive(Debug, Clone)]
pub struct Serves {
    start: Option<Launch>,
    spread_m: f64,
    top_m_per_s: f64,
    stream: Stream,
}

impl Serves {
    /// Serves of a rig with the ball `config` and this seed.
    #[must_use]
    pub fn new(config: &BallConfig, seed: u64) -> Self {
        Self {
            start: config.start,
            spread_m: config.serve_spread_m,
            top_m_per_s: config.serve_speed_m_per_s,
            stream: Stream::new(seed, "rig.ball.serve"),
        }
    }
}

impl Iterator for Serves {
    /// Position (m) and velocity (m/s).
    type Item = [[f64; 2]; 2];

    /// The next serve; `None` for a ball without a start.
    fn next(&mut self) -> Option<Self::Item> {
        let Launch { x_m, y_m, vx_m_per_s, vy_m_per_s } = self.start?;
        let (mut place, mut velocity) = ([x_m, y_m], [vx_m_per_s, vy_m_per_s]);
        let (spread, top) = (self.spread_m, self.top_m_per_s);
        if 0.0 < spread {
            place = place.map(|at| at + draw(&mut self.stream, [-spread, spread]));
        }
        if 0.0 < top {
            let given = push(&mut self.stream, top / 2.0, top);
            velocity = [velocity[0] + given[0], velocity[1] + given[1]];
        }
        Some([place, velocity])
    }
}

/// Obstacle of the next impact.
enum Obstacle {
    Wall { axis: usize },
    Peg { idx: usize },
}

impl Ball {
    pub(super) fn new(
        config: &BallConfig,
        cups: &CupConfig,
        half_board: [f64; 2],
        seed: u64,
    ) -> Self {
        let shift = &config.wall_shift;
        let bound = |axis: usize, low: f64, high: f64| {
            let half = half_board[axis] - config.radius_m;
            [-half - low, half + high]
        };
        let reach =
            [bound(0, shift.x_low_m, shift.x_high_m), bound(1, shift.y_low_m, shift.y_high_m)];
        let mut ball = Self {
            place: None,
            velocity: [0.0; 2],
            goals: [0; 2],
            served: 0,
            hits: [Hits::default(); 2],
            in_cup_s: None,
            still_since_s: None,
            next_launch_s: config.launch_every_s,
            config: config.clone(),
            cups: cups.clone(),
            half_board,
            reach,
            spin: [0.0; 2],
            launches: Stream::new(seed, "rig.ball.launch"),
            serves: Serves::new(config, seed),
        };
        ball.put_back();
        ball
    }

    /// Advance by `dt` (s) until `now_s`; the strikers have already moved and take their part of
    /// every impact.
    pub(super) fn step(&mut self, now_s: f64, dt: f64, pegs: &mut [Peg; 2]) {
        self.handle(now_s);
        let Some(mut place) = self.place else { return };
        if self.in_cup_s.is_some() {
            return;
        }
        self.attract(place, dt, pegs);
        self.roll(place, dt);
        self.slide(dt);
        let mut left = dt;
        for _ in 0..MOST_IMPACTS {
            let Some((time, obstacle)) = self.first_impact(place, left, pegs) else { break };
            for (axis, coordinate) in place.iter_mut().enumerate() {
                *coordinate += self.velocity[axis] * time;
            }
            left -= time;
            match obstacle {
                Obstacle::Wall { axis } => self.hit_wall(axis),
                Obstacle::Peg { idx } => {
                    let closing = self.hit_peg(place, left, &mut pegs[idx]);
                    if LEAST_BOUNCE <= closing {
                        let count = self.hits[idx].count + 1;
                        self.hits[idx] = Hits { count, newest_m_per_s: closing };
                    }
                }
            }
        }
        for (axis, coordinate) in place.iter_mut().enumerate() {
            let [low, high] = self.reach[axis];
            *coordinate = (*coordinate + self.velocity[axis] * left).clamp(low, high);
        }
        self.place = Some(place);
        self.enter_cup(place, now_s);
    }

    /// Actions of people: return the ball after a goal or when it is at rest, and roll it
    /// periodically.
    fn handle(&mut self, now_s: f64) {
        let still =
            self.place.is_some() && self.in_cup_s.is_none() && length(self.velocity) < STILL;
        self.still_since_s = if still { self.still_since_s.or(Some(now_s)) } else { None };
        let is_over = |since: Option<f64>, wait: f64| {
            since.is_some_and(|since| 0.0 < wait && since + wait <= now_s)
        };
        if is_over(self.in_cup_s, self.config.put_back_after_s)
            || is_over(self.still_since_s, self.config.put_back_still_after_s)
        {
            self.put_back();
        }
        if 0.0 < self.config.launch_every_s && self.next_launch_s <= now_s {
            self.next_launch_s += self.config.launch_every_s;
            let launch = self.reach.map(|bounds| draw(&mut self.launches, bounds));
            let top = self.config.launch_speed_m_per_s;
            self.place = Some(launch);
            self.velocity = push(&mut self.launches, top / 5.0, top);
            self.spin = self.velocity;
            self.in_cup_s = None;
        }
    }

    fn put_back(&mut self) {
        self.in_cup_s = None;
        self.still_since_s = None;
        let Some([place, velocity]) = self.serves.next() else { return };
        self.served += 1;
        self.place =
            Some([0, 1].map(|axis| place[axis].clamp(self.reach[axis][0], self.reach[axis][1])));
        self.velocity = velocity;
        self.spin = velocity;
    }

    fn roll(&mut self, place: [f64; 2], dt: f64) {
        let config = &self.config;
        let [half_x, half_y] = self.half_board;
        // h = crown (1 - (x/a)^2)(1 - (y/b)^2)
        let [across, along] = [place[0] / half_x, place[1] / half_y];
        let slope = [
            config.x_tilt_rad - 2.0 * config.crown_m * across / half_x * (1.0 - along * along),
            config.y_tilt_rad - 2.0 * config.crown_m * along / half_y * (1.0 - across * across),
        ];
        for (axis, slope) in slope.into_iter().enumerate() {
            self.velocity[axis] -= ROLLING * GRAVITY * slope * dt;
        }
        let speed = length(self.velocity);
        let patch = &config.patch;
        let worse = if length([place[0] - patch.x_m, place[1] - patch.y_m]) < patch.radius_m {
            patch.extra_resistance
        } else {
            0.0
        };
        let loss = ((config.rolling_resistance + worse) * GRAVITY
            + (config.viscous_per_s + config.quadratic_per_m * speed) * speed)
            * dt;
        let kept = if speed <= loss { 0.0 } else { 1.0 - loss / speed };
        self.velocity = self.velocity.map(|v| v * kept);
        self.spin = self.spin.map(|u| u * kept);
    }

    /// Sliding friction on the slip `v - u`: the centre loses `mu g`, the surface gains 5/2 of it.
    fn slide(&mut self, dt: f64) {
        let slip = [0, 1].map(|axis| self.velocity[axis] - self.spin[axis]);
        let size = length(slip);
        let change = self.config.sliding_friction * GRAVITY * dt;
        // The slip decreases by 7/2 of the change; rolling begins when it is zero.
        if self.config.sliding_friction == 0.0 {
            self.spin = self.velocity;
        } else if 0.0 < size {
            let part = change.min(size * 2.0 / 7.0) / size;
            for (axis, slip) in slip.into_iter().enumerate() {
                self.velocity[axis] -= slip * part;
                self.spin[axis] += slip * part * 2.5;
            }
        }
    }

    /// Attraction of the ball by the magnet of a striker.
    fn attract(&mut self, place: [f64; 2], dt: f64, pegs: &[Peg; 2]) {
        let config = &self.config;
        if config.peg_attraction_m_per_s2 == 0.0 {
            return;
        }
        for peg in pegs {
            let way = [0, 1].map(|axis| peg.position[axis] - place[axis]);
            let distance = length(way).max(1e-6);
            let gap = (distance - config.radius_m - peg.radius()).max(0.0);
            let pull =
                config.peg_attraction_m_per_s2 * (-gap / config.peg_attraction_range_m).exp();
            for (axis, way) in way.into_iter().enumerate() {
                self.velocity[axis] += pull * way / distance * dt;
            }
        }
    }

    fn first_impact(&self, place: [f64; 2], left: f64, pegs: &[Peg; 2]) -> Option<(f64, Obstacle)> {
        let mut first: Option<(f64, Obstacle)> = None;
        let mut offer = |time: f64, obstacle: Obstacle| {
            if first.as_ref().is_none_or(|(earliest, _)| time < *earliest) {
                first = Some((time, obstacle));
            }
        };
        for (axis, coordinate) in place.into_iter().enumerate() {
            let velocity = self.velocity[axis];
            let reach = self.reach[axis][usize::from(0.0 < velocity)];
            let beyond = coordinate + velocity * left - reach;
            if velocity != 0.0 && 0.0 < beyond * velocity {
                let time = ((reach - coordinate) / velocity).clamp(0.0, left);
                offer(time, Obstacle::Wall { axis });
            }
        }
        for (idx, peg) in pegs.iter().enumerate() {
            if let Some(time) = self.time_to_peg(place, left, peg) {
                offer(time, Obstacle::Peg { idx });
            }
        }
        first
    }

    /// Solve `|d + w t| = R` for the first `t` in `[0, left]`, with `d` from striker to ball.
    fn time_to_peg(&self, place: [f64; 2], left: f64, peg: &Peg) -> Option<f64> {
        let touch = self.config.radius_m + peg.radius();
        let w = [0, 1].map(|axis| self.velocity[axis] - peg.velocity[axis]);
        // The striker is at its position of the end of the step.
        let d = [0, 1].map(|axis| place[axis] - (peg.position[axis] - peg.velocity[axis] * left));
        let closing = d[0] * w[0] + d[1] * w[1];
        if 0.0 <= closing {
            return None;
        }
        let gap = d[0] * d[0] + d[1] * d[1] - touch * touch;
        if gap <= 0.0 {
            return Some(0.0);
        }
        let square = w[0] * w[0] + w[1] * w[1];
        let root = closing * closing - square * gap;
        if root < 0.0 {
            return None;
        }
        let time = gap / (-closing + root.sqrt());
        (time <= left).then_some(time)
    }

    fn hit_wall(&mut self, axis: usize) {
        let speed = self.velocity[axis].abs();
        let config = &self.config;
        let bounce =
            restitution(config.wall_restitution, config.wall_restitution_loss_s_per_m, speed);
        self.velocity[axis] *= -bounce;
        let along = &mut self.velocity[1 - axis];
        let loss = (config.wall_friction * (1.0 + bounce) * speed).min(GRIP * along.abs());
        *along -= loss.copysign(*along);
    }

    /// Impact on a striker; return the closing speed (m/s).
    fn hit_peg(&mut self, place: [f64; 2], left: f64, peg: &mut Peg) -> f64 {
        let d = [0, 1].map(|axis| place[axis] - (peg.position[axis] - peg.velocity[axis] * left));
        let distance = length(d);
        if distance == 0.0 {
            return 0.0;
        }
        let normal = d.map(|component| component / distance);
        let w = [0, 1].map(|axis| self.velocity[axis] - peg.velocity[axis]);
        let closing = -(w[0] * normal[0] + w[1] * normal[1]);
        let slide = w[1] * normal[0] - w[0] * normal[1];
        let config = &self.config;
        let bounce =
            restitution(config.peg_restitution, config.peg_restitution_loss_s_per_m, closing);
        let reduced = 1.0 / (1.0 / config.mass_kg + 1.0 / peg.mass());
        let push = (1.0 + bounce) * reduced * closing;
        let rub = (config.peg_friction * push).min(GRIP * reduced * slide.abs()).copysign(-slide);
        let impulse = [push * normal[0] - rub * normal[1], push * normal[1] + rub * normal[0]];
        for (axis, impulse) in impulse.into_iter().enumerate() {
            self.velocity[axis] += impulse / config.mass_kg;
            let change = impulse / peg.mass();
            peg.velocity[axis] -= change;
            peg.position[axis] -= change * left;
        }
        closing
    }

    fn enter_cup(&mut self, place: [f64; 2], now_s: f64) {
        let side = if place[1] < 0.0 { -1.0 } else { 1.0 };
        let centre = [0.0, self.cups.distance_m * side];
        let distance = length([place[0] - centre[0], place[1] - centre[1]]);
        let speed = length(self.velocity);
        if distance < self.cups.radius_m && speed <= self.cups.capture_speed_m_per_s {
            self.place = Some(centre);
            self.velocity = [0.0; 2];
            self.in_cup_s = Some(now_s);
            self.goals[usize::from(0.0 < side)] += 1;
        }
    }
}

fn draw(stream: &mut Stream, [low, high]: [f64; 2]) -> f64 {
    low + (high - low) * f64::from(stream.uniform_f32(0.0, 1.0))
}

/// Velocity (m/s) in a random direction, with a speed from `least` to `top`.
fn push(stream: &mut Stream, least: f64, top: f64) -> [f64; 2] {
    let speed = draw(stream, [least, top]);
    let angle = draw(stream, [0.0, std::f64::consts::TAU]);
    [speed * angle.cos(), speed * angle.sin()]
}

fn restitution(at_rest: f64, loss: f64, speed: f64) -> f64 {
    if speed < LEAST_BOUNCE { 0.0 } else { (at_rest - loss * speed).clamp(0.0, 1.0) }
}
