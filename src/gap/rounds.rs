//! The rounds of the search on one link: refit, screen, re-simulate the best, decide, add, repeat.

use super::{
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
pub const FAMILY_ERROR: f64 = 0.01;

/// Candidates that are simulated again in one round.
const SHORT_LIST: usize = 7;

/// Places of one effect that are simulated again in one round.
const PLACES_OF_ONE: usize = 2;

/// Share of the best candidate's gain below which another is not simulated again.
const WORTH_SIMULATING: f64 = 0.1;

/// Most effects that are added to one link.
const MOST_ADDED: usize = 6;

/// Block t statistic by which the held-out session must prefer the twin with the effect.
const HELD_OUT_T: f64 = 3.0;

/// Block t statistic below which a rival explains the data as well as the winner.
const RIVAL_T: f64 = 2.5;

/// Share of the held-out squared error (whitened) that an effect must explain to be worth a name: a
/// simulator of finite fidelity leaves that much of anything.
const WORTH_NAMING: f64 = 0.02;

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
    /// Its p-value, corrected for all tries, is above [`FAMILY_ERROR`].
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
    /// Residual RMS per held-out signal before and after this step, in order of [`Outcome::signals`].
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
    /// Whitening of the final residual.
    pub filters: Filters,
    /// Intervals of the final fit.
    pub uncertainty: Uncertainty,
    /// What was added, in this order.
    pub added: Vec<Added>,
    /// What was not.
    pub rejected: Vec<Rejected>,
    /// Tries of the last screen.
    pub tries: usize,
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
}

/// Searches one link from `start`. With `add_effects` false, only parameters are fitted.
#[must_use]
pub fn search<'a>(link: &Link<'a>, start: &Twin, add_effects: bool) -> Outcome<'a> {
    let mut train = Problem::new(&link.train, start);
    let mut held_out = Problem::new(&link.held_out, start);
    let slots = start.free(link.train[0]);
    let first = train.start(start.clone());
    let scales = train.filters(&first, whiten::scale_filters);
    let first = fit::adapt(&train, first, &scales);
    let (rough, _) = fit::fit_from_afar(&train, first.clone(), &slots, 15);
    train.drop_outliers(&rough.point);
    let held_point = fit::adapt(&held_out, held_out.start(rough.point.twin.clone()), &scales);
    held_out.drop_outliers(&held_point);
    let (mut best, mut filters) = fit::settle(&train, rough.point, &slots, 10);
    if let Some(better) = restarted(&train, &best, start) {
        (best, filters) = fit::settle(&train, better, &slots, 10);
    }
    let start_held_out = fit::adapt(&held_out, held_out.start(start.clone()), &scales);
    let refitted = best.point.clone();
    let mut added: Vec<Added> = Vec::new();
    let mut rejected = Vec::new();
    let mut tries = 0;
    while add_effects && added.len() < MOST_ADDED {
        let round = Round::run(&train, &held_out, &best, &filters);
        tries = round.tries;
        rejected = round.rejected;
        let Some((fit, step)) = round.winner else { break };
        added.push(step);
        (best, filters) = fit::settle(&train, fit.point.clone(), &fit.slots, 8);
    }
    let mut last_held_out =
        fit::adapt(&held_out, held_out.start(best.point.twin.clone()), &filters);
    let unexplained = add_effects
        .then(|| unknown::strongest(&train, &held_out, &best, &last_held_out, &filters))
        .flatten();
    if let Some(unknown) = &unexplained
        && withdraw(&mut best, &mut added, unknown)
    {
        (best, filters) = fit::settle(&train, best.point.clone(), &best.slots, 8);
        last_held_out = fit::adapt(&held_out, held_out.start(best.point.twin.clone()), &filters);
    }
    let uncertainty = fit::uncertainty(&train, &best, &filters);
    Outcome {
        kind: link.kind,
        train,
        held_out,
        start: first,
        start_held_out,
        refitted,
        last: best,
        last_held_out,
        filters,
        uncertainty,
        added,
        rejected,
        tries,
        unexplained,
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
        left.is_none_or(|left| STUCK * left.residual_rms < *rms)
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
    tries: usize,
}

