//! Velocity controller of a single axis with a velocity setpoint.

use crate::effects::{
    Domain, Effect, Parameter, Physics, Regressor, Signal, Site, VelocityController,
};

/// `drive.velocity_controller`: proportional and integral action on the velocity error, where the force that they make
/// was not recorded.
///
/// Forces F, friction included, are in the unit of the setpoint: divided by the proportional gain. T is the mass
/// divided by that gain.
pub(crate) static VELOCITY_CONTROLLER: Effect = Effect {
    name: "drive.velocity_controller",
    summary: "the velocity follows its setpoint with the error that makes the force",
    domain: Domain::Drive,
    site: Site::SingleAxis,
    equation: "T · a = e + ρ · ∫ e dt + F, e = r − v",
    parameters: &[
        Parameter {
            name: "time_constant_s",
            symbol: "T",
            unit: "s",
            scale: 0.002,
            bounds: (0.0, 1.0),
            plausible: (0.0, 0.1),
            per_session: false,
        },
        Parameter {
            name: "integral_rate_per_s",
            symbol: "ρ",
            unit: "1/s",
            scale: 10.0,
            bounds: (0.0, 500.0),
            plausible: (0.0, 200.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0],
    probes: &[&[0.01, 0.0], &[0.01, 20.0]],
    memory: 0,
    physics: Physics::VelocityController(|p| VelocityController {
        time_constant_s: p[0],
        integral_rate_per_s: p[1],
    }),
    regressors: &[Regressor::Acceleration],
    signals: &[Signal::AxisInput],
    excitation: "velocity steps and chirps in both directions",
    experiment: "chirp",
    confused_with: &["drive.lag1", "drive.delay"],
    reference: "Leonhard 2001, Control of Electrical Drives (cascade control)",
};
