//! Power spectral density of a residual: Welch's periodogram (P. Welch, IEEE Trans. Audio Electroacoust. 15,
//! 1967). Evenly spaced samples are divided into segments that overlap by half. Each segment is weighted with a Hann
//! window and transformed; the squared magnitudes are averaged. A plain discrete Fourier transform is fast enough at
//! these lengths.
//!
//! The density is one-sided and scaled so that its sum over all bins, times the width of a bin, is
//! the mean square of the weighted samples (Parseval). White noise of standard deviation s, sampled
//! at f Hz, has the density 2 s² / f at every frequency: that is the floor.

use std::f64::consts::TAU;

/// Lengths of a segment (samples), the one with the finest bins first.
const LENGTHS: [usize; 5] = [512, 256, 128, 64, 32];

/// Fewest segments over which a length is averaged; below it, the standard
/// deviation of a bin is as large as its value.
const LEAST_SEGMENTS: usize = 8;

/// The mean square per frequency of some stretches of one signal.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Spectrum {
    /// Width of a bin (Hz); bin `k` lies at `k` times this.
    pub(super) bin_hz: f64,
    /// Mean square per hertz in each bin, from 0 Hz to half the rate.
    pub(super) density: Vec<f64>,
    /// Number of averaged segments.
    pub(super) segments: usize,
}

/// Length of the segments for stretches of these lengths: the longest with enough segments.
pub(super) fn segment_length(stretches: &[usize]) -> Option<usize> {
    let segments = |length: usize| -> usize {
        stretches.iter().filter(|samples| length <= **samples).map(|n| 2 * n / length - 1).sum()
    };
    let enough = LENGTHS.into_iter().find(|length| LEAST_SEGMENTS <= segments(*length));
    enough.or_else(|| LENGTHS.into_iter().rev().find(|length| 0 < segments(*length)))
}

/// The spectrum of `stretches` in segments of `length` samples; `None` where all are shorter.
pub(super) fn spectrum(stretches: &[Vec<f64>], rate_hz: f64, length: usize) -> Option<Spectrum> {
    if length < 2 || rate_hz <= 0.0 {
        return None;
    }
    let window: Vec<f64> =
        (0..length).map(|k| 0.5 - 0.5 * (TAU * k as f64 / length as f64).cos()).collect();
    let power: f64 = window.iter().map(|weight| weight * weight).sum();
    let turn: Vec<(f64, f64)> =
        (0..length).map(|k| (TAU * k as f64 / length as f64).sin_cos()).collect();
    let mut density = vec![0.0; length / 2 + 1];
    let mut segments = 0;
    for stretch in stretches {
        let mut first = 0;
        while first + length <= stretch.len() {
            let weighted: Vec<f64> =
                stretch[first..first + length].iter().zip(&window).map(|(x, w)| x * w).collect();
            for (bin, sum) in density.iter_mut().enumerate() {
                *sum += squared_magnitude(&weighted, bin, &turn);
            }
            segments += 1;
            first += length / 2;
        }
    }
    if segments == 0 {
        return None;
    }
    for (bin, value) in density.iter_mut().enumerate() {
        let alone = bin == 0 || 2 * bin == length;
        *value *= if alone { 1.0 } else { 2.0 } / (rate_hz * power * segments as f64);
    }
    Some(Spectrum { bin_hz: rate_hz / length as f64, density, segments })
}

/// `|X_bin|²` of the discrete Fourier transform, with a table of sines and cosines of one turn.
fn squared_magnitude(values: &[f64], bin: usize, turn: &[(f64, f64)]) -> f64 {
    let (mut real, mut imaginary, mut at) = (0.0, 0.0, 0);
    for value in values {
        let (sine, cosine) = turn[at];
        real += value * cosine;
        imaginary -= value * sine;
        at = (at + bin) % turn.len();
    }
    real * real + imaginary * imaginary
}

/// Density of white noise of standard deviation `rms`, sampled at `rate_hz`.
pub(super) fn white(rms: f64, rate_hz: f64) -> f64 {
    2.0 * rms * rms / rate_hz
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    #[test]
    fn the_power_of_a_sine_lands_in_its_bin() {
        // 12 turns in 128 samples at 64 Hz: 6 Hz, bin 12; amplitude 3, so the mean square is 4.5.
        let wave: Vec<f64> =
            (0..1024).map(|k| 3.0 * (TAU * 12.0 * k as f64 / 128.0 + 0.4).sin()).collect();
        let found = spectrum(&[wave], 64.0, 128).unwrap();
        assert_eq!((found.bin_hz, found.segments), (0.5, 15));
        let top = (0..found.density.len())
            .max_by(|a, b| found.density[*a].total_cmp(&found.density[*b]))
            .unwrap();
        assert_eq!(top, 12);
        let near: f64 = found.density[11..=13].iter().sum::<f64>() * found.bin_hz;
        assert!((near - 4.5).abs() < 1e-9, "{near}");
    }

    #[test]
    fn all_bins_together_are_the_mean_square() {
        let mut stream = Stream::new(7, "spectrum");
        let noise: Vec<f64> = (0..64).map(|_| f64::from(stream.uniform_f32(-1.0, 1.0))).collect();
        let found = spectrum(std::slice::from_ref(&noise), 200.0, 64).unwrap();
        let weight = |k: usize| 0.5 - 0.5 * (TAU * k as f64 / 64.0).cos();
        let square: f64 = noise.iter().enumerate().map(|(k, x)| (weight(k) * x).powi(2)).sum();
        let power: f64 = (0..64).map(|k| weight(k).powi(2)).sum();
        let sum = found.density.iter().sum::<f64>() * found.bin_hz;
        assert!((sum - square / power).abs() < 1e-12, "{sum}");
    }

    #[test]
    fn white_noise_has_the_density_of_the_floor() {
        let mut stream = Stream::new(8, "spectrum");
        let noise: Vec<f64> =
            (0..20_000).map(|_| f64::from(stream.uniform_f32(-1.0, 1.0))).collect();
        let found = spectrum(&[noise], 100.0, 128).unwrap();
        let inner = &found.density[2..60];
        let mean = inner.iter().sum::<f64>() / inner.len() as f64;
        assert!((mean / white((1.0_f64 / 3.0).sqrt(), 100.0) - 1.0).abs() < 0.05, "{mean}");
    }

    #[test]
    fn short_stretches_get_short_segments() {
        assert_eq!(segment_length(&[5000]), Some(512));
        assert_eq!(segment_length(&[70; 20]), Some(64));
        assert_eq!(segment_length(&[40]), Some(32));
        assert_eq!(segment_length(&[20, 5]), None);
        assert_eq!(spectrum(&[vec![0.0; 20]], 100.0, 32), None);
    }
}
