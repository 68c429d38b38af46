//! The belt stretches.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site, Spring};

/// `drive.compliance.belt`: motor and load are two masses with a spring between them, whose compliance is 1/k: the
/// motor swings against the load, which lags by F/k with the force F that passes between them (below the resonance
/// M a/k, which is what camera and encoders together show). The rotor's mass, 0.98 kg of belt by the table's drawings,
/// is in `gantry.inertia` as well; the damping is a share of the critical one of the rotor on its belt.
pub(crate) static COMPLIANCE_BELT: Effect = Effect {
    name: "drive.compliance.belt",
    says: "the belt stretches, so the load lags in accelerations",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[
        Parameter {
            name: "compliance_m_per_n",
            unit: "m/N",
            scale: 1e-5,
            // The least that is not rigid.
            bounds: (RIGID, 0.01),
            plausible: (RIGID, 2e-4),
            per_session: false,
        },
        Parameter {
            name: "rotor_kg",
            unit: "kg",
            scale: 0.1,
            bounds: (0.05, 5.0),
            plausible: (0.05, 2.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            unit: "1",
            scale: 0.05,
            bounds: (0.0, 2.0),
            plausible: (0.0, 0.5),
            per_session: false,
        },
    ],
    null: &[0.0, 0.98, 0.05],
    probes: &[
        &[4e-06, 0.98, 0.05],
        &[1e-05, 0.98, 0.05],
        &[4e-05, 0.98, 0.05],
        &[0.0001, 0.98, 0.05],
        &[1e-05, 0.6, 0.05],
        &[4e-05, 0.6, 0.05],
    ],
    memory: 0,
    physics: Physics::Both(&[
        Physics::Play(|p, _, motion| motion.position - p[0] * motion.force),
        Physics::Transmission(spring),
    ]),
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

/// Below this compliance (m/N) belts are rigid: the load would swing faster than a step can follow.
const RIGID: f64 = 2e-6;

fn spring(p: &[f64]) -> Option<Spring> {
    let soft = |stiffness| Spring { stiffness, damping_ratio: p[2], motor_mass: p[1], play: 0.0 };
    (RIGID <= p[0]).then(|| soft(1.0 / p[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_load_lags_in_an_acceleration() {
        let Physics::Both([Physics::Play(stretch), _]) = COMPLIANCE_BELT.physics else {
            panic!("it lies between")
        };
        let motion = Motion { position: 0.2, force: 5.0, ..Motion::default() };
        assert!((stretch(&[1e-4, 0.98, 0.05], &mut [], &motion) - 0.1995).abs() < 1e-12);
        assert_eq!(stretch(COMPLIANCE_BELT.null, &mut [], &motion), 0.2);
    }

    #[test]
    fn hardly_any_compliance_is_none() {
        assert_eq!(spring(COMPLIANCE_BELT.null), None);
        let soft = spring(&[1e-5, 0.5, 0.1]).unwrap();
        assert!((soft.stiffness - 1e5).abs() < 1e-6 && soft.motor_mass == 0.5);
        assert_eq!(soft.damping_ratio, 0.1);
    }
}