impl Round {
    fn run(train: &Problem<'_>, held_out: &Problem<'_>, base: &Fit, filters: &Filters) -> Self {
        let candidates = screen::screen(train, base, filters);
        let tries: usize = candidates.iter().map(|candidate| candidate.tries).sum();
        let threshold = FAMILY_ERROR / tries.max(1) as f64;
        let (mut rejected, short) = short_list(candidates, threshold);
        let base_held = fit::adapt(held_out, held_out.start(base.point.twin.clone()), filters);
        // First in the metric of the base residual, then in that of the best candidate's.
        let known = train.columns(&base.point, &base.slots, filters);
        let rough: Vec<Fit> =
            in_parallel(&short, |candidate| fitted(train, base, candidate, filters, &known));
        let sound = |fit: &&Fit| on_bound(fit).is_none();
        let lead = rough.iter().filter(sound).min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(lead) = lead.or(rough.first()) else {
            return Self { winner: None, rejected, tries };
        };
        let sharp = train.filters(&lead.point, whiten::fit_filters);
        let known = train.columns(&lead.point, &base.slots, &sharp);
        let items: Vec<(Candidate, Fit)> = short.into_iter().zip(rough).collect();
        let mut trials = in_parallel(&items, |(candidate, rough)| {
            let fit = fit::fit_with(train, rough.point.clone(), &rough.slots, &sharp, 8, &known);
            trial(train, held_out, candidate.clone(), fit, &sharp)
        });
        trials.sort_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss));
        let base_train_rows = train.whitened(&base.point, &sharp);
        let base_held_rows = held_out.whitened(&base_held, &sharp);
        let bench = Bench { train, held_out, base_train_rows, base_held_rows };
        let contest = trials
            .iter()
            .map(|trial| {
                let loss = trial.fit.loss / trial.fit.rows.max(1) as f64;
                (trial.candidate.effect.name.to_owned(), trial.candidate.axis, loss)
            })
            .collect::<Vec<_>>();
        let mut winner: Option<usize> = None;
        for (index, trial) in trials.iter().enumerate() {
            match bench.objection(trial, &sharp) {
                None if winner.is_none() => winner = Some(index),
                None => {}
                Some(reason) => rejected.push(Rejected {
                    candidate: trial.candidate.clone(),
                    reason,
                    held_out_gain: Some(bench.held_out_gain(trial)),
                }),
            }
        }
        let winner = winner.map(|index| {
            let index = bench.simplest(&trials, index, &sharp);
            let own = &trials[index];
            let mut class = Vec::new();
            for (_, other) in trials.iter().enumerate().filter(|(other, _)| *other != index) {
                let same = other.candidate.effect == own.candidate.effect;
                if bench.objection(other, &sharp).is_some() {
                    continue;
                }
                if !same && bench.is_rival(own, other) {
                    if !class.contains(&other.candidate.effect.name) {
                        class.push(other.candidate.effect.name);
                    }
                } else {
                    rejected.push(Rejected {
                        candidate: other.candidate.clone(),
                        reason: Reason::Outdone(own.candidate.effect.name.to_owned()),
                        held_out_gain: Some(bench.held_out_gain(other)),
                    });
                }
            }
            let step = Added {
                effect: own.candidate.effect,
                axis: own.candidate.axis,
                p_value: (own.candidate.p_value * tries as f64).min(1.0),
                statistic: own.candidate.statistic,
                held_out_gain: bench.held_out_gain(own),
                class,
                held_out_steps: (held_out.rms(&base_held), held_out.rms(&own.held_point)),
                contest,
            };
            (own.fit.clone(), step)
        });
        Self { winner, rejected, tries }
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
    // The line of the screen may lead too far for what bends: the probe itself is a start as well.
    let starts = [&candidate.start, &candidate.probe].map(|values| {
        let twin = screen::with(&base.point.twin, candidate.effect, candidate.axis, values);
        let point = Point { twin, nuisance: base.point.nuisance.clone() };
        let loss = fit::squared(&train.whitened(&point, filters));
        (point, loss)
    });
    let [line, probe] = starts;
    let point = if probe.1 < line.1 { probe.0 } else { line.0 };
    let mut slots = base.slots.clone();
    slots.extend(slots_of_last(&point.twin));
    fit::fit_with(train, point, &slots, filters, 10, known)
}

/// Slots of the instance that was added last.
fn slots_of_last(twin: &Twin) -> Vec<Slot> {
    let instance = twin.instances.len() - 1;
    (0..twin.instances[instance].values.len())
        .map(|parameter| Slot { instance, parameter })
        .collect()
}

