//! Moving mass along one axis, rotors included.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `gantry.inertia`: mass that the force of both motors accelerates.
pub(crate) static INERTIA: Effect = Effect {
    name: "gantry.inertia",
    summary: "the moving mass differs",
    domain: Domain::Gantry,
    site: Site::Guides,
    equation: "M · a = F",
    parameters: &[Parameter {
        name: "mass_kg",
        symbol: "M",
        unit: "kg",
        scale: 0.5,
        bounds: (1e-3, 1e4),
        plausible: (0.5, 10.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.2]],
    memory: 0,
    physics: Physics::Mass(|p| p[0]),
    regressors: &[Regressor::Acceleration],
    signals: Signal::DRIVE,
    excitation: "accelerations well above the noise, with the torque recorded",
    experiment: "step_ladder",
    confused_with: &["gantry.mass_position", "drive.velocity_loop"],
    reference: "Khalil and Dombre 2002, Modeling, Identification and Control of Robots",
};
