//! `gap.json`, version 2: the document that `klasktron gap` writes.
//!
//! `datasets_schema/gap.schema.json` is its JSON Schema. Numbers are finite; a value that does not exist is null.

use super::{estimates::ParameterEstimate, journal::JournalEntry};
use crate::{
    effects::{Axis, Domain},
    twin::StageKind,
};
use serde::{Deserialize, Serialize};

/// Version of the document.
pub(super) const SCHEMA_VERSION: u32 = 2;

/// Answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// At least one effect passed every check.
    Named,
    /// No effect is missing: every residual is at its floor.
    None,
    /// No effect is missing, and known parameters changed.
    RefitOnly,
    /// Several effects fit equally well.
    Ambiguous,
    /// The residual is above its floor, and no effect of the catalogue explains it.
    Unexplained,
    /// These recordings cannot show it.
    NotTestable,
    /// The recordings are of another machine, or of a rebuilt one.
    DifferentMachine,
    /// Command and motion are unrelated.
    InputNotConnected,
}

impl Verdict {
    /// Return whether this is a verdict about the machine: status 0, and a twin is written.
    #[must_use]
    pub fn is_about_the_machine(self) -> bool {
        !matches!(self, Self::NotTestable | Self::DifferentMachine | Self::InputNotConnected)
    }
}

/// Signal and state of the machine that hold a part of the squared residual.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Localization {
    /// Stage of the measured chain.
    pub stage: Domain,
    /// Axis, such as `a`, `x` or `all`.
    pub location: String,
    /// Signal in which it is largest.
    pub signal: String,
    /// State of motion, such as "at reversals".
    pub condition: String,
    /// Fraction of the squared residual above the floor, over all signals, 0 to 1.
    pub fraction: f64,
}

/// One parameter of an identified effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IdentifiedParameter {
    /// Name, with the unit in it.
    pub name: String,
    /// Value in the final twin.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// 95 % interval; null where the data do not determine the parameter.
    pub ci95: Option<[f64; 2]>,
    /// The value is outside the catalogue's plausible range, which is an estimate.
    pub outside_plausible_range: bool,
}

/// Evidence for an identified effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Gain of the Gaussian log score (natural logarithm) on the validation sessions, summed over their samples, under
    /// the whitened residual variance of the training sessions.
    pub log_score_gain: Option<f64>,
    /// Standard error of `log_score_gain`, clustered by blocks of time.
    pub standard_error: Option<f64>,
    /// Tail probability of the screening test, Bonferroni-corrected for `comparisons`.
    pub p_value: f64,
    /// Data to which `p_value` refers.
    pub data: String,
    /// Number of comparisons for which `p_value` is corrected.
    pub comparisons: usize,
}

/// An effect that was identified and added to the twin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct IdentifiedEffect {
    /// Dotted name from the catalogue.
    pub name: String,
    /// Axis on which it acts.
    pub location: Axis,
    /// Its parameters.
    pub parameters: Vec<IdentifiedParameter>,
    /// Evidence for it.
    pub evidence: Evidence,
    /// RMS of the residual of `signal` on the validation sessions before the effect was added.
    pub rmse_before: Option<f64>,
    /// The same afterwards.
    pub rmse_after: Option<f64>,
    /// Signal that the effect changes most.
    pub signal: Option<String>,
    /// Unit of `rmse_before` and `rmse_after`.
    pub unit: Option<String>,
    /// Fraction of the squared whitened residual on the validation sessions that it removes, at most 1; below zero
    /// where it adds to it, null without validation sessions.
    pub validation_gain: Option<f64>,
    /// Explanation in a few sentences.
    pub explanation: String,
    /// All fitted parameters of the stage after this step, by ordinary least squares with each signal in units of its
    /// RMS. Later steps change them.
    pub estimates_after_step: Vec<ParameterEstimate>,
}

/// Effects that the data cannot distinguish.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Indistinguishable {
    /// Names of the effects, the best fit first.
    pub names: Vec<String>,
    /// Motion that would distinguish them.
    pub experiment: String,
}

/// A candidate that was not added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedEffect {
    /// Dotted name from the catalogue.
    pub name: String,
    /// Axis on which it was tried.
    pub location: Axis,
    /// Reason of the rejection.
    pub reason: String,
    /// F statistic of the screening test on the training sessions; null where the effect was not tested.
    pub statistic: Option<f64>,
    /// Its tail probability, not corrected; null where the effect was not tested.
    pub p_value: Option<f64>,
    /// Fraction of the squared whitened residual on the validation sessions that it would remove; null where it was
    /// not simulated.
    pub validation_gain: Option<f64>,
}

