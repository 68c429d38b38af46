//! Evidence by blocks of time: how sure it is that a change of the prediction is in the data.
//!
//! Residuals are whitened, and still neither white nor even: what is left of their colour and of the
//! simulation's own errors makes neighbouring samples depend on each other. So scatter is never counted
//! by samples but by the sums over blocks of 0.5 s, and always of the residual *after* the change in
//! question: an effect that acts strongly in few blocks is not its own noise.

use super::problem::dot;
use crate::stats::{f_tail, t_quantile};
use faer::{Mat, linalg::solvers::Solve};

/// Which block each row belongs to.
#[derive(Debug, Clone, Default)]
pub(super) struct Blocks {
    /// Block of each row.
    pub(super) of_row: Vec<usize>,
    /// How many blocks.
    pub(super) count: usize,
}

impl Blocks {
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

/// Number of blocks that carry `energy`, as if it were spread evenly over them.
fn effective(energy: impl Iterator<Item = f64> + Clone) -> f64 {
    let sum: f64 = energy.clone().sum();
    let squares: f64 = energy.map(|own| own * own).sum();
    if 0.0 < squares { sum * sum / squares } else { 0.0 }
}

/// How much of a change is in the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Amplitude {
    /// 1 where the data follow the change as it is, 0 where they do not know of it.
    pub(super) value: f64,
    /// Its standard error.
    pub(super) standard_error: f64,
    /// Degrees of freedom of that.
    pub(super) freedom: f64,
}

impl Amplitude {
    /// Of the change from a prediction with the whitened residual `before` to one with `after`: the
    /// least-squares factor of the change, its error by blocks and at least that of white noise (the
    /// encompassing test of Davidson and MacKinnon, Econometrica 49, 1981, with clustered errors).
    #[must_use]
    pub(super) fn of(before: &[f64], after: &[f64], blocks: &Blocks) -> Self {
        let change: Vec<f64> = before.iter().zip(after).map(|(b, a)| b - a).collect();
        let energy = dot(&change, &change);
        if energy <= f64::MIN_POSITIVE {
            return Self { value: 0.0, standard_error: f64::INFINITY, freedom: 0.0 };
        }
        let value = dot(&change, before) / energy;
        let rest: Vec<f64> = before.iter().zip(&change).map(|(b, c)| b - value * c).collect();
        let columns = [change];
        let scores = blocks.sums(&columns, &rest);
        let energies = blocks.sums(&columns, &columns[0]);
        let count = effective(energies.iter().map(|own| own[0]));
        let scatter: f64 = scores.iter().map(|own| own[0] * own[0]).sum();
        let correction = if 1.0 < count { count / (count - 1.0) } else { f64::INFINITY };
        let variance = (scatter * correction).max(energy) / (energy * energy);
        Self { value, standard_error: variance.sqrt(), freedom: (count - 1.0).max(0.0) }
    }

    /// Whether it is above `least` at the one-sided `level`.
    #[must_use]
    pub(super) fn is_above(&self, least: f64, level: f64) -> bool {
        1.0 <= self.freedom
            && t_quantile(1.0 - level, self.freedom) * self.standard_error < self.value - least
    }
}

/// Joint test that `columns` explain nothing of `residual`: F and its tail probability. The squared
/// error that they explain is compared with that which blocks of what is left would explain by chance
/// (first-order correction of Rao and Scott, Annals of Statistics 12, 1984), at least that of white
/// noise.
#[must_use]
pub(super) fn joint(columns: &[Vec<f64>], residual: &[f64], blocks: &Blocks) -> (f64, f64) {
    let Some(factors) = least_squares(columns, residual) else { return (0.0, 1.0) };
    let mut rest = residual.to_vec();
    for (column, factor) in columns.iter().zip(&factors) {
        rest.iter_mut().zip(column).for_each(|(value, column)| *value -= factor * column);
    }
    let explained = dot(residual, residual) - dot(&rest, &rest);
    let k = columns.len();
    let scores = blocks.sums(columns, &rest);
    let gram = gram(columns);
    let meat = Mat::from_fn(k, k, |i, j| scores.iter().map(|own| own[i] * own[j]).sum::<f64>());
    let solved = gram.partial_piv_lu().solve(&meat);
    let energies: Vec<f64> = (0..blocks.count).map(|_| 0.0).collect();
    let energies = columns.iter().fold(energies, |mut energies, column| {
        let whole = dot(column, column).max(f64::MIN_POSITIVE);
        for (row, block) in blocks.of_row.iter().enumerate() {
            energies[*block] += column[row] * column[row] / whole;
        }
        energies
    });
    let count = effective(energies.iter().copied());
    if count <= 2.0 || !explained.is_finite() {
        return (0.0, 1.0);
    }
    let dispersion = (0..k).map(|i| solved[(i, i)]).sum::<f64>() / k as f64 * count / (count - 1.0);
    let f = explained / k as f64 / dispersion.max(1.0);
    (f, f_tail(f, k as f64, count - 1.0))
}

/// Least-squares factors of `columns` on `residual`; `None` where there is nothing to solve.
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

/// Products of all pairs, with a trace of a ridge against columns that depend on each other.
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

    /// Standard normal numbers (sums of twelve uniform ones), each a share of the one before.
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
        let active = |row: usize| row * BLOCKS / ROWS % 10 == 0;
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
    fn coloured_noise_alone_is_rarely_an_effect() {
        let trials = 400;
        let (mut named, mut joined) = (0, 0);
        for seed in 0..trials {
            let residual = noise(2 * seed, 0.7);
            let columns = [noise(2 * seed + 1, 0.7), noise(9000 + seed, 0.9)];
            let after: Vec<f64> =
                residual.iter().zip(&columns[0]).map(|(r, c)| r - 0.1 * c).collect();
            named += usize::from(Amplitude::of(&residual, &after, &blocks()).is_above(0.0, 0.01));
            joined += usize::from(joint(&columns, &residual, &blocks()).1 < 0.01);
        }
        assert!(named <= 12 && joined <= 12, "{named} {joined} of {trials}");
        assert!(0 < named + joined, "a test at one in a hundred that never errs tests nothing");
    }
}
