//! `gap.json`: the contract's document of what was found.

use super::numbers::Number;
use crate::effects::{Axis, Domain};
use serde::{Deserialize, Serialize};

/// Version of the document.
pub(super) const SCHEMA_VERSION: u32 = 1;

/// The answer in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// At least one effect passed every check.
    Named,
    /// Nothing is missing above the noise floor.
    None,
    /// Only values of known parameters are off.
    RefitOnly,
    /// Several names fit equally well.
    Ambiguous,
    /// Something is missing and is not in the catalogue.
    Unexplained,
    /// This excitation cannot show it.
    NotTestable,
    /// Another machine, or a changed one.
    DifferentMachine,
    /// Command and motion are unrelated.
    InputNotConnected,
}

/// Where a gap sits.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Where {
    /// Part of the chain.
    pub domain: Domain,
    /// Axis, such as `a`, `x` or `all`.
    pub axis: String,
    /// Signal in which it shows most.
    pub signal: String,
    /// When, as text.
    pub condition: String,
    /// Share of the whole gap, 0 to 1.
    pub share_of_gap: f64,
}

/// One number of a named effect.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedParameter {
    /// Its name with the unit in it.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// Its unit.
    pub unit: String,
    /// 95 % interval.
    pub ci95: Option<[f64; 2]>,
    /// Outside the catalogue's range, which is an estimate.
    pub implausible: bool,
}

/// An effect that was named and added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NamedEffect {
    /// Canonical name.
    pub name: String,
    /// Where it acts.
    pub axis: Axis,
    /// Its numbers.
    pub parameters: Vec<NamedParameter>,
    /// Probability by chance, corrected for all tries.
    pub p_value: f64,
    /// RMS of the signal that it changes most, on held-out data, before it was added.
    pub gap_before: Option<f64>,
    /// The same after.
    pub gap_after: Option<f64>,
    /// The signal of both, with its unit.
    pub gap_signal: Option<String>,
    /// Share of the held-out squared error (whitened) that it removes, 0 to 1.
    pub held_out_gain: f64,
    /// All fitted numbers of its link when it had been added, by plain least squares (each signal in units of
    /// its RMS): later effects move them.
    pub numbers_when_added: Vec<Number>,
    /// One sentence.
    pub why: String,
}

/// Names that the data cannot tell apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Class {
    /// The names, the best first.
    pub names: Vec<String>,
    /// What would tell them apart.
    pub experiment: String,
}

/// A candidate that was not added.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RejectedEffect {
    /// Canonical name.
    pub name: String,
    /// Where it was tried.
    pub axis: Axis,
    /// Why not.
    pub reason: String,
    /// F of the block test.
    pub statistic: f64,
    /// Its tail probability, not corrected.
    pub p_value: f64,
    /// Share of the held-out squared error that it would remove; null where it was not simulated.
    pub held_out_gain: Option<f64>,
}

/// The gap of one signal in one band.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SignalGap {
    /// Part of the chain.
    pub domain: Domain,
    /// Signal.
    pub signal: String,
    /// Unit of all numbers.
    pub unit: String,
    /// Band, as text.
    pub band: String,
    /// Noise floor; null where none could be measured.
    pub noise_floor: Option<f64>,
    /// How the floor was measured.
    pub noise_floor_source: String,
    /// RMS on fitted sessions with the given twin.
    pub train_before: Option<f64>,
    /// RMS on fitted sessions with the final twin.
    pub train_after: Option<f64>,
    /// RMS on held-out sessions with the given twin.
    pub held_out_before: Option<f64>,
    /// RMS on held-out sessions with the final twin.
    pub held_out_after: Option<f64>,
}

/// A known parameter that moved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Refit {
    /// Dotted name of the effect, then the parameter.
    pub name: String,
    /// Where it acts.
    pub axis: Axis,
    /// Value in the given twin.
    pub before: f64,
    /// Value in the final twin.
    pub after: f64,
    /// 95 % interval of the new value.
    pub ci95: Option<[f64; 2]>,
    /// Unit.
    pub unit: String,
}

/// `gap.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Document {
    /// Always 1.
    pub schema_version: u32,
    /// The answer.
    pub verdict: Verdict,
    /// The answer in a sentence, with what to do.
    pub says: String,
    /// Where the gap sits.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
    /// What was added, the first found first.
    pub effects: Vec<NamedEffect>,
    /// Names that cannot be told apart.
    pub class: Vec<Class>,
    /// Everything else that was tried.
    pub rejected: Vec<RejectedEffect>,
    /// The gap by signal and band.
    pub gap: Vec<SignalGap>,
    /// Known parameters that moved.
    pub refit: Vec<Refit>,
    /// A `collect` command that would decide what is left.
    pub next_experiment: Option<String>,
    /// What is doubtful about the data or the fit.
    pub doubts: Vec<String>,
}
