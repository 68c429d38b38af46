//! Effects that turn out not to be needed, taken back.

use super::{Added, Search, uncertainty_of};
use crate::{
    effects::Effect,
    gap::{
        batch::in_parallel,
        fit::{self, Fit, Uncertainty},
        known::Worth,
        problem::{Point, Problem},
        round::on_bound_of,
        unknown::Unknown,
        whiten::Filters,
    },
    stats::t_quantile,
    twin::{Instance, Machine, Slot, Twin},
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
            log::info!("{:?}: {} on {} is removed", self.kind, step.effect.name, step.axis);
            let reason = "Backward elimination: without it, all other parameters refitted, the residual does not grow \
                          beyond chance, or by less than the model error";
            self.go_back(&step, (fit, filters), reason);
        }
        self.added.len() < before
    }

    /// The step that the data miss least, if they do not miss it, with the fit without it.
    fn least_missed(&self, worth: &Worth<'_>) -> Option<(Added, Fit, Filters)> {
        let with = self.rows(&self.best);
        let trials = self.absences(&self.hardly_missed());
        let is_missed = |own: &Absence| {
            self.is_beyond_chance(own, &with)
                && (with[1].is_empty() || worth.least(own.step.effect) <= own.share(1, &with))
        };
        trials
            .into_iter()
            .filter(|own| !is_missed(own))
            .min_by(|a, b| a.share(0, &with).total_cmp(&b.share(0, &with)))
            .map(|own| (own.step, own.fit, own.filters))
    }

    /// Takes back, the least first, what removes less than what stays unexplained: an effect outside the catalogue is
    /// imitated in part by several inside it.
    pub(super) fn withdraw_what_is_less_than(&mut self, unknown: &Unknown) {
        loop {
            let with = self.rows(&self.best);
            let kind = usize::from(!with[1].is_empty());
            let steps: Vec<&Added> =
                self.added.iter().filter(|step| step.unstated.is_none()).collect();
            let absences = self.absences(&steps);
            // As a share of what is left, as that of the unknown is.
            let removed = |own: &Absence| {
                let share = own.share(kind, &with);
                share / (1.0 - share).max(1e-12)
            };
            let least = absences.into_iter().min_by(|a, b| removed(a).total_cmp(&removed(b)));
            let Some(own) = least.filter(|own| removed(own) < unknown.share) else { return };
            log::info!(
                "{:?}: {} on {} removes {:.1} % of what is left, {} stays with {:.1} %: withdrawn",
                self.kind,
                own.step.effect.name,
                own.step.axis,
                100.0 * removed(&own),
                unknown.name,
                100.0 * unknown.share
            );
            let reason = format!(
                "It removes {:.1} % of the residual, less than the unexplained part ({}, {:.1} %)",
                100.0 * removed(&own),
                unknown.name,
                100.0 * unknown.share
            );
            self.go_back(&own.step, (own.fit, own.filters), &reason);
        }
    }

    /// Whitened residuals of the fitted and of the judging sessions, in the metric of the best fit.
    pub(super) fn rows(&self, fit: &Fit) -> [Vec<f64>; 2] {
        [
            self.train.whitened(&fit.point, &self.filters),
            self.held_out.whitened(&self.judged_of(fit), &self.filters),
        ]
    }

    /// Everything fitted without each of `steps`.
    fn absences(&self, steps: &[&Added]) -> Vec<Absence> {
        in_parallel(steps, |step| {
            let (fit, filters) = self.without(step);
            Absence { step: (*step).clone(), rows: self.rows(&fit), fit, filters }
        })
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

    /// Takes back effects whose joint intervals, now that everything is fitted together, hold the value at which
    /// there is no effect: what was added later explains what they did. Gives whether any was.
    pub(super) fn take_back_what_is_none(&mut self) -> bool {
        let before = self.added.len();
        while let Some(step) = self.nothing() {
            log::info!(
                "{:?}: {} on {} may as well be none",
                self.kind,
                step.effect.name,
                step.axis
            );
            let rest = self.without(&step);
            let reason = "After the joint refit, its confidence intervals contain zero or its magnitude is on a bound";
            self.go_back(&step, rest, reason);
        }
        self.added.len() < before
    }

    /// Remove the effects that were added to a single axis while a parameter of the given twin is on a bound: the twin
    /// cannot describe the machine then, and an added effect compensates for that. On a table, an effect of the given
    /// twin may end there because another takes its place. Give whether any was removed.
    pub(super) fn remove_beside_bound(&mut self) -> bool {
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
            self.go_back(&step, rest, &reason);
        }
        self.added.len() < before
    }

    /// The first fitted parameter of the given twin that is on a bound.
    fn known_on_bound(&self) -> Option<String> {
        let twin = &self.best.point.twin;
        let is_added = |slot: &Slot| {
            self.added.iter().any(|step| instance_of(twin, step) == Some(slot.instance))
        };
        let known: Vec<Slot> =
            self.best.slots.iter().copied().filter(|slot| !is_added(slot)).collect();
        known_on_bound(twin, &known)
    }

    /// Remove, one after the other, effects of which the joint confidence intervals contain "no effect" in the end. Give the
    /// twin on the validation sessions and the uncertainty of the fit, where effects remain.
    pub(super) fn without_indistinct(&mut self) -> Option<(Point, Uncertainty)> {
        while !self.added.is_empty() {
            let problems = (&self.train, &self.held_out);
            let others = (&self.rejected[..], &self.added[..]);
            let found = uncertainty_of(problems, &self.best, &self.filters, others);
            let Some(step) = self.indistinct(&found.1) else { return Some(found) };
            let reason = "The joint confidence intervals of its parameters contain the values without the effect";
            log::info!("{:?}: {} on {} is removed", self.kind, step.effect.name, step.axis);
            let rest = self.without(&step);
            self.go_back(&step, rest, reason);
        }
        None
    }

    /// The first step whose joint intervals contain the values without the effect; parameters that the data do not
    /// determine have none.
    fn indistinct(&self, uncertainty: &Uncertainty) -> Option<Added> {
        let twin = &self.best.point.twin;
        let is_indistinct = |step: &&Added| {
            let index = instance_of(twin, step);
            let fitted = self.best.slots.iter().enumerate();
            let own: Vec<(usize, &Slot)> = fitted
                .filter(|(k, slot)| Some(slot.instance) == index && !uncertainty.undetermined[*k])
                .collect();
            step.unstated.is_none() && contains_null(twin, &own, uncertainty)
        };
        self.added.iter().find(is_indistinct).cloned()
    }

    /// The first step whose effect may as well be none, whose size has run to its bound since it was added, or which is
    /// the end of a play.
    fn nothing(&self) -> Option<Added> {
        let twin = &self.best.point.twin;
        let ratio = self.train.thresholds().size_ratio;
        let is_gone = |step: &&Added| {
            instance_of(twin, step).is_some_and(|instance| {
                let size = Slot { instance, parameter: 0 };
                is_end_of_a_play(twin, instance, ratio)
                    || self.best.slots.contains(&size) && on_bound_of(twin, [size]).is_some()
            })
        };
        if let Some(step) = self.added.iter().find(is_gone) {
            return Some(step.clone());
        }
        self.added.iter().find(|step| has_sizes_only(step.effect))?;
        let judged = self.judged();
        let found = (&self.best, &judged);
        let uncertainty = fit::uncertainty(&self.train, &self.held_out, found, &self.filters);
        let is_none = |step: &&Added| {
            let of_step = |slot: &Slot| Some(slot.instance) == instance_of(twin, step);
            let all = self.best.slots.iter().enumerate();
            let own: Vec<(usize, &Slot)> = all.filter(|(_, slot)| of_step(slot)).collect();
            // A number without slope, such as a threshold between two commands, has no interval.
            has_sizes_only(step.effect)
                && own.iter().all(|(index, _)| !uncertainty.undetermined[*index])
                && contains_null(twin, &own, &uncertainty)
        };
        self.added.iter().filter(is_none).find(|step| !self.is_missed_as_a_whole(step)).cloned()
    }

    /// Whether the data say beyond chance that `step` is not none, whatever the intervals of its several numbers: each
    /// may be anything where another makes up for it, and a threshold has no slope to tell it by.
    fn is_missed_as_a_whole(&self, step: &Added) -> bool {
        if step.effect.null.len() < 2 {
            return false;
        }
        let with = self.rows(&self.best);
        self.absences(&[step]).iter().all(|own| self.is_beyond_chance(own, &with))
    }

    /// Whether fitted sessions, and judging ones where there are any, are worse off without the effect beyond chance.
    fn is_beyond_chance(&self, own: &Absence, with: &[Vec<f64>; 2]) -> bool {
        let is_in = |kind: usize, problem: &Problem<'_>| {
            problem.thresholds().is_in(&own.rows[kind], &with[kind], &problem.blocks())
        };
        is_in(0, &self.train) && (with[1].is_empty() || is_in(1, &self.held_out))
    }

    /// Everything fitted without the effect of `step`.
    fn without(&self, step: &Added) -> (Fit, Filters) {
        let mut rest = self.best.clone();
        take_out(&mut rest, step);
        fit::settle(&self.train, rest.point, &rest.slots, 5)
    }

    /// Remove `step` for `reason`; `rest` is the fit of everything else.
    fn go_back(&mut self, step: &Added, rest: (Fit, Filters), reason: &str) {
        self.note_removed(step, reason);
        self.added.retain(|own| {
            own.effect != step.effect || own.axis != step.axis || own.scanned != step.scanned
        });
        (self.best, self.filters) = rest;
    }
}

