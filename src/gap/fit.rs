//! Levenberg and Marquardt's method on a [`Problem`], and intervals that hold under correlated noise.

use super::{
    problem::{Linear, Point, Problem, dot},
    whiten::{self, Filters},
};
use crate::twin::Slot;
use faer::{Mat, linalg::solvers::Solve};

/// Relative gain of the squared error below which a fit has converged.
const CONVERGED: f64 = 1e-5;

/// Most times that the damping is raised within one iteration.
const MOST_RETRIES: usize = 8;

/// Weight of a parameter's start, against a whitened row, in units of its scale: enough to hold what
/// the data say nothing about, far too little to pull what they know.
const HOLD: f64 = 1e-6;

/// A fitted point.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Twin and nuisances.
    pub point: Point,
    /// The shared parameters that were fitted.
    pub slots: Vec<Slot>,
    /// Whitened squared error.
    pub loss: f64,
    /// Rows.
    pub rows: usize,
}

/// Fits `slots` from `start` in at most `iterations` steps, with the whitening of `filters`.
#[must_use]
pub(super) fn fit(
    problem: &Problem<'_>,
    start: Point,
    slots: &[Slot],
    filters: &Filters,
    iterations: usize,
) -> Fit {
    fit_with(problem, start, slots, &How { filters, iterations, known: &[] })
}

/// How to fit.
pub(super) struct How<'a> {
    /// The metric.
    pub(super) filters: &'a Filters,
    /// Most steps.
    pub(super) iterations: usize,
    /// Columns of the first parameters, where they are known from nearby.
    pub(super) known: &'a [Vec<f64>],
}

/// The same where the columns of the first parameters are known from nearby.
#[must_use]
pub(super) fn fit_with(problem: &Problem<'_>, start: Point, slots: &[Slot], how: &How<'_>) -> Fit {
    let How { filters, iterations, known } = *how;
    let mut point = start;
    let mut prediction = problem.prediction(&point);
    let mut loss = squared(&problem.whitened_at(&prediction, filters));
    let mut damping = 1e-3;
    for _ in 0..iterations {
        let linear = problem.linear_at(&point, &prediction, slots, filters, known);
        let normal = Normal::new(&linear).without_blocked(&point, slots);
        let mut improved = None;
        for _ in 0..MOST_RETRIES {
            let step = normal.step(damping);
            let next = problem.moved(&point, slots, &step, &linear);
            let predicted = problem.prediction(&next);
            let next_loss = squared(&problem.whitened_at(&predicted, filters));
            if next_loss < loss {
                improved = Some((next, predicted, next_loss));
                break;
            }
            damping = if damping < 1e-6 { 1e-4 } else { damping * 10.0 };
        }
        let Some((next, predicted, next_loss)) = improved else { break };
        let gain = (loss - next_loss) / loss.max(f64::MIN_POSITIVE);
        (point, prediction, loss) = (next, predicted, next_loss);
        damping = (damping * 0.1).max(1e-9);
        if gain < CONVERGED {
            break;
        }
    }
    Fit { point, slots: slots.to_vec(), loss, rows: problem.rows() }
}

/// Fits from far away: first with each signal merely scaled, then whitened by its own residual.
#[must_use]
pub(super) fn fit_from_afar(
    problem: &Problem<'_>,
    start: Point,
    slots: &[Slot],
    iterations: usize,
) -> (Fit, Filters) {
    let mut point = start;
    for _ in 0..3 {
        let scales = problem.filters(&point, whiten::scale_filters);
        let before = squared(&problem.whitened(&point, &scales));
        let found = fit(problem, point, slots, &scales, iterations);
        point = found.point;
        if 0.98 * before < found.loss {
            break;
        }
    }
    settle(problem, point, slots, iterations)
}

/// Fits from nearby: whitened by the residual, and again by the residual that is then left.
#[must_use]
pub(super) fn settle(
    problem: &Problem<'_>,
    start: Point,
    slots: &[Slot],
    iterations: usize,
) -> (Fit, Filters) {
    let mut filters = problem.filters(&start, whiten::fit_filters);
    let mut found = fit(problem, start, slots, &filters, iterations);
    filters = problem.filters(&found.point, whiten::fit_filters);
    found = fit(problem, found.point, slots, &filters, iterations);
    (found, filters)
}

/// Fits the nuisances, and what belongs to a session (the phase of a ripple), alone: how a twin that is
/// not touched otherwise predicts a session.
#[must_use]
pub(super) fn adapt(problem: &Problem<'_>, start: Point, filters: &Filters) -> Point {
    let Some(part) = problem.parts.first() else { return start };
    let own: Vec<Slot> = start
        .twin
        .free(part.stage)
        .into_iter()
        .filter(|slot| {
            let effect = start.twin.instances[slot.instance].effect;
            effect.parameters[slot.parameter].per_session
        })
        .collect();
    if own.is_empty() && problem.parts.iter().all(|part| part.stage.nuisance_groups().is_empty()) {
        return start;
    }
    fit(problem, start, &own, filters, 8).point
}

