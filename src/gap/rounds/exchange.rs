//! Exchange of an added effect for another one.

use super::{Added, Search};
use crate::{
    gap::{
        fit::{self, Fit},
        known::Excess,
        problem::Point,
        round::{Round, RoundStart},
        whiten::Filters,
    },
    twin::Machine,
};

/// Effect in place of another one, with the fit of everything.
struct Replacement {
    fit: Fit,
    filters: Filters,
    step: Added,
}

impl Search<'_> {
    /// Sequential replacement (Miller 2002, Subset Selection in Regression, section 3.5): each added effect that had a rival,
    /// but the last, is tried for exchange. Forward selection keeps an effect that stood in for others before they were
    /// added, and one with more parameters than are needed since. Return whether any was exchanged. On tables, exchanges took
    /// 57 % more processor time and changed no answer.
    pub(super) fn exchange(&mut self, given: &Point, excess: Option<Excess>) -> bool {
        if given.twin.machine == Machine::Table {
            return false;
        }
        let mut has_changed = false;
        // The last one was chosen with all others in place.
        let early = self.added.len().saturating_sub(1);
        let open = self.added.iter().take(early).filter(|step| step.has_rival).cloned();
        for step in open.collect::<Vec<_>>() {
            let Some(own) = self.replacement(&step, given, excess) else { continue };
            log::info!(
                "{:?}: {} on {} takes the place of {} on {}",
                self.kind,
                own.step.effect.name,
                own.step.axis,
                step.effect.name,
                step.axis
            );
            let reason = format!(
                "With the other effects in place, {} in its place leaves {}",
                own.step.effect.name,
                match is_simpler(&own.step, &step) {
                    true => "no larger residual beyond chance, with fewer parameters",
                    false => "a smaller residual beyond chance",
                }
            );
            self.remove_step(&step, (own.fit, own.filters), &reason);
            self.note_added(&own.step);
            self.added.push(own.step);
            has_changed = true;
        }
        has_changed
    }

    /// Effect that passes every check in place of `step`. In training and validation sessions it leaves a smaller residual
    /// beyond chance, or has fewer parameters and leaves no larger one beyond chance.
    fn replacement(
        &self,
        step: &Added,
        given: &Point,
        excess: Option<Excess>,
    ) -> Option<Replacement> {
        let (base, filters) = self.without(step);
        let round_start = RoundStart {
            base: &base,
            filters: &filters,
            plausible: None,
            given: None,
            given_instances: given.twin.instances.len(),
            before_added: self.before_added.as_ref(),
            previous: &[],
            required_gain: self.required_gain((given, excess), &base),
        };
        let (fit, winner) = Round::run(self.problems(), &round_start).winner?;
        if winner.effect == step.effect && winner.axis == step.axis {
            return None;
        }
        let (fit, filters) = fit::converge(&self.train, fit.point, &fit.slots, 8);
        let (with, replaced) = (self.rows(&self.best), self.rows(&fit));
        let is_better = match is_simpler(&winner, step) {
            true => !self.is_better_beyond_chance(&replaced, &with),
            false => self.is_better_beyond_chance(&with, &replaced),
        };
        is_better.then_some(Replacement { fit, filters, step: winner })
    }
}

/// Return whether the effect of `own` has fewer parameters than that of `other`.
fn is_simpler(own: &Added, other: &Added) -> bool {
    own.effect.parameters.len() < other.effect.parameters.len()
}
