//! The sealed answers: what is in each case, and what an honest answer to it is.

use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Version of `answers.json`.
pub(crate) const SCHEMA_VERSION: u32 = 1;

/// What kind of question a case asks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Class {
    NullClean,
    NullRefit,
    NullColoured,
    NullOutliers,
    NullFrames,
    Single,
    Two,
    Three,
    Outside,
    CannotShow,
    BadInput,
}

impl Class {
    pub(crate) const NULLS: [Self; 5] = [
        Self::NullClean,
        Self::NullRefit,
        Self::NullColoured,
        Self::NullOutliers,
        Self::NullFrames,
    ];

    pub(crate) fn is_null(self) -> bool {
        Self::NULLS.contains(&self)
    }
}

/// A parameter of a planted effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Parameter {
    pub(crate) name: String,
    pub(crate) unit: String,
    pub(crate) value: f64,
    /// What it was without the effect; null when there was nothing.
    pub(crate) before: Option<f64>,
}

/// A planted effect.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct PlantedEffect {
    pub(crate) name: String,
    pub(crate) domain: String,
    /// `a`, `b`, `x`, `y`; empty for the whole machine.
    pub(crate) axis: Vec<String>,
    pub(crate) parameters: Vec<Parameter>,
    /// Multiple of the noise that was asked for, and reached on the signal that shows it best.
    pub(crate) wanted_multiple: Option<f64>,
    pub(crate) noise_multiple: Option<f64>,
    pub(crate) signal: String,
    /// The catalogue's range ended before the wanted size.
    pub(crate) capped: bool,
    /// The plain twin has this effect; only its value changed.
    pub(crate) known: bool,
    /// Other names that the same recordings honestly allow.
    pub(crate) alike: Vec<String>,
}

/// One case.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Case {
    pub(crate) rig: String,
    pub(crate) class: Class,
    pub(crate) what: String,
    /// The excitation can show what is there.
    pub(crate) exciting: bool,
    pub(crate) effects: Vec<PlantedEffect>,
    /// Names that are no error although they are not the planted effect.
    pub(crate) tolerated: Vec<String>,
    /// Verdicts that are right; empty when only the names count.
    pub(crate) verdicts: Vec<String>,
    /// Noise of the measured signals by unit (RMS), as the generator made it.
    pub(crate) floors: BTreeMap<String, f64>,
}

/// One rig, with the recordings of its unchanged state.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Rig {
    pub(crate) kind: String,
    pub(crate) baseline: [String; 2],
    /// Effects that the rig has from the start and the plain twin lacks.
    pub(crate) own: Vec<String>,
}

/// The whole sealed document.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Answers {
    pub(crate) schema_version: u32,
    pub(crate) seed: u64,
    pub(crate) rigs: BTreeMap<String, Rig>,
    pub(crate) cases: BTreeMap<String, Case>,
}
