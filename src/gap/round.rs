//! One round of the search on one stage: screen, simulate and fit the best candidates, validate, select.

mod bench;
mod choice;
mod objection;
mod starts;
mod trial;

pub(super) use bench::View;
pub(super) use trial::on_bound_of;

use self::{
    bench::Bench,
    starts::rough_fits,
    trial::{on_bound, sort_by_loss},
};
use super::{
    batch::in_parallel,
    direct,
    fit::{self, Fit},
    known::RequiredGain,
    observer::SearchStep,
    problem::Problem,
    rounds::{Added, Reason, Rejected, known_on_bound},
    screen::{self, Candidate},
    thresholds::Thresholds,
    whiten::{self, Filters},
};
use crate::twin::{Instance, Machine, Slot, Twin};
#[cfg(test)]
use crate::{gap::known::AtFloor, twin::StageKind};

/// Most candidates that are simulated and fitted in one round.
const SHORT_LIST: usize = 7;

/// The same for effects that reduce the residual of the given twin most, each added alone.
const GIVEN_SHORT_LIST: usize = 4;

/// Most axes on which one effect is simulated and fitted in one round.
const LOCATIONS_PER_EFFECT: usize = 2;

/// Relative change of the squared error below which a start has no influence at all.
const IDLE: f64 = 1e-9;

/// Result of one round.
pub(super) struct Round {
    pub(super) winner: Option<(Fit, Added)>,
    pub(super) rejected: Vec<Rejected>,
    pub(super) tried: Vec<Tried>,
}

/// Candidate that was simulated and fitted.
pub(super) struct Tried {
    candidate: Candidate,
    fit: Fit,
    /// `true` where it passed every check.
    has_passed: bool,
}

impl Tried {
    fn is_of(&self, candidate: &Candidate) -> bool {
        self.candidate.is(candidate.effect, candidate.axis)
    }
}

/// State in which a round begins.
#[derive(Clone, Copy)]
pub(super) struct RoundStart<'p> {
    /// Twin so far, everything fitted.
    pub(super) base: &'p Fit,
    /// Whitening of its residual.
    pub(super) filters: &'p Filters,
    /// The same with those known parameters at their given values that are not plausible as fitted, if any.
    pub(super) plausible: Option<&'p (Fit, Filters)>,
    /// Given twin before any fit and any added effect.
    pub(super) given: Option<&'p (Fit, Filters)>,
    /// Number of instances in the given twin.
    pub(super) given_instances: usize,
    /// Twin before the first effect was added, everything fitted.
    pub(super) before_added: Option<&'p Twin>,
    /// Candidates of the round before.
    pub(super) previous: &'p [Tried],
    /// Gain that the first effect must have.
    pub(super) required_gain: RequiredGain<'p>,
}

impl RoundStart<'_> {
    /// Fitted parameters of the given twin that no candidate may leave on a bound: those of the rigid body of a single
    /// axis. On a table, an effect of the given twin may end there because another replaces it.
    fn known(&self) -> Vec<Slot> {
        if self.base.point.twin.machine == Machine::Table {
            return Vec::new();
        }
        let slots = self.base.slots.iter().copied();
        slots.filter(|slot| slot.instance < self.given_instances).collect()
    }

    /// Gain that an effect must have in the metric of `filters`, after those that were added before.
    fn required_gain(&self, problems: Problems<'_, '_>, filters: &Filters) -> RequiredGain<'_> {
        let Some(before) = self.before_added else { return self.required_gain };
        let problem = match problems.held_out.parts.is_empty() {
            true => problems.train,
            false => problems.held_out,
        };
        let square = |twin: &Twin| fit::squared(&fit::residual_on(problem, twin, filters));
        let base = &self.base.point.twin;
        let left = square(base);
        self.required_gain.in_addition_to(base, square(before) - left, left)
    }
}

/// Data of a round.
#[derive(Clone, Copy)]
pub(super) struct Problems<'a, 'b> {
    /// The stage in the training sessions.
    pub(super) train: &'b Problem<'a>,
    /// The stage in the validation sessions.
    pub(super) held_out: &'b Problem<'a>,
    /// Another stage in the validation sessions, on which the same effects act for longer.
    pub(super) witness: &'b Problem<'a>,
    /// Another stage in the training sessions, which was searched before and which no effect must contradict.
    pub(super) predecessor: &'b Problem<'a>,
}

