//! Belt compliance.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Spring};

/// `drive.compliance.belt`: belt compliance.
///
/// Motor and load are two masses on a spring of the compliance C. The rotor oscillates against the
/// load. The load lags by C F with the force F that the belt transmits; below the resonance this is
/// C M a, which camera and encoders together show. `gantry.inertia` includes the rotor, 0.98 kg of
/// belt by the drawings of the table. The damping ratio is that of the rotor on its belt.
pub(crate) static COMPLIANCE_BELT: Effect = Effect {
    name: "drive.compliance.belt",
    summary: "the belt stretches, so the load lags during acceleration",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "F = (q_motor − q_load) / C + 2 ζ · √(m_r / C) · (v_motor − v_load)",
    parameters: &[
        Parameter {
            name: "compliance_m_per_n",
            symbol: "C",
            unit: "m/N",
            scale: 1e-5,
            // Smallest compliance that is not rigid.
            bounds: (RIGID, 0.01),
            plausible: (RIGID, 2e-4),
            per_session: false,
        },
        Parameter {
            name: "rotor_kg",
            symbol: "m_r",
            unit: "kg",
            scale: 0.1,
            bounds: (0.05, 5.0),
            plausible: (0.05, 2.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            symbol: "ζ",
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
        Physics::Backlash(|p, _, motion| motion.position - p[0] * motion.force),
        Physics::Transmission(spring),
    ]),
    regressors: &[Regressor::Acceleration],
    signals: Signal::MOTION,
    excitation: "steps, or a chirp up to twice the resonance, with encoders and camera",
    experiment: "chirp",
    confused_with: &[
        "drive.velocity_loop",
        "coupling.magnet_spring",
        "drive.delay",
        "drive.current_loop",
    ],
    reference: "Spong 1987, ASME Journal of Dynamic Systems, Measurement, and Control 109(4), 310-318; belts: Sollmann, Jouaneh and Lavender 2010, IEEE/ASME Transactions on Mechatronics 15(2), 280-290",
};

/// Compliance (m/N) below which belts are rigid: a simulation step could not resolve the resonance.
const RIGID: f64 = 2e-6;

fn spring(p: &[f64]) -> Option<Spring> {
    let soft =
        |stiffness| Spring { stiffness, damping_ratio: p[2], motor_mass: p[1], backlash: 0.0 };
    (RIGID <= p[0]).then(|| soft(1.0 / p[0]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_load_lags_during_acceleration() {
        let Physics::Both([Physics::Backlash(stretch), _]) = COMPLIANCE_BELT.physics else {
            panic!("the belt transmits")
        };
        let motion = Motion { position: 0.2, force: 5.0, ..Motion::default() };
        assert!((stretch(&[1e-4, 0.98, 0.05], &mut [], &motion) - 0.1995).abs() < 1e-12);
        assert_eq!(stretch(COMPLIANCE_BELT.null, &mut [], &motion), 0.2);
    }

    #[test]
    fn a_tiny_compliance_is_rigid() {
        assert_eq!(spring(COMPLIANCE_BELT.null), None);
        let soft = spring(&[1e-5, 0.5, 0.1]).unwrap();
        assert!((soft.stiffness - 1e5).abs() < 1e-6 && soft.motor_mass == 0.5);
        assert_eq!(soft.damping_ratio, 0.1);
    }
}
