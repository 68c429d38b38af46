//! Common metric and base of all trials of a round: every trial is fitted in one metric, and its gain over the base is
//! measured there.

use super::{
    Problems, slots_of_last,
    starts::{from_starts, with_candidate},
    trial::{Trial, may_be_confused, on_bound_of, scanned},
    values_of_last,
};
use crate::{
    gap::{
        batch::in_parallel,
        evidence::{self, LogScoreGain},
        fit::{self, Fit},
        known::RequiredGain,
        problem::{Point, Problem},
        rounds::{Added, RankedCandidate, Reason, Rejected, at_null},
        screen::Candidate,
        thresholds::Thresholds,
        whiten::{self, Filters},
    },
    twin::{Machine, Slot, Twin},
};

/// Iterations of a fit from another start.
const RESTART_ITERATIONS: usize = 20;

/// Common metric and base of all trials of a round.
pub(super) struct Bench<'a, 'b> {
    pub(super) train: &'b Problem<'a>,
    pub(super) held_out: &'b Problem<'a>,
    /// Validation sessions in which the plain residual may show the gain of an effect.
    views: Vec<View<'a, 'b>>,
    /// Another stage that was searched before.
    predecessor: Option<View<'a, 'b>>,
    /// Metric: whitening of the best candidate's residual.
    pub(super) filters: &'b Filters,
    /// One over the RMS of each signal's residual: the metric of the gap.
    pub(super) scales: Filters,
    pub(super) required_gain: &'b RequiredGain<'b>,
    /// Number of comparisons for which each p-value is corrected.
    tries: usize,
    /// Fitted parameters of the given twin that a candidate may not leave on a bound.
    pub(super) known: Vec<Slot>,
    pub(super) base: &'b Fit,
    pub(super) base_train_rows: Vec<f64>,
    pub(super) base_held: Point,
    pub(super) base_held_rows: Vec<f64>,
    /// The same of the base twin or, where it leaves less, of the base with a model error that the reference recordings
    /// showed. The gain of an effect must be new.
    known_held_rows: Vec<f64>,
}

/// A stage without whitening: every signal in units of the RMS of the residual of the base twin.
pub(in crate::gap) struct View<'a, 'b> {
    problem: &'b Problem<'a>,
    scales: Filters,
    base_rows: Vec<f64>,
}

impl<'a, 'b> View<'a, 'b> {
    pub(in crate::gap) fn new(problem: &'b Problem<'a>, base: &Twin) -> Self {
        let scales = problem.filters(&problem.start(base.clone()), whiten::scale_filters);
        let mut view = Self { problem, scales, base_rows: Vec::new() };
        view.base_rows = view.rows(base);
        view
    }

    /// Scaled residual of `twin`.
    fn rows(&self, twin: &Twin) -> Vec<f64> {
        fit::residual_on(self.problem, twin, &self.scales)
    }

    /// Return whether the stage prefers the base to `twin` beyond chance.
    pub(in crate::gap) fn contradicts(&self, twin: &Twin) -> bool {
        let (rows, blocks) = (self.rows(twin), self.problem.blocks());
        self.problem.thresholds().is_in(&rows, &self.base_rows, &blocks)
    }
}