impl Round {
    pub(super) fn run(problems: Problems<'_, '_>, round_start: &RoundStart<'_>) -> Self {
        let base = round_start.base;
        let known_slots = round_start.known();
        let train = problems.train;
        let (mut rejected, short, tries) = chosen(train, round_start);
        // First in the metric of the base residual, then in that of the best candidate's residual.
        let observer = train.context.observer;
        // Each is fitted twice: roughly, and in the metric of the best.
        observer.step_begun(SearchStep::Trial, 2 * short.len());
        let rough = rough_fits(train, round_start, &short);
        // A rejected fit must not define the metric either.
        let sound = |fit: &&Fit| {
            let driven = newly_on_bound(&base.point.twin, &fit.point.twin, &known_slots);
            fit.loss.is_finite() && on_bound(train, fit).is_none() && driven.is_none()
        };
        let lead = rough.iter().filter(sound).min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(lead) = lead.or(rough.first()) else {
            return Self { winner: None, rejected, tried: vec![] };
        };
        let sharp = train.filters(&lead.point, whiten::fit_filters);
        let at_lead = train.evaluated(lead.point.clone());
        let known = train.columns(&at_lead, &base.slots, &sharp);
        let required_gain = round_start.required_gain(problems, &sharp);
        let bench = Bench::new(problems, (base, known_slots), (&sharp, &required_gain), tries);
        let items: Vec<(Candidate, Fit)> =
            short.into_iter().zip(rough).filter(|(_, fit)| fit.loss.is_finite()).collect();
        let mut trials = in_parallel(&items, |(candidate, rough)| {
            let trial = bench.trial(candidate, rough, &known);
            observer.candidate_done();
            trial
        });
        sort_by_loss(&mut trials);
        bench.refit_from_best(&mut trials, &known);
        sort_by_loss(&mut trials);
        bench.fit_rivals_to_convergence(&mut trials);
        sort_by_loss(&mut trials);
        let acceptable = bench.acceptable(&trials);
        for trial in &trials {
            trial.log();
            let is_in = acceptable.iter().any(|own| std::ptr::eq(*own, trial));
            if let Some(reason) = trial.objection.as_ref().filter(|_| !is_in) {
                rejected.push(bench.rejected(trial, reason.clone()));
            }
        }
        let winner = bench.winner(&acceptable, &trials, &mut rejected);
        let tried = trials.into_iter().map(|trial| Tried {
            candidate: trial.candidate,
            fit: trial.fit,
            has_passed: trial.objection.is_none(),
        });
        Self { winner, rejected, tried: tried.collect() }
    }
}

/// Name of the first of the `known` parameters that is on a bound in `twin` and was on none in its `base`. A candidate is
/// rejected only for a bound that it causes: the missing effects together may take a parameter off its bound. The last
/// twin is checked again.
fn newly_on_bound(base: &Twin, twin: &Twin, known: &[Slot]) -> Option<String> {
    let was_inside = |slot: &&Slot| on_bound_of(base, [**slot]).is_none();
    let inside: Vec<Slot> = known.iter().filter(was_inside).copied().collect();
    known_on_bound(twin, &inside)
}

/// Candidates that are simulated and fitted, the others with the reason of their rejection, and the number of tests that
/// were made to choose them.
fn chosen(
    train: &Problem<'_>,
    round_start: &RoundStart<'_>,
) -> (Vec<Rejected>, Vec<Candidate>, usize) {
    let RoundStart { base, filters, plausible, given, previous, .. } = *round_start;
    let candidates = screen::screen(train, base, filters);
    let others =
        plausible.map_or_else(Vec::new, |(fit, filters)| screen::screen(train, fit, filters));
    let tries = candidates.iter().chain(&others).map(|candidate| candidate.tries).sum();
    let (mut rejected, mut short) = short_list(candidates, tries, train.thresholds());
    for candidate in short_list(others, tries, train.thresholds()).1 {
        add_to_short_list(candidate, &mut short, &mut rejected);
    }
    if let Some((given, filters)) = given {
        let nearest = direct::nearest(train, (given, filters), &base.point);
        for candidate in nearest.into_iter().take(GIVEN_SHORT_LIST) {
            let same = |own: &Candidate| own.is(candidate.effect, candidate.axis);
            if let Some(own) = short.iter_mut().find(|own| same(own)) {
                own.start = candidate.start;
                own.is_as_good_as_refit = candidate.is_as_good_as_refit;
            } else {
                add_to_short_list(candidate, &mut short, &mut rejected);
            }
        }
    }
    // What passed before may be hidden now: the winner and the known parameters may have taken its place.
    for earlier in previous.iter().filter(|earlier| earlier.has_passed) {
        let is_acting = |own: &Instance| earlier.candidate.is(own.effect, own.axis);
        if !base.point.twin.instances.iter().any(is_acting) {
            add_to_short_list(earlier.candidate.clone(), &mut short, &mut rejected);
        }
    }
    (rejected, short, tries)
}

