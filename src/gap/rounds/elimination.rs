//! Backward elimination of effects.

use super::{Added, Search, uncertainty_of};
use crate::{
    effects::{Effect, Physics},
    gap::{
        batch::in_parallel,
        fit::{self, Fit, Uncertainty},
        floor::floors,
        known::{AtFloor, Excess, RequiredGain},
        problem::{Point, Problem},
        round::on_bound_of,
        unknown::Unknown,
        whiten::Filters,
    },
    stats::t_quantile,
    twin::{Discrepancy, Instance, Machine, Slot, Twin},
};

/// Elimination candidates that are fitted to convergence. A larger number costs one fit each per step.
const MOST_REFITTED: usize = 2;

/// Most iterations of a fit without an effect. The others may have compensated for it, far from where they belong.
const WITHOUT_ITERATIONS: usize = 20;

impl Search<'_> {
    /// Backward elimination: remove the least needed effect, refit, repeat; return whether any was removed. An effect
    /// is needed if the residual without it, all other parameters refitted, grows beyond chance and by the required
    /// gain, and if its p-value is below its [`share`] of the family-wise error. An early effect may have compensated for
    /// a later one, or a fit may have needed another effect to converge.
    pub(super) fn eliminate_unneeded(&mut self, given: (&Twin, Option<Excess>)) -> bool {
        let before = self.added.len();
        while !self.added.is_empty()
            && let Some((step, fit, filters)) = self.least_needed(given)
        {
            log::info!("{:?}: {} on {} is removed", self.kind, step.effect.name, step.axis);
            let reason = "Backward elimination: without it, all other parameters refitted, the residual does not grow \
                          beyond chance, by less than the model error, or by too little for its p-value";
            self.remove_step(&step, (fit, filters), reason);
        }
        self.added.len() < before
    }

    /// Least needed step with the fit without it; `None` where every step is needed.
    fn least_needed(
        &self,
        (given, excess): (&Twin, Option<Excess>),
    ) -> Option<(Added, Fit, Filters)> {
        let thresholds = self.train.thresholds();
        let required_gain = |own: &ReducedFit| {
            let floor = self.at_floor(given, &own.fit);
            let first = RequiredGain::new(thresholds, (given, self.kind), (excess, excess), floor);
            if self.added.len() == 1 { first } else { first.in_any_order() }
        };
        let with = self.rows(&self.best);
        let trials = self.reduced_fits(&self.elimination_candidates());
        let is_needed = |own: &ReducedFit| {
            let gain = own.gain(1, &with);
            self.is_better_beyond_chance(&own.rows, &with)
                && (with[1].is_empty()
                    || required_gain(own).least(own.step.effect) <= gain
                        && own.step.p_value <= share(gain) * thresholds.family_error)
        };
        trials
            .into_iter()
            .filter(|own| !is_needed(own))
            .min_by(|a, b| a.gain(0, &with).total_cmp(&b.gain(0, &with)))
            .map(|own| (own.step, own.fit, own.filters))
    }

    /// Remove effects, the smallest first, that explain less than the `unknown` dependence: several effects of the
    /// catalogue together imitate one outside it.
    pub(super) fn eliminate_smaller_than(&mut self, unknown: &Unknown) {
        loop {
            let with = self.rows(&self.best);
            let kind = usize::from(!with[1].is_empty());
            let steps: Vec<&Added> =
                self.added.iter().filter(|step| step.unstated.is_none()).collect();
            let reduced_fits = self.reduced_fits(&steps);
            // Relative to the residual without it, as the fraction of `unknown` is.
            let removed = |own: &ReducedFit| {
                let gain = own.gain(kind, &with);
                gain / (1.0 - gain).max(1e-12)
            };
            let least = reduced_fits.into_iter().min_by(|a, b| removed(a).total_cmp(&removed(b)));
            let Some(own) = least.filter(|own| removed(own) < unknown.fraction) else {
                return;
            };
            log::info!(
                "{:?}: {} on {} removes {:.1} % of what is left, {} stays with {:.1} %: withdrawn",
                self.kind,
                own.step.effect.name,
                own.step.axis,
                100.0 * removed(&own),
                unknown.name,
                100.0 * unknown.fraction
            );
            let reason = format!(
                "It removes {:.1} % of the residual, less than the unexplained part ({}, {:.1} %)",
                100.0 * removed(&own),
                unknown.name,
                100.0 * unknown.fraction
            );
            self.remove_step(&own.step, (own.fit, own.filters), &reason);
        }
    }

    /// Whitened residuals of the training and of the validation sessions, in the metric of the best fit.
    pub(super) fn rows(&self, fit: &Fit) -> [Vec<f64>; 2] {
        [
            self.train.whitened(&fit.point, &self.filters),
            self.held_out.whitened(&self.validated_of(fit), &self.filters),
        ]
    }

    /// Fits without each of `steps`.
    fn reduced_fits(&self, steps: &[&Added]) -> Vec<ReducedFit> {
        in_parallel(steps, |step| {
            let (fit, filters) = self.without(step);
            ReducedFit { step: (*step).clone(), rows: self.rows(&fit), fit, filters }
        })
    }

    /// The [`MOST_REFITTED`] steps with the smallest loss in a short fit without each, with the present columns of the
    /// others.
    fn elimination_candidates(&self) -> Vec<&Added> {
        let mut steps: Vec<&Added> = self.added.iter().collect();
        if MOST_REFITTED < steps.len() {
            let at = self.train.evaluated(self.best.point.clone());
            let columns = self.train.columns(&at, &self.best.slots, &self.filters);
            let losses = in_parallel(&steps, |step| self.roughly_without(step, &columns).loss);
            let mut order: Vec<usize> = (0..steps.len()).collect();
            order.sort_by(|a, b| losses[*a].total_cmp(&losses[*b]));
            steps = order.into_iter().take(MOST_REFITTED).map(|index| &self.added[index]).collect();
        }
        steps
    }

    /// Short fit without the effect of `step`, with the `columns` of the full fit.
    fn roughly_without(&self, step: &Added, columns: &[Vec<f64>]) -> Fit {
        let mut rest = self.best.clone();
        let gone = instance_of(&rest.point.twin, step);
        let stays = |slot: &Slot| Some(slot.instance) != gone;
        let columns = self.best.slots.iter().zip(columns).filter(|(slot, _)| stays(slot));
        let known: Vec<Vec<f64>> = columns.map(|(_, column)| column.clone()).collect();
        remove_from(&mut rest, step);
        let how = fit::How { known: &known, ..fit::How::minimum(&self.filters, 3) };
        fit::fit_with(&self.train, rest.point, &rest.slots, &how)
    }

    /// Remove effects whose joint confidence intervals contain "no effect" after the joint refit: a later effect
    /// explains the same. Return whether any was removed.
    pub(super) fn eliminate_null(&mut self) -> bool {
        let before = self.added.len();
        while let Some(step) = self.first_null() {
            log::info!(
                "{:?}: {} on {} may as well be none",
                self.kind,
                step.effect.name,
                step.axis
            );
            let rest = self.without(&step);
            let reason = "After the joint refit, its confidence intervals contain zero or its magnitude is on a bound";
            self.remove_step(&step, rest, reason);
        }
        self.added.len() < before
    }

    /// Remove the effects that were added to a single axis while a parameter of the given twin is on a bound; return
    /// whether any was removed. The twin cannot describe the machine then, and an added effect compensates for that. On
    /// a table, a given effect may end on a bound because another replaces it.
    pub(super) fn remove_with_known_on_bound(&mut self) -> bool {
        if self.best.point.twin.machine == Machine::Table {
            return false;
        }
        let before = self.added.len();
        while let Some(name) = self.known_on_bound()
            && let Some(step) = self.added.iter().rfind(|step| step.unstated.is_none()).cloned()
        {
            let reason =
                format!("The known parameter {name} is on its bound, so no effect is identified");
            let rest = self.without(&step);
            self.remove_step(&step, rest, &reason);
        }
        self.added.len() < before
    }

    /// Remove effects that were added to a single axis, the weakest first. An effect is removed if
    /// it explains less than half of the residual of the twin without it, and the rest is above its
    /// noise floor. The cause is then another one, which the effect may imitate. All waves of a
    /// ripple are one effect. Return whether any was removed. On a table, the floor of a calibrated
    /// twin contains its model error.
    pub(super) fn remove_minor(&mut self, given: &Twin) -> bool {
        let before = self.added.len();
        let is_table = self.best.point.twin.machine == Machine::Table;
        while !is_table
            && self.is_above_floor(given)
            && let Some((effect, gain, rest)) = self.weakest()
            && gain < self.train.thresholds().majority
        {
            let reason =
                "It explains less than half of the residual, and the rest is above its noise floor";
            let steps: Vec<Added> =
                self.added.iter().filter(|own| own.effect == effect).cloned().collect();
            steps.iter().for_each(|step| self.remove_step(step, rest.clone(), reason));
        }
        self.added.len() < before
    }

    /// The added effect that explains the least, and the fit without it. The fraction is the smallest of three: of the
    /// validation error when it was added, and of the squared residuals of the training and validation sessions without it.
    fn weakest(&self) -> Option<(&'static Effect, f64, (Fit, Filters))> {
        let squares = |fit: &Fit| -> [f64; 2] {
            let validated = self.held_out.squares(&self.validated_of(fit));
            [self.train.squares(&fit.point), validated].map(|all| all.iter().map(|own| own.0).sum())
        };
        let with = squares(&self.best);
        let mut effects: Vec<&'static Effect> = Vec::new();
        for step in self.added.iter().filter(|step| step.unstated.is_none()) {
            if !effects.contains(&step.effect) {
                effects.push(step.effect);
            }
        }
        let without = |effect: &'static Effect| {
            let mut rest = self.best.clone();
            let mut left_when_added = 1.0;
            for step in self.added.iter().filter(|own| own.effect == effect) {
                remove_from(&mut rest, step);
                left_when_added *= 1.0 - step.validation_gain;
            }
            let rest = fit::converge(&self.train, rest.point, &rest.slots, 5);
            let left = with.iter().zip(squares(&rest.0)).map(|(with, without)| with / without);
            (effect, 1.0 - left.fold(left_when_added, f64::max), rest)
        };
        effects.into_iter().map(without).min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Comparison of the residual of `fit` on a single axis with its noise floor. The floor of a table is that of its
    /// simulator.
    pub(super) fn at_floor(&self, given: &Twin, fit: &Fit) -> AtFloor {
        if given.machine == Machine::Table {
            return AtFloor::No;
        }
        let ratio =
            self.floor_ratios(given, fit).iter().fold(0.0, |most: f64, own| most.max(own.1));
        if ratio <= 1.0 { AtFloor::Yes(ratio) } else { AtFloor::No }
    }

    /// Return whether a signal of the training sessions is above its floor.
    pub(super) fn is_above_floor(&self, given: &Twin) -> bool {
        let ratio = self.train.thresholds().floor_ratio;
        self.floor_ratios(given, &self.best).iter().any(|(_, own)| ratio < *own)
    }

    /// Signals of the training sessions, with the ratio of residual and noise floor.
    fn floor_ratios(&self, given: &Twin, fit: &Fit) -> Vec<(&str, f64)> {
        let Some(part) = self.train.parts.first() else { return Vec::new() };
        let channels = part.stage.channels();
        let floors = floors(part.stage, given, &fit.point.twin, self.train.thresholds());
        let residuals = self.train.rms(&fit.point).into_iter().zip(floors);
        let ratios = residuals.map(|(rms, floor)| rms / floor.rms);
        channels.iter().map(|own| own.signal.as_str()).zip(ratios).collect()
    }

    /// Return whether an `unknown` dependence is larger than noise. Below the noise floor of a single axis, it must hold
    /// that fraction of the squared floor which it must hold of the squared residual elsewhere.
    pub(super) fn is_above_noise(&self, unknown: &Unknown) -> bool {
        let twin = &self.best.point.twin;
        let excess = self.train.thresholds().reference_excess;
        let is_above = |ratio: f64| excess <= unknown.fraction * ratio.min(1.0).powi(2);
        let mut ratios = self.floor_ratios(twin, &self.best).into_iter();
        twin.machine == Machine::Table
            || ratios.all(|(signal, ratio)| signal != unknown.signal || is_above(ratio))
    }

    /// First fitted parameter of the given twin that is on a bound.
    fn known_on_bound(&self) -> Option<String> {
        let twin = &self.best.point.twin;
        let is_added = |slot: &Slot| {
            self.added.iter().any(|step| instance_of(twin, step) == Some(slot.instance))
        };
        let known: Vec<Slot> =
            self.best.slots.iter().copied().filter(|slot| !is_added(slot)).collect();
        known_on_bound(twin, &known)
    }

    /// Remove, one by one, effects whose final joint confidence intervals contain "no effect". Return the twin on the
    /// validation sessions and the uncertainty of the fit; `None` where no effect remains.
    pub(super) fn eliminate_insignificant(&mut self) -> Option<(Point, Uncertainty)> {
        while !self.added.is_empty() {
            let problems = (&self.train, &self.held_out);
            let others = (&self.rejected[..], &self.added[..]);
            let found = uncertainty_of(problems, &self.best, &self.filters, others);
            let Some(least) = self.least_of_insignificant(&found.1) else { return Some(found) };
            let ReducedFit { step, fit, filters, .. } = least;
            let reason = "The joint confidence intervals of its parameters, or of an effect that it may be confused with, \
                          contain the values without the effect";
            log::info!("{:?}: {} on {} is removed", self.kind, step.effect.name, step.axis);
            self.remove_step(&step, (fit, filters), reason);
        }
        None
    }

    /// Step whose joint intervals contain the values without the effect. Of several, and of those that may be confused with
    /// it, which widen its intervals, the one without which the residual grows least. A single magnitude stays if it
    /// explains most of the residual. Several parameters stay if the data require them jointly: each may be zero where
    /// another one compensates. Parameters that the data do not determine have no interval.
    fn least_of_insignificant(&self, uncertainty: &Uncertainty) -> Option<ReducedFit> {
        let twin = &self.best.point.twin;
        let determined = |step: &Added| -> Vec<(usize, &Slot)> {
            let index = instance_of(twin, step);
            let fitted = self.best.slots.iter().enumerate();
            fitted
                .filter(|(k, slot)| Some(slot.instance) == index && !uncertainty.undetermined[*k])
                .collect()
        };
        let has_no_motor =
            |step: &Added| is_without_motor(step.effect, twin, &determined(step), uncertainty);
        let is_insignificant = |step: &&Added| {
            step.unstated.is_none()
                && (contains_null(twin, &determined(step), uncertainty) || has_no_motor(step))
        };
        let insignificant: Vec<&Added> = self.added.iter().filter(is_insignificant).collect();
        let is_alike = |step: &&Added| {
            insignificant.iter().any(|own| {
                own.effect == step.effect || own.effect.may_be_confused_with(step.effect)
            })
        };
        let steps: Vec<&Added> =
            self.added.iter().filter(|own| own.unstated.is_none()).filter(is_alike).collect();
        if steps.is_empty() {
            return None;
        }
        let with = self.rows(&self.best);
        let kind = usize::from(!with[1].is_empty());
        let is_needed = |own: &ReducedFit| {
            let is_single = own.step.effect.null.len() == 1;
            let least = if is_single { self.train.thresholds().majority } else { 0.0 };
            least <= own.gain(kind, &with) && self.is_better_beyond_chance(&own.rows, &with)
        };
        let left = |own: &ReducedFit| fit::squared(&own.rows[0]);
        let reduced_fits = self.reduced_fits(&steps).into_iter();
        reduced_fits
            .filter(|own| has_no_motor(&own.step) || !is_needed(own))
            .min_by(|a, b| left(a).total_cmp(&left(b)))
    }

    /// First step whose effect is insignificant, has its magnitude on a bound, or is the end stiffness of a backlash.
    fn first_null(&self) -> Option<Added> {
        let twin = &self.best.point.twin;
        let ratio = self.train.thresholds().size_ratio;
        let is_gone = |step: &&Added| {
            instance_of(twin, step).is_some_and(|instance| {
                let size = Slot { instance, parameter: 0 };
                is_end_of_backlash(twin, instance, ratio)
                    || self.best.slots.contains(&size) && on_bound_of(twin, [size]).is_some()
            })
        };
        if let Some(step) = self.added.iter().find(is_gone) {
            return Some(step.clone());
        }
        self.added.iter().find(|step| has_sizes_only(step.effect))?;
        let validated = self.validated();
        let found = (&self.best, &validated);
        let uncertainty = fit::uncertainty(&self.train, &self.held_out, found, &self.filters);
        let is_null = |step: &&Added| {
            let of_step = |slot: &Slot| Some(slot.instance) == instance_of(twin, step);
            let all = self.best.slots.iter().enumerate();
            let own: Vec<(usize, &Slot)> = all.filter(|(_, slot)| of_step(slot)).collect();
            // A parameter without slope, such as a threshold between two commands, has no interval.
            has_sizes_only(step.effect)
                && own.iter().all(|(index, _)| !uncertainty.undetermined[*index])
                && contains_null(twin, &own, &uncertainty)
        };
        self.added.iter().filter(is_null).find(|step| !self.is_needed_jointly(step)).cloned()
    }

    /// Return whether the data require `step` beyond chance as a whole, with several parameters. Each interval alone
    /// may be unbounded where another parameter compensates, and a threshold has no slope.
    fn is_needed_jointly(&self, step: &Added) -> bool {
        if step.effect.null.len() < 2 {
            return false;
        }
        let with = self.rows(&self.best);
        self.reduced_fits(&[step]).iter().all(|own| self.is_better_beyond_chance(&own.rows, &with))
    }

    /// Return whether the training sessions, and the validation sessions if any, are predicted better beyond chance with
    /// the residuals `after` than with those `before`.
    pub(super) fn is_better_beyond_chance(
        &self,
        before: &[Vec<f64>; 2],
        after: &[Vec<f64>; 2],
    ) -> bool {
        let is_in = |kind: usize, problem: &Problem<'_>| {
            problem.thresholds().is_in(&before[kind], &after[kind], &problem.blocks())
        };
        is_in(0, &self.train) && (after[1].is_empty() || is_in(1, &self.held_out))
    }

    /// Fit without the effect of `step`.
    pub(super) fn without(&self, step: &Added) -> (Fit, Filters) {
        let mut rest = self.best.clone();
        remove_from(&mut rest, step);
        fit::fit_from_distant_start(&self.train, rest.point, &rest.slots, WITHOUT_ITERATIONS)
    }

    /// Remove `step` for `reason`; `rest` is the fit of everything else.
    pub(super) fn remove_step(&mut self, step: &Added, rest: (Fit, Filters), reason: &str) {
        self.note_removed(step, reason);
        self.removed.extend(self.discrepancy_along(step, &rest.0));
        self.added.retain(|own| {
            own.effect != step.effect || own.axis != step.axis || own.scanned != step.scanned
        });
        (self.best, self.filters) = rest;
    }

    /// Part of the residual of `rest`, the fit without the effect of `step`, that this effect explains; `None` where there is none.
    fn discrepancy_along(&self, step: &Added, rest: &Fit) -> Option<Discrepancy> {
        let (with, without) = (self.rows(&self.best), self.rows(rest));
        let kind = usize::from(!with[1].is_empty());
        let explained_fraction = fit::explained(&with[kind], &without[kind]);
        let twin = &self.best.point.twin;
        let instance = &twin.instances[instance_of(twin, step)?];
        // Only the magnitude has a value without the effect.
        let offset =
            |(k, value): (usize, f64)| if k == 0 { value - step.effect.null[0] } else { 0.0 };
        (0.0 < explained_fraction).then(|| Discrepancy {
            stage: self.kind,
            effect: step.effect.name.to_owned(),
            explained_fraction,
            parameter_offsets: instance.numbers().into_iter().enumerate().map(offset).collect(),
            fitted: Some(instance.clone()),
        })
    }
}

