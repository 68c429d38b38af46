//! Complete search: check the data, refit, search stage by stage, and write the findings into the document of the
//! contract.

use super::{
    checks::{self, Objection},
    describe::{self, Features},
    document::{self, Material},
    findings::{Document, SignalResidual, Verdict},
    floor::{self, Floor, FloorSource},
    known,
    magnitude::Scale,
    noise,
    options::{Context, FixedParameter, SearchOptions},
    rounds::{self, Held, Outcome, StageData, Task},
    user_effects,
};
use crate::{
    effects::{CATALOGUE, Effect, Physics},
    recording::Split,
    stats::t_quantile,
    twin::{
        Channel, Instance, Machine, Plant, ReferenceResidual, Session, Slot, Source, Stage,
        StageKind, Twin, Value,
    },
};

mod gantry;

/// Stages after those of the gantry, in the order of the chain.
const BEHIND_GANTRY: [StageKind; 4] =
    [StageKind::Estimator, StageKind::Ball, StageKind::WholeRolls, StageKind::Axis];

/// All stages, in search order.
const STAGES: [StageKind; 6] = [
    StageKind::Drive,
    StageKind::Camera,
    StageKind::Estimator,
    StageKind::Ball,
    StageKind::WholeRolls,
    StageKind::Axis,
];

/// Task of a search and its context.
#[derive(Clone, Copy)]
struct Request<'a> {
    task: Task,
    context: Context<'a>,
}

/// Result of the complete search.
pub struct Found<'a> {
    /// Document of the contract.
    pub document: Document,
    /// Final twin with its effects; the start twin where the data were refused.
    pub twin: Twin,
    /// Results stage by stage.
    pub outcomes: Vec<Outcome<'a>>,
    /// Noise floor of each signal: `[outcome][channel]`.
    pub floors: Vec<Vec<Floor>>,
}

impl Found<'_> {
    /// Return whether there is a twin to write: not without a fit.
    #[must_use]
    pub fn has_twin(&self) -> bool {
        let verdict = self.document.verdict;
        !matches!(verdict, Verdict::NotTestable | Verdict::InputNotConnected)
    }

    /// Method of the noise floor of `signal`.
    pub(super) fn floor_source(&self, signal: &str) -> Option<FloorSource> {
        let of_outcome = |(outcome, floors): (&Outcome<'_>, &Vec<Floor>)| {
            let channels = outcome.train.parts.first()?.stage.channels();
            let index = channels.iter().position(|own| own.signal == signal)?;
            floors.get(index).map(|own| own.source)
        };
        self.outcomes.iter().zip(&self.floors).find_map(of_outcome)
    }
}

/// Run the workflow on `sessions` from the `given` twin, or from the nominal one, in a `context` of options and
/// observer.
#[must_use]
pub fn find<'a>(
    sessions: &'a [Session],
    given: Option<&Twin>,
    task: Task,
    context: Context<'a>,
) -> Found<'a> {
    let thresholds = context.options.thresholds();
    let start = given.cloned().unwrap_or_else(|| Twin::nominal_of(sessions));
    let added: Vec<String> = context.options.added_to(&start).map(of_added).collect();
    let start = context.options.applied_to(start).framed(sessions);
    let request = Request { task, context };
    if let Some(refused) = check(sessions, &start, request) {
        return refused;
    }
    let mut journal = Vec::new();
    let (mut outcomes, mut twin) = gantry::search(sessions, &start, request, &mut journal);
    for kind in BEHIND_GANTRY {
        if let Some(outcome) = search_stage(sessions, kind, &twin, request, &outcomes) {
            twin = stated(&start, &outcome);
            outcomes.push(outcome);
        }
    }
    if outcomes.iter().all(|outcome| outcome.train.rows() == 0) {
        return refused(start, sessions, &checks::nothing_compared());
    }
    for session in sessions.iter().filter(|session| session.split == Split::Train) {
        if !twin.fitted_to.contains(&session.sha256) {
            twin.fitted_to.push(session.sha256.clone());
        }
    }
    outcomes.iter_mut().for_each(|outcome| outcome.begin_at(&start));
    if twin.controller_reference_mass.is_none()
        && outcomes.iter().any(|own| own.kind == StageKind::Drive)
    {
        twin.controller_reference_mass = Some(Plant::new(&twin).mean_mass());
    }
    let floors: Vec<Vec<Floor>> = outcomes.iter().map(floors_of).collect();
    for outcome in &outcomes {
        note_residuals(&mut twin, outcome, task);
        noise::state(&mut twin, &outcome.train, &outcome.last.point);
        if task == Task::CloseGap {
            known::note_discrepancy(&mut twin, outcome);
        }
    }
    let unseen = unseen(sessions, &start, context);
    let material = Material {
        sessions,
        start: &start,
        is_given: given.is_some(),
        twin: &twin,
        outcomes: &outcomes,
        thresholds,
        floors: &floors,
        selected: context.options.selected().map(<[_]>::len),
        unseen: &unseen,
    };
    let mut document = document::document(&material, journal);
    if document.verdict == Verdict::Unexplained {
        describe_rest(&mut document, sessions, &outcomes, context);
    }
    let further = warnings(context, (&start, sessions), &outcomes);
    document.warnings.extend(added.into_iter().chain(further));
    if task == Task::CloseGap {
        document.warnings.extend(not_searched(sessions, &start, context.options));
    }
    Found { document, twin, outcomes, floors }
}

