//! Evidence for a change of the prediction, by blocks of time.
//!
//! Whitened residuals are still neither white nor homoscedastic: remaining colour and model errors make neighbouring
//! samples dependent. So the variance is always estimated from the sums over blocks of 0.5 s, never from samples. It
//! uses the residual *after* the change in question: an effect that acts strongly in few blocks is not its own noise.

use super::problem::dot;
use crate::stats::{f_tail, median, t_quantile};
use faer::{Mat, linalg::solvers::Solve};

/// Block of each row.
#[derive(Debug, Clone, Default)]
pub(super) struct Blocks {
    /// Block of each row.
    pub(super) of_row: Vec<usize>,
    /// Number of blocks.
    pub(super) count: usize,
}

impl Blocks {
    /// Blocks of one problem, followed by those of another.
    #[must_use]
    pub(super) fn joined([one, other]: &[Self; 2]) -> Self {
        let later = other.of_row.iter().map(|block| one.count + block);
        Self {
            of_row: one.of_row.iter().copied().chain(later).collect(),
            count: one.count + other.count,
        }
    }

    /// Sums of `columns[k] * residual` over each block: `[block][column]`.
    #[must_use]
    pub(super) fn sums(&self, columns: &[Vec<f64>], residual: &[f64]) -> Vec<Vec<f64>> {
        let mut sums = vec![vec![0.0; columns.len()]; self.count];
        for (k, column) in columns.iter().enumerate() {
            for (row, block) in self.of_row.iter().enumerate() {
                sums[*block][k] += column[row] * residual[row];
            }
        }
        sums
    }
}

/// Effective number of blocks that carry `energy`: the number over which it would be spread evenly.
fn effective(energy: impl Iterator<Item = f64> + Clone) -> f64 {
    let sum: f64 = energy.clone().sum();
    let squares: f64 = energy.map(|own| own * own).sum();
    if 0.0 < squares { sum * sum / squares } else { 0.0 }
}

/// Weight of the prior variance, in blocks.
const PRIOR_BLOCKS: f64 = 10.0;

/// Median of the square of a standard normal variable.
const MEDIAN_OF_SQUARE: f64 = 0.454_936_423_119_573;

/// Variance of scores, relative to white noise of unit variance, and its degrees of freedom.
struct Dispersion {
    value: f64,
    freedom: f64,
}

impl Dispersion {
    /// Dispersion of the scores of `columns` in the residual `rest`. Few active blocks determine their own variance
    /// poorly, so it is moderated by a prior from all rows (Smyth, Statistical Applications in Genetics and Molecular
    /// Biology 3, 2004). The prior is the mean square of the residual where the columns act, times the colour of the
    /// whole residual.
    fn of(columns: &[Vec<f64>], rest: &[f64], blocks: &Blocks, solved: &[f64]) -> Self {
        let scales: Vec<f64> =
            columns.iter().map(|own| 1.0 / dot(own, own).max(f64::MIN_POSITIVE)).collect();
        let mut energies = vec![0.0; blocks.count];
        let (mut local, mut sums, mut squares) = (0.0, energies.clone(), energies.clone());
        for (row, block) in blocks.of_row.iter().enumerate() {
            let own: f64 =
                columns.iter().zip(&scales).map(|(c, scale)| scale * c[row].powi(2)).sum();
            let square = rest[row] * rest[row];
            energies[*block] += own;
            local += own * square;
            sums[*block] += rest[row];
            squares[*block] += square;
        }
        let k = columns.len() as f64;
        let own: Vec<f64> = sums
            .iter()
            .zip(&squares)
            .filter(|(_, square)| 0.0 < **square)
            .map(|(sum, square)| sum * sum / square)
            .collect();
        let colour = (median(&own).unwrap_or(0.0) / MEDIAN_OF_SQUARE).max(1.0);
        let count = effective(energies.iter().copied());
        let active = (count - 1.0).max(0.0);
        let by_blocks = solved.iter().sum::<f64>() / k;
        let prior = colour * local / k;
        // The mean of squares over `count` blocks lost one degree of freedom to the fitted factor.
        let value = (count * by_blocks + PRIOR_BLOCKS * prior) / (active + PRIOR_BLOCKS);
        Self { value: value.max(1.0), freedom: active + PRIOR_BLOCKS }
    }
}

/// Least-squares projection of a residual onto a change of the prediction.
struct Projection {
    /// Change, the only column.
    change: [Vec<f64>; 1],
    /// Its square.
    energy: f64,
    /// Factor of the change in the residual.
    factor: f64,
    /// Residual less that part.
    rest: Vec<f64>,
}

