//! Presliding friction: a smooth reversal of the friction force.

use crate::effects::{Bristles, Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.presliding`: presliding friction: a smooth reversal of the friction force.
///
/// Of the dry friction, F_b acts through contacts that deflect before they slide ([`Bristles`]).
/// After a reversal the friction changes sign over the distance d. Below the velocity v_b it grows
/// with the velocity, as in lubricated contacts. Far from a reversal nothing changes. F_b counts up
/// to the dry friction of the twin. Where the dry friction of a single axis varies, with the load for example, the
/// contacts carry the same fraction of it, F_b over its Coulomb friction, with the same stiffness. The stiffness of the
/// contacts is F_b/d, 1e4 to 1e6 N/m. Their damping is about the square root of stiffness times mass.
pub(crate) static PRESLIDING: Effect = Effect {
    name: "drive.friction.presliding",
    summary: "the friction force changes sign smoothly at a reversal, because contacts deflect before they slide",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "F_f = −F_b · z − c · d · dz/dt, d · dz/dt = v − h(v) · z, h(v) = |v| / tanh(|v| / v_b)",
    parameters: &[
        Parameter {
            name: "force_n",
            symbol: "F_b",
            unit: "N",
            scale: 1.0,
            bounds: (0.0, 500.0),
            plausible: (0.05, 10.0),
            per_session: false,
        },
        Parameter {
            name: "distance_m",
            symbol: "d",
            unit: "m",
            scale: 0.00002,
            bounds: (1e-7, 0.01),
            plausible: (1e-6, 2e-4),
            per_session: false,
        },
        Parameter {
            name: "velocity_m_per_s",
            symbol: "v_b",
            unit: "m/s",
            scale: 0.002,
            bounds: (1e-5, 0.2),
            plausible: (1e-5, 0.02),
            per_session: false,
        },
        Parameter {
            name: "damping_n_s_per_m",
            symbol: "c",
            unit: "N s/m",
            scale: 50.0,
            bounds: (0.0, 1e5),
            plausible: (0.0, 3000.0),
            per_session: false,
        },
    ],
    null: &[0.0, 5e-05, 0.001, 0.0],
    probes: &[
        &[0.5, 5e-05, 0.001, 0.0],
        &[0.5, 0.0003, 0.001, 0.0],
        &[2.0, 1e-05, 0.0001, 1000.0],
        &[2.0, 5e-05, 0.0001, 300.0],
        &[2.0, 0.0003, 0.0001, 100.0],
        &[2.0, 0.002, 0.0001, 30.0],
        &[0.5, 1e-05, 0.01, 0.0],
        &[0.5, 5e-05, 0.02, 0.0],
    ],
    memory: 1,
    physics: Physics::Bristles(|p| Bristles {
        force: p[0],
        distance: p[1],
        velocity: p[2],
        damping: p[3],
    }),
    regressors: &[Regressor::SinceReversal, Regressor::Direction, Regressor::Speed],
    signals: Signal::DRIVE,
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
    reference: "Dahl 1968, A Solid Friction Model; Canudas de Wit, Olsson, Åström and Lischinsky 1995, IEEE TAC 40(3), 419-425; Makkar, Dixon, Sawyer and Hu 2005, AIM",
};

#[cfg(test)]
mod tests {
    use super::*;

    fn bristles(p: [f64; 4]) -> Bristles {
        let Physics::Bristles(of) = PRESLIDING.physics else { panic!("contacts bend") };
        of(&p)
    }

    #[test]
    fn a_reversal_turns_friction_round_over_the_distance() {
        let own = bristles([2.0, 1e-4, 1e-5, 0.0]);
        let turned = own.bent(1.0, -0.1, 1e-3);
        assert!((turned - (-1.0 + 2.0 * (-1.0_f64).exp())).abs() < 1e-12);
        assert!((own.bent(turned, -0.1, 0.05) + 1.0).abs() < 1e-12);
    }

    #[test]
    fn slow_motion_rubs_less_and_rest_creeps() {
        let own = bristles([2.0, 1e-6, 0.01, 0.0]);
        assert!((own.bent(1.0, 0.01, 0.1) - 1.0_f64.tanh()).abs() < 1e-9);
        assert!((own.bent(1.0, 0.2, 0.1) - 1.0).abs() < 1e-9);
        assert!((own.bent(1.0, 0.0, 1e-4) - (-1.0_f64).exp()).abs() < 1e-9);
    }
}