/// Sum of squares.
#[must_use]
pub(super) fn squared(values: &[f64]) -> f64 {
    dot(values, values)
}

/// Normal equations of one linearisation.
pub(super) struct Normal {
    gram: Mat<f64>,
    right: Vec<f64>,
}

impl Normal {
    /// Of all columns of `linear`.
    #[must_use]
    pub(super) fn new(linear: &Linear) -> Self {
        let count = linear.columns.len();
        let mut gram = Mat::zeros(count, count);
        for i in 0..count {
            for j in i..count {
                let product = dot(&linear.columns[i], &linear.columns[j]);
                gram[(i, j)] = product;
                gram[(j, i)] = product;
            }
        }
        let right = linear.columns.iter().map(|column| dot(column, &linear.residual)).collect();
        Self { gram, right }
    }

    /// The same without the parameters that stand on a bound and would be pushed beyond it.
    fn without_blocked(mut self, point: &Point, slots: &[Slot]) -> Self {
        for (k, slot) in slots.iter().enumerate() {
            let effect = point.twin.instances[slot.instance].effect;
            let (low, high) = effect.parameters[slot.parameter].bounds;
            let value = point.twin.get(*slot);
            let blocked =
                value <= low && self.right[k] < 0.0 || high <= value && 0.0 < self.right[k];
            if blocked {
                self.right[k] = 0.0;
                for other in 0..slots.len() {
                    self.gram[(k, other)] = 0.0;
                    self.gram[(other, k)] = 0.0;
                }
            }
        }
        self
    }

    /// The step of least squares with Marquardt's scaling of the damping.
    fn step(&self, damping: f64) -> Vec<f64> {
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
    pub(super) fn inverse(&self) -> Mat<f64> {
        let count = self.right.len();
        let left =
            Mat::from_fn(count, count, |i, j| self.gram[(i, j)] + if i == j { HOLD } else { 0.0 });
        left.partial_piv_lu().solve(Mat::<f64>::identity(count, count))
    }

    /// Coefficients of `columns` against another column: `inverse * products`.
    #[must_use]
    pub(super) fn solve(&self, products: &[f64]) -> Vec<f64> {
        let inverse = self.inverse();
        (0..products.len())
            .map(|i| (0..products.len()).map(|j| inverse[(i, j)] * products[j]).sum())
            .collect()
    }
}

/// Standard errors of the fitted values, in their own units, and the directions that the data do not
/// determine.
#[derive(Debug, Clone)]
pub struct Uncertainty {
    /// Standard error of each slot.
    pub standard_errors: Vec<f64>,
    /// Degrees of freedom of the block estimate.
    pub freedom: f64,
    /// Per slot: share of its variance that stems from directions the data hardly determine.
    pub undetermined: Vec<bool>,
}

/// The covariance that holds under correlation within blocks and uneven scatter (the sandwich of
/// Liang and Zeger, Biometrika 73, 1986, with blocks of time as clusters).
#[must_use]
pub(super) fn uncertainty(problem: &Problem<'_>, found: &Fit, filters: &Filters) -> Uncertainty {
    let linear = problem.linear(&found.point, &found.slots, filters);
    let normal = Normal::new(&linear);
    let inverse = normal.inverse();
    let count = found.slots.len();
    let scores = block_sums(&linear.columns, &linear.residual, &linear.blocks, linear.block_count);
    let used = scores.iter().filter(|score| score.iter().any(|value| *value != 0.0)).count();
    let freedom = (used as f64 - count as f64).max(1.0);
    let correction = used as f64 / freedom.min(used as f64).max(1.0);
    let mut standard_errors = Vec::with_capacity(count);
    let mut undetermined = Vec::with_capacity(count);
    for (i, slot) in found.slots.iter().enumerate() {
        let variance: f64 = scores
            .iter()
            .map(|score| {
                let moved: f64 = (0..count).map(|j| inverse[(i, j)] * score[j]).sum();
                moved * moved
            })
            .sum();
        let scale = found.point.twin.scale(*slot);
        standard_errors.push((variance * correction).sqrt() * scale);
        // The held part of a parameter shows as a variance near one over the hold.
        undetermined.push(0.01 / HOLD < inverse[(i, i)]);
    }
    Uncertainty { standard_errors, freedom, undetermined }
}

/// Sums of `columns[k] * residual` over each block: `[block][column]`.
#[must_use]
pub(super) fn block_sums(
    columns: &[Vec<f64>],
    residual: &[f64],
    blocks: &[usize],
    block_count: usize,
) -> Vec<Vec<f64>> {
    let mut sums = vec![vec![0.0; columns.len()]; block_count];
    for (k, column) in columns.iter().enumerate() {
        for (row, block) in blocks.iter().enumerate() {
            sums[*block][k] += column[row] * residual[row];
        }
    }
    sums
}
