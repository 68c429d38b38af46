//! Dry and viscous friction of one degree of freedom, with a step that never reverses the motion.
//!
//! Friction at speed `v`: `Fc + (Fs - Fc) exp(-(v/vs)^2) + Fv |v| + Fq v^2`, the dry part
//! multiplied by a ratio when `v < 0`. Over a step the friction may remove at most the whole
//! velocity. A resting body therefore stays at rest until the other forces exceed `Fs`, a discrete
//! form of Coulomb's law (non-smooth time stepping, e.g. Stewart and Trinkle 1996). With a presliding
//! stiffness `k` the dry part is a spring that slips at the force `F(v)`: the Jenkins element of
//! Iwan's models (1966), which gives hysteresis within `2 F/k`. A load adds a fraction of its force to
//! the dry part.

use super::config::{GuideFriction, MotorFriction};

/// Coefficients, all in units of one degree of freedom.
#[derive(Debug, Clone, Copy)]
pub(super) struct Friction {
    coulomb: f64,
    /// Breakaway minus Coulomb friction.
    bump: f64,
    stribeck_speed: f64,
    viscous: f64,
    quadratic: f64,
    backward_ratio: f64,
    /// Friction per load.
    load_fraction: f64,
    /// Presliding stiffness; 0 for rigid.
    presliding: f64,
    /// Deflection of the presliding spring.
    bent: f64,
}

impl Friction {
    /// Friction of a motor, in belt coordinates: N and m/s at the pulley's pitch radius `radius`,
    /// with `per_turn` metres of belt per turn.
    pub(super) fn of_motor(config: &MotorFriction, radius: f64, per_turn: f64) -> Self {
        Self {
            coulomb: config.coulomb_nm / radius,
            bump: (config.breakaway_nm - config.coulomb_nm).max(0.0) / radius,
            stribeck_speed: config.stribeck_turns_per_s * per_turn,
            viscous: config.viscous_nm_s_per_turn / radius / per_turn,
            quadratic: config.quadratic_nm_s2_per_turn2 / radius / per_turn.powi(2),
            backward_ratio: config.backward_ratio,
            load_fraction: config.load_fraction,
            presliding: 0.0,
            bent: 0.0,
        }
    }

    /// Friction of a linear guide.
    pub(super) fn of_guide(config: &GuideFriction) -> Self {
        Self {
            coulomb: config.coulomb_n,
            bump: (config.breakaway_n - config.coulomb_n).max(0.0),
            stribeck_speed: config.stribeck_m_per_s,
            viscous: config.viscous_n_s_per_m,
            quadratic: config.quadratic_n_s2_per_m2,
            backward_ratio: config.backward_ratio,
            load_fraction: 0.0,
            presliding: config.presliding_stiffness_n_per_m,
            bent: 0.0,
        }
    }

    /// Magnitude of the dry friction at `velocity` under `load`, multiplied by `factor`.
    fn dry(&self, velocity: f64, load: f64, factor: f64) -> f64 {
        let speed = velocity.abs();
        let mut dry = self.coulomb;
        if 0.0 < self.bump && speed < 4.0 * self.stribeck_speed {
            dry += self.bump * (-(speed / self.stribeck_speed).powi(2)).exp();
        }
        let side = if velocity < 0.0 { self.backward_ratio } else { 1.0 };
        (dry * factor + self.load_fraction * load.abs()) * side
    }

    /// Velocity after `dt` seconds of friction on `mass` under `load`, starting from `velocity`;
    /// the dry part is multiplied by `factor`.
    pub(super) fn slowed(&mut self, velocity: f64, under: Under) -> f64 {
        let Under { load, factor, mass, dt } = under;
        let speed = velocity.abs();
        let dry = self.dry(velocity, load, factor);
        let wet = (self.viscous + self.quadratic * speed) * speed;
        if 0.0 < self.presliding {
            let most = dry / self.presliding;
            let pull = self.presliding * self.bent.clamp(-most, most) + wet.copysign(velocity);
            let slowed = velocity - pull * dt / mass;
            self.bent = (self.bent + slowed * dt).clamp(-most, most);
            return slowed;
        }
        let loss = (dry + wet) * dt / mass;
        if speed <= loss { 0.0 } else { velocity - loss.copysign(velocity) }
    }
}

/// Conditions of one friction step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Under {
    /// Load force (N).
    pub(super) load: f64,
    /// Factor on the dry part.
    pub(super) factor: f64,
    /// Mass (kg).
    pub(super) mass: f64,
    /// Step (s).
    pub(super) dt: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNDER: Under = Under { load: 0.0, factor: 1.0, mass: 1.0, dt: 1e-4 };

    fn rail(breakaway_n: f64, presliding_stiffness_n_per_m: f64) -> Friction {
        Friction::of_guide(&GuideFriction {
            coulomb_n: 1.0,
            breakaway_n,
            presliding_stiffness_n_per_m,
            viscous_n_s_per_m: 0.0,
            ..GuideFriction::default()
        })
    }

    #[test]
    fn what_stands_stays_until_breakaway() {
        let mut friction = rail(2.0, 0.0);
        // 1.9 N push in one step: less than the breakaway force, so nothing moves.
        assert_eq!(friction.slowed(1.9e-4, UNDER), 0.0);
        assert!(0.0 < friction.slowed(2.1e-4, UNDER));
        // Far above the Stribeck speed only Coulomb friction remains.
        let after = friction.slowed(1.0, UNDER);
        assert!((after - (1.0 - 1e-4)).abs() < 1e-12);
    }

    #[test]
    fn before_it_slips_an_elastic_stage_pushes_back() {
        let mut friction = rail(0.0, 1e4);
        // 0.5 N hold it 0.05 mm away; without them it returns.
        let (mut velocity, mut place) = (0.0, 0.0);
        for _ in 0..2000 {
            velocity = friction.slowed(velocity + 0.5e-4 - velocity * 0.01, UNDER);
            place += velocity * 1e-4;
        }
        assert!((place - 5e-5).abs() < 2e-6, "{place}");
        for _ in 0..2000 {
            velocity = friction.slowed(velocity - velocity * 0.01, UNDER);
            place += velocity * 1e-4;
        }
        assert!(place.abs() < 2e-6, "{place}");
    }
}
