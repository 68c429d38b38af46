//! Entries of the journal that the rounds of one stage write.

use super::{Added, RankedCandidate, Search};
use crate::{
    effects::{Axis, Effect},
    gap::{
        fit,
        incident::Incident,
        journal::{JournalEntry, MoveComparison, MoveKind},
        problem::{Point, Problem},
    },
};

/// Checks that an effect has passed when it is added.
const CHECKS: [&str; 6] = [
    "no parameter on a bound, no wrong sign",
    "p-value below the family-wise error after Bonferroni correction",
    "the training sessions follow the change beyond chance",
    "the validation sessions follow the change beyond chance, at a consistent magnitude",
    "magnitude consistent between low and high speeds",
    "validation gain above the model error of the simulation",
];

impl Search<'_> {
    /// Note a decision without comparison.
    pub(super) fn note(&mut self, kind: MoveKind, reason: &str) {
        self.journal.push(JournalEntry::new(kind, Some(self.kind), reason));
    }

    /// Note the first fit of all `count` known parameters from `given`.
    pub(super) fn note_refit(&mut self, given: &Point, count: usize, reference: &str) {
        let squares = |problem: &Problem<'_>, point: &Point| {
            fit::squared(&problem.whitened(point, &self.filters))
        };
        let held_given = fit::on(&self.held_out, &given.twin, &self.filters);
        let held_best = fit::on(&self.held_out, &self.best.point.twin, &self.filters);
        let gain = |before: f64, after: f64| (0.0 < before).then(|| 1.0 - after / before);
        let comparison = MoveComparison {
            training_gain: gain(squares(&self.train, given), self.best.loss),
            validation_gain: gain(
                squares(&self.held_out, &held_given),
                squares(&self.held_out, &held_best),
            ),
            ..MoveComparison::default()
        };
        let counted = |count: usize, what: &str| match count {
            1 => format!("1 {what}"),
            count => format!("{count} {what}s"),
        };
        let reason = format!(
            "{} fitted to {} and validated on {}; the residual of the given twin {}",
            counted(count, "known parameter"),
            counted(self.train.parts.len(), "training session"),
            counted(self.held_out.parts.len(), "validation session"),
            reference
        );
        self.journal
            .push(JournalEntry::new(MoveKind::Refit, Some(self.kind), reason).compared(comparison));
    }

    /// Note one-off disturbances that are excluded since the last call.
    pub(super) fn note_masked(&mut self) {
        let of = |problem: &Problem<'_>| -> Vec<Incident> {
            problem.parts.iter().flat_map(|part| part.incidents.clone()).collect()
        };
        let found = [of(&self.train), of(&self.held_out)];
        for (all, what) in found.into_iter().zip(["training", "validation"]) {
            for own in all {
                if self.masked.contains(&own) {
                    continue;
                }
                let reason = format!(
                    "A one-off disturbance of {} in a {what} session, {:.1} to {:.1} s, is excluded: it holds at least \
                     half of the squared residual and does not recur",
                    own.signal, own.span.start, own.span.end
                );
                self.journal.push(JournalEntry::new(MoveKind::Mask, Some(self.kind), reason));
                self.masked.push(own);
            }
        }
    }

    /// Note that `step` was added.
    pub(super) fn note_added(&mut self, step: &Added) {
        let comparison = MoveComparison {
            validation_gain: self.has_validation().then_some(step.validation_gain),
            p_value: Some(step.p_value),
            comparisons: Some(step.comparisons),
            runner_up: step.runner_up().map(|own: &RankedCandidate| own.effect.name.to_owned()),
            ..MoveComparison::default()
        };
        let reason = match step.indistinguishable.as_slice() {
            [] => format!("Best candidate that passed every check (p-value: {})", step.data),
            names => format!(
                "Best candidate that passed every check, not distinguishable from {} (p-value: {})",
                names.join(", "),
                step.data
            ),
        };
        let mut entry = JournalEntry::new(MoveKind::Add, Some(self.kind), reason)
            .about(step.effect, step.axis)
            .compared(comparison);
        if step.unstated.is_none() && self.has_validation() {
            entry = entry.passed(&CHECKS);
        }
        self.journal.push(entry);
    }

    /// Note that an effect got separate parameters on each motor or axis, with the fractions of the squared residual
    /// that this removes on training and validation sessions.
    pub(super) fn note_split(
        &mut self,
        (effect, axis): (&Effect, Axis),
        [training, validation]: [f64; 2],
    ) {
        let comparison = MoveComparison {
            training_gain: Some(training),
            validation_gain: Some(validation),
            ..MoveComparison::default()
        };
        let reason = "Training and validation sessions are predicted better beyond chance with one value per motor or \
                      axis";
        let entry = JournalEntry::new(MoveKind::Split, Some(self.kind), reason);
        self.journal.push(entry.about(effect, axis).compared(comparison));
    }

    /// Note that `step` was removed for `reason`.
    pub(super) fn note_removed(&mut self, step: &Added, reason: &str) {
        let entry = JournalEntry::new(MoveKind::Remove, Some(self.kind), reason);
        self.journal.push(entry.about(step.effect, step.axis));
    }

    /// Note why no further effect is added.
    pub(super) fn note_end_of_rounds(&mut self, most: usize) {
        let reason = if self.added.len() < most {
            format!(
                "No further candidate passed every check; {} were rejected",
                self.rejected.len()
            )
        } else {
            format!("The limit of {most} added effects per stage is reached")
        };
        self.note(MoveKind::Stop, &reason);
    }

    fn has_validation(&self) -> bool {
        !self.held_out.parts.is_empty()
    }
}
