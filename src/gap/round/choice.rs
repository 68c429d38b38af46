//! Selection of the effect that is added, among the trials that passed.

use super::{
    bench::Bench,
    objection::aligns_stamps,
    slots_of_last,
    trial::{Trial, may_be_confused, squared_distance},
};
use crate::{
    effects::Physics,
    gap::{
        batch::in_parallel,
        evidence::{Amplitude, Blocks},
        fit::{self, Fit},
        problem::{Point, dot},
        rounds::{Added, Reason, Rejected},
    },
    twin::Slot,
};
use std::mem;

/// Iterations of a fit without whitening.
const PLAIN_ITERATIONS: usize = 12;

/// Trial and number of [required parameters](Bench::required_parameters) of its effect.
type Counted<'t> = (&'t Trial, usize);

impl Bench<'_, '_> {
    /// Select the trial to add, with its indistinguishable alternatives; all others are rejected.
    pub(super) fn winner(
        &self,
        passed: &[&Trial],
        trials: &[Trial],
        rejected: &mut Vec<Rejected>,
    ) -> Option<(Fit, Added)> {
        let free = in_parallel(passed, |trial| self.required_parameters(trial));
        let counted: Vec<Counted<'_>> = passed.iter().copied().zip(free).collect();
        let (own, free) = as_delay(self.strongest(self.simplest(&counted)?, &counted), &counted);
        let mut indistinguishable = Vec::new();
        for (other, parameters) in counted.iter().filter(|(other, _)| !std::ptr::eq(*other, own)) {
            let name = other.candidate.effect.name;
            // A motor has one of a few periods, given by its poles. A period from a scan therefore makes its ripple no
            // more flexible than an effect with a known period.
            let scanned = usize::from(other.candidate.effect.scanned_parameter().is_some());
            let is_as_good = *parameters <= free + scanned
                && self.is_rival(own, other)
                && self.is_rival(other, own);
            let is_alignment =
                [own, other].iter().all(|trial| aligns_stamps(&trial.fit.point.twin));
            if name != own.candidate.effect.name && (is_as_good || is_alignment) {
                if !indistinguishable.contains(&name) {
                    indistinguishable.push(name);
                }
            } else {
                let winner = own.candidate.effect.name.to_owned();
                rejected.push(self.rejected(other, Reason::Outperformed(winner)));
            }
        }
        Some((own.fit.clone(), self.added(own, indistinguishable, trials)))
    }

