//! Splits: a parameter shared by two motors or two axes becomes one per motor or axis. This applies to known effects
//! and to effects that were added on both.

use super::{Added, Search, elimination::instance_of};
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

/// Fit with one effect split.
struct SplitFit {
    /// Index of the instance.
    index: usize,
    /// Squared error of the training sessions.
    loss: f64,
    /// Fraction of the squared error of the training and of the validation sessions that the split removes.
    gains: [f64; 2],
    log_score: Option<LogScoreGain>,
    fit: Fit,
    filters: Filters,
}

impl Search<'_> {
    /// Split the known effect whose split fits best; return whether one was split. The data must prefer the split
    /// beyond chance and by the required gain. It must also fit clearly better than the `rival`, the effect that would
    /// be added instead. Physical reason: wear occurs on one motor alone.
    pub(super) fn split_known(&mut self, excess: Option<Excess>, rival: Option<&Fit>) -> bool {
        let shared: Vec<usize> = (0..self.best.point.twin.instances.len())
            .filter(|index| self.is_shared_and_known(*index))
            .collect();
        let before = self.rows(&self.best);
        let trials = in_parallel(&shared, |index| self.wanted_split(*index, &before, excess));
        let best = trials.into_iter().flatten().min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(SplitFit { index, loss, gains, fit, filters, .. }) = best else { return false };
        let left = |rival: &Fit| fit::squared(&self.train.whitened(&rival.point, &self.filters));
        let clearly_less = 1.0 - self.train.thresholds().clear_gain;
        if rival.is_some_and(|rival| clearly_less * left(rival) < loss) {
            return false;
        }
        let instance = &self.best.point.twin.instances[index];
        let (effect, axis) = (instance.effect, instance.axis);
        log::info!("{:?}: {} on {axis} is split", self.kind, effect.name);
        self.note_split((effect, axis), gains);
        (self.best, self.filters) = (fit, filters);
        true
    }

    /// Split the effect that was added last, under the same conditions as a known one: two motors or axes seldom have
    /// equal magnitudes. The result is two steps, each with its own gain. Return the twin on the validation sessions
    /// after a split.
    pub(super) fn split_added(&mut self, excess: Option<Excess>) -> Option<Point> {
        let step = self.added.last()?.clone();
        let [one, other] = step.axis.parts()?;
        let index = instance_of(&self.best.point.twin, &step)?;
        let before = self.rows(&self.best);
        let split_fit = self.wanted_split(index, &before, excess)?;
        let SplitFit { gains, log_score, fit, filters, .. } = split_fit;
        log::info!("{:?}: {} is split into {one} and {other}", self.kind, step.effect.name);
        self.note_split((step.effect, step.axis), gains);
        (self.best, self.filters) = (fit, filters);
        let validated = self.validated();
        let between = step.held_out_steps.1.clone();
        let second = Added {
            axis: other,
            data: format!("{}; test of the effect on {}", step.data, step.axis),
            log_score,
            validation_gain: gains[1],
            indistinguishable: Vec::new(),
            held_out_steps: (between, self.held_out.rms(&validated)),
            ranking: Vec::new(),
            ..step.clone()
        };
        let mut first = Added { axis: one, ..step.clone() };
        first.ranking.iter_mut().filter(|own| step.is(own)).for_each(|own| own.axis = one);
        self.added.pop();
        self.added.extend([first, second]);
        Some(validated)
    }

    /// Fit with the instance split, where the data prefer it beyond chance and by the required gain; `before` are the
    /// residuals of the best fit.
    fn wanted_split(
        &self,
        index: usize,
        before: &[Vec<f64>; 2],
        excess: Option<Excess>,
    ) -> Option<SplitFit> {
        let (fit, filters) = self.split_fit(index)?;
        let after = self.rows(&fit);
        let gains = [0, 1].map(|k| 1.0 - fit::squared(&after[k]) / fit::squared(&before[k]));
        let thresholds = self.train.thresholds();
        let is_wanted = thresholds.is_in(&before[0], &after[0], &self.train.blocks())
            && thresholds.is_in(&before[1], &after[1], &self.held_out.blocks())
            && thresholds.least_gain(excess) <= gains[1];
        is_wanted.then(|| {
            let variance = fit::squared(&after[0]) / after[0].len().max(1) as f64;
            let blocks = self.held_out.blocks();
            let log_score = LogScoreGain::of(&before[1], &after[1], variance, &blocks);
            SplitFit { index, loss: fit::squared(&after[0]), gains, log_score, fit, filters }
        })
    }

    /// Return whether the instance was given on both motors or axes, and is fitted.
    fn is_shared_and_known(&self, index: usize) -> bool {
        let instance = &self.best.point.twin.instances[index];
        let is_added = self.added.iter().any(|step| step.effect == instance.effect);
        let is_fitted = self.best.slots.iter().any(|slot| slot.instance == index);
        is_fitted && !is_added && instance.axis.parts().is_some()
    }

    /// Best fit with the instance split, each half with its own parameters.
    fn split_fit(&self, index: usize) -> Option<(Fit, Filters)> {
        let mut point = self.best.point.clone();
        let [one, other] = point.twin.instances[index].axis.parts()?;
        let mut second = point.twin.instances[index].clone();
        (point.twin.instances[index].axis, second.axis) = (one, other);
        let instance = point.twin.instances.len();
        point.twin.instances.push(second);
        let own = self.best.slots.iter().filter(|slot| slot.instance == index);
        let more = own.map(|slot| Slot { instance, ..*slot });
        let slots: Vec<Slot> = self.best.slots.iter().copied().chain(more).collect();
        Some(fit::converge(&self.train, point, &slots, 8))
    }
}
