//! Effects that turn out not to be needed, taken back.

use super::{Added, Search, is_in};
use crate::{
    effects::Effect,
    gap::{
        fit::{self, Fit},
        known::Worth,
        problem::Point,
        unknown::Unknown,
        whiten::Filters,
    },
    parallel::in_parallel,
    stats::t_quantile,
    twin::{Slot, Twin},
};

/// Effects that the data miss least, of which each is fitted away in earnest.
const NEXT_TO_GO: usize = 2;

impl Search<'_> {
    /// Takes back, one after the other, the effect that the data miss least when everything else is fitted without
    /// it, where that is not beyond chance or less than the share `least` of the held-out squared error: what was
    /// added early may have stood for what came later, and a fit may have found its way only beside another
    /// (backward elimination). At least `kept` stay: the only one was put to the data when it was added, but not since
    /// a known effect was parted. Gives whether any was.
    pub(super) fn take_back_what_is_not_missed(&mut self, worth: &Worth<'_>, kept: usize) -> bool {
        let before = self.added.len();
        while kept < self.added.len()
            && let Some((step, fit, filters)) = self.least_missed(worth)
        {
            log::info!("{:?}: {} on {} is not missed", self.kind, step.effect.name, step.axis);
            self.go_back(&step, (fit, filters));
        }
        self.added.len() < before
    }

    /// The step that the data miss least, if they do not miss it, with the fit without it.
    fn least_missed(&self, worth: &Worth<'_>) -> Option<(Added, Fit, Filters)> {
        let rows = |point: &Point, judged: &Point| {
            let train = self.train.whitened(point, &self.filters);
            (train, self.held_out.whitened(judged, &self.filters))
        };
        let (train, held) = rows(&self.best.point, &self.judged());
        let hardly_missed = self.hardly_missed();
        let trials = in_parallel(&hardly_missed, |step| {
            let (fit, filters) = self.without(step);
            let (train_without, held_without) = rows(&fit.point, &self.judged_of(&fit));
            let share = |without: &[f64], with: &[f64]| {
                1.0 - fit::squared(with) / fit::squared(without).max(f64::MIN_POSITIVE)
            };
            let is_missed = is_in(&train_without, &train, &self.train.blocks())
                && (held.is_empty()
                    || is_in(&held_without, &held, &self.held_out.blocks())
                        && worth.least(step.effect) <= share(&held_without, &held));
            (share(&train_without, &train), is_missed, fit, filters)
        });
        let found = hardly_missed.iter().zip(trials).filter(|(_, (_, is_missed, ..))| !is_missed);
        found
            .min_by(|a, b| a.1.0.total_cmp(&b.1.0))
            .map(|(step, (_, _, fit, filters))| ((*step).clone(), fit, filters))
    }

    /// The [`NEXT_TO_GO`] steps that the data miss least when the columns of the rest, as they are now, lead
    /// the fit without each.
    fn hardly_missed(&self) -> Vec<&Added> {
        let mut steps: Vec<&Added> = self.added.iter().collect();
        if NEXT_TO_GO < steps.len() {
            let at = self.train.evaluated(self.best.point.clone());
            let columns = self.train.columns(&at, &self.best.slots, &self.filters);
            let losses = in_parallel(&steps, |step| self.roughly_without(step, &columns).loss);
            let mut order: Vec<usize> = (0..steps.len()).collect();
            order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
            steps = order.into_iter().take(NEXT_TO_GO).map(|index| &self.added[index]).collect();
        }
        steps
    }

    /// Everything fitted without the effect of `step`, led by the `columns` of all.
    fn roughly_without(&self, step: &Added, columns: &[Vec<f64>]) -> Fit {
        let mut rest = self.best.clone();
        let gone = instance_of(&rest.point.twin, step);
        let stays = |slot: &Slot| Some(slot.instance) != gone;
        let columns = self.best.slots.iter().zip(columns).filter(|(slot, _)| stays(slot));
        let known: Vec<Vec<f64>> = columns.map(|(_, column)| column.clone()).collect();
        take_out(&mut rest, step);
        let how = fit::How { filters: &self.filters, iterations: 3, known: &known };
        fit::fit_with(&self.train, rest.point, &rest.slots, &how)
    }

    /// Takes back effects whose every interval, now that everything is fitted together, holds the value at which
    /// there is no effect: what was added later explains what they did. Gives whether any was.
    pub(super) fn take_back_what_is_none(&mut self) -> bool {
        let before = self.added.len();
        while let Some(step) = self.nothing() {
            let rest = self.without(&step);
            self.go_back(&step, rest);
        }
        self.added.len() < before
    }

    /// The first step whose effect may as well be none.
    fn nothing(&self) -> Option<Added> {
        self.added.iter().find(|step| has_sizes_only(step.effect))?;
        let judged = self.judged();
        let found = (&self.best, &judged);
        let uncertainty = fit::uncertainty(&self.train, &self.held_out, found, &self.filters);
        let quantile = t_quantile(0.975, uncertainty.freedom);
        let twin = &self.best.point.twin;
        let is_none = |step: &&Added| {
            let errors = self.best.slots.iter().zip(&uncertainty.standard_errors);
            let mut own = errors
                .filter(|(slot, _)| Some(slot.instance) == instance_of(twin, step))
                .map(|(slot, error)| (twin.get(*slot) - step.effect.null[slot.parameter], error))
                .peekable();
            has_sizes_only(step.effect)
                && own.peek().is_some()
                && own.all(|(size, error)| size.abs() < quantile * error)
        };
        self.added.iter().find(is_none).cloned()
    }

    /// Everything fitted without the effect of `step`.
    fn without(&self, step: &Added) -> (Fit, Filters) {
        let mut rest = self.best.clone();
        take_out(&mut rest, step);
        fit::settle(&self.train, rest.point, &rest.slots, 5)
    }

    /// Takes `step` back; what is left has been fitted.
    fn go_back(&mut self, step: &Added, rest: (Fit, Filters)) {
        self.added.retain(|own| own.effect != step.effect || own.axis != step.axis);
        (self.best, self.filters) = rest;
    }
}

