//! Scripted players, as opponents in training and evaluation.
//!
//! A [`Scripted`] player gets the observation of a policy, the standard values of
//! [`ObservationKind`](crate::game::ObservationKind) in its own frame, and returns a velocity. It
//! has no memory, so it can take over any environment at any time, in simulation and on a table.
//!
//! | player | behaviour |
//! |---|---|
//! | `stationary` | does not move |
//! | `random` | moves in a random direction at a random speed, drawn every 0.2 s |
//! | `goalkeeper` | stays close to its own cup, on the line from the cup to the ball |
//! | `chaser` | moves behind a ball in its half and hits it towards the other cup; otherwise waits between ball and own cup |
//! | `shooter` | like the chaser, but shoots a resting ball over a side wall and the end wall if the other striker covers the cup |
//!
//! ```
//! use klasktron::opponent::{Moment, Scripted};
//! let moment = Moment { seed: 0, board: 0, step: 0 };
//! let mut seen = [0.0; 12];
//! (seen[1], seen[8], seen[9]) = (-0.13, 0.1, 0.05); // the ball is in front and to the right
//! let [vx, vy] = Scripted::Goalkeeper.velocity(&seen, moment, 0.4);
//! assert!(0.0 < vx && vy.abs() <= 0.4);
//! assert_eq!(Scripted::Stationary.velocity(&seen, moment, 0.4), [0.0, 0.0]);
//! ```
//!
//! These definitions are our own; the paper and upstream name such players without a definition.

use crate::{
    board::{BALL_RADIUS, BoardSize, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    seed::Stream,
};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Number of control periods for which the random player keeps a velocity: 0.2 s, half a crossing
/// of its half.
const RANDOM_STEPS: u64 = 10;
/// Proportional gain from distance to velocity (1/s): two control periods of a slew-limited
/// carriage, so that it arrives without overshoot.
const GAIN: f32 = 10.0;
/// Distance of the goalkeeper from the middle of its own cup (m): rim, striker and ball next to
/// each other.
const KEEPER_DISTANCE: f32 = (CUP_RADIUS + STRIKER_RADIUS + 2.0 * BALL_RADIUS) as f32;
/// Minimum distance of a commanded position from the middle of the own cup (m); nearer, the striker
/// would fall in.
const CUP_CLEARANCE: f32 = (CUP_RADIUS + 2.0 * STRIKER_RADIUS) as f32;
/// Distance behind the ball from which the chaser hits it (m); contact is at 0.0145 m.
const RUN_UP: f32 = 0.03;
/// Maximum lateral error at which the chaser hits the ball (m). The ball then leaves at most 0.1
/// rad off, which is half a cup at the other end.
const ON_LINE: f32 = 0.0015;
/// Largest y that a striker reaches because of the wall limiter, seen from the ball (m).
const OUT_OF_REACH: f32 = -0.025;
/// Largest y of a striker that moves towards the middle, set by the wall limiter (m).
const FAR_EDGE: f32 = -0.0335;
/// Distance over which the limiter slows a striker before that position (m).
const BRAKING: f32 = 0.09;
/// Longest prediction of the ball by the chaser (s); a bounce is likely later.
const LONGEST_LEAD: f32 = 0.2;
/// Image of the other cup in the right wall and the end wall (m): a ball that is hit towards it, and that the walls reflect
/// like a mirror, enters the cup from behind. The middle of the ball turns a radius before each wall.
const RIGHT_IMAGE: [f32; 2] = [
    (BoardSize::STANDARD.short_side - 2.0 * BALL_RADIUS) as f32,
    (BoardSize::STANDARD.long_side - 2.0 * BALL_RADIUS - CUP_DISTANCE) as f32,
];
/// Distance from the line of a direct shot within which a striker covers it (m): that of a ball that it touches, and 10 mm
/// that it moves meanwhile.
const COVERED: f32 = (STRIKER_RADIUS + BALL_RADIUS) as f32 + 0.01;
/// Speed of the ball below which it is shot over the walls (m/s): the line of a shot moves with the ball, and has to stay
/// until the striker is on it.
const RESTING: f32 = 0.05;
/// Waiting position of the chaser: distance from its own cup towards the ball (m).
const WAIT_DISTANCE: f32 = 0.08;

/// A player that follows a fixed rule.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scripted {
    /// Does not move.
    Stationary,
    /// Moves at random.
    Random,
    /// Guards its cup.
    Goalkeeper,
    /// Chases the ball.
    Chaser,
    /// Shoots past the other striker.
    Shooter,
}

