//! Errors of a model on held-out runs: one step ahead, and free-running.
//!
//! Free-running predictions start every [`START_STRIDE`] samples. The model gets the measured
//! history before the start and then only commands. The error at a horizon is the root mean square
//! over all samples up to it, and over both axes unless one axis is given.

use super::{layout::AXES, model::VelocityModel, run::Run};
use crate::stats::{Interval, bootstrap_ci95};
use serde::Serialize;

/// Free-running horizons of the report (s).
pub const HORIZONS_S: [f64; 3] = [0.1, 0.5, LONGEST_HORIZON_S];

/// Horizon by which models are compared and selected (s).
pub(super) const LONGEST_HORIZON_S: f64 = 2.0;

/// Number of samples between two starts of free-running prediction.
const START_STRIDE: usize = 5;

/// Velocity component of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Component {
    /// x, across the board.
    X,
    /// y, from goal to goal.
    Y,
    /// Both components, the mean of their squares.
    Both,
}

impl Component {
    /// All components: x, y and both.
    pub const ALL: [Self; 3] = [Self::X, Self::Y, Self::Both];

    /// Return `x`, `y` or `both`.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::X => "x",
            Self::Y => "y",
            Self::Both => "both",
        }
    }

    fn axes(self) -> &'static [usize] {
        match self {
            Self::X => &[0],
            Self::Y => &[1],
            Self::Both => &[0, 1],
        }
    }
}

/// Sum of squares, count and largest absolute value of errors per axis.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    squares: [f64; AXES],
    count: usize,
    peak: [f64; AXES],
}

impl Sums {
    fn add_error(&mut self, error: [f64; AXES]) {
        for (axis, error) in error.into_iter().enumerate() {
            self.squares[axis] += error * error;
            self.peak[axis] = self.peak[axis].max(error.abs());
        }
        self.count += 1;
    }

    fn add(&mut self, other: &Self) {
        for axis in 0..AXES {
            self.squares[axis] += other.squares[axis];
            self.peak[axis] = self.peak[axis].max(other.peak[axis]);
        }
        self.count += other.count;
    }
}

fn total<'a>(parts: impl Iterator<Item = &'a Sums>) -> Sums {
    parts.fold(Sums::default(), |mut sum, part| {
        sum.add(part);
        sum
    })
}

fn rmse(sums: &Sums, component: Component) -> f64 {
    let axes = component.axes();
    let squares: f64 = axes.iter().map(|axis| sums.squares[*axis]).sum();
    (squares / (sums.count * axes.len()) as f64).sqrt()
}

/// Errors of one model on one run.
#[derive(Debug, Clone)]
struct RunErrors {
    pattern: String,
    one_step: Sums,
    /// Error at each free-running step, from the first.
    by_step: Vec<Sums>,
}

/// Errors of one model on all held-out runs.
#[derive(Debug, Clone)]
pub struct Evaluation {
    /// Name of the model.
    pub model: &'static str,
    runs: Vec<RunErrors>,
    dt: f64,
}

/// One error metric with its interval, as shown in results.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ErrorRow {
    /// Name of the model.
    pub model: &'static str,
    /// Pattern of the runs; `all` for all of them.
    pub pattern: String,
    /// Component of the velocity.
    pub component: Component,
    /// Horizon (s); 0 for one step ahead.
    pub horizon_s: f64,
    /// Root mean square error (m/s).
    pub rmse_m_per_s: f64,
    /// 95 % interval by bootstrap over runs (m/s); null for fewer than two runs.
    pub ci95_m_per_s: Option<Interval>,
    /// Largest error (m/s).
    pub peak_m_per_s: f64,
}

impl Evaluation {
    /// Evaluate `model` on `runs`, each long enough for `history` samples and the longest horizon.
    /// A shorter run counts up to its end.
    #[must_use]
    pub fn new(model: &dyn VelocityModel, runs: &[&Run], history: usize, dt: f64) -> Self {
        let steps = steps_of(LONGEST_HORIZON_S, dt);
        let runs = runs
            .iter()
            .filter(|run| history < run.len())
            .map(|run| evaluate_run(model, run, history, steps))
            .collect();
        Self { model: model.name(), runs, dt }
    }

    /// Return the one-step-ahead error over all runs (m/s).
    #[must_use]
    pub fn one_step(&self, component: Component) -> f64 {
        rmse(&total(self.runs.iter().map(|run| &run.one_step)), component)
    }

