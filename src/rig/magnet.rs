//! Dynamics of the striker on the board, pulled by the magnet on the carriage.
//!
//! At the distance `s` the force is `k s / (1 + (s/s0)^2)^2`: linear near the magnet, largest
//! (`0.325 k s0`) at `s0 / sqrt 3`, and decaying beyond. It describes the lateral force of two
//! magnets across a gap (shape after Furlani, Permanent Magnet and Electromechanical Devices, 2001,
//! section 4.5; an approximation). Beyond `lost_at_m` the striker decouples and no force acts until
//! the magnet is nearer than `caught_at_m`. Friction of the striker on the board is Coulomb
//! friction in the plane. It stops at walls and does not fall into the cups.

use super::{
    config::{MagnetConfig, PegConfig},
    length,
};
use std::f64::consts::TAU;

/// State of a striker.
#[derive(Debug, Clone)]
pub(super) struct Peg {
    /// Position (m).
    pub(super) position: [f64; 2],
    /// Velocity (m/s).
    pub(super) velocity: [f64; 2],
    /// True if the magnet couples to it.
    pub(super) coupled: bool,
    /// True if a fault removes the magnet's force.
    pub(super) magnet_broken: bool,
    /// Displacement of its head from its foot (m).
    tip: [f64; 2],
    tip_velocity: [f64; 2],
    magnet: MagnetConfig,
    config: PegConfig,
    /// Half of the board's sides less the radius (m).
    reach: [f64; 2],
}

impl Peg {
    pub(super) fn new(
        config: &PegConfig,
        magnet: &MagnetConfig,
        position: [f64; 2],
        half_board: [f64; 2],
    ) -> Self {
        let reach = half_board.map(|half| (half - config.radius_m).max(0.0));
        Self {
            position: [0, 1].map(|axis| f64::clamp(position[axis], -reach[axis], reach[axis])),
            velocity: [0.0; 2],
            coupled: true,
            magnet_broken: false,
            tip: [0.0; 2],
            tip_velocity: [0.0; 2],
            magnet: magnet.clone(),
            config: config.clone(),
            reach,
        }
    }

    /// Radius (m).
    pub(super) fn radius(&self) -> f64 {
        self.config.radius_m
    }

    /// Mass (kg).
    pub(super) fn mass(&self) -> f64 {
        self.config.mass_kg
    }

    /// Position of its head, as seen by the camera (m).
    pub(super) fn head(&self) -> [f64; 2] {
        [self.position[0] + self.tip[0], self.position[1] + self.tip[1]]
    }

    /// Advance by `dt` (s) with the magnet at `magnet`, moving at `magnet_velocity`; returns the
    /// force on the magnet (N).
    pub(super) fn step(
        &mut self,
        magnet: [f64; 2],
        magnet_velocity: [f64; 2],
        dt: f64,
    ) -> [f64; 2] {
        let pull = self.pull(magnet, magnet_velocity);
        let mass = self.config.mass_kg;
        let before = self.velocity;
        let drag = self.config.viscous_n_s_per_m;
        for (axis, velocity) in self.velocity.iter_mut().enumerate() {
            *velocity += (pull[axis] - drag * *velocity) / mass * dt;
        }
        let speed = length(self.velocity);
        let loss = self.config.friction_n / mass * dt;
        let kept = if speed <= loss { 0.0 } else { 1.0 - loss / speed };
        for axis in 0..2 {
            self.velocity[axis] *= kept;
            self.position[axis] += self.velocity[axis] * dt;
            let reach = self.reach[axis];
            if reach < self.position[axis].abs() {
                self.position[axis] = reach.copysign(self.position[axis]);
                self.velocity[axis] = 0.0;
            }
        }
        self.wobble(before, dt);
        pull.map(|force| -force)
    }

    /// Force of the magnet on the striker (N); also updates the coupling.
    fn pull(&mut self, magnet: [f64; 2], magnet_velocity: [f64; 2]) -> [f64; 2] {
        let lag = [magnet[0] - self.position[0], magnet[1] - self.position[1]];
        let square = lag[0] * lag[0] + lag[1] * lag[1];
        let config = &self.magnet;
        let bound = if self.coupled { config.lost_at_m } else { config.caught_at_m };
        self.coupled = !self.magnet_broken && square < bound * bound;
        if !self.coupled {
            return [0.0; 2];
        }
        let fade = 1.0 + square / config.scale_m.powi(2);
        let spring = config.stiffness_n_per_m / (fade * fade);
        let damping = config.damping_n_s_per_m;
        [0, 1].map(|axis| {
            spring * lag[axis] + damping * (magnet_velocity[axis] - self.velocity[axis])
        })
    }

    /// Oscillation of the head about the foot: `t'' + 2 z w t' + w^2 t = -acceleration`.
    fn wobble(&mut self, before: [f64; 2], dt: f64) {
        if self.config.wobble_hz == 0.0 {
            return;
        }
        let rate = TAU * self.config.wobble_hz;
        let damping = 2.0 * self.config.wobble_damping_ratio * rate;
        for (axis, before) in before.into_iter().enumerate() {
            let acceleration = (self.velocity[axis] - before) / dt;
            self.tip_velocity[axis] -=
                (acceleration + damping * self.tip_velocity[axis] + rate * rate * self.tip[axis])
                    * dt;
            self.tip[axis] += self.tip_velocity[axis] * dt;
        }
    }
}