/// Time and environment of a decision; only the random player depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moment {
    /// The user's seed.
    pub seed: u64,
    /// Number of the environment.
    pub board: u64,
    /// Number of the control period.
    pub step: u64,
}

impl Scripted {
    /// All players, weakest first.
    pub const ALL: [Self; 5] =
        [Self::Stationary, Self::Random, Self::Goalkeeper, Self::Chaser, Self::Shooter];

    /// `stationary`, `random`, `goalkeeper`, `chaser` or `shooter`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Stationary => "stationary",
            Self::Random => "random",
            Self::Goalkeeper => "goalkeeper",
            Self::Chaser => "chaser",
            Self::Shooter => "shooter",
        }
    }

    /// Velocity (m/s, own frame), at most `speed` along each axis, for the observation `seen`: at
    /// least the 12 standard values (m, m/s, own frame).
    ///
    /// # Panics
    /// When `seen` has fewer values.
    #[must_use]
    pub fn velocity(self, seen: &[f32], moment: Moment, speed: f32) -> [f32; 2] {
        let (own, ball) = ([seen[0], seen[1]], [seen[8], seen[9]]);
        match self {
            Self::Stationary => [0.0; 2],
            Self::Random => random(moment, speed),
            Self::Goalkeeper => {
                let place = along(OWN_CUP, ball, KEEPER_DISTANCE);
                towards(place, own, speed)
            }
            Self::Chaser => chase(seen, OTHER_CUP, speed),
            Self::Shooter => shoot(seen, speed),
        }
    }
}

impl fmt::Display for Scripted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

const OWN_CUP: [f32; 2] = [0.0, -CUP_DISTANCE as f32];
const OTHER_CUP: [f32; 2] = [0.0, CUP_DISTANCE as f32];

fn random(moment: Moment, speed: f32) -> [f32; 2] {
    let numbers = [moment.board, moment.step / RANDOM_STEPS];
    let mut stream = Stream::numbered(moment.seed, "opponent.random", &numbers);
    [stream.uniform_f32(-speed, speed), stream.uniform_f32(-speed, speed)]
}

/// Velocity of [`Scripted::Shooter`], as [`Scripted::velocity`] returns it.
pub(crate) fn shoot(seen: &[f32], speed: f32) -> [f32; 2] {
    chase(seen, shot_target(seen), speed)
}

/// Target of a shot: the other cup, or its image if the ball rests and the other striker covers the cup. The image is in
/// the end wall and in that side wall which a hit from here sends the ball to.
fn shot_target(seen: &[f32]) -> [f32; 2] {
    let [own, other, ball, ball_velocity] = [0, 4, 8, 10].map(|k| [seen[k], seen[k + 1]]);
    let hit = unit(minus(OTHER_CUP, ball));
    let from_ball = minus(other, ball);
    let is_covered = 0.0 < dot(from_ball, hit) && dot(from_ball, right_of(hit)).abs() < COVERED;
    if is_covered && length(ball_velocity) < RESTING {
        [RIGHT_IMAGE[0].copysign(ball[0] - own[0]), RIGHT_IMAGE[1]]
    } else {
        OTHER_CUP
    }
}

/// Velocity behind the ball, then through it towards `target`.
fn chase(seen: &[f32], target: [f32; 2], speed: f32) -> [f32; 2] {
    let (own, ball, ball_velocity) = ([seen[0], seen[1]], [seen[8], seen[9]], [seen[10], seen[11]]);
    if OUT_OF_REACH < ball[1] {
        return towards(along(OWN_CUP, ball, WAIT_DISTANCE), own, speed);
    }
    // Position of the ball at the time at which the striker can reach it.
    let time = (length(minus(ball, own)) / speed).min(LONGEST_LEAD);
    let ball = [ball[0] + time * ball_velocity[0], ball[1] + time * ball_velocity[1]];
    let hit = unit(minus(target, ball));
    let across = right_of(hit);
    let from_ball = minus(own, ball);
    let (behind, beside) = (-dot(from_ball, hit), dot(from_ball, across));
    // A shot over the walls is about twice as long, so half the error is allowed.
    let on_line = if target == OTHER_CUP { ON_LINE } else { 0.5 * ON_LINE };
    if 0.0 < behind && beside.abs() < on_line {
        return strike(own, [hit, across], beside, speed);
    }
    let mut place = [ball[0] - RUN_UP * hit[0], ball[1] - RUN_UP * hit[1]];
    if behind < 0.0 {
        // Around the ball, on the side on which it is.
        let side = if beside < 0.0 { -RUN_UP } else { RUN_UP };
        place = [place[0] + side * across[0], place[1] + side * across[1]];
    }
    if length(minus(place, OWN_CUP)) < CUP_CLEARANCE {
        place = along(OWN_CUP, own, CUP_CLEARANCE);
    }
    towards(place, own, speed)
}