    /// Trials that passed, the smallest loss first. A trial that is indistinguishable from the best of them is included
    /// even if its gain is too small: prior knowledge about one of two indistinguishable effects applies to neither.
    pub(super) fn acceptable<'t>(&self, trials: &'t [Trial]) -> Vec<&'t Trial> {
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

    /// Simplest of the best trial and those nearly as good: the fewest required parameters, then the fewest mandatory
    /// parameters, then the smallest loss. A law without a parameter states that it is zero.
    fn simplest<'t>(&self, passed: &[Counted<'t>]) -> Option<Counted<'t>> {
        let (best, free) = *passed.first()?;
        let qualifies = |(other, parameters): &Counted<'_>| {
            std::ptr::eq(*other, best)
                || self.is_rival(best, other)
                || *parameters < free && self.is_nearly_as_good(best, other)
        };
        let complexity = |(own, needed): &Counted<'_>| {
            let effect = own.candidate.effect;
            let all = 0..effect.parameters.len();
            (*needed, all.filter(|parameter| !effect.is_optional(*parameter)).count())
        };
        passed.iter().copied().filter(qualifies).min_by_key(complexity)
    }

    /// Number of parameters of the effect that the data require: the prediction changes beyond chance at their null
    /// value, or at twice their own. A frequency may happen to have the null value, and still counts. A spring that
    /// does not soften has no length at which it does. Optional parameters do not count.
    fn required_parameters(&self, trial: &Trial) -> usize {
        let twin = &trial.fit.point.twin;
        let effect = trial.candidate.effect;
        let matters = |slot: &Slot| {
            self.is_required(trial, *slot)
                || self.is_preferred_to(trial, |other| other.set(*slot, 2.0 * twin.get(*slot)))
        };
        let own = slots_of_last(twin).into_iter();
        own.filter(|slot| !effect.is_optional(slot.parameter) && matters(slot)).count()
    }

    /// Return whether `other` acts at the same point of the chain as `own`, may be confused with it, changes the
    /// prediction alike and removes nearly as much.
    fn is_nearly_as_good(&self, own: &Trial, other: &Trial) -> bool {
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let joint = |trial: &Trial| {
            trial.candidate.effect.physics.equations().first().map(mem::discriminant)
        };
        let machine = own.fit.point.twin.machine;
        joint(own) == joint(other)
            && may_be_confused(own, other)
            && self.is_same(own, other)
            && (1.0 - self.thresholds().model_error_of(machine)) * removes(own) <= removes(other)
    }

    /// Trial to add first: among effects that explain different things, one that closes far more of the gap precedes
    /// `best`, the most significant one. The latter counts as fitted to the gap: whitening tolerates slow errors.
    fn strongest<'t>(&self, best: Counted<'t>, passed: &[Counted<'t>]) -> Counted<'t> {
        let closed = passed.iter().map(|own| (self.closed_fraction(&own.0.fit.point), *own));
        let Some((most, rival)) = closed.max_by(|a, b| a.0.total_cmp(&b.0)) else { return best };
        let is_far_stronger =
            |point| self.thresholds().stronger_ratio * self.closed_fraction(point) < most;
        let Fit { point, slots, .. } = &best.0.fit;
        if !is_far_stronger(point) {
            return best;
        }
        let refitted = fit::fit(self.train, point.clone(), slots, &self.scales, PLAIN_ITERATIONS);
        if is_far_stronger(&refitted.point) { rival } else { best }
    }

    /// Fraction of the squared gap on the training sessions that is closed at `point`, every signal in units of its RMS.
    fn closed_fraction(&self, point: &Point) -> f64 {
        1.0 - fit::squared(&self.train.whitened(point, &self.scales))
            / self.train.rows().max(1) as f64
    }

    /// Return whether `other` explains the same as `own`, and predicts all sessions equally well.
    fn is_rival(&self, own: &Trial, other: &Trial) -> bool {
        if !self.is_same(own, other) {
            return false;
        }
        let thresholds = self.thresholds();
        let blocks = Blocks::joined(&[self.train.blocks(), self.held_out.blocks()]);
        let all = |trial: &Trial| [trial.train_rows.as_slice(), &trial.held_rows].concat();
        let (own, other) = (all(own), all(other));
        let base = [self.base_train_rows.as_slice(), &self.base_held_rows].concat();
        squared_distance(&own, &other) < thresholds.equal_prediction * squared_distance(&base, &own)
            || !Amplitude::of(&other, &own, &blocks)
                .is_above(thresholds.min_amplitude, thresholds.confirmation_level)
    }

    /// Return whether both trials change the prediction alike: the squared cosine of their changes is above one half.
    /// Otherwise they explain different things, however well.
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

/// The delay among the trials that passed, if `best` only aligns the stamps of input and motion: stamps and holds delay. As a
/// delay it remains distinguishable from a lag of the machine that appears later.
fn as_delay<'t>(best: Counted<'t>, passed: &[Counted<'t>]) -> Counted<'t> {
    let is_delay = |(trial, _): &&Counted<'_>| {
        matches!(trial.candidate.effect.physics, Physics::CommandDelay(_))
            && aligns_stamps(&trial.fit.point.twin)
    };
    match aligns_stamps(&best.0.fit.point.twin) {
        true => passed.iter().find(is_delay).copied().unwrap_or(best),
        false => best,
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Problems, RequiredGain, screen, trial::Trial, values_of_last, whiten};
    use super::*;
    use crate::gap::known::AtFloor;
    use crate::{
        effects::{Axis, find},
        gap::{
            problem::Problem,
            screen::Candidate,
            test_stage::{TestStage, first_parameters},
            thresholds::Thresholds,
        },
        twin::{Machine, Stage, StageKind, Twin},
    };
    use std::f64::consts::TAU;

    const WOBBLE: &str = "coupling.striker_wobble";

    /// Sine whose amplitude and frequency (Hz) are the first two parameters of the wobble; the third has no influence.
    fn sine(twin: &Twin, time: f64) -> f64 {
        let wobble = twin.instances.iter().find(|own| own.effect.name == WOBBLE);
        let [amplitude, frequency] =
            wobble.map_or([0.0; 2], |own| [0, 1].map(|index| own.values[index].value));
        amplitude * (TAU * frequency * time).sin()
    }

    /// Evaluate `f` with the search for a wobble on the recording of a machine that is `truth`. The base is the nominal
    /// table, the metric that of the residual of `truth`.
    fn with_bench<T>(
        truth: &Twin,
        predict: impl Fn(&Twin, f64) -> f64 + Sync,
        f: impl Fn(&Bench<'_, '_>) -> T,
    ) -> T {
        let given = Twin::nominal(Machine::Table);
        let stage = TestStage::camera(truth, predict, 7);
        let train = Problem::new(&[&stage as &dyn Stage], &given);
        let nothing = Problem::new(&[], &given);
        let fit_of =
            |twin: Twin| Fit { point: train.start(twin), slots: vec![], loss: 0.0, rows: 2000 };
        let (base, fit) = (fit_of(given.clone()), fit_of(truth.clone()));
        let filters = train.filters(&fit.point, whiten::scale_filters);
        let required_gain = RequiredGain::new(
            &Thresholds::DEFAULT,
            (&given, StageKind::Camera),
            (None, None),
            AtFloor::No,
        );
        let problems = Problems {
            train: &train,
            held_out: &nothing,
            witness: &nothing,
            predecessor: &nothing,
        };
        f(&Bench::new(problems, (&base, vec![]), (&filters, &required_gain), 1))
    }

    /// Trial of a wobble that ended with `twin`, in which `slots` were fitted.
    fn trial_of(bench: &Bench<'_, '_>, twin: &Twin, slots: &[Slot]) -> Trial {
        let parameters = values_of_last(twin);
        let candidate = Candidate {
            effect: find(WOBBLE).unwrap(),
            axis: Axis::Whole,
            start: parameters.clone(),
            probe: parameters,
            explained_fraction: 0.9,
            statistic: 30.0,
            p_value: 1e-9,
            detectability: 10.0,
            is_as_good_as_refit: false,
            tries: 1,
            parameter_offsets: vec![],
            shift: vec![],
            other_starts: vec![],
        };
        let point = bench.train.start(twin.clone());
        let train_rows = bench.train.whitened(&point, bench.filters);
        let loss = fit::squared(&train_rows);
        Trial {
            candidate,
            fit: Fit { point, slots: slots.to_vec(), loss, rows: 2000 },
            train_rows,
            held_rows: vec![],
            held_point: bench.held_out.start(twin.clone()),
            objection: None,
        }
    }

    /// The nominal table with a wobble of this amplitude and frequency (Hz).
    fn wobbling(wave: [f64; 2]) -> Twin {
        let effect = find(WOBBLE).unwrap();
        let parameters = [wave[0], wave[1], effect.null[2]];
        screen::with(&Twin::nominal(Machine::Table), effect, Axis::Whole, &parameters)
    }

    /// Required parameters of a wobble on a recording of a sine.
    fn required_parameters_of(wave: [f64; 2]) -> usize {
        let twin = wobbling(wave);
        with_bench(&twin, sine, |bench| bench.required_parameters(&trial_of(bench, &twin, &[])))
    }

    #[test]
    fn the_most_significant_effect_counts_as_fitted_to_the_gap() {
        const OFFSET: f64 = 3.0;
        let offset_of = |twin: &Twin| first_parameters(twin, ["drive.friction.coulomb"])[0];
        let sine_and_offset = |twin: &Twin, time: f64| sine(twin, time) + twin.get(offset_of(twin));
        let with_offset = |mut twin: Twin| {
            let slot = offset_of(&twin);
            twin.set(slot, twin.get(slot) + OFFSET);
            twin
        };
        let wave = [1.0, 5.0];
        let (fast, slow) = (wobbling(wave), with_offset(wobbling([0.0, 5.0])));
        let precedes_the_slow_one = |slots: &[Slot]| {
            with_bench(&with_offset(wobbling(wave)), sine_and_offset, |bench| {
                let [fast, slow] = [(&fast, slots), (&slow, &[][..])]
                    .map(|(twin, slots)| trial_of(bench, twin, slots));
                let best = bench.strongest((&fast, 1), &[(&fast, 1), (&slow, 1)]).0;
                std::ptr::eq(best, &raw const fast)
            })
        };
        assert!(!precedes_the_slow_one(&[]));
        // The known offset explains the slow part as well.
        assert!(precedes_the_slow_one(&[offset_of(&fast)]));
    }

    #[test]
    fn a_parameter_is_required_for_any_null_value_unless_it_has_no_influence() {
        let null = find(WOBBLE).unwrap().null[1];
        assert_eq!(required_parameters_of([1.0, 1.4 * null]), 2);
        // The null frequency by coincidence: the same sine, equally flexible.
        assert_eq!(required_parameters_of([1.0, null]), 2);
        // Far below the noise the data require no parameter.
        assert_eq!(required_parameters_of([1e-4, null]), 0);
    }
}
