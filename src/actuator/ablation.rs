//! Ablation of the paper: history length and width, several seeds each, compared by free-running
//! error.

use super::{
    evaluation::{Component, Evaluation, LONGEST_HORIZON_S},
    fit::{Fit, FitConfig},
    layout::LayoutKind,
};
use serde::Serialize;
use std::collections::BTreeMap;

/// History lengths of the ablation, in steps.
pub const HISTORIES: [usize; 3] = [1, 5, 10];
/// Widths of the ablation: units of each hidden layer.
pub const WIDTHS: [usize; 3] = [32, 64, 128];

/// Return every combination, each with `seeds` seeds counted from `base.seed`.
#[must_use]
pub fn configs(base: &FitConfig, seeds: u64) -> Vec<FitConfig> {
    // The upstream layout has one velocity less than commands, so it starts at two steps.
    let shortest = match base.layout {
        LayoutKind::Klasktron => 1,
        LayoutKind::KlaskRl => 2,
    };
    let mut configs = Vec::new();
    for history_steps in HISTORIES.map(|steps| steps.max(shortest)) {
        for width in WIDTHS {
            for seed in base.seed..base.seed + seeds {
                configs.push(FitConfig { history_steps, width, seed, ..*base });
            }
        }
    }
    configs
}

/// One combination, evaluated on the held-out runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Cell {
    /// Number of commands in the input history.
    pub history_steps: usize,
    /// Units of each hidden layer.
    pub width: usize,
    /// Number of finished seeds.
    pub seeds: usize,
    /// Free-running error over the longest horizon, mean over seeds (m/s).
    pub mean_rmse_m_per_s: f64,
    /// Standard error of that mean, over held-out runs (m/s).
    pub standard_error_m_per_s: f64,
    /// One-step-ahead error, mean over seeds (m/s).
    pub one_step_rmse_m_per_s: f64,
    /// Number of network parameters.
    pub parameters: usize,
}

/// Outcome of the whole ablation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ablation {
    /// Every combination.
    pub cells: Vec<Cell>,
    /// Index in `cells` of the smallest mean error.
    pub best: usize,
    /// Index in `cells` of the selected combination: the fewest parameters within one standard
    /// error of the best (Breiman et al., "Classification and Regression Trees", 1984, section
    /// 3.4.3).
    pub chosen: usize,
    /// Two-fold cross-fitted error of the selection (m/s). One half of the held-out runs selects,
    /// the other half evaluates, in both directions, and the two errors are averaged. This removes
    /// the optimism of selecting and evaluating on the same runs.
    pub cross_fitted_rmse_m_per_s: Option<f64>,
}

/// One fit of an ablation, as stored in the file.
#[derive(Debug, Clone, Copy)]
pub struct AblationFit {
    /// Settings of the fit.
    pub config: FitConfig,
    /// One-step-ahead error on held-out runs (m/s).
    pub one_step_rmse_m_per_s: f64,
    /// Free-running error over the longest horizon (m/s).
    pub free_running_rmse_m_per_s: f64,
}

impl AblationFit {
    pub(super) fn of(fit: &Fit, evaluation: &Evaluation) -> Self {
        Self {
            config: fit.config,
            one_step_rmse_m_per_s: evaluation.one_step(Component::Both),
            free_running_rmse_m_per_s: evaluation.free_running(LONGEST_HORIZON_S, Component::Both),
        }
    }
}

/// Evaluate every combination of `fits`; `evaluations` are in the same order.
#[must_use]
pub(super) fn select(fits: &[Fit], evaluations: &[Evaluation]) -> Option<Ablation> {
    let mut groups: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for (index, fit) in fits.iter().enumerate() {
        let key = (fit.config.history_steps, fit.config.width);
        groups.entry(key).or_default().push(index);
    }
    let groups: Vec<((usize, usize), Vec<usize>)> = groups.into_iter().collect();
    let by_run: Vec<Vec<f64>> = groups
        .iter()
        .map(|(_, members)| mean_by_run(members.iter().map(|index| &evaluations[*index])))
        .collect();
    let parameters: Vec<usize> =
        groups.iter().map(|(_, members)| parameter_count(&fits[members[0]])).collect();
    let all: Vec<usize> = (0..by_run.first()?.len()).collect();
    let (best, chosen) = one_standard_error(&by_run, &parameters, &all)?;
    let cells = groups
        .iter()
        .zip(&by_run)
        .zip(&parameters)
        .map(|(((key, members), errors), parameters)| {
            let mean_over = |figure: &dyn Fn(&Evaluation) -> f64| {
                members.iter().map(|i| figure(&evaluations[*i])).sum::<f64>() / members.len() as f64
            };
            Cell {
                history_steps: key.0,
                width: key.1,
                seeds: members.len(),
                mean_rmse_m_per_s: mean_over(&|j| {
                    j.free_running(LONGEST_HORIZON_S, Component::Both)
                }),
                standard_error_m_per_s: standard_error(errors, &all),
                one_step_rmse_m_per_s: mean_over(&|j| j.one_step(Component::Both)),
                parameters: *parameters,
            }
        })
        .collect();
    let cross_fitted_rmse_m_per_s = cross_fitted(&by_run, &parameters);
    Some(Ablation { cells, best, chosen, cross_fitted_rmse_m_per_s })
}

