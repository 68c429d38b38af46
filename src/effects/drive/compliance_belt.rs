//! The belt stretches.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.compliance.belt`: the load lags behind the motor by F/k, with the force F that passes
/// between them, so by M a/k: the stretch of the two-mass model below its resonance. The compliance
/// is 1/k; a load M then swings at sqrt(k/M).
pub(crate) static COMPLIANCE_BELT: Effect = Effect {
    name: "drive.compliance.belt",
    says: "the belt stretches, so the load lags in accelerations",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "compliance_m_per_n",
        unit: "m/N",
        scale: 1e-5,
        bounds: (0.0, 0.01),
        plausible: (1e-6, 2e-4),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1e-05], &[0.0001]],
    memory: 0,
    physics: Physics::Play(|p, _, motion| motion.position - p[0] * motion.force),
    regressors: &[Regressor::Acceleration],
    excitation: "steps or a chirp beyond twice the resonance, with encoder and camera",
    experiment: "chirp",
    confused_with: &[
        "drive.velocity_loop",
        "coupling.magnet_spring",
        "drive.delay",
        "drive.current_loop",
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_load_lags_in_an_acceleration() {
        let Physics::Play(stretch) = COMPLIANCE_BELT.physics else { panic!("it lies between") };
        let motion = Motion { position: 0.2, force: 5.0, ..Motion::default() };
        assert!((stretch(&[1e-4], &mut [], &motion) - 0.1995).abs() < 1e-12);
        assert_eq!(stretch(COMPLIANCE_BELT.null, &mut [], &motion), 0.2);
    }
}
