//! Covariance of least-squares estimates that holds under correlation within blocks and uneven variance (the sandwich of
//! Liang and Zeger, Biometrika 73, 1986, with blocks of time as clusters).

use super::{
    super::evidence::Blocks,
    normal::{HOLD, Normal},
};

/// Covariance of the parameters at one linearization, in the units of its columns.
pub(in crate::gap) struct Sandwich {
    /// Variance of each estimate.
    pub(in crate::gap) variances: Vec<f64>,
    /// Step of least squares from here.
    pub(in crate::gap) step: Vec<f64>,
    /// Degrees of freedom: blocks less parameters.
    pub(in crate::gap) freedom: f64,
    /// `true` for each parameter that the data hardly determine.
    pub(in crate::gap) undetermined: Vec<bool>,
}

impl Sandwich {
    /// Of `columns` and `residual`, with errors that depend on each other within `blocks`.
    #[must_use]
    pub(in crate::gap) fn new(columns: &[Vec<f64>], residual: &[f64], blocks: &Blocks) -> Self {
        let normal = Normal::new(columns, residual);
        let inverse = normal.inverse();
        let count = columns.len();
        let scores = blocks.sums(columns, residual);
        let used = scores.iter().filter(|score| score.iter().any(|value| *value != 0.0)).count();
        let freedom = (used as f64 - count as f64).max(1.0);
        let correction = used as f64 / freedom.min(used as f64).max(1.0);
        let along = |i: usize, score: &[f64]| -> f64 {
            (0..count).map(|j| inverse[(i, j)] * score[j]).sum()
        };
        let variance =
            |i: usize| correction * scores.iter().map(|score| along(i, score).powi(2)).sum::<f64>();
        Self {
            variances: (0..count).map(variance).collect(),
            step: (0..count).map(|i| along(i, &normal.right)).collect(),
            freedom,
            // The held part of a parameter shows as a variance near one over the hold.
            undetermined: (0..count).map(|i| 0.01 / HOLD < inverse[(i, i)]).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{seed::Stream, stats::t_quantile};

    /// Relative tolerance against figures printed with nine digits.
    const PRINTED: f64 = 1e-6;

    #[test]
    fn clustered_variances_are_those_of_statsmodels() {
        // statsmodels 0.15: OLS(y, [1, x]).fit(cov_type='cluster', cov_kwds={'groups': repeat(arange(6), 2),
        // 'use_correction': False}): params, diag(cov_params())
        let x = [0.2, 1.1, -0.7, 0.5, 2.0, -1.3, 0.9, 0.1, -0.4, 1.6, -2.1, 0.8];
        let y = [1.3, 2.9, -0.2, 1.4, 5.1, -1.9, 2.2, 1.4, 0.6, 3.5, -3.2, 3.1];
        let columns = [vec![1.0; 12], x.to_vec()];
        let blocks = Blocks { of_row: (0..12).map(|row| row / 2).collect(), count: 6 };
        let estimates = Sandwich::new(&columns, &y, &blocks).step;
        let residual: Vec<f64> =
            (0..12).map(|row| y[row] - estimates[0] - estimates[1] * x[row]).collect();
        let found = Sandwich::new(&columns, &residual, &blocks);
        // Six blocks determine two parameters: the variance is that of four degrees of freedom.
        assert_eq!(found.freedom, 4.0);
        let correction = 6.0 / 4.0;
        for (index, (estimate, variance)) in
            [(0.919_106_15, 0.002_128_06), (1.915_083_8, 0.011_222_64)].into_iter().enumerate()
        {
            assert!((estimates[index] / estimate - 1.0).abs() < PRINTED, "{estimates:?}");
            let own = found.variances[index] / correction;
            assert!((own / variance - 1.0).abs() < 3.0 * PRINTED, "{own} {variance}");
        }
    }

    const FITS: u64 = 400;
    const BLOCKS: usize = 40;
    const ROWS_OF_BLOCK: usize = 25;
    const TRUTH: [f64; 2] = [2.0, -3.0];

    /// Measurements of a line, with errors that are shared within blocks and grow with the predictor.
    fn measured(seed: u64) -> (Vec<f64>, Vec<f64>) {
        let mut stream = Stream::new(seed, "sandwich");
        let mut normal =
            || -> f64 { (0..12).map(|_| f64::from(stream.uniform_f32(-0.5, 0.5))).sum() };
        let (mut x, mut y) = (Vec::new(), Vec::new());
        for _ in 0..BLOCKS {
            let (place, shared) = (normal(), normal());
            for _ in 0..ROWS_OF_BLOCK {
                let own = place + 0.5 * normal();
                x.push(own);
                y.push(
                    TRUTH[0] + TRUTH[1] * own + 0.5 * shared + (0.3 + 0.3 * own.abs()) * normal(),
                );
            }
        }
        (x, y)
    }

    #[test]
    fn nominal_95_percent_intervals_contain_the_truth_in_90_to_99_percent_of_fits() {
        let blocks = Blocks {
            of_row: (0..BLOCKS * ROWS_OF_BLOCK).map(|row| row / ROWS_OF_BLOCK).collect(),
            count: BLOCKS,
        };
        let mut hits = [0_u32; 2];
        for seed in 0..FITS {
            let (x, y) = measured(seed);
            let columns = [vec![1.0; x.len()], x];
            let estimates = Sandwich::new(&columns, &y, &blocks).step;
            let predicted = |row: usize| estimates[0] + estimates[1] * columns[1][row];
            let residual: Vec<f64> = y.iter().enumerate().map(|(k, y)| y - predicted(k)).collect();
            let found = Sandwich::new(&columns, &residual, &blocks);
            let quantile = t_quantile(0.975, found.freedom);
            for (index, hits) in hits.iter_mut().enumerate() {
                let half = quantile * found.variances[index].sqrt();
                *hits += u32::from((estimates[index] - TRUTH[index]).abs() < half);
            }
        }
        for hits in hits {
            let coverage = f64::from(hits) / FITS as f64;
            assert!((0.90..=0.99).contains(&coverage), "{coverage}");
        }
    }

    #[test]
    fn a_parameter_without_influence_is_undetermined() {
        let columns = [vec![1.0; 50], vec![0.0; 50]];
        let blocks = Blocks { of_row: (0..50).map(|row| row / 5).collect(), count: 10 };
        assert_eq!(Sandwich::new(&columns, &[0.1; 50], &blocks).undetermined, [false, true]);
    }
}