/// Everything fitted without the effect of a step.
struct Absence {
    step: Added,
    fit: Fit,
    filters: Filters,
    /// Whitened residuals of the fitted and of the judging sessions.
    rows: [Vec<f64>; 2],
}

impl Absence {
    /// Share of the squared error without the effect that it removes, in sessions of one `kind`, fitted or judging.
    fn share(&self, kind: usize, with: &[Vec<f64>; 2]) -> f64 {
        1.0 - fit::squared(&with[kind]) / fit::squared(&self.rows[kind]).max(f64::MIN_POSITIVE)
    }
}

/// Where in the twin the effect of a step is: of several instances, the one nearest to the scanned value of the step.
pub(in crate::gap) fn instance_of(twin: &Twin, step: &Added) -> Option<usize> {
    let same = |own: &Instance| own.effect == step.effect && own.axis == step.axis;
    let apart = |index: &usize| match (step.scanned, step.effect.scanned_parameter()) {
        (Some(value), Some(parameter)) => {
            (twin.instances[*index].values[parameter].value / value).ln().abs()
        }
        _ => 0.0,
    };
    let all = (0..twin.instances.len()).filter(|index| same(&twin.instances[*index]));
    all.min_by(|one, other| apart(one).total_cmp(&apart(other)))
}

/// Whether the instance `index` is a spring that is at most `ratio` times as soft as the ends of a backlash beside it, of
/// which the stiffness is not fitted.
fn is_end_of_a_play(twin: &Twin, index: usize, ratio: f64) -> bool {
    let own = &twin.instances[index];
    let Some(belt) = own.spring().filter(|belt| belt.backlash == 0.0) else { return false };
    let plays = twin.instances.iter().filter(|other| other.axis.overlaps(own.axis));
    plays
        .filter_map(Instance::spring)
        .any(|gap| 0.0 < gap.backlash && gap.stiffness < ratio * belt.stiffness)
}

