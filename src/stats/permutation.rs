//! Permutation tests: significance of the difference between two groups.

use crate::seed::Stream;

/// Number of random permutations: the smallest p-value is one in ten thousand.
const PERMUTATIONS: usize = 9999;

/// Return the two-sided p-value of the difference of `statistic` between `a` and `b`. Under the
/// null hypothesis the groups are a random division of all their members (Good, "Permutation,
/// Parametric and Bootstrap Tests of Hypotheses", 3rd ed., section 3.2). The observed division
/// counts as one of the random ones. `None` when one of the groups has fewer than two members.
///
/// ```
/// use klasktron::stats::permutation_p;
/// let mean = |drawn: &[&f64]| drawn.iter().copied().sum::<f64>() / drawn.len() as f64;
/// let low = [1.0, 1.1, 0.9, 1.2, 1.0, 0.8];
/// let high = low.map(|value| value + 5.0);
/// assert!(permutation_p(&low, &high, 0, mean).unwrap() < 0.01);
/// assert!(0.5 < permutation_p(&low, &low, 0, mean).unwrap());
/// ```
pub fn permutation_p<T>(
    a: &[T],
    b: &[T],
    seed: u64,
    statistic: impl Fn(&[&T]) -> f64,
) -> Option<f64> {
    if a.len().min(b.len()) < 2 {
        return None;
    }
    let mut stream = Stream::new(seed, "permutation");
    let mut all: Vec<&T> = a.iter().chain(b).collect();
    let difference = |all: &[&T]| (statistic(&all[a.len()..]) - statistic(&all[..a.len()])).abs();
    let found = difference(&all);
    // Sums in another order differ in their last digits.
    let least = found - 1e-9 * found.abs();
    let as_large = (0..PERMUTATIONS)
        .filter(|_| {
            stream.shuffle(&mut all);
            least <= difference(&all)
        })
        .count();
    Some((as_large + 1) as f64 / (PERMUTATIONS + 1) as f64)
}

/// Return the p-values corrected for multiple comparisons (Holm, Scandinavian Journal of Statistics
/// 6, 1979).
#[must_use]
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut largest: f64 = 0.0;
    for (rank, idx) in order.into_iter().enumerate() {
        largest = largest.max(((p_values.len() - rank) as f64 * p_values[idx]).min(1.0));
        corrected[idx] = largest;
    }
    corrected
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn p_values_of_equal_groups_are_uniform() {
        let mean = |drawn: &[&f32]| drawn.iter().copied().sum::<f32>() as f64 / drawn.len() as f64;
        let small = (0..200)
            .filter(|seed| {
                let mut stream = Stream::new(*seed, "experiment");
                let mut draw = || (0..12).map(|_| stream.uniform_f32(0.0, 1.0)).collect::<Vec<_>>();
                let (a, b) = (draw(), draw());
                permutation_p(&a, &b, *seed, mean).unwrap() <= 0.1
            })
            .count();
        // 20 expected, standard deviation 4.2.
        assert!((8..=33).contains(&small), "{small} of 200");
    }

    #[test]
    fn holm_corrects_in_steps() {
        // By hand: 3 x 0.01, then max(0.03, 2 x 0.02), then max(0.04, 1 x 0.03).
        assert_eq!(holm(&[0.03, 0.01, 0.02]), [0.04, 0.03, 0.04]);
        assert_eq!(holm(&[0.9, 0.8]), [1.0, 1.0]);
    }
}
