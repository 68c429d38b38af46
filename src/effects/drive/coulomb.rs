//! Dry friction of constant size.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Site};

/// `drive.friction.coulomb`: -Fc sign v.
pub(crate) static COULOMB: Effect = Effect {
    name: "drive.friction.coulomb",
    says: "a friction force of constant size opposes the motion and holds at rest",
    domain: Domain::Drive,
    site: Site::MotorsAndRails,
    parameters: &[Parameter {
        name: "force_n",
        unit: "N",
        scale: 1.0,
        bounds: (0.0, 500.0),
        plausible: (0.05, 10.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1.0]],
    memory: 0,
    physics: Physics::Friction(|p, _, _| p[0]),
    regressors: &[Regressor::Direction],
    excitation: "slow reversals, and both directions at three or more speeds",
    experiment: "creep",
    confused_with: &["drive.input_deadband", "estimator.velocity_deadzone", "drive.offset"],
};