fn parameter_count(fit: &Fit) -> usize {
    fit.model.network.layers.iter().map(|l| l.weight.len() + l.bias.len()).sum()
}

/// Return the free-running error of each held-out run, averaged over seeds.
fn mean_by_run<'a>(evaluations: impl Iterator<Item = &'a Evaluation>) -> Vec<f64> {
    let by_seed: Vec<Vec<f64>> = evaluations.map(Evaluation::free_running_by_run).collect();
    let runs = by_seed.iter().map(Vec::len).min().unwrap_or(0);
    (0..runs)
        .map(|run| by_seed.iter().map(|errors| errors[run]).sum::<f64>() / by_seed.len() as f64)
        .collect()
}

fn mean(values: &[f64], at: &[usize]) -> f64 {
    at.iter().map(|index| values[*index]).sum::<f64>() / at.len() as f64
}

fn standard_error(values: &[f64], at: &[usize]) -> f64 {
    if at.len() < 2 {
        return 0.0;
    }
    let centre = mean(values, at);
    let squares: f64 = at.iter().map(|index| (values[*index] - centre).powi(2)).sum();
    (squares / (at.len() - 1) as f64 / at.len() as f64).sqrt()
}

/// Return the best and the selected combination by the errors of the runs `at`. The standard error
/// is that of the paired difference from the best, because all combinations are evaluated on the
/// same runs.
fn one_standard_error(
    by_run: &[Vec<f64>],
    parameters: &[usize],
    at: &[usize],
) -> Option<(usize, usize)> {
    let by_mean = |a: &usize, b: &usize| mean(&by_run[*a], at).total_cmp(&mean(&by_run[*b], at));
    let best = (0..by_run.len()).min_by(by_mean)?;
    let chosen = (0..by_run.len())
        .filter(|cell| {
            let differences: Vec<f64> =
                by_run[*cell].iter().zip(&by_run[best]).map(|(a, b)| a - b).collect();
            mean(&differences, at) <= standard_error(&differences, at)
        })
        .min_by(|a, b| parameters[*a].cmp(&parameters[*b]).then(by_mean(a, b)))?;
    Some((best, chosen))
}

/// Select on even runs and evaluate on odd ones, and the other way round.
fn cross_fitted(by_run: &[Vec<f64>], parameters: &[usize]) -> Option<f64> {
    let runs = by_run.first()?.len();
    let half = |parity: usize| (0..runs).filter(|run| run % 2 == parity).collect::<Vec<_>>();
    let (even, odd) = (half(0), half(1));
    if odd.is_empty() {
        return None;
    }
    let fit = |choose: &[usize], judge: &[usize]| {
        let (_, chosen) = one_standard_error(by_run, parameters, choose)?;
        Some(mean(&by_run[chosen], judge))
    };
    Some(0.5 * (fit(&even, &odd)? + fit(&odd, &even)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_model_within_one_standard_error_is_chosen() {
        // Three combinations of 100, 10 and 1 parameters over four runs. The second is worse by 0.01 +- 0.02 on average, which its standard error covers; the third by 0.5.
        let best = vec![1.0, 1.1, 0.9, 1.0];
        let close = vec![1.05, 1.07, 0.93, 0.99];
        let poor = vec![1.5, 1.6, 1.4, 1.5];
        let found = one_standard_error(&[best, close, poor], &[100, 10, 1], &[0, 1, 2, 3]);
        assert_eq!(found, Some((0, 1)));
    }

    #[test]
    fn cross_fitting_evaluates_on_the_other_half() {
        // The first combination is right on even runs, the second on odd ones. Each half selects its own best combination, which has an error of 2 on the other half.
        let errors = [vec![1.0, 2.0, 1.0, 2.0], vec![2.0, 1.0, 2.0, 1.0]];
        assert_eq!(cross_fitted(&errors, &[1, 1]), Some(2.0));
    }

    #[test]
    fn upstreams_layout_starts_at_two_steps() {
        let base = FitConfig {
            layout: LayoutKind::KlaskRl,
            history_steps: 10,
            width: 64,
            hidden_layers: 3,
            epochs: 1,
            batch: 1,
            learning_rate: 1e-3,
            schedule: super::super::fit::Schedule::Cosine,
            horizon: 1,
            seed: 5,
        };
        let configs = configs(&base, 8);
        assert_eq!(configs.len(), 72);
        assert_eq!(configs.iter().map(|c| c.history_steps).min(), Some(2));
        assert_eq!(configs[7].seed, 12);
    }
}
