//! The rounds of the search on one link: refit, screen, re-simulate the best, decide, add, repeat.

use super::{
    evidence::{Amplitude, Blocks},
    fit::{self, Fit, Uncertainty},
    problem::{Point, Problem, in_parallel},
    screen::{self, Candidate},
    unknown::{self, Unknown},
    whiten::{self, Filters},
};
use crate::{
    effects::{Axis, Effect},
    twin::{Slot, Stage, StageKind, Twin},
};

/// Probability of a false name over all tries of one screen (Bonferroni).
pub(super) const FAMILY_ERROR: f64 = 0.01;

/// Candidates that are simulated again in one round.
const SHORT_LIST: usize = 7;

/// Places of one effect that are simulated again in one round.
const PLACES_OF_ONE: usize = 2;

/// Share of the best candidate's gain below which another is not simulated again.
const WORTH_SIMULATING: f64 = 0.1;

/// Most effects that are added to one link.
const MOST_ADDED: usize = 6;

/// Probability of taking chance for an effect, on the fitted and again on the judging sessions.
const LEVEL: f64 = 1e-3;

/// Probability of taking a rival that explains the data as well as the winner for a worse one.
const RIVAL_LEVEL: f64 = 5e-3;

/// Share by which the judging sessions may want the effect smaller or larger.
const SESSIONS_APART: f64 = 0.5;

/// Share of the held-out squared error (whitened) that an effect must explain to be worth a name: a
/// simulator of finite fidelity leaves that much of anything.
const WORTH_NAMING: f64 = 0.02;

/// Share of the squared residual that the given twin left when its own search ended, by which recordings
/// may exceed it and still hold nothing new: sampling, and a course that shows the simulator's own errors
/// a little more. An effect of a third of the noise is above it.
const NOTHING_NEW: f64 = 0.05;

/// Length of an effect's column at its largest plausible size, in whitened standard deviations, below
/// which this motion cannot show it: what a test at one in 10,000 can just see.
const VISIBLE: f64 = 5.0;

/// One link in all sessions.
pub struct Link<'a> {
    /// Which link.
    pub kind: StageKind,
    /// Stages that may be fitted.
    pub train: Vec<&'a dyn Stage>,
    /// Stages that judge.
    pub held_out: Vec<&'a dyn Stage>,
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
    /// The held-out session does not prefer it.
    HeldOut,
    /// The sessions do not agree on its size.
    SessionsDisagree,
    /// It explains less than the simulator's own fidelity.
    TooSmall,
    /// The given twin predicts these recordings as well as those on which its own search ended.
    NothingNew,
    /// The motion does not show it beyond what known parameters imitate.
    NotTestable,
}

/// A candidate with what became of it.
#[derive(Debug, Clone)]
pub struct Rejected {
    /// What was tried.
    pub candidate: Candidate,
    /// Why it was not added.
    pub reason: Reason,
    /// Share of the held-out squared error (whitened) that it removes, where it was simulated.
    pub held_out_gain: Option<f64>,
}

/// An effect that passed.
#[derive(Debug, Clone)]
pub struct Added {
    /// The effect.
    pub effect: &'static Effect,
    /// Where it acts.
    pub axis: Axis,
    /// Probability of such a gain by chance, corrected for all tries.
    pub p_value: f64,
    /// The block statistic behind it.
    pub statistic: f64,
    /// Share of the held-out squared error (whitened) that it removes.
    pub held_out_gain: f64,
    /// Other effects that explain the data as well.
    pub class: Vec<&'static str>,
    /// Residual RMS per held-out signal before and after this step, in the order of the channels.
    pub held_out_steps: (Vec<f64>, Vec<f64>),
    /// The strongest candidates of the round: name, axis, whitened loss per row when fitted.
    pub contest: Vec<(String, Axis, f64)>,
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
}

/// A candidate, simulated and fitted.
struct Trial {
    candidate: Candidate,
    fit: Fit,
    /// Whitened residuals of fitted and judging sessions.
    train_rows: Vec<f64>,
    held_rows: Vec<f64>,
    held_point: Point,
    /// Why it may not be named.
    objection: Option<Reason>,
}

