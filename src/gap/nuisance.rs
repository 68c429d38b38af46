//! Numbers that belong to one run or session alone (where a roll began, a camera's offset), eliminated from
//! a linearised problem: their directions are taken out of residual and columns, and what they change with
//! a step of the shared parameters follows from a triangular system.

use super::problem::dot;

/// The nuisance columns of one group as Q R.
pub(super) struct Elimination {
    rows: std::ops::Range<usize>,
    q: Vec<Vec<f64>>,
    r: Vec<Vec<f64>>,
    /// Components of the residual along q before it was taken away.
    along_residual: Vec<f64>,
    /// The same for each shared column.
    along_columns: Vec<Vec<f64>>,
}

/// Orthonormalises `local` (modified Gram and Schmidt) and takes its directions out of the rows.
pub(super) fn eliminate(
    rows: std::ops::Range<usize>,
    mut local: Vec<Vec<f64>>,
    residual: &mut [f64],
    columns: &mut [Vec<f64>],
) -> Elimination {
    let count = local.len();
    let mut r = vec![vec![0.0; count]; count];
    for k in 0..count {
        let (done, rest) = local.split_at_mut(k);
        for (row, value) in r.iter_mut().zip(orthonormalise(&mut rest[0], done)) {
            row[k] = value;
        }
    }
    let take = |values: &mut [f64]| -> Vec<f64> {
        local
            .iter()
            .map(|q| {
                let along = dot(q, values);
                values.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
                along
            })
            .collect()
    };
    let along_residual = take(&mut residual[rows.clone()]);
    let along_columns = columns.iter_mut().map(|column| take(&mut column[rows.clone()])).collect();
    Elimination { rows, q: local, r, along_residual, along_columns }
}

/// Makes `own` a unit vector across all of `done`, or nothing if it depends on them: its components
/// along `done`, and the length that was left.
fn orthonormalise(own: &mut [f64], done: &[Vec<f64>]) -> Vec<f64> {
    let before = norm(own);
    let mut components = Vec::with_capacity(done.len() + 1);
    for q in done {
        let along = dot(q, own);
        own.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
        components.push(along);
    }
    let length = norm(own);
    if before == 0.0 || length <= 1e-9 * before {
        own.fill(0.0);
        components.push(0.0);
    } else {
        own.iter_mut().for_each(|value| *value /= length);
        components.push(length);
    }
    components
}

impl Elimination {
    /// Change of the group's numbers when the shared parameters change by `step` (scaled).
    #[must_use]
    pub(super) fn numbers(&self, step: &[f64]) -> Vec<f64> {
        let count = self.q.len();
        let mut right: Vec<f64> = (0..count)
            .map(|k| {
                let shared = step.iter().zip(&self.along_columns);
                let moved: f64 = shared.map(|(change, along)| change * along[k]).sum();
                self.along_residual[k] - moved
            })
            .collect();
        for k in (0..count).rev() {
            for j in k + 1..count {
                right[k] -= self.r[k][j] * right[j];
            }
            let pivot = self.r[k][k];
            right[k] = if pivot.abs() < 1e-12 { 0.0 } else { right[k] / pivot };
        }
        right
    }

    /// Takes this group's nuisance directions out of one more column.
    pub(super) fn take_from(&self, column: &mut [f64]) {
        let values = &mut column[self.rows.clone()];
        for q in &self.q {
            let along = dot(q, values);
            values.iter_mut().zip(q).for_each(|(value, q)| *value -= along * q);
        }
    }
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}
