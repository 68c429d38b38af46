//! One belt is softer than the other.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `gantry.belt_asymmetry`: what one belt has beyond the other. The drives see its dry friction, more or less
/// than what both motors have; the camera sees its stretch under the force that it passes on, load = motor -
/// c m a (Hooke, no mass of its own).
pub(crate) static BELT_ASYMMETRY: Effect = Effect {
    name: "gantry.belt_asymmetry",
    says: "one belt rubs or stretches more than the other, so the two diagonals differ",
    domain: Domain::Gantry,
    site: Site::OneMotor,
    parameters: &[
        Parameter {
            name: "friction_n",
            unit: "N",
            scale: 0.3,
            bounds: (-500.0, 500.0),
            plausible: (-5.0, 5.0),
            per_session: false,
        },
        Parameter {
            name: "compliance_m_per_n",
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
        Physics::Play(|p, _, motion| motion.position - p[1] * motion.force),
    ]),
    regressors: &[Regressor::Direction, Regressor::Acceleration, Regressor::Load],
    excitation: "slow moves and hard stops on both diagonals, with torque, camera and encoders",
    experiment: "diagonal",
    confused_with: &[
        "drive.compliance.belt",
        "gantry.cross_coupling",
        "drive.friction.viscous",
        "drive.friction.coulomb",
        "coupling.magnet_spring",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn one_belt_rubs_and_its_load_lags_by_the_stretch() {
        let Physics::Both([Physics::Friction(rub), Physics::Play(stretch)]) =
            BELT_ASYMMETRY.physics
        else {
            panic!("friction and play")
        };
        assert_eq!(rub(&[-0.4, 2e-5], &mut [], &Motion::default()), -0.4);
        // 8 N through 50 N/mm: 0.16 mm.
        let motion = Motion { position: 0.1, force: 8.0, ..Motion::default() };
        assert!((stretch(&[0.0, 2e-5], &mut [], &motion) - 0.099_84).abs() < 1e-12);
        assert_eq!(stretch(BELT_ASYMMETRY.null, &mut [], &motion), 0.1);
    }
}