/// The first of the `known` parameters of `twin` that is on a bound, unless it has no effect there.
pub(in crate::gap) fn known_on_bound(twin: &Twin, known: &[Slot]) -> Option<String> {
    let acts = |slot: &&Slot| {
        let effect = twin.instances[slot.instance].effect;
        twin.get(**slot) != effect.null[slot.parameter]
            && !effect.parameters[slot.parameter].per_session
    };
    let acting = known.iter().filter(acts).copied();
    on_bound_of(twin, acting).map(|(slot, name)| {
        let instance = &twin.instances[slot.instance];
        format!("{}.{name} on {}", instance.effect.name, instance.axis)
    })
}

/// Takes the effect of a step out of the twin; the rest stays as it is.
fn take_out(best: &mut Fit, step: &Added) {
    let Some(index) = instance_of(&best.point.twin, step) else { return };
    best.point.twin.instances.remove(index);
    best.slots.retain(|slot| slot.instance != index);
    let later = best.slots.iter_mut().filter(|slot| index < slot.instance);
    later.for_each(|slot| slot.instance -= 1);
}

/// Whether the joint 95 % intervals (Bonferroni) of `parameters`, with their indices in the fit, contain the values
/// without the effect; false of none.
fn contains_null(twin: &Twin, parameters: &[(usize, &Slot)], uncertainty: &Uncertainty) -> bool {
    let level = 1.0 - 0.025 / parameters.len().max(1) as f64;
    let quantile = t_quantile(level, uncertainty.freedom);
    let contains = |(index, slot): &(usize, &Slot)| {
        let null = twin.instances[slot.instance].effect.null[slot.parameter];
        (twin.get(**slot) - null).abs() < quantile * uncertainty.standard_errors[*index]
    };
    !parameters.is_empty() && parameters.iter().all(contains)
}