impl Projection {
    /// Projection of the whitened residual `before` onto the change to `after`; `None` without a change.
    fn of(before: &[f64], after: &[f64]) -> Option<Self> {
        let change = [before.iter().zip(after).map(|(b, a)| b - a).collect::<Vec<f64>>()];
        let energy = dot(&change[0], &change[0]);
        if !(f64::MIN_POSITIVE < energy && energy.is_finite()) {
            return None;
        }
        let factor = dot(&change[0], before) / energy;
        let rest = without(&change, &[factor], before);
        Some(Self { change, energy, factor, rest })
    }

    /// Sum of the squared scores of all blocks.
    fn score_squares(&self, blocks: &Blocks) -> f64 {
        blocks.sums(&self.change, &self.rest).iter().map(|own| own[0] * own[0]).sum()
    }
}

/// Amplitude with which the data follow a change.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Amplitude {
    /// 1 where the data follow the full change, 0 where they do not follow it.
    pub(super) value: f64,
    /// Its standard error.
    pub(super) standard_error: f64,
    /// Its degrees of freedom.
    pub(super) freedom: f64,
}

impl Amplitude {
    /// Amplitude of the change from a prediction with the whitened residual `before` to one with `after`: its
    /// least-squares factor. The standard error is clustered by blocks, and at least that of white noise. This is the
    /// encompassing test of Davidson and MacKinnon (Econometrica 49, 1981).
    #[must_use]
    pub(super) fn of(before: &[f64], after: &[f64], blocks: &Blocks) -> Self {
        let Some(own) = Projection::of(before, after) else {
            return Self { value: 0.0, standard_error: f64::INFINITY, freedom: PRIOR_BLOCKS };
        };
        let scores = own.score_squares(blocks) / own.energy;
        let dispersion = Dispersion::of(&own.change, &own.rest, blocks, &[scores]);
        let standard_error = (dispersion.value / own.energy).sqrt();
        Self { value: own.factor, standard_error, freedom: dispersion.freedom }
    }

    /// Return whether it is above `least` at the one-sided `level`.
    #[must_use]
    pub(super) fn is_above(&self, least: f64, level: f64) -> bool {
        t_quantile(1.0 - level, self.freedom) * self.standard_error < self.value - least
    }
}

/// Gain of the Gaussian log score from one prediction to another, in natural logarithms, summed over all samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogScoreGain {
    /// Gain.
    pub value: f64,
    /// Standard error, clustered by blocks of time.
    pub standard_error: f64,
}

impl LogScoreGain {
    /// Gain from the whitened residual `before` to `after` under the residual `variance`: half of the difference of
    /// the squares over the variance. The standard error treats the sums over blocks as independent (Vuong,
    /// Econometrica 57, 1989; Diebold and Mariano, Journal of Business and Economic Statistics 13, 1995). `None` for
    /// fewer than two blocks.
    #[must_use]
    pub(super) fn of(
        before: &[f64],
        after: &[f64],
        variance: f64,
        blocks: &Blocks,
    ) -> Option<Self> {
        let mut sums = vec![0.0; blocks.count];
        for (row, block) in blocks.of_row.iter().enumerate() {
            sums[*block] +=
                (before[row] * before[row] - after[row] * after[row]) / (2.0 * variance);
        }
        let count = sums.len() as f64;
        let value: f64 = sums.iter().sum();
        let mean = value / count;
        let squares: f64 = sums.iter().map(|sum| (sum - mean).powi(2)).sum();
        let standard_error = (count / (count - 1.0) * squares).sqrt();
        let is_finite = value.is_finite() && standard_error.is_finite();
        (2 <= blocks.count && is_finite).then_some(Self { value, standard_error })
    }
}

/// Joint test that `columns` explain nothing of `residual`: F and its tail probability, of the better of two tests at
/// twice its probability. The first ([`by_explained`]) has the higher power for correct columns. The second
/// ([`by_agreement`]) has it for columns of which only the sign is correct: a nonlinear effect, linearized far away.
#[must_use]
pub(super) fn joint(columns: &[Vec<f64>], residual: &[f64], blocks: &Blocks) -> (f64, f64) {
    let (explained, agreed) =
        (by_explained(columns, residual, blocks), by_agreement(columns, residual, blocks));
    let best = if explained.1 <= agreed.1 { explained } else { agreed };
    (best.0, (2.0 * best.1).min(1.0))
}