impl<'a, 'b> Bench<'a, 'b> {
    pub(super) fn new(
        problems: Problems<'a, 'b>,
        (base, known): (&'b Fit, Vec<Slot>),
        (filters, required_gain): (&'b Filters, &'b RequiredGain<'b>),
        tries: usize,
    ) -> Self {
        let Problems { train, held_out, witness, predecessor } = problems;
        let seen = [held_out, witness].into_iter();
        let seen = seen.filter(|problem| required_gain.any_signal && !problem.parts.is_empty());
        let base_held = fit::on(held_out, &base.point.twin, filters);
        let base_held_rows = held_out.whitened(&base_held, filters);
        let twins = required_gain.with_model_errors(&base.point.twin);
        let rows = in_parallel(&twins, |twin| fit::residual_on(held_out, twin, filters));
        let as_base = (base.point.twin.clone(), base_held_rows.clone());
        let (known_twin, known_held_rows) = std::iter::once(as_base)
            .chain(twins.into_iter().zip(rows))
            .min_by(|(_, one), (_, other)| fit::squared(one).total_cmp(&fit::squared(other)))
            .expect("the base is one of them");
        Self {
            train,
            held_out,
            views: seen.map(|problem| View::new(problem, &known_twin)).collect(),
            predecessor: (!predecessor.parts.is_empty())
                .then(|| View::new(predecessor, &base.point.twin)),
            filters,
            scales: train.filters(&base.point, whiten::scale_filters),
            required_gain,
            tries,
            known,
            base,
            base_train_rows: train.whitened(&base.point, filters),
            base_held_rows,
            base_held,
            known_held_rows,
        }
    }

    pub(super) fn thresholds(&self) -> &Thresholds {
        self.train.thresholds()
    }

    /// Return whether the stage that was searched before prefers the base to `trial` beyond chance.
    pub(super) fn contradicts(&self, trial: &Trial) -> bool {
        self.predecessor.as_ref().is_some_and(|view| view.contradicts(&trial.fit.point.twin))
    }

    /// Fit a candidate in this metric and validate it; `known` are the columns of known parameters.
    pub(super) fn trial(&self, candidate: &Candidate, rough: &Fit, known: &[Vec<f64>]) -> Trial {
        let fit = self.nested(candidate, self.fitted(candidate, rough, known));
        let fit = self.off_bounds(fit);
        let held_point = fit::on(self.held_out, &fit.point.twin, self.filters);
        let mut trial = Trial {
            candidate: candidate.clone(),
            train_rows: self.train.whitened(&fit.point, self.filters),
            held_rows: self.held_out.whitened(&held_point, self.filters),
            held_point,
            fit,
            objection: None,
        };
        trial.objection = self.objection(&trial);
        trial
    }

    /// Fit a candidate. On a table, a shape that ends on its bound is held at its start: the data do not determine it. On
    /// single axes, that named Stribeck friction in place of a dead band, and gave no right answer more.
    fn fitted(&self, candidate: &Candidate, rough: &Fit, known: &[Vec<f64>]) -> Fit {
        let how = fit::How { known, ..fit::How::minimum(self.filters, 8) };
        let fit = fit::fit_with(self.train, rough.point.clone(), &rough.slots, &how);
        let ended = on_bound_of(&fit.point.twin, slots_of_last(&fit.point.twin));
        let is_held = |slot: Slot| {
            fit.point.twin.machine == Machine::Table && candidate.effect.is_shape(slot.parameter)
        };
        let Some((shape, _)) = ended.filter(|(slot, _)| is_held(*slot)) else { return fit };
        let mut start = rough.point.clone();
        start.twin.set(shape, candidate.start[shape.parameter]);
        let slots: Vec<Slot> = rough.slots.iter().copied().filter(|slot| *slot != shape).collect();
        fit::fit_with(self.train, start, &slots, &how)
    }

    /// The fit, or one from the base with a small effect where that leaves less. The base is nested in every candidate, so a
    /// fit that leaves more than the base has stopped in another minimum.
    fn nested(&self, candidate: &Candidate, fit: Fit) -> Fit {
        if fit.loss <= fit::squared(&self.base_train_rows) {
            return fit;
        }
        let starts = with_candidate(self.train, &self.base.point, candidate, self.filters);
        let nearest = starts.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, point)| point);
        self.restarted(fit, nearest)
    }

    /// The fit, or a better one from `start`.
    fn restarted(&self, fit: Fit, start: Option<Point>) -> Fit {
        let how = fit::How::start(self.filters, RESTART_ITERATIONS);
        from_starts(self.train, fit, start, &how)
    }

    /// The fit, or a better one from the null value of an optional known parameter that ended on a bound.
    fn off_bounds(&self, fit: Fit) -> Fit {
        let ended = |slot: &Slot| on_bound_of(&fit.point.twin, [*slot]);
        let ended = self.known.iter().filter_map(ended);
        let start = ended.filter_map(|(slot, _)| at_null(&fit.point, slot)).next();
        self.restarted(fit, start)
    }

    /// Fit the trials that may be confused with the best one again, from its known parameters: a rival must not lose
    /// because its own fit stopped in another local minimum.
    pub(super) fn refit_from_best(&self, trials: &mut [Trial], known: &[Vec<f64>]) {
        let Some((best, others)) = trials.split_first_mut() else { return };
        let again = in_parallel(others, |other| {
            let instance = other.fit.point.twin.instances.last();
            let instance = instance.filter(|_| may_be_confused(best, other))?;
            let mut start = other.fit.clone();
            start.point = best.fit.point.clone();
            *start.point.twin.instances.last_mut()? = instance.clone();
            Some(self.trial(&other.candidate, &start, known))
        });
        for (other, again) in others.iter_mut().zip(again) {
            other.keep_better(again);
        }
    }

