//! Evaluation of finished fits: selection of a seed, metrics with intervals, comparison with
//! baselines.

use super::{
    ablation::{self, Ablation, AblationFit},
    baseline::{Arx, Fopdt, Ideal},
    coverage::Coverage,
    dataset::{DataWarning, Dataset, InputFile},
    evaluation::{Component, ErrorRow, Evaluation, HORIZONS_S, LONGEST_HORIZON_S},
    fit::{Fit, FitConfig},
    model::VelocityModel,
    run::{Run, Target},
};
use crate::{
    provenance::Provenance,
    stats::{Interval, bootstrap_ci95},
};
use serde::Serialize;
use std::fmt;

/// Ratio of held-out to training error above which the report warns of overfitting. A network that
/// follows the physics stays near 1 to 2; one that memorises windows exceeds 10.
const OVERFIT_RATIO: f64 = 3.0;

/// Fraction of held-out samples outside the training coverage above which the report warns.
const OUTSIDE_FRACTION: f64 = 0.01;

/// Return the name of the attachment with the weights of a seed.
#[must_use]
pub fn weights_name(seed: u64) -> String {
    format!("weights/seed_{seed}.safetensors")
}

/// One fit with its held-out errors.
#[derive(Debug, Clone)]
pub struct EvaluatedFit {
    /// The fit.
    pub fit: Fit,
    /// Errors on the held-out runs.
    pub evaluation: Evaluation,
}

/// Outcome of `fit-actuator`.
#[derive(Debug, Clone)]
pub struct Study {
    /// Resampled runs.
    pub dataset: Dataset,
    /// Every finished seed of the selected configuration, by seed.
    pub seeds: Vec<EvaluatedFit>,
    /// Index of the median seed by free-running error, which is the exported model. A median is not
    /// biased by the selection, unlike the best of several seeds.
    pub chosen: usize,
    /// Baselines: ideal actuator, first order plus dead time, linear ARX.
    pub baselines: Baselines,
    /// Ablation, if requested.
    pub ablation: Option<Ablation>,
    /// Each finished fit of the ablation.
    pub ablation_points: Vec<AblationFit>,
    /// Coverage of the training data.
    pub coverage: Coverage,
    /// Number of samples given to every model before it predicts: the longest history of all fits.
    pub history: usize,
    /// Number of requested fits.
    pub requested: usize,
    /// Number of finished fits.
    pub finished: usize,
}

/// Baseline models with their errors.
#[derive(Debug, Clone)]
pub struct Baselines {
    /// First order plus dead time.
    pub fopdt: Fopdt,
    /// Linear regression on the same history.
    pub arx: Arx,
    /// Errors of `ideal`, `fopdt` and `arx`, in this order.
    pub evaluations: [Evaluation; 3],
}

impl Baselines {
    /// Fit and evaluate the baseline models.
    #[must_use]
    pub fn fit(dataset: &Dataset, history_steps: usize) -> Self {
        let (train, held_out, dt) = (dataset.train(), dataset.held_out(), dataset.dt());
        let fopdt = Fopdt::fit(&train, dt);
        let arx = Arx::fit(&train, history_steps);
        let models: [&dyn VelocityModel; 3] = [&Ideal, &fopdt, &arx];
        let evaluations = models.map(|model| Evaluation::new(model, &held_out, history_steps, dt));
        Self { fopdt, arx, evaluations }
    }
}

/// Kind of study.
#[derive(Debug, Clone, Copy)]
pub enum StudyKind {
    /// Several seeds of one configuration.
    Seeds,
    /// Several seeds of every configuration of the ablation.
    Ablation,
}

impl Study {
    /// Evaluate `fits`, of which `requested` were requested. Return `None` when `fits` is empty.
    #[must_use]
    pub fn new(
        dataset: Dataset,
        fits: Vec<Fit>,
        requested: usize,
        kind: StudyKind,
    ) -> Option<Self> {
        // Every model is evaluated on the same samples: after the longest history.
        let history = fits.iter().map(|fit| fit.config.history_steps).max()?;
        let held_out = dataset.held_out();
        let evaluations: Vec<Evaluation> = fits
            .iter()
            .map(|fit| Evaluation::new(&fit.model, &held_out, history, dataset.dt()))
            .collect();
        let (ablation, ablation_points) = match kind {
            StudyKind::Seeds => (None, Vec::new()),
            StudyKind::Ablation => (
                ablation::select(&fits, &evaluations),
                fits.iter().zip(&evaluations).map(|(fit, j)| AblationFit::of(fit, j)).collect(),
            ),
        };
        let finished = fits.len();
        let mut seeds: Vec<EvaluatedFit> = fits
            .into_iter()
            .zip(evaluations)
            .map(|(fit, evaluation)| EvaluatedFit { fit, evaluation })
            .collect();
        if let Some(cell) = ablation.as_ref().map(|ablation| &ablation.cells[ablation.chosen]) {
            seeds.retain(|seed| {
                let config = &seed.fit.config;
                (config.history_steps, config.width) == (cell.history_steps, cell.width)
            });
        }
        let chosen = median_position(&seeds)?;
        let baselines = Baselines::fit(&dataset, history);
        let coverage = dataset.coverage();
        Some(Self {
            dataset,
            seeds,
            chosen,
            baselines,
            ablation,
            ablation_points,
            coverage,
            history,
            requested,
            finished,
        })
    }

