//! Levenberg-Marquardt fits of a [`Problem`], and confidence intervals that hold under correlated noise.

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

pub(super) use super::numerics::levenberg_marquardt::{explained, squared};

/// Precision of a fit: the relative gain of the squared error per iteration below which it ends.
#[derive(Debug, Clone, Copy)]
pub(super) enum Precision {
    /// Start of a further fit. Its last steps are left to that fit, in another metric or from the best of several starts.
    Start,
    /// Minimum.
    Minimum,
}

impl Precision {
    fn least_gain(self) -> f64 {
        match self {
            Self::Start => 1e-3,
            Self::Minimum => 1e-5,
        }
    }
}

/// Steps with corrected columns after one with fresh ones. More steps save simulations where the columns change little.
const SECANT_STEPS: usize = 2;

/// Fitted point.
#[derive(Debug, Clone)]
pub struct Fit {
    /// Twin and nuisances.
    pub point: Point,
    /// Shared parameters that were fitted.
    pub slots: Vec<Slot>,
    /// Whitened squared error.
    pub loss: f64,
    /// Number of rows.
    pub rows: usize,
}

/// Fit `slots` from `start` in at most `iterations` steps, with the whitening of `filters`.
#[must_use]
pub(super) fn fit(
    problem: &Problem<'_>,
    start: Point,
    slots: &[Slot],
    filters: &Filters,
    iterations: usize,
) -> Fit {
    fit_with(problem, start, slots, &How::minimum(filters, iterations))
}

/// Options of a fit.
pub(super) struct How<'a> {
    /// Metric.
    pub(super) filters: &'a Filters,
    /// Most iterations.
    pub(super) iterations: usize,
    /// Columns of the first parameters, where they are known from a nearby point.
    pub(super) known: &'a [Vec<f64>],
    pub(super) precision: Precision,
}

impl<'a> How<'a> {
    /// Options of a fit that only finds the start of a further one.
    pub(super) fn start(filters: &'a Filters, iterations: usize) -> Self {
        Self { filters, iterations, known: &[], precision: Precision::Start }
    }

    /// Options of a fit of all parameters to the minimum.
    pub(super) fn minimum(filters: &'a Filters, iterations: usize) -> Self {
        Self { precision: Precision::Minimum, ..Self::start(filters, iterations) }
    }
}

