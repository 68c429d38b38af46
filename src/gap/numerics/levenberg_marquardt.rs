//! Levenberg-Marquardt method (Marquardt, SIAM Journal on Applied Mathematics 11, 1963). Between steps with fresh
//! derivatives, the columns are corrected along the last step (Broyden, Mathematics of Computation 19, 1965).

use super::{super::problem::dot, normal::Normal};

/// Damping of the first step, in diagonal elements of the normal matrix.
const FIRST_DAMPING: f64 = 1e-3;

/// Damping below which a failed step does not continue from the last damping but from [`RAISED_DAMPING`].
const LOW_DAMPING: f64 = 1e-6;

/// Damping after a failed step with almost none.
const RAISED_DAMPING: f64 = 1e-4;

/// Factors of the damping after a failed step and after a successful one.
const DAMPING_RISE: f64 = 10.0;
const DAMPING_FALL: f64 = 0.1;

/// Least damping.
const LEAST_DAMPING: f64 = 1e-9;

/// Most times that the damping is raised within one iteration.
const MOST_RETRIES: usize = 7;

/// A least-squares problem: the sum of the squared residuals is minimized.
pub(in crate::gap) trait LeastSquares {
    /// Point with its prediction.
    type At;
    /// Residual and derivatives at a point.
    type Linear: Linearization;

    /// Residual at a point, measured less predicted.
    fn residual(&self, at: &Self::At) -> Vec<f64>;

    /// Fresh derivatives of the prediction by the parameters from index `first` on.
    fn columns(&self, at: &Self::At, first: usize) -> Vec<Vec<f64>>;

    /// Linearization at a point with `columns` that are known.
    fn linear(&self, at: &Self::At, columns: Vec<Vec<f64>>) -> Self::Linear;

    /// Return whether parameter `index` is on a bound and a change in the direction of `slope` would push it beyond.
    fn is_blocked(&self, at: &Self::At, index: usize, slope: f64) -> bool;

    /// Point after a `step`, and the step itself, which bounds may have limited.
    fn moved(&self, at: &Self::At, step: &[f64], linear: &Self::Linear) -> (Self::At, Vec<f64>);
}

/// Residual and derivatives, without the directions of nuisance parameters.
pub(in crate::gap) trait Linearization {
    /// Residual.
    fn residual(&self) -> &[f64];

    /// Derivatives of the prediction by each parameter.
    fn columns(&self) -> &[Vec<f64>];

    /// Project the directions of nuisance parameters out of one more column.
    fn take_nuisances_from(&self, column: &mut [f64]);
}

/// Termination criteria of a fit.
pub(in crate::gap) struct Limits {
    /// Most iterations, each with fresh derivatives.
    pub(in crate::gap) iterations: usize,
    /// Steps with corrected derivatives after one with fresh ones.
    pub(in crate::gap) secant_steps: usize,
    /// Relative gain of the squared error below which a fit has converged.
    pub(in crate::gap) converged: f64,
}

/// Minimum of a fit.
pub(in crate::gap) struct Minimum<A> {
    pub(in crate::gap) at: A,
    /// Squared error.
    pub(in crate::gap) loss: f64,
}

/// Minimize `problem` from `start`; `known` are derivatives by the first parameters that are never computed afresh.
pub(in crate::gap) fn minimize<P: LeastSquares>(
    problem: &P,
    start: P::At,
    known: &[Vec<f64>],
    limits: &Limits,
) -> Minimum<P::At> {
    let mut descent = Descent::new(problem, start, limits.converged);
    let mut columns = known.to_vec();
    for _ in 0..limits.iterations {
        let before = descent.loss;
        let fresh = problem.columns(&descent.at, known.len());
        columns.splice(known.len().., fresh);
        let mut leads_on = descent.step(&mut columns, MOST_RETRIES);
        for _ in 0..limits.secant_steps {
            leads_on = leads_on && descent.step(&mut columns, 0);
        }
        if before - descent.loss < limits.converged * before {
            break;
        }
    }
    Minimum { at: descent.at, loss: descent.loss }
}

/// State of a fit.
struct Descent<'p, P: LeastSquares> {
    problem: &'p P,
    at: P::At,
    residual: Vec<f64>,
    loss: f64,
    damping: f64,
    converged: f64,
}

impl<'p, P: LeastSquares> Descent<'p, P> {
    fn new(problem: &'p P, at: P::At, converged: f64) -> Self {
        let residual = problem.residual(&at);
        let loss = squared(&residual);
        Self { problem, at, residual, loss, damping: FIRST_DAMPING, converged }
    }

    /// One step with `columns`, then Broyden's correction of them; up to `retries` attempts with more damping. Return
    /// whether the squared error decreased.
    fn step(&mut self, columns: &mut [Vec<f64>], retries: usize) -> bool {
        let problem = self.problem;
        let linear = problem.linear(&self.at, columns.to_vec());
        let normal = Normal::new(linear.columns(), linear.residual())
            .without_blocked(|index, slope| problem.is_blocked(&self.at, index, slope));
        let damping = self.damping;
        for _ in 0..=retries {
            let step = normal.step(self.damping);
            let (next, taken) = problem.moved(&self.at, &step, &linear);
            let residual = problem.residual(&next);
            let loss = squared(&residual);
            if loss < self.loss {
                let gain = self.loss - loss;
                correct(columns, &taken, &linear, [&self.residual, &residual]);
                (self.at, self.residual, self.loss) = (next, residual, loss);
                self.damping = (self.damping * DAMPING_FALL).max(LEAST_DAMPING);
                return self.converged * self.loss <= gain;
            }
            self.damping = match self.damping < LOW_DAMPING {
                true => RAISED_DAMPING,
                false => self.damping * DAMPING_RISE,
            };
        }
        if retries == 0 {
            self.damping = damping;
        }
        false
    }
}

/// Broyden's correction of `columns` by a step `taken`. The change of the residual that neither the columns nor the
/// nuisances explain is attributed to the columns along the step.
fn correct(
    columns: &mut [Vec<f64>],
    taken: &[f64],
    linear: &impl Linearization,
    [before, after]: [&[f64]; 2],
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

/// Sum of squares; infinite where a simulation diverged, so that no comparison selects it as the minimum.
#[must_use]
pub(in crate::gap) fn squared(values: &[f64]) -> f64 {
    let sum = dot(values, values);
    if sum.is_finite() { sum } else { f64::INFINITY }
}

/// Fraction of the squared residual `without` an effect that is gone `with` it.
#[must_use]
pub(in crate::gap) fn explained(with: &[f64], without: &[f64]) -> f64 {
    1.0 - squared(with) / squared(without).max(f64::MIN_POSITIVE)
}
