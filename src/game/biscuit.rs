//! The three magnets ("biscuits") of the full game.
//!
//! A free biscuit slides with Coulomb friction, is hit by the ball and bounces off walls with the
//! walls' restitution. A striker whose centre comes within the capture distance holds it for the
//! rest of the episode; from then on the ball collides with both. Two biscuits on one striker lose
//! the point. Biscuits neither touch each other nor fall into cups.

use super::{
    body::{Mover, length, scale, subtract},
    cup::GRAVITY,
    settings::BiscuitSettings,
};
use crate::board::BALL_RADIUS;

/// State of one biscuit.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct BiscuitState {
    /// Position (m), absolute or relative to its holder.
    pub(super) position: [f64; 2],
    /// Velocity (m/s); unused while held.
    pub(super) velocity: [f64; 2],
    /// Index of the striker that holds it.
    pub(super) holder: Option<u8>,
}

impl BiscuitState {
    /// The three biscuits at the start of an episode.
    pub(super) fn start(settings: &BiscuitSettings) -> [Self; 3] {
        [-1.0, 0.0, 1.0]
            .map(|side| Self { position: [side * settings.spacing, 0.0], ..Self::default() })
    }

    /// Position (m), with the strikers at `strikers`.
    pub(super) fn place(&self, strikers: [[f64; 2]; 2]) -> [f64; 2] {
        self.holder.map_or(self.position, |holder| {
            super::body::add(self.position, strikers[usize::from(holder)])
        })
    }

    /// Motion through the next piece; `strikers` are the movers of both.
    pub(super) fn mover(&self, settings: &BiscuitSettings, strikers: &[Mover]) -> Mover {
        let touch = BALL_RADIUS + settings.radius;
        let (position, velocity, mass) = match self.holder {
            None => (self.position, self.velocity, settings.mass),
            Some(holder) => {
                let holder = &strikers[usize::from(holder)];
                let place = super::body::add(self.position, holder.position);
                (place, holder.velocity, holder.mass + settings.mass)
            }
        };
        Mover { position, velocity, kicked: [0.0; 2], moved: [0.0; 2], mass, touch }
    }

    /// Advance a free biscuit over a piece of `dt` seconds in which it moved as `mover`.
    pub(super) fn slide(
        &mut self,
        settings: &BiscuitSettings,
        mover: &Mover,
        (half, restitution): ([f64; 2], f64),
        dt: f64,
    ) {
        self.position = mover.position;
        self.velocity = mover.velocity;
        for (axis, half) in half.into_iter().enumerate() {
            let most = half - settings.radius;
            let beyond = self.position[axis].abs() - most;
            if 0.0 < beyond {
                let side = self.position[axis].signum();
                self.position[axis] = side * most;
                let outwards = (side * self.velocity[axis]).max(0.0);
                self.velocity[axis] -= side * (1.0 + restitution) * outwards;
            }
        }
        let speed = length(self.velocity);
        let left = speed - settings.friction * GRAVITY * dt;
        self.velocity = if 0.0 < left { scale(self.velocity, left / speed) } else { [0.0; 2] };
    }

    /// Attach the biscuit to `holder` at `striker`.
    pub(super) fn stick(&mut self, holder: u8, striker: [f64; 2]) {
        self.position = subtract(self.position, striker);
        self.velocity = [0.0; 2];
        self.holder = Some(holder);
    }
}
