//! Input and result of the search on one stage.

use crate::{
    effects::{Axis, Effect},
    gap::{
        estimates::ParameterEstimate,
        evidence::LogScoreGain,
        fit::{self, Fit, Uncertainty},
        journal::JournalEntry,
        options::Context,
        problem::{Point, Problem},
        screen::Candidate,
        unknown::Unknown,
        whiten::Filters,
    },
    twin::{Discrepancy, Instance, Slot, Stage, StageKind, Twin},
};

/// One stage of the measured chain in all sessions.
pub struct StageData<'a> {
    /// Stage of the measured chain.
    pub kind: StageKind,
    /// Stage in the training sessions.
    pub train: Vec<&'a dyn Stage>,
    /// Stage in the validation sessions.
    pub held_out: Vec<&'a dyn Stage>,
    /// Another stage in the validation sessions, on which the same effects act for longer. It helps to decide whether
    /// the gain of an effect suffices.
    pub witnesses: Vec<&'a dyn Stage>,
    /// Another stage on which some of the same parameters act. A refit of these must not contradict it.
    pub companions: Vec<&'a dyn Stage>,
    /// Another stage on which all of the same effects act, and which was searched before. No added effect must contradict
    /// it.
    pub predecessors: Vec<&'a dyn Stage>,
    /// Parameters that an earlier stage determined from these recordings; they stay fixed.
    pub held: Vec<Held>,
    /// `true` where a residual above the reference may be a disturbance. `false` where errors accumulate along a whole
    /// roll.
    pub may_be_disturbed: bool,
    /// Options and observer of the search.
    pub context: Context<'a>,
}

/// Parameter of an effect on an axis, independent of its index in the twin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    effect: &'static Effect,
    axis: Axis,
    parameter: usize,
}

impl Held {
    /// Parameter in `slot`.
    #[must_use]
    pub fn of(twin: &Twin, slot: Slot) -> Self {
        let Instance { effect, axis, .. } = twin.instances[slot.instance];
        Self { effect, axis, parameter: slot.parameter }
    }
}

/// Reason why a candidate was not added.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// Its p-value, corrected for all comparisons, is above the family-wise error.
    NotSignificant,
    /// Another effect explains more, and this one adds nothing to it.
    Outperformed(String),
    /// A parameter stopped on its bound, which for most effects is the wrong sign.
    OnBound(String),
    /// The validation sessions do not confirm it.
    HeldOut,
    /// A stage that was searched before contradicts it.
    Contradicted,
    /// The sessions disagree on its sign or magnitude.
    SessionsDisagree,
    /// Its magnitude differs between low and high speeds.
    SpeedsDisagree,
    /// It is not distinguishable from a model error of the simulation.
    TooSmall,
    /// The motion does not show it beyond a change of known parameters.
    NotTestable,
}

/// Rejected candidate with the reason.
#[derive(Debug, Clone)]
pub struct Rejected {
    /// Candidate.
    pub candidate: Candidate,
    /// Reason of the rejection.
    pub reason: Reason,
    /// Fraction of the squared whitened residual on the validation sessions that it removes; `None` if it was not
    /// simulated.
    pub validation_gain: Option<f64>,
    /// Values of its parameters, if it was simulated.
    pub values: Option<Vec<f64>>,
}

/// Candidate that was simulated and fitted in a round.
#[derive(Debug, Clone)]
pub struct RankedCandidate {
    /// Effect.
    pub effect: &'static Effect,
    /// Axis on which it would act.
    pub axis: Axis,
    /// Whitened loss per row after the fit; a smaller loss is more significant.
    pub loss: f64,
    /// `true` where it passed every check.
    pub has_passed: bool,
}

/// Effect that passed every check.
#[derive(Debug, Clone)]
pub struct Added {
    /// Effect.
    pub effect: &'static Effect,
    /// Axis on which it acts.
    pub axis: Axis,
    /// Value of the parameter that was scanned for, such as a period, when the effect was added: it distinguishes
    /// several instances of one effect.
    pub scanned: Option<f64>,
    /// Probability of such a gain by chance, corrected for all comparisons.
    pub p_value: f64,
    /// Block statistic behind `p_value`.
    pub statistic: f64,
    /// Data of the test behind `p_value`.
    pub data: String,
    /// Number of comparisons for which `p_value` is corrected.
    pub comparisons: usize,
    /// Gain of the log score on the validation sessions; `None` without any, and for an effect that changes no
    /// residual.
    pub log_score: Option<LogScoreGain>,
    /// Fraction of the squared whitened residual on the validation sessions that it removes.
    pub validation_gain: f64,
    /// Other effects that explain the data equally well.
    pub indistinguishable: Vec<&'static str>,
    /// `true` where another effect, alone, removes at least half as much of the residual.
    pub has_rival: bool,
    /// Residual RMS per signal on the validation sessions before and after this step, in the order of the channels.
    pub held_out_steps: (Vec<f64>, Vec<f64>),
    /// Statistics that the effect changes where it changes no residual.
    pub unstated: Option<Unstated>,
    /// Strongest candidates of the round, the smallest loss first.
    pub ranking: Vec<RankedCandidate>,
    /// Estimates of all parameters with it, before any later step, by ordinary least squares.
    pub estimates: Vec<ParameterEstimate>,
}

