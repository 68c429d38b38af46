//! The rounds of the search on one link: refit, screen, re-simulate the best, decide, add, repeat.

use super::{
    batch::in_parallel,
    evidence::LogScoreGain,
    fit::{self, Fit, Uncertainty},
    incident,
    journal::{JournalEntry, MoveKind},
    known::{Excess, Worth, excess},
    numbers::{ParameterEstimate, numbers},
    observer::SearchStep,
    options::Context,
    problem::{Point, Problem},
    round::{Problems, Round, Stand, numbers_of_last},
    scatter,
    screen::{self, Candidate},
    unknown::{self, Unknown},
    whiten::{self, Filters},
};
use crate::{
    effects::{Axis, Effect},
    twin::{Instance, Slot, Stage, StageKind, Twin},
};

mod note;
mod part;
mod take_back;

pub(in crate::gap) use take_back::{instance_of, known_on_bound};

/// Most effects that are added to one link.
const MOST_ADDED: usize = 6;

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
    pub(super) fn ends(self) -> (f64, f64) {
        let (Self::Variance(before, after) | Self::FramesLost(before, after)) = self;
        (before, after)
    }

    /// Variance of a sample for which it accounts (m^2).
    pub(super) fn variance(self) -> f64 {
        match self {
            Self::Variance(before, _) => before,
            Self::FramesLost(..) => 0.0,
        }
    }
}

impl Added {
    /// Its own place in the contest.
    pub(super) fn is(&self, one: &Contestant) -> bool {
        one.effect == self.effect && one.axis == self.axis
    }

    /// Its own whitened loss per row.
    pub(super) fn loss(&self) -> Option<f64> {
        self.contest.iter().find(|one| self.is(one)).map(|own| own.loss)
    }

    /// Whether `other` of its round could have been named and shows more clearly, though it closes less of the gap.
    pub(super) fn is_outshone_by(&self, other: &Contestant) -> bool {
        other.has_passed
            && !self.class.contains(&other.effect.name)
            && self.loss().is_some_and(|own| other.loss < own)
    }