fn trial(
    train: &Problem<'_>,
    held_out: &Problem<'_>,
    candidate: Candidate,
    fit: Fit,
    filters: &Filters,
) -> Trial {
    let held_point = fit::adapt(held_out, held_out.start(fit.point.twin.clone()), filters);
    Trial {
        candidate,
        train_rows: train.whitened(&fit.point, filters),
        held_rows: held_out.whitened(&held_point, filters),
        held_point,
        fit,
    }
}

/// What all trials of a round are measured against.
struct Bench<'a, 'b> {
    train: &'b Problem<'a>,
    held_out: &'b Problem<'a>,
    base_train_rows: Vec<f64>,
    base_held_rows: Vec<f64>,
}

impl Bench<'_, '_> {
    /// Share of the held-out squared error that the trial removes.
    fn held_out_gain(&self, trial: &Trial) -> f64 {
        let before = fit::squared(&self.base_held_rows);
        (before - fit::squared(&trial.held_rows)) / before.max(f64::MIN_POSITIVE)
    }

    /// Why the trial may not be named; `None` when it may.
    fn objection(&self, trial: &Trial, filters: &Filters) -> Option<Reason> {
        if let Some(name) = on_bound(&trial.fit) {
            return Some(Reason::OnBound(name));
        }
        if self.train.block_t(&self.base_train_rows, &trial.train_rows) < HELD_OUT_T {
            return Some(Reason::NotSignificant);
        }
        if self.held_out.parts.is_empty() {
            return None;
        }
        if self.held_out.block_t(&self.base_held_rows, &trial.held_rows) < HELD_OUT_T {
            return Some(Reason::HeldOut);
        }
        if self.held_out_gain(trial) < WORTH_NAMING {
            return Some(Reason::TooSmall);
        }
        self.sessions_disagree(trial, filters).then_some(Reason::SessionsDisagree)
    }

    /// Whether the judging sessions alone would give the effect another sign or quite another size.
    fn sessions_disagree(&self, trial: &Trial, filters: &Filters) -> bool {
        let slots: Vec<Slot> = slots_of_last(&trial.fit.point.twin)
            .into_iter()
            .filter(|slot| {
                let effect = trial.fit.point.twin.instances[slot.instance].effect;
                !effect.parameters[slot.parameter].per_session
            })
            .collect();
        let Some(first) = slots.first() else { return false };
        let own = fit::fit(self.held_out, trial.held_point.clone(), &slots, filters, 4);
        let fitted = trial.fit.point.twin.get(*first);
        let judged = own.point.twin.get(*first);
        let null = trial.fit.point.twin.instances[first.instance].effect.null[first.parameter];
        let spread = fit::uncertainty(self.held_out, &own, filters).standard_errors[0];
        let size = (fitted - null).abs().max((judged - null).abs());
        let opposite = (fitted - null) * (judged - null) < 0.0;
        let apart = (fitted - judged).abs();
        apart > 4.0 * spread && (opposite || 0.5 * size < apart)
    }

    /// Of the best trial and its rivals, the one with the fewest numbers; of equals the best.
    fn simplest(&self, trials: &[Trial], best: usize, filters: &Filters) -> usize {
        let count = |index: usize| trials[index].candidate.effect.parameters.len();
        (best..trials.len())
            .filter(|other| {
                *other == best
                    || self.is_rival(&trials[best], &trials[*other])
                        && self.objection(&trials[*other], filters).is_none()
            })
            .min_by_key(|index| (count(*index), *index))
            .unwrap_or(best)
    }

    /// Whether `other` explains all sessions as well as `own`.
    fn is_rival(&self, own: &Trial, other: &Trial) -> bool {
        let train = self.train.block_gains(&other.train_rows, &own.train_rows);
        let held = self.held_out.block_gains(&other.held_rows, &own.held_rows);
        let all: Vec<f64> = train.into_iter().chain(held).collect();
        mean_t(&all) < RIVAL_T
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

/// Student's t of the mean of `values`.
#[must_use]
pub fn mean_t(values: &[f64]) -> f64 {
    let n = values.len() as f64;
    if n < 3.0 {
        return 0.0;
    }
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
    if variance == 0.0 { 0.0 } else { mean / (variance / n).sqrt() }
}
