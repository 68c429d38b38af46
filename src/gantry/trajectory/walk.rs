//! Random walk: velocity levels held for random durations, steered to stay in the workspace.
//!
//! At position `p` an axis may move towards an edge only with a speed from which it can still stop
//! before it, `v t + v^2 / (2 a) <= edge - p`. With `a` at most the slew limit and `t` at least one
//! control period, braking along that curve never needs more than the slew limit. The walk
//! therefore stays inside for every draw.

use super::course::{Course, Grid};
use crate::{gantry::Limits, seed::Stream};

/// Present level of one axis.
struct Level {
    velocity: f64,
    left: usize,
}

pub(super) fn walk(top: f64, hold_s: [f64; 2], grid: &Grid<'_>) -> Course {
    let (dt, limits) = (grid.dt(), grid.limits);
    let careful = Limits {
        braking_m_per_s2: limits.braking_m_per_s2.min(limits.slew_m_per_s2),
        reaction_s: limits.reaction_s.max(dt),
        ..*limits
    };
    let edges = [
        [grid.workspace.x_min_m, grid.workspace.x_max_m],
        [grid.workspace.y_min_m, grid.workspace.y_max_m],
    ];
    let mut stream = Stream::new(grid.seed, "random walk");
    let mut levels = [0, 1].map(|_| Level { velocity: 0.0, left: 0 });
    let (mut place, mut before) = (grid.workspace.centre(), [0.0; 2]);
    let start = place;
    let mut velocities = Vec::with_capacity(grid.samples);
    for index in 0..grid.samples {
        let mut wanted = [0.0; 2];
        for axis in 0..2 {
            let [low, high] = edges[axis];
            let span = [
                -careful.speed_within(place[axis] - low),
                careful.speed_within(high - place[axis]),
            ];
            let level = &mut levels[axis];
            let blocked = level.velocity < span[0] || span[1] < level.velocity;
            if blocked || level.left == 0 {
                let inward = if place[axis] < f64::midpoint(low, high) { 1.0 } else { -1.0 };
                *level = draw(&mut stream, top, hold_s, grid.rate);
                if blocked || level.velocity < span[0] || span[1] < level.velocity {
                    level.velocity = inward * level.velocity.abs();
                }
            }
            level.left -= 1;
            wanted[axis] = level.velocity.clamp(span[0], span[1]);
        }
        let ending = (grid.samples - 1 - index).min(index) as f64 * limits.slew_m_per_s2 * dt;
        let next = limits.next_velocity(before, wanted, dt);
        before = within_total(before, next, limits).map(|part| part.clamp(-ending, ending));
        place = [0, 1].map(|axis| place[axis] + before[axis] * dt);
        velocities.push(before);
    }
    Course { start, velocities }
}

fn draw(stream: &mut Stream, top: f64, [shortest, longest]: [f64; 2], rate: f64) -> Level {
    let mut unit = || f64::from(stream.uniform_f32(0.0, 1.0));
    let velocity = top * (2.0 * unit() - 1.0);
    let hold = shortest + (longest - shortest) * unit();
    Level { velocity, left: ((hold * rate).round() as usize).max(1) }
}

/// Limit `next` (m/s) to the total speed. Only an axis that accelerates is limited. The other may
/// have to brake, and needs no more room than `before` (m/s) did.
fn within_total(before: [f64; 2], next: [f64; 2], limits: &Limits) -> [f64; 2] {
    let total = limits.total_speed_m_per_s;
    let mut kept = next;
    for axis in 0..2 {
        if before[axis].abs() < next[axis].abs() && total < kept[0].hypot(kept[1]) {
            let other = kept[1 - axis];
            let top = (total * total - other * other).max(0.0).sqrt();
            kept[axis] = next[axis].clamp(-top, top);
        }
    }
    kept
}