/// Difference between a statistic of the validation sessions and that of the twin, before and after a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unstated {
    /// Variance of a sample (m^2).
    Variance(f64, f64),
    /// Fraction of lost frames.
    FramesLost(f64, f64),
}

impl Unstated {
    pub(in crate::gap) fn ends(self) -> (f64, f64) {
        let (Self::Variance(before, after) | Self::FramesLost(before, after)) = self;
        (before, after)
    }

    /// Variance of a sample that it accounts for (m^2).
    pub(in crate::gap) fn variance(self) -> f64 {
        match self {
            Self::Variance(before, _) => before,
            Self::FramesLost(..) => 0.0,
        }
    }
}

impl Added {
    /// Return whether `one` is this effect on this axis.
    pub(in crate::gap) fn is(&self, one: &RankedCandidate) -> bool {
        one.effect == self.effect && one.axis == self.axis
    }

    /// Its whitened loss per row.
    pub(in crate::gap) fn loss(&self) -> Option<f64> {
        self.ranking.iter().find(|one| self.is(one)).map(|own| own.loss)
    }

    /// Return whether `other` of its round passed and has a smaller loss, though it closes less of the gap.
    pub(in crate::gap) fn is_less_significant_than(&self, other: &RankedCandidate) -> bool {
        other.has_passed
            && !self.indistinguishable.contains(&other.effect.name)
            && self.loss().is_some_and(|own| other.loss < own)
    }

    /// Best candidate of the round with a larger loss and another effect.
    pub(in crate::gap) fn runner_up(&self) -> Option<&RankedCandidate> {
        let own = self.loss()?;
        self.ranking.iter().find(|other| other.effect.name != self.effect.name && own <= other.loss)
    }
}

/// Result of the search on one stage.
pub struct Outcome<'a> {
    /// Stage of the measured chain.
    pub kind: StageKind,
    /// Least-squares problem on the training sessions.
    pub train: Problem<'a>,
    /// Least-squares problem on the validation sessions.
    pub held_out: Problem<'a>,
    /// Given twin, nuisances fitted, before any other change.
    pub start: Point,
    /// The same on the validation sessions.
    pub start_held_out: Point,
    /// All known parameters fitted, no effect added.
    pub refitted: Point,
    /// Estimates at that point, by ordinary least squares; empty where no effect was added later.
    pub refitted_estimates: Vec<ParameterEstimate>,
    /// Final twin.
    pub last: Fit,
    /// Final twin on the validation sessions, nuisances fitted.
    pub last_held_out: Point,
    /// `true` where the validation sessions prefer the final twin to the given one.
    pub is_better: bool,
    /// Whitening of the final residual.
    pub filters: Filters,
    /// Uncertainty of the final fit.
    pub uncertainty: Uncertainty,
    /// Added effects, in order.
    pub added: Vec<Added>,
    /// Rejected candidates.
    pub rejected: Vec<Rejected>,
    /// What effects that were added and removed again explain of the residual.
    pub removed: Vec<Discrepancy>,
    /// Dependence of the final residual that no effect explains.
    pub unexplained: Option<Unknown>,
    /// Decisions of the search, in order.
    pub journal: Vec<JournalEntry>,
}

impl Outcome<'_> {
    /// Measure the gap from the twin `given`, where earlier stages changed the twin with which this search began.
    pub(in crate::gap) fn begin_at(&mut self, given: &Twin) {
        if self.start.twin != *given {
            let on = |problem: &Problem<'_>| {
                fit::with_refitted_nuisances(problem, &problem.start(given.clone()))
            };
            (self.start, self.start_held_out) = (on(&self.train), on(&self.held_out));
        }
    }
}

/// Task of the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Fit the known parameters (`klasktron calibrate`).
    Calibrate,
    /// The same, kept only where the validation sessions prefer it.
    Follow,
    /// Fit the known parameters, identify missing effects, add them (`klasktron gap`).
    CloseGap,
}
