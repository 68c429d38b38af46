//! Samples of a sensor that no physics explains.

use crate::stats::{median, quantile};

/// Which values are finite and no spikes: a spike stands off from the median of its four neighbours
/// by more than `ratio` times the usual distance while they agree with each other: no physics moves one sample alone.
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
    // In quiet signals most distances are a quantum: the limit rests on the upper part of the
    // usual distances, so that a coarse grid does not make every step a spike.
    let usual = quantile(&off, 0.9).unwrap_or(0.0);
    values.iter().zip(&off).map(|(value, off)| value.is_finite() && *off <= ratio * usual).collect()
}