    /// The best of the contest that explains less and is another effect.
    pub(super) fn runner_up(&self) -> Option<&Contestant> {
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
    pub(super) fn begin_at(&mut self, given: &Twin) {
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

/// Searches one link from `start`.
#[must_use]
pub fn search<'a>(link: &Link<'a>, start: &Twin, task: Task) -> Outcome<'a> {
    let (mut search, opening) = Search::opened(link, start);
    let Opening { given, scales, excess, slots } = opening;
    let refitted = search.best.clone();
    let unexplained = match task {
        Task::Calibrate | Task::Follow => None,
        Task::CloseGap => search.close(&given, excess),
    };
    let known = search.without_indistinct();
    let Search { train, held_out, mut best, mut filters, added, rejected, mut journal, .. } =
        search;
    let twins = (start, &best.point.twin);
    let least = train.thresholds().least_gain(excess);
    let is_better = is_better(&held_out, twins, &filters, least);
    if task != Task::Calibrate && added.is_empty() && !is_better {
        (best, filters) = as_it_is(&train, &given, &slots);
        journal.push(JournalEntry::new(
            MoveKind::Keep,
            Some(link.kind),
            "The validation sessions do not confirm the refit: the given parameters stay",
        ));
    }
    let refitted_numbers = match added.is_empty() {
        true => Vec::new(),
        false => numbers(&fit::plainly(&train, &refitted)),
    };
    let alpha = link.context.options.thresholds().family_error;
    let (judged, uncertainty) = known.unwrap_or_else(|| {
        uncertainty_of((&train, &held_out), &best, &filters, (&rejected, alpha))
    });
    best.point = fit::told(&train, &best.point);
    Outcome {
        kind: link.kind,
        is_better,
        uncertainty,
        start_held_out: fit::on(&held_out, start, &scales),
        last_held_out: fit::told(&held_out, &judged),
        train,
        held_out,
        start: given,
        refitted: refitted.point,
        refitted_numbers,
        last: best,
        filters,
        added,
        rejected,
        unexplained,
        journal,
    }
}

/// The twin of `best` on the validation sessions, and the uncertainty of its parameters.
fn uncertainty_of(
    (train, held_out): (&Problem<'_>, &Problem<'_>),
    best: &Fit,
    filters: &Filters,
    (rejected, alpha): (&[Rejected], f64),
) -> (Point, Uncertainty) {
    let judged = fit::on(held_out, &best.point.twin, filters);
    let uncertainty = fit::uncertainty(train, held_out, (best, &judged), filters)
        .whatever_the_metric(train, best)
        .whatever_is_beside(best, &shifts(rejected, alpha));
    (judged, uncertainty)
}

/// How far each known parameter would move with each effect that was screened last, is in the data beyond chance and
/// was not added all the same (scaled). What was fitted and is not in them, with the wrong sign, or not on judging
/// sessions, moves none.
fn shifts(rejected: &[Rejected], family_error: f64) -> Vec<&[f64]> {
    let tries: usize = rejected.iter().map(|own| own.candidate.tries).sum();
    let is_there = |own: &&Rejected| {
        own.candidate.p_value * (tries as f64) < family_error
            && !matches!(own.reason, Reason::NotSignificant | Reason::OnBound(_) | Reason::HeldOut)
    };
    rejected.iter().filter(is_there).map(|own| own.candidate.shift.as_slice()).collect()
}

/// Leaves out single samples off the rest, and what happened once, of the fitted and of the judging sessions with
/// their points.
fn leave_out<'a>(
    kind: StageKind,
    train: (&mut Problem<'a>, &Point),
    held_out: (&mut Problem<'a>, &Point),
) {
    train.0.drop_outliers(train.1);
    held_out.0.drop_outliers(held_out.1);
    incident::leave_out_of(kind, train, held_out);
}

/// Everything that the twin has, fitted; what is off the rest is left out from then on.
fn refit<'a>(
    kind: StageKind,
    train: &mut Problem<'a>,
    held_out: &mut Problem<'a>,
    (given, slots): (&Point, &[Slot]),
) -> (Fit, Filters) {
    let (rough, filters) = fit::fit_from_afar(train, given.clone(), slots, 15);
    let judged = fit::on(held_out, &rough.point.twin, &filters);
    leave_out(kind, (train, &rough.point), (held_out, &judged));
    let (best, filters) = fit::settle(train, rough.point, slots, 10);
    from_deepest(train, (best, filters), given)
}

/// The fit itself, or what is found from other starts where that is better.
fn from_deepest(train: &Problem<'_>, found: (Fit, Filters), given: &Point) -> (Fit, Filters) {
    match restarted(train, &found.0, given) {
        Some(better) => fit::settle(train, better, &found.0.slots, 10),
        None => found,
    }
}

/// The given twin with nothing but its nuisances fitted; `slots` are its known parameters.
fn as_it_is(train: &Problem<'_>, given: &Point, slots: &[Slot]) -> (Fit, Filters) {
    let (mut kept, filters) = fit::settle(train, given.clone(), &[], 10);
    kept.slots = slots.to_vec();
    (kept, filters)
}

/// Whitened residuals of the judging sessions under two twins, each with its own nuisances.
fn judged_rows(held_out: &Problem<'_>, twins: (&Twin, &Twin), filters: &Filters) -> [Vec<f64>; 2] {
    [twins.0, twins.1].map(|twin| held_out.whitened(&fit::on(held_out, twin, filters), filters))
}

/// Whether the judging sessions prefer the second twin to the first, beyond chance and by the
/// share `worth` of the squared error; nothing to judge by objects to nothing.
fn is_better(held_out: &Problem<'_>, twins: (&Twin, &Twin), filters: &Filters, worth: f64) -> bool {
    let [before, after] = judged_rows(held_out, twins, filters);
    held_out.parts.is_empty()
        || held_out.thresholds().is_in(&before, &after, &held_out.blocks())
            && worth < 1.0 - fit::squared(&after) / fit::squared(&before)
}

/// A search under way.
struct Search<'a> {
    kind: StageKind,
    may_be_disturbed: bool,
    train: Problem<'a>,
    held_out: Problem<'a>,
    witness: Problem<'a>,
    best: Fit,
    filters: Filters,
    added: Vec<Added>,
    rejected: Vec<Rejected>,
    journal: Vec<JournalEntry>,
    /// One-off disturbances that are in the journal.
    masked: Vec<incident::Incident>,
}