/// Result where data, twin or selected effects are refused before any fit.
fn check<'a>(sessions: &[Session], start: &Twin, request: Request<'_>) -> Option<Found<'a>> {
    let thresholds = request.context.options.thresholds();
    let objection = checks::check(sessions, thresholds)
        .or_else(|| checks::check_twin(start, sessions, thresholds));
    if let Some(objection) = objection {
        return Some(refused(start.clone(), sessions, &objection));
    }
    let objection = check_selection(sessions, start, request)?;
    let mut found = refused(start.clone(), sessions, &objection);
    // No other data resolve an empty selection.
    found.document.next_experiment = None;
    Some(found)
}

/// Warning about a known parameter of an effect that the initial twin does not have.
fn of_added(known: &FixedParameter) -> String {
    format!("the initial twin does not have the effect of `--fix {known}`: it was added")
}

/// Warnings about the data and the options.
fn warnings(
    context: Context<'_>,
    (start, sessions): (&Twin, &[Session]),
    outcomes: &[Outcome<'_>],
) -> Vec<String> {
    let of_data = without_torques(sessions).into_iter();
    let of_data = of_data.chain(outcomes.iter().flat_map(late_sessions));
    of_data.chain(of_options(context, start.machine, sessions)).collect()
}

/// Warning about recordings of a table in which no drive reported its torque.
fn without_torques(sessions: &[Session]) -> Option<String> {
    let drives = || stages(sessions, StageKind::Drive, Split::Train);
    let is_torque = |channel: &Channel| channel.unit == "N m";
    let shows = |(_, stage): (&Session, &dyn Stage)| stage.channels().iter().any(is_torque);
    (drives().next().is_some() && !drives().any(shows)).then(|| {
        "no drive reported its torque: masses and forces of the table are determined up to a common factor only, so let the \
         drives send their torques (ODrive: axis0.config.can.torques_msg_rate_ms = 10)"
            .to_owned()
    })
}

/// Warnings about sessions whose commands waited on the bus by another time than in the first training session.
fn late_sessions(outcome: &Outcome<'_>) -> Vec<String> {
    let problems = [(&outcome.train, "training"), (&outcome.held_out, "validation")];
    let all = problems
        .into_iter()
        .flat_map(|(problem, split)| problem.parts.iter().map(move |part| (part.late, split)));
    let said = |([a, b], split): ([f64; 2], &str)| {
        format!(
            "in a {split} session, commands waited on the bus by another time than in the first training session: {:+.2} ms for \
             motor a, {:+.2} ms for motor b. drive.delay contains the wait of the first",
            1e3 * a,
            1e3 * b
        )
    };
    all.filter(|(late, _)| *late != [0.0; 2]).map(said).collect()
}

/// Warnings about the options: changed thresholds, and effects of the user that are not searched.
fn of_options(context: Context<'_>, machine: Machine, sessions: &[Session]) -> Vec<String> {
    let changes = context.options.thresholds().changes().into_iter();
    let changes = changes.map(|own| format!("the threshold {own} is not the default"));
    let effects = context.options.defined().iter().filter_map(|effect| {
        let stages = sessions.iter().flat_map(Session::stages);
        user_effects::objection(effect, machine, stages)
    });
    changes.chain(effects).collect()
}

/// Describe in `document` the residual that no effect explains, where forces act on its stage.
fn describe_rest(
    document: &mut Document,
    sessions: &[Session],
    outcomes: &[Outcome<'_>],
    context: Context<'_>,
) {
    let open = outcomes.iter().filter(|outcome| is_open(outcome, &document.residuals));
    let Some((outcome, features)) =
        open.filter_map(|outcome| Some((outcome, Features::of(outcome)?))).next()
    else {
        document.summary +=
            " It is not described by an equation, since no force acts on its stage.";
        return;
    };
    let options = features.options(context.options);
    let data = stage_data(sessions, outcome.kind, Context { options: &options, ..context }, &[]);
    let start = &outcome.last.point.twin;
    let found = rounds::search(&data, start, Task::CloseGap);
    let description = features.description(&found, &stated(start, &found));
    document.journal.extend(features.entries(description.as_ref()));
    document.summary += &match &description {
        Some(description) => format!(" {}", describe::sentence(description)),
        None => format!(" {}.", features.none_passed()),
    };
    document.description = description;
}

/// Return whether the stage of `outcome` has an unexplained residual.
fn is_open(outcome: &Outcome<'_>, residuals: &[SignalResidual]) -> bool {
    let channels = outcome.train.parts.first().map_or(&[][..], |part| part.stage.channels());
    let is_own = |own: &&SignalResidual| channels.iter().any(|it| it.signal == own.signal);
    outcome.unexplained.is_some()
        || residuals.iter().filter(is_own).any(|own| outcome.train.thresholds().is_above_floor(own))
}

/// Result of refused data for the reason of `objection`: nothing was fitted.
fn refused<'a>(twin: Twin, sessions: &[Session], objection: &Objection) -> Found<'a> {
    let document = document::refused(&twin, sessions, objection);
    Found { document, twin, outcomes: Vec::new(), floors: Vec::new() }
}

/// Search one stage from `twin`, after those `before` it; `None` where the sessions do not have it.
fn search_stage<'a>(
    sessions: &'a [Session],
    kind: StageKind,
    twin: &Twin,
    Request { task, context }: Request<'a>,
    before: &[Outcome<'_>],
) -> Option<Outcome<'a>> {
    let mut data = stage_data(sessions, kind, context, before);
    let is_validated = kind != StageKind::WholeRolls || !data.held_out.is_empty();
    if data.train.is_empty() || !is_validated {
        return None;
    }
    if task == Task::Calibrate {
        data.held.extend(not_selected(twin, context));
    }
    let has = |kind: &StageKind| stages(sessions, *kind, Split::Train).next().is_some();
    let kinds: Vec<StageKind> = STAGES.into_iter().filter(has).collect();
    let done = kinds.iter().position(|own| *own == kind).unwrap_or(0);
    context.observer.stage_begun(kind, done, kinds.len());
    Some(rounds::search(&data, twin, task_of(kind, task, before)))
}

/// Parameters of the effects in `twin` that are not selected: a calibration keeps them.
fn not_selected(twin: &Twin, context: Context<'_>) -> Vec<Held> {
    let instances = twin.instances.iter().enumerate();
    let kept = instances.filter(|(_, own)| !context.options.selects(own.effect));
    kept.flat_map(|(instance, own)| {
        (0..own.values.len()).map(move |parameter| Held::of(twin, Slot { instance, parameter }))
    })
    .collect()
}

/// One stage in all sessions, after those `before` it.
fn stage_data<'a>(
    sessions: &'a [Session],
    kind: StageKind,
    context: Context<'a>,
    before: &[Outcome<'_>],
) -> StageData<'a> {
    let of = |kind: StageKind, split: Split| -> Vec<&'a dyn Stage> {
        stages(sessions, kind, split).map(|(_, stage)| stage).collect()
    };
    StageData {
        kind,
        train: of(kind, Split::Train),
        held_out: of(kind, Split::Validation),
        witnesses: match kind {
            StageKind::Ball => of(StageKind::WholeRolls, Split::Validation),
            _ => Vec::new(),
        },
        companions: match kind {
            StageKind::Drive => of(StageKind::Camera, Split::Train),
            _ => Vec::new(),
        },
        predecessors: match kind {
            StageKind::WholeRolls => of(StageKind::Ball, Split::Train),
            _ => Vec::new(),
        },
        held: match kind {
            StageKind::Camera => before.iter().flat_map(determined).collect(),
            _ => Vec::new(),
        },
        // An error in an effect of the pieces accumulates along a whole roll; the pieces show whether there is more.
        may_be_disturbed: kind != StageKind::WholeRolls
            || before.last().is_none_or(|pieces| pieces.added.is_empty()),
        context,
    }
}

