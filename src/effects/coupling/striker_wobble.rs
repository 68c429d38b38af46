//! Tipping of the striker on its foot.

use crate::effects::oscillator::Oscillator;
use crate::effects::{Carriage, Domain, Effect, Parameter, Physics, Regressor, Signal, Site, both};
use std::f64::consts::TAU;

/// `coupling.striker_wobble`: tipping of the striker on its foot.
///
/// O is the offset of the part that the camera sees. A striker on a spring alone would have c =
/// 1/w^2 (`coupling.magnet_spring`); a striker that tips has its own c.
pub(crate) static STRIKER_WOBBLE: Effect = Effect {
    name: "coupling.striker_wobble",
    summary: "the striker tips on its foot: the part that the camera sees leans back during acceleration and oscillates after stops",
    domain: Domain::Coupling,
    site: Site::Whole,
    equation: "d²o/dt² + 2 ζ · ω · do/dt + ω² · o = −ω² · c · a, ω = 2π · f",
    parameters: &[
        Parameter {
            name: "lean_s2",
            symbol: "c",
            unit: "m/(m/s^2)",
            scale: 5e-5,
            bounds: (0.0, 5e-3),
            plausible: (5e-6, 4e-4),
            per_session: false,
        },
        Parameter {
            name: "frequency_hz",
            symbol: "f",
            unit: "Hz",
            scale: 5.0,
            bounds: (1.0, 80.0),
            plausible: (5.0, 40.0),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            symbol: "ζ",
            unit: "1",
            scale: 0.05,
            bounds: (0.002, 1.0),
            plausible: (0.01, 0.3),
            per_session: false,
        },
    ],
    null: &[0.0, 15.0, 0.1],
    probes: &[&[5e-5, 7.0, 0.1], &[5e-5, 12.0, 0.1], &[5e-5, 20.0, 0.1], &[5e-5, 33.0, 0.1]],
    memory: 4,
    physics: Physics::Coupling(wobble),
    regressors: &[Regressor::Acceleration, Regressor::SinceReversal],
    signals: Signal::STRIKER,
    excitation: "hard stops with a rest after each, with camera and encoders",
    experiment: "step_ladder",
    confused_with: &["coupling.magnet_spring", "sensor.noise_model"],
    reference: "damped oscillator: Rao 2017, Mechanical Vibrations",
};

/// Position of the striker as the camera sees it (m) after one step.
///
/// `memory` holds the offset and its velocity, x then y. Exact for an acceleration that is constant
/// over the step.
fn wobble(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
    let oscillator = Oscillator::new(TAU * p[1], p[2], carriage.dt);
    both(|axis| {
        let [offset, velocity] = [2 * axis, 2 * axis + 1];
        let rest = -p[0] * carriage.acceleration[axis];
        let (away, speed) = oscillator.step(memory[offset] - rest, memory[velocity]);
        memory[offset] = rest + away;
        memory[velocity] = speed;
        carriage.position[axis] + memory[offset]
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_leans_back_and_swings_after_the_acceleration_ends() {
        let mut memory = [0.0; 4];
        let p = [1e-4, 10.0, 0.05];
        let carriage = |acceleration: f64| Carriage {
            dt: 1e-3,
            acceleration: [acceleration, 0.0],
            ..Carriage::default()
        };
        for _ in 0..12_000 {
            wobble(&p, &mut memory, &carriage(8.0));
        }
        assert!((memory[0] + 8e-4).abs() < 1e-9);
        // After half a period of 0.1 s the offset is -exp(-pi z / sqrt(1 - z^2)) times the first one.
        let half = 0.05 / (1.0_f64 - 0.0025).sqrt();
        let mut place = [0.0; 2];
        let step = Carriage { dt: half / 50.0, ..carriage(0.0) };
        for _ in 0..50 {
            place = wobble(&p, &mut memory, &step);
        }
        let want = 8e-4 * (-std::f64::consts::PI * 0.05 / (1.0_f64 - 0.0025).sqrt()).exp();
        assert!((place[0] - want).abs() < 1e-9, "{} {want}", place[0]);
        assert_eq!(wobble(STRIKER_WOBBLE.null, &mut [0.0; 4], &carriage(9.0)), [0.0; 2]);
    }
}
