//! Baseline models: the ideal actuator, a first-order-plus-dead-time model, and linear ARX.

use super::{
    layout::{AXES, Layout, LayoutKind},
    model::VelocityModel,
    run::Run,
};
use argmin::{
    core::{CostFunction, Executor},
    solver::neldermead::NelderMead,
};
use faer::Mat;
use serde::Serialize;

/// Ideal actuator, `v_k+1 = u_k`: the carriage follows the command one sample later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ideal;

impl VelocityModel for Ideal {
    fn name(&self) -> &'static str {
        "ideal"
    }

    fn simulate(&self, run: &Run, starts: &[usize], steps: usize) -> Vec<[f64; AXES]> {
        starts.iter().flat_map(|start| run.commands[*start..start + steps].to_vec()).collect()
    }
}

/// First-order-plus-dead-time (FOPDT) model of one axis: `tau dv/dt = gain u(t - delay) - v`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Lag {
    /// Ratio of steady velocity to command.
    pub gain: f64,
    /// Time constant (s).
    pub tau_s: f64,
    /// Dead time (s).
    pub delay_s: f64,
}

impl Lag {
    /// Return the velocity one sample of `dt` later. Exact for a command that is constant over the
    /// sample; a delayed command is interpolated linearly between neighbouring samples.
    fn step(&self, velocity: f64, command: f64, dt: f64) -> f64 {
        let kept = (-dt / self.tau_s).exp();
        kept * velocity + (1.0 - kept) * self.gain * command
    }

    fn delayed(&self, commands: &[[f64; AXES]], axis: usize, at: usize, dt: f64) -> f64 {
        let late = self.delay_s / dt;
        let whole = late.floor();
        let fraction = late - whole;
        let back = |samples: usize| commands[at.saturating_sub(samples)][axis];
        (1.0 - fraction) * back(whole as usize) + fraction * back(whole as usize + 1)
    }
}

/// First-order-plus-dead-time model with independent axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Fopdt {
    /// Parameters of x and y.
    pub axes: [Lag; AXES],
    #[serde(skip)]
    dt: f64,
}

/// Longest delay of the search, in samples.
const MOST_DELAY_SAMPLES: usize = 8;
const LAG_ITERATIONS: u64 = 120;

impl Fopdt {
    /// Fit by least squares on the free-running simulation of `runs`. Nelder and Mead search gain
    /// and logarithmic time constant from a start at each whole delay; the delay is free.
    #[must_use]
    pub fn fit(runs: &[&Run], dt: f64) -> Self {
        let axes = std::array::from_fn(|axis| {
            let cost = LagCost { runs, axis, dt };
            (0..=MOST_DELAY_SAMPLES)
                .step_by(2)
                .map(|samples| cost.minimise(samples as f64 * dt))
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .map_or(Lag { gain: 1.0, tau_s: dt, delay_s: 0.0 }, |(lag, _)| lag)
        });
        Self { axes, dt }
    }
}

impl VelocityModel for Fopdt {
    fn name(&self) -> &'static str {
        "fopdt"
    }

    fn simulate(&self, run: &Run, starts: &[usize], steps: usize) -> Vec<[f64; AXES]> {
        let mut predicted = Vec::with_capacity(starts.len() * steps);
        for start in starts {
            let mut velocity = run.velocities[*start];
            for step in 0..steps {
                velocity = std::array::from_fn(|axis| {
                    let lag = &self.axes[axis];
                    let command = lag.delayed(&run.commands, axis, start + step, self.dt);
                    lag.step(velocity[axis], command, self.dt)
                });
                predicted.push(velocity);
            }
        }
        predicted
    }
}

struct LagCost<'a> {
    runs: &'a [&'a Run],
    axis: usize,
    dt: f64,
}

impl LagCost<'_> {
    fn lag(&self, parameters: &[f64]) -> Lag {
        let most = MOST_DELAY_SAMPLES as f64 * self.dt;
        Lag {
            gain: parameters[0],
            tau_s: parameters[1].exp(),
            delay_s: parameters[2].clamp(0.0, most),
        }
    }

    fn minimise(&self, delay_s: f64) -> (Lag, f64) {
        let start = [1.0, (2.0 * self.dt).ln(), delay_s];
        let steps = [0.1, 0.5, 0.5 * self.dt];
        let simplex: Vec<Vec<f64>> = (0..=start.len())
            .map(|vertex| {
                let mut point = start.to_vec();
                if let Some(index) = vertex.checked_sub(1) {
                    point[index] += steps[index];
                }
                point
            })
            .collect();
        let best = NelderMead::new(simplex)
            .with_sd_tolerance(1e-12)
            .and_then(|solver| {
                Executor::new(LagCost { ..*self }, solver)
                    .configure(|state| state.max_iters(LAG_ITERATIONS))
                    .run()
            })
            .ok()
            .and_then(|result| result.state.best_param)
            .unwrap_or_else(|| start.to_vec());
        let lag = self.lag(&best);
        (lag, self.mean_square(&lag))
    }

    fn mean_square(&self, lag: &Lag) -> f64 {
        let (mut sum, mut count) = (0.0, 0usize);
        for run in self.runs {
            let mut velocity = run.velocities[0][self.axis];
            for k in 0..run.len() - 1 {
                let command = lag.delayed(&run.commands, self.axis, k, self.dt);
                velocity = lag.step(velocity, command, self.dt);
                sum += (velocity - run.velocities[k + 1][self.axis]).powi(2);
                count += 1;
            }
        }
        sum / count as f64
    }
}

