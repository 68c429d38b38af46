//! Estimator of the velocity in a drive: a critically damped phase-locked loop on the encoder.
//!
//! With the time constant T, its velocity is the true one behind two filters of first order, 1/(1 + s T)^2; ODrive states
//! the bandwidth 1/T as `encoder_bandwidth`. While the velocity changes at a constant rate, its response is known in
//! closed form (Åström and Murray 2021, Feedback Systems, section 6.3).

use crate::lanes::Lanes;
use pulp::Simd;

/// Least time constant (s): a shorter one does not change any result.
const LEAST_TIME: f64 = 1e-7;

/// Rate of the output (m/s^2) of an estimator with this `time_constant` (s) and lag of its second filter (m/s).
pub(super) fn rate(time_constant: f64, second_lag: f64) -> f64 {
    second_lag / time_constant.max(LEAST_TIME)
}

/// Estimators of one motor, of each plant.
#[derive(Debug, Clone, Copy)]
pub(super) struct Estimators<S: Simd> {
    /// Time constant (s), and its reciprocal (1/s).
    time: Lanes<S>,
    per_time: Lanes<S>,
}

/// Distance of the output of each filter behind its input (m/s of belt).
#[derive(Debug, Clone, Copy)]
pub(super) struct Lag<S: Simd> {
    pub(super) first: Lanes<S>,
    pub(super) second: Lanes<S>,
}

/// Output of the estimator relative to the true velocity at the start of a span, as far as it is known then. It is a
/// linear function of the acceleration over the span.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected<S: Simd> {
    /// Output without acceleration (m/s), and its increase with the acceleration (s).
    pub(super) output: Lanes<S>,
    pub(super) ahead: Lanes<S>,
    /// The same of the rate of the output: (m/s^2), and without a unit.
    pub(super) rate: Lanes<S>,
    pub(super) rate_ahead: Lanes<S>,
}

/// Fraction of a deviation that remains after half of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Half<S: Simd> {
    /// Length in time constants, and the fraction.
    length: Lanes<S>,
    remaining: Lanes<S>,
}

impl<S: Simd> Estimators<S> {
    /// Estimators with these `time_constants` (s).
    #[inline(always)]
    pub(super) fn new(time_constants: Lanes<S>) -> Self {
        let time = time_constants.max(time_constants.like(LEAST_TIME));
        Self { time, per_time: 1.0 / time }
    }

    /// Half of a step of `dt` seconds.
    #[inline(always)]
    pub(super) fn half(&self, dt: Lanes<S>) -> Half<S> {
        let length = 0.5 * dt * self.per_time;
        // exp(-x) by the reciprocal of the series of exp(x): within 1e-4 up to x = 1. For a filter that is far faster than
        // the step it goes to zero, as it must.
        let series = [6, 5, 4, 3, 2, 1]
            .into_iter()
            .fold(length.like(1.0), |sum, k| 1.0 + (1.0 / f64::from(k)) * length * sum);
        Half { length, remaining: 1.0 / series }
    }

    /// Output at the end of `half` of a step.
    #[inline(always)]
    pub(super) fn expected(&self, half: &Half<S>, lag: &Lag<S>) -> Expected<S> {
        let Half { length, remaining } = *half;
        let gone = 1.0 - remaining;
        let turned = length * remaining;
        let behind = lag.first * turned + lag.second * remaining;
        Expected {
            output: -(lag.first * remaining + behind),
            ahead: self.time * (length + turned - 2.0 * gone),
            rate: behind * self.per_time,
            rate_ahead: gone - turned,
        }
    }

    /// Lag after the step of which this is `half`, and in which the velocity `changed` (m/s).
    #[inline(always)]
    pub(super) fn after(&self, half: &Half<S>, lag: &Lag<S>, changed: Lanes<S>) -> Lag<S> {
        let length = 2.0 * half.length;
        let remaining = half.remaining * half.remaining;
        // Lag of each filter in steady acceleration.
        let steady = changed / length;
        let first = lag.first - steady;
        let second = lag.second - steady + first * length;
        Lag { first: steady + first * remaining, second: steady + second * remaining }
    }

    /// Integral (m) of what the output is behind the true velocity over a step with the lag `before` and `after` it, in
    /// which the velocity `changed` (m/s).
    #[inline(always)]
    pub(super) fn travelled(&self, [before, after]: [&Lag<S>; 2], changed: Lanes<S>) -> Lanes<S> {
        let first = changed - (after.first - before.first);
        let second = first - (after.second - before.second);
        self.time * (first + second)
    }
}

