//! Friction or compliance of one belt beyond those of the other.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.belt_asymmetry`: difference of one belt from the other. The drives see its dry friction,
/// relative to the friction that both motors share. The camera sees its stretch under the
/// transmitted force, load = motor - C m a (Hooke's law, no mass of its own).
pub(crate) static BELT_ASYMMETRY: Effect = Effect {
    name: "gantry.belt_asymmetry",
    summary: "one belt has more friction or compliance than the other, so the two diagonals differ",
    domain: Domain::Gantry,
    site: Site::OneMotor,
    equation: "Δ|F_f| = F_c; q_load = q_motor − C · F",
    parameters: &[
        Parameter {
            name: "friction_n",
            symbol: "F_c",
            unit: "N",
            scale: 0.3,
            bounds: (-500.0, 500.0),
            plausible: (-5.0, 5.0),
            per_session: false,
        },
        Parameter {
            name: "compliance_m_per_n",
            symbol: "C",
            unit: "m/N",
            scale: 2e-5,
            bounds: (0.0, 5e-3),
            plausible: (2e-6, 3e-4),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.3, 0.0], &[-0.3, 0.0], &[0.0, 2e-5]],
    memory: 0,
    physics: Physics::Both(&[
        Physics::Friction(|p, _, _| p[0]),
        Physics::Stretch(|p, motion| motion.position - p[1] * motion.force),
    ]),
    regressors: &[Regressor::Direction, Regressor::Acceleration, Regressor::Load],
    signals: Signal::MOTION,
    excitation: "slow moves and hard stops on both diagonals, with torque, camera and encoders",
    experiment: "diagonal",
    confused_with: &[
        "drive.compliance.belt",
        "gantry.cross_coupling",
        "drive.friction.viscous",
        "drive.friction.coulomb",
        "coupling.magnet_spring",
    ],
    reference: "Sollmann, Jouaneh and Lavender 2010, IEEE/ASME Transactions on Mechatronics 15(2), 280-290",
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn one_belt_rubs_and_its_load_lags_by_the_stretch() {
        let Physics::Both([Physics::Friction(rub), Physics::Stretch(stretch)]) =
            BELT_ASYMMETRY.physics
        else {
            panic!("friction and compliance")
        };
        assert_eq!(rub(&[-0.4, 2e-5], &mut [], &Motion::default()), -0.4);
        // 8 N through 50 N/mm: 0.16 mm.
        let motion = Motion { position: 0.1, force: 8.0, ..Motion::default() };
        assert!((stretch(&[0.0, 2e-5], &motion) - 0.099_84).abs() < 1e-12);
        assert_eq!(stretch(BELT_ASYMMETRY.null, &motion), 0.1);
    }
}
