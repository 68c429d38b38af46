//! Friction of the striker on the board.

use super::{
    magnet_spring::{DAMPING, SOFTENING, STIFFNESS},
    striker::STATES,
};
use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Signal, Site, Striker};

/// Friction of the striker.
pub(super) const FRICTION: Parameter = Parameter {
    name: "force_n",
    symbol: "F_c",
    unit: "N",
    scale: 0.05,
    bounds: (0.0, 20.0),
    plausible: (0.005, 2.0),
    per_session: false,
};

/// `coupling.striker_friction`: friction of the striker on the board.
///
/// The magnet presses the striker on the board and holds it like the spring of
/// `coupling.magnet_spring`. At a constant velocity the striker lags by about F_c/k. At rest it may
/// stay anywhere within that distance. The carriage feels the coupling force.
pub(crate) static STRIKER_FRICTION: Effect = Effect {
    name: "coupling.striker_friction",
    summary: "the striker rubs on the board and lags by the same distance at any speed, also at rest",
    domain: Domain::Coupling,
    site: Site::Whole,
    equation: "m_s · dv_s/dt = k · d / (1 + (d / d0)²) + 2 ζ · √(k · m_s) · dd/dt − F_c · v_s / |v_s|, d = q_magnet − q_striker",
    parameters: &[
        FRICTION,
        Parameter { scale: 50.0, plausible: (20.0, 3000.0), ..STIFFNESS },
        Parameter { plausible: (0.0, 1.5), ..DAMPING },
        Parameter { plausible: (0.002, 1.0), ..SOFTENING },
    ],
    null: &[0.0, 5000.0, 1.0, 1.0],
    probes: &[
        &[0.5, 2500.0, 0.3, 0.02],
        &[0.1, 400.0, 0.2, 0.02],
        &[0.4, 400.0, 0.2, 0.02],
        &[0.02, 100.0, 0.2, 0.02],
        &[0.1, 100.0, 0.2, 0.02],
    ],
    memory: STATES,
    physics: Physics::Both(&[Physics::Striker(striker), Physics::Reaction(striker)]),
    regressors: &[Regressor::Direction, Regressor::SinceReversal],
    signals: Signal::MOTION,
    excitation: "slow reversals along the axes and diagonals, with camera and encoders",
    experiment: "creep",
    confused_with: &[
        "drive.backlash",
        "drive.friction.presliding",
        "coupling.magnet_spring",
        "sensor.camera_latency",
    ],
    reference: "Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, Automatica 30(7), 1083-1138",
};

