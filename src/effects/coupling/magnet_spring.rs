//! The magnet holds the striker like a spring.

use crate::effects::{Carriage, Domain, Effect, Parameter, Physics, Regressor, Site};

/// Share of critical damping of the striker on its spring: grease and magnet together.
const DAMPING_BOUNDS: (f64, f64) = (0.0, 3.0);

/// `coupling.magnet_spring`: m a = k (magnet - striker) + 2 z sqrt(k m) (v_magnet - v_striker).
pub(crate) static MAGNET_SPRING: Effect = Effect {
    name: "coupling.magnet_spring",
    says: "the magnet holds the striker like a soft spring: it lags in accelerations and swings after them",
    domain: Domain::Coupling,
    site: Site::Whole,
    parameters: &[
        Parameter {
            name: "stiffness_n_per_m",
            unit: "N/m",
            scale: 20.0,
            bounds: (1.0, 5000.0),
            plausible: (20.0, 500.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            unit: "1",
            scale: 0.1,
            bounds: DAMPING_BOUNDS,
            plausible: (0.01, 1.5),
            per_session: false,
        },
    ],
    null: &[5000.0, 1.0],
    probes: &[&[100.0, 0.3], &[30.0, 0.3], &[30.0, 0.05], &[300.0, 0.3]],
    memory: 4,
    physics: Physics::Coupling(swing),
    regressors: &[Regressor::Acceleration],
    excitation: "hard starts and stops, with camera and encoders",
    experiment: "steps",
    confused_with: &["drive.backlash", "drive.compliance.belt", "coupling.striker_friction"],
};

/// Memory: displacement of the striker from the magnet and its velocity, x then y. The step is
/// divided so that the swing is resolved.
fn swing(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
    let w2 = p[0] / carriage.striker_mass;
    let damping = 2.0 * p[1] * w2.sqrt();
    let parts = (carriage.dt * w2.sqrt() / 0.2).ceil().max(1.0);
    let dt = carriage.dt / parts;
    for axis in 0..2 {
        let [displacement, velocity] = [2 * axis, 2 * axis + 1];
        for _ in 0..parts as usize {
            let force = w2 * memory[displacement] + carriage.acceleration[axis];
            memory[velocity] = (memory[velocity] - dt * force) / (1.0 + dt * damping);
            memory[displacement] += dt * memory[velocity];
        }
    }
    [carriage.position[0] + memory[0], carriage.position[1] + memory[2]]
}