    /// Return the free-running error over `horizon_s` and all runs (m/s).
    #[must_use]
    pub fn free_running(&self, horizon_s: f64, component: Component) -> f64 {
        let steps = steps_of(horizon_s, self.dt);
        rmse(&total(self.runs.iter().flat_map(|run| run.by_step.iter().take(steps))), component)
    }

    /// Return the free-running error over the longest horizon, per run (m/s).
    #[must_use]
    pub fn free_running_by_run(&self) -> Vec<f64> {
        let by_run = self.runs.iter().map(|run| total(run.by_step.iter()));
        by_run.filter(|sums| 0 < sums.count).map(|sums| rmse(&sums, Component::Both)).collect()
    }

    /// Return the error at each free-running step of the longest horizon, both axes (s, m/s).
    #[must_use]
    pub fn growth(&self) -> Vec<(f64, f64)> {
        let steps = self.runs.iter().map(|run| run.by_step.len()).max().unwrap_or(0);
        (0..steps)
            .map(|step| {
                let sums = total(self.runs.iter().filter_map(|run| run.by_step.get(step)));
                ((step + 1) as f64 * self.dt, rmse(&sums, Component::Both))
            })
            .collect()
    }

    /// Return every metric: one step and each horizon, all runs and each pattern, x, y and both.
    #[must_use]
    pub fn rows(&self) -> Vec<ErrorRow> {
        let mut patterns: Vec<&str> = self.runs.iter().map(|run| run.pattern.as_str()).collect();
        patterns.sort_unstable();
        patterns.dedup();
        let named = patterns.iter().map(|pattern| Some(*pattern));
        let mut rows = Vec::new();
        for pattern in std::iter::once(None).chain(named) {
            let chosen: Vec<&RunErrors> = self
                .runs
                .iter()
                .filter(|run| pattern.is_none_or(|pattern| run.pattern == pattern))
                .collect();
            for horizon_s in std::iter::once(0.0).chain(HORIZONS_S) {
                for component in Component::ALL {
                    rows.push(self.row(pattern.unwrap_or("all"), &chosen, horizon_s, component));
                }
            }
        }
        rows
    }

    fn row(
        &self,
        pattern: &str,
        runs: &[&RunErrors],
        horizon_s: f64,
        component: Component,
    ) -> ErrorRow {
        let steps = steps_of(horizon_s, self.dt);
        let sums: Vec<Sums> = runs
            .iter()
            .map(
                |run| if steps == 0 { run.one_step } else { total(run.by_step.iter().take(steps)) },
            )
            .collect();
        let all = total(sums.iter());
        let over = |drawn: &[&Sums]| rmse(&total(drawn.iter().copied()), component);
        ErrorRow {
            model: self.model,
            pattern: pattern.to_owned(),
            component,
            horizon_s,
            rmse_m_per_s: rmse(&all, component),
            ci95_m_per_s: bootstrap_ci95(&sums, 0, over).filter(|ci| ci.low.is_finite()),
            peak_m_per_s: component.axes().iter().map(|a| all.peak[*a]).fold(0.0, f64::max),
        }
    }
}

fn steps_of(horizon_s: f64, dt: f64) -> usize {
    (horizon_s / dt).round() as usize
}

fn evaluate_run(model: &dyn VelocityModel, run: &Run, history: usize, steps: usize) -> RunErrors {
    let error = |sample: usize, predicted: [f64; AXES]| -> [f64; AXES] {
        std::array::from_fn(|axis| predicted[axis] - run.velocities[sample][axis])
    };
    let starts: Vec<usize> = (history - 1..run.len() - 1).collect();
    let mut one_step = Sums::default();
    for (start, predicted) in starts.iter().zip(model.simulate(run, &starts, 1)) {
        one_step.add_error(error(start + 1, predicted));
    }
    let steps = steps.min(run.len() - history);
    let last = run.len() - steps;
    let starts: Vec<usize> = (history - 1..last).step_by(START_STRIDE).collect();
    let mut by_step = vec![Sums::default(); steps];
    let predicted = model.simulate(run, &starts, steps);
    for (start, predicted) in starts.iter().zip(predicted.chunks_exact(steps)) {
        for (step, predicted) in predicted.iter().enumerate() {
            by_step[step].add_error(error(start + step + 1, *predicted));
        }
    }
    RunErrors { pattern: run.pattern.clone(), one_step, by_step }
}