/// What the workflow is asked to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Fit what the twin has (`klasktron calibrate`).
    Calibrate,
    /// Fit, find what is missing, add it (`klasktron gap`).
    CloseGap,
}

/// Searches one link from `start`.
#[must_use]
pub fn search<'a>(link: &Link<'a>, start: &Twin, task: Task) -> Outcome<'a> {
    let mut train = Problem::new(&link.train, start);
    let mut held_out = Problem::new(&link.held_out, start);
    let given = train.start(start.clone());
    let scales = train.filters(&given, whiten::scale_filters);
    let given = fit::adapt(&train, given, &scales);
    let held_given = fit::adapt(&held_out, held_out.start(start.clone()), &scales);
    train.drop_outliers(&given);
    held_out.drop_outliers(&held_given);
    let nothing_new =
        task == Task::CloseGap && is_as_known(start, [(&train, &given), (&held_out, &held_given)]);
    let (best, filters) = if nothing_new {
        as_given(&train, given.clone())
    } else {
        refit(&mut train, &mut held_out, start, &given)
    };
    let refitted = best.point.clone();
    let mut search =
        Search { train, held_out, best, filters, added: Vec::new(), rejected: Vec::new() };
    let unexplained = match task {
        Task::Calibrate => None,
        Task::CloseGap if nothing_new => search.look(start.free(link.train[0])),
        Task::CloseGap => search.close(start),
    };
    let Search { train, held_out, best, filters, added, rejected } = search;
    let adapted =
        |twin: &Twin, filters| fit::adapt(&held_out, held_out.start(twin.clone()), filters);
    let start_held_out = adapted(start, &scales);
    let last_held_out = adapted(&best.point.twin, &filters);
    Outcome {
        kind: link.kind,
        is_better: is_better(&held_out, (&start_held_out, &last_held_out), &filters),
        uncertainty: fit::uncertainty(&train, &held_out, (&best, &last_held_out), &filters),
        start_held_out,
        last_held_out,
        train,
        held_out,
        start: given,
        refitted,
        last: best,
        filters,
        added,
        rejected,
        unexplained,
    }
}

/// The given twin as it is, where the recordings hold nothing new.
fn as_given(train: &Problem<'_>, point: Point) -> (Fit, Filters) {
    let filters = train.filters(&point, whiten::fit_filters);
    let loss = fit::squared(&train.whitened(&point, &filters));
    (Fit { point, slots: Vec::new(), loss, rows: train.rows() }, filters)
}

/// Everything that the twin has, fitted; single samples off the rest are left out from then on.
fn refit(
    train: &mut Problem<'_>,
    held_out: &mut Problem<'_>,
    start: &Twin,
    given: &Point,
) -> (Fit, Filters) {
    let slots = start.free(train.parts[0].stage);
    let (rough, filters) = fit::fit_from_afar(train, given.clone(), &slots, 15);
    train.drop_outliers(&rough.point);
    let judged = fit::adapt(held_out, held_out.start(rough.point.twin.clone()), &filters);
    held_out.drop_outliers(&judged);
    let (best, filters) = fit::settle(train, rough.point, &slots, 10);
    match restarted(train, &best, start) {
        Some(better) => fit::settle(train, better, &slots, 10),
        None => (best, filters),
    }
}

