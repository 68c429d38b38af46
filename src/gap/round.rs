//! One round of the search on one link: screen, simulate the best again, judge, choose.

use super::{
    batch::in_parallel,
    direct,
    evidence::{Amplitude, Blocks, LogScoreGain},
    fit::{self, Fit},
    known::Worth,
    observer::SearchStep,
    problem::{Point, Problem, dot},
    rounds::{Added, Contestant, Reason, Rejected, known_on_bound},
    screen::{self, Candidate},
    steady::{self, Seen},
    thresholds::Thresholds,
    whiten::{self, Filters},
};
use crate::twin::{Instance, Machine, Slot, StageKind, Twin};
use std::mem;

/// Candidates that are simulated again in one round.
const SHORT_LIST: usize = 7;

/// The same of those that alone bring the given twin nearest to the data.
const FROM_GIVEN: usize = 4;

/// Places of one effect that are simulated again in one round.
const PLACES_OF_ONE: usize = 2;

/// So many probes of an effect say that its size has no slope.
const MANY_PROBES: usize = 6;

/// Places at which an effect that sits in one is fitted beside the place to which the screen leads.
const OTHER_PLACES: usize = 3;

/// Iterations of a fit of an effect without some of its parameters.
const PARTS_ITERATIONS: usize = 12;

/// Share of the squared error by which a start must change it to do anything at all.
const IDLE: f64 = 1e-9;

/// Factors of a size without slope that are tried beside it, and how often.
const AWAY: [f64; 8] = [0.7, 0.82, 0.9, 0.96, 1.04, 1.1, 1.2, 1.4];
const ACROSS_STEPS: usize = 3;

/// A candidate, simulated and fitted.
struct Trial {
    candidate: Candidate,
    fit: Fit,
    /// Whitened residuals of fitted and judging sessions.
    train_rows: Vec<f64>,
    held_rows: Vec<f64>,
    held_point: Point,
    /// Why it may not be named.
    objection: Option<Reason>,
}

/// A trial and how many [free numbers](Bench::free_numbers) its effect has.
type Counted<'t> = (&'t Trial, usize);

impl Trial {
    fn log(&self) {
        let Candidate { effect, axis, .. } = &self.candidate;
        let (numbers, loss) = (numbers_of_last(&self.fit.point.twin), self.fit.loss);
        log::debug!("{} on {axis}: {numbers:?} leave {loss}, {:?}", effect.name, self.objection);
    }

    /// Takes another fit of the same where it is better.
    fn take(&mut self, again: Option<Self>) {
        if let Some(again) = again.filter(|again| again.fit.loss < self.fit.loss) {
            *self = again;
        }
    }
}

/// The best first.
fn in_order(trials: &mut [Trial]) {
    trials.sort_by(|a, b| a.fit.loss.total_cmp(&b.fit.loss));
}

/// Squared distance of two residuals.
fn apart(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| (one - other).powi(2)).sum()
}

/// Whether the effects of two trials may be confused.
fn is_alike(one: &Trial, other: &Trial) -> bool {
    let (one, other) = (one.candidate.effect, other.candidate.effect);
    one.confused_with.contains(&other.name) || other.confused_with.contains(&one.name)
}

/// One round: screen, simulate, decide.
pub(super) struct Round {
    pub(super) winner: Option<(Fit, Added)>,
    pub(super) rejected: Vec<Rejected>,
}

/// Where a round begins.
#[derive(Clone, Copy)]
pub(super) struct Stand<'p> {
    /// The twin so far, everything fitted.
    pub(super) base: &'p Fit,
    /// Whitening of its residual.
    pub(super) filters: &'p Filters,
    /// The given twin as it was, before anything was fitted or added.
    pub(super) given: Option<&'p (Fit, Filters)>,
    /// Number of instances in the given twin.
    pub(super) given_instances: usize,
    /// What makes an effect worth a name.
    pub(super) worth: Worth<'p>,
}

