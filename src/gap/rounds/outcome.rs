//! What a search is given, and what it finds.

use crate::{
    effects::{Axis, Effect},
    gap::{
        evidence::LogScoreGain,
        fit::{self, Fit, Uncertainty},
        journal::JournalEntry,
        numbers::ParameterEstimate,
        options::Context,
        problem::{Point, Problem},
        screen::Candidate,
        unknown::Unknown,
        whiten::Filters,
    },
    twin::{Instance, Slot, Stage, StageKind, Twin},
};

/// One link in all sessions.
pub struct Link<'a> {
    /// Which link.
    pub kind: StageKind,
    /// Stages that may be fitted.
    pub train: Vec<&'a dyn Stage>,
    /// Stages that judge.
    pub held_out: Vec<&'a dyn Stage>,
    /// Stages of another link on which the same effects act for longer, and judge how much of a gap they are.
    pub witnesses: Vec<&'a dyn Stage>,
    /// Stages of another link on which some of the same parameters act: a refit of these must not contradict them.
    pub companions: Vec<&'a dyn Stage>,
    /// Numbers that a link before it has determined from these recordings: they stay as they are.
    pub held: Vec<Held>,
    /// Whether more than is known to be left may be a disturbance, and not what grows along a whole roll.
    pub may_be_disturbed: bool,
    /// Options and observer of the search.
    pub context: Context<'a>,
}

/// A number of a twin, at whichever place of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Held {
    effect: &'static Effect,
    axis: Axis,
    parameter: usize,
}

impl Held {
    /// That of `slot`.
    #[must_use]
    pub fn of(twin: &Twin, slot: Slot) -> Self {
        let Instance { effect, axis, .. } = twin.instances[slot.instance];
        Self { effect, axis, parameter: slot.parameter }
    }
}

/// Why a candidate was not added.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// Its p-value, corrected for all tries, is above 1 %.
    NotSignificant,
    /// Another effect explains more, and this one nothing beyond it.
    Outdone(String),
    /// A parameter stopped on its bound, which for most effects is the wrong sign.
    OnBound(String),
    /// The validation sessions do not confirm it.
    HeldOut,
    /// The sessions disagree on its sign or magnitude.
    SessionsDisagree,
    /// Its magnitude differs between low and high speeds.
    SpeedsDisagree,
    /// It explains less than the model error of the simulation.
    TooSmall,
    /// The motion does not show it beyond a change of known parameters.
    NotTestable,
}

/// A candidate with what became of it.
#[derive(Debug, Clone)]
pub struct Rejected {
    /// What was tried.
    pub candidate: Candidate,
    /// Why it was not added.
    pub reason: Reason,
    /// Fraction of the squared whitened residual on the validation sessions that it removes, where it was simulated.
    pub validation_gain: Option<f64>,
}

/// One of the candidates that were simulated again in a round.
#[derive(Debug, Clone)]
pub struct Contestant {
    /// Its effect.
    pub effect: &'static Effect,
    /// Where it would act.
    pub axis: Axis,
    /// Whitened loss per row when fitted: the less, the more clearly it shows.
    pub loss: f64,
    /// Whether it could have been named.
    pub has_passed: bool,
}

/// An effect that passed.
#[derive(Debug, Clone)]
pub struct Added {
    /// The effect.
    pub effect: &'static Effect,
    /// Where it acts.
    pub axis: Axis,
    /// Value of the parameter that was scanned for, such as a period, when the effect was added: it distinguishes several
    /// instances of one effect.
    pub scanned: Option<f64>,
    /// Probability of such a gain by chance, corrected for all tries.
    pub p_value: f64,
    /// The block statistic behind it.
    pub statistic: f64,
    /// Data of the test behind `p_value`.
    pub data: String,
    /// Number of comparisons for which `p_value` is corrected.
    pub comparisons: usize,
    /// Gain of the log score on the validation sessions; `None` without any, and for an effect that changes no residual.
    pub log_score: Option<LogScoreGain>,
    /// Fraction of the squared whitened residual on the validation sessions that it removes.
    pub validation_gain: f64,
    /// Other effects that explain the data as well.
    pub class: Vec<&'static str>,
    /// Residual RMS per held-out signal before and after this step, in the order of the channels.
    pub held_out_steps: (Vec<f64>, Vec<f64>),
    /// For an effect that leaves every residual as it is: what it is about instead.
    pub unstated: Option<Unstated>,
    /// The strongest candidates of the round, the clearest first.
    pub contest: Vec<Contestant>,
    /// All numbers with it, before anything else was added, by plain least squares.
    pub numbers: Vec<ParameterEstimate>,
}

