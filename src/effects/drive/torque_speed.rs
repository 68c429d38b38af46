//! Torque-speed limit of the motor.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site};

/// `drive.saturation.torque_speed`: line of a direct-current motor on a fixed supply. The loop
/// knows F_max, its own limit. It stops integrating where it demands more (conditional
/// integration). It does not know the lower limit that the supply sets at speed.
pub(crate) static TORQUE_SPEED: Effect = Effect {
    name: "drive.saturation.torque_speed",
    summary: "the available motor force falls with speed",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "|F| ≤ F_max · (1 − |v| / v0) while driving, |F| ≤ F_max while braking",
    parameters: &[
        Parameter {
            name: "force_n",
            symbol: "F_max",
            unit: "N",
            scale: 10.0,
            bounds: (0.5, 10000.0),
            plausible: (5.0, 200.0),
            per_session: false,
        },
        Parameter {
            name: "speed_m_per_s",
            symbol: "v0",
            unit: "m/s",
            scale: 1.0,
            bounds: (0.05, 1000.0),
            plausible: (0.5, 10.0),
            per_session: false,
        },
    ],
    null: &[10000.0, 1000.0],
    probes: &[&[40.0, 2.0], &[20.0, 2.0], &[10.0, 2.0], &[20.0, 1.0], &[10.0, 1.0], &[150.0, 2.0]],
    memory: 0,
    physics: Physics::Both(&[
        Physics::Effort(|p, _, motion| limited(p, motion)),
        Physics::Windup(|p| p[0]),
    ]),
    regressors: &[Regressor::Load, Regressor::Speed],
    signals: Signal::DRIVE,
    excitation: "starts and stops at full command up to high speed",
    experiment: "step_ladder",
    confused_with: &["drive.supply_sag", "drive.friction.viscous", "drive.saturation.slew"],
    reference: "Hughes and Drury 2013, Electric Motors and Drives; anti-windup: Åström and Hägglund 1995, PID Controllers, section 3.5",
};

fn limited(p: &[f64], motion: &Motion) -> f64 {
    let driving = 0.0 < motion.force * motion.velocity;
    let left = if driving { (1.0 - motion.velocity.abs() / p[1]).max(0.0) } else { 1.0 };
    motion.force.clamp(-p[0] * left, p[0] * left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_limits_while_driving_and_less_while_braking() {
        let at = |force, velocity| Motion { force, velocity, ..Motion::default() };
        assert_eq!(limited(&[10.0, 2.0], &at(9.0, 1.0)), 5.0);
        assert_eq!(limited(&[10.0, 2.0], &at(-9.0, -1.0)), -5.0);
        assert_eq!(limited(&[10.0, 2.0], &at(-9.0, 1.0)), -9.0);
        assert_eq!(limited(&[10.0, 2.0], &at(-19.0, 1.0)), -10.0);
        assert_eq!(limited(&[10.0, 2.0], &at(4.0, 1.0)), 4.0);
        assert_eq!(limited(TORQUE_SPEED.null, &at(200.0, 1.0)), 200.0);
    }
}
