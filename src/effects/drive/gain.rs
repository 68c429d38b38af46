//! The motor runs faster or slower than commanded by a constant ratio.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.gain`: u -> (1 + g) u.
pub(crate) static GAIN: Effect = Effect {
    name: "drive.gain",
    says: "the motors turn a constant share faster or slower than they are told",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "gain",
        unit: "1",
        scale: 0.05,
        bounds: (0.3, 3.0),
        plausible: (0.8, 1.2),
        per_session: false,
    }],
    null: &[1.0],
    probes: &[&[1.02]],
    memory: 0,
    physics: Physics::Command(|p, _, command, _| p[0] * command),
    regressors: &[Regressor::Command, Regressor::Velocity],
    excitation: "moves at several speeds in both directions",
    experiment: "x_line",
    confused_with: &["sensor.camera_scale_rotation", "drive.friction.viscous"],
};
