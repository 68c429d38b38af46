//! Levenberg and Marquardt's method on a [`Problem`], and intervals that hold under correlated noise.

use super::{
    problem::{Evaluated, Linear, Point, Problem, dot},
    whiten::{self, Filters},
};
use crate::{
    stats::t_quantile,
    twin::{Slot, Twin},
};
use faer::{Mat, linalg::solvers::Solve};

/// Relative gain of the squared error below which a fit has converged.
const CONVERGED: f64 = 1e-5;

/// Steps with corrected columns after one with fresh ones.
const SECANT_STEPS: usize = 2;

/// Most times that the damping is raised within one iteration.
const MOST_RETRIES: usize = 7;

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
///
/// Columns are simulated anew in each of the iterations; between them a few steps follow with columns that the last
/// step has corrected along itself (Broyden, Mathematics of Computation 19, 1965), which cost one simulation each;
/// not where nuisances move beside the parameters, whose bends would be taken for theirs.
#[must_use]
pub(super) fn fit_with(problem: &Problem<'_>, start: Point, slots: &[Slot], how: &How<'_>) -> Fit {
    let mut descent = Descent::new(problem, problem.evaluated(start), slots, how.filters);
    let has_nuisances = descent.at.point.nuisance.iter().any(|part| !part.is_empty());
    let iterations = if slots.is_empty() && !has_nuisances { 0 } else { how.iterations };
    let secant_steps = if has_nuisances { 0 } else { SECANT_STEPS };
    let mut columns = how.known.to_vec();
    for _ in 0..iterations {
        let before = descent.loss;
        let fresh = problem.columns(&descent.at, &slots[how.known.len()..], how.filters);
        columns.splice(how.known.len().., fresh);
        let mut leads_on = descent.step(&mut columns, MOST_RETRIES);
        for _ in 0..secant_steps {
            leads_on = leads_on && descent.step(&mut columns, 0);
        }
        if before - descent.loss < CONVERGED * before {
            break;
        }
    }
    Fit { point: descent.at.point, slots: slots.to_vec(), loss: descent.loss, rows: problem.rows() }
}

/// A fit under way.
struct Descent<'a, 'b> {
    problem: &'b Problem<'a>,
    slots: &'b [Slot],
    filters: &'b Filters,
    at: Evaluated,
    /// Whitened, where it is.
    residual: Vec<f64>,
    loss: f64,
    damping: f64,
}

impl<'a, 'b> Descent<'a, 'b> {
    fn new(
        problem: &'b Problem<'a>,
        at: Evaluated,
        slots: &'b [Slot],
        filters: &'b Filters,
    ) -> Self {
        let residual = problem.whitened_at(&at.prediction, filters);
        let loss = squared(&residual);
        Self { problem, slots, filters, at, residual, loss, damping: 1e-3 }
    }

    /// One step with `columns`, which are corrected by what it changed, more damped in up to so many `retries`;
    /// gives whether it led on.
    fn step(&mut self, columns: &mut [Vec<f64>], retries: usize) -> bool {
        let Self { problem, slots, filters, .. } = *self;
        let linear = problem.linear_of(&self.at, columns.to_vec(), filters);
        let normal = Normal::new(&linear).without_blocked(&self.at.point, slots);
        let damping = self.damping;
        for _ in 0..=retries {
            let step = normal.step(self.damping);
            let (moved, taken) = problem.moved(&self.at.point, slots, &step, &linear);
            let next = problem.evaluated(moved);
            let residual = problem.whitened_at(&next.prediction, filters);
            let loss = squared(&residual);
            if loss < self.loss {
                let gain = self.loss - loss;
                correct(columns, &taken, &linear, (&self.residual, &residual));
                (self.at, self.residual, self.loss) = (next, residual, loss);
                self.damping = (self.damping * 0.1).max(1e-9);
                return CONVERGED * self.loss <= gain;
            }
            self.damping = if self.damping < 1e-6 { 1e-4 } else { self.damping * 10.0 };
        }
        if retries == 0 {
            self.damping = damping;
        }
        false
    }
}

