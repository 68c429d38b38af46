//! Slip between magnet and striker.

use crate::effects::{Carriage, Domain, Effect, Parameter, Physics, Regressor, Signal, Site, both};

/// `coupling.magnet_slip`: slip between magnet and striker.
///
/// The striker follows exactly while that needs less than F_max. Above it the striker slides over
/// the magnet, until both have the same velocity again, and keeps the offset. The damping c
/// represents eddy currents and grease.
pub(crate) static MAGNET_SLIP: Effect = Effect {
    name: "coupling.magnet_slip",
    summary: "under high acceleration the magnet loses the striker, which keeps an offset afterwards",
    domain: Domain::Coupling,
    site: Site::Whole,
    equation: "sticks while m_s · |a| ≤ F_max; otherwise m_s · dv_s/dt = −(F_max + c · |w|) · w / |w|, w = v_s − v_magnet",
    parameters: &[
        Parameter {
            name: "grip_n",
            symbol: "F_max",
            unit: "N",
            scale: 0.05,
            bounds: (1e-3, 1e3),
            plausible: (0.05, 6.0),
            per_session: false,
        },
        Parameter {
            name: "damping_n_s_per_m",
            symbol: "c",
            unit: "N s/m",
            scale: 0.1,
            bounds: (0.0, 100.0),
            plausible: (0.0, 10.0),
            per_session: false,
        },
    ],
    null: &[1e3, 0.1],
    probes: &[
        &[0.035, 0.3],
        &[0.05, 0.3],
        &[0.07, 0.3],
        &[0.1, 0.3],
        &[0.14, 0.3],
        &[0.2, 0.3],
        &[0.4, 0.3],
        &[0.8, 0.3],
        &[0.05, 0.0],
        &[0.1, 0.0],
        &[0.2, 0.0],
    ],
    memory: 4,
    physics: Physics::Coupling(slip),
    regressors: &[Regressor::Acceleration, Regressor::SinceReversal],
    signals: Signal::STRIKER,
    excitation: "accelerations that increase until the striker slips, with camera and encoders",
    experiment: "ramp",
    confused_with: &["coupling.magnet_spring", "coupling.striker_friction"],
    reference: "Furlani 2001, Permanent Magnet and Electromechanical Devices",
};

/// Position of the striker (m) after one step.
///
/// `memory` holds the velocity of the striker relative to the magnet, then its offset. The grip
/// reduces the velocity within a step and never reverses it, so that sticking does not chatter. The
/// damping is implicit.
fn slip(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
    let dt = carriage.dt;
    let free = both(|axis| memory[axis] - carriage.acceleration[axis] * dt);
    let speed = free[0].hypot(free[1]);
    let held = p[0] / carriage.striker_mass * dt;
    let slowed = 1.0 + p[1] / carriage.striker_mass * dt;
    let left = if held < speed { (1.0 - held / speed) / slowed } else { 0.0 };
    both(|axis| {
        let velocity = left * free[axis];
        memory[2 + axis] += 0.5 * dt * (memory[axis] + velocity);
        memory[axis] = velocity;
        carriage.position[axis] + memory[2 + axis]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_of_one_hard_stop_is_that_of_the_kinematics_and_stays() {
        // 20 m/s^2 for 0.05 s against a grip of 10 m/s^2: the striker slides 0.5 * 10 * 0.05^2 while
        // it lasts and as far again until it is caught, 25 mm in all, ahead of the braking magnet.
        let mut memory = [0.0; 4];
        let mut place = [0.0; 2];
        for step in 0..2000 {
            let acceleration = [if step < 500 { -20.0 } else { 0.0 }, 0.0];
            let carriage =
                Carriage { dt: 1e-4, acceleration, striker_mass: 0.01, ..Carriage::default() };
            place = slip(&[0.1, 0.0], &mut memory, &carriage);
        }
        assert!((place[0] - 0.025).abs() < 1e-4, "{place:?}");
        assert_eq!(memory[0], 0.0);
    }

    #[test]
    fn a_damped_slide_tends_to_the_speed_at_which_grip_and_damping_carry_the_acceleration() {
        // m a = 0.2 N against a grip of 0.1 N and 0.5 N s/m: 0.2 m/s.
        let mut memory = [0.0; 4];
        let acceleration = [-20.0, 0.0];
        let carriage =
            Carriage { dt: 1e-4, acceleration, striker_mass: 0.01, ..Carriage::default() };
        for _ in 0..5000 {
            let _ = slip(&[0.1, 0.5], &mut memory, &carriage);
        }
        assert!((memory[0] - 0.2).abs() < 1e-4, "{memory:?}");
    }

    #[test]
    fn nothing_slips_below_the_grip() {
        let mut memory = [0.0; 4];
        let acceleration = [6.0, -6.0];
        let carriage =
            Carriage { dt: 1e-3, acceleration, striker_mass: 0.01, ..Carriage::default() };
        assert_eq!(slip(&[0.1, 0.0], &mut memory, &carriage), [0.0, 0.0]);
    }
}