    /// Fit the best trial and its close rivals to convergence, with fresh columns for all parameters. The comparison
    /// must not depend on the number of iterations of either fit.
    pub(super) fn fit_rivals_to_convergence(&self, trials: &mut [Trial]) {
        let Some((best, others)) = trials.split_first() else { return };
        let near = self.thresholds().majority;
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let is_near =
            |other: &Trial| may_be_confused(best, other) && near * removes(best) <= removes(other);
        let mut to_convergence: Vec<bool> = others.iter().map(is_near).collect();
        to_convergence.insert(0, to_convergence.contains(&true));
        let items: Vec<(&Trial, bool)> = trials.iter().zip(to_convergence).collect();
        let again = in_parallel(&items, |(trial, to_convergence)| {
            to_convergence.then(|| self.trial(&trial.candidate, &trial.fit, &[]))
        });
        for (trial, again) in trials.iter_mut().zip(again) {
            trial.keep_better(again);
        }
    }

    pub(super) fn rejected(&self, trial: &Trial, reason: Reason) -> Rejected {
        let gain = (!self.held_out.parts.is_empty()).then(|| self.validation_gain(trial));
        let values = Some(values_of_last(&trial.fit.point.twin));
        Rejected { candidate: trial.candidate.clone(), reason, validation_gain: gain, values }
    }

    pub(super) fn added(
        &self,
        own: &Trial,
        indistinguishable: Vec<&'static str>,
        trials: &[Trial],
    ) -> Added {
        let ranked = |trial: &Trial| RankedCandidate {
            effect: trial.candidate.effect,
            axis: trial.candidate.axis,
            loss: trial.fit.loss / trial.fit.rows.max(1) as f64,
            has_passed: trial.objection.is_none(),
        };
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let is_near = |other: &Trial| self.thresholds().majority * removes(own) <= removes(other);
        let has_rival = trials
            .iter()
            .any(|other| other.candidate.effect != own.candidate.effect && is_near(other));
        Added {
            effect: own.candidate.effect,
            axis: own.candidate.axis,
            scanned: scanned(own.fit.point.twin.instances.last()),
            p_value: self.p_value(own),
            statistic: own.candidate.statistic,
            data: training_blocks(self.train),
            comparisons: self.tries,
            log_score: self.log_score_gain(own),
            validation_gain: self.validation_gain(own),
            indistinguishable,
            has_rival,
            held_out_steps: (
                self.held_out.rms(&self.base_held),
                self.held_out.rms(&own.held_point),
            ),
            unstated: None,
            ranking: trials.iter().map(ranked).collect(),
            estimates: Vec::new(),
        }
    }

    /// Probability of the gain by chance, corrected for all comparisons (Bonferroni): that of the screen. For an effect that
    /// removes most of the residual, twice that of its fit where that is smaller: such an effect is most of what the
    /// screen takes for noise. For another one that changes over a session, at least that of its fit by long blocks: it is
    /// as slow as the change from one motion to the next. Each motion has model errors of its own, which are as slow.
    pub(super) fn p_value(&self, trial: &Trial) -> f64 {
        let effect = trial.candidate.effect;
        let tries = self.tries as f64;
        let screened = (trial.candidate.p_value * tries).min(1.0);
        let (before, after) = (&self.base_train_rows, &trial.train_rows);
        let removes_most = self.thresholds().majority <= fit::explained(after, before);
        if effect.changes_over_session() && !removes_most {
            let blocks = self.train.long_blocks();
            let slow = evidence::p_value_by_long_blocks(before, after, &blocks);
            return screened.max((tries * slow).min(1.0));
        }
        if screened <= self.thresholds().family_error || !removes_most {
            return screened;
        }
        let count = effect.parameters.len();
        let fitted = evidence::p_value_of(before, after, count, &self.train.blocks());
        (2.0 * fitted * tries).min(screened)
    }

