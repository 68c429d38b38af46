//! Reasons to reject a trial.

use super::{
    IDLE,
    bench::Bench,
    newly_on_bound, slots_of_last,
    trial::{Trial, on_bound, size_of_last, squared_distance, wrong_sign},
};
use crate::{
    gap::{
        evidence::Amplitude,
        fit,
        known::lag,
        problem::{Point, Problem},
        rounds::Reason,
        speed_dependence::{self, SessionResiduals},
    },
    twin::{Slot, Twin},
};

/// Iterations of a fit of an effect without some of its parameters.
const PARTS_ITERATIONS: usize = 12;

impl Bench<'_, '_> {
    /// Return whether the effect is hardly needed without its shape parameters: with its magnitude at zero, the other
    /// parameters explain most of the same. The sessions then show another effect.
    fn is_as_good_without_size(&self, trial: &Trial) -> bool {
        let size = slots_of_last(&trial.fit.point.twin).into_iter().next();
        match size.filter(|_| trial.candidate.effect.has_shape_parameters()) {
            Some(size) => !self.carry_most(trial, &[size]),
            None => false,
        }
    }

    /// Return whether an optional parameter of the effect carries most of its gain, such as the friction of a striker
    /// on a soft magnet. The sessions then show another effect.
    fn is_carried_by_optional_parameter(&self, trial: &Trial) -> bool {
        let (twin, effect) = (&trial.fit.point.twin, trial.candidate.effect);
        let is_used = |slot: &Slot| effect.is_optional(slot.parameter) && twin.get(*slot) != 0.0;
        let optional: Vec<Slot> = slots_of_last(twin).into_iter().filter(is_used).collect();
        !optional.is_empty() && self.carry_most(trial, &optional)
    }