/// Fit without the effect of one step.
struct ReducedFit {
    step: Added,
    fit: Fit,
    filters: Filters,
    /// Whitened residuals of the training and of the validation sessions.
    rows: [Vec<f64>; 2],
}

impl ReducedFit {
    /// Fraction of the squared error that the effect removes, in sessions of one `kind`: 0 for training, 1 for
    /// validation.
    fn gain(&self, kind: usize, with: &[Vec<f64>; 2]) -> f64 {
        fit::explained(&with[kind], &self.rows[kind])
    }
}

/// Share of the family-wise error for an effect that removes the fraction `gain` of the squared validation residual: its
/// square. The smaller an effect, the more model errors are as large. This is a weighted Bonferroni correction (Genovese,
/// Roeder and Wasserman, Biometrika 93, 2006): weights of at most one from the validation sessions, and p-values from the
/// training sessions.
fn share(gain: f64) -> f64 {
    gain.clamp(0.0, 1.0).powi(2)
}

/// Index in the twin of the effect of a step: of several instances, the one nearest to the scanned value of the step.
pub(in crate::gap) fn instance_of(twin: &Twin, step: &Added) -> Option<usize> {
    let same = |own: &Instance| own.effect == step.effect && own.axis == step.axis;
    let distance = |index: &usize| match (step.scanned, step.effect.scanned_parameter()) {
        (Some(value), Some(parameter)) => {
            (twin.instances[*index].values[parameter].value / value).ln().abs()
        }
        _ => 0.0,
    };
    let all = (0..twin.instances.len()).filter(|index| same(&twin.instances[*index]));
    all.min_by(|one, other| distance(one).total_cmp(&distance(other)))
}