    /// Gain of the log score on the validation sessions under the residual variance that the trial leaves on the
    /// training sessions.
    fn log_score_gain(&self, trial: &Trial) -> Option<LogScoreGain> {
        let variance = fit::squared(&trial.train_rows) / trial.train_rows.len().max(1) as f64;
        let (before, after) = (&self.base_held_rows, &trial.held_rows);
        LogScoreGain::of(before, after, variance, &self.held_out.blocks())
    }

    /// Fraction of the squared residual on the validation sessions that the trial removes.
    pub(super) fn validation_gain(&self, trial: &Trial) -> f64 {
        let before = fit::squared(&self.base_held_rows);
        (before - fit::squared(&trial.held_rows)) / before.max(f64::MIN_POSITIVE)
    }

    /// Return whether the trial removes the required fraction of the squared validation error: of the whitened
    /// residual, or of the plain one, on this stage or on the witness.
    pub(super) fn exceeds_required_gain(&self, trial: &Trial) -> bool {
        let twin = &trial.fit.point.twin;
        let required_gain =
            self.required_gain.of(trial.candidate.effect, &self.supported_values(trial));
        let shows = |view: &View<'_, '_>| {
            required_gain <= self.removes(view.problem, &view.base_rows, &view.rows(twin))
        };
        required_gain <= self.removes(self.held_out, &self.known_held_rows, &trial.held_rows)
            || self.views.iter().any(shows)
    }

    /// Fraction of the squared error of `problem` that is removed between two residuals, over all signals together. One
    /// signal's fraction over `single_signal_ratio` counts where it is larger: most signals do not show most effects.
    pub(super) fn removes(&self, problem: &Problem<'_>, before: &[f64], after: &[f64]) -> f64 {
        let mut squares: Vec<[f64; 2]> = Vec::new();
        let rows = problem.parts.iter().flat_map(|part| &part.layout.rows);
        for ((row, before), after) in rows.zip(before).zip(after) {
            let channel = row.channel as usize;
            squares.resize(squares.len().max(channel + 1), [0.0; 2]);
            squares[channel][0] += before * before;
            squares[channel][1] += after * after;
        }
        let fraction = |[before, after]: &[f64; 2]| 1.0 - after / before.max(f64::MIN_POSITIVE);
        let single = squares.iter().filter(|_| self.required_gain.any_signal);
        let single = single.map(|own| fraction(own) / self.thresholds().single_signal_ratio);
        single.fold(fraction(&[fit::squared(before), fit::squared(after)]), f64::max)
    }
}

