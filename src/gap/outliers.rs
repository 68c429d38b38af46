//! Outliers of a sensor.

use crate::stats::{median, quantile};

/// Return for each value whether it is finite and no spike. A spike is farther from the median of its four neighbours
/// than `ratio` times the usual distance, while they agree with each other. No physics moves one sample alone.
#[must_use]
pub(super) fn without_spikes(values: &[f64], ratio: f64) -> Vec<bool> {
    let off: Vec<f64> = (0..values.len())
        .map(|k| {
            let near = [k.wrapping_sub(2), k.wrapping_sub(1), k + 1, k + 2];
            let beside: Vec<f64> = near
                .iter()
                .filter_map(|at| values.get(*at))
                .copied()
                .filter(|v| v.is_finite())
                .collect();
            match median(&beside) {
                Some(middle) if 3 <= beside.len() => (values[k] - middle).abs(),
                _ => 0.0,
            }
        })
        .collect();
    // In quiet signals most distances are one quantum. The limit is based on an upper quantile of the distances, so
    // that a coarse quantization does not make every step a spike.
    let usual = quantile(&off, 0.9).unwrap_or(0.0);
    values.iter().zip(&off).map(|(value, off)| value.is_finite() && *off <= ratio * usual).collect()
}