    /// Return the median seed.
    #[must_use]
    pub fn chosen(&self) -> &EvaluatedFit {
        &self.seeds[self.chosen]
    }

    /// Return the comparison of the network with the best baseline.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let network = self.chosen().evaluation.free_running_by_run();
        let error =
            |evaluation: &&Evaluation| evaluation.free_running(LONGEST_HORIZON_S, Component::Both);
        let baseline = self
            .baselines
            .evaluations
            .iter()
            .filter(|evaluation| error(evaluation).is_finite())
            .min_by(|a, b| error(a).total_cmp(&error(b)));
        let Some(baseline) = baseline else {
            return Verdict { baseline: "none", difference_m_per_s: 0.0, ci95_m_per_s: None };
        };
        let differences: Vec<f64> =
            network.iter().zip(baseline.free_running_by_run()).map(|(n, r)| n - r).collect();
        let mean = |drawn: &[&f64]| drawn.iter().copied().sum::<f64>() / drawn.len() as f64;
        Verdict {
            baseline: baseline.model,
            difference_m_per_s: differences.iter().sum::<f64>() / differences.len().max(1) as f64,
            ci95_m_per_s: bootstrap_ci95(&differences, 0, mean),
        }
    }

    /// Return the ratio of held-out to training error, one step ahead, of the median seed.
    #[must_use]
    pub fn overfit_ratio(&self) -> f64 {
        let train = self.chosen().fit.curve.last().map_or(f64::NAN, |e| e.train_rmse_m_per_s);
        self.chosen().evaluation.one_step(Component::Both) / train
    }

    /// Return the fraction of held-out samples outside the coverage of the training data.
    #[must_use]
    pub fn fraction_outside(&self) -> f64 {
        let runs = self.dataset.held_out();
        let samples: usize = runs.iter().map(|run| run.len()).sum();
        let outside: f64 =
            runs.iter().map(|run| self.coverage.fraction_outside(run) * run.len() as f64).sum();
        outside / samples.max(1) as f64
    }

    /// Return the warnings that a user should know before trusting the model.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings: Vec<Warning> =
            self.dataset.warnings.iter().cloned().map(Warning::Data).collect();
        if self.finished < self.requested {
            warnings
                .push(Warning::Unfinished { finished: self.finished, requested: self.requested });
        }
        let ratio = self.overfit_ratio();
        if OVERFIT_RATIO < ratio {
            let samples = self.dataset.train.iter().map(Run::len).sum();
            warnings.push(Warning::Overfits { ratio, samples });
        }
        let verdict = self.verdict();
        if verdict.ci95_m_per_s.is_none_or(|ci| 0.0 <= ci.high) {
            warnings.push(Warning::NotBetter { baseline: verdict.baseline });
        }
        if self.dataset.held_out.len() < 2 {
            warnings.push(Warning::OneHeldOutRun);
        }
        let fraction = self.fraction_outside();
        if OUTSIDE_FRACTION < fraction {
            warnings.push(Warning::OutsideCoverage { fraction });
        }
        warnings
    }

    /// Return every model with the name of its topic: each seed, then the baselines.
    pub(super) fn models(&self) -> Vec<(String, &dyn VelocityModel)> {
        let seeds = self.seeds.iter().map(|seed| {
            let model: &dyn VelocityModel = &seed.fit.model;
            (format!("seed_{}", seed.fit.config.seed), model)
        });
        let simpler: [&dyn VelocityModel; 3] = [&self.baselines.arx, &self.baselines.fopdt, &Ideal];
        seeds.chain(simpler.map(|model| (model.name().to_owned(), model))).collect()
    }

    /// Simulate the whole of `run` free-running, from the sample after the history.
    pub(super) fn whole_run(&self, model: &dyn VelocityModel, run: &Run) -> Vec<[f64; 2]> {
        let history = self.history;
        if run.len() <= history {
            return Vec::new();
        }
        model.simulate(run, &[history - 1], run.len() - history)
    }

    /// Return the result as a document.
    #[must_use]
    pub fn summary(&self, provenance: Provenance) -> Summary {
        let side = |runs: &[Run]| {
            let samples: usize = runs.iter().map(Run::len).sum();
            let duration_s = samples as f64 * self.dataset.dt();
            Side { runs: runs.len(), samples, duration_s }
        };
        let baselines = self.baselines.evaluations.iter();
        let errors = [&self.chosen().evaluation].into_iter().chain(baselines);
        Summary {
            schema_version: 2,
            provenance,
            inputs: self.dataset.inputs.clone(),
            robot: self.dataset.robot.clone(),
            player: self.dataset.player.name(),
            target: self.dataset.config.target,
            rate_hz: self.dataset.config.rate_hz,
            train: side(&self.dataset.train),
            held_out: side(&self.dataset.held_out),
            fits_requested: self.requested,
            fits_finished: self.finished,
            chosen: self.chosen().fit.config,
            one_step_rmse_m_per_s: self.spread(&|j| j.one_step(Component::Both)),
            free_running_rmse_m_per_s: HORIZONS_S
                .map(|horizon_s| HorizonSpread {
                    horizon_s,
                    spread: self.spread(&|j| j.free_running(horizon_s, Component::Both)),
                })
                .to_vec(),
            seeds: self.seeds.iter().map(SeedSummary::of).collect(),
            fopdt: self.baselines.fopdt.axes,
            verdict: self.verdict(),
            overfit_ratio: self.overfit_ratio(),
            held_out_fraction_outside_coverage: self.fraction_outside(),
            errors: errors.flat_map(Evaluation::rows).collect(),
            ablation: self.ablation.clone(),
            warnings: self.warnings().iter().map(ToString::to_string).collect(),
        }
    }

    fn spread(&self, figure: &dyn Fn(&Evaluation) -> f64) -> Spread {
        let mut values: Vec<f64> = self.seeds.iter().map(|s| figure(&s.evaluation)).collect();
        values.sort_by(f64::total_cmp);
        let middle = values.len() / 2;
        let median = if values.len() % 2 == 1 {
            values[middle]
        } else {
            0.5 * (values[middle - 1] + values[middle])
        };
        Spread { median, min: values[0], max: values[values.len() - 1] }
    }
}