/// Data of a test on the training sessions of `train`, in words.
fn training_blocks(train: &Problem<'_>) -> String {
    let blocks = train.parts.iter().map(|part| part.layout.blocks).sum::<usize>();
    let seconds = train.parts.first().map_or(0.0, |part| part.stage.block_seconds());
    format!("training sessions, {blocks} blocks of {} s", (1e6 * seconds).round() / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        gap::{
            known::AtFloor,
            test_stage::{TestStage, axis_of_frequency, candidate, first_parameters, sines, with},
        },
        twin::{Discrepancy, Instance, Source, Stage, StageKind},
    };

    const FREQUENCY_HZ: f64 = 5.0;
    const LAG: f64 = 0.2;

    /// Stage of the camera that shows `truth`.
    fn stage(truth: &Twin, seed: u64) -> TestStage<fn(&Twin, f64) -> f64> {
        TestStage::camera(truth, sines as fn(&Twin, f64) -> f64, seed)
    }

    /// The base, and the base with a lag.
    fn twins() -> [Twin; 2] {
        let base = axis_of_frequency(FREQUENCY_HZ);
        let lagging = with(&base, "drive.lag1", LAG);
        [base, lagging]
    }

    /// Bench of a stage that shows a lag, whose base has none, and which comes after the stages `before`.
    fn with_bench<T>(before: &[&dyn Stage], of: impl Fn(&Bench<'_, '_>) -> T) -> T {
        with_validated_bench(&Twin::nominal(Machine::Axis), [before, &[]], of)
    }

    /// The same with the `given` twin, and with stages of the validation sessions.
    fn with_validated_bench<T>(
        given: &Twin,
        [before, validation]: [&[&dyn Stage]; 2],
        of: impl Fn(&Bench<'_, '_>) -> T,
    ) -> T {
        let nominal = Twin::nominal(Machine::Axis);
        let [_, lagging] = twins();
        let stage = stage(&lagging, 4);
        let train = Problem::new(&[&stage as _], &nominal);
        let (held_out, nothing) = (Problem::new(validation, &nominal), Problem::new(&[], &nominal));
        let predecessor = Problem::new(before, &nominal);
        let problems = Problems {
            train: &train,
            held_out: &held_out,
            witness: &nothing,
            predecessor: &predecessor,
        };
        let slots = first_parameters(&nominal, ["gantry.inertia"]).to_vec();
        let point = train.start(axis_of_frequency(FREQUENCY_HZ));
        let base = Fit { point, slots, loss: 0.0, rows: 2000 };
        let filters = train.filters(&base.point, whiten::scale_filters);
        let thresholds = Thresholds::DEFAULT;
        let of_stage = (given, StageKind::Camera);
        let gain = RequiredGain::new(&thresholds, of_stage, (None, None), AtFloor::No);
        of(&Bench::new(problems, (&base, Vec::new()), (&filters, &gain), 1))
    }

    /// Rough fit of the lag that stopped at this frequency (Hz).
    fn rough(bench: &Bench<'_, '_>, frequency: f64) -> Fit {
        let point = bench.train.start(with(&axis_of_frequency(frequency), "drive.lag1", LAG));
        let slots = [&bench.base.slots[..], &slots_of_last(&point.twin)].concat();
        Fit { point, slots, loss: 0.0, rows: 2000 }
    }

    fn trial(bench: &Bench<'_, '_>, rough: &Fit) -> Trial {
        bench.trial(&candidate("drive.lag1", LAG), rough, &known_columns(bench, rough))
    }

    /// Columns of the known parameters at the `rough` fit.
    fn known_columns(bench: &Bench<'_, '_>, rough: &Fit) -> Vec<Vec<f64>> {
        let at = bench.train.evaluated(rough.point.clone());
        bench.train.columns(&at, &bench.base.slots, bench.filters)
    }

    #[test]
    fn what_the_reference_recordings_showed_is_not_new() {
        let [_, lagging] = twins();
        let validation = stage(&lagging, 5);
        let objection = |lag: Option<f64>| {
            let effect = find("drive.lag1").unwrap();
            let fitted = |lag| Instance::new(effect, Axis::Single, &[lag], Source::Fitted);
            let discrepancy = Discrepancy {
                stage: StageKind::Camera,
                effect: effect.name.to_owned(),
                explained_fraction: 1e-3,
                parameter_offsets: Vec::new(),
                fitted: lag.map(fitted),
            };
            let given = Twin { discrepancy: vec![discrepancy], ..Twin::nominal(Machine::Axis) };
            with_validated_bench(&given, [&[], &[&validation]], |bench| {
                trial(bench, &rough(bench, FREQUENCY_HZ)).objection
            })
        };
        assert_eq!(objection(None), None);
        assert_eq!(objection(Some(LAG)), Some(Reason::TooSmall));
        assert_eq!(objection(Some(0.1 * LAG)), None);
    }

    #[test]
    fn a_fit_that_leaves_more_than_the_base_is_repeated_from_the_base() {
        with_bench(&[], |bench| {
            let rough = rough(bench, 5.7);
            let known = known_columns(bench, &rough);
            let alone = bench.fitted(&candidate("drive.lag1", LAG), &rough, &known);
            assert!(
                fit::squared(&bench.base_train_rows) < alone.loss,
                "the test needs a worse minimum"
            );
            let twin = trial(bench, &rough).fit.point.twin;
            let [frequency, lag] = first_parameters(&twin, ["gantry.inertia", "drive.lag1"]);
            assert!((twin.get(frequency) - FREQUENCY_HZ).abs() < 0.01, "{}", twin.get(frequency));
            assert!((twin.get(lag) - LAG).abs() < 0.05, "{}", twin.get(lag));
        });
    }

    #[test]
    fn a_stage_that_was_searched_before_contradicts_an_effect_that_it_does_not_have() {
        let contradicts = |before: &[&dyn Stage]| {
            with_bench(before, |bench| {
                bench.contradicts(&trial(bench, &rough(bench, FREQUENCY_HZ)))
            })
        };
        let [base, lagging] = twins();
        assert!(contradicts(&[&stage(&base, 5)]));
        assert!(!contradicts(&[&stage(&lagging, 6)]));
        assert!(!contradicts(&[]), "there is none");
    }
}