/// Tail probability of the change from the whitened residual `before` to `after`, for which `count` parameters were fitted.
/// F is the squared error that it removes per parameter, over its variance between blocks.
#[must_use]
pub(super) fn p_value_of(before: &[f64], after: &[f64], count: usize, blocks: &Blocks) -> f64 {
    let Amplitude { standard_error, freedom, .. } = Amplitude::of(before, after, blocks);
    let change: f64 = before.iter().zip(after).map(|(b, a)| (b - a).powi(2)).sum();
    let explained = dot(before, before) - dot(after, after);
    let dispersion = standard_error.powi(2) * change;
    let f = explained / (count as f64 * dispersion);
    if f.is_finite() { f_tail(f, count as f64, freedom) } else { 1.0 }
}

/// Tail probability of the factor with which the data follow the change from the whitened residual `before` to `after`,
/// from a few long `blocks` alone. Their effective number determines the degrees of freedom (Carter, Schnepel and
/// Steigerwald, Review of Economics and Statistics 99, 2017).
#[must_use]
pub(super) fn p_value_by_long_blocks(before: &[f64], after: &[f64], blocks: &Blocks) -> f64 {
    let Some(own) = Projection::of(before, after) else { return 1.0 };
    let energies = blocks.sums(&own.change, &own.change[0]);
    let count = effective(energies.iter().map(|sum| sum[0]));
    let variance = count / (count - 1.0) * own.score_squares(blocks) / (own.energy * own.energy);
    let f = own.factor * own.factor / variance;
    if 1.0 < count && f.is_finite() { f_tail(f, 1.0, count - 1.0) } else { 1.0 }
}

/// Hotelling's one-sample test of zero mean for the correlations of the columns with the residual, block by block.
/// Every block has the same weight, independent of its residual.
fn by_agreement(columns: &[Vec<f64>], residual: &[f64], blocks: &Blocks) -> (f64, f64) {
    let squares = |own: &Vec<f64>| -> Vec<f64> {
        blocks.sums(std::slice::from_ref(own), own).iter().map(|sum| sum[0]).collect()
    };
    let sizes: Vec<Vec<f64>> = columns.iter().map(squares).collect();
    let errors = squares(&residual.to_vec());
    let strongest = sizes[0].iter().copied().fold(0.0, f64::max);
    let sums = blocks.sums(columns, residual);
    let active = (0..blocks.count).filter(|block| LEAST_ACTIVE * strongest < sizes[0][*block]);
    let correlations: Vec<Vec<f64>> = active
        .map(|block| {
            let scale = |k: usize| (sizes[k][block] * errors[block]).sqrt().max(f64::MIN_POSITIVE);
            sums[block].iter().enumerate().map(|(k, sum)| sum / scale(k)).collect()
        })
        .collect();
    mean_is_zero(&correlations)
}

/// Fraction of the strongest block's energy below which a column is inactive in a block.
const LEAST_ACTIVE: f64 = 1e-6;

/// Hotelling's one-sample test: F and its tail probability.
fn mean_is_zero(sample: &[Vec<f64>]) -> (f64, f64) {
    let count = sample.first().map_or(0, Vec::len);
    let (n, k) = (sample.len() as f64, count as f64);
    if count == 0 || n < k + 4.0 {
        return (0.0, 1.0);
    }
    let mean: Vec<f64> =
        (0..count).map(|i| sample.iter().map(|own| own[i]).sum::<f64>() / n).collect();
    let covariance = Mat::from_fn(count, count, |i, j| {
        let sum: f64 = sample.iter().map(|own| (own[i] - mean[i]) * (own[j] - mean[j])).sum();
        sum / (n - 1.0) * if i == j { 1.0 + 1e-9 } else { 1.0 } + if i == j { 1e-300 } else { 0.0 }
    });
    let right = Mat::from_fn(count, 1, |i, _| mean[i]);
    let solved = covariance.partial_piv_lu().solve(&right);
    let t2: f64 = n * (0..count).map(|i| mean[i] * solved[(i, 0)]).sum::<f64>();
    let f = t2 * (n - k) / (k * (n - 1.0));
    (f, f_tail(f, k, n - k))
}

