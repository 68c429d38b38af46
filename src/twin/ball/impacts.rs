//! Impacts measured from the camera's samples, to examine restitution without a twin.

use super::{
    BALL_RADIUS, HALF_BOARD,
    rolls::{Line, Roll, Tracks},
};
use crate::{effects::Wall, stats::median};
use std::ops::Range;

/// Most and fewest samples on each side from which a velocity is measured.
const BESIDE: Range<usize> = 3..7;

/// Distance from the wall within which a turn is an impact (m), in addition to the distance of two
/// frames.
const NEAR: f64 = 0.006;

/// Least normal speed before an impact (m/s); slower ones are lost in the noise.
const LEAST_SPEED: f64 = 0.05;

/// Fewest samples between impacts from which the usual deceleration is measured.
const STRETCH: usize = 20;

/// One impact of the ball on a wall, measured from straight lines through the samples before and
/// after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallImpact {
    /// Index of the roll.
    pub roll: usize,
    /// Time (s since the session began).
    pub time: f64,
    /// Wall of the impact.
    pub wall: Wall,
    /// Position along the wall, from its middle (m).
    pub along: f64,
    /// Distance beyond the nominal wall at which the ball turned (m); negative on the board's side
    /// of it.
    pub beyond: f64,
    /// Speed into the wall (m/s).
    pub speed_in: f64,
    /// Speed out of it (m/s).
    pub speed_out: f64,
    /// Velocity along the wall before, towards positive x or y (m/s).
    pub along_in: f64,
    /// Velocity along the wall after (m/s).
    pub along_out: f64,
    /// Standard deviation of each of these four speeds by the camera's noise (m/s).
    pub spread: f64,
}

impl WallImpact {
    /// Coefficient of restitution: normal speed after the impact, as a fraction of that before it.
    #[must_use]
    pub fn restitution(&self) -> f64 {
        self.speed_out / self.speed_in
    }
}

/// All impacts of all rolls, in order of time.
pub(super) fn measure(tracks: &Tracks, rolls: &[Roll]) -> Vec<WallImpact> {
    let turns: Vec<Vec<(usize, Wall)>> = rolls.iter().map(|roll| turns_of(tracks, roll)).collect();
    let braking = usual_deceleration(tracks, rolls, &turns);
    let mut impacts = Vec::new();
    for (index, (roll, turns)) in rolls.iter().zip(&turns).enumerate() {
        for (place, turn) in turns.iter().enumerate() {
            let from = if place == 0 { roll.samples.start } else { turns[place - 1].0 + 1 };
            let to = turns.get(place + 1).map_or(roll.samples.end, |next| next.0);
            let impact = at_turn(tracks, *turn, from..to, braking);
            impacts.extend(impact.map(|impact| WallImpact { roll: index, ..impact }));
        }
    }
    impacts
}

/// The samples of `roll` at which the ball turns at a wall.
fn turns_of(tracks: &Tracks, roll: &Roll) -> Vec<(usize, Wall)> {
    let inner = roll.samples.start + 2..roll.samples.end.saturating_sub(2);
    inner
        .flat_map(|sample| Wall::ALL.map(|wall| (sample, wall)))
        .filter(|(sample, wall)| turns_at(tracks, *sample, *wall))
        .collect()
}

/// Median deceleration between impacts (m/s^2): velocities are measured before and after an impact,
/// not at it.
fn usual_deceleration(tracks: &Tracks, rolls: &[Roll], turns: &[Vec<(usize, Wall)>]) -> f64 {
    let mut found = Vec::new();
    for (roll, turns) in rolls.iter().zip(turns) {
        let mut start = roll.samples.start;
        for end in turns.iter().map(|turn| turn.0).chain([roll.samples.end]) {
            if start + STRETCH <= end {
                let middle = (start + end) / 2;
                let [first, second] =
                    [start..middle, middle..end].map(|samples| tracks.line(samples, 0.0));
                let span = second.middle - first.middle;
                found.push((first.speed() - second.speed()) / span);
            }
            start = end + 1;
        }
    }
    median(&found).unwrap_or(0.0).max(0.0)
}

/// Return whether the ball is furthest out towards `wall` at `sample`, and near it.
fn turns_at(tracks: &Tracks, sample: usize, wall: Wall) -> bool {
    let (axis, sign) = wall.outward();
    let out = |i: usize| sign * tracks.ball[i][axis];
    let here = out(sample);
    let way = (here - out(sample - 2)).abs().max((here - out(sample + 2)).abs());
    let furthest = out(sample - 2) < here
        && out(sample - 1) <= here
        && out(sample + 1) < here
        && out(sample + 2) < here;
    furthest && HALF_BOARD[axis] - BALL_RADIUS - here < NEAR + way
}

/// Measures the impact next to the sample of `turn`, from samples in `free` alone.
fn at_turn(
    tracks: &Tracks,
    (sample, wall): (usize, Wall),
    free: Range<usize>,
    braking: f64,
) -> Option<WallImpact> {
    let (axis, sign) = wall.outward();
    let most = BESIDE.end - 1;
    let before = free.start.max(sample.saturating_sub(most))..sample;
    let after = sample + 1..free.end.min(sample + 1 + most);
    if before.len() < BESIDE.start || after.len() < BESIDE.start {
        return None;
    }
    let spread = tracks.velocity_spread(before.len().min(after.len()));
    let at = tracks.times[sample];
    let (incoming, outgoing) = (tracks.line(before, at), tracks.line(after, at));
    let closing = sign * (incoming.velocity[axis] - outgoing.velocity[axis]);
    // The impact is where both lines meet.
    let late = (outgoing.place[axis] - incoming.place[axis]) * sign / closing;
    let [before, after] = [incoming, outgoing].map(|line| velocity_at(&line, at + late, braking));
    let (speed_in, speed_out) = (sign * before[axis], -sign * after[axis]);
    if speed_in < LEAST_SPEED || speed_out <= 0.0 {
        return None;
    }
    let other = 1 - axis;
    Some(WallImpact {
        roll: 0,
        time: at + late,
        wall,
        along: incoming.place[other] + incoming.velocity[other] * late,
        beyond: sign * (incoming.place[axis] + incoming.velocity[axis] * late)
            - (HALF_BOARD[axis] - BALL_RADIUS),
        speed_in,
        speed_out,
        along_in: before[other],
        along_out: after[other],
        spread,
    })
}

/// Velocity at `time` of a ball that slows down by `braking` and had that of `line` in its middle.
fn velocity_at(line: &Line, time: f64, braking: f64) -> [f64; 2] {
    let speed = line.speed();
    if speed == 0.0 {
        return line.velocity;
    }
    let share = 1.0 - braking * (time - line.middle) / speed;
    line.velocity.map(|velocity| velocity * share.max(0.0))
}