/// Return the index of the seed with the median free-running error; the lower of the two middle
/// ones.
fn median_position(seeds: &[EvaluatedFit]) -> Option<usize> {
    let error = |position: &usize| {
        seeds[*position].evaluation.free_running(LONGEST_HORIZON_S, Component::Both)
    };
    let mut order: Vec<usize> = (0..seeds.len()).collect();
    order.sort_by(|a, b| error(a).total_cmp(&error(b)));
    order.get(seeds.len().saturating_sub(1) / 2).copied()
}

/// Comparison of the network with the best baseline: difference of the mean free-running error over
/// held-out runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// The best of `ideal`, `fopdt` and `arx`.
    pub baseline: &'static str,
    /// Network minus baseline (m/s); negative when the network is better.
    pub difference_m_per_s: f64,
    /// 95 % interval by bootstrap over runs; null for fewer than two held-out runs.
    pub ci95_m_per_s: Option<Interval>,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let baseline = self.baseline;
        let by = self.difference_m_per_s.abs();
        match self.ci95_m_per_s {
            Some(ci) if ci.high < 0.0 => write!(f, "the network is better than {baseline} by")?,
            Some(ci) if 0.0 < ci.low => write!(f, "{baseline} is better than the network by")?,
            Some(_) => write!(
                f,
                "no significant difference between the network and {baseline} on the held-out runs:"
            )?,
            None => write!(
                f,
                "one held-out run gives no interval for the network compared with {baseline}:"
            )?,
        }
        write!(f, " {:.2} mm/s free-running over {} s", 1e3 * by, LONGEST_HORIZON_S)?;
        match self.ci95_m_per_s {
            Some(Interval { low, high }) => {
                write!(
                    f,
                    " (network minus {baseline}, 95 %: {:.2} to {:.2})",
                    1e3 * low,
                    1e3 * high
                )
            }
            None => Ok(()),
        }
    }
}

