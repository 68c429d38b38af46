//! Lag of the state estimator.

use crate::effects::oscillator::Oscillator;
use crate::effects::{Domain, Effect, Parameter, Physics, Regressor, Sample, Signal, Site};

/// Lag below which the estimator does not smooth (s).
const SHORTEST_LAG_S: f64 = 1e-6;

/// `estimator.lag`: second-order low-pass with the lag T = 2 z / w at low frequency. A Kalman
/// filter with a constant-velocity model has z = 1/sqrt(2) in steady state. A first-order low-pass
/// has a large z.
pub(crate) static LAG: Effect = Effect {
    name: "estimator.lag",
    summary: "the estimator smooths velocities, so they lag behind the motion",
    domain: Domain::Estimator,
    site: Site::Whole,
    equation: "d²v′/dt² + 2 ζ · ω · dv′/dt + ω² · v′ = ω² · v, ω = 2 ζ / T",
    parameters: &[
        Parameter {
            name: "lag_s",
            symbol: "T",
            unit: "s",
            scale: 0.01,
            bounds: (0.0, 0.5),
            plausible: (0.005, 0.05),
            per_session: false,
        },
        Parameter {
            name: "damping_ratio",
            symbol: "ζ",
            unit: "1",
            scale: 0.3,
            bounds: (0.3, 20.0),
            plausible: (0.6, 10.0),
            per_session: false,
        },
    ],
    null: &[0.0, 1.0],
    probes: &[&[0.01, 0.7], &[0.01, 4.0], &[0.04, 0.7], &[0.04, 4.0]],
    memory: 3,
    physics: Physics::Estimator(smooth),
    regressors: &[Regressor::Acceleration],
    signals: Signal::STATE,
    excitation: "velocity steps, with the positions and velocities of the state estimator recorded",
    experiment: "step_ladder",
    confused_with: &["drive.delay", "sensor.camera_latency", "drive.lag1"],
    reference: "Kalata 1984, The Tracking Index, IEEE TAES 20(2), 174-182, in continuous time",
};

/// Reported velocity (m/s) after one sample.
///
/// `memory` holds the previous true velocity, the reported velocity and its rate. Exact for a velocity
/// that is linear between samples: the forced solution then lags by T dv/dt.
fn smooth(p: &[f64], memory: &mut [f64], sample: &Sample) -> f64 {
    let (lag, ratio) = (p[0], p[1]);
    let before = std::mem::replace(&mut memory[0], sample.velocity);
    if lag < SHORTEST_LAG_S {
        (memory[1], memory[2]) = (sample.velocity, 0.0);
        return sample.velocity;
    }
    if sample.dt <= 0.0 {
        return memory[1];
    }
    let slope = (sample.velocity - before) / sample.dt;
    let oscillator = Oscillator::new(2.0 * ratio / lag, ratio, sample.dt);
    let (away, rate) = oscillator.step(memory[1] - (before - lag * slope), memory[2] - slope);
    memory[1] = sample.velocity - lag * slope + away;
    memory[2] = slope + rate;
    memory[1]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(p: &[f64], dt: f64, velocity: impl Fn(f64) -> f64, until: f64) -> f64 {
        let mut memory = [0.0; 3];
        let steps = (until / dt).round() as usize;
        (1..=steps).fold(0.0, |_, step| {
            smooth(
                p,
                &mut memory,
                &Sample { dt, velocity: velocity(step as f64 * dt), across: 0.0 },
            )
        })
    }

    #[test]
    fn a_ramp_lags_by_the_lag_whatever_the_step() {
        for dt in [0.001, 0.02] {
            for ratio in [0.7, 5.0] {
                let v = run(&[0.03, ratio], dt, |t| 2.0 * t, 2.0);
                assert!((v - 2.0 * (2.0 - 0.03)).abs() < 1e-9, "{v}");
            }
        }
        assert_eq!(run(LAG.null, 0.02, |t| t, 1.0), 1.0);
    }

    #[test]
    fn large_damping_is_a_first_order_low_pass() {
        // 1 - exp(-t/T) after a step; the linear rise over the sample of 0.1 ms matters little.
        let v = run(&[0.03, 20.0], 1e-4, |_| 1.0, 0.03);
        assert!((v - (1.0 - (-1.0_f64).exp())).abs() < 5e-3, "{v}");
    }

    #[test]
    fn a_kalman_filter_overshoots_a_step_by_four_percent() {
        let p = [0.03, std::f64::consts::FRAC_1_SQRT_2];
        let peak =
            (1..200).map(|k| run(&p, 1e-3, |_| 1.0, f64::from(k) * 1e-3)).fold(0.0_f64, f64::max);
        assert!((peak - 1.0432).abs() < 5e-4, "{peak}");
    }
}
