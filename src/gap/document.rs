//! Document `gap.json` from the outcomes of all stages.

mod sparse;

use super::{
    checks::Objection,
    experiment::{self, Setup},
    explain::{identified, significant},
    find::{changed, stages},
    findings::{
        Document, IdentifiedEffect, Indistinguishable, ParameterChange, RejectedEffect,
        SCHEMA_VERSION, SignalResidual, Verdict,
    },
    floor::{Floor, FloorSource},
    incident::Incident,
    journal::{JournalEntry, MoveKind},
    known::{added_lag, lag, sample_period_above_lag},
    locate,
    magnitude::{Magnitude, Scale},
    page::text::dependence,
    problem::Point,
    rounds::{self, Added, Outcome, Reason},
    thresholds::Thresholds,
    verdict::{Answer, Findings},
};
use crate::{
    effects::{Effect, Parameter, Physics},
    recording::Split,
    stats::t_quantile,
    twin::{Instance, Machine, Session, Slot, Source, StageKind, Twin, Value},
};

/// Everything from which the document is made.
pub(super) struct Material<'f, 'a> {
    /// The recordings.
    pub(super) sessions: &'a [Session],
    /// The twin at the start.
    pub(super) start: &'f Twin,
    /// Given by the user, not the nominal one.
    pub(super) is_given: bool,
    /// The final twin.
    pub(super) twin: &'f Twin,
    /// Stage by stage.
    pub(super) outcomes: &'f [Outcome<'a>],
    /// Thresholds of the search.
    pub(super) thresholds: &'f Thresholds,
    /// Noise floor of each signal: `[outcome][channel]`.
    pub(super) floors: &'f [Vec<Floor>],
    /// Number of effects to which the search was restricted; `None` where it was not.
    pub(super) selected: Option<usize>,
    /// Effects that no signal of these recordings shows.
    pub(super) unseen: &'f [&'static Effect],
}

/// The document of recordings that were refused before any fit.
pub(super) fn refused(twin: &Twin, sessions: &[Session], objection: &Objection) -> Document {
    Document {
        schema_version: SCHEMA_VERSION,
        verdict: objection.verdict,
        summary: objection.says.clone(),
        localization: Vec::new(),
        effects: Vec::new(),
        indistinguishable: Vec::new(),
        rejected: Vec::new(),
        residuals: Vec::new(),
        parameter_changes: Vec::new(),
        description: None,
        next_experiment: Some(experiment::after_refusal(Setup::of(twin.machine, sessions))),
        warnings: vec![objection.says.clone()],
        journal: vec![JournalEntry::new(MoveKind::Refuse, None, objection.says.clone())],
    }
}

/// The document of `material`; `journal` holds the decisions before those of the outcomes.
pub(super) fn document(material: &Material<'_, '_>, mut journal: Vec<JournalEntry>) -> Document {
    let Material { sessions, start, twin, outcomes, unseen, .. } = *material;
    let added = outcomes.iter().flat_map(|own| own.added.iter().map(move |step| (own, step)));
    let (mut held, mut missing) = (Vec::new(), Vec::new());
    for (outcome, step) in added {
        match not_counted(start, twin, step) {
            Some(why) => held.push(why),
            None => missing.push((outcome, step)),
        }
    }
    let effects: Vec<IdentifiedEffect> =
        missing.iter().map(|(outcome, step)| identified(outcome, step, twin)).collect();
    let steps = missing.into_iter().map(|(_, step)| step);
    let indistinguishable: Vec<Indistinguishable> =
        steps.filter(|step| !step.indistinguishable.is_empty()).map(indistinguishable).collect();
    let rejected = outcomes.iter().flat_map(|outcome| &outcome.rejected).map(rejected_effect);
    let rejected = rejected.chain(unseen.iter().copied().map(unseen_effect)).collect();
    let stages = outcomes.iter().zip(material.floors);
    let residuals: Vec<SignalResidual> =
        stages.flat_map(|(outcome, floors)| signal_residuals(outcome, floors)).collect();
    let parameter_changes = match material.is_given {
        true => parameter_changes(material),
        false => Vec::new(),
    };
    let localization = locate::localization(outcomes, &effects);
    let answer = Answer::of(&Findings {
        thresholds: material.thresholds,
        start,
        effects: &effects,
        indistinguishable: &indistinguishable,
        parameter_changes: &parameter_changes,
        residuals: &residuals,
        selected: material.selected,
        outcomes,
    });
    let effects = if answer.verdict == Verdict::DifferentMachine { Vec::new() } else { effects };
    let mut warnings = warnings(sessions, outcomes);
    warnings.extend(held);
    let setup = Setup::of(start.machine, sessions);
    let next_experiment = experiment::next_experiment(setup, &indistinguishable, outcomes, unseen);
    journal.extend(outcomes.iter().flat_map(|outcome| outcome.journal.clone()));
    Document {
        schema_version: SCHEMA_VERSION,
        verdict: answer.verdict,
        summary: answer.summary,
        localization,
        effects,
        indistinguishable,
        rejected,
        residuals,
        parameter_changes,
        description: None,
        next_experiment,
        warnings,
        journal,
    }
}

