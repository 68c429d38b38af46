//! Zero-phase low-pass filters: forwards and backwards through second-order sections.

use std::f64::consts::PI;

/// Order of the Butterworth filter that is run each way.
const BUTTERWORTH_ORDER: usize = 4;
/// Order of the Chebyshev filter before samples are dropped.
const CHEBYSHEV_ORDER: usize = 8;
/// Ripple of its pass band (dB).
const CHEBYSHEV_RIPPLE_DB: f64 = 0.05;
/// Its edge, as a fraction of the Nyquist frequency of the kept samples.
const CHEBYSHEV_EDGE: f64 = 0.8;

/// `g (1 + z^-1)^2 / (1 + a1 z^-1 + a2 z^-2)`.
#[derive(Debug, Clone, Copy)]
struct Section {
    gain: f64,
    a1: f64,
    a2: f64,
}

/// Zero-phase low-pass filter.
#[derive(Debug, Clone)]
pub(super) struct LowPass {
    sections: Vec<Section>,
}

impl LowPass {
    /// Butterworth filter with the edge `share` (cycles per sample).
    pub(super) fn butterworth(share: f64) -> Self {
        Self::from_poles(BUTTERWORTH_ORDER, share, 1.0, |angle| (-angle.sin(), angle.cos()))
    }

    /// Edge of [`before_decimation`](Self::before_decimation) (cycles per sample).
    pub(super) fn decimation_edge(factor: usize) -> f64 {
        0.5 * CHEBYSHEV_EDGE / factor as f64
    }

    /// Anti-aliasing filter before decimation by `factor`: Chebyshev of the first kind, whose
    /// highest gain is one.
    pub(super) fn before_decimation(factor: usize) -> Self {
        let epsilon = (10.0_f64.powf(0.1 * CHEBYSHEV_RIPPLE_DB) - 1.0).sqrt();
        let mu = (1.0 / epsilon).asinh() / CHEBYSHEV_ORDER as f64;
        let lowest = 10.0_f64.powf(-0.05 * CHEBYSHEV_RIPPLE_DB);
        Self::from_poles(CHEBYSHEV_ORDER, Self::decimation_edge(factor), lowest, |angle| {
            (-mu.sinh() * angle.sin(), mu.cosh() * angle.cos())
        })
    }

    /// Bilinear transform of an all-pole filter of even `order`. `pole` gives the pole (1/s at an
    /// edge of 1 rad/s) of each angle in the upper half plane; `constant` is the gain at zero
    /// frequency.
    fn from_poles(
        order: usize,
        share: f64,
        constant: f64,
        pole: impl Fn(f64) -> (f64, f64),
    ) -> Self {
        let warped = (PI * share).tan();
        let pairs = order / 2;
        let share_of_gain = constant.powf(1.0 / pairs as f64);
        let section = |k: usize| {
            let (re, im) = pole(PI * (2 * k + 1) as f64 / (2 * order) as f64);
            let (re, im) = (re * warped, im * warped);
            // z = (1 + s)/(1 - s)
            let below = (1.0 - re).powi(2) + im * im;
            let a1 = -2.0 * (1.0 - re * re - im * im) / below;
            let a2 = ((1.0 + re).powi(2) + im * im) / below;
            Section { gain: share_of_gain * (1.0 + a1 + a2) / 4.0, a1, a2 }
        };
        Self { sections: (0..pairs).map(section).collect() }
    }

    /// `values` filtered forwards and backwards; both ends are continued by point reflection.
    pub(super) fn apply(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        if n < 2 {
            return values.to_vec();
        }
        let margin = (3 * (2 * self.sections.len() + 1)).min(n - 1);
        let mut long = Vec::with_capacity(n + 2 * margin);
        long.extend((1..=margin).rev().map(|k| 2.0 * values[0] - values[k]));
        long.extend_from_slice(values);
        long.extend((1..=margin).map(|k| 2.0 * values[n - 1] - values[n - 1 - k]));
        for _ in 0..2 {
            for section in &self.sections {
                section.run(&mut long);
            }
            long.reverse();
        }
        long[margin..margin + n].to_vec()
    }
}

impl Section {
    /// One pass, started as if the first value had been constant for long.
    fn run(&self, values: &mut [f64]) {
        let Some(first) = values.first().copied() else { return };
        let constant = first * 4.0 * self.gain / (1.0 + self.a1 + self.a2);
        let mut later = self.gain * first - self.a2 * constant;
        let mut next = constant - self.gain * first;
        for value in values {
            let x = self.gain * *value;
            let y = x + next;
            next = 2.0 * x - self.a1 * y + later;
            later = x - self.a2 * y;
            *value = y;
        }
    }
}

/// Central differences of `values` that are `dt` apart; one-sided at the ends.
pub(super) fn derivative(values: &[f64], dt: f64) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    (0..values.len())
        .map(|k| {
            let (before, after) = (k.saturating_sub(1), (k + 1).min(last));
            let span = (after - before).max(1) as f64;
            (values[after] - values[before]) / (span * dt)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    fn gain(filter: &LowPass, frequency: f64) -> f64 {
        let wave: Vec<f64> = (0..4000).map(|k| (TAU * frequency * f64::from(k)).sin()).collect();
        let out = filter.apply(&wave);
        let (mut top, mut below) = (0.0, 0.0);
        for (x, y) in wave.iter().zip(&out).skip(1000).take(2000) {
            top += x * y;
            below += x * x;
        }
        top / below
    }

    #[test]
    fn both_ways_halve_the_power_twice_at_the_edge() {
        let filter = LowPass::butterworth(0.1);
        assert!((gain(&filter, 0.1) - 0.5).abs() < 1e-3);
        assert!((gain(&filter, 0.01) - 1.0).abs() < 1e-3);
        assert!(gain(&filter, 0.3) < 1e-4);
    }

    #[test]
    fn decimation_keeps_its_band_and_nothing_that_folds() {
        let filter = LowPass::before_decimation(10);
        for frequency in [0.002, 0.02, 0.035] {
            let level = gain(&filter, frequency);
            assert!((0.988..1.001).contains(&level), "{frequency} {level}");
        }
        assert!(gain(&filter, 0.065) < 2e-3);
    }

    #[test]
    fn a_line_keeps_its_slope_to_the_ends() {
        let line: Vec<f64> = (0..200).map(|k| 3.0 + 0.5 * f64::from(k)).collect();
        for (x, y) in line.iter().zip(LowPass::butterworth(0.1).apply(&line)) {
            assert!((x - y).abs() < 0.02, "{x} {y}");
        }
        assert!(derivative(&line, 0.5).iter().all(|slope| (slope - 1.0).abs() < 1e-12));
    }
}
