//! Rejection of false detections.
//!
//! The detector can miss the ball, take a striker for the ball, repeat an old frame, or deliver one
//! twice. Each is detected by a physical contradiction: a ball inside a striker, a striker faster
//! than any drive, a moving ball at exactly the same position. Such detections are removed here, so
//! that later stages need not explain them.

use super::{
    frames::Frame,
    rules::Rules,
    vector::{Vector, distance, length, minus, times},
};

/// Maximum speed of a striker (m/s); the drives' limit is 0.4 m/s per axis, hands are faster.
const FASTEST_STRIKER: f64 = 3.0;
/// Gap after which a striker may be anywhere (s).
const STRIKER_FORGOTTEN: f64 = 0.25;
/// Overlap with a striker beyond which a detection is not the ball (m).
const DEEPEST_OVERLAP: f64 = 0.006;
/// Distance outside the field beyond which a detection is not the ball (m).
const OUTSIDE: f64 = 0.02;
/// Expected displacement for which an exactly equal position is a repeated frame (m).
const FROZEN: f64 = 0.003;
/// Number of frames for the speed before a standstill.
const BEFORE: usize = 4;
/// Longest span of these frames (s).
const BEFORE_SPAN: f64 = 0.1;
/// Weights of a quadratic through seven frames at its middle (Savitzky and Golay, 1964).
const SMOOTHING: [f64; 7] = [-2.0, 3.0, 6.0, 7.0, 6.0, 3.0, -2.0];

/// One frame without false detections.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    /// Time since the recording began (s).
    pub(super) time: f64,
    /// Ball position (m), if correctly detected.
    pub(super) ball: Option<Vector>,
    /// Left and right striker, smoothed, if detected (m).
    pub(super) strikers: [Option<Vector>; 2],
    /// Biscuits (m).
    pub(super) biscuits: [Option<Vector>; 3],
    /// True if the detector reported a ball, correct or not.
    pub(super) said: bool,
}

impl Sight {
    /// The frame without what lies outside the board.
    pub(super) fn of(frame: &Frame, rules: &Rules) -> Self {
        let reach = rules.reach();
        let on_board =
            |position: &Vector| (0..2).all(|axis| position[axis].abs() <= reach[axis] + OUTSIDE);
        Self {
            time: frame.time,
            ball: frame.ball.filter(on_board),
            strikers: frame.strikers.map(|striker| striker.filter(on_board)),
            biscuits: frame.biscuits.map(|biscuit| biscuit.filter(on_board)),
            said: frame.ball.is_some(),
        }
    }
}

/// Frames in order of time, each once, without false detections.
pub(super) fn believe(frames: &[Frame], rules: &Rules) -> Vec<Sight> {
    let mut sights = in_order(frames, rules);
    for player in 0..2 {
        drop_wild_strikers(&mut sights, player);
    }
    drop_swapped_balls(&mut sights, rules);
    drop_frozen_balls(&mut sights);
    let smooth: Vec<[Option<Vector>; 2]> =
        (0..sights.len()).map(|at| [0, 1].map(|player| smoothed(&sights, at, player))).collect();
    for (sight, strikers) in sights.iter_mut().zip(smooth) {
        sight.strikers = strikers;
    }
    sights
}

fn in_order(frames: &[Frame], rules: &Rules) -> Vec<Sight> {
    let mut sorted: Vec<&Frame> = frames.iter().filter(|frame| frame.time.is_finite()).collect();
    sorted.sort_by(|a, b| a.time.total_cmp(&b.time));
    let period = usual_period(&sorted);
    let mut sights: Vec<Sight> = Vec::with_capacity(sorted.len());
    let mut last: Option<&Frame> = None;
    for frame in sorted {
        let twice = last.is_some_and(|last| {
            let same = last.ball == frame.ball && last.strikers == frame.strikers;
            let apart = frame.time - last.time;
            apart < 1e-6 || (same && apart < 0.5 * period)
        });
        if twice {
            continue;
        }
        sights.push(Sight::of(frame, rules));
        last = Some(frame);
    }
    sights
}

fn usual_period(frames: &[&Frame]) -> f64 {
    let steps: Vec<f64> = frames.windows(2).map(|pair| pair[1].time - pair[0].time).collect();
    crate::stats::median(&steps).unwrap_or(0.0)
}

