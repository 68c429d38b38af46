//! From finished fits to a judgement that can be trusted: which seed, how good, beside what.

use super::{
    ablation::{self, Ablation, AblationFit},
    baseline::{Arx, Ideal, LagDelay},
    coverage::Coverage,
    dataset::{DataWarning, Dataset, InputFile},
    fit::{Fit, FitConfig},
    judge::{Component, ErrorRow, HORIZONS_S, Judgement, LONGEST_HORIZON_S},
    model::VelocityModel,
    run::{Run, Target},
};
use crate::{
    provenance::Provenance,
    stats::{Interval, bootstrap_ci95},
};
use serde::Serialize;
use std::fmt;

/// Held-out over training error above which the report speaks of overfitting. A network that
/// follows the physics stays near 1 to 2; one that memorises windows is tens of times off.
const OVERFIT_RATIO: f64 = 3.0;

/// Share of held-out samples outside the training data's coverage that is worth a word.
const OUTSIDE_SHARE: f64 = 0.01;

/// Attachment with the weights of a seed.
#[must_use]
pub fn weights_name(seed: u64) -> String {
    format!("weights/seed_{seed}.safetensors")
}

/// One fit with its errors.
#[derive(Debug, Clone)]
pub struct Judged {
    /// The fit.
    pub fit: Fit,
    /// Its errors on the held-out runs.
    pub judgement: Judgement,
}

/// The outcome of `fit-actuator`.
#[derive(Debug, Clone)]
pub struct Study {
    /// The runs.
    pub dataset: Dataset,
    /// Every finished seed of the chosen configuration, by seed.
    pub seeds: Vec<Judged>,
    /// Position of the median seed by free-running error: the model that is exported. A median is
    /// not made better than it is by choosing, as the best of several would be.
    pub chosen: usize,
    /// Ideal actuator, lag with delay, linear ARX.
    pub baselines: Baselines,
    /// The ablation, where one was asked for.
    pub ablation: Option<Ablation>,
    /// Each finished fit of the ablation.
    pub ablation_points: Vec<AblationFit>,
    /// Where the training data lies.
    pub coverage: Coverage,
    /// Samples that every model is given before it predicts: the longest history of all fits.
    pub history: usize,
    /// Fits that were asked for.
    pub asked: usize,
    /// Fits that are finished.
    pub finished: usize,
}

/// The simpler models with their errors.
#[derive(Debug, Clone)]
pub struct Baselines {
    /// First-order lag with delay.
    pub lag_delay: LagDelay,
    /// Linear regression on the same history.
    pub arx: Arx,
    /// Errors of `ideal`, `lag_delay` and `arx`, in this order.
    pub judgements: [Judgement; 3],
}

impl Baselines {
    /// Fits and judges the simpler models.
    #[must_use]
    pub fn fit(dataset: &Dataset, history_steps: usize) -> Self {
        let (train, held_out, dt) = (dataset.train(), dataset.held_out(), dataset.dt());
        let lag_delay = LagDelay::fit(&train, dt);
        let arx = Arx::fit(&train, history_steps);
        let models: [&dyn VelocityModel; 3] = [&Ideal, &lag_delay, &arx];
        let judgements = models.map(|model| Judgement::new(model, &held_out, history_steps, dt));
        Self { lag_delay, arx, judgements }
    }
}

/// What a study was asked to do, beside its data.
#[derive(Debug, Clone, Copy)]
pub enum StudyKind {
    /// Several seeds of one configuration.
    Seeds,
    /// Several seeds of every configuration of the ablation.
    Ablation,
}

