//! What the gantry is told to do: patterns as velocity references at 50 Hz.

use crate::{draw::Draw, gantry::HOME};
use std::f64::consts::{FRAC_1_SQRT_2, TAU};

/// Control period (s).
pub(crate) const PERIOD: f64 = 0.02;
/// Largest distance of the reference from home (m).
const REACH: [f64; 2] = [0.105, 0.062];
/// Longest rest at the end of each run (s), and its largest share of the run.
const REST: f64 = 0.3;
const REST_SHARE: f64 = 0.1;

/// What a session can show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Excitation {
    /// Everything: lines, diagonals, circle, ramp, walk, slow reversals.
    Full,
    /// Nothing below 0.25 m/s except in passing.
    Fast,
    /// Nothing above 0.06 m/s.
    Slow,
    /// Along x only.
    OnlyX,
    /// Always towards +x, +y, in small steps with rests.
    OneWay,
}

/// One scripted run.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub(crate) pattern: &'static str,
    pub(crate) start: f64,
    pub(crate) end: f64,
}

/// References at every control period.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) position: Vec<[f64; 2]>,
    pub(crate) velocity: Vec<[f64; 2]>,
    pub(crate) runs: Vec<Run>,
}

/// The runs of a session of `seconds`; `pace` scales all speeds.
pub(crate) fn plan(excitation: Excitation, seconds: f64, pace: f64, draw: &mut Draw) -> Plan {
    let patterns = patterns(excitation);
    let length = (seconds / patterns.len() as f64 / PERIOD).round() * PERIOD;
    let mut plan = Plan { position: Vec::new(), velocity: Vec::new(), runs: Vec::new() };
    let mut at = [0.0; 2];
    for (index, pattern) in patterns.iter().enumerate() {
        let start = index as f64 * length;
        plan.runs.push(Run { pattern, start, end: start + length });
        let mut walk = Walk::new(pattern, excitation, pace, draw);
        let steps = (length / PERIOD).round() as usize;
        for step in 0..steps {
            let time = step as f64 * PERIOD;
            let velocity = if length - REST.min(REST_SHARE * length) <= time {
                [0.0; 2]
            } else {
                walk.velocity(time, at, draw)
            };
            plan.velocity.push(velocity);
            for axis in 0..2 {
                at[axis] += velocity[axis] * PERIOD;
            }
            plan.position.push([HOME[0] + at[0], HOME[1] + at[1]]);
        }
    }
    plan
}

fn patterns(excitation: Excitation) -> Vec<&'static str> {
    match excitation {
        Excitation::Full => vec![
            "x_line",
            "y_line",
            "diagonal_up",
            "diagonal_down",
            "circle",
            "ramp",
            "random_walk",
            "slow_reversals",
        ],
        Excitation::Fast => {
            vec!["x_line", "y_line", "diagonal_up", "diagonal_down", "circle", "circle"]
        }
        Excitation::Slow => {
            vec!["slow_reversals", "slow_reversals", "slow_line", "slow_line", "slow_diagonal"]
        }
        Excitation::OnlyX => vec!["x_line", "x_line", "x_ramp", "x_line"],
        Excitation::OneWay => vec!["one_way", "one_way", "one_way"],
    }
}

/// One run's generator.
struct Walk {
    pattern: &'static str,
    speed: f64,
    direction: [f64; 2],
    phase: f64,
    held: [f64; 2],
    until: f64,
}