/// Velocity through the ball along `hit`, with a correction of the lateral error `beside`. It is no
/// faster forwards than the wall limiter permits, which would bend the path.
fn strike(own: [f32; 2], [hit, across]: [[f32; 2]; 2], beside: f32, speed: f32) -> [f32; 2] {
    let room = (FAR_EDGE - own[1]).clamp(0.0, BRAKING) / BRAKING;
    let forwards = (room / hit[1].max(1e-3)).min(1.0) * speed;
    [0, 1].map(|k| (forwards * hit[k] - GAIN * beside * across[k]).clamp(-speed, speed))
}

/// Velocity from `own` to `place`, directed away from the own cup when too close to it.
fn towards(place: [f32; 2], own: [f32; 2], speed: f32) -> [f32; 2] {
    let to_cup = minus(own, OWN_CUP);
    let place = if length(to_cup) < CUP_CLEARANCE {
        along(OWN_CUP, own, 2.0 * CUP_CLEARANCE)
    } else {
        place
    };
    minus(place, own).map(|distance| (GAIN * distance).clamp(-speed, speed))
}

/// Point at `distance` from `start` on the way to `end`.
fn along(start: [f32; 2], end: [f32; 2], distance: f32) -> [f32; 2] {
    let [x, y] = unit(minus(end, start));
    [start[0] + distance * x, start[1] + distance * y]
}