impl CostFunction for LagCost<'_> {
    type Param = Vec<f64>;
    type Output = f64;

    fn cost(&self, parameters: &Self::Param) -> Result<f64, argmin::core::Error> {
        Ok(self.mean_square(&self.lag(parameters)))
    }
}

/// Linear regression of the next velocity on the same history as the network's, both axes together,
/// with a constant.
#[derive(Debug, Clone)]
pub struct Arx {
    layout: Layout,
    /// `[inputs + 1][AXES]`; the constant last.
    coefficients: Mat<f64>,
}

impl Arx {
    /// Fit by least squares over one step. A truncated eigenvalue decomposition gives inputs that
    /// never differ the smallest coefficients instead of arbitrary ones.
    #[must_use]
    pub fn fit(runs: &[&Run], history_steps: usize) -> Self {
        let layout = Layout { kind: LayoutKind::Klasktron, history_steps };
        let size = layout.inputs() + 1;
        // Normal equations, accumulated run by run: 41 columns for any length.
        let mut gram = Mat::<f64>::zeros(size, size);
        let mut right = Mat::<f64>::zeros(size, AXES);
        let mut input = vec![0.0f32; layout.inputs()];
        let mut row = vec![1.0; size];
        for run in runs {
            for at in history_steps - 1..run.len() - 1 {
                layout.fill(&mut input, &run.commands, &run.velocities, at);
                for (wide, narrow) in row.iter_mut().zip(&input) {
                    *wide = f64::from(*narrow);
                }
                for i in 0..size {
                    for j in 0..=i {
                        gram[(i, j)] += row[i] * row[j];
                    }
                    for axis in 0..AXES {
                        right[(i, axis)] += row[i] * run.velocities[at + 1][axis];
                    }
                }
            }
        }
        Self { layout, coefficients: solve_symmetric(&gram, &right) }
    }
}

/// Eigenvalues below this fraction of the largest count as zero.
const RANK_TOLERANCE: f64 = 1e-12;

/// Return the minimum-norm solution of `gram x = right`, from the lower triangle of `gram`.
fn solve_symmetric(gram: &Mat<f64>, right: &Mat<f64>) -> Mat<f64> {
    let zero = Mat::zeros(right.nrows(), right.ncols());
    let Ok(eigen) = gram.self_adjoint_eigen(faer::Side::Lower) else { return zero };
    let values = eigen.S().column_vector();
    let largest = values.iter().fold(0.0f64, |most, value| most.max(value.abs()));
    let mut rotated = eigen.U().transpose() * right;
    for (row, value) in values.iter().enumerate() {
        let inverse = if RANK_TOLERANCE * largest < *value { 1.0 / value } else { 0.0 };
        for column in 0..right.ncols() {
            rotated[(row, column)] *= inverse;
        }
    }
    eigen.U() * rotated
}

impl VelocityModel for Arx {
    fn name(&self) -> &'static str {
        "arx"
    }

    fn simulate(&self, run: &Run, starts: &[usize], steps: usize) -> Vec<[f64; AXES]> {
        let mut predicted = Vec::with_capacity(starts.len() * steps);
        let mut input = vec![0.0f32; self.layout.inputs()];
        let constant = self.layout.inputs();
        for start in starts {
            self.layout.fill(&mut input, &run.commands, &run.velocities, *start);
            for step in 0..steps {
                let velocity: [f64; AXES] = std::array::from_fn(|axis| {
                    let linear = input.iter().enumerate();
                    self.coefficients[(constant, axis)]
                        + linear
                            .map(|(i, x)| f64::from(*x) * self.coefficients[(i, axis)])
                            .sum::<f64>()
                });
                predicted.push(velocity);
                let command = run.commands[start + step + 1].map(|u| u as f32);
                self.layout.advance(&mut input, command, velocity.map(|v| v as f32));
            }
        }
        predicted
    }
}
