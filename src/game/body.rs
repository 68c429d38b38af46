//! State of the ball, the strikers and other moving bodies.

use crate::board::{BALL_RADIUS, STRIKER_RADIUS};

/// Value of [`BallState::over_cup`] of a ball that is over the board.
pub(super) const ON_THE_BOARD: f64 = -1.0;

/// The ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BallState {
    /// Position (m).
    pub(super) position: [f64; 2],
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// Slip velocity of the contact point on the board (m/s); zero while rolling.
    pub(super) slip: [f64; 2],
    /// Spin about the vertical, as velocity of the ball's surface (m/s).
    pub(super) spin: f64,
    /// Time since the last impact or the start (s).
    pub(super) since_impact: f64,
    /// Time for which its centre has been over a cup (s); [`ON_THE_BOARD`] otherwise.
    pub(super) over_cup: f64,
}

impl BallState {
    /// Ball at rest at `position` (m).
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

    /// Move on a straight line for `time` seconds.
    pub(super) fn advance(&mut self, time: f64) {
        self.position = along(self.position, self.velocity, time);
        self.since_impact += time;
        if self.over_cup != ON_THE_BOARD {
            self.over_cup += time;
        }
    }
}

/// State of one striker: position of its drive, and displacement from it by impacts.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct StrikerState {
    /// Command after clamp and slew limit, in the board frame (m/s).
    pub(super) command: [f64; 2],
    /// Position of the carriage that the wall limiter uses (m).
    pub(super) carriage: [f64; 2],
    /// Position of the magnet (m).
    pub(super) led: [f64; 2],
    /// Velocity of the magnet (m/s).
    pub(super) led_velocity: [f64; 2],
    /// Displacement of the striker from the magnet by impacts (m).
    pub(super) recoil: [f64; 2],
    /// Velocity of the displacement (m/s).
    pub(super) recoil_velocity: [f64; 2],
}

impl StrikerState {
    /// Striker at rest at `position` (m).
    pub(super) fn at(position: [f64; 2]) -> Self {
        Self { carriage: position, led: position, ..Self::default() }
    }

    /// Position (m).
    pub(super) fn position(&self) -> [f64; 2] {
        add(self.led, self.recoil)
    }

    /// Velocity (m/s).
    pub(super) fn velocity(&self) -> [f64; 2] {
        add(self.led_velocity, self.recoil_velocity)
    }
}

/// A striker or a biscuit during one piece of a period: straight motion between impacts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mover {
    /// Position (m).
    pub(super) position: [f64; 2],
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// Velocity change by impacts so far (m/s).
    pub(super) kicked: [f64; 2],
    /// Displacement by these (m).
    pub(super) moved: [f64; 2],
    /// Mass (kg).
    pub(super) mass: f64,
    /// Distance of centres at contact with the ball (m).
    pub(super) touch: f64,
}

impl Mover {
    /// Mover of a striker.
    pub(super) fn striker(position: [f64; 2], velocity: [f64; 2], mass: f64) -> Self {
        let touch = BALL_RADIUS + STRIKER_RADIUS;
        Self { position, velocity, kicked: [0.0; 2], moved: [0.0; 2], mass, touch }
    }

    /// Advance for `time` seconds.
    pub(super) fn advance(&mut self, time: f64) {
        self.position = along(self.position, self.velocity, time);
        self.moved = along(self.moved, self.kicked, time);
    }

    /// Change the velocity by `change` (m/s).
    pub(super) fn kick(&mut self, change: [f64; 2]) {
        self.velocity = add(self.velocity, change);
        self.kicked = add(self.kicked, change);
    }
}

/// Position after straight motion, `position + velocity time`.
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

/// Length of a vector. `hypot` takes several times as long, and nothing here over- or underflows.
#[inline(always)]
pub(super) fn length(a: [f64; 2]) -> f64 {
    dot(a, a).sqrt()
}
