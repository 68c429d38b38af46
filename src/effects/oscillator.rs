//! Exact step of one damped oscillator, or of several side by side.

use crate::lanes::Lanes;
use pulp::{Scalar, Simd};

/// Largest square of the phase of one step (rad^2) at which [`short_turn`] is exact.
const SHORT_TURN_SQUARED: f64 = 0.25;

/// Largest exponent of a decay at which its power series is exact.
const SHORT_DECAY: f64 = 1.0;

/// x'' + 2 z w x' + w^2 x = 0 over one step, for any damping.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Oscillator(OscillatorLanes<Scalar>);

impl Oscillator {
    /// A step of `dt` seconds at the angular frequency `natural` (1/s) with the damping `ratio`.
    pub(crate) fn new(natural: f64, ratio: f64, dt: f64) -> Self {
        let of = |value: f64| Lanes::splat(Scalar, value);
        let damping = ratio * natural;
        let decay = of((-damping * dt).exp());
        Self(OscillatorLanes::with_decay(of(natural * natural), of(damping), of(dt), decay))
    }

    /// Position and velocity after the step.
    pub(crate) fn step(&self, place: f64, velocity: f64) -> (f64, f64) {
        let of = |value: f64| Lanes::splat(Scalar, value);
        let (place, velocity) = self.0.step(of(place), of(velocity));
        (place.get(0), velocity.get(0))
    }
}

/// cos(p) and sin(p) / p of `square` = p^2, or cosh and sinh of -`square`: their power series, which are the same.
///
/// The first term left out is below 2e-16 of the sum for squares up to [`SHORT_TURN_SQUARED`].
#[inline(always)]
fn short_turn<S: Simd>(square: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
    let cosine = series(square, [132.0, 90.0, 56.0, 30.0, 12.0, 2.0]);
    (cosine, series(square, [156.0, 110.0, 72.0, 42.0, 20.0, 6.0]))
}

/// 1 - x/d_n (... (1 - x/d_2 (1 - x/d_1))), with x and all d. Horner's scheme of an alternating power series.
#[inline(always)]
fn series<S: Simd, const N: usize>(x: Lanes<S>, divisors: [f64; N]) -> Lanes<S> {
    let mut sum = x.like(1.0);
    for divisor in divisors {
        sum = 1.0 - (1.0 / divisor) * x * sum;
    }
    sum
}

/// `cosine` and `sine` of [`OscillatorLanes`] for one step that is too long for [`short_turn`].
///
/// With p = sqrt(|1 - z^2|) w the solution is exp(-z w t), which is `decay`, times cosines and sines of p t, or hyperbolic
/// ones above critical damping. They are expanded so that none overflows.
fn long_turn([stiffness, damping]: [f64; 2], dt: f64, decay: f64) -> (f64, f64) {
    let square = stiffness - damping * damping;
    let turn = (square * dt * dt).abs().sqrt() / dt;
    if 0.0 < square {
        return (decay * (turn * dt).cos(), decay * (turn * dt).sin() / turn);
    }
    let slow = (-stiffness / (damping + turn) * dt).exp();
    let fast = (-(damping + turn) * dt).exp();
    (0.5 * (slow + fast), 0.5 * (slow - fast) / turn)
}

/// Oscillators of several simulations; see [`Oscillator`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct OscillatorLanes<S: Simd> {
    /// w^2 (1/s^2).
    stiffness: Lanes<S>,
    /// z w (1/s).
    damping: Lanes<S>,
    /// exp(-z w t) times cos(p t), and times sin(p t) / p (s).
    cosine: Lanes<S>,
    sine: Lanes<S>,
}

impl<S: Simd> OscillatorLanes<S> {
    /// Steps of `dt` with w^2 = `stiffness` (1/s^2) and z w = `damping` (1/s), where exp(-z w dt) is `decay`.
    #[inline(always)]
    pub(crate) fn with_decay(
        stiffness: Lanes<S>,
        damping: Lanes<S>,
        dt: Lanes<S>,
        decay: Lanes<S>,
    ) -> Self {
        let square = (stiffness - damping * damping) * dt * dt;
        let (cosine, sine) = short_turn(square);
        let (mut cosine, mut sine) = (decay * cosine, decay * dt * sine);
        let is_short = square.abs().at_most(square.like(SHORT_TURN_SQUARED));
        if !is_short.all() {
            for lane in 0..S::F64_LANES {
                if SHORT_TURN_SQUARED < square.get(lane).abs() {
                    let own = [stiffness.get(lane), damping.get(lane)];
                    let (own_cosine, own_sine) = long_turn(own, dt.get(lane), decay.get(lane));
                    cosine.set(lane, own_cosine);
                    sine.set(lane, own_sine);
                }
            }
        }
        Self { stiffness, damping, cosine, sine }
    }

