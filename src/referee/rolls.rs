//! Segmentation of the ball's track into free rolls: most likely times of sudden velocity changes.
//!
//! Between impacts the ball rolls, x' = v, v' = -a v/|v| + w, with white noise w for unmodelled
//! effects. An impact between two frames changes the velocity arbitrarily and keeps the position.
//! Every segmentation then has a likelihood, by one Kalman filter per time of the last impact.
//! Dynamic programming finds the most likely one (Fearnhead and Liu, "On-line inference for
//! multiple changepoint problems", J. R. Stat. Soc. B 69, 2007), with few hypotheses kept per
//! frame. An outlier costs as much as a uniform position on the board.
//!
//! Both axes have the same noise, so one covariance serves both.

use super::{
    rules::Rules,
    vector::{Vector, distance, length},
};
use std::ops::Range;

/// Rolling resistance (m/s^2): coefficient 0.008 times gravity, a steel ball on painted wood.
const ROLLING: f64 = 0.08;
/// Speed below which the ball counts as at rest (m/s).
const STANDING: f64 = 0.02;
/// Spectral density of unmodelled accelerations (m^2/s^3).
const UNMODELLED: f64 = 1e-3;
/// The same in the first frames after an impact, when the ball may still slide.
const UNMODELLED_YOUNG: f64 = 4e-3;
/// Duration of that phase (s).
const YOUNG: f64 = 0.1;
/// Standard deviation of each component of the velocity after an impact (m/s).
const SPREAD_AFTER: f64 = 0.8;
/// Negative log-probability of an impact in one frame, near an obstacle and in the open.
const COST_NEAR: f64 = 3.0;
const COST_OPEN: f64 = 13.0;
/// Length over which the first value changes into the second (m), and distance at which that
/// begins.
const COST_OVER: f64 = 0.008;
const NEAR: f64 = 0.004;
/// The same for a bounce of a ball that reaches a wall, within this distance (m).
const COST_BOUNCE: f64 = 1.0;
const AT_WALL: f64 = 0.001;
/// Prior of the velocity after a bounce: restitution, and its standard deviation at rest (m/s) and
/// relative to the incoming speed.
const USUAL_BOUNCE: f64 = 0.75;
const BOUNCE_SPREAD: [f64; 2] = [0.02, 0.2];
/// Negative log-probability of an outlier.
const COST_ASTRAY: f64 = 7.0;
/// Number of hypotheses kept per frame, and their maximum loss of log-likelihood relative to the
/// best (nats).
const KEPT: usize = 8;
const WORST: f64 = 18.0;

/// One accepted position of the ball.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Time since the recording began (s).
    pub(super) time: f64,
    pub(super) position: Vector,
    /// Left and right striker at that time.
    pub(super) strikers: [Option<Vector>; 2],
}

/// A part of the track without gaps, with the times of its velocity changes.
#[derive(Debug, Clone)]
pub(super) struct Stretch {
    /// Accepted samples of the stretch, in order.
    pub(super) samples: Vec<Sample>,
    /// Index of the first sample after each change; increasing.
    pub(super) changes: Vec<usize>,
}

/// Split `samples` at gaps longer than `rules.longest_gap` and segment each stretch into rolls.
/// `noise` is the standard deviation of one coordinate (m).
pub(super) fn divide(samples: &[Sample], noise: f64, rules: &Rules) -> Vec<Stretch> {
    stretches(samples, rules.longest_gap)
        .into_iter()
        .map(|stretch| Division::new(noise, rules).run(&samples[stretch]))
        .collect()
}

fn stretches(samples: &[Sample], longest_gap: f64) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut start = 0;
    for end in 1..=samples.len() {
        let goes_on =
            end < samples.len() && samples[end].time - samples[end - 1].time <= longest_gap;
        if !goes_on {
            found.push(start..end);
            start = end;
        }
    }
    found
}

/// A hypothesis: position and velocity with their common covariance, and its history.
#[derive(Debug, Clone, Copy)]
struct Belief {
    position: Vector,
    velocity: Vector,
    /// Variances of position and velocity, and their covariance, of each axis.
    covariance: [f64; 3],
    /// Negative log-likelihood up to here.
    cost: f64,
    /// Time of the last change.
    since: f64,
    /// Index of the end of its history in `Division::history`.
    history: u32,
}