impl Stand<'_> {
    /// Fitted parameters of the given twin that no candidate may leave on a bound: those of the rigid body of a single
    /// axis. On a table, an effect of the given twin may end there because another takes its place.
    fn known(&self) -> Vec<Slot> {
        if self.base.point.twin.machine == Machine::Table {
            return Vec::new();
        }
        let slots = self.base.slots.iter().copied();
        slots.filter(|slot| slot.instance < self.given_instances).collect()
    }
}

/// What a round looks at.
#[derive(Clone, Copy)]
pub(super) struct Problems<'a, 'b> {
    /// The link on the fitted sessions.
    pub(super) train: &'b Problem<'a>,
    /// The link on the judging sessions.
    pub(super) held_out: &'b Problem<'a>,
    /// Another link on the judging sessions, on which the same effects act for longer.
    pub(super) witness: &'b Problem<'a>,
}

impl Round {
    pub(super) fn run(problems: Problems<'_, '_>, stand: &Stand<'_>) -> Self {
        let Stand { base, filters, given, worth, .. } = *stand;
        let known_slots = stand.known();
        let train = problems.train;
        let candidates = screen::screen(train, base, filters);
        let tries: usize = candidates.iter().map(|candidate| candidate.tries).sum();
        let (mut rejected, mut short) = short_list(candidates, tries, train.thresholds());
        if let Some((given, filters)) = given {
            let nearest = direct::nearest(train, (given, filters), &base.point);
            for candidate in nearest.into_iter().take(FROM_GIVEN) {
                let same =
                    |own: &Candidate| own.effect == candidate.effect && own.axis == candidate.axis;
                if let Some(own) = short.iter_mut().find(|own| same(own)) {
                    own.start = candidate.start;
                    own.is_as_good_as_refit = candidate.is_as_good_as_refit;
                } else {
                    rejected.retain(|other| !same(&other.candidate));
                    short.push(candidate);
                }
            }
        }
        // First in the metric of the base residual, then in that of the best candidate's.
        let observer = train.context.observer;
        // Each is fitted twice: roughly, and in the metric of the best.
        observer.step_begun(SearchStep::Trial, 2 * short.len());
        let rough = rough_fits(train, stand, &short);
        // What is no effect is no metric either.
        let is_driven = |fit: &Fit| known_on_bound(&fit.point.twin, &known_slots);
        let sound = |fit: &&Fit| {
            fit.loss.is_finite() && on_bound(fit).is_none() && is_driven(fit).is_none()
        };
        let lead = rough.iter().filter(sound).min_by(|a, b| a.loss.total_cmp(&b.loss));
        let Some(lead) = lead.or(rough.first()) else { return Self { winner: None, rejected } };
        let sharp = train.filters(&lead.point, whiten::fit_filters);
        let at_lead = train.evaluated(lead.point.clone());
        let known = train.columns(&at_lead, &base.slots, &sharp);
        let bench = Bench::new(problems, (base, known_slots), (&sharp, &worth), tries);
        let items: Vec<(Candidate, Fit)> =
            short.into_iter().zip(rough).filter(|(_, fit)| fit.loss.is_finite()).collect();
        let mut trials = in_parallel(&items, |(candidate, rough)| {
            let trial = bench.trial(candidate, rough, &known);
            observer.candidate_done();
            trial
        });
        in_order(&mut trials);
        bench.give_second_chances(&mut trials, &known);
        in_order(&mut trials);
        bench.fit_rivals_in_earnest(&mut trials);
        in_order(&mut trials);
        let worth_naming = bench.worth_naming(&trials);
        for trial in &trials {
            trial.log();
            let is_in = worth_naming.iter().any(|own| std::ptr::eq(*own, trial));
            if let Some(reason) = trial.objection.as_ref().filter(|_| !is_in) {
                rejected.push(bench.rejected(trial, reason.clone()));
            }
        }
        let winner = bench.winner(&worth_naming, &trials, &mut rejected);
        Self { winner, rejected }
    }
}