/// Squared error that the columns explain, relative to that which blocks of the remaining residual would explain by
/// chance (first-order correction of Rao and Scott, Annals of Statistics 12, 1984).
fn by_explained(columns: &[Vec<f64>], residual: &[f64], blocks: &Blocks) -> (f64, f64) {
    let Some(factors) = least_squares(columns, residual) else { return (0.0, 1.0) };
    let rest = without(columns, &factors, residual);
    let explained = dot(residual, residual) - dot(&rest, &rest);
    if !explained.is_finite() {
        return (0.0, 1.0);
    }
    let k = columns.len();
    let scores = blocks.sums(columns, &rest);
    let meat = Mat::from_fn(k, k, |i, j| scores.iter().map(|own| own[i] * own[j]).sum::<f64>());
    let solved = gram(columns).partial_piv_lu().solve(&meat);
    let solved: Vec<f64> = (0..k).map(|i| solved[(i, i)]).collect();
    let dispersion = Dispersion::of(columns, &rest, blocks, &solved);
    let f = explained / k as f64 / dispersion.value;
    (f, f_tail(f, k as f64, dispersion.freedom))
}

/// `residual` less `factors` of `columns`.
#[must_use]
pub(super) fn without(columns: &[Vec<f64>], factors: &[f64], residual: &[f64]) -> Vec<f64> {
    let mut rest = residual.to_vec();
    for (column, factor) in columns.iter().zip(factors) {
        rest.iter_mut().zip(column).for_each(|(value, column)| *value -= factor * column);
    }
    rest
}

/// Least-squares factors of `columns` on `residual`; `None` without a solution.
#[must_use]
pub(super) fn least_squares(columns: &[Vec<f64>], residual: &[f64]) -> Option<Vec<f64>> {
    let gram = gram(columns);
    let count = columns.len();
    if count == 0 || (0..count).any(|i| !(0.0 < gram[(i, i)] && gram[(i, i)].is_finite())) {
        return None;
    }
    let right = Mat::from_fn(count, 1, |i, _| dot(&columns[i], residual));
    let solution = gram.partial_piv_lu().solve(&right);
    Some((0..count).map(|i| solution[(i, 0)]).collect())
}

