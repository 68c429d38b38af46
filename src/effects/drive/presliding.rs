//! Friction turns round smoothly instead of at once.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// `drive.friction.presliding`: the level of friction changes by -F (1 - z sign v tanh(|v|/v0)),
/// with Dahl's state z' = v (1 - z sign v)/z0 of contacts that bend before they slide, z between -1
/// and 1. Far from a reversal nothing changes; beside one the sign of the velocity is rounded over
/// the way z0 behind it, and over the velocity v0 on both sides, as lubricated contacts do. F may
/// not exceed the dry friction that it rounds; the stiffness of the contacts is F/z0. Sources: Dahl
/// 1968; Canudas de Wit, Olsson, Astrom and Lischinsky 1995; rounding by velocity: Makkar, Dixon,
/// Sawyer and Hu 2005.
pub(crate) static PRESLIDING: Effect = Effect {
    name: "drive.friction.presliding",
    says: "friction turns round smoothly at a reversal: contacts bend before they slide",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[
        Parameter {
            name: "force_n",
            unit: "N",
            scale: 1.0,
            bounds: (0.0, 500.0),
            plausible: (0.05, 10.0),
            per_session: false,
        },
        Parameter {
            name: "distance_m",
            unit: "m",
            scale: 0.00002,
            bounds: (1e-7, 0.01),
            plausible: (1e-6, 2e-4),
            per_session: false,
        },
        Parameter {
            name: "velocity_m_per_s",
            unit: "m/s",
            scale: 0.002,
            bounds: (1e-5, 0.2),
            plausible: (1e-5, 0.02),
            per_session: false,
        },
    ],
    null: &[0.0, 5e-05, 0.001],
    probes: &[
        &[0.5, 5e-05, 0.001],
        &[0.5, 0.0003, 0.001],
        &[0.5, 1e-05, 0.01],
        &[0.5, 5e-05, 0.02],
    ],
    memory: 1,
    physics: Physics::Friction(bend),
    regressors: &[Regressor::SinceReversal, Regressor::Direction, Regressor::Speed],
    excitation: "many small reversals",
    experiment: "creep",
    confused_with: &[
        "drive.friction.stribeck",
        "drive.backlash",
        "drive.compliance.belt",
        "drive.delay",
        "drive.lag1",
        "drive.current_loop",
        "drive.input_deadband",
    ],
};

/// Memory: the bend z, by the exact solution for a constant velocity over the step. What has
/// stopped is held by the bent contacts.
fn bend(p: &[f64], memory: &mut [f64], motion: &Motion) -> f64 {
    if motion.velocity == 0.0 {
        return -p[0] * (1.0 - memory[0].abs());
    }
    let direction = motion.velocity.signum();
    let left = (-(motion.velocity * motion.dt / p[1]).abs()).exp();
    memory[0] = direction - (direction - memory[0]) * left;
    -p[0] * (1.0 - direction * memory[0] * (motion.velocity.abs() / p[2]).tanh())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reversal_turns_friction_round_over_the_distance() {
        let p = [2.0, 1e-4, 1e-5];
        let at = |velocity| Motion { velocity, dt: 1e-3, ..Motion::default() };
        let mut memory = [1.0];
        assert_eq!(bend(&p, &mut memory, &at(0.0)), 0.0);
        assert_eq!(bend(&p, &mut memory, &at(0.1)), 0.0);
        let turned = bend(&p, &mut memory, &at(-0.1));
        assert!((memory[0] - (-1.0 + 2.0 * (-1.0_f64).exp())).abs() < 1e-12);
        assert!((turned + 2.0 * 2.0 * (-1.0_f64).exp()).abs() < 1e-12);
        for _ in 0..50 {
            bend(&p, &mut memory, &at(-0.1));
        }
        assert!(bend(&p, &mut memory, &at(-0.1)).abs() < 1e-12);
        assert_eq!(bend(PRESLIDING.null, &mut [0.3], &at(0.1)), 0.0);
    }

    #[test]
    fn slow_motion_rubs_less() {
        let p = [2.0, 1e-6, 0.01];
        let at = |velocity| Motion { velocity, dt: 1e-3, ..Motion::default() };
        let slow = bend(&p, &mut [1.0], &at(0.01));
        assert!((slow + 2.0 * (1.0 - 1.0_f64.tanh())).abs() < 1e-9);
        assert!(bend(&p, &mut [1.0], &at(0.2)).abs() < 1e-9);
    }
}
