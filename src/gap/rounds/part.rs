//! Effects that two motors, or two rails, have of different sizes: known ones that they had in common, and such as were
//! found on both.

use super::{Added, Search, take_back::instance_of};
use crate::{
    gap::{
        batch::in_parallel,
        evidence::LogScoreGain,
        fit::{self, Fit},
        known::Excess,
        problem::Point,
        whiten::Filters,
    },
    twin::Slot,
};

/// Everything fitted with one effect in two.
struct Parting {
    /// The instance.
    index: usize,
    /// Squared error of the fitted sessions.
    loss: f64,
    /// Share of the squared error of the training and of the validation sessions that it removes.
    shares: [f64; 2],
    log_score: Option<LogScoreGain>,
    fit: Fit,
    filters: Filters,
}

impl Search<'_> {
    /// Parts the known effect of which the data want it most, where they do beyond chance and by what makes an
    /// effect worth a name, and clearly better than what would be added instead, the `rival`: what wears, wears on one
    /// motor alone. Gives whether one was parted.
    pub(super) fn part_a_known(&mut self, excess: Option<Excess>, rival: Option<&Fit>) -> bool {
        let shared: Vec<usize> = (0..self.best.point.twin.instances.len())
            .filter(|index| self.is_shared_and_known(*index))
            .collect();
        let before = self.rows(&self.best);
        let trials = in_parallel(&shared, |index| self.wanted_parting(*index, &before, excess));
        let best = trials.into_iter().flatten().min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(Parting { index, loss, shares, fit, filters, .. }) = best else { return false };
        let left = |rival: &Fit| fit::squared(&self.train.whitened(&rival.point, &self.filters));
        let clearly_less = 1.0 - self.train.thresholds().clear_gain;
        if rival.is_some_and(|rival| clearly_less * left(rival) < loss) {
            return false;
        }
        let instance = &self.best.point.twin.instances[index];
        let (effect, axis) = (instance.effect, instance.axis);
        log::info!("{:?}: {} on {axis} is split", self.kind, effect.name);
        self.note_split((effect, axis), shares);
        (self.best, self.filters) = (fit, filters);
        true
    }

    /// Parts the effect that was added last, where the data want it so as they want a known one: two motors, or two
    /// rails, seldom have quite as much of it. It is then two steps, each with its part of the gap. Gives the twin on the
    /// judging sessions, if it was parted.
    pub(super) fn part_the_added(&mut self, excess: Option<Excess>) -> Option<Point> {
        let step = self.added.last()?.clone();
        let [one, other] = step.axis.parts()?;
        let index = instance_of(&self.best.point.twin, &step)?;
        let before = self.rows(&self.best);
        let parting = self.wanted_parting(index, &before, excess)?;
        let Parting { shares, log_score, fit, filters, .. } = parting;
        log::info!("{:?}: {} is split into {one} and {other}", self.kind, step.effect.name);
        self.note_split((step.effect, step.axis), shares);
        (self.best, self.filters) = (fit, filters);
        let judged = self.judged();
        let between = step.held_out_steps.1.clone();
        let second = Added {
            axis: other,
            data: format!("{}; test of the effect on {}", step.data, step.axis),
            log_score,
            validation_gain: shares[1],
            class: Vec::new(),
            held_out_steps: (between, self.held_out.rms(&judged)),
            contest: Vec::new(),
            ..step.clone()
        };
        let mut first = Added { axis: one, ..step.clone() };
        first.contest.iter_mut().filter(|own| step.is(own)).for_each(|own| own.axis = one);
        self.added.pop();
        self.added.extend([first, second]);
        Some(judged)
    }

    /// The fit with the instance parted, where the data want that beyond chance and by what makes an effect worth a
    /// name; `before` are the residuals of the best fit.
    fn wanted_parting(
        &self,
        index: usize,
        before: &[Vec<f64>; 2],
        excess: Option<Excess>,
    ) -> Option<Parting> {
        let (fit, filters) = self.parted(index)?;
        let after = self.rows(&fit);
        let shares = [0, 1].map(|k| 1.0 - fit::squared(&after[k]) / fit::squared(&before[k]));
        let thresholds = self.train.thresholds();
        let is_wanted = thresholds.is_in(&before[0], &after[0], &self.train.blocks())
            && thresholds.is_in(&before[1], &after[1], &self.held_out.blocks())
            && thresholds.least_gain(excess) <= shares[1];
        is_wanted.then(|| {
            let variance = fit::squared(&after[0]) / after[0].len().max(1) as f64;
            let blocks = self.held_out.blocks();
            let log_score = LogScoreGain::of(&before[1], &after[1], variance, &blocks);
            Parting { index, loss: fit::squared(&after[0]), shares, log_score, fit, filters }
        })
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
