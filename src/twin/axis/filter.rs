//! Zero-phase low-pass filters: forwards and backwards through second-order sections.

use std::f64::consts::PI;

/// Sections of the Butterworth filter that is run each way: half its order.
const BUTTERWORTH_SECTIONS: usize = 2;
/// Sections of the Chebyshev filter before samples are dropped: half its order.
const CHEBYSHEV_SECTIONS: usize = 4;
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

/// Zero-phase low-pass filter of second-order sections in series.
#[derive(Debug, Clone)]
pub(super) struct LowPass<const SECTIONS: usize> {
    sections: [Section; SECTIONS],
}

/// Filter of measured signals.
pub(super) type Smoothing = LowPass<BUTTERWORTH_SECTIONS>;

/// Filter before samples are dropped.
pub(super) type Decimation = LowPass<CHEBYSHEV_SECTIONS>;

impl Smoothing {
    /// Butterworth filter with the edge `share` (cycles per sample).
    pub(super) fn butterworth(share: f64) -> Self {
        Self::from_poles(share, 1.0, |angle| (-angle.sin(), angle.cos()))
    }
}

impl Decimation {
    /// Edge of [`before_decimation`](Self::before_decimation) (cycles per sample).
    pub(super) fn decimation_edge(factor: usize) -> f64 {
        0.5 * CHEBYSHEV_EDGE / factor as f64
    }

    /// Anti-aliasing filter before decimation by `factor`: Chebyshev of the first kind, whose
    /// highest gain is one.
    pub(super) fn before_decimation(factor: usize) -> Self {
        let epsilon = (10.0_f64.powf(0.1 * CHEBYSHEV_RIPPLE_DB) - 1.0).sqrt();
        let mu = (1.0 / epsilon).asinh() / (2 * CHEBYSHEV_SECTIONS) as f64;
        let lowest = 10.0_f64.powf(-0.05 * CHEBYSHEV_RIPPLE_DB);
        Self::from_poles(Self::decimation_edge(factor), lowest, |angle| {
            (-mu.sinh() * angle.sin(), mu.cosh() * angle.cos())
        })
    }
}

impl<const SECTIONS: usize> LowPass<SECTIONS> {
    /// Bilinear transform of an all-pole filter of two poles per section. `pole` gives the pole (1/s at an
    /// edge of 1 rad/s) of each angle in the upper half plane; `constant` is the gain at zero
    /// frequency.
    fn from_poles(share: f64, constant: f64, pole: impl Fn(f64) -> (f64, f64)) -> Self {
        let warped = (PI * share).tan();
        let share_of_gain = constant.powf(1.0 / SECTIONS as f64);
        let section = |k: usize| {
            let (re, im) = pole(PI * (2 * k + 1) as f64 / (4 * SECTIONS) as f64);
            let (re, im) = (re * warped, im * warped);
            // z = (1 + s)/(1 - s)
            let below = (1.0 - re).powi(2) + im * im;
            let a1 = -2.0 * (1.0 - re * re - im * im) / below;
            let a2 = ((1.0 + re).powi(2) + im * im) / below;
            Section { gain: share_of_gain * (1.0 + a1 + a2) / 4.0, a1, a2 }
        };
        Self { sections: std::array::from_fn(section) }
    }

    /// `values` filtered forwards and backwards; both ends are continued by point reflection.
    pub(super) fn apply(&self, values: &[f64]) -> Vec<f64> {
        let n = values.len();
        if n < 2 {
            return values.to_vec();
        }
        let margin = (3 * (2 * SECTIONS + 1)).min(n - 1);
        let mut long = Vec::with_capacity(n + 2 * margin);
        long.extend((1..=margin).rev().map(|k| 2.0 * values[0] - values[k]));
        long.extend_from_slice(values);
        long.extend((1..=margin).map(|k| 2.0 * values[n - 1] - values[n - 1 - k]));
        let mut forwards = Cascade::new(&self.sections, long[0]);
        long.iter_mut().for_each(|value| *value = forwards.next(*value));
        let mut backwards = Cascade::new(&self.sections, long[long.len() - 1]);
        long.iter_mut().rev().for_each(|value| *value = backwards.next(*value));
        long[margin..margin + n].to_vec()
    }
}

/// Sections in series and their state. Each waits for its own last value only, so the processor works on all of them
/// at once.
struct Cascade<'a, const SECTIONS: usize> {
    sections: &'a [Section; SECTIONS],
    /// What the values so far add to the next value of each section, and to the one after it.
    next: [f64; SECTIONS],
    later: [f64; SECTIONS],
}

impl<'a, const SECTIONS: usize> Cascade<'a, SECTIONS> {
    /// `sections`, started as if the value had been constant for long.
    fn new(sections: &'a [Section; SECTIONS], mut value: f64) -> Self {
        let [mut next, mut later] = [[0.0; SECTIONS]; 2];
        for (k, section) in sections.iter().enumerate() {
            let x = section.gain * value;
            value = 4.0 * x / (1.0 + section.a1 + section.a2);
            next[k] = value - x;
            later[k] = x - section.a2 * value;
        }
        Self { sections, next, later }
    }

    fn next(&mut self, mut value: f64) -> f64 {
        for (k, section) in self.sections.iter().enumerate() {
            let x = section.gain * value;
            value = x + self.next[k];
            self.next[k] = 2.0 * x - section.a1 * value + self.later[k];
            self.later[k] = x - section.a2 * value;
        }
        value
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

    fn gain<const SECTIONS: usize>(filter: &LowPass<SECTIONS>, frequency: f64) -> f64 {
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
        let filter = Smoothing::butterworth(0.1);
        assert!((gain(&filter, 0.1) - 0.5).abs() < 1e-3);
        assert!((gain(&filter, 0.01) - 1.0).abs() < 1e-3);
        assert!(gain(&filter, 0.3) < 1e-4);
    }

    #[test]
    fn decimation_keeps_its_band_and_nothing_that_folds() {
        let filter = Decimation::before_decimation(10);
        for frequency in [0.002, 0.02, 0.035] {
            let level = gain(&filter, frequency);
            assert!((0.988..1.001).contains(&level), "{frequency} {level}");
        }
        assert!(gain(&filter, 0.065) < 2e-3);
    }

    #[test]
    fn a_line_keeps_its_slope_to_the_ends() {
        let line: Vec<f64> = (0..200).map(|k| 3.0 + 0.5 * f64::from(k)).collect();
        for (x, y) in line.iter().zip(Smoothing::butterworth(0.1).apply(&line)) {
            assert!((x - y).abs() < 0.02, "{x} {y}");
        }
        assert!(derivative(&line, 0.5).iter().all(|slope| (slope - 1.0).abs() < 1e-12));
    }
}
