//! Search on one stage: refit, screen, simulate and fit the best candidates, select, add, repeat.

use super::{
    estimates::estimates,
    fit::{self, Fit, Uncertainty},
    incident,
    journal::{JournalEntry, MoveKind},
    known::{Excess, RequiredGain, excess},
    noise,
    observer::SearchStep,
    problem::{Point, Problem},
    round::{Problems, Round, RoundStart, values_of_last},
    screen::{self, Candidate},
    unknown::{self, Unknown},
    whiten::{self, Filters},
};
use crate::twin::{Discrepancy, Machine, Slot, StageKind, Twin};

mod alignment;
mod elimination;
mod exchange;
mod few_changes;
mod note;
mod outcome;
mod refit;
mod split;

use refit::{exclude_outliers, multistart, refit_in_agreement, with_nuisances_only};

pub(in crate::gap) use elimination::{instance_of, known_on_bound};
pub use outcome::{Added, Held, Outcome, Reason, Rejected, StageData, Task};
pub(super) use outcome::{RankedCandidate, Unstated};
pub(in crate::gap) use refit::at_null;

/// Most effects that are added on one stage.
const MOST_ADDED: usize = 10;

/// Search one stage from the twin `start`.
#[must_use]
pub fn search<'a>(data: &StageData<'a>, start: &Twin, task: Task) -> Outcome<'a> {
    let (mut search, opening) = Search::opened(data, start);
    let Opening { given, scales, excess, slots } = opening;
    let refitted = search.best.clone();
    let unexplained = match task {
        Task::Calibrate | Task::Follow => None,
        Task::CloseGap => search.add_effects(&given, excess),
    };
    let mut known = search.eliminate_insignificant();
    // Effects now include the part that a removed effect had in common with them.
    while search.remove_minor(&given.twin) {
        known = search.eliminate_insignificant();
    }
    let Search {
        train,
        held_out,
        mut best,
        mut filters,
        added,
        rejected,
        removed,
        mut journal,
        ..
    } = search;
    let twins = (start, &best.point.twin);
    let least = train.thresholds().least_gain(excess);
    let is_better = is_better(&held_out, twins, &filters, least);
    if task != Task::Calibrate && added.is_empty() && !is_better {
        (best, filters) = with_nuisances_only(&train, &given, &slots);
        journal.push(JournalEntry::new(
            MoveKind::Keep,
            Some(data.kind),
            "The validation sessions do not confirm the refit: the given parameters stay",
        ));
    }
    let refitted_estimates = match added.is_empty() {
        true => Vec::new(),
        false => estimates(&fit::ordinary_least_squares(&train, &refitted)),
    };
    let (validated, uncertainty) = known.unwrap_or_else(|| {
        uncertainty_of((&train, &held_out), &best, &filters, (&rejected, &added))
    });
    best.point = fit::with_refitted_nuisances(&train, &best.point);
    Outcome {
        kind: data.kind,
        is_better,
        uncertainty,
        start_held_out: fit::on(&held_out, start, &scales),
        last_held_out: fit::with_refitted_nuisances(&held_out, &validated),
        train,
        held_out,
        start: given,
        refitted: refitted.point,
        refitted_estimates,
        last: best,
        filters,
        added,
        rejected,
        removed,
        unexplained,
        journal,
    }
}

/// Twin of `best` on the validation sessions, and the uncertainty of its parameters.
fn uncertainty_of(
    (train, held_out): (&Problem<'_>, &Problem<'_>),
    best: &Fit,
    filters: &Filters,
    (rejected, added): (&[Rejected], &[Added]),
) -> (Point, Uncertainty) {
    let is_replacement = |own: &Candidate| replaces_added(own, added);
    let shifts = shifts(rejected, is_replacement, train.thresholds().family_error);
    let validated = fit::on(held_out, &best.point.twin, filters);
    let uncertainty = fit::uncertainty(train, held_out, (best, &validated), filters)
        .with_metric_variance(train, best)
        .with_omitted_effects(best, &shifts);
    (validated, uncertainty)
}