/// Fits of all on the short list, each from the nearest of its starts.
fn rough_fits(train: &Problem<'_>, stand: &Stand<'_>, short: &[Candidate]) -> Vec<Fit> {
    let columns =
        |fit: &Fit| train.columns(&train.evaluated(fit.point.clone()), &fit.slots, stand.filters);
    let mut bases = vec![(stand.base, columns(stand.base))];
    bases.extend(stand.given.map(|(given, _)| (given, columns(given))));
    in_parallel(short, |candidate| {
        let fit = fitted(train, &bases, candidate, stand.filters);
        train.context.observer.candidate_done();
        fit
    })
}

/// Who is simulated again, and why the others are not.
fn short_list(
    candidates: Vec<Candidate>,
    tries: usize,
    thresholds: &Thresholds,
) -> (Vec<Rejected>, Vec<Candidate>) {
    let threshold = thresholds.family_error / tries.max(1) as f64;
    let visible = thresholds.detectability;
    let mut rejected = Vec::new();
    let mut short: Vec<Candidate> = Vec::new();
    let best = candidates
        .iter()
        .filter(|candidate| candidate.p_value < threshold)
        .map(|candidate| candidate.share)
        .fold(0.0, f64::max);
    for candidate in candidates {
        let is_seen = candidate.p_value < threshold;
        let places = short.iter().filter(|other| other.effect == candidate.effect).count();
        let usually_shown = candidate.visibility * screen::usual_share(candidate.effect);
        let reason = if candidate.visibility < visible || !is_seen && usually_shown < visible {
            Reason::NotTestable
        } else if !is_seen {
            Reason::NotSignificant
        } else if short.len() < SHORT_LIST
            && thresholds.clear_gain * best <= candidate.share
            && (screen::is_shared(candidate.axis) || places < PLACES_OF_ONE)
        {
            short.push(candidate);
            continue;
        } else {
            Reason::Outdone(short.first().map_or("", |first| first.effect.name).to_owned())
        };
        rejected.push(Rejected { candidate, reason, validation_gain: None });
    }
    (rejected, short)
}

/// The candidate's effect added to each of several bases at the nearest of its sizes, everything fitted together, and
/// the best of that: what known parameters have made up for may lead astray. With each base come the columns of its
/// known parameters.
fn fitted(
    train: &Problem<'_>,
    bases: &[(&Fit, Vec<Vec<f64>>)],
    candidate: &Candidate,
    filters: &Filters,
) -> Fit {
    // The line of the screen may lead too far for what bends: what is nearer to nothing is a start too.
    let sizes = screen::towards_null(candidate);
    let fits = bases.iter().filter_map(|(base, known)| {
        let nothing = fit::squared(&train.whitened(&base.point, filters));
        let starts = sizes.iter().map(|values| {
            let twin = screen::with(&base.point.twin, candidate.effect, candidate.axis, values);
            let point = Point { twin, nuisance: base.point.nuisance.clone() };
            let loss = fit::squared(&train.whitened(&point, filters));
            // From a limit that is never reached no slope leads anywhere.
            let is_idle = (loss - nothing).abs() <= IDLE * nothing;
            (is_idle, loss, point)
        });
        let (.., point) = starts.min_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))?;
        let mut slots = bases[0].0.slots.clone();
        slots.extend(slots_of_last(&point.twin));
        let how = fit::How { filters, iterations: 10, known };
        Some((fit::fit_with(train, point, &slots, &how), how))
    });
    let best = fits.min_by(|a, b| a.0.loss.total_cmp(&b.0.loss));
    let (found, how) = best.expect("there is a base, and sizes to start from");
    let found = from_other_starts(train, found, candidate, &how);
    if candidate.effect.probes.len() < MANY_PROBES {
        return found;
    }
    // Whole rolls have valleys everywhere: what happens early in one is amplified.
    let is_whole = train.parts.iter().any(|part| part.stage.kind() == StageKind::WholeRolls);
    let found = match candidate.effect.is_localized() && !is_whole {
        true => from_other_places(train, found, candidate, &how),
        false => found,
    };
    across_steps(train, found, &how)
}

/// The fit, or a better one from the other values of a parameter that was scanned for.
fn from_other_starts(
    train: &Problem<'_>,
    found: Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let starts: Vec<Point> =
        candidate.other_starts.iter().map(|start| with_last(&found.point, start)).collect();
    from_starts(train, found, starts, how)
}