/// Remove detections that a striker could only have reached faster than it can move.
fn drop_wild_strikers(sights: &mut [Sight], player: usize) {
    let mut last: Option<(f64, Vector)> = None;
    for sight in sights {
        let Some(position) = sight.strikers[player] else { continue };
        if let Some((time, before)) = last {
            let apart = sight.time - time;
            let most = FASTEST_STRIKER * apart + DEEPEST_OVERLAP;
            if apart < STRIKER_FORGOTTEN && most < distance(position, before) {
                sight.strikers[player] = None;
                continue;
            }
        }
        last = Some((sight.time, position));
    }
}

/// Remove a ball at the position of a striker: the detector confused the two.
fn drop_swapped_balls(sights: &mut [Sight], rules: &Rules) {
    let mut known = LastStrikers::default();
    for sight in sights {
        known.check(sight, rules);
    }
}

/// Last detection of each striker.
#[derive(Debug, Default)]
pub(super) struct LastStrikers([Option<(f64, Vector)>; 2]);

impl LastStrikers {
    /// Take the strikers of `sight` and remove a ball inside one of them.
    pub(super) fn check(&mut self, sight: &mut Sight, rules: &Rules) {
        for (known, striker) in self.0.iter_mut().zip(sight.strikers) {
            *known = striker.map(|position| (sight.time, position)).or(*known);
        }
        let inside = |ball: Vector| {
            self.0.iter().flatten().any(|(time, position)| {
                sight.time - time < STRIKER_FORGOTTEN
                    && distance(ball, *position) < rules.touching() - DEEPEST_OVERLAP
            })
        };
        sight.ball = sight.ball.filter(|ball| !inside(*ball));
    }
}

/// Remove exact repetitions of a moving ball's position that end with a jump.
fn drop_frozen_balls(sights: &mut [Sight]) {
    let seen: Vec<usize> = (0..sights.len()).filter(|at| sights[*at].ball.is_some()).collect();
    let mut first = 0;
    while first < seen.len() {
        let position = sights[seen[first]].ball;
        let same = seen[first..].iter().take_while(|at| sights[**at].ball == position).count();
        let end = first + same;
        if 1 < same && is_frozen(sights, &seen, first, end) {
            for at in &seen[first + 1..end] {
                sights[*at].ball = None;
            }
        }
        first = end;
    }
}

/// Return whether the ball at `seen[first..end]`, all at one position, was moving before and is
/// elsewhere after.
fn is_frozen(sights: &[Sight], seen: &[usize], first: usize, end: usize) -> bool {
    let ball = |at: usize| sights[seen[at]].ball.unwrap_or_default();
    let time = |at: usize| sights[seen[at]].time;
    let start = first.saturating_sub(BEFORE);
    let span = time(first) - time(start);
    if span <= 0.0 || BEFORE_SPAN < span {
        return false;
    }
    let velocity = times(minus(ball(first), ball(start)), 1.0 / span);
    let expected = length(velocity) * (time(end - 1) - time(first));
    let jump = if end < seen.len() { distance(ball(end), ball(first)) } else { 0.0 };
    FROZEN < expected && FROZEN.max(0.5 * expected) < jump
}

/// Striker position by a quadratic through seven frames; unsmoothed if some of them are missing.
fn smoothed(sights: &[Sight], at: usize, player: usize) -> Option<Vector> {
    let seen = sights[at].strikers[player]?;
    let half = SMOOTHING.len() / 2;
    let Some(around) = at.checked_sub(half).and_then(|from| sights.get(from..=at + half)) else {
        return Some(seen);
    };
    let step = (around[2 * half].time - around[0].time) / (2 * half) as f64;
    let mut sum = [0.0; 2];
    for (k, (sight, weight)) in around.iter().zip(SMOOTHING).enumerate() {
        let due = around[0].time + k as f64 * step;
        let even = (sight.time - due).abs() < 0.25 * step;
        let Some(position) = sight.strikers[player].filter(|_| even) else { return Some(seen) };
        sum = [sum[0] + weight * position[0], sum[1] + weight * position[1]];
    }
    Some(times(sum, 1.0 / SMOOTHING.iter().sum::<f64>()))
}
