//! The force that the motor can give falls with its speed.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// `drive.saturation.torque_speed`: |F| <= Fmax (1 - |v|/v0) while the motor drives, |F| <= Fmax
/// while it brakes: the line of a direct-current motor on a fixed supply. The loop knows Fmax, its own limit, and stops
/// integrating where it demands more (conditional integration: Åström and Hägglund, PID Controllers, 3.5); it does not
/// know what the supply leaves of that at speed.
pub(crate) static TORQUE_SPEED: Effect = Effect {
    name: "drive.saturation.torque_speed",
    says: "the motor runs out of force at high speed",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[
        Parameter {
            name: "force_n",
            unit: "N",
            scale: 10.0,
            bounds: (0.5, 10000.0),
            plausible: (5.0, 200.0),
            per_session: false,
        },
        Parameter {
            name: "speed_m_per_s",
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
    excitation: "starts and stops at full command to high speed",
    experiment: "step_ladder",
    confused_with: &["drive.supply_sag", "drive.friction.viscous", "drive.saturation.slew"],
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