/// The fit, or a better one from another place of an effect that sits in one: from afar nothing leads there.
fn from_other_places(
    train: &Problem<'_>,
    found: Fit,
    candidate: &Candidate,
    how: &fit::How<'_>,
) -> Fit {
    let tries = candidate.effect.probes.iter().map(|probe| {
        let point = with_last(&found.point, probe);
        (fit::squared(&train.whitened(&point, how.filters)), point)
    });
    let mut tries: Vec<_> = tries.collect();
    tries.sort_by(|a, b| a.0.total_cmp(&b.0));
    let starts = tries.into_iter().take(OTHER_PLACES).map(|(_, point)| point).collect();
    from_starts(train, found, starts, how)
}

/// `point` with the numbers `values` of the effect that was added last.
fn with_last(point: &Point, values: &[f64]) -> Point {
    let mut point = point.clone();
    let slots = slots_of_last(&point.twin);
    slots.iter().zip(values).for_each(|(slot, value)| point.twin.set(*slot, *value));
    point
}

/// The fit, or the best one from `starts` where that is better.
fn from_starts(train: &Problem<'_>, found: Fit, starts: Vec<Point>, how: &fit::How<'_>) -> Fit {
    let fits = starts.into_iter().map(|point| fit::fit_with(train, point, &found.slots, how));
    let best = fits.min_by(|a, b| a.loss.total_cmp(&b.loss));
    best.filter(|best| best.loss < found.loss).unwrap_or(found)
}

/// The fit, or a better one found by trying the size of the last effect at several distances: a threshold has no
/// slope to follow between two values at which something passes it.
fn across_steps(train: &Problem<'_>, mut found: Fit, how: &fit::How<'_>) -> Fit {
    for _ in 0..ACROSS_STEPS {
        let Some(size) = slots_of_last(&found.point.twin).first().copied() else { break };
        let tries = AWAY.map(|factor| {
            let mut point = found.point.clone();
            point.twin.set(size, factor * found.point.twin.get(size));
            (fit::squared(&train.whitened(&point, how.filters)), point)
        });
        let nearest = tries.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        let nearest = nearest.filter(|(loss, _)| *loss < found.loss);
        let Some((_, point)) = nearest else { break };
        found = fit::fit_with(train, point, &found.slots, how);
    }
    found
}

/// Slots of the instance that was added last.
pub(super) fn slots_of_last(twin: &Twin) -> Vec<Slot> {
    let instance = twin.instances.len() - 1;
    (0..twin.instances[instance].values.len())
        .map(|parameter| Slot { instance, parameter })
        .collect()
}

/// The numbers of the instance that was added last.
pub(super) fn numbers_of_last(twin: &Twin) -> Vec<f64> {
    slots_of_last(twin).into_iter().map(|slot| twin.get(slot)).collect()
}

/// The first of them: the size of its effect.
fn size_of_last(twin: &Twin) -> Option<f64> {
    numbers_of_last(twin).first().copied()
}

