//! Limit of the velocity setpoint.

use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site};

/// `drive.saturation.speed`: the largest setpoint that the drive accepts, as `vel_limit` of an ODrive. On a single axis
/// it limits the input in its own unit, as the voltage of an amplifier.
pub(crate) static SPEED: Effect = Effect {
    name: "drive.saturation.speed",
    summary: "the drive limits its setpoint: the velocity of a table, the input of a single axis",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "|u′| ≤ v_max",
    parameters: &[Parameter {
        name: "limit_m_per_s",
        symbol: "v_max",
        unit: "m/s",
        scale: 0.1,
        bounds: (0.01, 100.0),
        plausible: (0.1, 10.0),
        per_session: false,
    }],
    null: &[100.0],
    probes: &[&[1.6], &[0.8], &[0.4], &[0.2]],
    memory: 0,
    physics: Physics::Command(|p, _, command, _| command.clamp(-p[0], p[0])),
    regressors: &[Regressor::Command, Regressor::Speed],
    signals: Signal::DRIVE,
    excitation: "moves faster than the limit, in both directions",
    experiment: "step_ladder",
    confused_with: &["drive.saturation.torque_speed", "drive.gain", "drive.friction.quadratic"],
    reference: "ODrive documentation, controller.config.vel_limit; Åström and Murray 2021, Feedback Systems (saturation)",
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faster_setpoints_are_cut_off_in_both_directions() {
        let Physics::Command(limit) = SPEED.physics else { panic!("it acts on the command") };
        assert_eq!(limit(&[0.3], &mut [], 0.5, 1e-3), 0.3);
        assert_eq!(limit(&[0.3], &mut [], -0.5, 1e-3), -0.3);
        assert_eq!(limit(&[0.3], &mut [], -0.2, 1e-3), -0.2);
    }
}
