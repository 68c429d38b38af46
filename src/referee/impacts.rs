//! Time, position and cause of each impact on the ball.
//!
//! Around a velocity change the ball's track is two straight lines that meet. Position and both
//! velocities follow by least squares for every impact time. Each possible cause has a misfit. A wall
//! has a fixed position and reduces the speed. A striker, at its interpolated position, is one contact
//! distance away and pushes outwards. The time and the cause with the least misfit are selected. The
//! confidence is the normalized likelihood of the selected cause, relative to all causes and to no
//! impact.

use super::{
    rolls::{Sample, Stretch},
    rules::Rules,
    vector::{Vector, distance, dot, length, minus, plus, times},
};
use crate::{board::CUP_RADIUS, recording::topic::Player};
use std::ops::Range;

/// Number of frames on each side for the velocities.
const BESIDE: usize = 9;
/// Time steps per frame.
const STEPS: usize = 4;
/// Maximum error of the segmentation (frames).
const AROUND: usize = 2;
/// Standard deviation of the prior on velocities (m/s); it matters only if a side has a single
/// frame.
const SPREAD: f64 = 1.0;
/// Range of plausible restitution.
const RESTITUTION: Range<f64> = 0.1..1.15;
/// Maximum ratio of tangential to normal velocity change: friction.
const FRICTION: f64 = 0.3;
/// Maximum reversed tangential velocity, relative to the same: spin.
const REVERSAL: f64 = 0.05;
/// Standard deviation of velocities in addition to camera noise (m/s): sliding, spin, compliant
/// strikers.
const VELOCITY_TOLERANCE: f64 = 0.03;
/// Negative log-probability of a cause relative to the most likely one.
const COST_BOTH: f64 = 3.0;
const COST_RIM: f64 = 3.0;
/// In a corner two bounces are expected.
const COST_CORNER: f64 = 0.0;
const COST_NOTHING: f64 = 9.0;
/// Log-likelihood that the three additional parameters of an impact gain by chance (nats).
const CHANCE: f64 = 6.0;
/// Half-width of the ring around a cup in which its edge acts (m).
const RIM: f64 = 0.004;

/// Cause of an impact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Cause {
    /// Wall at the end of this axis (0 across, 1 along), on this side (sign).
    Wall(usize, f64),
    Striker(Player),
    /// Striker and wall within one frame.
    StrikerAtWall(Player, usize, f64),
    /// Edge of a cup, or the ball in it.
    Rim,
    /// Unknown cause, such as a hand.
    Unknown,
}

impl Cause {
    pub(super) fn striker(self) -> Option<Player> {
        match self {
            Self::Striker(player) | Self::StrikerAtWall(player, ..) => Some(player),
            _ => None,
        }
    }

    pub(super) fn is_wall(self) -> bool {
        matches!(self, Self::Wall(..) | Self::StrikerAtWall(..))
    }
}

/// A sudden change of the ball's velocity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Impact {
    /// Time since the recording began (s).
    pub(super) time: f64,
    pub(super) position: Vector,
    /// Velocity before (m/s).
    pub(super) before: Vector,
    pub(super) after: Vector,
    pub(super) cause: Cause,
    /// Normalized likelihood of the cause, 0 to 1.
    pub(super) confidence: f64,
}

impl Impact {
    /// Magnitude of the velocity change (m/s).
    pub(super) fn size(&self) -> f64 {
        distance(self.after, self.before)
    }
}