/// Products of all pairs, with a very small ridge against collinear columns.
fn gram(columns: &[Vec<f64>]) -> Mat<f64> {
    Mat::from_fn(columns.len(), columns.len(), |i, j| {
        dot(&columns[i], &columns[j]) * if i == j { 1.0 + 1e-9 } else { 1.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::Stream;

    const ROWS: usize = 4000;
    const BLOCKS: usize = 80;

    fn blocks() -> Blocks {
        Blocks { of_row: (0..ROWS).map(|row| row * BLOCKS / ROWS).collect(), count: BLOCKS }
    }

    /// Standard normal numbers (sums of twelve uniform ones), autoregressive with the coefficient `memory`.
    fn noise(seed: u64, memory: f64) -> Vec<f64> {
        let mut stream = Stream::new(seed, "evidence");
        let mut last = 0.0;
        (0..ROWS)
            .map(|_| {
                let fresh: f64 = (0..12).map(|_| f64::from(stream.uniform_f32(-0.5, 0.5))).sum();
                last = memory * last + (1.0 - memory * memory).sqrt() * fresh;
                last
            })
            .collect()
    }

    #[test]
    fn an_effect_in_few_blocks_is_seen() {
        let active = |row: usize| (row * BLOCKS / ROWS).is_multiple_of(10);
        let change: Vec<f64> =
            (0..ROWS)
                .map(|row| {
                    if active(row) {
                        (row as f64 * 0.3).sin() * (1 + row / 400) as f64
                    } else {
                        0.0
                    }
                })
                .collect();
        let after = noise(1, 0.0);
        let before: Vec<f64> = after.iter().zip(&change).map(|(a, c)| a + c).collect();
        let found = Amplitude::of(&before, &after, &blocks());
        assert!((found.value - 1.0).abs() < 0.05, "{found:?}");
        assert!(found.is_above(0.5, 1e-3));
        let (f, p) = joint(&[change], &before, &blocks());
        assert!(100.0 < f && p < 1e-4, "{f} {p}");
    }

    #[test]
    fn a_log_score_gain_is_half_of_the_squares_and_has_the_error_of_its_blocks() {
        let after = noise(5, 0.0);
        let before: Vec<f64> = noise(6, 0.0).iter().zip(&after).map(|(b, a)| a + 0.3 * b).collect();
        let found = LogScoreGain::of(&before, &after, 2.0, &blocks()).unwrap();
        let squares = |rows: &[f64]| dot(rows, rows);
        assert!((found.value - (squares(&before) - squares(&after)) / 4.0).abs() < 1e-9);
        // One sample gains (2 a b c + c^2 b^2) / 4 with c = 0.3: variance (4 c^2 + 2 c^4) / 16.
        let error = (ROWS as f64 * (4.0 * 0.09 + 2.0 * 0.0081) / 16.0).sqrt();
        assert!((found.standard_error / error - 1.0).abs() < 0.2, "{found:?} {error}");
        assert!(LogScoreGain::of(&[], &[], 1.0, &Blocks::default()).is_none());
    }

    #[test]
    fn the_test_of_means_is_that_of_statsmodels() {
        // statsmodels 0.15: stats.multivariate.test_mvmean(sample): statistic, pvalue
        let sample = [
            [0.3, -0.1],
            [0.5, 0.2],
            [-0.2, 0.4],
            [0.7, 0.3],
            [0.1, -0.3],
            [0.4, 0.6],
            [0.2, 0.1],
            [0.6, -0.2],
        ];
        let (f, p) = mean_is_zero(&sample.map(Vec::from));
        assert!((f / 4.891_629_297_5 - 1.0).abs() < 1e-8, "{f}");
        assert!((p / 0.054_936_847_6 - 1.0).abs() < 1e-6, "{p}");
    }

    /// A test that takes the effect for noise has no power: the residual of the fit is the noise.
    #[test]
    fn a_fit_that_removes_nearly_everything_is_significant() {
        let change: Vec<f64> = (0..ROWS).map(|row| 30.0 * (row as f64 * 0.003).sin()).collect();
        let after = noise(7, 0.5);
        let before: Vec<f64> = after.iter().zip(&change).map(|(a, c)| a + c).collect();
        assert!(p_value_of(&before, &after, 2, &blocks()) < 1e-20);
        assert!(p_value_of(&after, &after, 2, &blocks()) == 1.0, "nothing was removed");
        assert!(p_value_of(&after, &before, 2, &blocks()) == 1.0, "more than before");
    }

    /// Each of eight motions has an error of its own, along what a drift would change. A drift grows through all of them.
    #[test]
    fn errors_of_few_motions_are_no_drift_by_long_blocks() {
        let long = Blocks { of_row: (0..ROWS).map(|row| row * 8 / ROWS).collect(), count: 8 };
        let signature = |row: usize| (0.3 * row as f64).sin();
        let drift: Vec<f64> =
            (0..ROWS).map(|row| signature(row) * row as f64 / ROWS as f64).collect();
        const TRIALS: usize = 300;
        let (mut by_short, mut by_long, mut found) = (0, 0, 0);
        for seed in 0..TRIALS as u64 {
            let mut stream = Stream::new(seed, "motions");
            let errors: Vec<f64> =
                (0..8).map(|_| f64::from(stream.uniform_f32(-1.0, 1.0))).collect();
            let white = noise(seed, 0.0);
            let error = |row: usize| white[row] + errors[row * 8 / ROWS] * signature(row);
            let p_values = |size: f64| {
                let before: Vec<f64> =
                    (0..ROWS).map(|row| error(row) + size * drift[row]).collect();
                let columns = [drift.clone()];
                let factors = least_squares(&columns, &before).unwrap();
                let after = without(&columns, &factors, &before);
                let short = p_value_of(&before, &after, 1, &blocks());
                [short, p_value_by_long_blocks(&before, &after, &long)]
            };
            let [short, few] = p_values(0.0).map(|p_value| usize::from(p_value < 0.01));
            by_short += short;
            by_long += few;
            found += usize::from(p_values(30.0)[1] < 1e-4);
        }
        assert!(TRIALS / 4 < by_short, "short blocks take errors of motions for drift: {by_short}");
        assert!(by_long <= 12, "{by_long} of {TRIALS}");
        assert_eq!(found, TRIALS, "a drift of thirty times the errors");
    }

    #[test]
    fn coloured_noise_alone_is_rarely_an_effect() {
        let trials = 400;
        let (mut named, mut joined, mut fitted) = (0, 0, 0);
        for seed in 0..trials {
            let residual = noise(2 * seed, 0.7);
            let columns = [noise(2 * seed + 1, 0.7), noise(9000 + seed, 0.9)];
            let after: Vec<f64> =
                residual.iter().zip(&columns[0]).map(|(r, c)| r - 0.1 * c).collect();
            named += usize::from(Amplitude::of(&residual, &after, &blocks()).is_above(0.0, 0.01));
            joined += usize::from(joint(&columns, &residual, &blocks()).1 < 0.01);
            let factors = least_squares(&columns, &residual).unwrap();
            let rest = without(&columns, &factors, &residual);
            fitted += usize::from(p_value_of(&residual, &rest, 2, &blocks()) < 0.01);
        }
        assert!(named.max(joined).max(fitted) <= 12, "{named} {joined} {fitted} of {trials}");
        assert!(0 < named + joined, "a test at one in a hundred that never errs tests nothing");
    }
}
