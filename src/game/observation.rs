//! Observations of a player: 12 standard values, and features computed from them.
//!
//! Source: the upstream observation configuration; the order is part of every policy file. All
//! values are in the player's own frame (that of the left player; the board turned by 180 degrees
//! for the right one), in m, m/s and rad.
//!
//! | index | value | index | value |
//! |---|---|---|---|
//! | 0, 1 | own striker | 12 | angle at the own striker between ball and other cup |
//! | 2, 3 | its velocity | 13 | angle at the other striker between ball and own cup |
//! | 4, 5 | other striker | 14 | angle at the own striker between ball and other striker |
//! | 6, 7 | its velocity | 15 | angle at the other striker between ball and own striker |
//! | 8, 9 | ball | 16, 17 | distance from the ball to the own, the other cup |
//! | 10, 11 | its velocity | 18, 19 | distance from the ball to the own, the other striker |
//!
//! The first 20 are upstream's. The larger set adds the geometry of a shot, by signed values. The hit
//! line leads from the ball to the other cup; across it is positive to its right.
//!
//! | index | value |
//! |---|---|
//! | 20, 21 | ball relative to the own striker (m) |
//! | 22, 23 | own striker relative to the ball: across the hit line, distance behind the ball along it (m) |
//! | 24 | `a / (|a| + 5 mm)` of value 22, which resolves the last millimetres |
//! | 25, 26 | velocity of the own striker across and along the hit line (m/s) |
//! | 27, 28 | velocity of the ball across and along the hit line (m/s) |
//!
//! The largest set adds the velocity (m/s) that the scripted shooter ([`Scripted::Shooter`](crate::opponent::Scripted)) would command, at most 0.4 m/s
//! along each axis. It aims a shot within a millimetre, which no network learned from the other values. Its target is on
//! the KlaskTron board.
//!
//! | index | value |
//! |---|---|
//! | 29, 30 | command of the shooter along x and y |
//!
//! After these values a policy may observe its own previous commands, the newest first (m/s, own
//! frame, before the wall limiter): [`ObservationLayout`]. A command that has not reached its drive yet is
//! part of the state of the simulation; without it, a policy behind a delay sees half a state (Katsikopoulos
//! and Engelbrecht, "Markov decision processes with delays and asynchronous cost collection", 2003).
//!
//! Angles are `acos(a b / (|a| |b| + 1e-8))`, from 0 to pi. One version of upstream's table
//! software computed value 16 relative to the own striker; here it is the cup.
//!
//! The state is exact and current, or that of the state estimator behind a camera
//! ([`Sensors`](super::Sensors)); all features are computed from the same values.

use super::{
    body::{BallState, StrikerState},
    settings::CommandLimits,
};
use crate::{opponent::shoot, recording::topic::Player};
use serde::{Deserialize, Serialize};

/// Set of observed values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ObservationKind {
    /// Positions and velocities: 12 values.
    #[serde(rename = "standard12")]
    Standard12,
    /// Positions and velocities with angles and distances: 20 values.
    #[serde(rename = "augmented20")]
    Augmented20,
    /// These and the geometry of a shot: 29 values.
    #[serde(rename = "aiming29")]
    Aiming29,
    /// These and the command of the scripted shooter: 31 values.
    #[serde(rename = "shooting31")]
    Shooting31,
}

/// Lateral offset at which value 24 is one half (m): a ball that is hit 1.4 mm off its middle
/// leaves 0.1 rad off, which is half a cup at the other end.
const AIM_SCALE: f32 = 0.005;

/// Maximum speed of the observed shooter along each axis (m/s).
const SHOOTER_SPEED: f32 = CommandLimits::DEFAULT_SPEED as f32;

impl ObservationKind {
    /// All sets, the smallest first.
    pub const ALL: [Self; 4] =
        [Self::Standard12, Self::Augmented20, Self::Aiming29, Self::Shooting31];

    /// Number of values of the largest set.
    pub const MOST: usize = 31;

