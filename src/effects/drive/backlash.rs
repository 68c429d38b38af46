//! Play between motor and load.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site, Spring};

/// `drive.backlash`: the load moves freely inside a play of width b and is taken along at its ends.
/// Inside, its own friction slows it by a constant deceleration: a load with much friction stays
/// where it is until the motor has crossed the play, one with little coasts to the other end when the
/// motor brakes. At the ends it takes over the motor's velocity. It begins in the middle. A motor feels its own play:
/// inside it no force passes, so that only its rotor (0.98 kg of belt by the table's drawings) resists it.
/// Source: Nordin and Gutman 2002, Automatica 38(10), with a load of finite friction.
pub(crate) static BACKLASH: Effect = Effect {
    name: "drive.backlash",
    says: "after a reversal the motor turns a little before the load follows",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[
        Parameter {
            name: "width_m",
            unit: "m",
            scale: 0.0002,
            // The least that is not the give of the ends.
            bounds: (NO_PLAY, 0.02),
            plausible: (2e-05, 0.002),
            per_session: false,
        },
        Parameter {
            name: "load_deceleration_m_per_s2",
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
    physics: Physics::Both(&[Physics::Play(follow), Physics::Transmission(slack)]),
    regressors: &[Regressor::Direction, Regressor::SinceReversal],
    excitation: "reversals at several speeds, with encoder and camera",
    experiment: "creep",
    confused_with: &[
        "drive.input_deadband",
        "drive.friction.presliding",
        "estimator.velocity_deadzone",
        "coupling.striker_friction",
        "coupling.magnet_spring",
    ],
};

/// Width up to which there is none (m): the ends give way by as much under a few newtons.
const NO_PLAY: f64 = 5e-6;

/// Where the play ends, motor and load meet as hard as a step of the simulation can follow (N/m), and bounce on this
/// table with half of their speed.
const MEETING: Spring = Spring { stiffness: 5e5, damping_ratio: 0.1, motor_mass: 0.98, play: 0.0 };

fn slack(p: &[f64]) -> Option<Spring> {
    (NO_PLAY <= p[0]).then(|| Spring { play: p[0], ..MEETING })
}

/// Memory: place and velocity of the load, and 1 once there is one.
fn follow(p: &[f64], memory: &mut [f64], motion: &Motion) -> f64 {
    let half = 0.5 * p[0];
    if memory[2] == 0.0 {
        (memory[0], memory[1], memory[2]) = (motion.position, motion.velocity, 1.0);
    }
    let slowed = (memory[1].abs() - p[1] * motion.dt).max(0.0).copysign(memory[1]);
    let coasted = memory[0] + 0.5 * motion.dt * (memory[1] + slowed);
    let held = coasted.clamp(motion.position - half, motion.position + half);
    memory[1] = if held == coasted { slowed } else { motion.velocity };
    memory[0] = held;
    held
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position: f64, velocity: f64) -> Motion {
        Motion { position, velocity, dt: 1e-3, ..Motion::default() }
    }

    #[test]
    fn hardly_any_width_is_no_play() {
        assert_eq!(slack(BACKLASH.null), None);
        assert_eq!(slack(&[3e-4, 50.0]).map(|spring| spring.play), Some(3e-4));
    }

    #[test]
    fn a_load_with_friction_follows_behind_the_play() {
        let p = [0.002, 1000.0];
        let mut memory = [0.0; 3];
        assert_eq!(follow(&p, &mut memory, &at(0.1, 0.0)), 0.1);
        assert!((follow(&p, &mut memory, &at(0.11, 0.1)) - 0.109).abs() < 1e-12);
        assert!((follow(&p, &mut memory, &at(0.1085, -0.1)) - 0.109).abs() < 1e-4);
        assert!((follow(&p, &mut memory, &at(0.1, -0.1)) - 0.101).abs() < 1e-12);
        assert_eq!(follow(BACKLASH.null, &mut [0.3, 0.0, 1.0], &at(0.1, 0.0)), 0.1);
    }

    #[test]
    fn a_load_without_friction_coasts_when_the_motor_brakes() {
        let p = [0.002, 0.0];
        let mut memory = [0.099, 0.2, 1.0];
        // Taken along at 0.2 m/s behind the motor; the motor stops at once.
        assert!((follow(&p, &mut memory, &at(0.1, 0.0)) - 0.0992).abs() < 1e-12);
        for _ in 0..20 {
            follow(&p, &mut memory, &at(0.1, 0.0));
        }
        assert!((memory[0] - 0.101).abs() < 1e-12);
    }
}