impl Study {
    /// Judges `fits`, of which `asked` were asked for. `None` when there are none.
    #[must_use]
    pub fn new(dataset: Dataset, fits: Vec<Fit>, asked: usize, kind: StudyKind) -> Option<Self> {
        // Every model is judged from the same samples: after the longest history.
        let history = fits.iter().map(|fit| fit.config.history_steps).max()?;
        let held_out = dataset.held_out();
        let judgements: Vec<Judgement> = fits
            .iter()
            .map(|fit| Judgement::new(&fit.model, &held_out, history, dataset.dt()))
            .collect();
        let (ablation, ablation_points) = match kind {
            StudyKind::Seeds => (None, Vec::new()),
            StudyKind::Ablation => (
                ablation::select(&fits, &judgements),
                fits.iter().zip(&judgements).map(|(fit, j)| AblationFit::of(fit, j)).collect(),
            ),
        };
        let finished = fits.len();
        let mut seeds: Vec<Judged> = fits
            .into_iter()
            .zip(judgements)
            .map(|(fit, judgement)| Judged { fit, judgement })
            .collect();
        if let Some(cell) = ablation.as_ref().map(|ablation| &ablation.cells[ablation.chosen]) {
            seeds.retain(|judged| {
                let config = &judged.fit.config;
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
            asked,
            finished,
        })
    }

    /// The median seed.
    #[must_use]
    pub fn chosen(&self) -> &Judged {
        &self.seeds[self.chosen]
    }

    /// How the network compares with the best of the simpler models.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let network = self.chosen().judgement.free_running_by_run();
        let error =
            |judgement: &&Judgement| judgement.free_running(LONGEST_HORIZON_S, Component::Both);
        let rival = self
            .baselines
            .judgements
            .iter()
            .filter(|judgement| error(judgement).is_finite())
            .min_by(|a, b| error(a).total_cmp(&error(b)));
        let Some(rival) = rival else {
            return Verdict { rival: "none", difference_m_per_s: 0.0, ci95_m_per_s: None };
        };
        let differences: Vec<f64> =
            network.iter().zip(rival.free_running_by_run()).map(|(n, r)| n - r).collect();
        let mean = |drawn: &[&f64]| drawn.iter().copied().sum::<f64>() / drawn.len() as f64;
        Verdict {
            rival: rival.model,
            difference_m_per_s: differences.iter().sum::<f64>() / differences.len().max(1) as f64,
            ci95_m_per_s: bootstrap_ci95(&differences, 0, mean),
        }
    }

    /// Held-out over training error, one step ahead, of the median seed.
    #[must_use]
    pub fn overfit_ratio(&self) -> f64 {
        let train = self.chosen().fit.curve.last().map_or(f64::NAN, |e| e.train_rmse_m_per_s);
        self.chosen().judgement.one_step(Component::Both) / train
    }

    /// Share of held-out samples outside the coverage of the training data.
    #[must_use]
    pub fn share_outside(&self) -> f64 {
        let runs = self.dataset.held_out();
        let samples: usize = runs.iter().map(|run| run.len()).sum();
        let outside: f64 =
            runs.iter().map(|run| self.coverage.share_outside(run) * run.len() as f64).sum();
        outside / samples.max(1) as f64
    }

    /// Everything that a user should know before trusting the model.
    #[must_use]
    pub fn warnings(&self) -> Vec<Warning> {
        let mut warnings: Vec<Warning> =
            self.dataset.warnings.iter().cloned().map(Warning::Data).collect();
        if self.finished < self.asked {
            warnings.push(Warning::Unfinished { finished: self.finished, asked: self.asked });
        }
        let ratio = self.overfit_ratio();
        if OVERFIT_RATIO < ratio {
            let samples = self.dataset.train.iter().map(Run::len).sum();
            warnings.push(Warning::Overfits { ratio, samples });
        }
        let verdict = self.verdict();
        if verdict.ci95_m_per_s.is_none_or(|ci| 0.0 <= ci.high) {
            warnings.push(Warning::NotBetter { rival: verdict.rival });
        }
        if self.dataset.held_out.len() < 2 {
            warnings.push(Warning::OneHeldOutRun);
        }
        let share = self.share_outside();
        if OUTSIDE_SHARE < share {
            warnings.push(Warning::OutsideCoverage { share });
        }
        warnings
    }

    /// Every model with the name of its topic: each seed, then the simpler ones.
    pub(super) fn models(&self) -> Vec<(String, &dyn VelocityModel)> {
        let seeds = self.seeds.iter().map(|judged| {
            let model: &dyn VelocityModel = &judged.fit.model;
            (format!("seed_{}", judged.fit.config.seed), model)
        });
        let simpler: [&dyn VelocityModel; 3] =
            [&self.baselines.arx, &self.baselines.lag_delay, &Ideal];
        seeds.chain(simpler.map(|model| (model.name().to_owned(), model))).collect()
    }