    /// Name in settings and files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Standard12 => "standard12",
            Self::Augmented20 => "augmented20",
            Self::Aiming29 => "aiming29",
            Self::Shooting31 => "shooting31",
        }
    }

    /// Number of values.
    #[must_use]
    pub const fn len(self) -> usize {
        match self {
            Self::Standard12 => 12,
            Self::Augmented20 => 20,
            Self::Aiming29 => 29,
            Self::Shooting31 => Self::MOST,
        }
    }

    /// Name of each value with its unit, in order.
    #[must_use]
    pub fn names(self) -> &'static [&'static str] {
        const NAMES: [&str; ObservationKind::MOST] = [
            "own_x_m",
            "own_y_m",
            "own_vx_m_per_s",
            "own_vy_m_per_s",
            "other_x_m",
            "other_y_m",
            "other_vx_m_per_s",
            "other_vy_m_per_s",
            "ball_x_m",
            "ball_y_m",
            "ball_vx_m_per_s",
            "ball_vy_m_per_s",
            "angle_at_own_ball_to_other_cup_rad",
            "angle_at_other_ball_to_own_cup_rad",
            "angle_at_own_ball_to_other_striker_rad",
            "angle_at_other_ball_to_own_striker_rad",
            "ball_to_own_cup_m",
            "ball_to_other_cup_m",
            "ball_to_own_striker_m",
            "ball_to_other_striker_m",
            "ball_from_own_x_m",
            "ball_from_own_y_m",
            "own_across_hit_line_m",
            "own_behind_ball_m",
            "own_across_hit_line_saturated",
            "own_speed_across_hit_line_m_per_s",
            "own_speed_along_hit_line_m_per_s",
            "ball_speed_across_hit_line_m_per_s",
            "ball_speed_along_hit_line_m_per_s",
            "shooter_vx_m_per_s",
            "shooter_vy_m_per_s",
        ];
        &NAMES[..self.len()]
    }

    /// Sign of each value when the board is mirrored across its long axis (x to -x), `[len]`: -1
    /// for values along x or across the hit line; angles and distances are the same.
    #[must_use]
    pub fn mirror_signs(self) -> Vec<i8> {
        let is_x = |index: &usize| match index {
            0..12 => index.is_multiple_of(2),
            _ => [20, 22, 24, 25, 27, 29].contains(index),
        };
        (0..self.len()).map(|index| if is_x(&index) { -1 } else { 1 }).collect()
    }

    /// Always false: no set is empty.
    #[must_use]
    pub fn is_empty(self) -> bool {
        false
    }
}

/// Maximum number of previous commands in an observation: 160 ms at 50 Hz.
pub const MOST_PREVIOUS_COMMANDS: usize = 8;

/// Values that a policy observes, in this order: values of the state, then its own previous commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ObservationLayout {
    /// Values of the state.
    pub state: ObservationKind,
    /// Number of previous commands, two values each, 0 to [`MOST_PREVIOUS_COMMANDS`].
    pub commands: usize,
}

impl From<ObservationKind> for ObservationLayout {
    fn from(state: ObservationKind) -> Self {
        Self { state, commands: 0 }
    }
}

impl ObservationLayout {
    /// Number of values of the largest layout.
    pub const MOST: usize = ObservationKind::MOST + 2 * MOST_PREVIOUS_COMMANDS;

    /// Number of values.
    #[must_use]
    pub const fn len(self) -> usize {
        self.state.len() + 2 * self.commands
    }

    /// Always false: no layout is empty.
    #[must_use]
    pub fn is_empty(self) -> bool {
        false
    }

    /// Name of each value with its unit, in order.
    #[must_use]
    pub fn names(self) -> Vec<String> {
        let of_command = |number: usize| {
            ["x", "y"].map(|axis| format!("previous_command_{number}_v{axis}_m_per_s"))
        };
        let state = self.state.names().iter().map(|name| (*name).to_owned());
        state.chain((1..=self.commands).flat_map(of_command)).collect()
    }