/// Whether each number of `effect` says how large it is, and none only what it looks like.
fn has_sizes_only(effect: &Effect) -> bool {
    effect.null.len() == 1 || effect.null.iter().all(|null| *null == 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::thresholds::Thresholds,
        twin::Source,
    };

    #[test]
    fn a_known_parameter_on_its_bound_is_found_unless_it_has_no_effect_there() {
        let mut twin = Twin::nominal(Machine::Axis);
        let at = |name: &str| twin.instances.iter().position(|own| own.effect.name == name);
        let mass = Slot { instance: at("gantry.inertia").unwrap(), parameter: 0 };
        let coulomb = Slot { instance: at("drive.friction.coulomb").unwrap(), parameter: 0 };
        assert_eq!(known_on_bound(&twin, &[mass, coulomb]), None);
        twin.set(mass, 0.0);
        let found = known_on_bound(&twin, &[coulomb, mass]).unwrap();
        assert!(found.starts_with("gantry.inertia.mass_kg on"), "{found}");
    }

    #[test]
    fn a_belt_beside_a_play_is_more_than_its_ends() {
        let is_end_of_a_play = |twin: &Twin, index: usize| {
            is_end_of_a_play(twin, index, Thresholds::DEFAULT.size_ratio)
        };
        let mut twin = Twin::nominal(Machine::Table);
        let mut add = |name: &str, axis: Axis, values: &[f64]| {
            twin.instances.push(Instance::new(find(name).unwrap(), axis, values, Source::Fitted));
            twin.instances.len() - 1
        };
        let hard = add("drive.compliance.belt", Axis::Motors, &[2.7e-6, 0.98, 0.05]);
        let soft = add("drive.compliance.belt", Axis::Motors, &[1.7e-5, 0.98, 0.05]);
        assert!(!is_end_of_a_play(&twin, hard));
        twin.instances.push(Instance::new(
            find("drive.backlash").unwrap(),
            Axis::B,
            &[3e-4, 50.0],
            Source::Fitted,
        ));
        assert!(is_end_of_a_play(&twin, hard) && !is_end_of_a_play(&twin, soft));
        assert!(!is_end_of_a_play(&twin, soft + 1));
        twin.instances[hard].axis = Axis::A;
        assert!(!is_end_of_a_play(&twin, hard));
    }
}