/// Add `candidate` to the `short` list in place of a rejection, unless it is there.
fn add_to_short_list(
    candidate: Candidate,
    short: &mut Vec<Candidate>,
    rejected: &mut Vec<Rejected>,
) {
    let is_same = |own: &Candidate| own.is(candidate.effect, candidate.axis);
    if !short.iter().any(is_same) {
        rejected.retain(|other| !is_same(&other.candidate));
        short.push(candidate);
    }
}

/// Candidates that are simulated and fitted, and the others with the reason of their rejection.
fn short_list(
    candidates: Vec<Candidate>,
    tries: usize,
    thresholds: &Thresholds,
) -> (Vec<Rejected>, Vec<Candidate>) {
    let threshold = thresholds.family_error / tries.max(1) as f64;
    let detectable = thresholds.detectability;
    let mut rejected = Vec::new();
    let mut short: Vec<Candidate> = Vec::new();
    let best = candidates
        .iter()
        .filter(|candidate| candidate.p_value < threshold)
        .map(|candidate| candidate.explained_fraction)
        .fold(0.0, f64::max);
    for candidate in candidates {
        let is_seen = candidate.p_value < threshold;
        let locations = short.iter().filter(|other| other.effect == candidate.effect).count();
        let usually_shown = candidate.detectability * screen::usual_fraction(candidate.effect);
        let reason =
            if candidate.detectability < detectable || !is_seen && usually_shown < detectable {
                Reason::NotTestable
            } else if !is_seen {
                Reason::NotSignificant
            } else if short.len() < SHORT_LIST
                && thresholds.clear_gain * best <= candidate.explained_fraction
                && (screen::is_shared(candidate.axis) || locations < LOCATIONS_PER_EFFECT)
            {
                short.push(candidate);
                continue;
            } else {
                Reason::Outperformed(short.first().map_or("", |first| first.effect.name).to_owned())
            };
        rejected.push(Rejected { candidate, reason, validation_gain: None, values: None });
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

/// Parameter values of the instance that was added last.
pub(super) fn values_of_last(twin: &Twin) -> Vec<f64> {
    slots_of_last(twin).into_iter().map(|slot| twin.get(slot)).collect()
}

#[cfg(test)]
impl<'p> RoundStart<'p> {
    /// Round of the camera stage with everything in the `base` and no effect on the `nominal` twin.
    fn at(base: &'p Fit, filters: &'p Filters, nominal: &'p Twin, previous: &'p [Tried]) -> Self {
        let of_stage = (nominal, StageKind::Camera);
        let thresholds = &Thresholds::DEFAULT;
        Self {
            base,
            filters,
            plausible: None,
            given: None,
            given_instances: nominal.instances.len(),
            before_added: None,
            previous,
            required_gain: RequiredGain::new(thresholds, of_stage, (None, None), AtFloor::No),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gap::{
        test_stage::{TestStage, axis_of_frequency, candidate, sines, with},
        whiten,
    };

    #[test]
    fn what_passed_before_is_tried_again_without_a_significant_screen() {
        let nominal = Twin::nominal(Machine::Axis);
        let truth = with(&axis_of_frequency(5.0), "drive.lag1", 0.3);
        let stage = TestStage::camera(&truth, sines, 4);
        let train = Problem::new(&[&stage as _], &nominal);
        let base = Fit { point: train.start(truth), slots: vec![], loss: 1.0, rows: 2000 };
        let filters = train.filters(&base.point, whiten::scale_filters);
        let is_tried = |has_passed: bool| {
            let candidate = candidate("drive.delay", 0.4);
            let previous = [Tried { candidate, fit: base.clone(), has_passed }];
            let round_start = RoundStart::at(&base, &filters, &nominal, &previous);
            let (_, short, _) = chosen(&train, &round_start);
            short.iter().any(|own| own.effect.name == "drive.delay")
        };
        assert!(is_tried(true) && !is_tried(false));
    }
}
