//! Levenberg and Marquardt's method on a [`Problem`], and intervals that hold under correlated noise.

use super::{
    numerics::{
        levenberg_marquardt::{LeastSquares, Limits, Linearization, minimize},
        normal::Normal,
        sandwich::Sandwich,
    },
    problem::{Evaluated, Linear, Point, Problem},
    whiten::{self, Filters},
};
use crate::{
    stats::t_quantile,
    twin::{Slot, Twin},
};

pub(super) use super::numerics::levenberg_marquardt::squared;

/// Relative gain of the squared error below which a fit has converged.
const CONVERGED: f64 = 1e-5;

/// Steps with corrected columns after one with fresh ones.
const SECANT_STEPS: usize = 2;

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
/// step has corrected along itself, which cost one simulation each; not where nuisances move beside the parameters, whose
/// bends would be taken for theirs.
#[must_use]
pub(super) fn fit_with(problem: &Problem<'_>, start: Point, slots: &[Slot], how: &How<'_>) -> Fit {
    let has_nuisances = start.nuisance.iter().any(|part| !part.is_empty());
    let limits = Limits {
        iterations: if slots.is_empty() && !has_nuisances { 0 } else { how.iterations },
        secant_steps: if has_nuisances { 0 } else { SECANT_STEPS },
        converged: CONVERGED,
    };
    let fitted = Fitted { problem, slots, filters: how.filters };
    let found = minimize(&fitted, problem.evaluated(start), how.known, &limits);
    Fit { point: found.at.point, slots: slots.to_vec(), loss: found.loss, rows: problem.rows() }
}

/// Shared parameters of a problem that are fitted in one metric.
struct Fitted<'a, 'b> {
    problem: &'b Problem<'a>,
    slots: &'b [Slot],
    filters: &'b Filters,
}

impl LeastSquares for Fitted<'_, '_> {
    type At = Evaluated;
    type Linear = Linear;

    fn residual(&self, at: &Evaluated) -> Vec<f64> {
        self.problem.whitened_at(&at.prediction, self.filters)
    }

    fn columns(&self, at: &Evaluated, first: usize) -> Vec<Vec<f64>> {
        self.problem.columns(at, &self.slots[first..], self.filters)
    }

    fn linear(&self, at: &Evaluated, columns: Vec<Vec<f64>>) -> Linear {
        self.problem.linear_of(at, columns, self.filters)
    }

    fn is_blocked(&self, at: &Evaluated, index: usize, slope: f64) -> bool {
        let slot = self.slots[index];
        let effect = at.point.twin.instances[slot.instance].effect;
        let (low, high) = effect.parameters[slot.parameter].bounds;
        let value = at.point.twin.get(slot);
        value <= low && slope < 0.0 || high <= value && 0.0 < slope
    }

    fn moved(&self, at: &Evaluated, step: &[f64], linear: &Linear) -> (Evaluated, Vec<f64>) {
        let (moved, taken) = self.problem.moved(&at.point, self.slots, step, linear);
        let next = self.problem.evaluated(moved);
        (self.problem.with_shorter_nuisance_steps(at, next, self.filters), taken)
    }
}

impl Linearization for Linear {
    fn residual(&self) -> &[f64] {
        &self.residual
    }

    fn columns(&self) -> &[Vec<f64>] {
        &self.columns
    }

    fn take_nuisances_from(&self, column: &mut [f64]) {
        Self::take_nuisances_from(self, column);
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

/// Standard errors that hold under correlation within blocks and uneven scatter ([`Sandwich`]), and between sessions: where the
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
    let own = sandwich(problem, &found.point, &found.slots, filters);
    let other =
        (!held_out.parts.is_empty()).then(|| sandwich(held_out, judged, &found.slots, filters));
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
        let other = sandwich(problem, &found.point, &found.slots, &scales);
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
    let inverse = Normal::new(&linear.columns, &linear.residual).inverse();
    let count = found.slots.len();
    let scaled = |i: usize, j: usize| inverse[(i, j)] / (inverse[(i, i)] * inverse[(j, j)]).sqrt();
    (0..count).map(|i| (0..count).map(|j| scaled(i, j)).collect()).collect()
}

/// Covariance of the parameters on one problem, by blocks of time, in scaled units.
fn sandwich(problem: &Problem<'_>, point: &Point, slots: &[Slot], filters: &Filters) -> Sandwich {
    let linear = problem.linear(point, slots, filters);
    Sandwich::new(&linear.columns, &linear.residual, &linear.blocks)
}