    /// Return whether `parts` of the effect of `trial` change the prediction more than the rest of it, all else as fitted,
    /// and the data need them beyond chance. The gain that a refit leaves does not decide: a spring that is far softer,
    /// with much damping, follows a course as late as a striker with friction.
    fn carry_most(&self, trial: &Trial, parts: &[Slot]) -> bool {
        let own = slots_of_last(&trial.fit.point.twin);
        let without = |gone: &[Slot]| {
            let mut point = trial.fit.point.clone();
            gone.iter().for_each(|slot| point.twin.set_to_null(*slot));
            point
        };
        let rest = without(parts);
        let rows = |point: &Point| self.train.whitened(point, self.filters);
        let (rest_rows, nothing_rows) = (rows(&rest), rows(&without(&own)));
        let by_rest = squared_distance(&rest_rows, &nothing_rows);
        if by_rest <= IDLE * squared_distance(&nothing_rows, &trial.train_rows) {
            return true;
        }
        if squared_distance(&rest_rows, &trial.train_rows) < by_rest {
            return false;
        }
        let slots = trial.fit.slots.iter().copied();
        let others: Vec<Slot> = slots.filter(|slot| !parts.contains(slot)).collect();
        let refitted = fit::fit(self.train, rest, &others, self.filters, PARTS_ITERATIONS).point;
        let needs = |problem: &Problem<'_>, without: &[f64], with: &[f64]| {
            self.thresholds().is_in(without, with, &problem.blocks())
        };
        let held_out = || fit::residual_on(self.held_out, &refitted.twin, self.filters);
        (self.held_out.parts.is_empty() || needs(self.held_out, &held_out(), &trial.held_rows))
            && needs(self.train, &rows(&refitted), &trial.train_rows)
    }

    /// Return whether the data prefer the effect multiplied by the speed to the effect as its physics states it. An effect
    /// on the command does not depend on the speed: a limit acts at the highest commands only.
    fn grows_with_speed(&self, trial: &Trial) -> bool {
        let is_on_command = trial.candidate.effect.is_on_command();
        if is_on_command || !speed_dependence::are_speeds_known(self.train) {
            return false;
        }
        let mut twin = trial.fit.point.twin.clone();
        for slot in slots_of_last(&trial.fit.point.twin) {
            twin.set_to_null(slot);
        }
        let [train, held] = [self.train, self.held_out]
            .map(|problem| fit::residual_on(problem, &twin, self.filters));
        speed_dependence::grows_with_speed([
            SessionResiduals { problem: self.train, without: &train, with: &trial.train_rows },
            SessionResiduals { problem: self.held_out, without: &held, with: &trial.held_rows },
        ])
    }

    /// Reason to reject the trial, if any.
    pub(super) fn objection(&self, trial: &Trial) -> Option<Reason> {
        let thresholds = self.thresholds();
        let known = || newly_on_bound(&self.base.point.twin, &trial.fit.point.twin, &self.known);
        let own = || on_bound(self.train, &trial.fit);
        if let Some(name) = own().or_else(|| wrong_sign(&trial.fit)).or_else(known) {
            return Some(Reason::OnBound(name));
        }
        if thresholds.family_error < self.p_value(trial) {
            return Some(Reason::NotSignificant);
        }
        if !thresholds.is_in(&self.base_train_rows, &trial.train_rows, &self.train.blocks()) {
            // Known parameters confound the effect in one of two ways, so the motion does not show it.
            return Some(match trial.candidate.is_as_good_as_refit {
                true => Reason::NotTestable,
                false => Reason::NotSignificant,
            });
        }
        if self.is_as_good_without_size(trial) || self.is_carried_by_optional_parameter(trial) {
            return Some(Reason::NotSignificant);
        }
        if self.held_out.parts.is_empty() {
            let required_gain =
                self.required_gain.of(trial.candidate.effect, &self.supported_values(trial));
            let gain = self.removes(self.train, &self.base_train_rows, &trial.train_rows);
            return (gain < required_gain).then_some(Reason::TooSmall);
        }
        let (before, blocks) = (&self.base_held_rows, self.held_out.blocks());
        let amplitude = Amplitude::of(before, &trial.held_rows, &blocks);
        if amplitude.is_above(0.0, thresholds.confirmation_level)
            && thresholds.size_ratio < amplitude.value
        {
            return Some(Reason::SessionsDisagree);
        }
        if !thresholds.is_in(before, &trial.held_rows, &blocks) {
            return Some(Reason::HeldOut);
        }
        if self.contradicts(trial) {
            return Some(Reason::Contradicted);
        }
        if self.grows_with_speed(trial) {
            return Some(Reason::SpeedsDisagree);
        }
        let is_old = size_of_last(&trial.fit.point.twin).is_some_and(|size| {
            self.required_gain.is_within_discrepancy(trial.candidate.effect, size)
        });
        // An effect that only aligns the stamps of input and motion is no claim, so it needs no
        // magnitude.
        let is_small = !aligns_stamps(&trial.fit.point.twin) && !self.exceeds_required_gain(trial);
        let (base, twin) = (&self.base_held.twin, &trial.fit.point.twin);
        let is_same_lag = self.required_gain.only_redistributes_lag(base, twin)
            && self.validation_gain(trial) < thresholds.majority;
        (is_old || is_small || is_same_lag).then_some(Reason::TooSmall)
    }

    /// Return whether the data prefer `trial` beyond chance to its twin with the parameter `slot` at its null value.
    pub(super) fn is_required(&self, trial: &Trial, slot: Slot) -> bool {
        self.is_preferred_to(trial, |twin| twin.set_to_null(slot))
    }

    /// Return whether the data prefer `trial` beyond chance to its twin after a `change`.
    pub(super) fn is_preferred_to(&self, trial: &Trial, change: impl Fn(&mut Twin)) -> bool {
        let own = squared_distance(&self.base_train_rows, &trial.train_rows);
        let mut point = trial.fit.point.clone();
        change(&mut point.twin);
        let without = self.train.whitened(&point, self.filters);
        self.thresholds().equal_prediction * own <= squared_distance(&without, &trial.train_rows)
            && self.thresholds().is_in(&without, &trial.train_rows, &self.train.blocks())
    }

    /// Parameter values of the effect; shape parameters without an influence beyond chance are at their null values.
    pub(super) fn supported_values(&self, trial: &Trial) -> Vec<f64> {
        let twin = &trial.fit.point.twin;
        let effect = trial.candidate.effect;
        let shown = |slot: Slot| match slot.parameter {
            0 => twin.get(slot),
            _ if self.is_required(trial, slot) => twin.get(slot),
            shape => effect.null[shape],
        };
        slots_of_last(twin).into_iter().map(shown).collect()
    }
}

/// Return whether the last instance of `twin` is a lag below the sample period of its axis, and the
/// only lag of a twin without a reference. Recordings of a reference would show how their stamps
/// relate inputs to the motion.
pub(super) fn aligns_stamps(twin: &Twin) -> bool {
    let Some((last, others)) = twin.instances.split_last() else { return false };
    let period = twin.axis_frame.map(|frame| frame.scales.sample_period);
    twin.reference_residuals.is_empty()
        && !others.iter().any(|own| lag(own).is_some())
        && lag(last).zip(period).is_some_and(|(lag, period)| lag < period)
}
