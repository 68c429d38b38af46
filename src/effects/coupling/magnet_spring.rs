//! Elastic coupling of striker and magnet.

use super::{striker::STATES, striker_friction::FRICTION};
use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Striker};

/// Stiffness of the magnetic coupling.
pub(super) const STIFFNESS: Parameter = Parameter {
    name: "stiffness_n_per_m",
    symbol: "k",
    unit: "N/m",
    scale: 20.0,
    bounds: (1.0, 5000.0),
    plausible: (20.0, 500.0),
    per_session: false,
};

/// Damping ratio of the striker on the coupling: grease and magnet together.
pub(super) const DAMPING: Parameter = Parameter {
    name: "damping_ratio",
    symbol: "ζ",
    unit: "1",
    scale: 0.1,
    bounds: (0.0, 30.0),
    plausible: (0.01, 1.5),
    per_session: false,
};

/// Displacement of the largest coupling force.
pub(super) const SOFTENING: Parameter = Parameter {
    name: "softening_m",
    symbol: "d0",
    unit: "m",
    scale: 0.002,
    bounds: (0.0005, 1.0),
    plausible: (0.002, 0.008),
    per_session: false,
};

/// `coupling.magnet_spring`: elastic coupling of striker and magnet.
///
/// D is the displacement of the magnet from the striker. The force between two magnets grows with
/// the displacement, is largest at d0 and decreases beyond it. A striker on a soft spring shows the friction that a stiff
/// one hides; where the friction F_c explains more than the spring, the effect is `coupling.striker_friction`. The carriage
/// feels the coupling force.
pub(crate) static MAGNET_SPRING: Effect = Effect {
    name: "coupling.magnet_spring",
    summary: "the magnet holds the striker like a soft spring: the striker lags during acceleration and oscillates afterwards",
    domain: Domain::Coupling,
    site: Site::Whole,
    equation: "m_s · dv_s/dt = k · d / (1 + (d / d0)²) + 2 ζ · √(k · m_s) · dd/dt − F_c · v_s / |v_s|, d = q_magnet − q_striker",
    parameters: &[STIFFNESS, DAMPING, SOFTENING, FRICTION],
    null: &[5000.0, 1.0, 1.0, 0.0],
    probes: &[
        &[100.0, 0.3, 0.02, 0.0],
        &[30.0, 0.3, 0.02, 0.0],
        &[30.0, 0.05, 0.02, 0.0],
        &[30.0, 3.0, 0.02, 0.0],
        &[300.0, 0.3, 0.02, 0.0],
    ],
    memory: STATES,
    physics: Physics::Both(&[Physics::Striker(striker), Physics::Reaction(striker)]),
    regressors: &[Regressor::Acceleration],
    signals: Signal::MOTION,
    excitation: "hard starts and stops, with camera and encoders",
    experiment: "step_ladder",
    confused_with: &[
        "coupling.striker_wobble",
        "coupling.striker_friction",
        "drive.backlash",
        "drive.compliance.belt",
    ],
    reference: "Furlani 2001, Permanent Magnet and Electromechanical Devices",
};

fn striker(p: &[f64]) -> Striker {
    Striker { friction: p[3], stiffness: p[0], damping_ratio: p[1], softening: p[2] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Carriage, StrikerLanes};

    const MASS: f64 = 0.012;

    fn after(p: &[f64], acceleration: [f64; 2], seconds: f64) -> [f64; 2] {
        let mut memory = [0.0; STATES];
        let own = StrikerLanes::alone(striker(p), MASS);
        let dt = 1e-3;
        let steps = (seconds / dt).round() as usize;
        (1..=steps).fold([0.0; 2], |_, step| {
            let velocity = acceleration.map(|own| own * dt * step as f64);
            let carriage =
                Carriage { dt, velocity, acceleration, striker_mass: MASS, ..Carriage::default() };
            own.striker(&mut memory, &carriage)
        })
    }

    #[test]
    fn the_striker_stays_behind_by_mass_times_acceleration_over_stiffness() {
        let [x, y] = after(&[30.0, 0.3, 1e3, 0.0], [5.0, -10.0], 3.0);
        assert!((x + 0.002).abs() < 1e-9 && (y - 0.004).abs() < 1e-9);
        // Undamped it reaches twice that displacement after half a period.
        let half = std::f64::consts::PI * (MASS / 30.0).sqrt();
        let [x, _] = after(&[30.0, 0.0, 1e3, 0.0], [5.0, 0.0], half);
        assert!((x + 0.004).abs() < 1e-5, "{x}");
    }

    #[test]
    fn a_softening_spring_rests_where_its_force_holds_the_striker() {
        let [x, _] = after(&[30.0, 0.5, 0.005, 0.0], [4.0, 0.0], 3.0);
        let force = 30.0 * x / (1.0 + (x / 0.005).powi(2));
        assert!((force + MASS * 4.0).abs() < 1e-9, "{x}");
    }
}
