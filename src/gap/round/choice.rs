//! Which of the trials that passed is added.

use super::{
    bench::Bench,
    slots_of_last,
    trial::{Trial, apart, is_alike},
};
use crate::{
    gap::{
        batch::in_parallel,
        evidence::{Amplitude, Blocks},
        fit::{self, Fit},
        problem::dot,
        rounds::{Added, Reason, Rejected},
    },
    twin::Slot,
};
use std::mem;

/// A trial and how many [free numbers](Bench::free_numbers) its effect has.
type Counted<'t> = (&'t Trial, usize);

impl Bench<'_, '_> {
    /// The one to add, with what explains the data as well; all others are rejected.
    pub(super) fn winner(
        &self,
        passed: &[&Trial],
        trials: &[Trial],
        rejected: &mut Vec<Rejected>,
    ) -> Option<(Fit, Added)> {
        let free = in_parallel(passed, |trial| self.free_numbers(trial));
        let counted: Vec<Counted<'_>> = passed.iter().copied().zip(free).collect();
        let (own, free) = self.strongest(self.simplest(&counted)?, &counted);
        let mut class = Vec::new();
        for (other, numbers) in counted.iter().filter(|(other, _)| !std::ptr::eq(*other, own)) {
            let name = other.candidate.effect.name;
            // A motor has one of a few periods, given by its poles: a period that a scan found makes its ripple no more
            // flexible than that of an effect whose period is known.
            let scanned = usize::from(other.candidate.effect.scanned_parameter().is_some());
            let is_as_good = *numbers <= free + scanned
                && self.is_rival(own, other)
                && self.is_rival(other, own);
            if name != own.candidate.effect.name && is_as_good {
                if !class.contains(&name) {
                    class.push(name);
                }
            } else {
                let winner = own.candidate.effect.name.to_owned();
                rejected.push(self.rejected(other, Reason::Outdone(winner)));
            }
        }
        Some((own.fit.clone(), self.added(own, class, trials)))
    }

    /// What passed, the clearest first, and what explains the data as well as the clearest and was only not worth a
    /// name: where two cannot be told apart, what is known of one of them is known of neither.
    pub(super) fn worth_naming<'t>(&self, trials: &'t [Trial]) -> Vec<&'t Trial> {
        let Some(best) = trials.iter().find(|trial| trial.objection.is_none()) else {
            return Vec::new();
        };
        let is_worth = |trial: &Trial| match &trial.objection {
            None => true,
            Some(Reason::TooSmall) => self.is_rival(best, trial) && self.is_rival(trial, best),
            Some(_) => false,
        };
        trials.iter().filter(|trial| is_worth(trial)).collect()
    }

    /// Of the best that passed and what is nearly as good, the one with the fewest numbers that are needed; of equals
    /// the one whose law has no others, and so says that they are none; of these the best.
    fn simplest<'t>(&self, passed: &[Counted<'t>]) -> Option<Counted<'t>> {
        let (best, free) = *passed.first()?;
        let stands = |(other, numbers): &Counted<'_>| {
            std::ptr::eq(*other, best)
                || self.is_rival(best, other)
                || *numbers < free && self.is_nearly_as_good(best, other)
        };
        let complexity = |(own, needed): &Counted<'_>| {
            let effect = own.candidate.effect;
            let all = 0..effect.parameters.len();
            (*needed, all.filter(|parameter| !effect.is_optional(*parameter)).count())
        };
        passed.iter().copied().filter(stands).min_by_key(complexity)
    }

    /// Number of parameters of the effect that the data require: the prediction changes beyond chance at their null
    /// value, or at twice their own. A frequency may happen to have the null value, and still counts. A spring that does
    /// not soften has no length at which it does. Optional parameters do not count.
    fn free_numbers(&self, trial: &Trial) -> usize {
        let twin = &trial.fit.point.twin;
        let effect = trial.candidate.effect;
        let matters = |slot: &Slot| {
            self.does_something(trial, *slot)
                || self.changes_something(trial, |other| other.set(*slot, 2.0 * twin.get(*slot)))
        };
        let own = slots_of_last(twin).into_iter();
        own.filter(|slot| !effect.is_optional(slot.parameter) && matters(slot)).count()
    }

    /// Whether `other` describes the same joint of the chain as `own`, may be confused with it, changes the prediction
    /// alike and removes nearly as much.
    fn is_nearly_as_good(&self, own: &Trial, other: &Trial) -> bool {
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let joint = |trial: &Trial| {
            trial.candidate.effect.physics.equations().first().map(mem::discriminant)
        };
        joint(own) == joint(other)
            && is_alike(own, other)
            && self.is_same(own, other)
            && (1.0 - self.thresholds().min_gain) * removes(own) <= removes(other)
    }

    /// The strongest goes first: of effects that explain different things it is not `best`, which the whitened
    /// residual shows most clearly, but one that closes far more of the gap.
    fn strongest<'t>(&self, best: Counted<'t>, passed: &[Counted<'t>]) -> Counted<'t> {
        let most = self.thresholds().stronger_ratio * self.closes(best.0);
        let far_stronger = passed.iter().map(|own| (self.closes(own.0), *own));
        far_stronger
            .filter(|(closes, _)| most < *closes)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(best, |(_, own)| own)
    }

    /// Share of the squared gap on the fitted sessions, every signal in units of its RMS, that the trial closes.
    fn closes(&self, trial: &Trial) -> f64 {
        1.0 - fit::squared(&self.train.whitened(&trial.fit.point, &self.scales))
            / self.train.rows().max(1) as f64
    }

    /// Whether `other` explains the same as `own` and all sessions as well.
    fn is_rival(&self, own: &Trial, other: &Trial) -> bool {
        if !self.is_same(own, other) {
            return false;
        }
        let thresholds = self.thresholds();
        let blocks = Blocks::joined(&[self.train.blocks(), self.held_out.blocks()]);
        let all = |trial: &Trial| [trial.train_rows.as_slice(), &trial.held_rows].concat();
        let (own, other) = (all(own), all(other));
        let base = [self.base_train_rows.as_slice(), &self.base_held_rows].concat();
        apart(&own, &other) < thresholds.equal_prediction * apart(&base, &own)
            || !Amplitude::of(&other, &own, &blocks)
                .is_above(thresholds.min_amplitude, thresholds.confirmation_level)
    }

    /// Whether the two change the prediction alike: what has most of its change for itself explains something else,
    /// however well.
    fn is_same(&self, own: &Trial, other: &Trial) -> bool {
        let change = |trial: &Trial| -> Vec<f64> {
            self.base_train_rows
                .iter()
                .zip(&trial.train_rows)
                .map(|(base, own)| base - own)
                .collect()
        };
        let (own, other) = (change(own), change(other));
        let shared = dot(&own, &other).max(0.0).powi(2);
        self.thresholds().majority * fit::squared(&own) * fit::squared(&other) <= shared
    }
}
