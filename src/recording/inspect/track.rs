//! Signals over time, and the relation between two of them.

use super::super::table::Table;
use crate::units::Nanos;

/// Columns of a topic over time, without rows with non-finite values.
#[derive(Debug, Clone, Default)]
pub(super) struct Track<const N: usize> {
    /// Time since the recording's first message (s), never decreasing.
    pub(super) times_s: Vec<f64>,
    pub(super) values: Vec<[f64; N]>,
}

impl<const N: usize> Track<N> {
    /// Return the columns called `names`; empty when one is missing.
    pub(super) fn new(table: &Table, names: [&str; N], start: Nanos) -> Self {
        let columns: Vec<Vec<f64>> =
            names.iter().filter_map(|name| table.column(name)?.numbers()).collect();
        let mut track = Self { times_s: vec![], values: vec![] };
        if columns.len() < N {
            return track;
        }
        for (row, time) in table.log_time_ns.iter().enumerate() {
            let values = std::array::from_fn(|column| columns[column][row]);
            if values.iter().all(|value| value.is_finite()) {
                track.times_s.push(Nanos(*time).seconds_since(start));
                track.values.push(values);
            }
        }
        track
    }

    /// Return the smallest and largest value of column `at`; `None` when empty.
    pub(super) fn range(&self, at: usize) -> Option<(f64, f64)> {
        let values = || self.values.iter().map(|value| value[at]);
        Some((values().min_by(f64::total_cmp)?, values().max_by(f64::total_cmp)?))
    }

    /// Return the value in force at `time_s`, unless it is older than `max_age_s`.
    pub(super) fn held(&self, time_s: f64, max_age_s: f64) -> Option<[f64; N]> {
        let at = self.times_s.partition_point(|time| *time <= time_s).checked_sub(1)?;
        (time_s - self.times_s[at] <= max_age_s).then(|| self.values[at])
    }

    /// Interpolate the value at `time_s` between its neighbours, unless these are further apart
    /// than `max_interval_s`.
    pub(super) fn between(&self, time_s: f64, max_interval_s: f64) -> Option<[f64; N]> {
        let after = self.times_s.partition_point(|time| *time < time_s);
        let before = after.checked_sub(1)?;
        let (t0, t1) = (self.times_s[before], *self.times_s.get(after)?);
        if !(t1 - t0 <= max_interval_s && t0 < t1) {
            return None;
        }
        let fraction = (time_s - t0) / (t1 - t0);
        let (v0, v1) = (self.values[before], self.values[after]);
        Some(std::array::from_fn(|at| v0[at] + fraction * (v1[at] - v0[at])))
    }
}

/// Sums of products of `N` variables about their means.
#[derive(Debug, Clone)]
pub(super) struct Covariance<const N: usize> {
    pub(super) count: usize,
    /// Variances on the diagonal.
    pub(super) matrix: [[f64; N]; N],
}

impl<const N: usize> Covariance<N> {
    pub(super) fn new(rows: &[[f64; N]]) -> Self {
        let count = rows.len();
        let mut mean = [0.0; N];
        for row in rows {
            for at in 0..N {
                mean[at] += row[at] / count as f64;
            }
        }
        let mut matrix = [[0.0; N]; N];
        for row in rows {
            for i in 0..N {
                for j in 0..N {
                    matrix[i][j] += (row[i] - mean[i]) * (row[j] - mean[j]) / count as f64;
                }
            }
        }
        Self { count, matrix }
    }

    /// Return the standard deviation of variable `at`.
    pub(super) fn deviation(&self, at: usize) -> f64 {
        self.matrix[at][at].sqrt()
    }

    /// Return the slope of variable `of` on variable `on`, and the fraction of variance explained;
    /// zeros when `on` does not vary.
    pub(super) fn slope(&self, of: usize, on: usize) -> (f64, f64) {
        let (variance, shared) = (self.matrix[on][on], self.matrix[of][on]);
        if variance <= 0.0 || self.matrix[of][of] <= 0.0 {
            return (0.0, 0.0);
        }
        (shared / variance, shared * shared / (variance * self.matrix[of][of]))
    }

    /// Return the slopes of variable `of` on the variables 0 and 1 together, and the fraction of
    /// variance explained; `None` when the two are nearly collinear.
    pub(super) fn slopes(&self, of: usize) -> Option<([f64; 2], f64)> {
        /// Least determinant as a fraction of the product of both variances; below it the two are
        /// collinear.
        const MIN_DETERMINANT_FRACTION: f64 = 0.02;
        let m = &self.matrix;
        let determinant = m[0][0] * m[1][1] - m[0][1] * m[0][1];
        if determinant <= MIN_DETERMINANT_FRACTION * m[0][0] * m[1][1] || m[of][of] <= 0.0 {
            return None;
        }
        let first = (m[of][0] * m[1][1] - m[of][1] * m[0][1]) / determinant;
        let second = (m[of][1] * m[0][0] - m[of][0] * m[0][1]) / determinant;
        let explained = (first * m[of][0] + second * m[of][1]) / m[of][of];
        Some(([first, second], explained))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slopes_of_an_exact_relation_are_exact() {
        let rows: Vec<[f64; 3]> = (0..50)
            .map(|k| {
                let (a, b) = (f64::from(k % 7), f64::from(k % 5));
                [a, b, 2.0 * a - 0.5 * b + 3.0]
            })
            .collect();
        let covariance = Covariance::new(&rows);
        let ([a, b], explained) = covariance.slopes(2).unwrap();
        assert!((a - 2.0).abs() < 1e-9 && (b + 0.5).abs() < 1e-9, "{a} {b}");
        assert!((explained - 1.0).abs() < 1e-9);
        let same: Vec<[f64; 3]> = rows.iter().map(|row| [row[0], row[0], row[2]]).collect();
        assert!(Covariance::new(&same).slopes(2).is_none());
    }

    #[test]
    fn values_are_held_and_interpolated_within_reach_only() {
        let track = Track { times_s: vec![0.0, 1.0], values: vec![[1.0], [3.0]] };
        assert_eq!(track.held(0.5, 1.0), Some([1.0]));
        assert_eq!(track.held(2.5, 1.0), None);
        assert_eq!(track.held(-0.1, 1.0), None);
        assert_eq!(track.between(0.5, 1.0), Some([2.0]));
        assert_eq!(track.between(0.5, 0.9), None);
    }
}