fn minus(a: [f32; 2], b: [f32; 2]) -> [f32; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn length(a: [f32; 2]) -> f32 {
    dot(a, a).sqrt()
}

/// Vector `a`, turned to the right by 90 degrees.
fn right_of([x, y]: [f32; 2]) -> [f32; 2] {
    [y, -x]
}

/// Unit vector of `a`; straight ahead for a zero vector.
fn unit(a: [f32; 2]) -> [f32; 2] {
    let length = length(a);
    if length < 1e-6 { [0.0, 1.0] } else { a.map(|v| v / length) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        game::{Ending, GameSettings, Games, ObservationKind, Outcomes},
        recording::topic::Player,
    };

    const SPEED: f32 = 0.4;

    /// Play one episode in each of `boards` environments; returns its ends and the number of hits
    /// of each player.
    fn play([left, right]: [Scripted; 2], boards: usize) -> (Vec<Ending>, [u32; 2]) {
        let mut games = Games::new(boards, &GameSettings::default(), 5).unwrap();
        let mut outcomes = Outcomes::new(boards);
        let mut rows = [vec![0.0; 12 * boards], vec![0.0; 12 * boards]];
        let mut endings = vec![None; boards];
        let mut hits = [0; 2];
        for step in 0..600 {
            for player in Player::BOTH {
                let rows = &mut rows[player as usize];
                games.observe(player, ObservationKind::Standard12, rows).unwrap();
            }
            let commands: Vec<_> = (0..boards)
                .map(|board| {
                    let moment = Moment { seed: 1, board: board as u64, step };
                    let of = |script: Scripted, player: usize| {
                        let row = &rows[player][12 * board..12 * (board + 1)];
                        script.velocity(row, moment, SPEED)
                    };
                    [of(left, 0), of(right, 1)]
                })
                .collect();
            games.step(&commands, &mut outcomes).unwrap();
            for (ending, ended) in endings.iter_mut().zip(&outcomes.ended) {
                *ending = ending.or(*ended);
            }
            for of_board in &outcomes.hits {
                hits[0] += u32::from(of_board[0]);
                hits[1] += u32::from(of_board[1]);
            }
        }
        (endings.into_iter().flatten().collect(), hits)
    }

    fn wins(endings: &[Ending], player: Player) -> usize {
        endings.iter().filter(|ending| ending.winner() == Some(player)).count()
    }

    #[test]
    fn the_chaser_scores_from_both_seats() {
        for other in [Scripted::Stationary, Scripted::Random] {
            let (endings, hits) = play([Scripted::Chaser, other], 100);
            assert_eq!(endings.len(), 100);
            let (own, others) = (wins(&endings, Player::Left), wins(&endings, Player::Right));
            assert!(3 * others.max(1) < own, "{other}: {own} {others}");
            assert!(40 < hits[0], "{other}: {hits:?}");
            let (endings, _) = play([other, Scripted::Chaser], 100);
            let (own, others) = (wins(&endings, Player::Right), wins(&endings, Player::Left));
            assert!(3 * others.max(1) < own, "turned, {other}: {own} {others}");
        }
    }

    #[test]
    fn the_goalkeeper_lets_fewer_in_than_one_that_stands() {
        let conceded = |keeper| {
            let (endings, _) = play([Scripted::Chaser, keeper], 100);
            let goal = Ending::Goal { scorer: Player::Left };
            endings.iter().filter(|ending| **ending == goal).count()
        };
        let (keeper, standing) = (conceded(Scripted::Goalkeeper), conceded(Scripted::Stationary));
        assert!(keeper < standing, "{keeper} {standing}");
    }

    #[test]
    fn the_shooter_scores_past_the_goalkeeper() {
        let goals = |script| {
            let (endings, _) = play([script, Scripted::Goalkeeper], 200);
            wins(&endings, Player::Left)
        };
        let (shooter, chaser) = (goals(Scripted::Shooter), goals(Scripted::Chaser));
        assert!(5 * chaser.max(1) < shooter, "{shooter} {chaser}");
    }

    #[test]
    fn a_covered_shot_goes_over_the_walls_to_the_side_of_the_hit() {
        let ball = [0.02, -0.1];
        let keeper = along(OTHER_CUP, ball, KEEPER_DISTANCE);
        let target = |own: [f32; 2], other: [f32; 2], ball_speed| {
            let mut seen = [0.0; 12];
            for (first, value) in [(0, own), (4, other), (8, ball), (10, [ball_speed, 0.0])] {
                seen[first..first + 2].copy_from_slice(&value);
            }
            shot_target(&seen)
        };
        let (left_of_it, right_of_it) = ([-0.01, -0.12], [0.05, -0.12]);
        assert_eq!(target(left_of_it, keeper, 0.0), RIGHT_IMAGE);
        assert_eq!(target(right_of_it, keeper, 0.0), [-RIGHT_IMAGE[0], RIGHT_IMAGE[1]]);
        assert_eq!(target(left_of_it, [0.1, 0.1], 0.0), OTHER_CUP);
        assert_eq!(target(left_of_it, keeper, 0.1), OTHER_CUP);
        // By hand: 2 (0.16 - 0.007) and 2 (0.21 - 0.007) - 0.17.
        assert!((RIGHT_IMAGE[0] - 0.306).abs() < 1e-6 && (RIGHT_IMAGE[1] - 0.236).abs() < 1e-6);
    }

    #[test]
    fn careful_players_do_not_fall_into_their_cups() {
        for script in
            [Scripted::Stationary, Scripted::Goalkeeper, Scripted::Chaser, Scripted::Shooter]
        {
            let (endings, _) = play([script, Scripted::Chaser], 40);
            let own = endings.iter().filter(|e| **e == Ending::OwnGoal { loser: Player::Left });
            assert!(own.count() <= 1, "{script}: {endings:?}");
        }
    }

    #[test]
    fn random_velocities_last_and_differ_by_board_and_time() {
        let seen = [0.0; 12];
        let at =
            |board, step| Scripted::Random.velocity(&seen, Moment { seed: 3, board, step }, SPEED);
        assert_eq!(at(0, 0), at(0, RANDOM_STEPS - 1));
        assert_ne!(at(0, 0), at(0, RANDOM_STEPS));
        assert_ne!(at(0, 0), at(1, 0));
        assert!((0..100).flat_map(|step| at(0, 10 * step)).all(|v| v.abs() <= SPEED));
    }
}
