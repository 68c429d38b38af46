//! Journal of the search: every decision with its comparison, its checks and its reason, in order.

use crate::{
    effects::{Axis, Effect},
    twin::StageKind,
};
use serde::{Deserialize, Serialize};

/// Kind of a decision.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MoveKind {
    /// The data are refused before any fit.
    Refuse,
    /// The known parameters are fitted again.
    Refit,
    /// The given twin stays as it is.
    Keep,
    /// One-off disturbances are excluded.
    Mask,
    /// An effect is added.
    Add,
    /// A parameter shared by two motors or two axes becomes one per motor or axis.
    Split,
    /// An effect is removed.
    Remove,
    /// The search ends.
    Stop,
    /// A feature describes the residual that no effect explains.
    Describe,
}

/// One move of the search.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Move {
    /// Kind of the move.
    pub kind: MoveKind,
    /// Stage on which it was made; null for a move that concerns all stages.
    pub stage: Option<StageKind>,
    /// Dotted name of the effect, where one is concerned.
    pub effect: Option<String>,
    /// Axis on which the effect acts.
    pub location: Option<Axis>,
}

/// Comparison behind a decision. Values that were not computed are null.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct MoveComparison {
    /// Fraction of the squared whitened residual on the training sessions that the move removes.
    pub training_gain: Option<f64>,
    /// The same on the validation sessions.
    pub validation_gain: Option<f64>,
    /// Tail probability on the training sessions, corrected for `comparisons`.
    pub p_value: Option<f64>,
    /// Number of comparisons for which `p_value` is corrected.
    pub comparisons: Option<usize>,
    /// Effect that came second.
    pub runner_up: Option<String>,
}

/// One decision.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct JournalEntry {
    /// The move.
    #[serde(rename = "move")]
    pub made: Move,
    /// Comparison behind it; null where nothing was compared.
    pub comparison: Option<MoveComparison>,
    /// Checks that it passed.
    pub checks: Vec<String>,
    /// Reason, as a sentence.
    pub reason: String,
}

impl JournalEntry {
    /// A decision on `stage` for `reason`, with nothing compared.
    #[must_use]
    pub(super) fn new(kind: MoveKind, stage: Option<StageKind>, reason: impl Into<String>) -> Self {
        Self {
            made: Move { kind, stage, effect: None, location: None },
            comparison: None,
            checks: Vec::new(),
            reason: reason.into(),
        }
    }

    /// The same about `effect` at `axis`.
    #[must_use]
    pub(super) fn about(mut self, effect: &Effect, axis: Axis) -> Self {
        self.made.effect = Some(effect.name.to_owned());
        self.made.location = Some(axis);
        self
    }

    /// The same with its `comparison`.
    #[must_use]
    pub(super) fn compared(mut self, comparison: MoveComparison) -> Self {
        self.comparison = Some(MoveComparison {
            training_gain: comparison.training_gain.filter(|gain| gain.is_finite()),
            validation_gain: comparison.validation_gain.filter(|gain| gain.is_finite()),
            p_value: comparison.p_value.filter(|p| p.is_finite()),
            ..comparison
        });
        self
    }

    /// The same with the checks that were passed.
    #[must_use]
    pub(super) fn passed(mut self, checks: &[&str]) -> Self {
        self.checks.extend(checks.iter().map(|check| (*check).to_owned()));
        self
    }
}
