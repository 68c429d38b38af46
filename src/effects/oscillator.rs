//! Exact step of one damped oscillator.

/// Largest square of the phase of one step (rad^2) at which [`short_turn`] is exact.
const SHORT_TURN_SQUARED: f64 = 0.25;

/// x'' + 2 z w x' + w^2 x = 0 over one step, for any damping.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Oscillator {
    /// w^2 (1/s^2).
    stiffness: f64,
    /// z w (1/s).
    damping: f64,
    cosine: f64,
    sine: f64,
}

impl Oscillator {
    /// A step of `dt` seconds at the angular frequency `natural` (1/s) with the damping `ratio`.
    ///
    /// With p = sqrt(|1 - z^2|) w the solution is exp(-z w t) times cosines and sines of p t, or
    /// hyperbolic ones above critical damping. They are expanded so that none overflows.
    pub(crate) fn new(natural: f64, ratio: f64, dt: f64) -> Self {
        Self::with_stiffness(natural * natural, ratio * natural, dt)
    }

    /// The same with w^2 = `stiffness` (1/s^2) and z w = `damping` (1/s).
    pub(crate) fn with_stiffness(stiffness: f64, damping: f64, dt: f64) -> Self {
        let decay = (-damping * dt).exp();
        let square = (stiffness - damping * damping) * dt * dt;
        let turn = || square.abs().sqrt() / dt;
        let (cosine, sine) = if square.abs() <= SHORT_TURN_SQUARED {
            let (cosine, sine) = short_turn(square);
            (decay * cosine, decay * dt * sine)
        } else if 0.0 < square {
            let turn = turn();
            (decay * (turn * dt).cos(), decay * (turn * dt).sin() / turn)
        } else {
            let turn = turn();
            let slow = (-stiffness / (damping + turn) * dt).exp();
            let fast = (-(damping + turn) * dt).exp();
            (0.5 * (slow + fast), 0.5 * (slow - fast) / turn)
        };
        Self { stiffness, damping, cosine, sine }
    }

    /// Position and velocity after the step.
    pub(crate) fn step(&self, place: f64, velocity: f64) -> (f64, f64) {
        let Self { stiffness, damping, cosine, sine } = *self;
        (
            place * cosine + (velocity + damping * place) * sine,
            velocity * cosine - (damping * velocity + stiffness * place) * sine,
        )
    }

    /// Position and velocity after a step that begins at 0 without velocity, while the place of rest is at 1.
    pub(crate) fn response(&self) -> (f64, f64) {
        let (from_rest, velocity) = self.step(-1.0, 0.0);
        (1.0 + from_rest, velocity)
    }
}

/// cos(p) and sin(p) / p of `square` = p^2, or cosh and sinh of -`square`: their power series, which are the same.
///
/// The first term left out is below 2e-16 of the sum for squares up to [`SHORT_TURN_SQUARED`].
fn short_turn(square: f64) -> (f64, f64) {
    let series = |divisors: [f64; 6]| {
        divisors.iter().rev().fold(1.0, |sum, divisor| 1.0 - square * (1.0 / divisor) * sum)
    };
    (series([2.0, 12.0, 30.0, 56.0, 90.0, 132.0]), series([6.0, 20.0, 42.0, 72.0, 110.0, 156.0]))
}

#[cfg(test)]
mod tests {
    use super::{Oscillator, SHORT_TURN_SQUARED, short_turn};

    #[test]
    fn the_series_of_a_short_turn_are_the_functions() {
        for k in -50..=50 {
            let square = SHORT_TURN_SQUARED * f64::from(k) / 50.0;
            let p = square.abs().sqrt().max(f64::MIN_POSITIVE);
            let (cosine, sine) =
                if k < 0 { (p.cosh(), p.sinh() / p) } else { (p.cos(), p.sin() / p) };
            let (own_cosine, own_sine) = short_turn(square);
            let error = (own_cosine - cosine).abs().max((own_sine - sine).abs());
            assert!(error < 4.0 * f64::EPSILON, "{square} {error}");
        }
    }

    #[test]
    fn a_step_agrees_with_many_small_ones_at_any_damping() {
        for ratio in [0.0, 0.3, 0.999_999_999, 1.0, 1.000_001, 4.0] {
            let (w, dt) = (40.0_f64, 0.03);
            let (mut x, mut v) = (0.002_f64, -0.1_f64);
            let (want_x, want_v) = Oscillator::new(w, ratio, dt).step(x, v);
            let n = 300_000;
            for _ in 0..n {
                let h = dt / f64::from(n);
                let (mx, mv) = (x + 0.5 * h * v, v - 0.5 * h * (2.0 * ratio * w * v + w * w * x));
                (x, v) = (x + h * mv, v - h * (2.0 * ratio * w * mv + w * w * mx));
            }
            assert!((x - want_x).abs() < 1e-9 && (v - want_v).abs() < 1e-7, "{ratio} {x} {want_x}");
        }
        // No overflow far above critical damping.
        let (x, v) = Oscillator::new(1e5, 50.0, 1.0).step(1.0, 0.0);
        assert!(x.is_finite() && v.is_finite());
    }
}
