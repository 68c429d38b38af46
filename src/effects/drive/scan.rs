//! Parameters that need a global search, because the cost has many local minima in them.

use super::ripple_motor::RIPPLE_MOTOR;
use crate::{
    effects::{Effect, Regressor},
    stats::quantile,
};
use std::f64::consts::TAU;

/// Global search over one parameter of an effect, in the residual of a twin.
#[derive(Debug, Clone, Copy)]
pub struct Scan {
    /// Index of the parameter.
    pub parameter: usize,
    /// Quantity in the first argument of `propose`.
    pub regressor: Regressor,
    /// Function from regressor and residual at the same samples to start values, the best first.
    pub propose: fn(regressor: &[f64], residual: &[f64]) -> Vec<f64>,
}

/// Effects with a scanned parameter; the proposals replace that parameter in each probe.
pub static SCANS: &[(&Effect, Scan)] =
    &[(&RIPPLE_MOTOR, Scan { parameter: 2, regressor: Regressor::Position, propose: periods })];

/// Frequencies per spectral line width, so that no line falls between two of them.
const PER_LINE: f64 = 4.0;
/// Largest number of frequencies.
const MOST_FREQUENCIES: usize = 4000;
/// Fraction of the travel that a sample must move to count.
const MOVING: f64 = 1e-4;
/// Quantile of the steps between samples that counts as slow.
const SLOW: f64 = 0.1;
/// Largest number of proposed periods.
const PROPOSALS: usize = 3;

/// Periods of `residual` along `position`, the strongest first, in the unit of the position.
///
/// Lomb-Scargle periodogram with a floating mean (Lomb 1976, Scargle 1982): least squares of a sine, a
/// cosine and a constant at every frequency. The range is from two periods in the travel to the
/// shortest period that the samples resolve where the motion is slow. Golden-section search refines
/// the strongest lines that are not neighbours. Empty where the position does not change.
#[must_use]
pub fn periods(position: &[f64], residual: &[f64]) -> Vec<f64> {
    let (position, residual): (Vec<f64>, Vec<f64>) = position
        .iter()
        .zip(residual)
        .filter(|(q, r)| q.is_finite() && r.is_finite())
        .map(|(q, r)| (*q, *r))
        .unzip();
    let low = position.iter().copied().fold(f64::INFINITY, f64::min);
    let high = position.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let travel = high - low;
    if position.len() < 8 || travel <= 0.0 {
        return Vec::new();
    }
    let step = 1.0 / (PER_LINE * travel);
    let first = 2.0 / travel;
    let count = ((0.5 / slow_step(&position, travel) - first) / step) as usize;
    let count = count.clamp(1, MOST_FREQUENCIES);
    let powers: Vec<f64> =
        (0..count).map(|index| power(&position, &residual, first + step * index as f64)).collect();
    let refine = |index: usize| {
        let middle = first + step * index as f64;
        let height = |frequency| power(&position, &residual, frequency);
        1.0 / highest(height, middle - step, middle + step)
    };
    strongest(&powers).into_iter().map(refine).collect()
}

/// Indices of the largest `powers`, the largest first, at least one line width apart: next to a line with a
/// distorted phase, its neighbour may be the true one.
fn strongest(powers: &[f64]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..powers.len()).collect();
    order.sort_by(|a, b| powers[*b].total_cmp(&powers[*a]));
    let mut lines: Vec<usize> = Vec::new();
    for index in order {
        if lines.len() == PROPOSALS {
            break;
        }
        if lines.iter().all(|line| PER_LINE <= line.abs_diff(index) as f64) {
            lines.push(index);
        }
    }
    lines
}

/// Distance between neighbouring samples where the motion is slow (m), which limits the resolved period.
fn slow_step(position: &[f64], travel: f64) -> f64 {
    let steps: Vec<f64> = position
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|step| MOVING * travel < *step)
        .collect();
    quantile(&steps, SLOW).unwrap_or(travel)
}

/// Sum of squares that a sinusoid of `frequency` and a constant explain.
fn power(position: &[f64], residual: &[f64], frequency: f64) -> f64 {
    let n = position.len() as f64;
    let mean = residual.iter().sum::<f64>() / n;
    let [mut s, mut c, mut ss, mut cc, mut sc, mut ys, mut yc] = [0.0; 7];
    for (q, r) in position.iter().zip(residual) {
        let (sine, cosine) = (TAU * frequency * q).sin_cos();
        s += sine;
        c += cosine;
        ss += sine * sine;
        cc += cosine * cosine;
        sc += sine * cosine;
        ys += (r - mean) * sine;
        yc += (r - mean) * cosine;
    }
    let (ss, cc, sc) = (ss - s * s / n, cc - c * c / n, sc - s * c / n);
    let determinant = ss * cc - sc * sc;
    if determinant <= 1e-9 * ss * cc {
        return 0.0;
    }
    (ys * ys * cc - 2.0 * ys * yc * sc + yc * yc * ss) / determinant
}

/// Maximum of the unimodal function `height` between `low` and `high`, by golden-section search.
fn highest(height: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    for _ in 0..40 {
        let span = GOLDEN * (high - low);
        let (left, right) = (high - span, low + span);
        if height(left) < height(right) { low = left } else { high = right }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_period_of_a_wave_is_found_between_the_frequencies_tried() {
        let position: Vec<f64> = (0..4000).map(|k| 0.1 * (1.0 - (k as f64 * 0.01).cos())).collect();
        let residual: Vec<f64> = position
            .iter()
            .enumerate()
            .map(|(k, q)| (TAU * q / 0.00731).sin() + 3.0 * q + ((k * 7919) % 13) as f64 / 13.0)
            .collect();
        let found = periods(&position, &residual);
        assert!(found.iter().any(|period| (period / 0.00731 - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_period_shorter_than_a_fast_step_shows_where_the_motion_is_slow() {
        // Seven tenths of the samples run at 4.7 mm a step, the rest at 0.3 mm.
        let mut position = vec![0.0];
        for k in 0..3000 {
            let step = if k % 1000 < 700 { 0.0047 } else { 0.0003 };
            let up = (k / 30) % 2 == 0;
            position.push(position[k] + if up { step } else { -step });
        }
        let wave = |q: &f64| (TAU * q / 0.0025).sin();
        let found = periods(&position, &position.iter().map(wave).collect::<Vec<f64>>());
        assert!(found.iter().any(|period| (period / 0.0025 - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_constant_position_has_no_period() {
        assert!(periods(&[0.1; 50], &[1.0; 50]).is_empty());
        assert!(periods(&[], &[]).is_empty());
    }
}