/// Shift of each known parameter with each rejected effect of the last screen (scaled). Only significant effects count.
/// An effect shifts nothing if its joint fit is not significant, has the wrong sign, or is not confirmed by the
/// validation sessions. Nor does one that `is_replacement` of an added effect.
fn shifts(
    rejected: &[Rejected],
    is_replacement: impl Fn(&Candidate) -> bool,
    family_error: f64,
) -> Vec<&[f64]> {
    let tries: usize = rejected.iter().map(|own| own.candidate.tries).sum();
    let is_there = |own: &&Rejected| {
        own.candidate.p_value * (tries as f64) < family_error
            && !is_replacement(&own.candidate)
            && !matches!(
                own.reason,
                Reason::NotSignificant
                    | Reason::OnBound(_)
                    | Reason::HeldOut
                    | Reason::Contradicted
            )
    };
    rejected.iter().filter(is_there).map(|own| own.candidate.shift.as_slice()).collect()
}

/// Return whether a candidate would replace an added effect, not act in addition. It is indistinguishable from that
/// effect, or another wave of it at the same location, which nearly cancels the added one.
fn replaces_added(candidate: &Candidate, added: &[Added]) -> bool {
    added.iter().any(|step| {
        step.indistinguishable.contains(&candidate.effect.name)
            || step.effect.name == candidate.effect.name && step.axis == candidate.axis
    })
}

/// Whitened residuals of the validation sessions under two twins, each with its own nuisances.
fn validation_rows(
    held_out: &Problem<'_>,
    twins: (&Twin, &Twin),
    filters: &Filters,
) -> [Vec<f64>; 2] {
    [twins.0, twins.1].map(|twin| fit::residual_on(held_out, twin, filters))
}

/// Return whether the validation sessions prefer the second twin beyond chance. It must also remove at least the
/// fraction `required_gain` of the squared error. Without validation sessions the second twin is accepted.
fn is_better(
    held_out: &Problem<'_>,
    twins: (&Twin, &Twin),
    filters: &Filters,
    required_gain: f64,
) -> bool {
    let [before, after] = validation_rows(held_out, twins, filters);
    held_out.parts.is_empty()
        || held_out.thresholds().is_in(&before, &after, &held_out.blocks())
            && required_gain < 1.0 - fit::squared(&after) / fit::squared(&before)
}

/// State of a search.
struct Search<'a> {
    kind: StageKind,
    may_be_disturbed: bool,
    train: Problem<'a>,
    held_out: Problem<'a>,
    witness: Problem<'a>,
    predecessor: Problem<'a>,
    best: Fit,
    filters: Filters,
    added: Vec<Added>,
    /// Twin before the first effect was added, everything fitted.
    before_added: Option<Twin>,
    rejected: Vec<Rejected>,
    /// Model errors that removed effects explain.
    removed: Vec<Discrepancy>,
    journal: Vec<JournalEntry>,
    /// One-off disturbances that are in the journal.
    masked: Vec<incident::Incident>,
}

/// State in which a search begins.
struct Opening {
    /// Given twin, nuisances fitted.
    given: Point,
    /// One over the RMS of each signal's residual at the given twin.
    scales: Filters,
    /// Residual of the recordings above the reference residual of the given twin.
    excess: Option<Excess>,
    /// Parameters that may be fitted.
    slots: Vec<Slot>,
}

impl<'a> Search<'a> {
    /// Fit the given twin to `data` and refit its parameters; outliers and one-off disturbances are excluded.
    fn opened(data: &StageData<'a>, start: &Twin) -> (Self, Opening) {
        let context = data.context;
        context.observer.step_begun(SearchStep::Fit, 0);
        let mut train = Problem::new(&data.train, start).within(context);
        let mut held_out = Problem::new(&data.held_out, start).within(context);
        let given = train.start(start.clone());
        let scales = train.filters(&given, whiten::scale_filters);
        let given = fit::adapt(&train, given, &scales);
        let held_given = fit::on(&held_out, start, &scales);
        exclude_outliers(data.kind, (&mut train, &given), (&mut held_out, &held_given));
        let excess = excess(start, [(&train, &given), (&held_out, &held_given)]);
        let mut slots = start.free(data.train[0]);
        slots.retain(|slot| !data.held.contains(&Held::of(start, *slot)));
        let is_new = !context.options.thresholds().is_at_reference(excess);
        let count = slots.len();
        let (best, filters) = match is_new {
            true => {
                refit_in_agreement(data, start, (&mut train, &mut held_out), (&given, &mut slots))
            }
            false => fit::converge(&train, given.clone(), &slots, 10),
        };
        log::info!(
            "{:?}: {} parameters refitted on {} training sessions, {} validation sessions",
            data.kind,
            slots.len(),
            data.train.len(),
            data.held_out.len()
        );
        let mut search = Self {
            kind: data.kind,
            may_be_disturbed: data.may_be_disturbed,
            train,
            held_out,
            witness: Problem::new(&data.witnesses, start).within(context),
            predecessor: Problem::new(&data.predecessors, start).within(context),
            best,
            filters,
            added: vec![],
            before_added: None,
            rejected: vec![],
            removed: vec![],
            journal: vec![],
            masked: vec![],
        };
        let reference =
            if is_new { "is above its reference, or has none" } else { "is at its reference" };
        search.align_sessions();
        search.note_refit(&given, slots.len(), reference);
        if slots.len() < count {
            search.note(
                MoveKind::Keep,
                "With all parameters refitted, the twin predicts the camera worse than the given twin: parameters that act \
                 there, too, keep their given values",
            );
        }
        search.note_masked();
        (search, Opening { given, scales, excess, slots })
    }
}