/// Statement on an effect of a single axis that is part of the twin and does not count as missing.
fn not_counted(start: &Twin, twin: &Twin, step: &Added) -> Option<String> {
    twin.axis_frame?;
    let instance = &twin.instances[rounds::instance_of(twin, step)?];
    let why = lag_within_a_sample(start, twin, instance)
        .or_else(|| rigid(step.effect, &instance.values))?;
    Some(format!(
        "{why}, so {} is part of the twin and does not count as missing",
        step.effect.name
    ))
}

/// Reason why a lag shorter than the sample period is no effect of an axis.
fn lag_within_a_sample(start: &Twin, twin: &Twin, instance: &Instance) -> Option<String> {
    let period = sample_period_above_lag(start, twin, instance)?;
    let than =
        if start.reference_residuals.is_empty() { "" } else { " more than in the given twin" };
    Some(format!(
        "the motion follows the input by {} s{than}, which is less than the sample period of {} s: the time stamps or a \
         zero-order hold explain it",
        significant(added_lag(start, twin)),
        significant(period)
    ))
}

/// Reason why contacts that may carry nothing, or be rigid, are no effect: Coulomb friction
/// remains.
fn rigid(effect: &Effect, values: &[Value]) -> Option<String> {
    let Physics::Bristles(_) = effect.physics else { return None };
    let contains_zero = |value: &Value| value.ci95.is_some_and(|[low, _]| low < 0.0);
    let [force, deflection, ..] = values else { return None };
    let what = match (contains_zero(force), contains_zero(deflection)) {
        (true, _) => "force",
        (_, true) => "deflection",
        _ => return None,
    };
    Some(format!(
        "the interval of the {what} of elastic contacts contains zero: that is Coulomb friction"
    ))
}

fn indistinguishable(step: &Added) -> Indistinguishable {
    let names = std::iter::once(step.effect.name).chain(step.indistinguishable.iter().copied());
    Indistinguishable {
        names: names.map(str::to_owned).collect(),
        experiment: step.effect.excitation.to_owned(),
    }
}

fn rejected_effect(rejected: &rounds::Rejected) -> RejectedEffect {
    let reason = match &rejected.reason {
        Reason::NotSignificant => {
            "not significant after the Bonferroni correction for all comparisons".to_owned()
        }
        Reason::Outperformed(name) if name.is_empty() => {
            "explains less than other effects".to_owned()
        }
        Reason::Outperformed(name) => format!("explains nothing beyond {name}"),
        Reason::OnBound(parameter) => {
            format!("{parameter} is on its bound: wrong sign, or the effect is not there")
        }
        Reason::HeldOut => "the validation sessions do not confirm it".to_owned(),
        Reason::Contradicted => "pieces of the same rolls contradict it".to_owned(),
        Reason::SpeedsDisagree => {
            "low and high speeds disagree on its magnitude: the cause is another effect".to_owned()
        }
        Reason::SessionsDisagree => "the sessions disagree on its sign or magnitude".to_owned(),
        Reason::TooSmall => "not distinguishable from a model error of the simulation".to_owned(),
        Reason::NotTestable => {
            let needed = rejected.candidate.effect.excitation;
            format!("not testable with this motion: it needs {needed}")
        }
    };
    // The test of an effect that this motion does not show says nothing.
    let was_tested = rejected.reason != Reason::NotTestable;
    let finite = |value: f64| Some(value).filter(|value| was_tested && value.is_finite());
    RejectedEffect {
        name: rejected.candidate.effect.name.to_owned(),
        location: rejected.candidate.axis,
        reason,
        statistic: finite(rejected.candidate.statistic),
        p_value: finite(rejected.candidate.p_value),
        validation_gain: rejected.validation_gain.and_then(finite),
    }
}