impl<S: Simd> Lag<S> {
    /// Distance of the output of the estimator behind the velocity (m/s of belt).
    #[inline(always)]
    pub(super) fn whole(&self) -> Lanes<S> {
        self.first + self.second
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pulp::Scalar;

    fn lanes(value: f64) -> Lanes<Scalar> {
        Lanes::splat(Scalar, value)
    }

    fn none() -> Lag<Scalar> {
        Lag { first: lanes(0.0), second: lanes(0.0) }
    }

    /// Velocity of an estimator with the time constant `time` (s) at the end of each step of `dt` seconds with these
    /// `rates` of the true velocity (m/s^2), by small steps of its equations `p' = v + 2 e / T`, `v' = e / T^2`.
    fn by_its_equations(time: f64, dt: f64, rates: &[f64]) -> Vec<f64> {
        let tiny = dt / 2000.0;
        let (mut true_position, mut true_velocity) = (0.0, 0.0);
        let (mut position, mut velocity) = (0.0, 0.0);
        let mut all = Vec::new();
        for rate in rates {
            for _ in 0..2000 {
                let error: f64 = true_position - position;
                position += tiny * (velocity + 2.0 * error / time);
                velocity += tiny * error / (time * time);
                true_position += tiny * true_velocity;
                true_velocity += tiny * rate;
            }
            all.push(velocity);
        }
        all
    }

    /// Rates of the velocity in each step (m/s^2).
    const RATES: [f64; 12] = [6.0, 6.0, -8.0, 3.0, 0.0, 0.0, 20.0, -20.0, 1.0, 0.0, 0.0, 0.0];

    #[test]
    fn the_output_is_that_of_a_phase_locked_loop() {
        for (time, dt) in [(1e-3, 1e-3), (2e-3, 5e-4), (3e-4, 4e-4)] {
            let estimators = Estimators::new(lanes(time));
            let (mut lag, mut velocity) = (none(), 0.0);
            let expected = by_its_equations(time, dt, &RATES);
            for (rate, expected) in RATES.iter().zip(expected) {
                let half = estimators.half(lanes(dt));
                lag = estimators.after(&half, &lag, lanes(rate * dt));
                velocity += rate * dt;
                let output = velocity - lag.whole().get(0);
                assert!(
                    (output - expected).abs() < 2e-4 * 20.0 * dt / 1e-3,
                    "{time}: {output} {expected}"
                );
            }
        }
    }

    #[test]
    fn a_whole_step_is_two_halves_and_the_expectation_comes_true() {
        let estimators = Estimators::new(lanes(8e-4));
        let lag = Lag { first: lanes(0.003), second: lanes(-0.002) };
        let (dt, rate) = (6e-4, 5.0);
        let once = estimators.after(&estimators.half(lanes(dt)), &lag, lanes(rate * dt));
        let quarter = estimators.half(lanes(0.5 * dt));
        let halfway = estimators.after(&quarter, &lag, lanes(0.5 * rate * dt));
        let twice = estimators.after(&quarter, &halfway, lanes(0.5 * rate * dt));
        assert!((once.first.get(0) - twice.first.get(0)).abs() < 1e-8);
        assert!((once.second.get(0) - twice.second.get(0)).abs() < 1e-8);
        let expected = estimators.expected(&estimators.half(lanes(dt)), &lag);
        let output = expected.output.get(0) + rate * expected.ahead.get(0);
        assert!((output - (0.5 * rate * dt - halfway.whole().get(0))).abs() < 1e-8);
        let slope = expected.rate.get(0) + rate * expected.rate_ahead.get(0);
        assert!((slope - halfway.second.get(0) / 8e-4).abs() < 1e-4, "{slope}");
        // The integral of the lag, by Simpson's rule.
        let behind = |own: &Lag<Scalar>| own.whole().get(0);
        let simpson = dt / 6.0 * (behind(&lag) + 4.0 * behind(&halfway) + behind(&once));
        let travelled = estimators.travelled([&lag, &once], lanes(rate * dt)).get(0);
        assert!((travelled - simpson).abs() < 1e-9, "{travelled} {simpson}");
    }

    #[test]
    fn without_a_time_constant_the_output_is_the_velocity() {
        let estimators = Estimators::new(lanes(0.0));
        let lag = estimators.after(&estimators.half(lanes(1e-3)), &none(), lanes(0.02));
        assert!(lag.whole().get(0).abs() < 1e-5);
        let expected = estimators.expected(&estimators.half(lanes(1e-3)), &lag);
        assert!((expected.ahead.get(0) - 5e-4).abs() < 1e-6 && expected.output.get(0).abs() < 1e-9);
        assert!((expected.rate_ahead.get(0) - 1.0).abs() < 1e-9);
    }
}