    /// exp(-`exponent`); exponents are not negative.
    ///
    /// Up to [`SHORT_DECAY`] it is the eighth power of the power series, whose first term left out is below 1e-17.
    #[inline(always)]
    pub(crate) fn decay(exponent: Lanes<S>) -> Lanes<S> {
        let eighth = 0.125 * exponent;
        let root = series(eighth, [10.0, 9.0, 8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0]);
        let fourth_root = root * root;
        let square_root = fourth_root * fourth_root;
        let mut decay = square_root * square_root;
        if !exponent.at_most(exponent.like(SHORT_DECAY)).all() {
            for lane in 0..S::F64_LANES {
                let exponent = exponent.get(lane);
                if SHORT_DECAY < exponent {
                    decay.set(lane, (-exponent).exp());
                }
            }
        }
        decay
    }

    /// w^2 (1/s^2).
    #[inline(always)]
    pub(crate) fn stiffness(&self) -> Lanes<S> {
        self.stiffness
    }

    /// Position and velocity after the step.
    #[inline(always)]
    pub(crate) fn step(&self, place: Lanes<S>, velocity: Lanes<S>) -> (Lanes<S>, Lanes<S>) {
        let Self { stiffness, damping, cosine, sine } = *self;
        (
            place * cosine + (velocity + damping * place) * sine,
            velocity * cosine - (damping * velocity + stiffness * place) * sine,
        )
    }

    /// Position and velocity after a step that begins at 0 without velocity, while the place of rest is at 1.
    #[inline(always)]
    pub(crate) fn response(&self) -> (Lanes<S>, Lanes<S>) {
        let Self { stiffness, damping, cosine, sine } = *self;
        (1.0 - (cosine + damping * sine), stiffness * sine)
    }
}

#[cfg(test)]
mod tests {
    use super::{Oscillator, OscillatorLanes, SHORT_TURN_SQUARED, short_turn};
    use crate::lanes::Lanes;
    use pulp::Scalar;

    #[test]
    fn the_series_of_a_short_turn_are_the_functions() {
        for k in -50..=50 {
            let square = SHORT_TURN_SQUARED * f64::from(k) / 50.0;
            let p = square.abs().sqrt().max(f64::MIN_POSITIVE);
            let (cosine, sine) =
                if k < 0 { (p.cosh(), p.sinh() / p) } else { (p.cos(), p.sin() / p) };
            let (own_cosine, own_sine) = short_turn(Lanes::splat(Scalar, square));
            let (own_cosine, own_sine) = (own_cosine.get(0), own_sine.get(0));
            let error = (own_cosine - cosine).abs().max((own_sine - sine).abs());
            assert!(error < 4.0 * f64::EPSILON, "{square} {error}");
        }
    }

    #[test]
    fn the_series_of_a_decay_is_the_exponential() {
        for k in 0..=300 {
            let exponent = 0.01 * f64::from(k);
            let own = OscillatorLanes::decay(Lanes::splat(Scalar, exponent)).get(0);
            let error = (own / (-exponent).exp() - 1.0).abs();
            assert!(error < 16.0 * f64::EPSILON, "{exponent} {error}");
        }
    }

    #[test]
    fn side_by_side_oscillators_step_as_alone() {
        for (natural, ratio, dt) in [(300.0, 0.2, 1e-3), (300.0, 0.2, 1e-2), (80.0, 3.0, 2e-2)] {
            let of = |value: f64| Lanes::splat(Scalar, value);
            let (stiffness, damping) = (natural * natural, ratio * natural);
            let decay = OscillatorLanes::decay(of(damping * dt));
            let own = OscillatorLanes::with_decay(of(stiffness), of(damping), of(dt), decay);
            let (place, velocity) = own.step(of(0.3), of(-7.0));
            let (want_place, want_velocity) = Oscillator::new(natural, ratio, dt).step(0.3, -7.0);
            assert!((place.get(0) - want_place).abs() < 1e-14, "{natural} {ratio} {dt}");
            assert!((velocity.get(0) - want_velocity).abs() < 1e-11, "{natural} {ratio} {dt}");
            let (from_rest, _) = own.step(of(-1.0), of(0.0));
            assert!((own.response().0.get(0) - 1.0 - from_rest.get(0)).abs() < 1e-15);
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
