//! Running mean and variance, and the normalization from them.
//!
//! Two sets of `n_a` and `n_b` rows are merged by Chan, Golub and LeVeque, "Algorithms for
//! Computing the Sample Variance" (1983), equation 2.1: with `d = mean_b - mean_a`,
//! `mean = mean_a + d n_b / n` and `M2 = M2_a + M2_b + d^2 n_a n_b / n`. The variance is
//! `M2 / n`. All in double precision.

use super::Normalization;
use crate::nn::Standardizer;

/// Count, mean and sum of squared deviations of each column.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Rows seen, a whole number.
    pub count: f64,
    /// `[columns]`
    pub mean: Vec<f64>,
    /// Sum of squared deviations from the mean, `[columns]`.
    pub squares: Vec<f64>,
}

impl Moments {
    /// No rows.
    #[must_use]
    pub fn new(columns: usize) -> Self {
        Self { count: 0.0, mean: vec![0.0; columns], squares: vec![0.0; columns] }
    }

    /// Moments of `rows`, `[rows][columns]`, in two passes.
    #[must_use]
    pub fn of_rows(rows: &[f32], columns: usize) -> Self {
        let mut moments = Self::new(columns);
        let count = rows.len() / columns;
        if count == 0 {
            return moments;
        }
        moments.count = count as f64;
        for row in rows.chunks_exact(columns) {
            for (sum, value) in moments.mean.iter_mut().zip(row) {
                *sum += f64::from(*value);
            }
        }
        for mean in &mut moments.mean {
            *mean /= count as f64;
        }
        for row in rows.chunks_exact(columns) {
            let columns = moments.squares.iter_mut().zip(&moments.mean);
            for ((squares, mean), value) in columns.zip(row) {
                *squares += (f64::from(*value) - mean).powi(2);
            }
        }
        moments
    }

    /// Merge with the moments of other rows.
    pub fn merge(&mut self, other: &Self) {
        let total = self.count + other.count;
        if other.count < 1.0 {
            return;
        }
        let columns = self.mean.iter_mut().zip(&mut self.squares);
        for ((mean, squares), (other_mean, other_squares)) in
            columns.zip(other.mean.iter().zip(&other.squares))
        {
            let d = other_mean - *mean;
            *mean += d * other.count / total;
            *squares += other_squares + d * d * self.count * other.count / total;
        }
        self.count = total;
    }

    /// Population variance of each column; 1 without rows.
    #[must_use]
    pub fn variances(&self) -> Vec<f64> {
        let variance = |squares: &f64| if self.count < 1.0 { 1.0 } else { squares / self.count };
        self.squares.iter().map(variance).collect()
    }

    /// Normalization by the settings `normalization`. Without rows it only clips.
    #[must_use]
    pub fn standardizer(&self, normalization: Normalization) -> Standardizer {
        match normalization {
            Normalization::Off => Standardizer::identity(self.mean.len()),
            Normalization::Running { limit, epsilon } => {
                let scale = |variance: f64| (variance + f64::from(epsilon)).sqrt().recip() as f32;
                Standardizer {
                    mean: self.mean.iter().map(|mean| *mean as f32).collect(),
                    scale: self.variances().into_iter().map(scale).collect(),
                    limit,
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    #[test]
    fn batches_merge_to_the_moments_of_two_passes_over_all() {
        let mut stream = Stream::new(1, "rows");
        // One-pass formulas are inaccurate for a column far from zero.
        let rows: Vec<f32> = (0..3000)
            .map(|i| stream.uniform_f32(-1.0, 1.0) + if i % 3 == 0 { 4000.0 } else { 0.0 })
            .collect();
        let mut moments = Moments::new(3);
        let mut rest = rows.as_slice();
        for size in [1, 7, 400, 92, 500] {
            let (batch, left) = rest.split_at(3 * size);
            moments.merge(&Moments::of_rows(batch, 3));
            rest = left;
        }
        assert!(rest.is_empty());
        for column in 0..3 {
            let values = || rows.iter().skip(column).step_by(3).map(|v| f64::from(*v));
            let mean = values().sum::<f64>() / 1000.0;
            let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / 1000.0;
            assert!((moments.mean[column] - mean).abs() < 1e-9);
            assert!((moments.variances()[column] - variance).abs() < 1e-9);
        }
        // By hand: 1, 2, 6 have mean 3 and variance (4 + 1 + 9) / 3.
        let by_hand = Moments::of_rows(&[1.0, 2.0, 6.0], 1);
        assert!((by_hand.variances()[0] - 14.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn standardised_rows_are_centred_scaled_and_limited() {
        let moments = Moments::of_rows(&[1.0, 2.0, 6.0], 1);
        let running = Normalization::Running { limit: 1.5, epsilon: 1e-8 };
        let mut found = [0.0; 3];
        moments.standardizer(running).apply(&[3.0, 1.0, 60.0], &mut found);
        let deviation = (14.0f32 / 3.0).sqrt();
        for (found, expected) in found.iter().zip([0.0, -2.0 / deviation, 1.5]) {
            assert!((found - expected).abs() < 1e-6, "{found} {expected}");
        }
        moments.standardizer(Normalization::Off).apply(&[3.0, 1.0, 60.0], &mut found);
        assert_eq!(found, [3.0, 1.0, 60.0]);
    }
}