/// Fit `slots` from `start`, with known columns of the first parameters.
///
/// Each iteration simulates fresh columns. A few steps with columns corrected along the last step follow, at one
/// simulation each. They are omitted with nuisances: the correction would attribute their nonlinearity to the
/// parameters.
#[must_use]
pub(super) fn fit_with(problem: &Problem<'_>, start: Point, slots: &[Slot], how: &How<'_>) -> Fit {
    let has_nuisances = start.nuisance.iter().any(|part| !part.is_empty());
    let limits = Limits {
        iterations: if slots.is_empty() && !has_nuisances { 0 } else { how.iterations },
        secant_steps: if has_nuisances { 0 } else { SECANT_STEPS },
        converged: how.precision.least_gain(),
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

/// Fit from a distant start: first with each signal only scaled, then whitened by its own residual.
#[must_use]
pub(super) fn fit_from_distant_start(
    problem: &Problem<'_>,
    start: Point,
    slots: &[Slot],
    iterations: usize,
) -> (Fit, Filters) {
    let mut point = start;
    for _ in 0..3 {
        let scales = problem.filters(&point, whiten::scale_filters);
        let before = squared(&problem.whitened(&point, &scales));
        let found = fit_with(problem, point, slots, &How::start(&scales, iterations));
        point = found.point;
        if 0.98 * before < found.loss {
            break;
        }
    }
    converge(problem, point, slots, iterations)
}

/// Ordinary least squares from `found`, every signal in units of its RMS: the estimates of published tables.
#[must_use]
pub(super) fn ordinary_least_squares(problem: &Problem<'_>, found: &Fit) -> Fit {
    let scales = problem.filters(&found.point, whiten::scale_filters);
    fit(problem, found.point.clone(), &found.slots, &scales, 4)
}

/// Fit from a nearby start: whitened by the residual, then again by the residual after that fit.
#[must_use]
pub(super) fn converge(
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

/// Fit only the nuisances and the parameters of a session (the phase of a ripple): the prediction of an otherwise
/// unchanged twin.
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

/// `twin` on a problem to which it was not fitted: its nuisances from their first guesses, as [`adapt`] estimates them.
#[must_use]
pub(super) fn on(problem: &Problem<'_>, twin: &Twin, filters: &Filters) -> Point {
    adapt(problem, problem.start(twin.clone()), filters)
}

/// Whitened residual of `twin` on such a problem.
#[must_use]
pub(super) fn residual_on(problem: &Problem<'_>, twin: &Twin, filters: &Filters) -> Vec<f64> {
    problem.whitened(&on(problem, twin, filters), filters)
}

/// `point` with its nuisances and parameters of a session refitted, every signal in units of its RMS. The gap is
/// measured at this point: whitening tolerates slow errors and must not choose the start of a roll.
#[must_use]
pub(super) fn with_refitted_nuisances(problem: &Problem<'_>, point: &Point) -> Point {
    let scales = problem.filters(point, whiten::scale_filters);
    adapt(problem, point.clone(), &scales)
}

/// Standard errors of the fitted values, in their own units, and parameters that are not identifiable.
#[derive(Debug, Clone)]
pub struct Uncertainty {
    /// Standard error of each slot.
    pub standard_errors: Vec<f64>,
    /// Degrees of freedom of the block estimate.
    pub freedom: f64,
    /// `true` for each slot whose variance comes mostly from directions that the data hardly determine.
    pub undetermined: Vec<bool>,
}

/// Standard errors that hold under correlation within blocks and uneven variance ([`Sandwich`]), and between sessions.
///
/// Let d be the difference between the training and the validation estimate. The variance between sessions is half of
/// d², beyond the variance of d (DerSimonian and Laird, Controlled Clinical Trials 7, 1986, for two studies). One
/// session alone does not show it.
#[must_use]
pub(super) fn uncertainty(
    problem: &Problem<'_>,
    held_out: &Problem<'_>,
    (found, validated): (&Fit, &Point),
    filters: &Filters,
) -> Uncertainty {
    let own = sandwich(problem, &found.point, &found.slots, filters);
    let other =
        (!held_out.parts.is_empty()).then(|| sandwich(held_out, validated, &found.slots, filters));
    let mut standard_errors = Vec::with_capacity(found.slots.len());
    for (index, slot) in found.slots.iter().enumerate() {
        let effect = found.point.twin.instances[slot.instance].effect;
        let mut variance = own.variances[index];
        if let Some(other) = &other
            && !other.undetermined[index]
            && !effect.parameters[slot.parameter].per_session
        {
            let late = held_out.lateness(&found.point.twin, *slot) / found.point.twin.scale(*slot);
            let step = other.step[index] + late;
            variance += excess_variance(step, variance + other.variances[index]);
        }
        standard_errors.push(variance.sqrt() * found.point.twin.scale(*slot));
    }
    Uncertainty { standard_errors, freedom: own.freedom, undetermined: own.undetermined }
}

/// Variance that two estimates, `step` apart, have in addition to the `variance` of their difference.
fn excess_variance(step: f64, variance: f64) -> f64 {
    0.5 * (step.powi(2) - variance).max(0.0)
}

impl Uncertainty {
    /// The same with the variance due to model error. A correct model gives the same estimates under any weighting of
    /// the errors (Hausman, Econometrica 46, 1978). The second weighting scales the residuals without whitening. Half
    /// of the squared difference beyond its variance is added, as between sessions.
    #[must_use]
    pub(super) fn with_metric_variance(mut self, problem: &Problem<'_>, found: &Fit) -> Self {
        let scales = problem.filters(&found.point, whiten::scale_filters);
        let other = sandwich(problem, &found.point, &found.slots, &scales);
        for (index, slot) in found.slots.iter().enumerate() {
            if !other.undetermined[index] {
                let variance = excess_variance(other.step[index], other.variances[index]);
                let error = &mut self.standard_errors[index];
                *error = error.hypot(variance.sqrt() * found.point.twin.scale(*slot));
            }
        }
        self
    }

    /// The same with the bias of omitted effects that are too small to be added: `shifts` are the changes of each
    /// parameter with each of them (scaled). An interval reaches as far as the largest change.
    #[must_use]
    pub(super) fn with_omitted_effects(mut self, found: &Fit, shifts: &[&[f64]]) -> Self {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::test_stage::{TestStage, axis_of_frequency, first_parameters};
    use std::{
        f64::consts::TAU,
        sync::atomic::{AtomicUsize, Ordering},
    };

    /// Sum of two sines whose amplitudes are a parameter and its square.
    fn amplitudes(of: f64, square: f64, time: f64) -> f64 {
        of * (TAU * time).sin() + square * (2.0 * TAU * time).sin()
    }

    /// No value of the parameter gives both amplitudes of the data, so the steps converge slowly.
    #[test]
    fn a_fit_that_finds_a_start_ends_earlier_and_leads_to_the_same_minimum() {
        /// Largest relative difference between two paths to one minimum.
        const SAME: f64 = 1e-2;
        let measured = (0..500).map(|k| amplitudes(1.0, -0.4, 0.01 * f64::from(k))).collect();
        let simulations = AtomicUsize::new(0);
        let stage = TestStage::drive(measured, |twin: &Twin, time: f64| {
            simulations.fetch_add(usize::from(time == 0.0), Ordering::Relaxed);
            let [slot] = first_parameters(twin, ["gantry.inertia"]);
            amplitudes(twin.get(slot), twin.get(slot).powi(2), time)
        });
        let start = axis_of_frequency(3.0);
        let slots = first_parameters(&start, ["gantry.inertia"]);
        let fitted = |precision: Precision| {
            // A problem of its own: predictions are remembered.
            let train = Problem::new(&[&stage as _], &start);
            let at = train.start(start.clone());
            let filters = train.filters(&at, whiten::scale_filters);
            simulations.store(0, Ordering::Relaxed);
            let how = How { precision, ..How::start(&filters, 20) };
            let found = fit_with(&train, at, &slots, &how);
            let count = simulations.load(Ordering::Relaxed);
            let last = fit(&train, found.point.clone(), &slots, &filters, 20);
            (count, found.loss, last.point.twin.get(slots[0]))
        };
        let [near, at] = [Precision::Start, Precision::Minimum].map(fitted);
        assert!(near.0 < at.0, "{} and {} simulations", near.0, at.0);
        assert!(at.1 <= near.1 && near.1 < 1.01 * at.1, "{} and {}", near.1, at.1);
        assert!((near.2 / at.2 - 1.0).abs() < SAME, "{} and {}", near.2, at.2);
    }
}