/// Impacts of one stretch, in order.
pub(super) fn find(stretch: &Stretch, noise: f64, rules: &Rules) -> Vec<Impact> {
    let samples = &stretch.samples;
    let changes = &stretch.changes;
    let mut found = Vec::with_capacity(changes.len());
    let mut from = 0;
    while from < changes.len() {
        let apart = |pair: &[usize]| pair[1] - pair[0] <= AROUND;
        let close = changes[from..].windows(2).take_while(|pair| apart(pair)).count();
        let to = from + close + 1;
        let first = if from == 0 { 0 } else { changes[from - 1] };
        let end = changes.get(to).copied().unwrap_or(samples.len());
        let near = |first, at, end| Neighbourhood { samples, first, at, end };
        let one_by_one: Vec<Impact> = (from..to)
            .flat_map(|k| {
                let before = if k == from { first } else { changes[k - 1] };
                let after = if k + 1 == to { end } else { changes[k + 1] };
                near(before, changes[k], after).impacts(noise, rules)
            })
            .collect();
        // Two changes that are a frame apart have too few data for two separate impacts, but
        // together they may be those of a corner.
        let together = if one_by_one.len() < to - from {
            near(first, changes[from], end).impacts(noise, rules)
        } else {
            Vec::new()
        };
        found.extend(if one_by_one.len() < together.len() { together } else { one_by_one });
        from = to;
    }
    found
}

/// A velocity change with the rolls before and after it.
struct Neighbourhood<'a> {
    samples: &'a [Sample],
    /// First sample of the roll before.
    first: usize,
    /// First sample after the change.
    at: usize,
    /// End of the roll after.
    end: usize,
}

/// Two lines that meet at `time`.
#[derive(Debug, Clone, Copy)]
struct Meeting {
    time: f64,
    position: Vector,
    before: Vector,
    after: Vector,
    /// Variance of each coordinate of position and velocities.
    place_variance: f64,
    before_variance: f64,
    after_variance: f64,
    /// Half the sum of squared residuals over the variance, by axis.
    misfit: Vector,
}

impl Neighbourhood<'_> {
    /// Impacts at this change: usually one; two in a corner.
    fn impacts(&self, noise: f64, rules: &Rules) -> Vec<Impact> {
        let window = self.first.max(self.at.saturating_sub(BESIDE))..self.end.min(self.at + BESIDE);
        if self.at <= window.start || window.end <= self.at {
            return Vec::new();
        }
        let samples = &self.samples[window.clone()];
        let at = self.at - window.start;
        let mut tally = Tally::default();
        let mut corner = Corner::default();
        for time in times_around(samples, at) {
            let meeting = meet(samples, time, noise);
            corner.offer(&meeting, rules);
            let strikers = strikers_at(samples, time);
            for (cause, cost) in costs(&meeting, strikers, noise, rules) {
                tally.add(cause, meeting.misfit[0] + meeting.misfit[1] + cost, &meeting);
            }
        }
        let straight = straight_misfit(samples, noise) - CHANCE;
        match tally.verdict(straight) {
            Some((_, least)) if corner.cost() < least => corner.impacts(least),
            Some((impact, _)) => vec![impact],
            None => Vec::new(),
        }
    }
}

/// Candidate times of the impact: some frames around the change.
fn times_around(samples: &[Sample], at: usize) -> impl Iterator<Item = f64> {
    let from = at.saturating_sub(AROUND + 1).max(usize::from(AROUND + 1 < at));
    let to = (at + AROUND).min(samples.len() - 1);
    let (start, end) = (samples[from].time, samples[to].time);
    let steps = STEPS * (to - from);
    (0..=steps).map(move |step| start + (end - start) * step as f64 / steps as f64)
}