/// Whether both problems are predicted as well, in every signal, as what was left when `start` came out
/// of a search that found nothing more.
fn is_as_known(start: &Twin, points: [(&Problem<'_>, &Point); 2]) -> bool {
    let [train, held_out] = points.map(|(problem, point)| problem.squares(point));
    let channels = points[0].0.parts.first().map_or(&[][..], |part| part.stage.channels());
    !channels.is_empty()
        && channels.iter().enumerate().all(|(k, channel)| {
            let own = [train.get(k), held_out.get(k)].into_iter().flatten();
            let (sum, count) = own.fold((0.0, 0), |all, own| (all.0 + own.0, all.1 + own.1));
            let left = start.left.iter().find(|left| left.signal == channel.signal);
            left.is_some_and(|left| {
                let known = left.residual_rms.powi(2) * count as f64;
                left.searched && sum < (1.0 + NOTHING_NEW) * known
            })
        })
}

/// Whether the judging sessions prefer the second point to the first, beyond chance and by more than the
/// simulator's own fidelity; nothing to judge by objects to nothing.
fn is_better(held_out: &Problem<'_>, points: (&Point, &Point), filters: &Filters) -> bool {
    let (before, after) =
        (held_out.whitened(points.0, filters), held_out.whitened(points.1, filters));
    held_out.parts.is_empty()
        || is_in(&before, &after, &held_out.blocks())
            && WORTH_NAMING < 1.0 - fit::squared(&after) / fit::squared(&before)
}

/// Whether the data follow a change of the residual from `before` to `after` beyond chance, and are better
/// off with it than without.
fn is_in(before: &[f64], after: &[f64], blocks: &Blocks) -> bool {
    let amplitude = Amplitude::of(before, after, blocks);
    0.5 < amplitude.value && amplitude.is_above(0.0, LEVEL)
}

/// A search under way.
struct Search<'a> {
    train: Problem<'a>,
    held_out: Problem<'a>,
    best: Fit,
    filters: Filters,
    added: Vec<Added>,
    rejected: Vec<Rejected>,
}

impl Search<'_> {
    /// Adds effects until nothing passes; gives what is then still unexplained.
    fn close(&mut self, start: &Twin) -> Option<Unknown> {
        while self.added.len() < MOST_ADDED {
            if self.is_closed(start) {
                return None;
            }
            let round = Round::run(&self.train, &self.held_out, &self.best, &self.filters);
            self.rejected = round.rejected;
            let Some((fit, step)) = round.winner else { break };
            self.added.push(step);
            (self.best, self.filters) = fit::settle(&self.train, fit.point, &fit.slots, 8);
        }
        if self.is_closed(start) {
            return None;
        }
        let (held_out, judged) = (&self.held_out, self.judged());
        let unknown =
            unknown::strongest(&self.train, held_out, &self.best, &judged, &self.filters)?;
        if withdraw(&mut self.best, &mut self.added, &unknown) {
            let (point, slots) = (self.best.point.clone(), self.best.slots.clone());
            (self.best, self.filters) = fit::settle(&self.train, point, &slots, 8);
        }
        Some(unknown)
    }

    /// Says of every effect whether these recordings could have shown it; adds nothing.
    fn look(&mut self, slots: Vec<Slot>) -> Option<Unknown> {
        let known = Fit { slots, ..self.best.clone() };
        let candidates = screen::screen(&self.train, &known, &self.filters);
        self.rejected = candidates
            .into_iter()
            .map(|candidate| {
                let hidden = candidate.visibility < VISIBLE;
                let reason = if hidden { Reason::NotTestable } else { Reason::NothingNew };
                Rejected { candidate, reason, held_out_gain: None }
            })
            .collect();
        None
    }

    /// The best twin on the judging sessions.
    fn judged(&self) -> Point {
        let start = self.held_out.start(self.best.point.twin.clone());
        fit::adapt(&self.held_out, start, &self.filters)
    }

    /// Whether nothing is left beyond what is known to be left.
    fn is_closed(&self, start: &Twin) -> bool {
        is_as_known(start, [(&self.train, &self.best.point), (&self.held_out, &self.judged())])
    }
}

/// How far above what the twin left when it was calibrated a refit may stay (ratio of RMS) before its
/// parameters are started elsewhere.
const STUCK: f64 = 1.2;

/// Share of the scaled squared error that another start must save.
const ANOTHER_VALLEY: f64 = 0.9;