/// Residual RMS of one signal in one band.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SignalResidual {
    /// Stage of the measured chain.
    pub stage: Domain,
    /// Signal.
    pub signal: String,
    /// Unit of all values.
    pub unit: String,
    /// Frequency band.
    pub band: String,
    /// Noise floor; null where it could not be measured.
    pub noise_floor: Option<f64>,
    /// Method of the noise floor.
    pub noise_floor_source: String,
    /// RMS on the training sessions with the given twin.
    pub train_before: Option<f64>,
    /// RMS on the training sessions with the final twin.
    pub train_after: Option<f64>,
    /// RMS on the validation sessions with the given twin.
    pub validation_before: Option<f64>,
    /// RMS on the validation sessions with the final twin.
    pub validation_after: Option<f64>,
}

/// A parameter of the given twin that changed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ParameterChange {
    /// Dotted name of the effect, then the parameter. The friction of a striker on a soft magnet, which the twin keeps
    /// with the spring, is `coupling.striker_friction.force_n`.
    pub name: String,
    /// Axis on which the effect acts.
    pub location: Axis,
    /// Value in the given twin.
    pub before: f64,
    /// Value in the final twin.
    pub after: f64,
    /// 95 % interval of the new value.
    pub ci95: Option<[f64; 2]>,
    /// Unit.
    pub unit: String,
}

/// Sparse equation of the residual where no effect of the catalogue explains it. It is a description, not a cause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Fitted stage.
    pub stage: StageKind,
    /// The equation as text: the force F along the coordinate that the twin lacks.
    pub equation: String,
    /// Its terms, in the order in which they were added.
    pub terms: Vec<DescriptionTerm>,
    /// Scales of the symbols of the features: (quantity - origin) / scale.
    pub scales: Vec<DescriptionScale>,
    /// Fraction of the squared whitened residual on the validation sessions that all terms remove; null without
    /// validation sessions.
    pub validation_gain: Option<f64>,
}

/// One term of a [`Description`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DescriptionTerm {
    /// Dimensionless feature, such as `v |v|`.
    pub feature: String,
    /// Axis on which the force acts.
    pub location: Axis,
    /// Its coefficient.
    pub coefficient: f64,
    /// 95 % interval of the coefficient.
    pub ci95: [f64; 2],
    /// Unit of the coefficient.
    pub unit: String,
    /// The term in the language of `--effects`.
    pub expression: String,
    /// Tail probability of the screening test, Bonferroni-corrected for `comparisons`.
    pub p_value: f64,
    /// Number of comparisons for which `p_value` is corrected.
    pub comparisons: usize,
    /// Fraction of the squared whitened residual on the validation sessions that it removes; null without validation
    /// sessions.
    pub validation_gain: Option<f64>,
    /// Other features that describe the data equally well.
    pub indistinguishable: Vec<String>,
}

/// A symbol in the features of a [`Description`]: (quantity - `origin`) / `scale`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct DescriptionScale {
    /// Symbol.
    pub symbol: String,
    /// Quantity, such as `velocity`.
    pub quantity: String,
    /// Value at which the symbol is zero.
    pub origin: f64,
    /// Size at which it is one.
    pub scale: f64,
    /// Unit of both.
    pub unit: String,
}

/// The recording that would answer an open question.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NextExperiment {
    /// Command line that records it; null for a machine that klasktron does not drive.
    pub command: Option<String>,
    /// Motion in words.
    pub motion: String,
    /// Question that it decides.
    pub decides: String,
}

/// `gap.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Document {
    /// Always 2.
    pub schema_version: u32,
    /// Answer in one word.
    pub verdict: Verdict,
    /// Answer in one or two sentences.
    pub summary: String,
    /// Signals and states that hold the residual of the given twin, the largest fraction first.
    pub localization: Vec<Localization>,
    /// Effects that were added, in the order of the search.
    pub effects: Vec<IdentifiedEffect>,
    /// Sets of effects that the data cannot distinguish.
    pub indistinguishable: Vec<Indistinguishable>,
    /// Every other candidate.
    pub rejected: Vec<RejectedEffect>,
    /// Residual RMS of each signal, before and after.
    pub residuals: Vec<SignalResidual>,
    /// Parameters of the given twin that changed.
    pub parameter_changes: Vec<ParameterChange>,
    /// Sparse equation of an unexplained residual; null where the verdict is another one, and where no feature passed.
    pub description: Option<Description>,
    /// Recording that would resolve the open question.
    pub next_experiment: Option<NextExperiment>,
    /// Warnings about data and fit, as sentences.
    pub warnings: Vec<String>,
    /// Decisions of the search, in order.
    pub journal: Vec<JournalEntry>,
}

impl Document {
    /// The warnings that say more than the summary.
    pub fn doubts(&self) -> impl Iterator<Item = &String> {
        self.warnings.iter().filter(|warning| **warning != self.summary)
    }
}
