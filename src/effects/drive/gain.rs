//! Gain of the drive: commanded to realized velocity.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.gain`: ratio of the realized to the commanded velocity.
pub(crate) static GAIN: Effect = Effect {
    name: "drive.gain",
    summary: "the motors run faster or slower than commanded by a constant ratio",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "u′ = K · u",
    parameters: &[Parameter {
        name: "gain",
        symbol: "K",
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
    signals: Signal::DRIVE,
    excitation: "moves at several speeds in both directions",
    experiment: "x_line",
    confused_with: &["sensor.camera_scale_rotation", "drive.friction.viscous"],
    reference: "Ljung 1999, System Identification: Theory for the User (static gain)",
};