/// Return whether instance `index` is a spring at most `ratio` times as soft as the ends of a backlash on the same
/// axis. The stiffness of the ends is not fitted.
fn is_end_of_backlash(twin: &Twin, index: usize, ratio: f64) -> bool {
    let own = &twin.instances[index];
    let Some(belt) = own.spring().filter(|belt| belt.backlash == 0.0) else { return false };
    let overlapping = twin.instances.iter().filter(|other| other.axis.overlaps(own.axis));
    overlapping
        .filter_map(Instance::spring)
        .any(|gap| 0.0 < gap.backlash && gap.stiffness < ratio * belt.stiffness)
}

/// First of the `known` parameters of `twin` that is on a bound, unless it has no effect there.
pub(in crate::gap) fn known_on_bound(twin: &Twin, known: &[Slot]) -> Option<String> {
    let acts = |slot: &&Slot| {
        let effect = twin.instances[slot.instance].effect;
        twin.get(**slot) != effect.null[slot.parameter]
            && !effect.parameters[slot.parameter].per_session
    };
    let acting = known.iter().filter(acts).copied();
    on_bound_of(twin, acting).map(|(slot, name)| {
        let instance = &twin.instances[slot.instance];
        format!("{}.{name}{}", instance.effect.name, instance.axis.phrase())
    })
}