    /// Sign of each value when the board is mirrored across its long axis, `[len]`.
    #[must_use]
    pub fn mirror_signs(self) -> Vec<i8> {
        let mut signs = self.state.mirror_signs();
        signs.extend([-1, 1].repeat(self.commands));
        signs
    }

    /// Write the values into `row`, `[len]`; the cups are `cup_distance` (m) from the middle.
    pub fn write(
        self,
        seen: &Observation,
        previous: &PreviousCommands,
        cup_distance: f32,
        row: &mut [f32],
    ) {
        let (state, commands) = row.split_at_mut(self.state.len());
        seen.write(self.state, cup_distance, state);
        previous.write(commands);
    }
}

/// Previous commands of one player, the newest first (m/s, own frame); zero before the first.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PreviousCommands([[f32; 2]; MOST_PREVIOUS_COMMANDS]);

impl PreviousCommands {
    /// Add the newest command.
    pub fn push(&mut self, command: [f32; 2]) {
        self.0.rotate_right(1);
        self.0[0] = command;
    }

    /// Write as many commands into `values` as fit, x before y.
    pub fn write(&self, values: &mut [f32]) {
        for (pair, command) in values.chunks_exact_mut(2).zip(&self.0) {
            pair.copy_from_slice(command);
        }
    }

    /// All values, for a checkpoint.
    #[must_use]
    pub fn values(&self) -> &[f32] {
        self.0.as_flattened()
    }

    /// All values, from a checkpoint.
    pub fn values_mut(&mut self) -> &mut [f32] {
        self.0.as_flattened_mut()
    }
}

/// Guard of the angles against division by zero, as in upstream.
const GUARD: f32 = 1e-8;

/// Observation of one player in one environment, in its own frame: position and velocity of own
/// striker, other striker and ball (m, m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation(pub [f32; 12]);

impl Observation {
    /// Observation of the exact state.
    pub(super) fn of(player: Player, strikers: &[StrikerState; 2], ball: &BallState) -> Self {
        let motion = |[x, y]: [f64; 2], [vx, vy]: [f64; 2]| [x, y, vx, vy];
        let strikers = [0, 1].map(|k| motion(strikers[k].position(), strikers[k].velocity()));
        Self::of_board(player, &strikers, motion(ball.position, ball.velocity))
    }

    /// Observation of `player`, from strikers (left first) and ball, each as (x, y, vx, vy) in the
    /// board frame (m, m/s).
    ///
    /// ```
    /// use klasktron::{game::Observation, recording::topic::Player};
    /// let strikers = [[0.02, -0.1, 0.0, 0.0], [0.05, 0.12, 0.0, 0.3]];
    /// let seen = Observation::of_board(Player::Right, &strikers, [0.0, 0.1, 0.2, 0.0]).0;
    /// assert_eq!(seen[..4], [-0.05, -0.12, 0.0, -0.3]);
    /// assert_eq!(seen[4..6], [-0.02, 0.1]);
    /// assert_eq!(seen[8..11], [0.0, -0.1, -0.2]);
    /// ```
    #[must_use]
    pub fn of_board(player: Player, strikers: &[[f64; 4]; 2], ball: [f64; 4]) -> Self {
        let (own, other) = match player {
            Player::Left => (strikers[0], strikers[1]),
            Player::Right => (strikers[1], strikers[0]),
        };
        let mut seen = [0.0; 12];
        let values = [own, other, ball].into_iter().flat_map(|[x, y, vx, vy]| [[x, y], [vx, vy]]);
        for (pair, value) in seen.chunks_exact_mut(2).zip(values) {
            pair.copy_from_slice(&turned(player, value).map(|value| value as f32));
        }
        Self(seen)
    }

