//! Viscous friction.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.friction.viscous`: resistance in proportion to velocity.
pub(crate) static VISCOUS: Effect = Effect {
    name: "drive.friction.viscous",
    summary: "a resistance grows in proportion to velocity",
    domain: Domain::Drive,
    site: Site::MotorsAndGuides,
    equation: "F_f = −F_v · v",
    parameters: &[Parameter {
        name: "coefficient_n_s_per_m",
        symbol: "F_v",
        unit: "N s/m",
        scale: 2.0,
        bounds: (0.0, 5000.0),
        plausible: (0.1, 40.0),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[2.0]],
    memory: 0,
    physics: Physics::Damping(|p| p[0]),
    regressors: &[Regressor::Velocity],
    signals: Signal::DRIVE,
    excitation: "three or more speeds in both directions",
    experiment: "x_line",
    confused_with: &["drive.gain", "drive.lag1", "drive.friction.quadratic"],
    reference: "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), 1083-1138",
};
