//! What moves on a board.

use crate::board::{BALL_RADIUS, STRIKER_RADIUS};

/// Value of [`BallState::over_cup`] of a ball that is over the board.
pub(super) const ON_THE_BOARD: f64 = -1.0;

/// The ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BallState {
    /// Place (m).
    pub(super) position: [f64; 2],
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// Velocity of the contact point on the board; zero while it rolls (m/s).
    pub(super) slip: [f64; 2],
    /// Spin about the vertical, as velocity of the rim (m/s).
    pub(super) spin: f64,
    /// Time since the last impact or the start (s).
    pub(super) since_impact: f64,
    /// How long its centre has been over a cup (s); [`ON_THE_BOARD`] when it is not.
    pub(super) over_cup: f64,
}

impl BallState {
    /// At rest at `position` (m).
    pub(super) fn at(position: [f64; 2]) -> Self {
        Self {
            position,
            velocity: [0.0; 2],
            slip: [0.0; 2],
            spin: 0.0,
            since_impact: 0.0,
            over_cup: ON_THE_BOARD,
        }
    }

    /// Speed (m/s).
    pub(super) fn speed(&self) -> f64 {
        length(self.velocity)
    }

    /// Moves on a straight line for `time` seconds.
    pub(super) fn advance(&mut self, time: f64) {
        self.position = along(self.position, self.velocity, time);
        self.since_impact += time;
        if self.over_cup != ON_THE_BOARD {
            self.over_cup += time;
        }
    }
}

/// One striker: where its drive leads it, and how far hits have pushed it from there.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct StrikerState {
    /// Command after clamp and slew limit, in the board frame (m/s).
    pub(super) command: [f64; 2],
    /// Place of the carriage as the wall limiter knows it (m).
    pub(super) carriage: [f64; 2],
    /// Where the magnet leads the striker (m).
    pub(super) led: [f64; 2],
    /// Velocity of that place (m/s).
    pub(super) led_velocity: [f64; 2],
    /// Displacement by hits (m).
    pub(super) recoil: [f64; 2],
    /// Its velocity (m/s).
    pub(super) recoil_velocity: [f64; 2],
}

impl StrikerState {
    /// At rest at `position` (m).
    pub(super) fn at(position: [f64; 2]) -> Self {
        Self { carriage: position, led: position, ..Self::default() }
    }

    /// Place (m).
    pub(super) fn position(&self) -> [f64; 2] {
        add(self.led, self.recoil)
    }

    /// Velocity (m/s).
    pub(super) fn velocity(&self) -> [f64; 2] {
        add(self.led_velocity, self.recoil_velocity)
    }
}

/// A striker or a biscuit during one piece of a period: it moves on a straight line but for hits.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mover {
    /// Place (m).
    pub(super) position: [f64; 2],
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// Change of the velocity by hits so far (m/s).
    pub(super) kicked: [f64; 2],
    /// Displacement by them (m).
    pub(super) moved: [f64; 2],
    /// Mass (kg).
    pub(super) mass: f64,
    /// Distance of centres at which it touches the ball (m).
    pub(super) touch: f64,
}

impl Mover {
    /// A striker.
    pub(super) fn striker(position: [f64; 2], velocity: [f64; 2], mass: f64) -> Self {
        let touch = BALL_RADIUS + STRIKER_RADIUS;
        Self { position, velocity, kicked: [0.0; 2], moved: [0.0; 2], mass, touch }
    }

    /// Moves on for `time` seconds.
    pub(super) fn advance(&mut self, time: f64) {
        self.position = along(self.position, self.velocity, time);
        self.moved = along(self.moved, self.kicked, time);
    }

    /// Changes the velocity by `change` (m/s).
    pub(super) fn kick(&mut self, change: [f64; 2]) {
        self.velocity = add(self.velocity, change);
        self.kicked = add(self.kicked, change);
    }
}

/// `position + velocity time`.
#[inline(always)]
pub(super) fn along(position: [f64; 2], velocity: [f64; 2], time: f64) -> [f64; 2] {
    [position[0] + velocity[0] * time, position[1] + velocity[1] * time]
}

#[inline(always)]
pub(super) fn add(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] + b[0], a[1] + b[1]]
}

#[inline(always)]
pub(super) fn subtract(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

#[inline(always)]
pub(super) fn scale(a: [f64; 2], factor: f64) -> [f64; 2] {
    [a[0] * factor, a[1] * factor]
}

#[inline(always)]
pub(super) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Length; `hypot` takes several times as long, and nothing here over- or underflows.
#[inline(always)]
pub(super) fn length(a: [f64; 2]) -> f64 {
    dot(a, a).sqrt()
}
