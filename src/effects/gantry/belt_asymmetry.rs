//! One belt is softer than the other.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `gantry.belt_asymmetry`: load = motor - c m a on one belt alone, its stretch under the force that
/// it passes on (Hooke, no mass of its own).
///
/// Different friction of the belts needs no effect of its own: it is `drive.friction.*` on motor `a`
/// or `b` alone.
pub(crate) static BELT_ASYMMETRY: Effect = Effect {
    name: "gantry.belt_asymmetry",
    says: "one belt stretches more than the other, so the two diagonals differ",
    domain: Domain::Gantry,
    site: Site::OneMotor,
    parameters: &[Parameter {
        name: "compliance_m_per_n",
        unit: "m/N",
        scale: 2e-5,
        bounds: (0.0, 5e-3),
        plausible: (2e-6, 3e-4),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[2e-5]],
    memory: 0,
    physics: Physics::Play(|p, _, motion| motion.position - p[0] * motion.force),
    regressors: &[Regressor::Acceleration, Regressor::Load],
    excitation: "hard starts and stops on both diagonals, with camera and encoders",
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
    fn the_load_lags_by_the_stretch() {
        let Physics::Play(stretch) = BELT_ASYMMETRY.physics else { panic!("a play") };
        // 8 N through 50 N/mm: 0.16 mm.
        let motion = Motion { position: 0.1, force: 8.0, ..Motion::default() };
        assert!((stretch(&[2e-5], &mut [], &motion) - 0.099_84).abs() < 1e-12);
        assert_eq!(stretch(BELT_ASYMMETRY.null, &mut [], &motion), 0.1);
    }
}