impl Walk {
    fn new(pattern: &'static str, excitation: Excitation, pace: f64, draw: &mut Draw) -> Self {
        let fast = draw.uniform(0.30, 0.55) * pace;
        let speed = match excitation {
            Excitation::Slow => draw.uniform(0.02, 0.05) * pace,
            Excitation::OneWay => draw.uniform(0.03, 0.06) * pace,
            _ => fast,
        };
        let direction = match pattern {
            "y_line" => [0.0, 1.0],
            "diagonal_up" | "slow_diagonal" => [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
            "diagonal_down" => [FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
            "slow_line" => draw.pick(&[[1.0, 0.0], [0.0, 1.0]]),
            "one_way" => [0.8, 0.45],
            _ => [1.0, 0.0],
        };
        let phase = draw.uniform(0.0, TAU);
        Self { pattern, speed, direction, phase, held: [0.0; 2], until: 0.0 }
    }

    fn velocity(&mut self, time: f64, at: [f64; 2], draw: &mut Draw) -> [f64; 2] {
        match self.pattern {
            "circle" => self.circle(time, at),
            "ramp" | "x_ramp" => self.ramp(time, at),
            "random_walk" => self.random(time, at, draw, [0.08, 0.4]),
            "slow_reversals" => self.slow(time, at, draw),
            "one_way" => self.one_way(time),
            _ => self.line(at),
        }
    }

    /// To and fro at constant speed along a line through home, back to it from aside.
    fn line(&mut self, at: [f64; 2]) -> [f64; 2] {
        let margin = 0.02f64.max(0.06 * self.speed);
        let d = self.direction;
        let reach = (0..2)
            .filter(|axis| d[*axis] != 0.0)
            .map(|axis| REACH[axis] / d[axis].abs())
            .fold(f64::INFINITY, f64::min);
        let along = at[0] * d[0] + at[1] * d[1];
        if reach - margin < along {
            self.direction = [-d[0], -d[1]];
        }
        let d = self.direction;
        let along = at[0] * d[0] + at[1] * d[1];
        let aside = |axis: usize| (-1.5 * (at[axis] - along * d[axis])).clamp(-0.2, 0.2);
        [d[0] * self.speed + aside(0), d[1] * self.speed + aside(1)]
    }

    fn circle(&self, time: f64, at: [f64; 2]) -> [f64; 2] {
        let radius = 0.045;
        let rate = self.speed / radius;
        let (sin, cos) = (rate * time + self.phase).sin_cos();
        let centre = |axis: usize| -2.5 * (at[axis] - radius * [cos, sin][axis]);
        [-self.speed * sin + centre(0), self.speed * cos + centre(1)]
    }

    /// Velocity rises and falls linearly, with growing peaks.
    fn ramp(&self, time: f64, at: [f64; 2]) -> [f64; 2] {
        let period = 0.9;
        let cycle = (time / period).rem_euclid(1.0);
        let triangle = if cycle < 0.5 { 4.0 * cycle - 1.0 } else { 3.0 - 4.0 * cycle };
        let shape = triangle * self.speed * (0.35 + 0.65 * (time / 3.0).min(1.0));
        let y = if self.pattern == "ramp" { 0.55 * shape } else { 0.0 };
        [shape - 1.5 * at[0], y - 1.5 * at[1]]
    }

    /// Velocities held for a random while; turned back near the ends.
    fn random(&mut self, time: f64, at: [f64; 2], draw: &mut Draw, hold: [f64; 2]) -> [f64; 2] {
        if self.until <= time {
            self.until = time + draw.uniform(hold[0], hold[1]);
            for axis in 0..2 {
                let room = REACH[axis] * 0.8;
                let mut value = draw.uniform(-1.2, 1.2) * self.speed;
                if room < (at[axis] + value * 0.15).abs() {
                    value = -value.abs() * at[axis].signum();
                }
                self.held[axis] = value;
            }
        }
        for axis in 0..2 {
            if REACH[axis] - 0.015 < at[axis].abs() && 0.0 < at[axis] * self.held[axis] {
                self.held[axis] = -self.held[axis];
            }
        }
        self.held
    }

    /// Creep with reversals: 3 to 40 mm/s.
    fn slow(&mut self, time: f64, at: [f64; 2], draw: &mut Draw) -> [f64; 2] {
        if self.until <= time {
            self.until = time + draw.uniform(0.15, 0.6);
            for axis in 0..2 {
                let magnitude = 0.003 * 13.0f64.powf(draw.unit());
                let back = if 0.03 < at[axis].abs() { -at[axis].signum() } else { draw.sign() };
                self.held[axis] = magnitude * back;
            }
        }
        self.held
    }

    fn one_way(&self, time: f64) -> [f64; 2] {
        let on = time.rem_euclid(1.0) < 0.6;
        let speed = if on { 0.6 * self.speed } else { 0.0 };
        [self.direction[0] * speed, self.direction[1] * speed]
    }
}
