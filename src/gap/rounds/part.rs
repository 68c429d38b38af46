//! Known effects that two motors, or two rails, had in common and do not have in common any more.

use super::{Search, is_in};
use crate::{
    gap::{
        fit::{self, Fit},
        known::{Excess, least_worth},
        whiten::Filters,
    },
    parallel::in_parallel,
    twin::Slot,
};

/// Share of what a rival leaves that a parted effect may leave at most: it has more numbers, and needs no name.
const CLEARLY_LESS: f64 = 0.9;

impl Search<'_> {
    /// Parts the known effect of which the data want it most, where they do beyond chance and by what makes an
    /// effect worth a name, and clearly better than what would be added instead, the `rival`: what wears, wears on one
    /// motor alone. Gives whether one was parted.
    pub(super) fn part_a_known(&mut self, excess: Option<Excess>, rival: Option<&Fit>) -> bool {
        let train = self.train.whitened(&self.best.point, &self.filters);
        let held = self.held_out.whitened(&self.judged(), &self.filters);
        let shared: Vec<usize> = (0..self.best.point.twin.instances.len())
            .filter(|index| self.is_shared_and_known(*index))
            .collect();
        let trials = in_parallel(&shared, |index| {
            let (fit, filters) = self.parted(*index)?;
            let train_parted = self.train.whitened(&fit.point, &self.filters);
            let held_parted = self.held_out.whitened(&self.judged_of(&fit), &self.filters);
            let share = 1.0 - fit::squared(&held_parted) / fit::squared(&held);
            let is_wanted = is_in(&train, &train_parted, &self.train.blocks())
                && is_in(&held, &held_parted, &self.held_out.blocks())
                && least_worth(excess) <= share;
            is_wanted.then(|| (fit::squared(&train_parted), fit, filters))
        });
        let best = trials.into_iter().flatten().min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((loss, fit, filters)) = best else { return false };
        let left = |rival: &Fit| fit::squared(&self.train.whitened(&rival.point, &self.filters));
        if rival.is_some_and(|rival| CLEARLY_LESS * left(rival) < loss) {
            return false;
        }
        log::info!("{:?}: a known effect is parted", self.kind);
        (self.best, self.filters) = (fit, filters);
        true
    }

    /// Whether the instance was given on both motors, or both rails, and is fitted.
    fn is_shared_and_known(&self, index: usize) -> bool {
        let instance = &self.best.point.twin.instances[index];
        let is_added = self.added.iter().any(|step| step.effect == instance.effect);
        let is_fitted = self.best.slots.iter().any(|slot| slot.instance == index);
        is_fitted && !is_added && instance.axis.parts().is_some()
    }

    /// The best fit with the instance in two, each with numbers of its own.
    fn parted(&self, index: usize) -> Option<(Fit, Filters)> {
        let mut point = self.best.point.clone();
        let [one, other] = point.twin.instances[index].axis.parts()?;
        let mut second = point.twin.instances[index].clone();
        (point.twin.instances[index].axis, second.axis) = (one, other);
        let instance = point.twin.instances.len();
        point.twin.instances.push(second);
        let own = self.best.slots.iter().filter(|slot| slot.instance == index);
        let more = own.map(|slot| Slot { instance, ..*slot });
        let slots: Vec<Slot> = self.best.slots.iter().copied().chain(more).collect();
        Some(fit::settle(&self.train, point, &slots, 8))
    }
}