fn striker(p: &[f64]) -> Striker {
    Striker { friction: p[0], stiffness: p[1], damping_ratio: p[2], softening: p[3] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Carriage, CarriageLanes, StrikerLanes, StrikerStateLanes};
    use pulp::Scalar;

    fn rub(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        StrikerLanes::alone(striker(p), carriage.striker_mass).striker(memory, carriage)
    }

    fn hold_back(p: &[f64], memory: &mut [f64], carriage: &Carriage) -> [f64; 2] {
        rub(p, memory, carriage);
        let own = StrikerLanes::alone(striker(p), carriage.striker_mass);
        let mut state = StrikerStateLanes::at_rest(Scalar);
        state.put(0, memory);
        own.hold_back(&state, &CarriageLanes::alone(carriage)).map(|own| own.get(0))
    }

    const MASS: f64 = 0.012;

    /// Displacement after `milliseconds` of a carriage whose velocity and acceleration at a time (s) are `motion`.
    fn moved(
        p: &[f64],
        memory: &mut [f64],
        milliseconds: std::ops::Range<u32>,
        motion: impl Fn(f64) -> [[f64; 2]; 2],
    ) -> [f64; 2] {
        milliseconds.fold([0.0; 2], |_, k| {
            let [velocity, acceleration] = motion(1e-3 * f64::from(k + 1));
            let carriage = Carriage {
                dt: 1e-3,
                velocity,
                acceleration,
                striker_mass: MASS,
                ..Carriage::default()
            };
            rub(p, memory, &carriage)
        })
    }

    #[test]
    fn it_hangs_back_by_force_over_stiffness_and_crosses_the_band_at_a_reversal() {
        let p = [0.4, 800.0, 0.3, 1.0];
        let mut memory = [0.0; 4];
        let there = |_| [[0.003, 0.004], [0.0; 2]];
        let [x, y] = moved(&p, &mut memory, 0..2000, there);
        assert!((x + 3e-4).abs() < 1e-7 && (y + 4e-4).abs() < 1e-7, "{x} {y}");
        // The lag remains at rest, and is the same at another speed.
        let rest = moved(&p, &mut memory, 0..2000, |_| [[0.0; 2]; 2]);
        assert_eq!(rest, moved(&p, &mut memory, 0..2000, |_| [[0.0; 2]; 2]));
        assert!((rest[0] + 3e-4).abs() < 2e-5 && (rest[1] + 4e-4).abs() < 2e-5, "{rest:?}");
        let [x, y] = moved(&p, &mut memory, 0..2000, |_| [[-0.03, -0.04], [0.0; 2]]);
        assert!((x - 3e-4).abs() < 1e-6 && (y - 4e-4).abs() < 1e-6, "{x} {y}");
        assert_eq!(moved(&p, &mut [0.0; 4], 0..1, |_| [[0.0; 2]; 2]), [0.0; 2]);
    }

    /// Solution of the equation by small steps, with friction that is smooth near rest.
    #[test]
    fn it_swings_as_its_equation_says() {
        let p = [0.1, 400.0, 0.1, 0.002];
        let turn = 2.0 * std::f64::consts::PI * 3.0;
        let motion = |t: f64| {
            let (sin, cos) = (turn * t).sin_cos();
            [[0.2 * sin, 0.0], [0.2 * turn * cos, 0.0]]
        };
        let (h, damping) = (1e-6, 2.0 * p[2] * (p[1] * MASS).sqrt());
        let (mut away, mut speed, mut worst) = (0.0, 0.0_f64, 0.0_f64);
        let mut memory = [0.0; 4];
        for k in 0..1000 {
            for inner in 0..1000 {
                let t = 1e-3 * f64::from(k) + h * f64::from(inner);
                let rate = speed - motion(t)[0][0];
                let spring = -p[1] * away / (1.0 + (away / p[3]).powi(2));
                let force = spring - damping * rate - p[0] * (speed / 1e-4).tanh();
                away += h * rate;
                speed += h * force / MASS;
            }
            let [x, _] = moved(&p, &mut memory, k..k + 1, motion);
            worst = worst.max((x - away).abs());
        }
        // One percent of the amplitude.
        assert!(worst < 1e-5, "{worst}");
    }

    #[test]
    fn the_carriage_is_held_back_by_the_friction_and_its_mass_counts_already() {
        let held = |p: &[f64], motion: &dyn Fn(f64) -> [[f64; 2]; 2]| {
            let mut memory = [0.0; 4];
            (1..=2000).fold([0.0; 2], |_, k| {
                let [velocity, acceleration] = motion(1e-3 * f64::from(k));
                let striker_mass = MASS;
                let now = Carriage {
                    dt: 1e-3,
                    velocity,
                    acceleration,
                    striker_mass,
                    ..Carriage::default()
                };
                hold_back(p, &mut memory, &now)
            })
        };
        let [x, y] = held(&[0.4, 800.0, 0.3, 1.0], &|_| [[0.03, -0.04], [0.0; 2]]);
        assert!((x + 0.24).abs() < 1e-4 && (y - 0.32).abs() < 1e-4, "{x} {y}");
        let [x, _] = held(&[0.0, 800.0, 0.5, 1.0], &|t| [[3.0 * t, 0.0], [3.0, 0.0]]);
        assert!(x.abs() < 1e-6, "{x}");
    }

    #[test]
    fn without_friction_it_is_a_spring() {
        let mut memory = [0.0; 4];
        let [x, _] =
            moved(&[0.0, 30.0, 0.5, 1e3], &mut memory, 0..3000, |t| [[5.0 * t, 0.0], [5.0, 0.0]]);
        assert!((x + 0.002).abs() < 1e-9, "{x}");
    }
}