/// Warning about the fitted model.
#[derive(Debug, Clone, PartialEq)]
pub enum Warning {
    /// Warning about the inputs.
    Data(DataWarning),
    /// The fits were interrupted.
    Unfinished {
        /// Number of finished fits.
        finished: usize,
        /// Number of requested fits.
        requested: usize,
    },
    /// The held-out error is far above the training error.
    Overfits {
        /// Ratio of held-out to training error.
        ratio: f64,
        /// Number of training samples.
        samples: usize,
    },
    /// A baseline is as good as the network.
    NotBetter {
        /// Name of the baseline.
        baseline: &'static str,
    },
    /// One held-out run gives no interval.
    OneHeldOutRun,
    /// The held-out runs leave the coverage of the training data.
    OutsideCoverage {
        /// Fraction of samples, 0 to 1.
        fraction: f64,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Data(warning) => write!(f, "{warning}"),
            Self::Unfinished { finished, requested } => write!(
                f,
                "only {finished} of {requested} fits are finished; repeat the same command to continue"
            ),
            Self::Overfits { ratio, samples } => write!(
                f,
                "the network overfits: its error on held-out runs is {ratio:.1} times that on the \
                 {samples} samples it was fitted to; record more runs, or use a simpler model"
            ),
            Self::NotBetter { baseline } => write!(
                f,
                "the network is not significantly better than {baseline} on the held-out runs"
            ),
            Self::OneHeldOutRun => write!(f, "one held-out run gives no confidence interval"),
            Self::OutsideCoverage { fraction } => write!(
                f,
                "{:.1} % of the held-out samples lie outside the (command, velocity) coverage of \
                 the training data; there the model extrapolates",
                100.0 * fraction
            ),
        }
    }
}

/// Size of one side of the split.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Side {
    /// Number of runs.
    pub runs: usize,
    /// Number of samples.
    pub samples: usize,
    /// Duration (s).
    pub duration_s: f64,
}

/// Spread of a metric over seeds (m/s).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// Median seed.
    pub median: f64,
    /// Best seed.
    pub min: f64,
    /// Worst seed.
    pub max: f64,
}

/// Spread at one horizon.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HorizonSpread {
    /// Horizon (s).
    pub horizon_s: f64,
    /// Spread over seeds (m/s).
    #[serde(flatten)]
    pub spread: Spread,
}

/// One seed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeedSummary {
    /// Seed.
    pub seed: u64,
    /// One-step-ahead error over the last epoch's training windows (m/s).
    pub train_rmse_m_per_s: Option<f64>,
    /// One-step-ahead error on held-out runs (m/s).
    pub one_step_rmse_m_per_s: f64,
    /// Free-running error on held-out runs over each horizon of [`HORIZONS_S`] (m/s).
    pub free_running_rmse_m_per_s: [f64; 3],
    /// Attachment with the weights.
    pub weights: String,
}

impl SeedSummary {
    fn of(evaluated: &EvaluatedFit) -> Self {
        let seed = evaluated.fit.config.seed;
        Self {
            seed,
            train_rmse_m_per_s: evaluated.fit.curve.last().map(|epoch| epoch.train_rmse_m_per_s),
            one_step_rmse_m_per_s: evaluated.evaluation.one_step(Component::Both),
            free_running_rmse_m_per_s: HORIZONS_S
                .map(|horizon| evaluated.evaluation.free_running(horizon, Component::Both)),
            weights: weights_name(seed),
        }
    }
}

/// Result of a study as a document.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Version of the document, 2.
    pub schema_version: u32,
    /// Provenance of the result.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Input files.
    pub inputs: Vec<InputFile>,
    /// Metadata `robot` of the recordings.
    pub robot: String,
    /// Player whose gantry is modelled.
    pub player: &'static str,
    /// Predicted motion.
    pub target: Target,
    /// Sampling rate (Hz).
    pub rate_hz: f64,
    /// Size of the training data.
    pub train: Side,
    /// Size of the held-out data.
    pub held_out: Side,
    /// Number of requested fits.
    pub fits_requested: usize,
    /// Number of finished fits.
    pub fits_finished: usize,
    /// Settings of the exported model.
    pub chosen: FitConfig,
    /// One-step-ahead error on held-out runs, over seeds.
    pub one_step_rmse_m_per_s: Spread,
    /// Free-running error on held-out runs, over seeds.
    pub free_running_rmse_m_per_s: Vec<HorizonSpread>,
    /// Results of every seed.
    pub seeds: Vec<SeedSummary>,
    /// Fitted first-order-plus-dead-time parameters of x and y.
    pub fopdt: [super::Lag; 2],
    /// Comparison of the network with the best baseline.
    pub verdict: Verdict,
    /// Ratio of held-out to training error, one step ahead.
    pub overfit_ratio: f64,
    /// Fraction of held-out samples outside the coverage of the training data, 0 to 1.
    pub held_out_fraction_outside_coverage: f64,
    /// Every metric with its interval; the network's are those of the selected seed.
    pub errors: Vec<ErrorRow>,
    /// Ablation, if requested.
    pub ablation: Option<Ablation>,
    /// Warnings about the data and the model.
    pub warnings: Vec<String>,
}
