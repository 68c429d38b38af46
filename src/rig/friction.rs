//! Dry and viscous friction of one degree of freedom, and the step that never reverses a motion.
//!
//! Level at speed `v`: `Fc + (Fs - Fc) exp(-(v/vs)^2) + Fv |v| + Fq v^2`, the dry part multiplied by
//! a ratio when `v < 0`. Over a step the friction may take away at most the whole velocity, so what
//! stands stays standing until the other forces exceed `Fs` (a discrete form of Coulomb's law; the
//! idea of non-smooth time stepping, e.g. Stewart and Trinkle 1996). No presliding.

use super::config::{MotorFriction, RailFriction};

/// Coefficients, all in units of one degree of freedom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Friction {
    coulomb: f64,
    /// Extra at standstill.
    bump: f64,
    stribeck_speed: f64,
    viscous: f64,
    quadratic: f64,
    backward_ratio: f64,
}

impl Friction {
    /// Of a motor, in belt coordinates: N and m/s at the pulley's pitch radius `radius`, `per_turn`
    /// metres of belt per turn.
    pub(super) fn of_motor(config: &MotorFriction, radius: f64, per_turn: f64) -> Self {
        Self {
            coulomb: config.coulomb_nm / radius,
            bump: (config.breakaway_nm - config.coulomb_nm).max(0.0) / radius,
            stribeck_speed: config.stribeck_turns_per_s * per_turn,
            viscous: config.viscous_nm_s_per_turn / radius / per_turn,
            quadratic: config.quadratic_nm_s2_per_turn2 / radius / per_turn.powi(2),
            backward_ratio: config.backward_ratio,
        }
    }

    /// Of a rail.
    pub(super) fn of_rail(config: &RailFriction) -> Self {
        Self {
            coulomb: config.coulomb_n,
            bump: (config.breakaway_n - config.coulomb_n).max(0.0),
            stribeck_speed: config.stribeck_m_per_s,
            viscous: config.viscous_n_s_per_m,
            quadratic: config.quadratic_n_s2_per_m2,
            backward_ratio: config.backward_ratio,
        }
    }

    /// Magnitude of the friction force at `velocity`, its dry part multiplied by `factor`.
    fn level(&self, velocity: f64, factor: f64) -> f64 {
        let speed = velocity.abs();
        let mut dry = self.coulomb;
        if 0.0 < self.bump && speed < 4.0 * self.stribeck_speed {
            dry += self.bump * (-(speed / self.stribeck_speed).powi(2)).exp();
        }
        let side = if velocity < 0.0 { self.backward_ratio } else { 1.0 };
        dry * side * factor + (self.viscous + self.quadratic * speed) * speed
    }

    /// `velocity` after `dt` seconds of friction on `mass`.
    pub(super) fn slowed(&self, velocity: f64, factor: f64, dt_per_mass: f64) -> f64 {
        let loss = self.level(velocity, factor) * dt_per_mass;
        if velocity.abs() <= loss { 0.0 } else { velocity - loss.copysign(velocity) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_stands_stays_until_breakaway() {
        let friction = Friction::of_rail(&RailFriction {
            coulomb_n: 1.0,
            breakaway_n: 2.0,
            viscous_n_s_per_m: 0.0,
            ..RailFriction::default()
        });
        let dt_per_mass = 1e-4;
        // 1.9 N push in one step: less than the breakaway force, so nothing moves.
        assert_eq!(friction.slowed(1.9 * dt_per_mass, 1.0, dt_per_mass), 0.0);
        assert!(0.0 < friction.slowed(2.1 * dt_per_mass, 1.0, dt_per_mass));
        // Far above the Stribeck speed only Coulomb's friction is left.
        let after = friction.slowed(1.0, 1.0, dt_per_mass);
        assert!((after - (1.0 - 1.0 * dt_per_mass)).abs() < 1e-12);
    }
}
