//! First-order lag of the command.

use crate::effects::{
    Domain, Effect, Parameter, Physics, Regressor, Signal, Site, first_order::follow,
};

/// `drive.lag1`: first-order low-pass of the command; a ramp is late by its time constant.
pub(crate) static LAG1: Effect = Effect {
    name: "drive.lag1",
    summary: "a first-order lag smooths the command",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "τ · dr/dt + r = u",
    parameters: &[Parameter {
        name: "time_constant_s",
        symbol: "τ",
        unit: "s",
        scale: 0.002,
        bounds: (0.0, 0.3),
        plausible: (0.0005, 0.05),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.002], &[0.01], &[0.03]],
    memory: 2,
    physics: Physics::Command(|p, memory, command, dt| follow(p[0], memory, command, dt)),
    regressors: &[Regressor::Acceleration, Regressor::Jerk],
    signals: Signal::DRIVE,
    excitation: "a chirp over a decade of frequency: a lag attenuates its amplitude, a delay does not",
    experiment: "chirp",
    confused_with: &[
        "drive.delay",
        "drive.velocity_loop",
        "drive.current_loop",
        "drive.saturation.slew",
        "sensor.camera_latency",
        "estimator.lag",
        "sensor.clock_skew",
    ],
    reference: "Åström and Murray 2021, Feedback Systems (first-order systems)",
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_arrives_with_the_time_constant() {
        let Physics::Command(lag) = LAG1.physics else { panic!("the lag acts on the command") };
        let mut memory = [0.0; 2];
        let mut reached = 0.0;
        for _ in 0..1000 {
            reached = lag(&[0.01], &mut memory, 1.0, 1e-5);
        }
        assert!((reached - (1.0 - (-1.0_f64).exp())).abs() < 1e-3);
        assert_eq!(lag(LAG1.null, &mut [0.0; 2], 1.0, 1e-3), 1.0);
    }
}
