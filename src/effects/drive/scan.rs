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
    /// Function from regressor and residual at the same samples to start values, the best first; `longest` is the
    /// longest period, in ranges of the regressor.
    pub propose: fn(regressor: &[f64], residual: &[f64], longest: f64) -> Vec<f64>,
}

/// Effects with a scanned parameter; the proposals replace that parameter in each probe.
pub static SCANS: &[(&Effect, Scan)] =
    &[(&RIPPLE_MOTOR, Scan { parameter: 2, regressor: Regressor::Position, propose: periods })];

/// Frequencies per spectral line width, so that no line falls between two of them.
const PER_LINE: f64 = 4.0;
/// Fewest samples of a periodogram.
const LEAST_SAMPLES: usize = 8;
/// Largest number of frequencies.
const MOST_FREQUENCIES: usize = 4000;
/// Fraction of the travel that a sample must move to count.
const MOVING: f64 = 1e-4;
/// Quantile of the steps between samples that counts as slow.
const SLOW: f64 = 0.02;
/// Largest number of proposed periods: by power, and as many again by power over the background.
const PROPOSALS: usize = 3;
/// Ratio of the frequencies of a line and of the ends of its background: the residual of a wrong base model is red, so a
/// line is compared with its octave.
const BACKGROUND: f64 = std::f64::consts::SQRT_2;

/// Periods of `residual` along `position`, the strongest first, in the unit of the position.
///
/// Lomb-Scargle periodogram with a floating mean (Lomb 1976, Scargle 1982): least squares of a sine, a
/// cosine and a constant at every frequency. The range is from `longest` travels to the
/// shortest period that the samples resolve where the motion is slow. Golden-section search refines
/// the strongest lines that are not neighbours. Empty where the position does not change.
#[must_use]
pub fn periods(position: &[f64], residual: &[f64], longest: f64) -> Vec<f64> {
    let (position, residual): (Vec<f64>, Vec<f64>) = position
        .iter()
        .zip(residual)
        .filter(|(q, r)| q.is_finite() && r.is_finite())
        .map(|(q, r)| (*q, *r))
        .unzip();
    let low = position.iter().copied().fold(f64::INFINITY, f64::min);
    let high = position.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let travel = high - low;
    if position.len() < LEAST_SAMPLES || travel <= 0.0 {
        return Vec::new();
    }
    let step = 1.0 / (PER_LINE * travel);
    let first = 1.0 / (longest * travel);
    let count = ((0.5 / slow_step(&position, travel) - first) / step) as usize;
    let count = count.clamp(1, MOST_FREQUENCIES);
    let samples = samples(&position, &residual);
    let powers: Vec<f64> =
        (0..count).map(|index| power(&samples, first + step * index as f64)).collect();
    let refine = |index: usize| {
        let middle = first + step * index as f64;
        let height = |frequency| power(&samples, frequency);
        1.0 / highest(height, middle - 0.9 * step, middle + step)
    };
    let mut lines = strongest(&powers);
    let standing_out = strongest(&over_background(&powers));
    lines.extend(
        standing_out.into_iter().filter(|line| is_apart(*line, &lines)).collect::<Vec<_>>(),
    );
    lines.into_iter().map(refine).collect()
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
        if is_apart(index, &lines) {
            lines.push(index);
        }
    }
    lines
}

/// Return whether a frequency is at least one line width from `lines`.
fn is_apart(index: usize, lines: &[usize]) -> bool {
    lines.iter().all(|line| PER_LINE <= line.abs_diff(index) as f64)
}

/// Powers over the median power of their octave.
fn over_background(powers: &[f64]) -> Vec<f64> {
    let ratio = |index: usize| {
        let place = 1.0 + index as f64;
        let (from, to) = ((place / BACKGROUND) as usize, (place * BACKGROUND) as usize);
        let octave = &powers[from.min(index)..to.clamp(index + 1, powers.len())];
        let background = quantile(octave, 0.5).unwrap_or(0.0);
        if 0.0 < background { powers[index] / background } else { 0.0 }
    };
    (0..powers.len()).map(ratio).collect()
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

/// Largest fraction of a period between a sample and its neighbours that shows the period: half of one is the limit
/// of any sampling.
const RESOLVED: f64 = 0.4;

/// One sample of a periodogram.
struct Sample {
    position: f64,
    residual: f64,
    /// Distance to the farther of its neighbours.
    step: f64,
}

fn samples(position: &[f64], residual: &[f64]) -> Vec<Sample> {
    let step = |k: usize| {
        let beside = [k.checked_sub(1), Some(k + 1)].into_iter().flatten();
        let beside = beside.filter_map(|other| position.get(other));
        beside.map(|other| (other - position[k]).abs()).fold(0.0, f64::max)
    };
    let pairs = position.iter().zip(residual).enumerate();
    pairs.map(|(k, (q, r))| Sample { position: *q, residual: *r, step: step(k) }).collect()
}

/// Sum of squares that a sinusoid of `frequency` explains beyond a constant, over the samples that resolve it.
fn power(samples: &[Sample], frequency: f64) -> f64 {
    let resolved = || samples.iter().filter(|own| own.step * frequency <= RESOLVED);
    let n = resolved().count() as f64;
    if n < LEAST_SAMPLES as f64 {
        return 0.0;
    }
    let mean = resolved().map(|own| own.residual).sum::<f64>() / n;
    let [mut s, mut c, mut ss, mut cc, mut sc, mut ys, mut yc] = [0.0; 7];
    for Sample { position: q, residual: r, .. } in resolved() {
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
        let found = periods(&position, &residual, 0.5);
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
        let found = periods(&position, &position.iter().map(wave).collect::<Vec<f64>>(), 0.5);
        assert!(found.iter().any(|period| (period / 0.0025 - 1.0).abs() < 1e-3), "{found:?}");
    }

    #[test]
    fn a_constant_position_has_no_period() {
        assert!(periods(&[0.1; 50], &[1.0; 50], 0.5).is_empty());
        assert!(periods(&[], &[], 0.5).is_empty());
    }
}