/// Least-squares fit of two lines that meet at `time`, with a prior on the velocities.
fn meet(samples: &[Sample], time: f64, noise: f64) -> Meeting {
    let ridge = (noise / SPREAD).powi(2);
    let origin = samples[0].position;
    let mut sums = [[0.0; 2]; 2]; // of times and of their squares, before and after
    sums[0][1] = ridge;
    sums[1][1] = ridge;
    let mut positions = [0.0; 2];
    let mut products = [[0.0; 2]; 2];
    let mut squares = [0.0; 2];
    for sample in samples {
        let tau = sample.time - time;
        let side = usize::from(0.0 < tau);
        sums[side][0] += tau;
        sums[side][1] += tau * tau;
        let position = minus(sample.position, origin);
        for axis in 0..2 {
            positions[axis] += position[axis];
            products[side][axis] += tau * position[axis];
        }
        squares = [0, 1].map(|axis| squares[axis] + position[axis] * position[axis]);
    }
    let share = |side: usize| sums[side][0] / sums[side][1];
    let weight = samples.len() as f64 - share(0) * sums[0][0] - share(1) * sums[1][0];
    let position = [0, 1].map(|axis| {
        (positions[axis] - share(0) * products[0][axis] - share(1) * products[1][axis]) / weight
    });
    let velocity = |side: usize| {
        [0, 1].map(|axis| (products[side][axis] - sums[side][0] * position[axis]) / sums[side][1])
    };
    let (before, after) = (velocity(0), velocity(1));
    let explained = |axis: usize| {
        positions[axis] * position[axis]
            + products[0][axis] * before[axis]
            + products[1][axis] * after[axis]
    };
    let variance = noise * noise;
    let spread =
        |side: usize| variance * (1.0 / sums[side][1] + share(side) * share(side) / weight);
    Meeting {
        time,
        position: plus(origin, position),
        before,
        after,
        place_variance: variance / weight,
        before_variance: spread(0),
        after_variance: spread(1),
        misfit: [0, 1].map(|axis| 0.5 * (squares[axis] - explained(axis)).max(0.0) / variance),
    }
}

/// Half the sum of squared residuals over the variance, for one straight line.
fn straight_misfit(samples: &[Sample], noise: f64) -> f64 {
    let count = samples.len() as f64;
    let origin = samples[0];
    let (mut t, mut tt) = (0.0, 0.0);
    let (mut p, mut tp, mut pp) = ([0.0; 2], [0.0; 2], 0.0);
    for sample in samples {
        let tau = sample.time - origin.time;
        let position = minus(sample.position, origin.position);
        t += tau;
        tt += tau * tau;
        p = plus(p, position);
        tp = plus(tp, times(position, tau));
        pp += dot(position, position);
    }
    let spread = tt - t * t / count;
    let about = pp - dot(p, p) / count;
    let slope = minus(tp, times(p, t / count));
    let explained = if 0.0 < spread { dot(slope, slope) / spread } else { 0.0 };
    0.5 * (about - explained).max(0.0) / (noise * noise)
}

/// Position and velocity of both strikers at `time`.
fn strikers_at(samples: &[Sample], time: f64) -> [Option<(Vector, Vector)>; 2] {
    let after = samples.partition_point(|sample| sample.time <= time).clamp(1, samples.len() - 1);
    let (a, b) = (&samples[after - 1], &samples[after]);
    [0, 1].map(|player: usize| {
        let (from, to) = (a.strikers[player]?, b.strikers[player]?);
        let velocity = times(minus(to, from), 1.0 / (b.time - a.time));
        Some((plus(from, times(velocity, time - a.time)), velocity))
    })
}

/// Penalty of a positive `excess` with the standard deviation `sigma` (nats).
fn beyond(excess: f64, sigma: f64) -> f64 {
    0.5 * (excess.max(0.0) / sigma).powi(2)
}

