//! Numbers of an effect that a screen must look for, because no small step leads to them.

use super::ripple_motor::RIPPLE_MOTOR;
use crate::{
    effects::{Effect, Regressor},
    stats::quantile,
};
use std::f64::consts::TAU;

/// How to propose values of one parameter of an effect from what a twin leaves unexplained.
#[derive(Debug, Clone, Copy)]
pub struct Scan {
    /// Which parameter.
    pub parameter: usize,
    /// What the first argument of `propose` is.
    pub regressor: Regressor,
    /// Regressor and residual at the same samples to values worth a probe, the best first.
    pub propose: fn(regressor: &[f64], residual: &[f64]) -> Vec<f64>,
}

/// Every effect with a number that must be scanned for; it replaces that number in each probe.
pub static SCANS: &[(&Effect, Scan)] =
    &[(&RIPPLE_MOTOR, Scan { parameter: 2, regressor: Regressor::Position, propose: periods })];

/// Frequencies per width of a line, so that no line falls between two of them.
const PER_LINE: f64 = 4.0;
/// Most frequencies that are tried.
const MOST_FREQUENCIES: usize = 4000;
/// Share of the travel that a sample must move to count, and the quantile of such steps that is slow.
const MOVING: f64 = 1e-4;
const SLOW: f64 = 0.1;
/// How many periods are proposed at most.
const PROPOSALS: usize = 3;

/// Periods of `residual` along `position`, the strongest first, in the unit of the position.
///
/// Least squares of a sine and a cosine beside a constant at every frequency from two periods in
/// the travel to the shortest that the samples resolve where the motion is slow (Lomb 1976, Scargle
/// 1982, with a floating mean); the strongest lines that are no neighbours of each other are refined
/// by golden sections.
/// Empty where the position does not move.
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

/// The highest of `powers`, the best first, a line apart at least: beside a line whose phase is distorted,
/// its neighbour may be the true one.
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

/// Way between neighbouring samples where the motion is slow: what passes in no time elsewhere is resolved
/// there.
fn slow_step(position: &[f64], travel: f64) -> f64 {
    let steps: Vec<f64> = position
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|step| MOVING * travel < *step)
        .collect();
    quantile(&steps, SLOW).unwrap_or(travel)
}

/// Sum of squares that a wave of `frequency` and a constant explain.
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

/// Where `height` is highest between `low` and `high`, where it has one top.
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
    fn what_does_not_move_has_no_period() {
        assert!(periods(&[0.1; 50], &[1.0; 50]).is_empty());
        assert!(periods(&[], &[]).is_empty());
    }
}
