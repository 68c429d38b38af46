//! Coulomb friction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.coulomb`: dry friction of constant level.
pub(crate) static COULOMB: Effect = Effect {
    name: "drive.friction.coulomb",
    summary: "a friction force of constant magnitude opposes the motion and holds at rest",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "F_f = −F_c · sign(v)",
    parameters: &[Parameter {
        name: "force_n",
        symbol: "F_c",
        unit: "N",
        scale: 1.0,
        bounds: (0.0, 500.0),
        plausible: (0.05, 10.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[1.0]],
    memory: 0,
    physics: Physics::Coulomb(|p| p[0]),
    regressors: &[Regressor::Direction],
    signals: Signal::DRIVE,
    excitation: "slow reversals, and both directions at three or more speeds",
    experiment: "creep",
    confused_with: &["drive.input_deadband", "estimator.velocity_deadzone", "drive.offset"],
    reference: "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), 1083-1138",
};