    /// Write the values of `kind` into `row`; the cups are `cup_distance` (m) from the middle.
    pub fn write(&self, kind: ObservationKind, cup_distance: f32, row: &mut [f32]) {
        let (standard, augmented) = row.split_at_mut(12);
        standard.copy_from_slice(&self.0);
        if kind == ObservationKind::Standard12 {
            return;
        }
        let (features, aiming) = augmented.split_at_mut(8);
        features.copy_from_slice(&self.features(cup_distance));
        if kind == ObservationKind::Augmented20 {
            return;
        }
        let (aiming, shooting) = aiming.split_at_mut(9);
        aiming.copy_from_slice(&self.aiming(cup_distance));
        if kind == ObservationKind::Shooting31 {
            shooting.copy_from_slice(&shoot(&self.0, SHOOTER_SPEED));
        }
    }

    fn aiming(&self, cup_distance: f32) -> [f32; 9] {
        let [own, own_velocity, ball, ball_velocity] =
            [0, 2, 8, 10].map(|index| [self.0[index], self.0[index + 1]]);
        let way = [-ball[0], cup_distance - ball[1]];
        let size = (way[0] * way[0] + way[1] * way[1]).sqrt() + GUARD;
        let hit = way.map(|part| part / size);
        let across = |[x, y]: [f32; 2]| x * hit[1] - y * hit[0];
        let along = |[x, y]: [f32; 2]| x * hit[0] + y * hit[1];
        let from_ball = [own[0] - ball[0], own[1] - ball[1]];
        let beside = across(from_ball);
        [
            -from_ball[0],
            -from_ball[1],
            beside,
            -along(from_ball),
            beside / (beside.abs() + AIM_SCALE),
            across(own_velocity),
            along(own_velocity),
            across(ball_velocity),
            along(ball_velocity),
        ]
    }

    fn features(&self, cup_distance: f32) -> [f32; 8] {
        let place = |index: usize| [self.0[index], self.0[index + 1]];
        let (own, other, ball) = (place(0), place(4), place(8));
        let (own_cup, other_cup) = ([0.0, -cup_distance], [0.0, cup_distance]);
        [
            angle(own, ball, other_cup),
            angle(other, ball, own_cup),
            angle(own, ball, other),
            angle(other, ball, own),
            distance(ball, own_cup),
            distance(ball, other_cup),
            distance(ball, own),
            distance(ball, other),
        ]
    }
}

/// Transform a position (m) or velocity (m/s) between the board frame and the frame of `player`, in
/// either direction: identity for the left player, a turn by 180 degrees for the right one.
#[must_use]
pub fn turned(player: Player, vector: [f64; 2]) -> [f64; 2] {
    match player {
        Player::Left => vector,
        Player::Right => vector.map(|value| -value),
    }
}

fn distance(a: [f32; 2], b: [f32; 2]) -> f32 {
    let [x, y] = [a[0] - b[0], a[1] - b[1]];
    (x * x + y * y).sqrt()
}

