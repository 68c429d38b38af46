//! Backlash between motor and load.

use crate::effects::{
    Domain, Effect, Gap, Motion, Parameter, Physics, Regressor, Signal, Site, Spring,
};

/// `drive.backlash`: backlash between motor and load.
///
/// The load moves freely within the gap of width b, and the motor drives it at either end. Within
/// the gap its own friction decelerates it by a_f. A load with much friction stays until the motor
/// has crossed the gap. A load with little friction coasts to the other end when the motor brakes.
/// At an end it takes the velocity of the motor. It starts in the middle of the gap. A motor feels
/// its own backlash: within the gap no force passes, so that only its rotor resists it (the load is 11 %
/// of what moves along x, by the drawings of the table). Both belts of a gantry move one load. The friction of each
/// guide decelerates it in proportion to the mass that moves along it, and a_f is the mean of both axes.
pub(crate) static BACKLASH: Effect = Effect {
    name: "drive.backlash",
    summary: "after a reversal the motor turns before the load follows",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "|q_motor − q_load| ≤ b / 2; within the gap dv_load/dt = −a_f · sign(v_load)",
    parameters: &[
        Parameter {
            name: "width_m",
            symbol: "b",
            unit: "m",
            scale: 0.0002,
            // Smallest width that differs from the deflection of the ends.
            bounds: (NO_BACKLASH, 0.02),
            plausible: (2e-05, 0.002),
            per_session: false,
        },
        Parameter {
            name: "load_deceleration_m_per_s2",
            symbol: "a_f",
            unit: "m/s^2",
            scale: 2.0,
            bounds: (0.0, 1000.0),
            plausible: (0.1, 100.0),
            per_session: false,
        },
    ],
    null: &[0.0, 50.0],
    probes: &[
        &[0.00005, 50.0],
        &[0.0001, 50.0],
        &[0.0002, 50.0],
        &[0.0005, 50.0],
        &[0.0005, 3.0],
        &[0.0015, 50.0],
        &[0.0015, 3.0],
    ],
    memory: 3,
    physics: Physics::Both(&[Physics::Gap(gap), Physics::Transmission(slack)]),
    regressors: &[Regressor::Direction, Regressor::SinceReversal],
    signals: Signal::MOTION,
    excitation: "reversals at several speeds, with encoders and camera",
    experiment: "creep",
    confused_with: &[
        "drive.input_deadband",
        "drive.friction.presliding",
        "estimator.velocity_deadzone",
        "coupling.striker_friction",
        "coupling.magnet_spring",
    ],
    reference: "Nordin and Gutman 2002, Automatica 38(10), 1633-1649, with a load of finite friction",
};

/// Width below which the backlash counts as zero (m): the ends deflect by as much under a few newtons.
const NO_BACKLASH: f64 = 5e-6;

/// Contact of motor and load at the ends of the gap: the largest stiffness (N/m) that a simulation step
/// resolves. On this table they rebound with half of their speed.
const END_CONTACT: Spring =
    Spring { stiffness: 5e5, damping_ratio: 0.28, load_fraction: 0.11, backlash: 0.0 };

fn slack(p: &[f64]) -> Option<Spring> {
    (NO_BACKLASH <= p[0]).then(|| Spring { backlash: p[0], ..END_CONTACT })
}

fn gap(p: &[f64]) -> Gap {
    Gap { width: p[0], deceleration: p[1] }
}

impl Gap {
    /// Position of the load (m) after one step along one axis.
    ///
    /// `memory` holds position and velocity of the load, and 1 once both are initialized.
    pub(crate) fn load(&self, memory: &mut [f64], motion: &Motion) -> f64 {
        let half = 0.5 * self.width;
        if memory[2] == 0.0 {
            (memory[0], memory[1], memory[2]) = (motion.position, motion.velocity, 1.0);
        }
        let (coasted, slowed) = Self::coasted(memory[0], memory[1], self.deceleration, motion.dt);
        let held = coasted.clamp(motion.position - half, motion.position + half);
        memory[1] = if held == coasted { slowed } else { motion.velocity };
        memory[0] = held;
        held
    }

    /// Position (m) and velocity (m/s) of a load after `dt` seconds within a gap, with `deceleration` in m/s^2.
    pub(crate) fn coasted(position: f64, velocity: f64, deceleration: f64, dt: f64) -> (f64, f64) {
        let slowed = (velocity.abs() - deceleration * dt).max(0.0).copysign(velocity);
        (position + 0.5 * dt * (velocity + slowed), slowed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position: f64, velocity: f64) -> Motion {
        Motion { position, velocity, dt: 1e-3, ..Motion::default() }
    }

    #[test]
    fn a_tiny_width_is_no_backlash() {
        assert_eq!(slack(BACKLASH.null), None);
        assert_eq!(slack(&[3e-4, 50.0]).map(|spring| spring.backlash), Some(3e-4));
    }

    #[test]
    fn a_load_with_friction_follows_across_the_gap() {
        let own = gap(&[0.002, 1000.0]);
        let mut memory = [0.0; 3];
        assert_eq!(own.load(&mut memory, &at(0.1, 0.0)), 0.1);
        assert!((own.load(&mut memory, &at(0.11, 0.1)) - 0.109).abs() < 1e-12);
        assert!((own.load(&mut memory, &at(0.1085, -0.1)) - 0.109).abs() < 1e-4);
        assert!((own.load(&mut memory, &at(0.1, -0.1)) - 0.101).abs() < 1e-12);
        assert_eq!(gap(BACKLASH.null).load(&mut [0.3, 0.0, 1.0], &at(0.1, 0.0)), 0.1);
    }

    #[test]
    fn a_load_without_friction_coasts_when_the_motor_brakes() {
        let own = gap(&[0.002, 0.0]);
        let mut memory = [0.099, 0.2, 1.0];
        // The motor has driven the load at 0.2 m/s and stops within one step.
        assert!((own.load(&mut memory, &at(0.1, 0.0)) - 0.0992).abs() < 1e-12);
        for _ in 0..20 {
            own.load(&mut memory, &at(0.1, 0.0));
        }
        assert!((memory[0] - 0.101).abs() < 1e-12);
    }
}