    /// Free-running over the whole of `run`, from the sample after the history.
    pub(super) fn whole_run(&self, model: &dyn VelocityModel, run: &Run) -> Vec<[f64; 2]> {
        let history = self.history;
        if run.len() <= history {
            return Vec::new();
        }
        model.simulate(run, &[history - 1], run.len() - history)
    }

    /// The result as a document.
    #[must_use]
    pub fn summary(&self, provenance: Provenance) -> Summary {
        let side = |runs: &[Run]| {
            let samples: usize = runs.iter().map(Run::len).sum();
            let duration_s = samples as f64 * self.dataset.dt();
            Side { runs: runs.len(), samples, duration_s }
        };
        let judged = self.baselines.judgements.iter();
        let errors = [&self.chosen().judgement].into_iter().chain(judged);
        Summary {
            schema_version: 1,
            provenance,
            inputs: self.dataset.inputs.clone(),
            robot: self.dataset.robot.clone(),
            player: self.dataset.player.name(),
            target: self.dataset.config.target,
            rate_hz: self.dataset.config.rate_hz,
            train: side(&self.dataset.train),
            held_out: side(&self.dataset.held_out),
            fits_asked: self.asked,
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
            lag_delay: self.baselines.lag_delay.axes,
            verdict: self.verdict(),
            overfit_ratio: self.overfit_ratio(),
            held_out_share_outside_coverage: self.share_outside(),
            errors: errors.flat_map(Judgement::rows).collect(),
            ablation: self.ablation.clone(),
            warnings: self.warnings().iter().map(ToString::to_string).collect(),
        }
    }

    fn spread(&self, figure: &dyn Fn(&Judgement) -> f64) -> Spread {
        let mut values: Vec<f64> = self.seeds.iter().map(|s| figure(&s.judgement)).collect();
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

/// Position of the seed with the median free-running error; the lower of the two middle ones.
fn median_position(seeds: &[Judged]) -> Option<usize> {
    let error = |position: &usize| {
        seeds[*position].judgement.free_running(LONGEST_HORIZON_S, Component::Both)
    };
    let mut order: Vec<usize> = (0..seeds.len()).collect();
    order.sort_by(|a, b| error(a).total_cmp(&error(b)));
    order.get(seeds.len().saturating_sub(1) / 2).copied()
}

/// Network minus the best simpler model: mean over held-out runs of the free-running error.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Verdict {
    /// The best of `ideal`, `lag_delay` and `arx`.
    pub rival: &'static str,
    /// Negative when the network is better (m/s).
    pub difference_m_per_s: f64,
    /// By bootstrap over runs; null for fewer than two held-out runs.
    pub ci95_m_per_s: Option<Interval>,
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let rival = self.rival;
        let by = self.difference_m_per_s.abs();
        match self.ci95_m_per_s {
            Some(ci) if ci.high < 0.0 => write!(f, "the network is better than {rival} by")?,
            Some(ci) if 0.0 < ci.low => write!(f, "{rival} is better than the network by")?,
            Some(_) => write!(f, "the held-out runs cannot tell the network from {rival}:")?,
            None => write!(f, "one held-out run cannot tell the network from {rival}:")?,
        }
        write!(f, " {:.2} mm/s free-running over {} s", 1e3 * by, LONGEST_HORIZON_S)?;
        match self.ci95_m_per_s {
            Some(Interval { low, high }) => {
                write!(f, " (network minus {rival}, 95 %: {:.2} to {:.2})", 1e3 * low, 1e3 * high)
            }
            None => Ok(()),
        }
    }
}