/// Angle at `at` between `a` and `b` (rad).
fn angle(at: [f32; 2], a: [f32; 2], b: [f32; 2]) -> f32 {
    let [ax, ay] = [a[0] - at[0], a[1] - at[1]];
    let [bx, by] = [b[0] - at[0], b[1] - at[1]];
    let sizes = ((ax * ax + ay * ay) * (bx * bx + by * by)).sqrt();
    ((ax * bx + ay * by) / (sizes + GUARD)).clamp(-1.0, 1.0).acos()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::board::CUP_DISTANCE;
    use std::f32::consts::{FRAC_PI_2, PI};

    #[test]
    fn angles_and_distances_are_those_of_a_drawn_example() {
        // Own striker at (0, -0.1), other at (0, 0.1), ball at (0.1, -0.1).
        let mut seen = [0.0; 12];
        (seen[1], seen[5], seen[8], seen[9]) = (-0.1, 0.1, 0.1, -0.1);
        let mut row = [0.0; 20];
        Observation(seen).write(ObservationKind::Augmented20, 0.17, &mut row);
        let wanted = [
            FRAC_PI_2,
            (0.1_f32).atan2(0.2), // between (0.1, -0.2) and straight down
            FRAC_PI_2,
            (0.1_f32).atan2(0.2),
            (0.01_f32 + 0.0049).sqrt(),
            (0.01_f32 + 0.0729).sqrt(),
            0.1,
            (0.01_f32 + 0.04).sqrt(),
        ];
        for (index, (found, wanted)) in row[12..].iter().zip(wanted).enumerate() {
            assert!((found - wanted).abs() < 1e-5, "{}: {found} {wanted}", index + 12);
        }
        assert_eq!(row[..12], seen);
    }

    #[test]
    fn a_shot_is_described_along_its_hit_line() {
        // The ball is 0.1 m before the middle of the other cup's line, 0.07 m to its left; the
        // striker 30 mm behind it and 5 mm to the right of the line.
        let hit = [0.6_f32, 0.8];
        let ball = [-0.06, 0.17 - 0.08];
        let own =
            [ball[0] - 0.03 * hit[0] + 0.005 * hit[1], ball[1] - 0.03 * hit[1] - 0.005 * hit[0]];
        let mut seen = [0.0; 12];
        (seen[0], seen[1], seen[2], seen[3]) = (own[0], own[1], 0.3, 0.4);
        (seen[8], seen[9], seen[10], seen[11]) = (ball[0], ball[1], 0.0, 1.0);
        let mut row = [0.0; ObservationKind::Aiming29.len()];
        Observation(seen).write(ObservationKind::Aiming29, 0.17, &mut row);
        let [bx, by] = [ball[0] - own[0], ball[1] - own[1]];
        let wanted = [bx, by, 0.005, 0.03, 0.5, 0.0, 0.5, -0.6, 0.8];
        for (index, (found, wanted)) in row[20..].iter().zip(wanted).enumerate() {
            assert!((found - wanted).abs() < 1e-5, "{}: {found} {wanted}", index + 20);
        }
    }

    #[test]
    fn the_last_values_are_the_command_of_the_scripted_shooter() {
        let seen = [0.01, -0.15, 0.0, 0.0, 0.0, 0.12, 0.0, 0.0, 0.03, -0.1, 0.02, 0.0];
        let mut row = [0.0; ObservationKind::MOST];
        Observation(seen).write(ObservationKind::Shooting31, 0.17, &mut row);
        let moment = crate::opponent::Moment { seed: 0, board: 0, step: 0 };
        let wanted = crate::opponent::Scripted::Shooter.velocity(&seen, moment, SHOOTER_SPEED);
        assert_eq!(row[29..], wanted);
        assert_ne!(wanted, [0.0; 2]);
    }

    #[test]
    fn the_mirrored_board_is_seen_with_the_signs() {
        let kind = ObservationKind::Shooting31;
        let row = |mirror: f64| {
            let strikers =
                [[mirror * 0.02, -0.1, mirror * 0.3, 0.1], [mirror * -0.05, 0.12, 0.0, 0.3]];
            let ball = [mirror * 0.07, 0.03, mirror * -0.2, 0.4];
            let mut row = vec![0.0; kind.len()];
            let seen = Observation::of_board(Player::Right, &strikers, ball);
            seen.write(kind, CUP_DISTANCE as f32, &mut row);
            row
        };
        let signs = kind.mirror_signs();
        for ((value, mirrored), sign) in row(1.0).into_iter().zip(row(-1.0)).zip(signs) {
            assert!((f32::from(sign) * value - mirrored).abs() < 1e-6, "{value} {mirrored}");
        }
    }

    #[test]
    fn the_guard_makes_an_angle_without_a_side_a_right_one() {
        assert_eq!(angle([0.0; 2], [0.0; 2], [0.1, 0.0]), FRAC_PI_2);
        assert!((angle([0.0; 2], [0.1, 0.0], [-0.2, 0.0]) - PI).abs() < 2e-3);
    }
}
