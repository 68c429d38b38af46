//! What all trials of a round are measured against: fits in one metric, and what each removes.

use super::{
    Problems,
    trial::{Trial, is_alike, scanned},
};
use crate::{
    gap::{
        batch::in_parallel,
        evidence::LogScoreGain,
        fit::{self, Fit},
        known::Worth,
        problem::{Point, Problem},
        rounds::{Added, Contestant, Reason, Rejected},
        screen::Candidate,
        thresholds::Thresholds,
        whiten::{self, Filters},
    },
    twin::{Slot, Twin},
};

/// What all trials of a round are measured against.
pub(super) struct Bench<'a, 'b> {
    pub(super) train: &'b Problem<'a>,
    pub(super) held_out: &'b Problem<'a>,
    /// Where else it may show what an effect is worth, if anywhere.
    views: Vec<View<'a, 'b>>,
    /// The metric: whitening of the best candidate's residual.
    pub(super) filters: &'b Filters,
    /// One over the RMS of each signal's residual: in which a gap is told.
    pub(super) scales: Filters,
    pub(super) worth: &'b Worth<'b>,
    /// How many tries each p-value is corrected for.
    tries: usize,
    /// Fitted parameters of the given twin that a candidate may not leave on a bound.
    pub(super) known: Vec<Slot>,
    pub(super) base_train_rows: Vec<f64>,
    base_held: Point,
    pub(super) base_held_rows: Vec<f64>,
}

/// Judging sessions in plain units: every signal in units of the RMS that the base leaves.
struct View<'a, 'b> {
    problem: &'b Problem<'a>,
    scales: Filters,
    base_rows: Vec<f64>,
}

impl<'a, 'b> View<'a, 'b> {
    fn new(problem: &'b Problem<'a>, base: &Twin) -> Self {
        let scales = problem.filters(&problem.start(base.clone()), whiten::scale_filters);
        let mut view = Self { problem, scales, base_rows: Vec::new() };
        view.base_rows = view.rows(base);
        view
    }

    /// What `twin` leaves.
    fn rows(&self, twin: &Twin) -> Vec<f64> {
        let point = fit::on(self.problem, twin, &self.scales);
        self.problem.whitened(&point, &self.scales)
    }
}