/// Where a search begins.
struct Opening {
    /// The given twin, nuisances fitted.
    given: Point,
    /// One over the RMS of each signal's residual there.
    scales: Filters,
    /// What the recordings hold beyond what the given twin is known to leave.
    excess: Option<Excess>,
    /// The parameters that may be fitted.
    slots: Vec<Slot>,
}

impl<'a> Search<'a> {
    /// The given twin on `link`, and its refit, what is off the rest left out.
    fn opened(link: &Link<'a>, start: &Twin) -> (Self, Opening) {
        let context = link.context;
        context.observer.step_begun(SearchStep::Fit, 0);
        let mut train = Problem::new(&link.train, start).within(context);
        let mut held_out = Problem::new(&link.held_out, start).within(context);
        let given = train.start(start.clone());
        let scales = train.filters(&given, whiten::scale_filters);
        let given = fit::adapt(&train, given, &scales);
        let held_given = fit::on(&held_out, start, &scales);
        leave_out(link.kind, (&mut train, &given), (&mut held_out, &held_given));
        let excess = excess(start, [(&train, &given), (&held_out, &held_given)]);
        let mut slots = start.free(link.train[0]);
        slots.retain(|slot| !link.held.contains(&Held::of(start, *slot)));
        let is_new = !context.options.thresholds().is_at_reference(excess);
        let (best, filters) = match is_new {
            true => refit(link.kind, &mut train, &mut held_out, (&given, &slots)),
            false => fit::settle(&train, given.clone(), &slots, 10),
        };
        log::info!(
            "{:?}: {} parameters refitted on {} training sessions, {} validation sessions",
            link.kind,
            slots.len(),
            link.train.len(),
            link.held_out.len()
        );
        let mut search = Self {
            kind: link.kind,
            may_be_disturbed: link.may_be_disturbed,
            train,
            held_out,
            witness: Problem::new(&link.witnesses, start).within(context),
            best,
            filters,
            added: vec![],
            rejected: vec![],
            journal: vec![],
            masked: vec![],
        };
        let reference =
            if is_new { "is above its reference, or has none" } else { "is at its reference" };
        search.note_refit(&given, slots.len(), reference);
        search.note_masked();
        (search, Opening { given, scales, excess, slots })
    }
}