/// What all trials of a round are measured against.
struct Bench<'a, 'b> {
    train: &'b Problem<'a>,
    held_out: &'b Problem<'a>,
    /// Where else it may show what an effect is worth, if anywhere.
    views: Vec<View<'a, 'b>>,
    /// The metric: whitening of the best candidate's residual.
    filters: &'b Filters,
    /// One over the RMS of each signal's residual: in which a gap is told.
    scales: Filters,
    worth: &'b Worth<'b>,
    /// How many tries each p-value is corrected for.
    tries: usize,
    /// Fitted parameters of the given twin that a candidate may not leave on a bound.
    known: Vec<Slot>,
    base_train_rows: Vec<f64>,
    base_held: Point,
    base_held_rows: Vec<f64>,
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
    fn new(
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

    fn thresholds(&self) -> &Thresholds {
        self.train.thresholds()
    }

    /// A candidate, fitted in this metric and judged; `known` are the columns of known parameters.
    fn trial(&self, candidate: &Candidate, rough: &Fit, known: &[Vec<f64>]) -> Trial {
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
    fn give_second_chances(&self, trials: &mut [Trial], known: &[Vec<f64>]) {
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
    fn fit_rivals_in_earnest(&self, trials: &mut [Trial]) {
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

    fn rejected(&self, trial: &Trial, reason: Reason) -> Rejected {
        let gain = (!self.held_out.parts.is_empty()).then(|| self.validation_gain(trial));
        Rejected { candidate: trial.candidate.clone(), reason, validation_gain: gain }
    }

    fn added(&self, own: &Trial, class: Vec<&'static str>, trials: &[Trial]) -> Added {
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
    fn p_value(&self, trial: &Trial) -> f64 {
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
    fn is_worth_naming(&self, trial: &Trial) -> bool {
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
    fn removes(&self, problem: &Problem<'_>, before: &[f64], after: &[f64]) -> f64 {
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

    /// Whether what makes the effect is hardly needed beside the numbers that shape it: with its size at nothing the
    /// others explain most of what it explains, and it is another effect that the sessions show.
    fn is_as_good_without_size(&self, trial: &Trial) -> bool {
        let size = slots_of_last(&trial.fit.point.twin).into_iter().next();
        match size.filter(|_| trial.candidate.effect.has_shape_parameters()) {
            Some(size) => !self.carry_most(trial, &[size]),
            None => false,
        }
    }

    /// Whether a number that comes beside the effect, such as the friction of a striker on a soft magnet, carries most
    /// of what the effect explains: then it is another effect that the sessions show.
    fn is_carried_by_option(&self, trial: &Trial) -> bool {
        let (twin, effect) = (&trial.fit.point.twin, trial.candidate.effect);
        let is_used = |slot: &Slot| effect.is_optional(slot.parameter) && twin.get(*slot) != 0.0;
        let optional: Vec<Slot> = slots_of_last(twin).into_iter().filter(is_used).collect();
        !optional.is_empty() && self.carry_most(trial, &optional)
    }

    /// Whether most of what `trial` explains is lost without `parts` of its effect, when all other parameters are fitted
    /// again.
    fn carry_most(&self, trial: &Trial, parts: &[Slot]) -> bool {
        let own = slots_of_last(&trial.fit.point.twin);
        let without = |gone: &[Slot]| {
            let mut point = trial.fit.point.clone();
            for slot in gone {
                point.twin.set_to_null(*slot);
            }
            point
        };
        let (rest, nothing) = (without(parts), without(&own));
        let rows = |point: &Point| self.train.whitened(point, self.filters);
        let change = apart(&rows(&nothing), &trial.train_rows);
        if apart(&rows(&rest), &rows(&nothing)) <= IDLE * change {
            return true;
        }
        let refitted = |point: Point, gone: &[Slot]| {
            let slots = trial.fit.slots.iter().copied();
            let others: Vec<Slot> = slots.filter(|slot| !gone.contains(slot)).collect();
            fit::fit(self.train, point, &others, self.filters, PARTS_ITERATIONS).point.twin
        };
        let (rest, nothing) = (refitted(rest, parts), refitted(nothing, &own));
        let needs = |problem: &Problem<'_>, with: &[f64]| {
            let rows =
                |twin: &Twin| problem.whitened(&fit::on(problem, twin, self.filters), self.filters);
            let without = rows(&rest);
            let [nothing, rest, all] = [&rows(&nothing), &without, with].map(fit::squared);
            self.thresholds().is_in(&without, with, &problem.blocks())
                && (nothing - rest).max(0.0) <= rest - all
        };
        let held_out = self.held_out;
        (held_out.parts.is_empty() || needs(held_out, &trial.held_rows))
            && needs(self.train, &trial.train_rows)
    }

    /// Whether what the effect does is rather in proportion to the speed, beside what its physics says.
    fn grows_with_speed(&self, trial: &Trial) -> bool {
        if !steady::are_speeds_known(self.train) {
            return false;
        }
        let mut twin = trial.fit.point.twin.clone();
        for slot in slots_of_last(&trial.fit.point.twin) {
            twin.set_to_null(slot);
        }
        let without = |problem: &Problem<'_>| {
            problem.whitened(&fit::on(problem, &twin, self.filters), self.filters)
        };
        let [train, held] = [without(self.train), without(self.held_out)];
        steady::grows_with_speed([
            Seen { problem: self.train, without: &train, with: &trial.train_rows },
            Seen { problem: self.held_out, without: &held, with: &trial.held_rows },
        ])
    }

    /// Why the trial may not be named; `None` when it may.
    fn objection(&self, trial: &Trial) -> Option<Reason> {
        let thresholds = self.thresholds();
        let known = || known_on_bound(&trial.fit.point.twin, &self.known);
        if let Some(name) = on_bound(&trial.fit).or_else(|| wrong_sign(&trial.fit)).or_else(known) {
            return Some(Reason::OnBound(name));
        }
        if thresholds.family_error < self.p_value(trial) {
            return Some(Reason::NotSignificant);
        }
        if !thresholds.is_in(&self.base_train_rows, &trial.train_rows, &self.train.blocks()) {
            // What known parameters imitate, one way or the other, is not shown.
            return Some(match trial.candidate.is_as_good_as_refit {
                true => Reason::NotTestable,
                false => Reason::NotSignificant,
            });
        }
        if self.is_as_good_without_size(trial) || self.is_carried_by_option(trial) {
            return Some(Reason::NotSignificant);
        }
        if self.held_out.parts.is_empty() {
            let worth = self.worth.of(trial.candidate.effect, &self.shown_numbers(trial));
            let gain = self.removes(self.train, &self.base_train_rows, &trial.train_rows);
            return (gain < worth).then_some(Reason::TooSmall);
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
        if self.grows_with_speed(trial) {
            return Some(Reason::SpeedsDisagree);
        }
        let is_old = size_of_last(&trial.fit.point.twin)
            .is_some_and(|size| self.worth.was_there_before(trial.candidate.effect, size));
        (is_old || !self.is_worth_naming(trial)).then_some(Reason::TooSmall)
    }

    /// The one to add, with what explains the data as well; all others are rejected.
    fn winner(
        &self,
        passed: &[&Trial],
        trials: &[Trial],
        rejected: &mut Vec<Rejected>,
    ) -> Option<(Fit, Added)> {
        let free = in_parallel(passed, |trial| self.free_numbers(trial));
        let counted: Vec<Counted<'_>> = passed.iter().copied().zip(free).collect();
        let (own, free) = self.strongest(self.simplest(&counted)?, &counted);
        let mut class = Vec::new();
        for (other, numbers) in counted.iter().filter(|(other, _)| !std::ptr::eq(*other, own)) {
            let name = other.candidate.effect.name;
            let is_as_good =
                *numbers <= free && self.is_rival(own, other) && self.is_rival(other, own);
            if name != own.candidate.effect.name && is_as_good {
                if !class.contains(&name) {
                    class.push(name);
                }
            } else {
                let winner = own.candidate.effect.name.to_owned();
                rejected.push(self.rejected(other, Reason::Outdone(winner)));
            }
        }
        Some((own.fit.clone(), self.added(own, class, trials)))
    }

    /// What passed, the clearest first, and what explains the data as well as the clearest and was only not worth a
    /// name: where two cannot be told apart, what is known of one of them is known of neither.
    fn worth_naming<'t>(&self, trials: &'t [Trial]) -> Vec<&'t Trial> {
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

    /// Of the best that passed and what is nearly as good, the one with the fewest numbers that are needed; of equals
    /// the one whose law has no others, and so says that they are none; of these the best.
    fn simplest<'t>(&self, passed: &[Counted<'t>]) -> Option<Counted<'t>> {
        let (best, free) = *passed.first()?;
        let stands = |(other, numbers): &Counted<'_>| {
            std::ptr::eq(*other, best)
                || self.is_rival(best, other)
                || *numbers < free && self.is_nearly_as_good(best, other)
        };
        let complexity = |(own, needed): &Counted<'_>| {
            let effect = own.candidate.effect;
            let all = 0..effect.parameters.len();
            (*needed, all.filter(|parameter| !effect.is_optional(*parameter)).count())
        };
        passed.iter().copied().filter(stands).min_by_key(complexity)
    }

    /// How many numbers of the effect do something that is beyond chance: a spring that does not soften has no length
    /// at which it does. Numbers that only come beside the effect do not count.
    fn free_numbers(&self, trial: &Trial) -> usize {
        let effect = trial.candidate.effect;
        let own = slots_of_last(&trial.fit.point.twin).into_iter();
        own.filter(|slot| !effect.is_optional(slot.parameter) && self.does_something(trial, *slot))
            .count()
    }

    /// Whether the parameter `slot` changes the prediction beyond chance.
    fn does_something(&self, trial: &Trial, slot: Slot) -> bool {
        let change = apart(&self.base_train_rows, &trial.train_rows);
        let mut point = trial.fit.point.clone();
        point.twin.set_to_null(slot);
        let without = self.train.whitened(&point, self.filters);
        self.thresholds().equal_prediction * change <= apart(&without, &trial.train_rows)
            && self.thresholds().is_in(&without, &trial.train_rows, &self.train.blocks())
    }

    /// The numbers of the effect; those that shape it and do nothing beyond chance at their null values.
    fn shown_numbers(&self, trial: &Trial) -> Vec<f64> {
        let twin = &trial.fit.point.twin;
        let effect = trial.candidate.effect;
        let shown = |slot: Slot| match slot.parameter {
            0 => twin.get(slot),
            _ if self.does_something(trial, slot) => twin.get(slot),
            shape => effect.null[shape],
        };
        slots_of_last(twin).into_iter().map(shown).collect()
    }

    /// Whether `other` describes the same joint of the chain as `own`, may be confused with it, changes the prediction
    /// alike and removes nearly as much.
    fn is_nearly_as_good(&self, own: &Trial, other: &Trial) -> bool {
        let removes = |trial: &Trial| fit::squared(&self.base_train_rows) - trial.fit.loss;
        let joint = |trial: &Trial| {
            trial.candidate.effect.physics.equations().first().map(mem::discriminant)
        };
        joint(own) == joint(other)
            && is_alike(own, other)
            && self.is_same(own, other)
            && (1.0 - self.thresholds().min_gain) * removes(own) <= removes(other)
    }

    /// The strongest goes first: of effects that explain different things it is not `best`, which the whitened
    /// residual shows most clearly, but one that closes far more of the gap.
    fn strongest<'t>(&self, best: Counted<'t>, passed: &[Counted<'t>]) -> Counted<'t> {
        let most = self.thresholds().stronger_ratio * self.closes(best.0);
        let far_stronger = passed.iter().map(|own| (self.closes(own.0), *own));
        far_stronger
            .filter(|(closes, _)| most < *closes)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(best, |(_, own)| own)
    }

    /// Share of the squared gap on the fitted sessions, every signal in units of its RMS, that the trial closes.
    fn closes(&self, trial: &Trial) -> f64 {
        1.0 - fit::squared(&self.train.whitened(&trial.fit.point, &self.scales))
            / self.train.rows().max(1) as f64
    }

    /// Whether `other` explains the same as `own` and all sessions as well.
    fn is_rival(&self, own: &Trial, other: &Trial) -> bool {
        if !self.is_same(own, other) {
            return false;
        }
        let thresholds = self.thresholds();
        let blocks = Blocks::joined(&[self.train.blocks(), self.held_out.blocks()]);
        let all = |trial: &Trial| [trial.train_rows.as_slice(), &trial.held_rows].concat();
        let (own, other) = (all(own), all(other));
        let base = [self.base_train_rows.as_slice(), &self.base_held_rows].concat();
        apart(&own, &other) < thresholds.equal_prediction * apart(&base, &own)
            || !Amplitude::of(&other, &own, &blocks)
                .is_above(thresholds.min_amplitude, thresholds.confirmation_level)
    }

    /// Whether the two change the prediction alike: what has most of its change for itself explains something else,
    /// however well.
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

/// Value of the parameter of `instance` that is scanned for.
fn scanned(instance: Option<&Instance>) -> Option<f64> {
    let instance = instance?;
    let parameter = instance.effect.scanned_parameter()?;
    Some(instance.values[parameter].value)
}

/// Data of a test on the training sessions of `train`, in words.
fn training_blocks(train: &Problem<'_>) -> String {
    let blocks = train.parts.iter().map(|part| part.layout.blocks).sum::<usize>();
    let seconds = train.parts.first().map_or(0.0, |part| part.stage.block_seconds());
    format!("training sessions, {blocks} blocks of {} s", (1e6 * seconds).round() / 1e6)
}

/// The size of the added effect where it is below nothing though the effect has one sign only: commands do not
/// take effect before they are sent, though a fit may move a clock so.
fn wrong_sign(fit: &Fit) -> Option<String> {
    let effect = fit.point.twin.instances.last()?.effect;
    let parameter = effect.parameters.first()?;
    let one_sign = effect.null[0] == 0.0 && 0.0 <= parameter.plausible.0;
    (one_sign && size_of_last(&fit.point.twin)? < 0.0).then(|| parameter.name.to_owned())
}

/// The first parameter of the added effect that stopped on a bound. Of several the later ones may do nothing, or
/// shape the effect up to a bound that is plausible itself (contacts that do not creep).
fn on_bound(fit: &Fit) -> Option<String> {
    let twin = &fit.point.twin;
    on_bound_of(twin, slots_of_last(twin)).map(|(_, name)| name)
}

/// The same of an effect with these slots.
pub(super) fn on_bound_of(
    twin: &Twin,
    slots: impl IntoIterator<Item = Slot>,
) -> Option<(Slot, String)> {
    slots.into_iter().find_map(|slot| {
        let effect = twin.instances[slot.instance].effect;
        let parameter = &effect.parameters[slot.parameter];
        let (value, (low, high)) = (twin.get(slot), parameter.bounds);
        let near = 1e-6 * (high - low);
        let does_nothing =
            0 < slot.parameter && (value - effect.null[slot.parameter]).abs() <= near;
        let (least, most) = parameter.plausible;
        let is_limit = 0 < slot.parameter
            && (value <= low + near && least <= low || high - near <= value && high <= most);
        let is_on = value <= low + near || high - near <= value;
        (is_on && !does_nothing && !is_limit).then(|| (slot, parameter.name.to_owned()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        effects::{Axis, find},
        twin::Machine,
    };

    /// A fit that ended with the effect called `name` at `values`.
    fn ended(name: &str, axis: Axis, values: &[f64]) -> Fit {
        let effect = find(name).unwrap();
        let twin = screen::with(&Twin::nominal(Machine::Table), effect, axis, values);
        Fit { point: Point { twin, nuisance: vec![] }, slots: vec![], loss: 0.0, rows: 0 }
    }

    #[test]
    fn a_size_on_its_bound_is_no_effect_and_a_later_number_at_nothing_is_none_of_it() {
        let bound =
            |values: &[f64]| on_bound(&ended("ball.rolling_resistance", Axis::Whole, values));
        assert_eq!(bound(&[0.0, 0.1]), Some("coefficient".to_owned()));
        assert_eq!(bound(&[0.3, 0.1]), Some("coefficient".to_owned()));
        assert_eq!(bound(&[0.01, 5.0]), Some("viscous_per_s".to_owned()));
        assert_eq!(bound(&[0.01, 0.0]), None);
    }

    #[test]
    fn commands_do_not_act_before_they_are_sent() {
        let wrong = |values: &[f64]| wrong_sign(&ended("drive.delay", Axis::Motors, values));
        assert_eq!(wrong(&[-5e-5]), Some("delay_s".to_owned()));
        assert_eq!(wrong(&[5e-5]), None);
        // Tilt has both signs; a gain below one is one.
        assert_eq!(wrong_sign(&ended("ball.tilt", Axis::Whole, &[-0.001, 0.0])), None);
        assert_eq!(wrong_sign(&ended("drive.gain", Axis::Motors, &[0.9])), None);
    }
}