/// What of the held-out sessions a twin did not state before a step, and does not state after it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Unstated {
    /// Variance of a sample (m^2).
    Variance(f64, f64),
    /// Share of the frames that are lost.
    FramesLost(f64, f64),
}

impl Unstated {
    pub(in crate::gap) fn ends(self) -> (f64, f64) {
        let (Self::Variance(before, after) | Self::FramesLost(before, after)) = self;
        (before, after)
    }

    /// Variance of a sample for which it accounts (m^2).
    pub(in crate::gap) fn variance(self) -> f64 {
        match self {
            Self::Variance(before, _) => before,
            Self::FramesLost(..) => 0.0,
        }
    }
}

impl Added {
    /// Its own place in the contest.
    pub(in crate::gap) fn is(&self, one: &Contestant) -> bool {
        one.effect == self.effect && one.axis == self.axis
    }

    /// Its own whitened loss per row.
    pub(in crate::gap) fn loss(&self) -> Option<f64> {
        self.contest.iter().find(|one| self.is(one)).map(|own| own.loss)
    }

    /// Whether `other` of its round could have been named and shows more clearly, though it closes less of the gap.
    pub(in crate::gap) fn is_outshone_by(&self, other: &Contestant) -> bool {
        other.has_passed
            && !self.class.contains(&other.effect.name)
            && self.loss().is_some_and(|own| other.loss < own)
    }

    /// The best of the contest that explains less and is another effect.
    pub(in crate::gap) fn runner_up(&self) -> Option<&Contestant> {
        let own = self.loss()?;
        self.contest.iter().find(|other| other.effect != self.effect && own <= other.loss)
    }
}

/// What the search found on one link.
pub struct Outcome<'a> {
    /// Which link.
    pub kind: StageKind,
    /// The link's problem on the fitted sessions.
    pub train: Problem<'a>,
    /// The link's problem on the judging sessions.
    pub held_out: Problem<'a>,
    /// The given twin, nuisances fitted: before anything was changed.
    pub start: Point,
    /// The same on the judging sessions.
    pub start_held_out: Point,
    /// All parameters fitted, nothing added.
    pub refitted: Point,
    /// All numbers then, by plain least squares; empty where nothing was added later.
    pub refitted_numbers: Vec<ParameterEstimate>,
    /// The final twin.
    pub last: Fit,
    /// Its nuisances on the judging sessions.
    pub last_held_out: Point,
    /// Whether the judging sessions prefer the final twin to the given one.
    pub is_better: bool,
    /// Whitening of the final residual.
    pub filters: Filters,
    /// Intervals of the final fit.
    pub uncertainty: Uncertainty,
    /// What was added, in this order.
    pub added: Vec<Added>,
    /// What was not.
    pub rejected: Vec<Rejected>,
    /// What the rest still depends on, where no effect explains it.
    pub unexplained: Option<Unknown>,
    /// Decisions of the search, in order.
    pub journal: Vec<JournalEntry>,
}

impl Outcome<'_> {
    /// Tells the gap from `given` on, where links before this one have changed the twin with which its search began.
    pub(in crate::gap) fn begin_at(&mut self, given: &Twin) {
        if self.start.twin != *given {
            let on = |problem: &Problem<'_>| fit::told(problem, &problem.start(given.clone()));
            (self.start, self.start_held_out) = (on(&self.train), on(&self.held_out));
        }
    }
}

/// What the workflow is asked to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Fit what the twin has (`klasktron calibrate`).
    Calibrate,
    /// The same, kept where the judging sessions are better off with it.
    Follow,
    /// Fit, find what is missing, add it (`klasktron gap`).
    CloseGap,
}