/// A refit can stop in a valley that is not the deepest: a spring far softer, a delay far longer than
/// before. Where the rest is well above what the twin left when it was calibrated, each effect is
/// started from its probes as well; the best start, when it is better.
fn restarted(train: &Problem<'_>, best: &Fit, start: &Twin) -> Option<Point> {
    let rms = train.rms(&best.point);
    let channels = train.parts.first()?.stage.channels();
    let stuck = channels.iter().zip(&rms).any(|(channel, rms)| {
        let left = start.left.iter().find(|left| left.signal == channel.signal);
        left.is_some_and(|left| STUCK * left.residual_rms < *rms)
    });
    if !stuck {
        return None;
    }
    let scales = train.filters(&best.point, whiten::scale_filters);
    let before = fit::squared(&train.whitened(&best.point, &scales));
    let mut starts = Vec::new();
    for (index, instance) in start.instances.iter().enumerate() {
        if !best.slots.iter().any(|slot| slot.instance == index) {
            continue;
        }
        for probe in instance.effect.probes {
            let mut twin = start.clone();
            for (parameter, value) in probe.iter().enumerate() {
                twin.set(Slot { instance: index, parameter }, *value);
            }
            starts.push(Point { twin, nuisance: best.point.nuisance.clone() });
        }
    }
    let fits = in_parallel(&starts, |start| {
        fit::fit(train, start.clone(), &best.slots, &scales, RESTART_ITERATIONS)
    });
    fits.into_iter()
        .min_by(|a, b| a.loss.total_cmp(&b.loss))
        .filter(|found| found.loss < ANOTHER_VALLEY * before)
        .map(|found| found.point)
}

/// Steps of a fit from another start.
const RESTART_ITERATIONS: usize = 12;

/// Takes back what explains less than what stays unexplained: an effect outside the catalogue is
/// imitated in part by several inside it. Gives whether anything was taken back.
fn withdraw(best: &mut Fit, added: &mut Vec<Added>, unknown: &Unknown) -> bool {
    let before = added.len();
    added.retain(|step| {
        let stays = unknown.share < step.held_out_gain;
        if !stays {
            let twin = &mut best.point.twin;
            let found = twin
                .instances
                .iter()
                .position(|own| own.effect == step.effect && own.axis == step.axis);
            if let Some(index) = found {
                twin.instances.remove(index);
                best.slots.retain(|slot| slot.instance != index);
                best.slots
                    .iter_mut()
                    .filter(|slot| index < slot.instance)
                    .for_each(|slot| slot.instance -= 1);
            }
        }
        stays
    });
    added.len() < before
}

/// One round: screen, simulate, decide.
struct Round {
    winner: Option<(Fit, Added)>,
    rejected: Vec<Rejected>,
}

impl Round {
    fn run(train: &Problem<'_>, held_out: &Problem<'_>, base: &Fit, filters: &Filters) -> Self {
        let candidates = screen::screen(train, base, filters);
        let tries: usize = candidates.iter().map(|candidate| candidate.tries).sum();
        let threshold = FAMILY_ERROR / tries.max(1) as f64;
        let (mut rejected, short) = short_list(candidates, threshold);
        // First in the metric of the base residual, then in that of the best candidate's.
        let at_base = train.prediction(&base.point);
        let known = train.columns(&base.point, &at_base, &base.slots, filters);
        let rough: Vec<Fit> =
            in_parallel(&short, |candidate| fitted(train, base, candidate, filters, &known));
        let sound = |fit: &&Fit| on_bound(fit).is_none();
        let lead = rough.iter().filter(sound).min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(lead) = lead.or(rough.first()) else { return Self { winner: None, rejected } };
        let sharp = train.filters(&lead.point, whiten::fit_filters);
        let at_lead = train.prediction(&lead.point);
        let known = train.columns(&lead.point, &at_lead, &base.slots, &sharp);
        let bench = Bench::new(train, held_out, base, &sharp);
        let items: Vec<(Candidate, Fit)> = short.into_iter().zip(rough).collect();
        let mut trials =
            in_parallel(&items, |(candidate, rough)| bench.trial(candidate, rough, &known));
        trials.sort_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss));
        for trial in &trials {
            if let Some(reason) = &trial.objection {
                rejected.push(bench.rejected(trial, reason.clone()));
            }
        }
        let passed: Vec<&Trial> = trials.iter().filter(|trial| trial.objection.is_none()).collect();
        let winner = bench.simplest(&passed).map(|own| {
            let mut class = Vec::new();
            for other in passed.iter().filter(|other| !std::ptr::eq(**other, own)) {
                let name = other.candidate.effect.name;
                if name != own.candidate.effect.name && bench.is_rival(own, other) {
                    if !class.contains(&name) {
                        class.push(name);
                    }
                } else {
                    let winner = own.candidate.effect.name.to_owned();
                    rejected.push(bench.rejected(other, Reason::Outdone(winner)));
                }
            }
            (own.fit.clone(), bench.added(own, class, &trials, tries))
        });
        Self { winner, rejected }
    }
}

