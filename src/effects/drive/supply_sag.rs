//! The supply gives way when both motors work hard.

use crate::effects::{Domain, Effect, Motion, Parameter, Physics, Regressor, Site};

/// `drive.supply_sag`: V = V0 - Rs I with I = P/V0, so that all forces shrink by the share s P,
/// where P is the mechanical power that both motors take from the supply and s = Rs/V0^2. Power
/// that a braking motor returns is not counted.
pub(crate) static SUPPLY_SAG: Effect = Effect {
    name: "drive.supply_sag",
    says: "the supply voltage drops under load, so both motors weaken when the total power is high",
    domain: Domain::Drive,
    site: Site::Motors,
    parameters: &[Parameter {
        name: "share_per_w",
        unit: "1/W",
        scale: 0.005,
        bounds: (0.0, 1.0),
        plausible: (0.0005, 0.02),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[0.002], &[0.01]],
    memory: 0,
    physics: Physics::Effort(|p, _, motion| sagged(p, motion)),
    regressors: &[Regressor::Load, Regressor::OtherAxis, Regressor::Speed],
    excitation: "both motors hard at once, then each alone",
    experiment: "circle",
    confused_with: &[
        "drive.saturation.torque_speed",
        "drive.friction.viscous",
        "gantry.cross_coupling",
    ],
};

/// What is left of the force at the least.
const LEAST: f64 = 0.1;

fn sagged(p: &[f64], motion: &Motion) -> f64 {
    let power = (motion.force * motion.velocity).max(0.0)
        + (motion.other.force * motion.other.velocity).max(0.0);
    motion.force * (1.0 - p[0] * power).max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CrossMotion;

    #[test]
    fn the_power_of_both_motors_counts() {
        let other = CrossMotion { force: -5.0, velocity: -2.0, ..CrossMotion::default() };
        let both = Motion { force: 10.0, velocity: 1.0, other, ..Motion::default() };
        assert!((sagged(&[0.01], &both) - 8.0).abs() < 1e-12);
        let alone = Motion { other: CrossMotion::default(), ..both };
        assert!((sagged(&[0.01], &alone) - 9.0).abs() < 1e-12);
        assert_eq!(sagged(&[0.01], &Motion { velocity: -1.0, ..alone }), 10.0);
        assert_eq!(sagged(SUPPLY_SAG.null, &both), 10.0);
    }
}