/// Remove the effect of a step from the twin; everything else stays as it is.
fn remove_from(best: &mut Fit, step: &Added) {
    let Some(index) = instance_of(&best.point.twin, step) else { return };
    best.point.twin.instances.remove(index);
    best.slots.retain(|slot| slot.instance != index);
    let later = best.slots.iter_mut().filter(|slot| index < slot.instance);
    later.for_each(|slot| slot.instance -= 1);
}

/// Standard errors in half of each joint 95 % interval (Bonferroni) of `count` parameters.
fn joint_quantile(count: usize, uncertainty: &Uncertainty) -> f64 {
    t_quantile(1.0 - 0.025 / count.max(1) as f64, uncertainty.freedom)
}

/// Return whether the joint 95 % intervals of `parameters`, with their indices in the fit, contain the values without the
/// effect; false for an empty list.
fn contains_null(twin: &Twin, parameters: &[(usize, &Slot)], uncertainty: &Uncertainty) -> bool {
    let quantile = joint_quantile(parameters.len(), uncertainty);
    let contains = |(index, slot): &(usize, &Slot)| {
        let null = twin.instances[slot.instance].effect.null[slot.parameter];
        (twin.get(**slot) - null).abs() < quantile * uncertainty.standard_errors[*index]
    };
    !parameters.is_empty() && parameters.iter().all(contains)
}

