//! The rounds of the search on one link: refit, screen, re-simulate the best, decide, add, repeat.

use super::{
    fit::{self, Fit, Uncertainty},
    incident,
    journal::{JournalEntry, MoveKind},
    known::{Excess, Worth, excess},
    numbers::numbers,
    observer::SearchStep,
    problem::{Point, Problem},
    round::{Problems, Round, Stand, numbers_of_last},
    scatter,
    screen::{self, Candidate},
    unknown::{self, Unknown},
    whiten::{self, Filters},
};
use crate::twin::{Instance, Slot, StageKind, Twin};

mod note;
mod outcome;
mod part;
mod refit;
mod take_back;

use refit::{as_it_is, from_deepest, leave_out, refit_in_agreement};

pub use outcome::{Added, Held, Link, Outcome, Reason, Rejected, Task};
pub(super) use outcome::{Contestant, Unstated};
pub(in crate::gap) use take_back::{instance_of, known_on_bound};

/// Most effects that are added to one link.
const MOST_ADDED: usize = 6;

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
    let (judged, uncertainty) = known.unwrap_or_else(|| {
        uncertainty_of((&train, &held_out), &best, &filters, (&rejected, &added))
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
    (rejected, added): (&[Rejected], &[Added]),
) -> (Point, Uncertainty) {
    let shifts = shifts(rejected, &alternatives(added), train.thresholds().family_error);
    let judged = fit::on(held_out, &best.point.twin, filters);
    let uncertainty = fit::uncertainty(train, held_out, (best, &judged), filters)
        .whatever_the_metric(train, best)
        .whatever_is_beside(best, &shifts);
    (judged, uncertainty)
}

/// How far each known parameter would move with each effect that was screened last, is in the data beyond chance and
/// was not added all the same (scaled). What was fitted and is not in them, with the wrong sign, or not on judging
/// sessions, moves none; nor does an effect of the `alternatives`.
fn shifts<'r>(
    rejected: &'r [Rejected],
    alternatives: &[&str],
    family_error: f64,
) -> Vec<&'r [f64]> {
    let tries: usize = rejected.iter().map(|own| own.candidate.tries).sum();
    let is_there = |own: &&Rejected| {
        own.candidate.p_value * (tries as f64) < family_error
            && !alternatives.contains(&own.candidate.effect.name)
            && !matches!(own.reason, Reason::NotSignificant | Reason::OnBound(_) | Reason::HeldOut)
    };
    rejected.iter().filter(is_there).map(|own| own.candidate.shift.as_slice()).collect()
}

/// Effects that cannot be distinguished from one that was added: they would act instead of it, not in addition.
fn alternatives(added: &[Added]) -> Vec<&'static str> {
    added.iter().flat_map(|step| step.class.iter().copied()).collect()
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
        let count = slots.len();
        let (best, filters) = match is_new {
            true => {
                refit_in_agreement(link, start, (&mut train, &mut held_out), (&given, &mut slots))
            }
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
    /// Adds effects until nothing passes; gives what is then still unexplained.
    fn close(&mut self, given: &Point, mut excess: Option<Excess>) -> Option<Unknown> {
        let mut judged = None;
        let thresholds = self.train.thresholds();
        let mut starts_again = !thresholds.is_at_reference(excess) && !self.is_followed(given);
        let mut has_parted = false;
        while self.added.len() < MOST_ADDED {
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
        self.note_end_of_rounds(MOST_ADDED);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Axis, find};

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
        assert_eq!(shifts(&all, &[], 0.01), [[1.0], [2.0]]);
        assert_eq!(shifts(&all, &["drive.delay"], 0.01), [[1.0], [2.0]]);
        // An effect that would act instead of an added one moves no parameter.
        assert!(shifts(&all, &["drive.lag1"], 0.01).is_empty());
    }
}
