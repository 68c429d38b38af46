//! Normal equations of a linearized least-squares problem.

use super::super::problem::dot;
use faer::{Mat, linalg::solvers::Solve};

/// Weight of a parameter's start, against a whitened row, in units of its scale. It is enough to hold parameters that
/// the data do not determine, and far too small to bias the others.
pub(in crate::gap) const HOLD: f64 = 1e-6;

/// Normal equations of one linearization.
pub(in crate::gap) struct Normal {
    gram: Mat<f64>,
    /// Products of the columns with the residual.
    pub(in crate::gap) right: Vec<f64>,
}

impl Normal {
    /// Of `columns`, the derivatives of the prediction, and the `residual`, measured less predicted.
    #[must_use]
    pub(in crate::gap) fn new(columns: &[Vec<f64>], residual: &[f64]) -> Self {
        let count = columns.len();
        let mut gram = Mat::zeros(count, count);
        for i in 0..count {
            for j in i..count {
                let product = dot(&columns[i], &columns[j]);
                gram[(i, j)] = product;
                gram[(j, i)] = product;
            }
        }
        let right = columns.iter().map(|column| dot(column, residual)).collect();
        Self { gram, right }
    }

    /// The same without the parameters that are on a bound and would be pushed beyond it. `is_blocked` receives the
    /// index of a parameter and the product of its column with the residual.
    #[must_use]
    pub(super) fn without_blocked(mut self, is_blocked: impl Fn(usize, f64) -> bool) -> Self {
        let count = self.right.len();
        for k in 0..count {
            if is_blocked(k, self.right[k]) {
                self.right[k] = 0.0;
                for other in 0..count {
                    self.gram[(k, other)] = 0.0;
                    self.gram[(other, k)] = 0.0;
                }
            }
        }
        self
    }

    /// The step of least squares with Marquardt's scaling of the damping.
    #[must_use]
    pub(in crate::gap) fn step(&self, damping: f64) -> Vec<f64> {
        let count = self.right.len();
        if count == 0 {
            return Vec::new();
        }
        let left = Mat::from_fn(count, count, |i, j| {
            let own = self.gram[(i, j)];
            if i == j { own * (1.0 + damping) + HOLD } else { own }
        });
        let right = Mat::from_fn(count, 1, |i, _| self.right[i]);
        let solution = left.partial_piv_lu().solve(&right);
        let step: Vec<f64> = (0..count).map(|i| solution[(i, 0)]).collect();
        // A matrix that cannot be solved gives no step; more damping will.
        if step.iter().all(|change| change.is_finite()) { step } else { vec![0.0; count] }
    }

    /// Inverse of the normal matrix.
    #[must_use]
    pub(in crate::gap) fn inverse(&self) -> Mat<f64> {
        let count = self.right.len();
        let left =
            Mat::from_fn(count, count, |i, j| self.gram[(i, j)] + if i == j { HOLD } else { 0.0 });
        left.partial_piv_lu().solve(Mat::<f64>::identity(count, count))
    }

    /// Coefficients of the columns against another column: `inverse * products`.
    #[must_use]
    pub(in crate::gap) fn solve(&self, products: &[f64]) -> Vec<f64> {
        let inverse = self.inverse();
        (0..products.len())
            .map(|i| (0..products.len()).map(|j| inverse[(i, j)] * products[j]).sum())
            .collect()
    }
}