/// Who is simulated again, and why the others are not.
fn short_list(candidates: Vec<Candidate>, threshold: f64) -> (Vec<Rejected>, Vec<Candidate>) {
    let mut rejected = Vec::new();
    let mut short: Vec<Candidate> = Vec::new();
    let best = candidates
        .iter()
        .filter(|candidate| candidate.p_value < threshold)
        .map(|candidate| candidate.share)
        .fold(0.0, f64::max);
    for candidate in candidates {
        let reason = if candidate.visibility < VISIBLE {
            Reason::NotTestable
        } else if threshold <= candidate.p_value {
            Reason::NotSignificant
        } else if short.len() < SHORT_LIST
            && WORTH_SIMULATING * best <= candidate.share
            && short.iter().filter(|other| other.effect == candidate.effect).count() < PLACES_OF_ONE
        {
            short.push(candidate);
            continue;
        } else {
            Reason::Outdone(short.first().map_or("", |first| first.effect.name).to_owned())
        };
        rejected.push(Rejected { candidate, reason, held_out_gain: None });
    }
    (rejected, short)
}

/// `base` with the candidate's effect, everything fitted together.
fn fitted(
    train: &Problem<'_>,
    base: &Fit,
    candidate: &Candidate,
    filters: &Filters,
    known: &[Vec<f64>],
) -> Fit {
    // The line of the screen may lead too far for what bends: what is nearer to nothing is a start too.
    let starts = screen::towards_null(candidate).into_iter().map(|values| {
        let twin = screen::with(&base.point.twin, candidate.effect, candidate.axis, &values);
        let point = Point { twin, nuisance: base.point.nuisance.clone() };
        let loss = fit::squared(&train.whitened(&point, filters));
        (point, loss)
    });
    let best = starts.min_by(|a, b| a.1.total_cmp(&b.1));
    let point = best.map_or_else(|| base.point.clone(), |(point, _)| point);
    let mut slots = base.slots.clone();
    slots.extend(slots_of_last(&point.twin));
    fit::fit_with(train, point, &slots, &fit::How { filters, iterations: 10, known })
}

/// Slots of the instance that was added last.
fn slots_of_last(twin: &Twin) -> Vec<Slot> {
    let instance = twin.instances.len() - 1;
    (0..twin.instances[instance].values.len())
        .map(|parameter| Slot { instance, parameter })
        .collect()
}

/// What all trials of a round are measured against.
struct Bench<'a, 'b> {
    train: &'b Problem<'a>,
    held_out: &'b Problem<'a>,
    /// The metric: whitening of the best candidate's residual.
    filters: &'b Filters,
    base_train_rows: Vec<f64>,
    base_held: Point,
    base_held_rows: Vec<f64>,
}

impl<'a, 'b> Bench<'a, 'b> {
    fn new(
        train: &'b Problem<'a>,
        held_out: &'b Problem<'a>,
        base: &Fit,
        filters: &'b Filters,
    ) -> Self {
        let base_held = fit::adapt(held_out, held_out.start(base.point.twin.clone()), filters);
        Self {
            train,
            held_out,
            filters,
            base_train_rows: train.whitened(&base.point, filters),
            base_held_rows: held_out.whitened(&base_held, filters),
            base_held,
        }
    }

    /// A candidate, fitted in this metric and judged; `known` are the columns of known parameters.
    fn trial(&self, candidate: &Candidate, rough: &Fit, known: &[Vec<f64>]) -> Trial {
        let how = fit::How { filters: self.filters, iterations: 8, known };
        let fit = fit::fit_with(self.train, rough.point.clone(), &rough.slots, &how);
        let start = self.held_out.start(fit.point.twin.clone());
        let held_point = fit::adapt(self.held_out, start, self.filters);
        let mut trial = Trial {
            candidate: candidate.clone(),
            train_rows: self.train.whitened(&fit.point, self.filters),
            held_rows: self.held_out.whitened(&held_point, self.filters),
            held_point,
            fit,
            objection: None,
        };
        trial.objection = self.objection(&trial);
        trial
    }