/// Effect that no signal of the recordings shows.
fn unseen_effect(effect: &'static Effect) -> RejectedEffect {
    RejectedEffect {
        name: effect.name.to_owned(),
        location: effect.site.axes()[0],
        reason: format!(
            "not testable without the signals that show it: it needs {}",
            effect.excitation
        ),
        statistic: None,
        p_value: None,
        validation_gain: None,
    }
}

/// Known parameters outside the interval of what was known of them, on stages on which the
/// validation sessions prefer the final twin. The limit is corrected for the number of parameters
/// that could have changed (Bonferroni). If those of a stage changed jointly, but none by itself,
/// because their errors are correlated, the fewest that explain the change are stated.
fn parameter_changes(material: &Material<'_, '_>) -> Vec<ParameterChange> {
    let stages = || material.outcomes.iter().zip(material.floors);
    if material.start.machine == Machine::Axis && stages().all(is_refit_within_model_error) {
        return Vec::new();
    }
    let known = material.twin.instances.iter().enumerate();
    let mut possible: Vec<PossibleChange> =
        known.flat_map(|(index, after)| possible_changes(material, index, after)).collect();
    for (outcome, floors) in stages() {
        let is_own = |own: &PossibleChange| outcome.last.slots.contains(&own.slot);
        let is_clear = possible.iter().any(|own| is_own(own) && 1.0 < own.ratio);
        if is_clear || !explains_most_by_refit((outcome, floors)) {
            continue;
        }
        let slots: Vec<Slot> =
            possible.iter().filter(|own| is_own(own)).map(|own| own.slot).collect();
        let points = [&outcome.start, &outcome.last.point];
        let changed = sparse::fewest_changes(&outcome.train, &outcome.filters, points, &slots);
        possible
            .iter_mut()
            .filter(|own| changed.contains(&own.slot))
            .for_each(|own| own.ratio = f64::INFINITY);
    }
    possible.into_iter().filter(|own| 1.0 < own.ratio).map(|own| own.change).collect()
}

/// Difference of a parameter of the final twin from the given value.
struct PossibleChange {
    slot: Slot,
    /// Ratio of the difference to the limit of chance.
    ratio: f64,
    change: ParameterChange,
}

