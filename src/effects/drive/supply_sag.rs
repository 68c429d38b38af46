//! Supply voltage drop under the power of both motors.

use crate::effects::{
    Domain, Effect, Motion, Parameter, Physics, Regressor, Signal, Site, first_order::follow,
};

/// `drive.supply_sag`: supply voltage drop under the power of both motors.
///
/// The voltage V = V0 - Rs I with I = P/V0 reduces all forces by the fraction k P, with k =
/// Rs/V0^2. P is the power that both motors take from the supply, behind the time constant T = Rs C
/// of the bus capacitor. A driving motor takes its mechanical power F v. Of the power that a
/// braking motor absorbs, the supply delivers the fraction b. A positive b means losses, or a
/// bridge that brakes against the supply; a negative b means regeneration; 0 means a brake
/// resistor.
pub(crate) static SUPPLY_SAG: Effect = Effect {
    name: "drive.supply_sag",
    summary: "the supply voltage drops under load, so both motors weaken when the total power is high",
    domain: Domain::Drive,
    site: Site::Motors,
    equation: "F′ = F · (1 − k · P), T · dP/dt + P = Σ over motors of (max(F v, 0) − b · min(F v, 0))",
    parameters: &[
        Parameter {
            name: "fraction_per_w",
            symbol: "k",
            unit: "1/W",
            scale: 0.005,
            bounds: (0.0, 1.0),
            plausible: (0.0005, 0.02),
            per_session: false,
        },
        Parameter {
            name: "time_constant_s",
            symbol: "T",
            unit: "s",
            scale: 0.005,
            bounds: (0.0, 0.2),
            plausible: (0.0, 0.05),
            per_session: false,
        },
        Parameter {
            name: "braking_fraction",
            symbol: "b",
            unit: "1",
            scale: 0.5,
            bounds: (-2.0, 3.0),
            plausible: (-1.0, 2.0),
            per_session: false,
        },
    ],
    null: &[0.0, 0.0, 0.0],
    probes: &[&[0.002, 0.0, 0.0], &[0.01, 0.0, 0.0], &[0.01, 0.01, 0.0], &[0.01, 0.01, 1.0]],
    memory: 2,
    physics: Physics::Effort(sagged),
    regressors: &[Regressor::Load, Regressor::OtherAxis, Regressor::Speed],
    signals: Signal::DRIVE,
    excitation: "high power of both motors at once, then of each motor alone",
    experiment: "circle",
    confused_with: &[
        "drive.saturation.torque_speed",
        "drive.friction.viscous",
        "gantry.cross_coupling",
    ],
    reference: "Ohm's law for the source resistance, and the RC circuit of the bus capacitor",
};

/// Smallest remaining fraction of the force.
const LEAST: f64 = 0.1;

fn sagged(p: &[f64], memory: &mut [f64], motion: &Motion) -> f64 {
    let drawn = |mechanical: f64| mechanical.max(0.0) - p[2] * mechanical.min(0.0);
    let both =
        drawn(motion.force * motion.velocity) + drawn(motion.other.force * motion.other.velocity);
    let power = follow(p[1], memory, both, motion.dt);
    motion.force * (1.0 - p[0] * power).max(LEAST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::CrossMotion;

    /// Force of a motor under a constant load.
    fn steady(p: &[f64], motion: Motion) -> f64 {
        let mut memory = [0.0; 2];
        (0..1000).map(|_| sagged(p, &mut memory, &Motion { dt: 1e-3, ..motion })).last().unwrap()
    }

    #[test]
    fn the_power_of_both_motors_counts() {
        let other = CrossMotion { force: -5.0, velocity: -2.0, ..CrossMotion::default() };
        let both = Motion { force: 10.0, velocity: 1.0, other, ..Motion::default() };
        let alone = Motion { other: CrossMotion::default(), ..both };
        for time_constant in [0.0, 0.01] {
            let with = |motion| steady(&[0.01, time_constant, 0.0], motion);
            assert!((with(both) - 8.0).abs() < 1e-12);
            assert!((with(alone) - 9.0).abs() < 1e-12);
            assert_eq!(with(Motion { velocity: -1.0, ..alone }), 10.0);
        }
        assert_eq!(steady(SUPPLY_SAG.null, both), 10.0);
    }

    #[test]
    fn braking_takes_from_the_supply_or_gives_back() {
        let braking = Motion { force: 10.0, velocity: -1.0, ..Motion::default() };
        assert!((steady(&[0.01, 0.0, 1.0], braking) - 9.0).abs() < 1e-12);
        assert!((steady(&[0.01, 0.0, -1.0], braking) - 11.0).abs() < 1e-12);
    }

    #[test]
    fn the_capacitor_holds_the_voltage_up_for_its_time_constant() {
        let motion = Motion { dt: 1e-4, force: 10.0, velocity: 1.0, ..Motion::default() };
        let mut memory = [10.0, 0.0];
        let after = (0..100).map(|_| sagged(&[0.01, 0.01, 0.0], &mut memory, &motion)).last();
        assert!((after.unwrap() - (9.0 + (-1.0_f64).exp())).abs() < 1e-9);
    }
}