/// Result of a sample, and link to the previous one.
#[derive(Debug, Clone, Copy)]
struct Step {
    sample: u32,
    what: StepKind,
    before: u32,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum StepKind {
    Change,
    Astray,
}

const NO_HISTORY: u32 = u32::MAX;

struct Division<'a> {
    variance: f64,
    rules: &'a Rules,
    /// Negative log density of a uniform position on the board.
    anywhere: f64,
    beliefs: Vec<Belief>,
    next: Vec<Belief>,
    history: Vec<Step>,
}

impl<'a> Division<'a> {
    fn new(noise: f64, rules: &'a Rules) -> Self {
        Self {
            variance: noise * noise,
            rules,
            anywhere: (rules.board.short_side * rules.board.long_side).ln(),
            beliefs: Vec::new(),
            next: Vec::new(),
            history: Vec::new(),
        }
    }

    fn run(mut self, samples: &[Sample]) -> Stretch {
        let Some(first) = samples.first() else {
            return Stretch { samples: vec![], changes: vec![] };
        };
        self.beliefs.push(Belief {
            position: first.position,
            velocity: [0.0; 2],
            covariance: [self.variance, SPREAD_AFTER * SPREAD_AFTER, 0.0],
            cost: 0.0,
            since: first.time,
            history: NO_HISTORY,
        });
        for at in 1..samples.len() {
            self.advance(samples, at);
        }
        self.finish(samples)
    }

    /// Process sample `at`.
    fn advance(&mut self, samples: &[Sample], at: usize) {
        let (before, now) = (&samples[at - 1], &samples[at]);
        let dt = now.time - before.time;
        self.next.clear();
        let mut change: Option<Belief> = None;
        for idx in 0..self.beliefs.len() {
            let belief = self.beliefs[idx];
            let rolled = roll(&belief, now.time, dt);
            let kept = self.measured(&rolled, now.position);
            // Skip an outlier that no hypothesis explains.
            if belief.cost + self.anywhere + COST_ASTRAY < kept.cost {
                let history = self.remember(at, StepKind::Astray, belief.history);
                let cost = belief.cost + self.anywhere + COST_ASTRAY;
                self.next.push(Belief { cost, history, ..rolled });
            } else {
                self.next.push(kept);
            }
            let open = self.struck(&belief, now, dt);
            for struck in self.bounced(&rolled, now).into_iter().chain([open]) {
                if change.is_none_or(|other| struck.cost < other.cost) {
                    change = Some(struck);
                }
            }
        }
        if let Some(mut change) = change {
            change.history = self.remember(at, StepKind::Change, change.history);
            self.next.push(change);
        }
        self.prune();
    }

    fn remember(&mut self, sample: usize, what: StepKind, before: u32) -> u32 {
        self.history.push(Step { sample: sample as u32, what, before });
        (self.history.len() - 1) as u32
    }

    /// Hypothesis of an impact between the frames, updated with `now`.
    fn struck(&self, belief: &Belief, now: &Sample, dt: f64) -> Belief {
        let spread = SPREAD_AFTER * SPREAD_AFTER;
        let [position, velocity, both] = belief.covariance;
        let half = 0.5 * dt;
        let moved = position + half * (2.0 * both + half * velocity);
        // Mean squares of a uniform time within the frame: a twelfth for the path before it, a
        // third for the path after it.
        let speed = length(belief.velocity);
        let unknown = dt * dt * (speed * speed / 24.0 + spread / 3.0);
        let prior = Belief {
            position: [0, 1].map(|k| belief.position[k] + half * belief.velocity[k]),
            velocity: [0.0; 2],
            covariance: [moved + unknown, spread, spread * half],
            cost: belief.cost + self.cost_of_impact(belief.position, now),
            since: now.time,
            ..*belief
        };
        self.measured(&prior, now.position)
    }

    /// Hypothesis of a bounce at the wall beyond which `rolled` is, updated with `now`; `None`
    /// without such a wall.
    fn bounced(&self, rolled: &Belief, now: &Sample) -> Option<Belief> {
        let reach = self.rules.reach();
        let beyond = |axis: usize| rolled.position[axis].abs() - reach[axis];
        let axis = usize::from(beyond(0) < beyond(1));
        let sign = rolled.position[axis].signum();
        let came = sign * rolled.velocity[axis];
        if beyond(axis) < -AT_WALL || came <= 0.0 {
            return None;
        }
        let mut bounced = *rolled;
        let over = beyond(axis).max(0.0);
        bounced.position[axis] -= sign * over * (1.0 + USUAL_BOUNCE);
        bounced.velocity[axis] = -sign * USUAL_BOUNCE * came;
        let unsure = BOUNCE_SPREAD[0] + BOUNCE_SPREAD[1] * came;
        bounced.covariance[1] += unsure * unsure;
        bounced.cost += COST_BOUNCE;
        bounced.since = now.time;
        Some(self.measured(&bounced, now.position))
    }