impl Search<'_> {
    /// Adds effects until nothing passes; gives what is then still unexplained.
    fn close(&mut self, given: &Point, mut excess: Option<Excess>) -> Option<Unknown> {
        let mut judged = None;
        let thresholds = self.train.thresholds();
        let mut starts_again = !thresholds.is_at_reference(excess) && !self.is_followed(given);
        let mut has_parted = false;
        let most = MOST_ADDED;
        while self.added.len() < most {
            let first = self.added.is_empty() && !has_parted && !thresholds.is_at_reference(excess);
            let as_given = first.then(|| self.as_given(given));
            let stand = Stand {
                base: &self.best,
                filters: &self.filters,
                given: as_given.as_ref(),
                given_instances: given.twin.instances.len(),
                worth: Worth::new(thresholds, (&given.twin, self.kind), excess, self.removed()),
            };
            let round = Round::run(self.problems(), &stand);
            self.rejected = round.rejected;
            // A refit that led astray hides what the given twin shows.
            let is_lost = round.winner.is_none() && self.added.is_empty();
            if is_lost && std::mem::take(&mut starts_again) {
                let slots = std::mem::take(&mut self.best.slots);
                (self.best, self.filters) = as_it_is(&self.train, given, &slots);
                self.note(
                    MoveKind::Keep,
                    "No candidate passed after the refit, and the refit predicts the validation sessions worse than the \
                     given twin: the search starts again from the given parameters",
                );
                continue;
            }
            // What one motor seems to miss may be what it does not share with the other any more.
            let is_open = round
                .winner
                .as_ref()
                .is_none_or(|(_, step)| self.added.is_empty() && !screen::is_shared(step.axis));
            let may_part =
                !has_parted && excess.is_some() && !thresholds.is_at_reference(excess) && is_open;
            let rival = round.winner.as_ref().map(|(fit, _)| fit);
            if may_part && self.part_a_known(excess, rival) {
                (has_parted, starts_again) = (true, false);
                excess = self.excess(judged.insert(self.judged()));
                continue;
            }
            let Some(winner) = round.winner else { break };
            self.note_added(&winner.1);
            excess = self.add(winner, given, &mut judged);
        }
        self.note_end_of_rounds(most);
        let worth = Worth::new(thresholds, (&given.twin, self.kind), excess, 0.0);
        let is_less = self.take_back_what_is_not_missed(&worth, usize::from(!has_parted));
        let is_fewer = self.take_back_what_is_none();
        if self.remove_beside_bound() || is_fewer || is_less {
            excess = self.excess(judged.insert(self.judged()));
        }
        let judged = judged.unwrap_or_else(|| self.judged());
        let scatters_otherwise = self.name_scatter(&given.twin, &judged, excess);
        if thresholds.is_at_reference(excess) {
            return None;
        }
        let disturbance = match scatters_otherwise {
            true => None,
            false => self.disturbance(given, &judged),
        };
        self.unexplained(&judged, disturbance)
    }

    /// Adds what won a round, on each motor or rail by itself where they differ, and fits everything; gives what is
    /// then left, and puts the twin on the judging sessions into `judged`.
    fn add(
        &mut self,
        (fit, step): (Fit, Added),
        given: &Point,
        judged: &mut Option<Point>,
    ) -> Option<Excess> {
        let at = numbers_of_last(&fit.point.twin);
        log::info!("{:?}: {} on {} is added at {at:?}", self.kind, step.effect.name, step.axis);
        let before = self.added.len();
        self.added.push(step);
        let settled = fit::settle(&self.train, fit.point, &fit.slots, 8);
        (self.best, self.filters) = from_deepest(&self.train, settled, given);
        self.leave_out_incidents();
        let mut excess = self.excess(judged.insert(self.judged()));
        if !self.train.thresholds().is_at_reference(excess)
            && let Some(parted) = self.part_the_added(excess)
        {
            excess = self.excess(judged.insert(parted));
        }
        let plain = numbers(&fit::plainly(&self.train, &self.best));
        self.added[before..].iter_mut().for_each(|step| step.numbers.clone_from(&plain));
        excess
    }

    /// Leaves out what happened once and was hidden by what has been added.
    fn leave_out_incidents(&mut self) {
        let judged = self.judged();
        let train = (&mut self.train, &self.best.point);
        if incident::leave_out_of(self.kind, train, (&mut self.held_out, &judged)) {
            let (point, slots) = (self.best.point.clone(), self.best.slots.clone());
            (self.best, self.filters) = fit::settle(&self.train, point, &slots, 8);
            self.note_masked();
        }
    }

    /// What the rest still depends on, or is, where that is more, a `disturbance`; what was added and removes less
    /// than that is withdrawn.
    fn unexplained(&mut self, judged: &Point, disturbance: Option<Unknown>) -> Option<Unknown> {
        let (train, held_out) = (&self.train, &self.held_out);
        let strongest = unknown::strongest(train, held_out, &self.best, judged, &self.filters);
        let larger = strongest.into_iter().chain(disturbance);
        let unknown =
            larger.max_by(|a, b| a.share.total_cmp(&b.share)).or_else(|| self.imitated())?;
        self.withdraw_what_is_less_than(&unknown);
        Some(unknown)
    }

    /// What an effect of the catalogue imitates that is larger at high speeds.
    fn imitated(&self) -> Option<Unknown> {
        let other = self.rejected.iter().find(|own| own.reason == Reason::SpeedsDisagree)?;
        let Candidate { effect, axis, statistic, p_value, .. } = &other.candidate;
        let channels = self.train.parts.first()?.stage.channels();
        Some(Unknown {
            name: format!("unknown.speed[as {} on {axis} but in proportion to it]", effect.name),
            signal: channels.first()?.signal.clone(),
            share: other.validation_gain?,
            statistic: *statistic,
            p_value: (p_value * self.rejected.len() as f64).min(1.0),
            comparisons: self.rejected.len(),
        })
    }

    /// Whether the judging sessions are not worse off with the refit than with the given twin.
    fn is_followed(&self, given: &Point) -> bool {
        let twins = (&given.twin, &self.best.point.twin);
        let [before, after] = judged_rows(&self.held_out, twins, &self.filters);
        fit::squared(&after) <= fit::squared(&before)
    }

    /// Adds what the scatter of the camera and its lost frames say beyond what the given twin states; gives whether it
    /// scatters otherwise.
    fn name_scatter(&mut self, given: &Twin, judged: &Point, excess: Option<Excess>) -> bool {
        let problems = [&self.train, &self.held_out];
        let found = scatter::find(problems, [&self.best.point, judged], given, excess);
        let scatters = found.iter().any(scatter::Named::scatters);
        for named in found {
            let step = named.put_into(&mut self.best.point.twin);
            step.iter().for_each(|step| self.note_added(step));
            self.added.extend(step);
        }
        scatters
    }

    /// Share of the held-out squared error that the effects added so far removed, step after step.
    fn removed(&self) -> f64 {
        1.0 - self.added.iter().map(|step| 1.0 - step.validation_gain).product::<f64>()
    }

    /// The given twin as it is, every signal scaled by its own residual.
    fn as_given(&self, given: &Point) -> (Fit, Filters) {
        let filters = self.train.filters(given, whiten::scale_filters);
        let loss = fit::squared(&self.train.whitened(given, &filters));
        let slots = self.best.slots.clone();
        (Fit { point: given.clone(), slots, loss, rows: self.train.rows() }, filters)
    }

    /// What is left beyond what is known to be left.
    fn excess(&self, judged: &Point) -> Option<Excess> {
        excess(&self.best.point.twin, [(&self.train, &self.best.point), (&self.held_out, judged)])
    }

    /// More than is known to be left, in both kinds of sessions, which depends on nothing measured and is more
    /// than what any fit leaves of the gap that it closed. Where there is play, noise decides when motor and load meet:
    /// that is more than any twin follows.
    fn disturbance(&self, given: &Point, judged: &Point) -> Option<Unknown> {
        let twin = &self.best.point.twin;
        let rattles = self.kind == StageKind::Drive && twin.instances.iter().any(Instance::rattles);
        if !self.may_be_disturbed || rattles {
            return None;
        }
        let before = excess(twin, [(&self.train, given)])?.most;
        let trained = excess(twin, [(&self.train, &self.best.point)])?.most;
        let held = excess(twin, [(&self.held_out, judged)])?.most;
        let thresholds = self.train.thresholds();
        (thresholds.large_excess < trained.min(held)
            && thresholds.clear_gain * (before - trained) < trained)
            .then(|| unknown::disturbance(&self.train, &self.best.point))
            .flatten()
    }

    fn problems(&self) -> Problems<'_, '_> {
        Problems { train: &self.train, held_out: &self.held_out, witness: &self.witness }
    }

    /// The best twin on the judging sessions.
    fn judged(&self) -> Point {
        self.judged_of(&self.best)
    }

    /// The twin of `fit` on the judging sessions, in the metric of the best.
    fn judged_of(&self, fit: &Fit) -> Point {
        fit::on(&self.held_out, &fit.point.twin, &self.filters)
    }
}

