//! Belt compliance.

use crate::effects::{
    Domain, Effect, ElasticLoad, Parameter, Physics, Regressor, Resonance, Signal, Site, Spring,
    axis_scales::PERIOD_UNIT,
};
use std::f64::consts::TAU;

/// `drive.compliance.belt`: belt compliance.
///
/// Motor and load are two masses on a spring of the compliance C. The rotor oscillates against the
/// load. The load lags by C F with the force F that the belt transmits; below the resonance this is
/// C M a, which camera and encoders together show. `gantry.inertia` M includes the rotors; the load is the fraction r of it
/// along the lighter axis (0.11 by the drawings of the table). The damping ratio is that of the load against motors that stand.
pub(crate) static COMPLIANCE_BELT: Effect = Effect {
    name: "drive.compliance.belt",
    summary: "the belt stretches, so the load lags during acceleration",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "F = (q_motor − q_load) / C + 2 ζ · √(r M / (2 C)) · (v_motor − v_load), m_rotor = (1 − r) M / 2",
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
        // Large motors on small pulleys are fifty times as heavy as the carriage.
        Parameter { bounds: (0.005, 0.98), plausible: (0.01, 0.95), ..LOAD_FRACTION },
        Parameter { bounds: (0.0, 2.0), plausible: (0.0, 1.0), ..DAMPING_RATIO },
    ],
    null: &[0.0, 0.11, 0.1],
    probes: &[
        &[4e-06, 0.11, 0.1],
        &[1e-05, 0.11, 0.1],
        &[4e-05, 0.11, 0.1],
        &[0.0001, 0.11, 0.1],
        &[1e-05, 0.5, 0.1],
        &[4e-05, 0.5, 0.1],
        &[1e-05, 0.025, 0.1],
        &[4e-05, 0.025, 0.1],
    ],
    memory: 0,
    physics: Physics::Both(&[
        Physics::Stretch(|p, motion| motion.position - p[0] * motion.force),
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

/// `drive.compliance.belt` on a single axis: a load on a belt or coupling, behind a motor whose position is measured.
///
/// `gantry.inertia` is the whole moving mass M. Far below the frequency f, the load follows the motor. Far above it, only the
/// fraction 1 - r of the mass resists the motor. The frequency is that of the load while the motor stands (antiresonance).
pub(in crate::effects) static COMPLIANCE_ENCODER_ON_MOTOR: Effect = Effect {
    summary: "the load oscillates against the motor, whose position is measured",
    equation: "F = (1 − r) M · a + r M · a_load, a_load = (2π f)² (q − q_load) + 2 ζ · 2π f (v − v_load)",
    parameters: &[LOAD_FRACTION, FREQUENCY, DAMPING_RATIO],
    null: &[0.0, 10.0, 0.05],
    probes: &[
        &[0.5, 2.0, 0.05],
        &[0.5, 3.0, 0.05],
        &[0.5, 4.5, 0.05],
        &[0.5, 7.0, 0.05],
        &[0.5, 10.0, 0.05],
        &[0.5, 15.0, 0.05],
    ],
    physics: Physics::ElasticLoad(|p| ElasticLoad {
        fraction: p[0],
        angular_frequency: TAU * p[1],
        damping_ratio: p[2],
    }),
    signals: Signal::DRIVE,
    excitation: "steps, or a chirp up to twice the resonance",
    confused_with: &["drive.delay", "drive.lag1", "drive.current_loop", "gantry.stiffness"],
    ..COMPLIANCE_BELT
};

/// `drive.compliance.belt` on a single axis: a load on a belt or coupling, whose position is measured.
///
/// Motor and load resonate with the period T. Far below the resonance, the motor drives one mass. Forces are those on the
/// load side.
pub(in crate::effects) static COMPLIANCE_ENCODER_ON_LOAD: Effect = Effect {
    summary: "the motor oscillates against the load, whose position is measured",
    equation: "F = F_load + 2 ζ · T / (2π) · dF_load/dt + (T / (2π))² · d²F_load/dt², F_load = M · a + friction",
    parameters: &[
        Parameter {
            name: "resonance_period_s",
            symbol: "T",
            unit: PERIOD_UNIT,
            scale: 0.1,
            bounds: (0.045, 1.2),
            plausible: (0.05, 1.0),
            per_session: false,
        },
        DAMPING_RATIO,
    ],
    null: &[0.0, 0.05],
    probes: &[&[0.055, 0.05], &[0.08, 0.05], &[0.12, 0.05], &[0.2, 0.05], &[0.3, 0.05]],
    physics: Physics::Resonance(|p| Resonance { angular_period: p[0] / TAU, damping_ratio: p[1] }),
    ..COMPLIANCE_ENCODER_ON_MOTOR
};

/// Mass of the load over the whole moving mass.
const LOAD_FRACTION: Parameter = Parameter {
    name: "load_fraction",
    symbol: "r",
    unit: "1",
    scale: 0.1,
    bounds: (0.0, 0.98),
    plausible: (0.05, 0.95),
    per_session: false,
};

/// Frequency at which the load of a single axis oscillates while the motor stands. Only motion up to twice a resonance shows
/// it, so it is at most half of the highest compared frequency, 40 Hz on the table. A fit that ends on a bound is rejected.
const FREQUENCY: Parameter = Parameter {
    name: "frequency_hz",
    symbol: "f",
    unit: "Hz",
    scale: 10.0,
    bounds: (0.8, 22.0),
    plausible: (1.0, 20.0),
    per_session: false,
};

/// Damping ratio of motor and load: every machine has some, and above 0.7 there is no resonance.
const DAMPING_RATIO: Parameter = Parameter {
    name: "damping_ratio",
    symbol: "ζ",
    unit: "1",
    scale: 0.05,
    bounds: (0.002, 0.7),
    plausible: (0.005, 0.5),
    per_session: false,
};

/// Compliance (m/N) below which belts are rigid: a simulation step could not resolve the resonance.
const RIGID: f64 = 2e-6;

fn spring(p: &[f64]) -> Option<Spring> {
    let [compliance, load_fraction, damping_ratio] = [p[0], p[1], p[2]];
    let soft = Spring { stiffness: 1.0 / compliance, damping_ratio, load_fraction, backlash: 0.0 };
    (RIGID <= compliance).then_some(soft)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::Motion;

    #[test]
    fn the_load_lags_during_acceleration() {
        let Physics::Both([Physics::Stretch(stretch), _]) = COMPLIANCE_BELT.physics else {
            panic!("the belt transmits")
        };
        let motion = Motion { position: 0.2, force: 5.0, ..Motion::default() };
        assert!((stretch(&[1e-4, 0.11, 0.1], &motion) - 0.1995).abs() < 1e-12);
        assert_eq!(stretch(COMPLIANCE_BELT.null, &motion), 0.2);
    }

    #[test]
    fn a_tiny_compliance_is_rigid() {
        assert_eq!(spring(COMPLIANCE_BELT.null), None);
        let soft = spring(&[1e-5, 0.5, 0.1]).unwrap();
        assert!((soft.stiffness - 1e5).abs() < 1e-6 && soft.load_fraction == 0.5);
        assert_eq!(soft.damping_ratio, 0.1);
    }
}