/// Cost of each possible cause of `meeting` (nats).
fn costs(
    meeting: &Meeting,
    strikers: [Option<(Vector, Vector)>; 2],
    noise: f64,
    rules: &Rules,
) -> Vec<(Cause, f64)> {
    let tolerance = rules.place_tolerance * rules.place_tolerance;
    let place_sigma = (tolerance + meeting.place_variance).sqrt();
    let mut found = vec![(Cause::Unknown, COST_NOTHING)];
    let mut walls = Vec::new();
    for axis in 0..2 {
        let sign = meeting.position[axis].signum();
        let off = sign * meeting.position[axis] - rules.reach()[axis];
        let distance_cost = 0.5 * (off / place_sigma).powi(2);
        if distance_cost < COST_NOTHING {
            walls.push((axis, sign, distance_cost));
            let cost = distance_cost + wall_motion(meeting, axis, sign);
            found.push((Cause::Wall(axis, sign), cost));
        }
    }
    for player in Player::BOTH {
        let Some((striker, velocity)) = strikers[player as usize] else { continue };
        let off = minus(meeting.position, striker);
        let apart = length(off);
        let sigma = (place_sigma * place_sigma + 0.5 * noise * noise).sqrt();
        let distance_cost = 0.5 * ((apart - rules.touching()) / sigma).powi(2);
        if COST_NOTHING <= distance_cost || apart <= 0.0 {
            continue;
        }
        let normal = times(off, 1.0 / apart);
        let motion = striker_motion(meeting, normal, velocity);
        found.push((Cause::Striker(player), distance_cost + motion));
        for (axis, sign, wall_cost) in &walls {
            let cost = distance_cost + wall_cost + COST_BOTH + pinch(meeting, normal, *axis, *sign);
            found.push((Cause::StrikerAtWall(player, *axis, *sign), cost));
        }
    }
    let rim = Player::BOTH
        .into_iter()
        .any(|player| distance(meeting.position, rules.cup(player)) < CUP_RADIUS + RIM);
    if rim {
        found.push((Cause::Rim, COST_RIM));
    }
    found
}

fn velocity_sigma(variance: f64) -> f64 {
    (variance + VELOCITY_TOLERANCE * VELOCITY_TOLERANCE).sqrt()
}

/// Cost of a motion against a wall: it reverses the normal velocity and reduces the tangential one
/// by friction.
fn wall_motion(meeting: &Meeting, axis: usize, sign: f64) -> f64 {
    let (came, left) = (sign * meeting.before[axis], -sign * meeting.after[axis]);
    let sigma = velocity_sigma(meeting.before_variance + meeting.after_variance);
    let (before, after) = (meeting.before[1 - axis], meeting.after[1 - axis]);
    let along = (after - before).abs();
    let reversed = -after * before.signum();
    beyond(reversed - REVERSAL * (came + left).max(0.0), sigma)
        + beyond(-came, sigma)
        + beyond(RESTITUTION.start * came - left, sigma)
        + beyond(left - RESTITUTION.end * came.max(0.0), sigma)
        + beyond(along - FRICTION * (came + left).max(0.0), sigma)
}

/// Two bounces in a corner, possibly some frames apart. Each wall acts on one axis, so each axis
/// has its own impact.
#[derive(Default)]
struct Corner {
    best: [Option<(f64, f64, Meeting)>; 2],
}

impl Corner {
    fn offer(&mut self, meeting: &Meeting, rules: &Rules) {
        for axis in 0..2 {
            let sign = meeting.position[axis].signum();
            let off = sign * meeting.position[axis] - rules.reach()[axis];
            let position = meeting.place_variance + rules.place_tolerance * rules.place_tolerance;
            let (came, left) = (sign * meeting.before[axis], -sign * meeting.after[axis]);
            let sigma = velocity_sigma(meeting.before_variance + meeting.after_variance);
            let motion = beyond(RESTITUTION.start * came - left, sigma)
                + beyond(left - RESTITUTION.end * came.max(0.0), sigma)
                + beyond(rules.least_impulse - came - left, 0.1 * rules.least_impulse);
            let cost = meeting.misfit[axis] + 0.5 * off * off / position + motion;
            if self.best[axis].is_none_or(|(least, ..)| cost < least) {
                self.best[axis] = Some((cost, sign, *meeting));
            }
        }
    }

    fn cost(&self) -> f64 {
        self.best.iter().map(|best| best.map_or(f64::INFINITY, |(cost, ..)| cost)).sum::<f64>()
            + COST_CORNER
    }