/// Other starts that are fitted.
const OTHER_STARTS: usize = 2;

/// Steps of a fit from another start.
const RESTART_ITERATIONS: usize = 12;

/// A refit can stop in a valley that is not the deepest: a spring far softer, a delay far longer than
/// before, and parameters that have made up for an effect that was missing until now. Where the rest is well
/// above what the given twin is known to leave, or nothing is known of that, everything that was given starts
/// again from its given values, and each of its effects from its probes; the best of them are fitted; the best
/// fit, when it is better.
fn restarted(train: &Problem<'_>, best: &Fit, given: &Point) -> Option<Point> {
    let thresholds = train.thresholds();
    if excess(&given.twin, [(train, &best.point)])
        .is_some_and(|excess| excess.most < thresholds.large_excess)
    {
        return None;
    }
    let scales = train.filters(&best.point, whiten::scale_filters);
    let loss = |point: &Point| fit::squared(&train.whitened(point, &scales));
    let mut anew = best.point.clone();
    for (own, instance) in anew.twin.instances.iter_mut().zip(&given.twin.instances) {
        own.values.clone_from(&instance.values);
    }
    let mut starts = vec![anew.clone()];
    for (index, instance) in given.twin.instances.iter().enumerate() {
        if !best.slots.iter().any(|slot| slot.instance == index) {
            continue;
        }
        for probe in instance.effect.probes {
            let mut point = anew.clone();
            for (parameter, value) in probe.iter().enumerate() {
                point.twin.set(Slot { instance: index, parameter }, *value);
            }
            starts.push(point);
        }
    }
    let losses = in_parallel(&starts, loss);
    let mut order: Vec<usize> = (0..starts.len()).collect();
    order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
    let nearest: Vec<Point> =
        order.into_iter().take(OTHER_STARTS).map(|index| starts[index].clone()).collect();
    let fits = in_parallel(&nearest, |start| {
        fit::fit(train, start.clone(), &best.slots, &scales, RESTART_ITERATIONS)
    });
    fits.into_iter()
        .min_by(|a, b| a.loss.total_cmp(&b.loss))
        .filter(|found| found.loss < (1.0 - thresholds.clear_gain) * loss(&best.point))
        .map(|found| found.point)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::find;

    /// A candidate that would move the one known parameter by `shift`, with this tail probability.
    fn rejected(p_value: f64, reason: Reason, shift: f64) -> Rejected {
        let effect = find("drive.lag1").expect("it is in the catalogue");
        let candidate = Candidate {
            effect,
            axis: Axis::Motors,
            start: vec![1e-3],
            probe: vec![1e-3],
            share: 0.1,
            statistic: 30.0,
            p_value,
            visibility: 10.0,
            is_as_good_as_refit: false,
            tries: 1,
            lean: vec![1e-4],
            shift: vec![shift],
            other_starts: Vec::new(),
        };
        Rejected { candidate, reason, validation_gain: None }
    }

    #[test]
    fn what_is_not_there_moves_no_known_parameter() {
        let all = [
            rejected(1e-6, Reason::TooSmall, 1.0),
            rejected(1e-6, Reason::NotTestable, 2.0),
            rejected(1e-6, Reason::NotSignificant, 3.0),
            rejected(1e-6, Reason::OnBound("time_constant_s".into()), 4.0),
            rejected(1e-6, Reason::HeldOut, 5.0),
            rejected(0.5, Reason::TooSmall, 6.0),
        ];
        assert_eq!(shifts(&all, 0.01), [[1.0], [2.0]]);
    }
}