/// Something to know before the model is trusted.
#[derive(Debug, Clone, PartialEq)]
pub enum Warning {
    /// About the inputs.
    Data(DataWarning),
    /// Interrupted.
    Unfinished {
        /// Finished fits.
        finished: usize,
        /// Asked for.
        asked: usize,
    },
    /// Far better on what it was fitted to.
    Overfits {
        /// Held-out over training error.
        ratio: f64,
        /// Training samples.
        samples: usize,
    },
    /// A simpler model is as good.
    NotBetter {
        /// Its name.
        rival: &'static str,
    },
    /// No interval can be given.
    OneHeldOutRun,
    /// The held-out runs ask about what was not seen.
    OutsideCoverage {
        /// Share of samples, 0 to 1.
        share: f64,
    },
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Data(warning) => write!(f, "{warning}"),
            Self::Unfinished { finished, asked } => write!(
                f,
                "only {finished} of {asked} fits are finished; the same command again continues"
            ),
            Self::Overfits { ratio, samples } => write!(
                f,
                "the network overfits: its error on held-out runs is {ratio:.1} times that on the \
                 {samples} samples it was fitted to; record more runs, or use a simpler model"
            ),
            Self::NotBetter { rival } => {
                write!(f, "the network is not shown to be better than {rival} on held-out runs")
            }
            Self::OneHeldOutRun => write!(f, "one held-out run gives no confidence interval"),
            Self::OutsideCoverage { share } => write!(
                f,
                "{:.1} % of the held-out samples lie outside the (command, velocity) pairs that \
                 were fitted; there the model extrapolates",
                100.0 * share
            ),
        }
    }
}

/// Runs on one side of the split.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Side {
    /// How many runs.
    pub runs: usize,
    /// How many samples.
    pub samples: usize,
    /// How long (s).
    pub duration_s: f64,
}

/// Over seeds (m/s).
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
    /// Over seeds (m/s).
    #[serde(flatten)]
    pub spread: Spread,
}

/// One seed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SeedSummary {
    /// The seed.
    pub seed: u64,
    /// One step ahead over the last epoch's training windows (m/s).
    pub train_rmse_m_per_s: Option<f64>,
    /// One step ahead on held-out runs (m/s).
    pub one_step_rmse_m_per_s: f64,
    /// Free-running on held-out runs over each horizon of [`HORIZONS_S`] (m/s).
    pub free_running_rmse_m_per_s: [f64; 3],
    /// Attachment with its weights.
    pub weights: String,
}

impl SeedSummary {
    fn of(judged: &Judged) -> Self {
        let seed = judged.fit.config.seed;
        Self {
            seed,
            train_rmse_m_per_s: judged.fit.curve.last().map(|epoch| epoch.train_rmse_m_per_s),
            one_step_rmse_m_per_s: judged.judgement.one_step(Component::Both),
            free_running_rmse_m_per_s: HORIZONS_S
                .map(|horizon| judged.judgement.free_running(horizon, Component::Both)),
            weights: weights_name(seed),
        }
    }
}

/// The result as a document.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// 1.
    pub schema_version: u32,
    /// How it was made.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// From what.
    pub inputs: Vec<InputFile>,
    /// Metadata `robot` of the recordings.
    pub robot: String,
    /// Which gantry.
    pub player: &'static str,
    /// Which motion.
    pub target: Target,
    /// Samples per second.
    pub rate_hz: f64,
    /// What was fitted.
    pub train: Side,
    /// What judged.
    pub held_out: Side,
    /// Fits that were asked for.
    pub fits_asked: usize,
    /// Fits that are finished.
    pub fits_finished: usize,
    /// Settings of the model that is exported.
    pub chosen: FitConfig,
    /// One step ahead on held-out runs, over seeds.
    pub one_step_rmse_m_per_s: Spread,
    /// Free-running on held-out runs, over seeds.
    pub free_running_rmse_m_per_s: Vec<HorizonSpread>,
    /// Every seed.
    pub seeds: Vec<SeedSummary>,
    /// The fitted lag with delay, x and y.
    pub lag_delay: [super::Lag; 2],
    /// Network against the best simpler model.
    pub verdict: Verdict,
    /// Held-out over training error, one step ahead.
    pub overfit_ratio: f64,
    /// Share of held-out samples outside what was fitted, 0 to 1.
    pub held_out_share_outside_coverage: f64,
    /// Every figure with its interval; the network's are those of the chosen seed.
    pub errors: Vec<ErrorRow>,
    /// The ablation, where one was asked for.
    pub ablation: Option<Ablation>,
    /// What to know before the model is trusted.
    pub warnings: Vec<String>,
}