/// Takes back what removed less than what stays unexplained: an effect outside the catalogue is imitated in
/// part by several inside it. Gives whether anything was taken back.
pub(super) fn withdraw(best: &mut Fit, added: &mut Vec<Added>, unknown: &Unknown) -> bool {
    let before = added.len();
    added.retain(|step| {
        // Both as shares of what was left when the step was done.
        let stays = unknown.share < step.held_out_gain / (1.0 - step.held_out_gain).max(1e-12);
        if !stays {
            log::info!(
                "{} removed {:.1} %, {} stays with {:.1} %: withdrawn",
                step.effect.name,
                100.0 * step.held_out_gain,
                unknown.name,
                100.0 * unknown.share
            );
            take_out(best, step);
        }
        stays
    });
    added.len() < before
}

/// Where in the twin the effect of a step is.
fn instance_of(twin: &Twin, step: &Added) -> Option<usize> {
    twin.instances.iter().position(|own| own.effect == step.effect && own.axis == step.axis)
}

/// Takes the effect of a step out of the twin; the rest stays as it is.
fn take_out(best: &mut Fit, step: &Added) {
    let Some(index) = instance_of(&best.point.twin, step) else { return };
    best.point.twin.instances.remove(index);
    best.slots.retain(|slot| slot.instance != index);
    let later = best.slots.iter_mut().filter(|slot| index < slot.instance);
    later.for_each(|slot| slot.instance -= 1);
}

/// Whether each number of `effect` says how large it is, and none only what it looks like.
fn has_sizes_only(effect: &Effect) -> bool {
    effect.null.len() == 1 || effect.null.iter().all(|null| *null == 0.0)
}