/// Return whether other values of the known parameters explain the residual without a new effect.
/// The given twin leaves a residual above its noise floor on the validation sessions, these values
/// explain most of its square, and no effect was added.
fn explains_most_by_refit((outcome, floors): (&Outcome<'_>, &Vec<Floor>)) -> bool {
    let thresholds = outcome.train.thresholds();
    let refit = Refit::of(outcome, floors);
    outcome.is_better
        && outcome.added.is_empty()
        && thresholds.floor_ratio < refit.floor_ratio
        && thresholds.majority < refit.gain
}

/// Return whether other values of the known parameters of a single axis explain no more than a model error: the given
/// twin is at the noise floor, and they explain less than an effect there must explain.
fn is_refit_within_model_error((outcome, floors): (&Outcome<'_>, &Vec<Floor>)) -> bool {
    let Refit { floor_ratio, gain } = Refit::of(outcome, floors);
    outcome.added.is_empty()
        && floor_ratio <= 1.0
        && gain < outcome.train.thresholds().least_gain_at_floor(floor_ratio)
}

/// Known parameters of the given twin, refitted, on the validation sessions.
struct Refit {
    /// Largest ratio of a signal's residual to its noise floor with the given values; infinite without a residual.
    floor_ratio: f64,
    /// Fraction of the squared residual, in noise floors, that the new values explain.
    gain: f64,
}

impl Refit {
    fn of(outcome: &Outcome<'_>, floors: &[Floor]) -> Self {
        let ratios = |point: &Point| -> Vec<f64> {
            outcome.held_out.rms(point).iter().zip(floors).map(|(rms, own)| rms / own.rms).collect()
        };
        let sum = |ratios: &[f64]| ratios.iter().map(|ratio| ratio * ratio).sum::<f64>();
        let (before, after) = (ratios(&outcome.start_held_out), ratios(&outcome.last_held_out));
        Self {
            floor_ratio: before.iter().copied().reduce(f64::max).unwrap_or(f64::INFINITY),
            gain: 1.0 - sum(&after) / sum(&before).max(f64::MIN_POSITIVE),
        }
    }
}

/// Differences of the parameters of the instance `index` of the final twin from the given values.
fn possible_changes(
    material: &Material<'_, '_>,
    index: usize,
    after: &Instance,
) -> Vec<PossibleChange> {
    let Material { start, twin, outcomes, thresholds, .. } = *material;
    let (Some(known), Some(outcome)) =
        (known_as(start, index, after), confirmed_by(outcomes, twin, index))
    else {
        return Vec::new();
    };
    let tries: usize = outcomes.iter().map(|outcome| outcome.last.slots.len()).sum();
    let beyond_chance = 1.0 - 0.5 * thresholds.family_error / tries.max(1) as f64;
    let plain = start.plain();
    let before = &start.instances[known];
    let freedom = outcome.uncertainty.freedom;
    let in_half_intervals = t_quantile(beyond_chance, freedom) / t_quantile(0.975, freedom);
    // Of several lags only the sum is known.
    let mut added = twin.instances.iter().skip(start.instances.len());
    let is_redistributed = lag(before).is_some()
        && added.any(|own| sample_period_above_lag(start, twin, own).is_some());
    let change_of = |(k, parameter): (usize, &Parameter)| {
        let (old, new) = (&before.values[k], &after.values[k]);
        if new.ci95.is_none()
            || new.source != Source::Fitted
            || parameter.per_session
            || is_redistributed
        {
            return None;
        }
        let scale = Scale::of(before.effect, k);
        let [was, is] = [old, new].map(|own| Magnitude::of(scale, own));
        // The model error is part of both values, and not of their difference.
        let slot = Slot { instance: known, parameter: k };
        let common = t_quantile(0.975, freedom)
            * thresholds.model_error
            * changed(&plain, start, slot)
            * was.slope;
        let old_half = (was.half.powi(2) - common.powi(2)).max(0.0).sqrt();
        let limit = in_half_intervals * is.half.hypot(old_half);
        let change = ParameterChange {
            name: format!("{}.{}", before.effect.effect_of_parameter(k), parameter.name),
            location: after.axis,
            before: old.value,
            after: new.value,
            ci95: new.ci95,
            unit: parameter.unit.to_owned(),
        };
        let difference = (is.value - was.value).abs();
        // A value that was given exactly, and stays, is no change.
        (0.0 < difference).then(|| PossibleChange {
            slot: Slot { instance: index, parameter: k },
            ratio: difference / limit,
            change,
        })
    };
    before.effect.parameters.iter().enumerate().filter_map(change_of).collect()
}

/// The outcome that has fitted the instance `index` of `twin` and whose validation sessions prefer the final twin.
fn confirmed_by<'o, 'a>(
    outcomes: &'o [Outcome<'a>],
    twin: &Twin,
    index: usize,
) -> Option<&'o Outcome<'a>> {
    // Measurement noise is estimated on the camera, without a slot that is fitted.
    let is_noise = twin.instances[index].effect.is_noise();
    outcomes.iter().find(|own| {
        own.is_better && own.last.slots.iter().any(|slot| slot.instance == index)
            || is_noise && own.kind == StageKind::Camera
    })
}

/// Index in `start` of the instance `index` of the final twin, perhaps shared there by both motors or axes.
fn known_as(start: &Twin, index: usize, instance: &Instance) -> Option<usize> {
    let is_same =
        |own: &Instance| own.effect == instance.effect && own.axis.overlaps(instance.axis);
    let at_index = (index < start.instances.len()).then_some(index);
    at_index.or_else(|| start.instances.iter().position(is_same))
}

fn signal_residuals(outcome: &Outcome<'_>, floors: &[Floor]) -> Vec<SignalResidual> {
    let Some(part) = outcome.train.parts.first() else { return Vec::new() };
    let columns = [
        outcome.train.rms(&outcome.start),
        outcome.train.rms(&outcome.last.point),
        outcome.held_out.rms(&outcome.start_held_out),
        outcome.held_out.rms(&outcome.last_held_out),
    ];
    let at =
        |column: usize, k: usize| columns[column].get(k).copied().filter(|rms| rms.is_finite());
    part.stage
        .channels()
        .iter()
        .zip(floors)
        .enumerate()
        .map(|(k, (channel, floor))| SignalResidual {
            stage: channel.domain,
            signal: channel.signal.clone(),
            unit: channel.unit.to_owned(),
            band: "all".to_owned(),
            noise_floor: (floor.source != FloorSource::Unknown).then_some(floor.rms),
            noise_floor_source: match floor.source {
                FloorSource::Smoothness => {
                    format!("third differences of the measured signal, {} samples", floor.samples)
                }
                FloorSource::Propagated => format!(
                    "propagated noise of the measured input and position, and the model error of the simulation, {} \
                     samples",
                    floor.samples
                ),
                FloorSource::Reference => {
                    "reference residual of the given twin (measurement noise and model error)"
                        .to_owned()
                }
                FloorSource::Unknown => "too few samples".to_owned(),
            },
            train_before: at(0, k),
            train_after: at(1, k),
            validation_before: at(2, k),
            validation_after: at(3, k),
        })
        .collect()
}

fn warnings(sessions: &[Session], outcomes: &[Outcome<'_>]) -> Vec<String> {
    let mut warnings = undetermined(outcomes);
    for outcome in outcomes {
        for (problem, split) in
            [(&outcome.train, Split::Train), (&outcome.held_out, Split::Validation)]
        {
            let names = stages(sessions, outcome.kind, split).map(|(session, _)| &session.name);
            for (part, session) in problem.parts.iter().zip(names) {
                warnings.extend(part.incidents.iter().map(|own| masked(session, own)));
            }
        }
        if let Some(unknown) = &outcome.unexplained {
            warnings.push(format!(
                "the residual of {} still {} ({:.0} % of its square)",
                unknown.signal,
                dependence(&unknown.name),
                100.0 * unknown.fraction
            ));
        }
        let known: Vec<Slot> =
            outcome.last.slots.iter().copied().filter(|slot| is_known(outcome, slot)).collect();
        if let Some(name) = rounds::known_on_bound(&outcome.last.point.twin, &known) {
            warnings.push(format!(
                "{name} is on its bound: the twin cannot describe this machine with it (unit of the input, or structure?)"
            ));
        }
        if outcome.held_out.parts.is_empty() {
            let stage = outcome.kind;
            warnings
                .push(format!("stage {stage}: no validation session, so no effect is validated"));
        }
    }
    warnings
}

/// Return whether `slot` is a parameter of the given twin.
fn is_known(outcome: &Outcome<'_>, slot: &Slot) -> bool {
    let twin = &outcome.last.point.twin;
    !outcome.added.iter().any(|step| rounds::instance_of(twin, step) == Some(slot.instance))
}

/// Parameters that no stage determines.
fn undetermined(outcomes: &[Outcome<'_>]) -> Vec<String> {
    let mut parameters: Vec<(String, bool)> = Vec::new();
    for outcome in outcomes {
        for (index, slot) in outcome.last.slots.iter().enumerate() {
            let instance = &outcome.last.point.twin.instances[slot.instance];
            let Parameter { name, .. } = instance.effect.parameters[slot.parameter];
            let shown = format!("{}.{name}{}", instance.effect.name, instance.axis.phrase());
            let is_determined = !outcome.uncertainty.undetermined[index];
            match parameters.iter_mut().find(|(other, _)| *other == shown) {
                Some((_, determined)) => *determined |= is_determined,
                None => parameters.push((shown, is_determined)),
            }
        }
    }
    let open = parameters.into_iter().filter(|(_, is_determined)| !is_determined);
    open.map(|(shown, _)| format!("the data do not determine {shown}")).collect()
}

/// Warning about a one-off disturbance in the session called `session`.
fn masked(session: &str, incident: &Incident) -> String {
    let Incident { signal, unit, farthest, span } = incident;
    format!(
        "{session}: a one-off disturbance of {signal} by up to {farthest:.3} {unit} from {:.1} to {:.1} s is left out, since \
         nothing like it recurs (a hand on the machine, an end stop, or a limit?)",
        span.start, span.end
    )
}