    /// Both bounces; `other` is the cost of the alternative cause.
    fn impacts(&self, other: f64) -> Vec<Impact> {
        let confidence = 1.0 / (1.0 + (self.cost() - other).exp());
        let mut found: Vec<Impact> = (0..2)
            .filter_map(|axis| {
                let (_, sign, meeting) = self.best[axis]?;
                Some(Impact {
                    time: meeting.time,
                    position: meeting.position,
                    before: meeting.before,
                    after: meeting.after,
                    cause: Cause::Wall(axis, sign),
                    confidence,
                })
            })
            .collect();
        found.sort_by(|a, b| a.time.total_cmp(&b.time));
        found
    }
}

/// Cost of a striker with `velocity` that pushes along `normal`, at most as hard as in an elastic
/// impact.
fn striker_motion(meeting: &Meeting, normal: Vector, velocity: Vector) -> f64 {
    let sigma = velocity_sigma(meeting.before_variance + meeting.after_variance);
    let change = minus(meeting.after, meeting.before);
    let push = dot(change, normal);
    let along = length(minus(change, times(normal, push)));
    let closing = -dot(minus(meeting.before, velocity), normal);
    let parting = dot(minus(meeting.after, velocity), normal);
    // The striker's own velocity, and its change in the impact, are less certain.
    let loose = 3.0 * sigma;
    beyond(-push, sigma)
        + beyond(along - FRICTION * push.max(0.0), sigma)
        + beyond(-closing, loose)
        + beyond(parting - RESTITUTION.end * closing.max(0.0), loose)
}

/// Cost of a change between striker and wall: it is in the cone of both normals.
fn pinch(meeting: &Meeting, normal: Vector, axis: usize, sign: f64) -> f64 {
    let sigma = velocity_sigma(meeting.before_variance + meeting.after_variance);
    let change = minus(meeting.after, meeting.before);
    let mut wall = [0.0; 2];
    wall[axis] = -sign;
    // change = a * normal + b * wall
    let determinant = normal[0] * wall[1] - normal[1] * wall[0];
    if determinant.abs() < 0.1 {
        return beyond(dot(change, normal).abs(), sigma).min(COST_BOTH);
    }
    let a = (change[0] * wall[1] - change[1] * wall[0]) / determinant;
    let b = (normal[0] * change[1] - normal[1] * change[0]) / determinant;
    beyond(-a, sigma) + beyond(-b, sigma) + beyond(0.1 - a, 0.1) + beyond(0.1 - b, 0.1)
}

/// Likelihood by cause, and the mean fit of each.
#[derive(Default)]
struct Tally {
    entries: Vec<Entry>,
}

struct Entry {
    cause: Cause,
    least: f64,
    /// Sums of likelihoods and of likelihood-weighted times, relative to the least cost.
    weight: f64,
    time: f64,
    best: Meeting,
}

impl Tally {
    fn add(&mut self, cause: Cause, cost: f64, meeting: &Meeting) {
        let Some(entry) = self.entries.iter_mut().find(|entry| entry.cause == cause) else {
            let time = meeting.time;
            self.entries.push(Entry { cause, least: cost, weight: 1.0, time, best: *meeting });
            return;
        };
        if cost < entry.least {
            let scale = (cost - entry.least).exp();
            entry.weight = entry.weight * scale + 1.0;
            entry.time = entry.time * scale + meeting.time;
            entry.least = cost;
            entry.best = *meeting;
        } else {
            let share = (entry.least - cost).exp();
            entry.weight += share;
            entry.time += share * meeting.time;
        }
    }

    /// The most likely cause and its cost; `straight` is the cost of no impact.
    fn verdict(self, straight: f64) -> Option<(Impact, f64)> {
        let best = self.entries.iter().min_by(|a, b| a.least.total_cmp(&b.least))?;
        if straight < best.least {
            return None;
        }
        let causes = self.entries.iter().map(|entry| entry.least);
        let total: f64 = causes.chain([straight]).map(|cost| (best.least - cost).exp()).sum();
        let impact = Impact {
            time: best.time / best.weight,
            position: best.best.position,
            before: best.best.before,
            after: best.best.after,
            cause: best.cause,
            confidence: 1.0 / total,
        };
        Some((impact, best.least))
    }
}