/// Return whether the joint 95 % interval of the mass fraction of an elastic load contains the
/// whole mass. The data then do not show that anything else moves with the motor.
fn is_without_motor(
    effect: &Effect,
    twin: &Twin,
    parameters: &[(usize, &Slot)],
    uncertainty: &Uncertainty,
) -> bool {
    let quantile = joint_quantile(parameters.len(), uncertainty);
    let mut fractions = parameters.iter().filter(|(_, slot)| slot.parameter == 0);
    matches!(effect.physics, Physics::ElasticLoad(_))
        && fractions.any(|(index, slot)| {
            1.0 <= twin.get(**slot) + quantile * uncertainty.standard_errors[*index]
        })
}

/// Return whether every parameter of `effect` is a magnitude, and none a shape.
fn has_sizes_only(effect: &Effect) -> bool {
    effect.null.len() == 1 || effect.null.iter().all(|null| *null == 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::{
            options::Context,
            round::slots_of_last,
            rounds::StageData,
            test_stage::{CAMERA_NOISE_RMS, TestStage},
            thresholds::Thresholds,
        },
        twin::{Source, StageKind},
    };
    use std::f64::consts::TAU;

    /// Nominal single axis with the effect called `name`, its first parameter at three scales and the others at null.
    fn with_effect(name: &str) -> Twin {
        let effect = find(name).unwrap();
        let mut values = effect.null.to_vec();
        values[0] = 3.0 * effect.parameters[0].scale;
        let mut twin = Twin::nominal(Machine::Axis);
        twin.instances.push(Instance::new(effect, Axis::Single, &values, Source::Fitted));
        twin
    }

    /// Sine of 1 Hz with the amplitude of the noise. At three scales it hardly depends on the magnitude of the effect.
    fn saturated(twin: &Twin, time: f64) -> f64 {
        let nominal = Twin::nominal(Machine::Axis).instances.len();
        let scaled = |own: &Instance| own.values[0].value / own.effect.parameters[0].scale;
        let magnitude = twin.instances.get(nominal).map_or(0.0, scaled);
        CAMERA_NOISE_RMS * magnitude.tanh() * (TAU * time).sin()
    }

    /// Step that added the effect called `name`, the only candidate of its round.
    fn step(name: &str) -> Added {
        Added {
            effect: find(name).unwrap(),
            axis: Axis::Single,
            scanned: None,
            p_value: 1e-6,
            statistic: 30.0,
            data: String::new(),
            comparisons: 1,
            log_score: None,
            validation_gain: 0.3,
            indistinguishable: vec![],
            has_rival: false,
            held_out_steps: (vec![], vec![]),
            unstated: None,
            ranking: vec![],
            estimates: vec![],
        }
    }

    #[test]
    fn a_smaller_effect_needs_a_smaller_p_value() {
        assert_eq!([1.0, 0.5, 0.1].map(share), [1.0, 0.25, 0.1_f64.powi(2)]);
        // Validation sessions that are predicted worse leave no share.
        assert_eq!([share(-0.3), share(1.5)], [0.0, 1.0]);
    }

    /// The interval of a magnitude in saturation contains zero, although the effect explains a third of the residual.
    #[test]
    fn several_parameters_are_judged_by_the_residual_without_them() {
        let remains = |name: &str| {
            let twin = with_effect(name);
            let stages = [1, 2].map(|seed| TestStage::camera(&twin, saturated, seed));
            let data = StageData {
                kind: StageKind::Camera,
                train: vec![&stages[0]],
                held_out: vec![&stages[1]],
                witnesses: vec![],
                companions: vec![],
                predecessors: vec![],
                held: vec![],
                may_be_disturbed: false,
                context: Context::default(),
            };
            let (mut search, _) = Search::opened(&data, &twin);
            search.best.point.twin = twin.clone();
            search.best.slots = slots_of_last(&twin);
            search.added = vec![step(name)];
            search.eliminate_insignificant();
            !search.added.is_empty()
        };
        assert!(remains("drive.friction.presliding"));
        assert!(!remains("drive.lag1"), "its only parameter may be zero");
    }

    #[test]
    fn a_known_parameter_on_its_bound_is_found_unless_it_has_no_effect_there() {
        let mut twin = Twin::nominal(Machine::Axis);
        let at = |name: &str| twin.instances.iter().position(|own| own.effect.name == name);
        let mass = Slot { instance: at("gantry.inertia").unwrap(), parameter: 0 };
        let coulomb = Slot { instance: at("drive.friction.coulomb").unwrap(), parameter: 0 };
        assert_eq!(known_on_bound(&twin, &[mass, coulomb]), None);
        twin.set(mass, 0.0);
        let found = known_on_bound(&twin, &[coulomb, mass]).unwrap();
        assert_eq!(found, "gantry.inertia.mass_kg");
    }

    #[test]
    fn a_belt_is_distinguished_from_the_ends_of_a_backlash() {
        let is_end_of_backlash = |twin: &Twin, index: usize| {
            is_end_of_backlash(twin, index, Thresholds::DEFAULT.size_ratio)
        };
        let mut twin = Twin::nominal(Machine::Table);
        let mut add = |name: &str, axis: Axis, values: &[f64]| {
            twin.instances.push(Instance::new(find(name).unwrap(), axis, values, Source::Fitted));
            twin.instances.len() - 1
        };
        let hard = add("drive.compliance.belt", Axis::Motors, &[2.7e-6, 0.98, 0.05]);
        let soft = add("drive.compliance.belt", Axis::Motors, &[1.7e-5, 0.98, 0.05]);
        assert!(!is_end_of_backlash(&twin, hard));
        twin.instances.push(Instance::new(
            find("drive.backlash").unwrap(),
            Axis::B,
            &[3e-4, 50.0],
            Source::Fitted,
        ));
        assert!(is_end_of_backlash(&twin, hard) && !is_end_of_backlash(&twin, soft));
        assert!(!is_end_of_backlash(&twin, soft + 1));
        twin.instances[hard].axis = Axis::A;
        assert!(!is_end_of_backlash(&twin, hard));
    }
}