impl<'a, 'b> Bench<'a, 'b> {
    pub(super) fn new(
        problems: Problems<'a, 'b>,
        (base, known): (&'b Fit, Vec<Slot>),
        (filters, worth): (&'b Filters, &'b Worth<'b>),
        tries: usize,
    ) -> Self {
        let Problems { train, held_out, witness } = problems;
        let seen = [held_out, witness].into_iter();
        let seen = seen.filter(|problem| worth.in_any_view && !problem.parts.is_empty());
        let base_held = fit::on(held_out, &base.point.twin, filters);
        Self {
            train,
            held_out,
            views: seen.map(|problem| View::new(problem, &base.point.twin)).collect(),
            filters,
            scales: train.filters(&base.point, whiten::scale_filters),
            worth,
            tries,
            known,
            base_train_rows: train.whitened(&base.point, filters),
            base_held_rows: held_out.whitened(&base_held, filters),
            base_held,
        }
    }

    pub(super) fn thresholds(&self) -> &Thresholds {
        self.train.thresholds()
    }

    /// A candidate, fitted in this metric and judged; `known` are the columns of known parameters.
    pub(super) fn trial(&self, candidate: &Candidate, rough: &Fit, known: &[Vec<f64>]) -> Trial {
        let how = fit::How { filters: self.filters, iterations: 8, known };
        let fit = fit::fit_with(self.train, rough.point.clone(), &rough.slots, &how);
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

    /// Fits what may be confused with the best trial once more from where that one ended: a rival must not lose
    /// because its own fit stopped in another valley of the known parameters.
    pub(super) fn give_second_chances(&self, trials: &mut [Trial], known: &[Vec<f64>]) {
        let Some((best, others)) = trials.split_first_mut() else { return };
        let again = in_parallel(others, |other| {
            let instance = other.fit.point.twin.instances.last();
            let instance = instance.filter(|_| is_alike(best, other))?;
            let mut start = other.fit.clone();
            start.point = best.fit.point.clone();
            *start.point.twin.instances.last_mut()? = instance.clone();
            Some(self.trial(&other.candidate, &start, known))
        });
        for (other, again) in others.iter_mut().zip(again) {
            other.take(again);
        }
    }

    /// Fits the best trial and what may be confused with it and comes near it to the end, no column known from
    /// elsewhere: which of them the data prefer must not hang on whose fit was stopped earlier.
    pub(super) fn fit_rivals_in_earnest(&self, trials: &mut [Trial]) {
        let Some((best, others)) = trials.split_first() else { return };
        let near = self.thresholds().majority;
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let is_near =
            |other: &Trial| is_alike(best, other) && near * removes(best) <= removes(other);
        let mut in_earnest: Vec<bool> = others.iter().map(is_near).collect();
        in_earnest.insert(0, in_earnest.contains(&true));
        let items: Vec<(&Trial, bool)> = trials.iter().zip(in_earnest).collect();
        let again = in_parallel(&items, |(trial, in_earnest)| {
            in_earnest.then(|| self.trial(&trial.candidate, &trial.fit, &[]))
        });
        for (trial, again) in trials.iter_mut().zip(again) {
            trial.take(again);
        }
    }

    pub(super) fn rejected(&self, trial: &Trial, reason: Reason) -> Rejected {
        let gain = (!self.held_out.parts.is_empty()).then(|| self.validation_gain(trial));
        Rejected { candidate: trial.candidate.clone(), reason, validation_gain: gain }
    }

    pub(super) fn added(&self, own: &Trial, class: Vec<&'static str>, trials: &[Trial]) -> Added {
        let contestant = |trial: &Trial| Contestant {
            effect: trial.candidate.effect,
            axis: trial.candidate.axis,
            loss: trial.fit.loss / trial.fit.rows.max(1) as f64,
            has_passed: trial.objection.is_none(),
        };
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
            class,
            held_out_steps: (
                self.held_out.rms(&self.base_held),
                self.held_out.rms(&own.held_point),
            ),
            unstated: None,
            contest: trials.iter().map(contestant).collect(),
            numbers: Vec::new(),
        }
    }

    /// Probability of what its effect explains by chance, corrected for all tries (Bonferroni).
    pub(super) fn p_value(&self, trial: &Trial) -> f64 {
        (trial.candidate.p_value * self.tries as f64).min(1.0)
    }

    /// Gain of the log score on the validation sessions under the residual variance that the trial leaves on the
    /// training sessions.
    fn log_score_gain(&self, trial: &Trial) -> Option<LogScoreGain> {
        let variance = fit::squared(&trial.train_rows) / trial.train_rows.len().max(1) as f64;
        let (before, after) = (&self.base_held_rows, &trial.held_rows);
        LogScoreGain::of(before, after, variance, &self.held_out.blocks())
    }

    /// Fraction of the squared residual on the validation sessions that the trial removes.
    fn validation_gain(&self, trial: &Trial) -> f64 {
        let before = fit::squared(&self.base_held_rows);
        (before - fit::squared(&trial.held_rows)) / before.max(f64::MIN_POSITIVE)
    }

    /// Whether the trial removes the share of the squared error of the judging sessions that makes its effect worth
    /// a name: of the whitened residual, or of the residual as it is, there or on the witness.
    pub(super) fn is_worth_naming(&self, trial: &Trial) -> bool {
        let twin = &trial.fit.point.twin;
        let worth = self.worth.of(trial.candidate.effect, &self.shown_numbers(trial));
        let shows = |view: &View<'_, '_>| {
            worth <= self.removes(view.problem, &view.base_rows, &view.rows(twin))
        };
        worth <= self.removes(self.held_out, &self.base_held_rows, &trial.held_rows)
            || self.views.iter().any(shows)
    }

    /// The share of the squared error of `problem` between two residuals that is removed of all signals
    /// together, or that of one signal over `single_signal_ratio`: most signals do not show most effects.
    pub(super) fn removes(&self, problem: &Problem<'_>, before: &[f64], after: &[f64]) -> f64 {
        let mut squares: Vec<[f64; 2]> = Vec::new();
        let rows = problem.parts.iter().flat_map(|part| &part.layout.rows);
        for ((row, before), after) in rows.zip(before).zip(after) {
            let channel = row.channel as usize;
            squares.resize(squares.len().max(channel + 1), [0.0; 2]);
            squares[channel][0] += before * before;
            squares[channel][1] += after * after;
        }
        let share = |[before, after]: &[f64; 2]| 1.0 - after / before.max(f64::MIN_POSITIVE);
        let single = squares.iter().filter(|_| self.worth.in_any_view);
        let single = single.map(|own| share(own) / self.thresholds().single_signal_ratio);
        single.fold(share(&[fit::squared(before), fit::squared(after)]), f64::max)
    }
}

/// Data of a test on the training sessions of `train`, in words.
fn training_blocks(train: &Problem<'_>) -> String {
    let blocks = train.parts.iter().map(|part| part.layout.blocks).sum::<usize>();
    let seconds = train.parts.first().map_or(0.0, |part| part.stage.block_seconds());
    format!("training sessions, {blocks} blocks of {} s", (1e6 * seconds).round() / 1e6)
}