    fn rejected(&self, trial: &Trial, reason: Reason) -> Rejected {
        let held_out_gain = Some(self.held_out_gain(trial));
        Rejected { candidate: trial.candidate.clone(), reason, held_out_gain }
    }

    fn added(
        &self,
        own: &Trial,
        class: Vec<&'static str>,
        trials: &[Trial],
        tries: usize,
    ) -> Added {
        let contest = trials
            .iter()
            .map(|trial| {
                let loss = trial.fit.loss / trial.fit.rows.max(1) as f64;
                (trial.candidate.effect.name.to_owned(), trial.candidate.axis, loss)
            })
            .collect();
        Added {
            effect: own.candidate.effect,
            axis: own.candidate.axis,
            p_value: (own.candidate.p_value * tries as f64).min(1.0),
            statistic: own.candidate.statistic,
            held_out_gain: self.held_out_gain(own),
            class,
            held_out_steps: (
                self.held_out.rms(&self.base_held),
                self.held_out.rms(&own.held_point),
            ),
            contest,
        }
    }

    /// Share of the held-out squared error that the trial removes.
    fn held_out_gain(&self, trial: &Trial) -> f64 {
        let before = fit::squared(&self.base_held_rows);
        (before - fit::squared(&trial.held_rows)) / before.max(f64::MIN_POSITIVE)
    }

    /// Why the trial may not be named; `None` when it may.
    fn objection(&self, trial: &Trial) -> Option<Reason> {
        if let Some(name) = on_bound(&trial.fit) {
            return Some(Reason::OnBound(name));
        }
        if !is_in(&self.base_train_rows, &trial.train_rows, &self.train.blocks()) {
            return Some(Reason::NotSignificant);
        }
        if self.held_out.parts.is_empty() {
            return None;
        }
        let (before, blocks) = (&self.base_held_rows, self.held_out.blocks());
        let amplitude = Amplitude::of(before, &trial.held_rows, &blocks);
        if amplitude.is_above(0.0, LEVEL) && SESSIONS_APART < (amplitude.value - 1.0).abs() {
            return Some(Reason::SessionsDisagree);
        }
        if !is_in(before, &trial.held_rows, &blocks) {
            return Some(Reason::HeldOut);
        }
        (self.held_out_gain(trial) < WORTH_NAMING).then_some(Reason::TooSmall)
    }

    /// Of the best that passed and its rivals, the one with the fewest numbers; of equals the best.
    fn simplest<'t>(&self, passed: &[&'t Trial]) -> Option<&'t Trial> {
        let best = *passed.first()?;
        passed
            .iter()
            .copied()
            .filter(|other| std::ptr::eq(*other, best) || self.is_rival(best, other))
            .min_by_key(|trial| trial.candidate.effect.parameters.len())
    }

    /// Whether `other` explains all sessions as well as `own`.
    fn is_rival(&self, own: &Trial, other: &Trial) -> bool {
        let (train, held) = (self.train.blocks(), self.held_out.blocks());
        let later = held.of_row.iter().map(|block| train.count + block);
        let blocks = Blocks {
            of_row: train.of_row.iter().copied().chain(later).collect(),
            count: train.count + held.count,
        };
        let all = |trial: &Trial| [trial.train_rows.as_slice(), &trial.held_rows].concat();
        !Amplitude::of(&all(other), &all(own), &blocks).is_above(0.5, RIVAL_LEVEL)
    }
}

/// The first parameter of the added effect that stopped on a bound.
fn on_bound(fit: &Fit) -> Option<String> {
    let twin = &fit.point.twin;
    slots_of_last(twin).into_iter().find_map(|slot| {
        let parameter = &twin.instances[slot.instance].effect.parameters[slot.parameter];
        let (value, (low, high)) = (twin.get(slot), parameter.bounds);
        let near = 1e-6 * (high - low);
        (value <= low + near || high - near <= value).then(|| parameter.name.to_owned())
    })
}