/// Broyden's correction of `columns` by a step `taken` (scaled), in which the whitened residual changed: what it
/// changed other than they say, and other than nuisances do, is theirs along the step.
fn correct(
    columns: &mut [Vec<f64>],
    taken: &[f64],
    linear: &Linear,
    (before, after): (&[f64], &[f64]),
) {
    let length = dot(taken, taken);
    if length == 0.0 {
        return;
    }
    let mut defect: Vec<f64> =
        before.iter().zip(after).map(|(before, after)| before - after).collect();
    for (column, step) in columns.iter().zip(taken) {
        for (defect, value) in defect.iter_mut().zip(column) {
            *defect -= step * value;
        }
    }
    linear.take_nuisances_from(&mut defect);
    for (column, step) in columns.iter_mut().zip(taken) {
        for (value, defect) in column.iter_mut().zip(&defect) {
            *value += defect * step / length;
        }
    }
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

/// The same by plain least squares, every signal in units of its RMS: what published tables hold.
#[must_use]
pub(super) fn plainly(problem: &Problem<'_>, found: &Fit) -> Fit {
    let scales = problem.filters(&found.point, whiten::scale_filters);
    fit(problem, found.point.clone(), &found.slots, &scales, 4)
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

/// `twin` on a problem that it was not fitted to: its nuisances from their first guesses, as [`adapt`] finds them.
#[must_use]
pub(super) fn on(problem: &Problem<'_>, twin: &Twin, filters: &Filters) -> Point {
    adapt(problem, problem.start(twin.clone()), filters)
}

/// `point` with its nuisances and what belongs to a session fitted alone, every signal in units of its RMS: where a
/// gap is told, a roll's start must not be chosen by a metric that looks past slow errors.
#[must_use]
pub(super) fn told(problem: &Problem<'_>, point: &Point) -> Point {
    let scales = problem.filters(point, whiten::scale_filters);
    adapt(problem, point.clone(), &scales)
}

/// Sum of squares; infinite where a simulation has left the range of numbers, so that no comparison takes it
/// for the least.
#[must_use]
pub(super) fn squared(values: &[f64]) -> f64 {
    let sum = dot(values, values);
    if sum.is_finite() { sum } else { f64::INFINITY }
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

/// Standard errors that hold under correlation within blocks and uneven scatter (the sandwich of Liang
/// and Zeger, Biometrika 73, 1986, with blocks of time as clusters), and between sessions: where the
/// held-out session alone would give another value than scatter explains, half of what is beyond it is
/// the variance from session to session (DerSimonian and Laird, Controlled Clinical Trials 7, 1986, for
/// two studies), which one session does not show.
#[must_use]
pub(super) fn uncertainty(
    problem: &Problem<'_>,
    held_out: &Problem<'_>,
    (found, judged): (&Fit, &Point),
    filters: &Filters,
) -> Uncertainty {
    let own = Sandwich::new(problem, &found.point, &found.slots, filters);
    let other = (!held_out.parts.is_empty())
        .then(|| Sandwich::new(held_out, judged, &found.slots, filters));
    let mut standard_errors = Vec::with_capacity(found.slots.len());
    for (index, slot) in found.slots.iter().enumerate() {
        let effect = found.point.twin.instances[slot.instance].effect;
        let mut variance = own.variances[index];
        if let Some(other) = &other
            && !other.undetermined[index]
            && !effect.parameters[slot.parameter].per_session
        {
            variance += beyond(other.step[index], variance + other.variances[index]);
        }
        standard_errors.push(variance.sqrt() * found.point.twin.scale(*slot));
    }
    Uncertainty { standard_errors, freedom: own.freedom, undetermined: own.undetermined }
}

/// Variance that two estimates, `step` apart, tell of where their scatter has this variance.
fn beyond(step: f64, scatter: f64) -> f64 {
    0.5 * (step.powi(2) - scatter).max(0.0)
}

impl Uncertainty {
    /// The same where the model may be wrong: a right one gives the same values however its errors are
    /// weighed (Hausman, Econometrica 46, 1978). Where residuals that are merely scaled, not whitened, would
    /// give another value than scatter explains, half of what is beyond it is added to the variance, as
    /// between sessions.
    #[must_use]
    pub(super) fn whatever_the_metric(mut self, problem: &Problem<'_>, found: &Fit) -> Self {
        let scales = problem.filters(&found.point, whiten::scale_filters);
        let other = Sandwich::new(problem, &found.point, &found.slots, &scales);
        for (index, slot) in found.slots.iter().enumerate() {
            if !other.undetermined[index] {
                let variance = beyond(other.step[index], other.variances[index]);
                let error = &mut self.standard_errors[index];
                *error = error.hypot(variance.sqrt() * found.point.twin.scale(*slot));
            }
        }
        self
    }

    /// The same where one of several small effects is there that is not worth a name: `shifts` say how far each
    /// parameter would move beside each of them (scaled). An interval reaches as far as the largest of them.
    #[must_use]
    pub(super) fn whatever_is_beside(mut self, found: &Fit, shifts: &[&[f64]]) -> Self {
        let quantile = t_quantile(0.975, self.freedom);
        for (index, slot) in found.slots.iter().enumerate() {
            let own = shifts.iter().filter_map(|shift| shift.get(index));
            let largest = own.fold(0.0_f64, |most, shift| most.max(shift.abs()));
            let error = &mut self.standard_errors[index];
            *error = error.hypot(largest * found.point.twin.scale(*slot) / quantile);
        }
        self
    }
}

/// Correlations of the estimates of `found` on `problem`, from the Gauss-Newton covariance: the inverse of the normal
/// matrix. NaN for a parameter without influence.
#[must_use]
pub(super) fn correlations(problem: &Problem<'_>, found: &Fit, filters: &Filters) -> Vec<Vec<f64>> {
    let linear = problem.linear(&found.point, &found.slots, filters);
    let inverse = Normal::new(&linear).inverse();
    let count = found.slots.len();
    let scaled = |i: usize, j: usize| inverse[(i, j)] / (inverse[(i, i)] * inverse[(j, j)]).sqrt();
    (0..count).map(|i| (0..count).map(|j| scaled(i, j)).collect()).collect()
}

/// Covariance of the parameters on one problem, by blocks of time, in scaled units.
struct Sandwich {
    variances: Vec<f64>,
    /// What this problem alone would change.
    step: Vec<f64>,
    freedom: f64,
    undetermined: Vec<bool>,
}

impl Sandwich {
    fn new(problem: &Problem<'_>, point: &Point, slots: &[Slot], filters: &Filters) -> Self {
        let linear = problem.linear(point, slots, filters);
        let normal = Normal::new(&linear);
        let inverse = normal.inverse();
        let count = slots.len();
        let scores = linear.blocks.sums(&linear.columns, &linear.residual);
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