    /// Cost of an impact: low near walls, strikers and cups.
    fn cost_of_impact(&self, before: Vector, now: &Sample) -> f64 {
        let clearance = self.clearance(before, now).min(self.clearance(now.position, now));
        let open = ((clearance - NEAR) / COST_OVER).clamp(0.0, 1.0);
        COST_NEAR + open * (COST_OPEN - COST_NEAR)
    }

    fn clearance(&self, position: Vector, now: &Sample) -> f64 {
        let reach = self.rules.reach();
        let wall = (reach[0] - position[0].abs()).min(reach[1] - position[1].abs());
        let striker = now
            .strikers
            .iter()
            .flatten()
            .map(|striker| distance(position, *striker) - self.rules.touching())
            .fold(f64::INFINITY, f64::min);
        wall.min(striker)
    }

    /// Update with a measured position.
    fn measured(&self, belief: &Belief, position: Vector) -> Belief {
        let [pp, vv, pv] = belief.covariance;
        let total = pp + self.variance;
        let (gain_place, gain_velocity) = (pp / total, pv / total);
        let off = [position[0] - belief.position[0], position[1] - belief.position[1]];
        let square = off[0] * off[0] + off[1] * off[1];
        Belief {
            position: [0, 1].map(|k| belief.position[k] + gain_place * off[k]),
            velocity: [0, 1].map(|k| belief.velocity[k] + gain_velocity * off[k]),
            covariance: [pp * (1.0 - gain_place), vv - gain_velocity * pv, pv * (1.0 - gain_place)],
            cost: belief.cost + 0.5 * square / total + (std::f64::consts::TAU * total).ln(),
            ..*belief
        }
    }

    /// Keep the most likely hypotheses.
    fn prune(&mut self) {
        self.next.sort_unstable_by(|a, b| a.cost.total_cmp(&b.cost));
        let worst = self.next.first().map_or(0.0, |best| best.cost) + WORST;
        self.next.truncate(KEPT);
        self.next.retain(|belief| belief.cost <= worst);
        std::mem::swap(&mut self.beliefs, &mut self.next);
    }

    fn finish(self, samples: &[Sample]) -> Stretch {
        let best = self.beliefs.iter().min_by(|a, b| a.cost.total_cmp(&b.cost));
        let mut at = best.map_or(NO_HISTORY, |best| best.history);
        let mut astray = vec![false; samples.len()];
        let mut changes = Vec::new();
        while at != NO_HISTORY {
            let step = self.history[at as usize];
            match step.what {
                StepKind::Change => changes.push(step.sample as usize),
                StepKind::Astray => astray[step.sample as usize] = true,
            }
            at = step.before;
        }
        changes.reverse();
        // Indices among the accepted samples.
        let mut kept_before = Vec::with_capacity(samples.len() + 1);
        let mut count = 0;
        for astray in &astray {
            kept_before.push(count);
            count += usize::from(!astray);
        }
        let fits = samples.iter().zip(&astray).filter(|(_, astray)| !**astray);
        Stretch {
            samples: fits.map(|(sample, _)| *sample).collect(),
            changes: changes.into_iter().map(|at| kept_before[at]).collect(),
        }
    }
}

/// Predict a free roll of `dt` to `now`.
fn roll(belief: &Belief, now: f64, dt: f64) -> Belief {
    let [pp, vv, pv] = belief.covariance;
    let young = now - belief.since < YOUNG;
    let q = if young { UNMODELLED_YOUNG } else { UNMODELLED };
    let speed = length(belief.velocity);
    let slower = if speed <= STANDING { 1.0 } else { 1.0 - (ROLLING * dt / speed).min(1.0) };
    let velocity = belief.velocity.map(|v| v * slower);
    let mean = [0, 1].map(|k| 0.5 * (belief.velocity[k] + velocity[k]));
    Belief {
        position: [0, 1].map(|k| belief.position[k] + dt * mean[k]),
        velocity,
        covariance: [
            pp + dt * (2.0 * pv + dt * vv) + q * dt * dt * dt / 3.0,
            vv + q * dt,
            pv + dt * vv + q * dt * dt / 2.0,
        ],
        ..*belief
    }
}
