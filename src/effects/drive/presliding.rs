//! Contacts bend before they slide.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// `drive.friction.presliding`: Dahl's state z' = v (1 - z sign v)/z0 of the bent contacts, -1 <= z <= 1;
/// the level of friction changes by -F (1 - z sign v). Sliding friction is as before, a reversal turns it
/// round over the distance z0 instead of at once; the stiffness is F/z0. F may not exceed the dry friction
/// that it rounds. Source: Dahl 1968; Canudas de Wit, Olsson, Astrom and Lischinsky 1995.
pub(crate) static PRESLIDING: Effect = Effect {
    name: "drive.friction.presliding",
    says: "contacts bend before they slide, so friction turns round smoothly over a short way",
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
            scale: 0.00005,
            bounds: (1e-7, 0.01),
            plausible: (1e-6, 2e-4),
            per_session: false,
        },
    ],
    null: &[0.0, 5e-05],
    probes: &[&[0.5, 5e-05], &[0.5, 1e-05], &[0.5, 0.0003]],
    memory: 1,
    physics: Physics::Friction(bend),
    regressors: &[Regressor::SinceReversal, Regressor::Direction],
    excitation: "many small reversals",
    experiment: "creep",
    confused_with: &[
        "drive.friction.stribeck",
        "drive.backlash",
        "drive.compliance.belt",
        "drive.delay",
        "drive.lag1",
        "drive.input_deadband",
        "sensor.encoder_quantisation",
    ],
};

/// Memory: the bend z, by the exact solution for a constant velocity over the step.
fn bend(p: &[f64], memory: &mut [f64], motion: &Motion) -> f64 {
    if motion.velocity == 0.0 {
        return -p[0] * (1.0 - memory[0].abs());
    }
    let direction = motion.velocity.signum();
    let left = (-(motion.velocity * motion.dt / p[1]).abs()).exp();
    memory[0] = direction - (direction - memory[0]) * left;
    -p[0] * (1.0 - direction * memory[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reversal_turns_friction_round_over_the_distance() {
        let p = [2.0, 1e-4];
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
}
