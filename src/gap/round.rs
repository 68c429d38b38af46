//! One round of the search on one link: screen, simulate the best again, judge, choose.

mod bench;
mod choice;
mod objection;
mod starts;
mod trial;

pub(super) use trial::on_bound_of;

use self::{
    bench::Bench,
    starts::rough_fits,
    trial::{in_order, on_bound},
};
use super::{
    batch::in_parallel,
    direct,
    fit::Fit,
    known::Worth,
    observer::SearchStep,
    problem::Problem,
    rounds::{Added, Reason, Rejected, known_on_bound},
    screen::{self, Candidate},
    thresholds::Thresholds,
    whiten::{self, Filters},
};
use crate::twin::{Machine, Slot, Twin};

/// Candidates that are simulated again in one round.
const SHORT_LIST: usize = 7;

/// The same of those that alone bring the given twin nearest to the data.
const FROM_GIVEN: usize = 4;

/// Places of one effect that are simulated again in one round.
const PLACES_OF_ONE: usize = 2;

/// Share of the squared error by which a start must change it to do anything at all.
const IDLE: f64 = 1e-9;

/// One round: screen, simulate, decide.
pub(super) struct Round {
    pub(super) winner: Option<(Fit, Added)>,
    pub(super) rejected: Vec<Rejected>,
}

/// Where a round begins.
#[derive(Clone, Copy)]
pub(super) struct Stand<'p> {
    /// The twin so far, everything fitted.
    pub(super) base: &'p Fit,
    /// Whitening of its residual.
    pub(super) filters: &'p Filters,
    /// The given twin as it was, before anything was fitted or added.
    pub(super) given: Option<&'p (Fit, Filters)>,
    /// Number of instances in the given twin.
    pub(super) given_instances: usize,
    /// What makes an effect worth a name.
    pub(super) worth: Worth<'p>,
}

impl Stand<'_> {
    /// Fitted parameters of the given twin that no candidate may leave on a bound: those of the rigid body of a single
    /// axis. On a table, an effect of the given twin may end there because another takes its place.
    fn known(&self) -> Vec<Slot> {
        if self.base.point.twin.machine == Machine::Table {
            return Vec::new();
        }
        let slots = self.base.slots.iter().copied();
        slots.filter(|slot| slot.instance < self.given_instances).collect()
    }
}

/// What a round looks at.
#[derive(Clone, Copy)]
pub(super) struct Problems<'a, 'b> {
    /// The link on the fitted sessions.
    pub(super) train: &'b Problem<'a>,
    /// The link on the judging sessions.
    pub(super) held_out: &'b Problem<'a>,
    /// Another link on the judging sessions, on which the same effects act for longer.
    pub(super) witness: &'b Problem<'a>,
}

impl Round {
    pub(super) fn run(problems: Problems<'_, '_>, stand: &Stand<'_>) -> Self {
        let Stand { base, filters, given, worth, .. } = *stand;
        let known_slots = stand.known();
        let train = problems.train;
        let candidates = screen::screen(train, base, filters);
        let tries: usize = candidates.iter().map(|candidate| candidate.tries).sum();
        let (mut rejected, mut short) = short_list(candidates, tries, train.thresholds());
        if let Some((given, filters)) = given {
            let nearest = direct::nearest(train, (given, filters), &base.point);
            for candidate in nearest.into_iter().take(FROM_GIVEN) {
                let same =
                    |own: &Candidate| own.effect == candidate.effect && own.axis == candidate.axis;
                if let Some(own) = short.iter_mut().find(|own| same(own)) {
                    own.start = candidate.start;
                    own.is_as_good_as_refit = candidate.is_as_good_as_refit;
                } else {
                    rejected.retain(|other| !same(&other.candidate));
                    short.push(candidate);
                }
            }
        }
        // First in the metric of the base residual, then in that of the best candidate's.
        let observer = train.context.observer;
        // Each is fitted twice: roughly, and in the metric of the best.
        observer.step_begun(SearchStep::Trial, 2 * short.len());
        let rough = rough_fits(train, stand, &short);
        // What is no effect is no metric either.
        let is_driven = |fit: &Fit| known_on_bound(&fit.point.twin, &known_slots);
        let sound = |fit: &&Fit| {
            fit.loss.is_finite() && on_bound(fit).is_none() && is_driven(fit).is_none()
        };
        let lead = rough.iter().filter(sound).min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(lead) = lead.or(rough.first()) else { return Self { winner: None, rejected } };
        let sharp = train.filters(&lead.point, whiten::fit_filters);
        let at_lead = train.evaluated(lead.point.clone());
        let known = train.columns(&at_lead, &base.slots, &sharp);
        let bench = Bench::new(problems, (base, known_slots), (&sharp, &worth), tries);
        let items: Vec<(Candidate, Fit)> =
            short.into_iter().zip(rough).filter(|(_, fit)| fit.loss.is_finite()).collect();
        let mut trials = in_parallel(&items, |(candidate, rough)| {
            let trial = bench.trial(candidate, rough, &known);
            observer.candidate_done();
            trial
        });
        in_order(&mut trials);
        bench.give_second_chances(&mut trials, &known);
        in_order(&mut trials);
        bench.fit_rivals_in_earnest(&mut trials);
        in_order(&mut trials);
        let worth_naming = bench.worth_naming(&trials);
        for trial in &trials {
            trial.log();
            let is_in = worth_naming.iter().any(|own| std::ptr::eq(*own, trial));
            if let Some(reason) = trial.objection.as_ref().filter(|_| !is_in) {
                rejected.push(bench.rejected(trial, reason.clone()));
            }
        }
        let winner = bench.winner(&worth_naming, &trials, &mut rejected);
        Self { winner, rejected }
    }
}

/// Who is simulated again, and why the others are not.
fn short_list(
    candidates: Vec<Candidate>,
    tries: usize,
    thresholds: &Thresholds,
) -> (Vec<Rejected>, Vec<Candidate>) {
    let threshold = thresholds.family_error / tries.max(1) as f64;
    let visible = thresholds.detectability;
    let mut rejected = Vec::new();
    let mut short: Vec<Candidate> = Vec::new();
    let best = candidates
        .iter()
        .filter(|candidate| candidate.p_value < threshold)
        .map(|candidate| candidate.share)
        .fold(0.0, f64::max);
    for candidate in candidates {
        let is_seen = candidate.p_value < threshold;
        let places = short.iter().filter(|other| other.effect == candidate.effect).count();
        let usually_shown = candidate.visibility * screen::usual_share(candidate.effect);
        let reason = if candidate.visibility < visible || !is_seen && usually_shown < visible {
            Reason::NotTestable
        } else if !is_seen {
            Reason::NotSignificant
        } else if short.len() < SHORT_LIST
            && thresholds.clear_gain * best <= candidate.share
            && (screen::is_shared(candidate.axis) || places < PLACES_OF_ONE)
        {
            short.push(candidate);
            continue;
        } else {
            Reason::Outdone(short.first().map_or("", |first| first.effect.name).to_owned())
        };
        rejected.push(Rejected { candidate, reason, validation_gain: None });
    }
    (rejected, short)
}

/// Slots of the instance that was added last.
pub(super) fn slots_of_last(twin: &Twin) -> Vec<Slot> {
    let instance = twin.instances.len() - 1;
    (0..twin.instances[instance].values.len())
        .map(|parameter| Slot { instance, parameter })
        .collect()
}

/// The numbers of the instance that was added last.
pub(super) fn numbers_of_last(twin: &Twin) -> Vec<f64> {
    slots_of_last(twin).into_iter().map(|slot| twin.get(slot)).collect()
}
