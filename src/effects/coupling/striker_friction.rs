//! The striker rubs on the board and hangs back on the soft grip of the magnet.

use crate::effects::{Carriage, Domain, Effect, Parameter, Physics, Regressor, Site, both};

/// `coupling.striker_friction`: the striker moves only when the spring k pulls harder than its
/// friction Fc, so it hangs back by Fc/k against the direction in which it last moved, and stays
/// there at rest. Only the ratio can be seen, and it is the parameter. Lag by inertia is
/// `coupling.magnet_spring`.
pub(crate) static STRIKER_FRICTION: Effect = Effect {
    name: "coupling.striker_friction",
    says: "the striker rubs on the board and hangs back by the same distance at any speed, also at rest",
    domain: Domain::Coupling,
    site: Site::Whole,
    parameters: &[Parameter {
        name: "half_band_m",
        unit: "m",
        scale: 2e-4,
        bounds: (0.0, 0.03),
        plausible: (5e-5, 5e-3),
        per_session: false,
    }],
    null: &[0.0],
    probes: &[&[2e-4], &[1e-3]],
    memory: 2,
    physics: Physics::Coupling(hang_back),
    regressors: &[Regressor::Direction, Regressor::SinceReversal],
    excitation: "slow reversals along rails and diagonals, with camera and encoders",
    experiment: "creep",
    confused_with: &[
        "drive.backlash",
        "drive.friction.presliding",
        "coupling.magnet_spring",
        "sensor.camera_latency",
    ],
};

/// Memory: displacement of the striker from the magnet. The magnet moves on alone until the
/// displacement is as long as the band allows, then drags the striker along.
fn hang_back(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
    let alone = both(|axis| memory[axis] - carriage.velocity[axis] * carriage.dt);
    let length = alone[0].hypot(alone[1]);
    let share = if p[0] < length { p[0] / length } else { 1.0 };
    both(|axis| {
        memory[axis] = share * alone[axis];
        carriage.position[axis] + memory[axis]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(p: &[f64], memory: &mut [f64], velocity: [f64; 2], steps: usize) -> [f64; 2] {
        let carriage = Carriage { dt: 1e-3, velocity, ..Carriage::default() };
        (0..steps).fold([0.0; 2], |_, _| hang_back(p, memory, &carriage))
    }

    #[test]
    fn the_striker_hangs_back_and_crosses_the_band_at_a_reversal() {
        let mut memory = [0.0; 2];
        let [x, y] = moved(&[5e-4], &mut memory, [0.3, 0.4], 100);
        assert!((x + 3e-4).abs() < 1e-9 && (y + 4e-4).abs() < 1e-9);
        // At rest it stays; back at 0.5 m/s it crosses 1 mm in 2 ms.
        let _ = moved(&[5e-4], &mut memory, [0.0, 0.0], 100);
        let [x, _] = moved(&[5e-4], &mut memory, [-0.3, -0.4], 1);
        assert!(x.abs() < 1e-9, "{x}");
        let [x, _] = moved(&[5e-4], &mut memory, [-0.3, -0.4], 1);
        assert!((x - 3e-4).abs() < 1e-9);
        assert_eq!(moved(STRIKER_FRICTION.null, &mut memory, [0.3, 0.4], 1), [0.0; 2]);
    }
}
