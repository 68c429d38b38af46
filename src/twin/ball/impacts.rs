//! Impacts as the camera's samples show them, for looking at restitution without any twin.

use super::{
    HALF_BOARD, RADIUS, WALLS, outward,
    rolls::{Roll, Tracks},
};
use crate::effects::Wall;
use std::ops::Range;

/// Most and fewest samples on each side from which a velocity is measured.
const BESIDE: Range<usize> = 3..7;

/// Distance from the wall within which a turn is an impact (m), besides the way of two frames.
const NEAR: f64 = 0.006;

/// Least normal speed before an impact (m/s); slower ones are lost in the noise.
const LEAST_SPEED: f64 = 0.03;

/// One impact of the ball on a wall, measured from straight lines through the samples beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallImpact {
    /// Index of the roll.
    pub roll: usize,
    /// Time (s since the session began).
    pub time: f64,
    /// Which wall.
    pub wall: Wall,
    /// Place along the wall, from its middle (m).
    pub along: f64,
    /// How far beyond the nominal wall the ball turned (m); negative on the board's side of it.
    pub beyond: f64,
    /// Speed into the wall (m/s).
    pub speed_in: f64,
    /// Speed out of it (m/s).
    pub speed_out: f64,
    /// Velocity along the wall before, towards positive x or y (m/s).
    pub along_in: f64,
    /// Velocity along the wall after (m/s).
    pub along_out: f64,
}

impl WallImpact {
    /// Share of the normal speed that the wall gave back.
    #[must_use]
    pub fn restitution(&self) -> f64 {
        self.speed_out / self.speed_in
    }
}

/// All impacts of all rolls, in order of time.
pub(super) fn measure(tracks: &Tracks, rolls: &[Roll]) -> Vec<WallImpact> {
    let mut impacts = Vec::new();
    for (index, roll) in rolls.iter().enumerate() {
        let mut turns: Vec<(usize, Wall)> = Vec::new();
        for sample in roll.samples.start + 2..roll.samples.end.saturating_sub(2) {
            turns.extend(
                WALLS.iter().filter(|w| turns_at(tracks, sample, **w)).map(|w| (sample, *w)),
            );
        }
        for (place, (sample, wall)) in turns.iter().enumerate() {
            let from = if place == 0 { roll.samples.start } else { turns[place - 1].0 + 1 };
            let to = turns.get(place + 1).map_or(roll.samples.end, |next| next.0);
            impacts.extend(at_turn(tracks, index, *wall, *sample, from..to));
        }
    }
    impacts
}

/// Whether the ball is furthest out towards `wall` at `sample`, and near it.
fn turns_at(tracks: &Tracks, sample: usize, wall: Wall) -> bool {
    let (axis, sign) = outward(wall);
    let out = |i: usize| sign * tracks.ball[i][axis];
    let here = out(sample);
    let way = (here - out(sample - 2)).abs().max((here - out(sample + 2)).abs());
    let furthest = out(sample - 2) < here
        && out(sample - 1) <= here
        && out(sample + 1) < here
        && out(sample + 2) < here;
    furthest && HALF_BOARD[axis] - RADIUS - here < NEAR + way
}

/// Measures the impact next to `sample`, from samples in `free` alone.
fn at_turn(
    tracks: &Tracks,
    roll: usize,
    wall: Wall,
    sample: usize,
    free: Range<usize>,
) -> Option<WallImpact> {
    let (axis, sign) = outward(wall);
    let most = BESIDE.end - 1;
    let before = free.start.max(sample.saturating_sub(most))..sample;
    let after = sample + 1..free.end.min(sample + 1 + most);
    if before.len() < BESIDE.start || after.len() < BESIDE.start {
        return None;
    }
    let at = tracks.times[sample];
    let (incoming, outgoing) = (tracks.line(before, at), tracks.line(after, at));
    let (speed_in, speed_out) = (sign * incoming.velocity[axis], -sign * outgoing.velocity[axis]);
    if speed_in < LEAST_SPEED || speed_out <= 0.0 {
        return None;
    }
    // The impact is where both lines meet.
    let late = (outgoing.place[axis] - incoming.place[axis]) * sign / (speed_in + speed_out);
    let turned = sign * incoming.place[axis] + speed_in * late;
    let other = 1 - axis;
    Some(WallImpact {
        roll,
        time: at + late,
        wall,
        along: incoming.place[other] + incoming.velocity[other] * late,
        beyond: turned - (HALF_BOARD[axis] - RADIUS),
        speed_in,
        speed_out,
        along_in: incoming.velocity[other],
        along_out: outgoing.velocity[other],
    })
}