impl Search<'_> {
    /// Add effects until no candidate passes; return the dependence that is then unexplained. `excess` is that of the
    /// given twin.
    fn add_effects(&mut self, given: &Point, mut excess: Option<Excess>) -> Option<Unknown> {
        let mut validated = None;
        let thresholds = self.train.thresholds();
        let mut may_restart = !thresholds.is_at_reference(excess) && !self.is_confirmed(given);
        let mut has_split = false;
        let mut previous = Vec::new();
        while self.added.len() < MOST_ADDED {
            let first = self.added.is_empty() && !has_split && !thresholds.is_at_reference(excess);
            let as_given = first.then(|| self.as_given(given));
            let plausible = self.plausible(given);
            let round_start = RoundStart {
                base: &self.best,
                filters: &self.filters,
                plausible: plausible.as_ref(),
                given: as_given.as_ref(),
                given_instances: given.twin.instances.len(),
                before_added: self.before_added.as_ref(),
                previous: &previous,
                required_gain: self.required_gain((given, excess), &self.best),
            };
            let round = Round::run(self.problems(), &round_start);
            self.rejected = round.rejected;
            previous = round.tried;
            // A refit in a wrong local minimum hides effects that the given twin shows.
            let has_no_candidate = round.winner.is_none() && self.added.is_empty();
            if has_no_candidate && std::mem::take(&mut may_restart) {
                self.discard_refit(given);
                continue;
            }
            // An effect on one motor may be a parameter that both motors no longer share.
            let is_open = round
                .winner
                .as_ref()
                .is_none_or(|(_, step)| self.added.is_empty() && !screen::is_shared(step.axis));
            let may_split =
                !has_split && excess.is_some() && !thresholds.is_at_reference(excess) && is_open;
            let rival = round.winner.as_ref().map(|(fit, _)| fit);
            if may_split && self.split_known(excess, rival) {
                (has_split, may_restart) = (true, false);
                excess = self.excess(validated.insert(self.validated()));
                continue;
            }
            let Some(winner) = round.winner else { break };
            self.note_added(&winner.1);
            excess = self.add_winner(winner, given, &mut validated);
            // What is at its reference hides nothing.
            if thresholds.is_at_reference(excess) {
                previous.clear();
            }
        }
        self.note_end_of_rounds(MOST_ADDED);
        if self.revise(given, excess) {
            excess = self.excess(validated.insert(self.validated()));
        }
        let validated = validated.unwrap_or_else(|| self.validated());
        let has_noise_changed = self.add_noise_effects(&given.twin, &validated, excess);
        if thresholds.is_at_reference(excess) {
            return None;
        }
        let disturbance = match has_noise_changed {
            true => None,
            false => self.disturbance(given, &validated),
        };
        self.unexplained(&validated, disturbance)
    }

    /// Remove or exchange added effects that others replace; return whether anything changed.
    fn revise(&mut self, given: &Point, excess: Option<Excess>) -> bool {
        let is_less = self.eliminate_unneeded((&given.twin, excess));
        let is_other = self.exchange(given, excess);
        // An effect may have compensated for what was wrong in the one that was exchanged.
        if is_other {
            self.eliminate_unneeded((&given.twin, excess));
        }
        let is_fewer = self.eliminate_null();
        let is_minor = self.remove_minor(&given.twin);
        self.remove_with_known_on_bound() || is_minor || is_fewer || is_other || is_less
    }

    /// Gain that the first effect must have in addition to `base`, if the given twin has this `excess`.
    fn required_gain<'s>(
        &'s self,
        (given, excess): (&'s Point, Option<Excess>),
        base: &Fit,
    ) -> RequiredGain<'s> {
        let thresholds = self.train.thresholds();
        let fitted = self.excess_of(base, &self.validated_of(base));
        let stage = (&given.twin, self.kind);
        RequiredGain::new(thresholds, stage, (excess, fitted), self.at_floor(&given.twin, base))
    }

    /// Replace the refit by the given twin.
    fn discard_refit(&mut self, given: &Point) {
        let slots = std::mem::take(&mut self.best.slots);
        (self.best, self.filters) = with_nuisances_only(&self.train, given, &slots);
        self.note(
            MoveKind::Keep,
            "No candidate passed after the refit, and the refit predicts the validation sessions worse than the \
             given twin: the search starts again from the given parameters",
        );
    }

    /// Add the winner of a round, with one parameter set per motor or axis where they differ, and fit everything.
    /// Return the excess that is left, and put the twin on the validation sessions into `validated`.
    fn add_winner(
        &mut self,
        (fit, step): (Fit, Added),
        given: &Point,
        validated: &mut Option<Point>,
    ) -> Option<Excess> {
        let at = values_of_last(&fit.point.twin);
        log::info!("{:?}: {} on {} is added at {at:?}", self.kind, step.effect.name, step.axis);
        let before = self.added.len();
        self.before_added.get_or_insert_with(|| self.best.point.twin.clone());
        self.added.push(step);
        let converged = fit::converge(&self.train, fit.point, &fit.slots, 8);
        (self.best, self.filters) = multistart(&self.train, converged, given);
        self.align_sessions();
        self.exclude_disturbances();
        let mut excess = self.excess(validated.insert(self.validated()));
        if !self.train.thresholds().is_at_reference(excess)
            && let Some(split_fit) = self.split_added(excess)
        {
            excess = self.excess(validated.insert(split_fit));
        }
        let plain = estimates(&fit::ordinary_least_squares(&self.train, &self.best));
        self.added[before..].iter_mut().for_each(|step| step.estimates.clone_from(&plain));
        excess
    }

    /// Exclude one-off disturbances that the added effect reveals, and refit.
    fn exclude_disturbances(&mut self) {
        let validated = self.validated();
        let train = (&mut self.train, &self.best.point);
        if incident::exclude_from(self.kind, train, (&mut self.held_out, &validated)) {
            let (point, slots) = (self.best.point.clone(), self.best.slots.clone());
            (self.best, self.filters) = fit::converge(&self.train, point, &slots, 8);
            self.note_masked();
        }
    }

    /// Strongest dependence of the final residual on a regressor, or the `disturbance` where that is larger. Added
    /// effects that remove less than it are eliminated.
    fn unexplained(&mut self, validated: &Point, disturbance: Option<Unknown>) -> Option<Unknown> {
        let (train, held_out) = (&self.train, &self.held_out);
        let strongest = unknown::strongest(train, held_out, &self.best, validated, &self.filters);
        let larger =
            strongest.filter(|own| self.is_above_noise(own)).into_iter().chain(disturbance);
        let on_speed = || self.speed_dependence().filter(|own| self.is_above_noise(own));
        let unknown = larger.max_by(|a, b| a.fraction.total_cmp(&b.fraction)).or_else(on_speed)?;
        self.eliminate_smaller_than(&unknown);
        Some(unknown)
    }

    /// Dependence on speed that a rejected effect imitates: its magnitude grows with the speed.
    fn speed_dependence(&self) -> Option<Unknown> {
        let other = self.rejected.iter().find(|own| own.reason == Reason::SpeedsDisagree)?;
        let Candidate { effect, axis, statistic, p_value, .. } = &other.candidate;
        let channels = self.train.parts.first()?.stage.channels();
        Some(Unknown {
            name: format!(
                "unknown.speed[as {}{} but in proportion to it]",
                effect.name,
                axis.phrase()
            ),
            signal: channels.first()?.signal.clone(),
            fraction: other.validation_gain?,
            statistic: *statistic,
            p_value: (p_value * self.rejected.len() as f64).min(1.0),
            comparisons: self.rejected.len(),
        })
    }

    /// Return whether the refit predicts the validation sessions at least as well as the given twin.
    fn is_confirmed(&self, given: &Point) -> bool {
        let twins = (&given.twin, &self.best.point.twin);
        let [before, after] = validation_rows(&self.held_out, twins, &self.filters);
        fit::squared(&after) <= fit::squared(&before)
    }

    /// Add changes of the measurement noise and of the fraction of lost frames, compared with the given twin. Return
    /// whether the noise variance changed.
    fn add_noise_effects(
        &mut self,
        given: &Twin,
        validated: &Point,
        excess: Option<Excess>,
    ) -> bool {
        let problems = [&self.train, &self.held_out];
        let found = noise::find(problems, [&self.best.point, validated], given, excess);
        let changes_variance = found.iter().any(noise::DetectedChange::changes_variance);
        for named in found {
            let step = named.apply_to(&mut self.best.point.twin);
            step.iter().for_each(|step| self.note_added(step));
            self.added.extend(step);
        }
        changes_variance
    }

    /// Given twin without any refit, every signal scaled by its own residual.
    fn as_given(&self, given: &Point) -> (Fit, Filters) {
        let filters = self.train.filters(given, whiten::scale_filters);
        let loss = fit::squared(&self.train.whitened(given, &filters));
        let slots = self.best.slots.clone();
        (Fit { point: given.clone(), slots, loss, rows: self.train.rows() }, filters)
    }

    /// Residual above the reference residual.
    fn excess(&self, validated: &Point) -> Option<Excess> {
        self.excess_of(&self.best, validated)
    }

    /// The same of another `fit`.
    fn excess_of(&self, fit: &Fit, validated: &Point) -> Option<Excess> {
        excess(&fit.point.twin, [(&self.train, &fit.point), (&self.held_out, validated)])
    }

    /// Disturbance that depends on no measured quantity. The residual is above its reference in
    /// training and validation sessions, and exceeds the fraction `clear_gain` of the reduction
    /// that the fit achieved. The residual of a single axis is also above its noise floor. A drive
    /// with backlash is exempt: its impact times depend on noise, so no simulation reproduces them.
    fn disturbance(&self, given: &Point, validated: &Point) -> Option<Unknown> {
        let twin = &self.best.point.twin;
        let is_noise = || twin.machine == Machine::Axis && !self.is_above_floor(&given.twin);
        if !self.may_be_disturbed || twin.rattles_in(self.kind) || is_noise() {
            return None;
        }
        let before = excess(twin, [(&self.train, given)])?.most;
        let trained = excess(twin, [(&self.train, &self.best.point)])?.most;
        let held = excess(twin, [(&self.held_out, validated)])?.most;
        let thresholds = self.train.thresholds();
        (thresholds.large_excess < trained.min(held)
            && thresholds.clear_gain * (before - trained) < trained)
            .then(|| unknown::disturbance(&self.train, &self.best.point))
            .flatten()
    }

    fn problems(&self) -> Problems<'_, '_> {
        let Self { train, held_out, witness, predecessor, .. } = self;
        Problems { train, held_out, witness, predecessor }
    }

    /// Best twin on the validation sessions.
    fn validated(&self) -> Point {
        self.validated_of(&self.best)
    }

    /// Twin of `fit` on the validation sessions, in the metric of the best fit.
    fn validated_of(&self, fit: &Fit) -> Point {
        fit::on(&self.held_out, &fit.point.twin, &self.filters)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Axis, find};

    /// Candidate that would move the one known parameter by `shift`, with this tail probability.
    fn rejected(p_value: f64, reason: Reason, shift: f64) -> Rejected {
        let effect = find("drive.lag1").expect("it is in the catalogue");
        let candidate = Candidate {
            effect,
            axis: Axis::Motors,
            start: vec![1e-3],
            probe: vec![1e-3],
            explained_fraction: 0.1,
            statistic: 30.0,
            p_value,
            detectability: 10.0,
            is_as_good_as_refit: false,
            tries: 1,
            parameter_offsets: vec![1e-4],
            shift: vec![shift],
            other_starts: Vec::new(),
        };
        Rejected { candidate, reason, validation_gain: None, values: None }
    }

    #[test]
    fn insignificant_effects_shift_no_known_parameter() {
        let all = [
            rejected(1e-6, Reason::TooSmall, 1.0),
            rejected(1e-6, Reason::NotTestable, 2.0),
            rejected(1e-6, Reason::NotSignificant, 3.0),
            rejected(1e-6, Reason::OnBound("time_constant_s".into()), 4.0),
            rejected(1e-6, Reason::HeldOut, 5.0),
            rejected(1e-6, Reason::Contradicted, 6.0),
            rejected(0.5, Reason::TooSmall, 7.0),
        ];
        assert_eq!(shifts(&all, |_| false, 0.01), [[1.0], [2.0]]);
        // A replacement of an added effect shifts no parameter.
        assert!(shifts(&all, |own| own.effect.name == "drive.lag1", 0.01).is_empty());
    }
}