/// Parameters that the drives determine. Motor signals show the impact with the load. The camera shows only the lag,
/// which other effects change as well: of a soft belt the magnitude, and nothing of the rotor.
fn determined(outcome: &Outcome<'_>) -> Vec<Held> {
    let twin = &outcome.last.point.twin;
    let fitted = outcome.last.slots.iter().zip(&outcome.uncertainty.undetermined);
    fitted
        .filter(|(slot, is_undetermined)| {
            !**is_undetermined && (0 < slot.parameter || twin.instances[slot.instance].rattles())
        })
        .map(|(slot, _)| Held::of(twin, *slot))
        .collect()
}

/// Stages of one kind in the sessions of one split, in order.
pub(super) fn stages(
    sessions: &[Session],
    kind: StageKind,
    split: Split,
) -> impl Iterator<Item = (&Session, &dyn Stage)> {
    sessions
        .iter()
        .filter(move |session| session.split == split)
        .flat_map(|session| session.stages().into_iter().map(move |stage| (session, stage)))
        .filter(move |(_, stage)| stage.kind() == kind)
}

/// Task on one stage.
///
/// The reference velocities of the estimator are computed from camera positions. If the camera noise changed, a change
/// of the estimator is not identifiable. An unexplained residual on pieces of rolls accumulates along whole rolls and
/// resembles another effect.
fn task_of(kind: StageKind, task: Task, before: &[Outcome<'_>]) -> Task {
    let mut added = before.iter().flat_map(|outcome| &outcome.added);
    let scatters = added.any(|step| noise::is_variance_effect(step.effect));
    let in_pieces = before.iter().find(|outcome| outcome.kind == StageKind::Ball);
    match kind {
        StageKind::Estimator if scatters => Task::Calibrate,
        StageKind::WholeRolls if in_pieces.is_some_and(|own| own.unexplained.is_some()) => {
            Task::Follow
        }
        _ => task,
    }
}

/// Deflection of both ends of a backlash under a few newtons (m). It is not fitted, and limits the accuracy of the
/// width.
const END_DEFLECTION: f64 = 1e-5;

/// Final twin of a stage with sources and intervals.
///
/// The interval of an added effect includes the discrepancy of the given twin. That of a change from the `first` twin
/// includes the model error. A parameter that changed although the data do not determine it (a level that is never
/// reached) loses its interval.
fn stated(first: &Twin, outcome: &Outcome<'_>) -> Twin {
    let mut twin = outcome.last.point.twin.clone();
    let given = &outcome.start.twin;
    let quantile = t_quantile(0.975, outcome.uncertainty.freedom);
    for (index, slot) in outcome.last.slots.iter().enumerate() {
        let value = twin.get(*slot);
        if outcome.uncertainty.undetermined[index] {
            let stays = slot.instance < given.instances.len() && given.get(*slot) == value;
            let own = &mut twin.instances[slot.instance].values[slot.parameter];
            own.ci95 = own.ci95.filter(|_| stays);
            continue;
        }
        let own_error = outcome.train.thresholds().model_error * changed(first, &twin, *slot);
        let mut half = quantile * outcome.uncertainty.standard_errors[index].hypot(own_error);
        if slot.parameter == 0 && twin.instances[slot.instance].rattles() {
            half = half.hypot(END_DEFLECTION);
        }
        if given.instances.len() <= slot.instance {
            let effect = twin.instances[slot.instance].effect;
            let offsets = known::offsets(given, outcome.kind, effect);
            half += offsets.get(slot.parameter).map_or(0.0, |offset| offset.abs());
        }
        let effect = twin.instances[slot.instance].effect;
        let ci95 = Some(Scale::of(effect, slot.parameter).interval(value, half));
        twin.instances[slot.instance].values[slot.parameter] =
            Value { value, ci95, source: Source::Fitted };
    }
    twin
}

/// Change of a parameter of `twin` from the `first` one, where a fit had determined it (also before a split). For an
/// added effect: the distance from null, or from zero where that is nearer. That of a limit is the change of its reciprocal,
/// as a change from the present value. A shape parameter, such as a period, has none.
pub(super) fn changed(first: &Twin, twin: &Twin, slot: Slot) -> f64 {
    let value = twin.get(slot);
    let effect = twin.instances[slot.instance].effect;
    let is_same = |own: &&Instance| own.effect.name == effect.name;
    let same = || first.instances.iter().find(is_same);
    let null = effect.null[slot.parameter];
    let at_place = first.instances.get(slot.instance).filter(is_same);
    match at_place.or_else(same).map(|own| &own.values[slot.parameter]) {
        Some(before) if before.source == Source::Fitted => {
            Scale::of(effect, slot.parameter).difference(value, before.value)
        }
        Some(_) => 0.0,
        None if effect.is_shape(slot.parameter) => 0.0,
        None => (value - null).abs().min(value.abs()),
    }
}

/// Noise floor of each signal of the stage of `outcome`.
fn floors_of(outcome: &Outcome<'_>) -> Vec<Floor> {
    let part = outcome.train.parts.first();
    let (given, fitted) = (&outcome.start.twin, &outcome.last.point.twin);
    part.map_or(Vec::new(), |part| {
        floor::floors(part.stage, given, fitted, outcome.train.thresholds())
    })
}

/// Note the residual of each signal on the recordings to which the twin was fitted.
fn note_residuals(twin: &mut Twin, outcome: &Outcome<'_>, task: Task) {
    let Some(part) = outcome.train.parts.first() else { return };
    let squares = outcome.train.squares(&outcome.last.point);
    let validated = outcome.held_out.squares(&outcome.last_held_out);
    let rms = squares.iter().enumerate().map(|(k, (sum, count))| {
        let (other, more) = validated.get(k).copied().unwrap_or_default();
        ((sum + other) / (count + more).max(1) as f64).sqrt()
    });
    for (channel, rms) in part.stage.channels().iter().zip(rms) {
        twin.reference_residuals.retain(|own| own.signal != channel.signal);
        twin.reference_residuals.push(ReferenceResidual {
            signal: channel.signal.clone(),
            residual_rms: rms,
            searched: task == Task::CloseGap,
        });
    }
}

/// Effects of the table that no stage of these recordings shows in any motion: those of a camera, without one.
fn unseen(sessions: &[Session], start: &Twin, context: Context<'_>) -> Vec<&'static Effect> {
    let is_possible = |effect: &Effect| !start.machine.axes(effect.site).is_empty();
    let all = CATALOGUE.iter().chain(context.options.defined()).copied();
    all.filter(|effect| start.machine == Machine::Table && is_possible(effect))
        .filter(|effect| !is_shown(sessions, start, effect))
        .collect()
}

/// Return whether `start` has the effect, or a stage of these recordings shows it in some motion.
fn is_shown(sessions: &[Session], start: &Twin, effect: &'static Effect) -> bool {
    let mut stages = sessions.iter().flat_map(Session::stages);
    let is_called = match effect.physics {
        Physics::Noise(_) => stages.any(|stage| stage.kind() == StageKind::Camera),
        _ => stages.any(|stage| start.forms_of(effect).iter().any(|form| stage.calls(form))),
    };
    let is_possible = !start.machine.axes(effect.site).is_empty();
    is_called && is_possible || is_part_of(start, effect)
}

fn is_part_of(twin: &Twin, effect: &Effect) -> bool {
    twin.instances.iter().any(|own| own.effect.name == effect.name)
}

/// Refusal of a search that is restricted to effects which these recordings cannot show.
fn check_selection(
    sessions: &[Session],
    start: &Twin,
    Request { task, context }: Request<'_>,
) -> Option<Objection> {
    let selected = context.options.selected()?;
    let is_idle = match task {
        Task::Calibrate => selected.iter().all(|effect| !is_part_of(start, effect)),
        Task::CloseGap | Task::Follow => {
            selected.iter().all(|effect| !is_shown(sessions, start, effect))
        }
    };
    is_idle.then(|| checks::nothing_selected(task, start.machine))
}

/// Warnings about effects that were selected by name and are not searched.
fn not_searched(sessions: &[Session], start: &Twin, options: &SearchOptions) -> Vec<String> {
    let named = options.named().iter().filter(|effect| !is_shown(sessions, start, effect));
    let warning = |effect: &&'static Effect| {
        format!(
            "{} was selected, but these recordings of a {} cannot show it: it was not searched",
            effect.name, start.machine
        )
    };
    named.map(warning).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SLEW: &str = "drive.saturation.slew";

    #[test]
    fn a_limit_that_comes_into_reach_has_changed_by_about_itself() {
        let mut before = Twin::nominal(Machine::Table);
        let instance = before.instances.iter().position(|own| own.effect.name == SLEW).unwrap();
        let slot = Slot { instance, parameter: 0 };
        before.set(slot, 500.0);
        before.instances[instance].values[0].source = Source::Fitted;
        let mut after = before.clone();
        after.set(slot, 4.0);
        assert!((changed(&before, &after, slot) - 4.0 * (1.0 - 4.0 / 500.0)).abs() < 1e-12);
        assert_eq!(changed(&before, &before, slot), 0.0);
    }
}
