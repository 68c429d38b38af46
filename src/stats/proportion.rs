//! Confidence interval of a proportion.

use super::Interval;

/// 97.5th percentile of the normal distribution.
const Z: f64 = 1.959_964;

/// Return the 95 % interval of the proportion of `hits` in `count` (Wilson, J. Am. Stat. Assoc. 22,
/// 1927, score interval); `None` for a count of zero.
///
/// ```
/// use klasktron::stats::wilson_ci95;
/// // 8 of 10, computed by hand: 0.490 to 0.943.
/// let interval = wilson_ci95(8, 10).unwrap();
/// assert!((interval.low - 0.490).abs() < 1e-3 && (interval.high - 0.943).abs() < 1e-3);
/// assert_eq!(wilson_ci95(0, 0), None);
/// ```
#[must_use]
pub fn wilson_ci95(hits: u64, count: u64) -> Option<Interval> {
    if count == 0 {
        return None;
    }
    let n = count as f64;
    let p = hits as f64 / n;
    let middle = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let whole = 1.0 + Z * Z / n;
    Some(Interval {
        low: ((middle - half) / whole).max(0.0),
        high: ((middle + half) / whole).min(1.0),
    })
}
