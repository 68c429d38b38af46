//! The whole search: check, refit, search link by link, and put the findings into the contract's
//! document.

use super::{
    checks::{self, Objection},
    findings::{
        Class, Document, NamedEffect, NamedParameter, Refit, RejectedEffect, SCHEMA_VERSION,
        SignalGap, Verdict,
    },
    floor::{self, Floor, FloorSource},
    incident::Incident,
    known, locate,
    rounds::{self, Added, Contestant, Held, Link, Outcome, Reason, Task, Unstated},
    scatter,
    verdict::{Findings, Told},
};
use crate::{
    effects::{CATALOGUE, Domain, Effect, Parameter, Physics},
    recording::Split,
    stats::t_quantile,
    twin::{
        Instance, Left, Machine, Plant, Session, Slot, Source, Stage, StageKind, Twin, Value,
        machine_of,
    },
};

/// The links after those of the gantry, in the order of the chain.
const BEHIND_GANTRY: [StageKind; 4] =
    [StageKind::Estimator, StageKind::Ball, StageKind::WholeRolls, StageKind::Axis];

/// Most searches of the drives: with what the camera's link alone shows to pull at them, without, and with what it
/// shows behind the drives as they were found.
const MOST_DRIVE_SEARCHES: usize = 3;

/// Everything that was found.
pub struct Found<'a> {
    /// The contract's document.
    pub document: Document,
    /// The twin with the effects in it.
    pub twin: Twin,
    /// Link by link.
    pub outcomes: Vec<Outcome<'a>>,
    /// The floor of each signal: `[outcome][channel]`.
    pub floors: Vec<Vec<Floor>>,
}

/// Share by which a known parameter must move to be told, beside leaving its interval.
const LEAST_MOVE: f64 = 0.002;

/// Runs the workflow on `sessions` from `given`, or from the plain twin.
#[must_use]
pub fn find<'a>(sessions: &'a [Session], given: Option<&Twin>, task: Task) -> Found<'a> {
    let start = given.cloned().unwrap_or_else(|| Twin::nominal(machine_of(sessions)));
    let refusal = checks::check(sessions).or_else(|| checks::check_twin(&start, sessions));
    if let Some(objection) = refusal {
        return refused(start, objection);
    }
    let (mut outcomes, mut twin) = gantry_links(sessions, &start, task);
    for kind in BEHIND_GANTRY {
        if let Some(outcome) = search_link(sessions, kind, &twin, task, &outcomes) {
            twin = stated(&start, &outcome);
            outcomes.push(outcome);
        }
    }
    for session in sessions.iter().filter(|session| session.split == Split::Train) {
        if !twin.fitted_to.contains(&session.sha256) {
            twin.fitted_to.push(session.sha256.clone());
        }
    }
    outcomes.iter_mut().for_each(|outcome| outcome.begin_at(&start));
    if twin.tuned_mass.is_none() && outcomes.iter().any(|own| own.kind == StageKind::Drive) {
        twin.tuned_mass = Some(Plant::new(&twin).mean_mass());
    }
    let floors: Vec<Vec<Floor>> = outcomes.iter().map(floors_of).collect();
    for outcome in &outcomes {
        leave(&mut twin, outcome, task);
        scatter::state(&mut twin, &outcome.train, &outcome.last.point);
        if task == Task::CloseGap {
            known::note_mimicry(&mut twin, outcome);
        }
    }
    let unseen = unseen(sessions, &start);
    let document = document(
        &start,
        given,
        &twin,
        &Findable { sessions, outcomes: &outcomes, floors: &floors, unseen: &unseen },
    );
    Found { document, twin, outcomes, floors }
}

/// Searches one link from `twin`, after those `before` it; `None` where the sessions do not have it.
fn search_link<'a>(
    sessions: &'a [Session],
    kind: StageKind,
    twin: &Twin,
    task: Task,
    before: &[Outcome<'_>],
) -> Option<Outcome<'a>> {
    let link = link_of(sessions, kind, before);
    let judges = kind != StageKind::WholeRolls || !link.held_out.is_empty();
    (!link.train.is_empty() && judges)
        .then(|| rounds::search(&link, twin, task_of(kind, task, before)))
}

/// What the camera's link has added that is behind the carriage and felt by what drives it.
fn pull_of(camera: &Outcome<'_>) -> Option<Instance> {
    let is_felt = |effect: &Effect| {
        effect.physics.equations().iter().any(|own| matches!(own, Physics::Reaction(_)))
    };
    let step = camera.added.iter().find(|step| is_felt(step.effect))?;
    camera.last.point.twin.instance(step.effect.name, step.axis).cloned()
}

/// Drives and camera, and the twin after them. What the camera shows of the striker may pull at the drives, and the
/// camera's link itself begins behind what the drives have: what is assumed to pull is what is found in the end.
fn gantry_links<'a>(sessions: &'a [Session], start: &Twin, task: Task) -> (Vec<Outcome<'a>>, Twin) {
    let of =
        |kind, twin: &Twin, before: &[Outcome<'_>]| search_link(sessions, kind, twin, task, before);
    let has_drives = stages(sessions, StageKind::Drive, Split::Train).next().is_some();
    let scout = (task == Task::CloseGap && has_drives).then(|| of(StageKind::Camera, start, &[]));
    let mut pull = scout.flatten().as_ref().and_then(pull_of);
    let mut searches = 0;
    loop {
        searches += 1;
        let mut outcomes = Vec::new();
        let mut twin = start.clone();
        twin.instances.extend(pull.clone());
        if let Some(drive) = of(StageKind::Drive, &twin, &outcomes) {
            twin = stated(start, &drive);
            outcomes.push(drive);
        }
        let is_pull = |own: &Instance| pull.as_ref().is_some_and(|pull| own.effect == pull.effect);
        twin.instances.retain(|own| !is_pull(own));
        let Some(camera) = of(StageKind::Camera, &twin, &outcomes) else {
            return (outcomes, twin);
        };
        let shown = pull_of(&camera);
        let effect = |pull: &Option<Instance>| pull.as_ref().map(|own| own.effect);
        let is_unheeded = pull.is_none() && outcomes.iter().all(|drive| drive.added.is_empty());
        twin = stated(start, &camera);
        outcomes.push(camera);
        if effect(&shown) == effect(&pull) || is_unheeded || searches == MOST_DRIVE_SEARCHES {
            return (outcomes, twin);
        }
        pull = shown;
        log::info!("what pulls at the drives is another than was assumed: they are searched again");
    }
}

/// One link in all sessions, after those `before` it.
fn link_of<'a>(sessions: &'a [Session], kind: StageKind, before: &[Outcome<'_>]) -> Link<'a> {
    let of = |kind: StageKind, split: Split| -> Vec<&'a dyn Stage> {
        stages(sessions, kind, split).map(|(_, stage)| stage).collect()
    };
    Link {
        kind,
        train: of(kind, Split::Train),
        held_out: of(kind, Split::Validation),
        witnesses: match kind {
            StageKind::Ball => of(StageKind::WholeRolls, Split::Validation),
            _ => Vec::new(),
        },
        held: match kind {
            StageKind::Camera => before.iter().flat_map(widths).collect(),
            _ => Vec::new(),
        },
        // What an effect of the pieces is off grows along a whole roll; they say whether more is there.
        may_be_disturbed: kind != StageKind::WholeRolls
            || before.last().is_none_or(|pieces| pieces.added.is_empty()),
    }
}

/// Numbers of plays at motors that a link has determined: motors feel when they meet their load, and the camera only
/// sees how far it lags, which other things change as well.
fn widths(outcome: &Outcome<'_>) -> Vec<Held> {
    let twin = &outcome.last.point.twin;
    let fitted = outcome.last.slots.iter().zip(&outcome.uncertainty.undetermined);
    fitted
        .filter(|(slot, is_undetermined)| {
            twin.instances[slot.instance].rattles() && !**is_undetermined
        })
        .map(|(slot, _)| Held::of(twin, *slot))
        .collect()
}

/// The links of one kind in the sessions of one purpose, in their order.
fn stages(
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

/// What is asked of one link. The estimator's true velocities are made of the camera's places: where these
/// scatter otherwise than before, it cannot be told whether the estimator does. What pieces of rolls cannot explain
/// grows along whole rolls into the likeness of something else.
fn task_of(kind: StageKind, task: Task, before: &[Outcome<'_>]) -> Task {
    let mut added = before.iter().flat_map(|outcome| &outcome.added);
    let scatters = added.any(|step| scatter::is_scatter(step.effect));
    let in_pieces = before.iter().find(|outcome| outcome.kind == StageKind::Ball);
    match kind {
        StageKind::Estimator if scatters => Task::Calibrate,
        StageKind::WholeRolls if in_pieces.is_some_and(|own| own.unexplained.is_some()) => {
            Task::Follow
        }
        _ => task,
    }
}

/// Nothing may be said.
fn refused<'a>(twin: Twin, objection: Objection) -> Found<'a> {
    let document = Document {
        schema_version: SCHEMA_VERSION,
        verdict: objection.verdict,
        says: objection.says.clone(),
        places: Vec::new(),
        effects: Vec::new(),
        class: Vec::new(),
        rejected: Vec::new(),
        gap: Vec::new(),
        refit: Vec::new(),
        next_experiment: Some(collect_command(&["x_line", "y_line", "random_walk"])),
        doubts: vec![objection.says],
    };
    Found { document, twin, outcomes: Vec::new(), floors: Vec::new() }
}

/// Standard error of a change, as a share of it, that is the simulation's own, however clearly the data show it (an
/// uncertainty of type B: JCGM 100, Guide to the Expression of Uncertainty in Measurement, 4.3): what the numbers of
/// 234 blind cases, of another simulator, were off beyond their scatter (`reports/2026-11-23-gap-unseen`).
const FIDELITY: f64 = 0.025;

/// What the two ends of a play give way by under a few newtons (m), which is not fitted: its width is not known better.
const GIVE_OF_ENDS: f64 = 1e-5;

/// The final twin of a link with sources and intervals. An effect that was added is known no better than by what
/// the given twin looked like it before, and no change from the `first` twin better than to [`FIDELITY`]; a number
/// that the data do not determine and that moved all the same (a level that is never reached) has no interval any more.
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
        let own_error = FIDELITY * changed(first, &twin, *slot);
        let mut half = quantile * outcome.uncertainty.standard_errors[index].hypot(own_error);
        if slot.parameter == 0 && twin.instances[slot.instance].rattles() {
            half = half.hypot(GIVE_OF_ENDS);
        }
        if given.instances.len() <= slot.instance {
            let effect = twin.instances[slot.instance].effect;
            let lean = known::lean(given, outcome.kind, effect);
            half += lean.get(slot.parameter).map_or(0.0, |lean| lean.abs());
        }
        twin.instances[slot.instance].values[slot.parameter] =
            Value { value, ci95: Some([value - half, value + half]), source: Source::Fitted };
    }
    twin
}

/// How far a number of `twin` is from that of the `first` one, where a fit had determined it (also where what two
/// motors had in common was parted); of an effect that was added, from where it does nothing, or from zero where that
/// is nearer. What only shapes an effect, such as a period, is none.
fn changed(first: &Twin, twin: &Twin, slot: Slot) -> f64 {
    let value = twin.get(slot);
    let effect = twin.instances[slot.instance].effect;
    let same = || first.instances.iter().find(|own| own.effect == effect);
    let null = effect.null[slot.parameter];
    match first.instances.get(slot.instance).or_else(same).map(|own| &own.values[slot.parameter]) {
        Some(before) if before.source == Source::Fitted => (value - before.value).abs(),
        Some(_) => 0.0,
        None if 0 < slot.parameter && null != 0.0 => 0.0,
        None => (value - null).abs().min(value.abs()),
    }
}

fn floors_of(outcome: &Outcome<'_>) -> Vec<Floor> {
    let Some(part) = outcome.train.parts.first() else { return Vec::new() };
    part.stage.channels().iter().map(|channel| floor::floor(channel, &[])).collect()
}

/// Notes what the twin leaves unexplained.
fn leave(twin: &mut Twin, outcome: &Outcome<'_>, task: Task) {
    let Some(part) = outcome.train.parts.first() else { return };
    let squares = outcome.train.squares(&outcome.last.point);
    let judged = outcome.held_out.squares(&outcome.last_held_out);
    let rms = squares.iter().enumerate().map(|(k, (sum, count))| {
        let (other, more) = judged.get(k).copied().unwrap_or_default();
        ((sum + other) / (count + more).max(1) as f64).sqrt()
    });
    for (channel, rms) in part.stage.channels().iter().zip(rms) {
        twin.left.retain(|left| left.signal != channel.signal);
        twin.left.push(Left {
            signal: channel.signal.clone(),
            residual_rms: rms,
            searched: task == Task::CloseGap,
        });
    }
}

/// What the recordings show, link by link, and what they do not show.
struct Findable<'f, 'a> {
    sessions: &'a [Session],
    outcomes: &'f [Outcome<'a>],
    floors: &'f [Vec<Floor>],
    unseen: &'f [&'static Effect],
}

/// Effects that no link of these recordings shows, whatever the motion: what takes a camera, where there was none.
fn unseen(sessions: &[Session], start: &Twin) -> Vec<&'static Effect> {
    let stages: Vec<&dyn Stage> = sessions.iter().flat_map(Session::stages).collect();
    let is_shown = |effect: &Effect| match effect.physics {
        Physics::Noise(_) => stages.iter().any(|stage| stage.kind() == StageKind::Camera),
        _ => stages.iter().any(|stage| stage.calls(effect)),
    };
    let is_known = |effect: &Effect| start.instances.iter().any(|own| own.effect == effect);
    let all = CATALOGUE.iter().copied();
    all.filter(|effect| start.machine == Machine::Table && !is_shown(effect) && !is_known(effect))
        .collect()
}

fn document(start: &Twin, given: Option<&Twin>, twin: &Twin, found: &Findable<'_, '_>) -> Document {
    let Findable { sessions, outcomes, floors, unseen } = *found;
    let effects: Vec<NamedEffect> = outcomes
        .iter()
        .flat_map(|outcome| outcome.added.iter().map(move |step| named(outcome, step, twin)))
        .collect();
    let class: Vec<Class> = outcomes
        .iter()
        .flat_map(|outcome| &outcome.added)
        .filter(|step| !step.class.is_empty())
        .map(class_of)
        .collect();
    let rejected = outcomes.iter().flat_map(|outcome| &outcome.rejected).map(rejected_effect);
    let rejected = rejected.chain(unseen.iter().copied().map(unseen_effect)).collect();
    let gap: Vec<SignalGap> = outcomes
        .iter()
        .zip(floors)
        .flat_map(|(outcome, floors)| signal_gaps(outcome, floors))
        .collect();
    let refit = given.map_or_else(Vec::new, |_| refits(start, twin, outcomes));
    let places = locate::places(outcomes, &effects);
    let told = Told::of(&Findings {
        start,
        is_given: given.is_some(),
        effects: &effects,
        class: &class,
        refit: &refit,
        gap: &gap,
        outcomes,
    });
    let effects = if told.verdict == Verdict::DifferentMachine { Vec::new() } else { effects };
    // Runs are driven on the table only; what an axis or a ball needs stands with its class in words.
    let next_experiment = match start.machine {
        Machine::Table => next_experiment(&class, outcomes, unseen),
        Machine::Axis => None,
    };
    Document {
        schema_version: SCHEMA_VERSION,
        verdict: told.verdict,
        says: told.says,
        places,
        effects,
        class,
        rejected,
        gap,
        refit,
        next_experiment,
        doubts: doubts(sessions, outcomes),
    }
}

fn named(outcome: &Outcome<'_>, step: &Added, twin: &Twin) -> NamedEffect {
    let instance = twin.instance(step.effect.name, step.axis);
    let parameters: Vec<NamedParameter> = instance
        .map(|instance| {
            step.effect
                .parameters
                .iter()
                .zip(&instance.values)
                .map(|(parameter, value)| NamedParameter {
                    name: parameter.name.to_owned(),
                    value: value.value,
                    unit: parameter.unit.to_owned(),
                    ci95: value.ci95,
                    implausible: !parameter.per_session
                        && !(parameter.plausible.0..=parameter.plausible.1)
                            .contains(&value.value.abs())
                        && !(parameter.plausible.0..=parameter.plausible.1).contains(&value.value),
                })
                .collect()
        })
        .unwrap_or_default();
    let (before, after) = &step.held_out_steps;
    let most = (0..before.len())
        .filter(|k| 0.0 < after[*k])
        .max_by(|a, b| (before[*a] / after[*a]).total_cmp(&(before[*b] / after[*b])));
    let channels = outcome.train.parts.first().map(|part| part.stage.channels());
    let of_signal = |what: &str, index: usize| {
        channels
            .and_then(|channels| channels.get(index))
            .map(|channel| format!("{what}{} ({})", channel.signal, channel.unit))
    };
    // What changes the scatter alone leaves every residual as it is: its gap is the scatter that is not stated.
    let (signal, ends) = match step.unstated {
        Some(Unstated::Variance(before, after)) => (
            of_signal("unstated scatter of ", 0),
            Some((before.max(0.0).sqrt(), after.max(0.0).sqrt())),
        ),
        Some(Unstated::FramesLost(before, after)) => {
            (Some("share of frames lost that is not stated".to_owned()), Some((before, after)))
        }
        None => (
            most.and_then(|index| of_signal("", index)),
            most.map(|index| (before[index], after[index])),
        ),
    };
    NamedEffect {
        name: step.effect.name.to_owned(),
        axis: step.axis,
        p_value: step.p_value,
        gap_before: ends.map(|ends| ends.0),
        gap_after: ends.map(|ends| ends.1),
        held_out_gain: step.held_out_gain,
        why: why(step.effect, step, signal.as_deref(), ends, &parameters),
        gap_signal: signal,
        numbers_when_added: step.numbers.clone(),
        parameters,
    }
}

/// The sentence after a name: what, where, how large, how sure, what else.
fn why(
    effect: &Effect,
    step: &Added,
    signal: Option<&str>,
    gap: Option<(f64, f64)>,
    parameters: &[NamedParameter],
) -> String {
    let numbers: Vec<String> = parameters
        .iter()
        .filter(|parameter| parameter.ci95.is_some())
        .map(|parameter| {
            let [low, high] = parameter.ci95.unwrap_or_default();
            format!(
                "{} {} ({} to {})",
                parameter.name,
                significant(parameter.value),
                significant(low),
                significant(high)
            )
        })
        .collect();
    let mut text = format!("On {}: {}; {}.", step.axis, effect.summary, numbers.join(", "));
    text += &when_added(step);
    if let (Some(signal), Some((before, after))) = (signal, gap) {
        let (what, unit) = match step.unstated {
            Some(Unstated::FramesLost(..)) => (signal.to_owned(), ""),
            _ => (format!("gap of {signal}"), " RMS"),
        };
        let tried = match step.contest.len() {
            0 => String::new(),
            count => format!("; {count} candidates were simulated"),
        };
        text += &format!(
            " On data that was not fitted it takes the {what} from {before:.3e} to {after:.3e}{unit} \
             (p = {:.1e}{tried}).",
            step.p_value,
        );
    }
    if step.class.is_empty() {
        let name = |other: &Contestant| other.effect.name;
        text += &match step.contest.iter().find(|other| step.is_outshone_by(other)).map(name) {
            Some(name) => format!(" {name} shows more clearly and closes far less of the gap."),
            None => step
                .runner_up()
                .map(name)
                .map_or_else(String::new, |name| format!(" The next best, {name}, explains less.")),
        };
    } else {
        text += &format!(" It could as well be {}.", step.class.join(" or "));
    }
    text
}

/// Numbers that people know an effect by and that its parameters give together, as they were when it was added.
fn when_added(step: &Added) -> String {
    let derived = step.numbers.iter().filter_map(|own| {
        let own = (own.axis == step.axis).then_some(own)?;
        let name = own.name.strip_prefix(step.effect.name)?.strip_prefix('.')?;
        let is_derived = step.effect.parameters.iter().all(|parameter| parameter.name != name);
        is_derived.then(|| format!("{name} {}", significant(own.value)))
    });
    match derived.collect::<Vec<_>>().join(", ") {
        none if none.is_empty() => none,
        numbers => format!(" When it was added: {numbers}."),
    }
}

/// Four significant digits, without an exponent where it is not needed.
fn significant(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 || (1e-3..1e5).contains(&size) {
        let before = if size == 0.0 { 1 } else { size.log10().floor() as i32 + 1 };
        format!("{value:.*}", (4 - before).clamp(0, 7) as usize)
    } else {
        format!("{value:.3e}")
    }
}

fn class_of(step: &Added) -> Class {
    let names = std::iter::once(step.effect.name)
        .chain(step.class.iter().copied())
        .map(str::to_owned)
        .collect();
    Class { names, experiment: step.effect.excitation.to_owned() }
}

fn rejected_effect(rejected: &rounds::Rejected) -> RejectedEffect {
    let reason = match &rejected.reason {
        Reason::NotSignificant => "not significant after the correction for all tries".to_owned(),
        Reason::Outdone(name) if name.is_empty() => "explains less than others".to_owned(),
        Reason::Outdone(name) => format!("explains nothing beyond {name}"),
        Reason::OnBound(parameter) => {
            format!("{parameter} stopped on its bound: wrong sign, or no such effect")
        }
        Reason::HeldOut => "the held-out session does not prefer it".to_owned(),
        Reason::SpeedsDisagree => {
            "low and high speeds do not agree on its size: something else is there".to_owned()
        }
        Reason::SessionsDisagree => "the sessions do not agree on its sign or size".to_owned(),
        Reason::TooSmall => "explains less than the simulation's own fidelity".to_owned(),
        Reason::NotTestable => {
            let takes = rejected.candidate.effect.excitation;
            format!("not testable with this motion: it takes {takes}")
        }
    };
    RejectedEffect {
        name: rejected.candidate.effect.name.to_owned(),
        axis: rejected.candidate.axis,
        reason,
        statistic: rejected.candidate.statistic,
        p_value: rejected.candidate.p_value,
        held_out_gain: rejected.held_out_gain,
    }
}

/// An effect that nothing in the recordings shows.
fn unseen_effect(effect: &'static Effect) -> RejectedEffect {
    RejectedEffect {
        name: effect.name.to_owned(),
        axis: effect.site.axes()[0],
        reason: format!(
            "not testable without the signals that show it: it takes {}",
            effect.excitation
        ),
        statistic: 0.0,
        p_value: 1.0,
        held_out_gain: None,
    }
}

/// Known parameters that left what was known of them, in links that the judging sessions prefer as they
/// are now. The limit is corrected for the number of parameters that could have moved (Bonferroni).
fn refits(start: &Twin, twin: &Twin, outcomes: &[Outcome<'_>]) -> Vec<Refit> {
    let better = |instance: usize| {
        // A scatter is measured on the camera, without a slot that is fitted.
        let is_noise = twin.instances[instance].effect.is_noise();
        let fitted = |own: &&Outcome<'_>| {
            own.is_better && own.last.slots.iter().any(|s| s.instance == instance)
                || is_noise && own.kind == StageKind::Camera
        };
        outcomes.iter().find(fitted)
    };
    let tries: usize = outcomes.iter().map(|outcome| outcome.last.slots.len()).sum();
    let beyond_chance = 1.0 - 0.5 * rounds::FAMILY_ERROR / tries.max(1) as f64;
    let plain = Twin::nominal(start.machine);
    let mut refits = Vec::new();
    for (index, after) in twin.instances.iter().enumerate() {
        let Some(known) = known_as(start, index, after) else { continue };
        let before = &start.instances[known];
        let Some(outcome) = better(index) else { continue };
        let freedom = outcome.uncertainty.freedom;
        let in_half_intervals = t_quantile(beyond_chance, freedom) / t_quantile(0.975, freedom);
        for (k, parameter) in before.effect.parameters.iter().enumerate() {
            let (old, new) = (&before.values[k], &after.values[k]);
            let Some([low, high]) = new.ci95 else { continue };
            if new.source != Source::Fitted || parameter.per_session {
                continue;
            }
            let old_half = old.ci95.map_or(0.0, |[low, high]| 0.5 * (high - low));
            // The simulation's own error is in both values, and not in their difference.
            let slot = Slot { instance: known, parameter: k };
            let common = t_quantile(0.975, freedom) * FIDELITY * changed(&plain, start, slot);
            let old_half = (old_half.powi(2) - common.powi(2)).max(0.0).sqrt();
            let limit = in_half_intervals * (0.5 * (high - low)).hypot(old_half);
            let change = (new.value - old.value).abs();
            if limit < change && LEAST_MOVE * parameter.scale.max(old.value.abs()) < change {
                refits.push(Refit {
                    name: format!("{}.{}", before.effect.name, parameter.name),
                    axis: after.axis,
                    before: old.value,
                    after: new.value,
                    ci95: new.ci95,
                    unit: parameter.unit.to_owned(),
                });
            }
        }
    }
    refits
}

/// As which of its instances the twin had the instance `index` at the `start`, perhaps on both motors or rails alike.
fn known_as(start: &Twin, index: usize, instance: &Instance) -> Option<usize> {
    let is_same =
        |own: &Instance| own.effect == instance.effect && own.axis.overlaps(instance.axis);
    let at_index = (index < start.instances.len()).then_some(index);
    at_index.or_else(|| start.instances.iter().position(is_same))
}

fn signal_gaps(outcome: &Outcome<'_>, floors: &[Floor]) -> Vec<SignalGap> {
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
        .map(|(k, (channel, floor))| SignalGap {
            domain: channel.domain,
            signal: channel.signal.clone(),
            unit: channel.unit.to_owned(),
            band: "all".to_owned(),
            noise_floor: (floor.source != FloorSource::Unknown).then_some(floor.rms),
            noise_floor_source: match floor.source {
                FloorSource::Rest => format!("scatter at rest, {} samples", floor.samples),
                FloorSource::Smoothness => format!(
                    "scatter of the measured signal about a smooth course, {} samples",
                    floor.samples
                ),
                FloorSource::Unknown => "too few samples".to_owned(),
            },
            train_before: at(0, k),
            train_after: at(1, k),
            held_out_before: at(2, k),
            held_out_after: at(3, k),
        })
        .collect()
}

/// Where the camera's detections come from unless somebody says otherwise.
const CAMERA: &str = " --camera udp:127.0.0.1:9870";

/// A `collect` command that drives `patterns` with repeats.
fn collect_command(patterns: &[&str]) -> String {
    let patterns: Vec<String> = patterns.iter().map(|name| format!("--pattern {name}")).collect();
    format!("klasktron collect {} --seconds 10 --repeat 2 --output next.mcap", patterns.join(" "))
}

/// What would decide what is left: the class first, then what could not be tested. Where no camera saw the
/// striker, one belongs to it.
fn next_experiment(
    class: &[Class],
    outcomes: &[Outcome<'_>],
    unseen: &[&'static Effect],
) -> Option<String> {
    let mut patterns: Vec<&str> = Vec::new();
    let mut add = |name: &str| {
        if let Some(effect) = crate::effects::find(name)
            && !effect.experiment.is_empty()
            && !patterns.contains(&effect.experiment)
        {
            patterns.push(effect.experiment);
        }
    };
    class.iter().flat_map(|class| &class.names).for_each(|name| add(name));
    for rejected in outcomes.iter().flat_map(|outcome| &outcome.rejected) {
        if rejected.reason == Reason::NotTestable {
            add(rejected.candidate.effect.name);
        }
    }
    let is_driven = outcomes.iter().any(|outcome| outcome.kind == StageKind::Drive);
    let with_camera = |effect: &&&Effect| is_driven && effect.domain == Domain::Coupling;
    let unseen: Vec<&&Effect> = unseen.iter().filter(with_camera).collect();
    unseen.iter().for_each(|effect| add(effect.name));
    patterns.truncate(4);
    let camera = if unseen.is_empty() { "" } else { CAMERA };
    (!patterns.is_empty()).then(|| collect_command(&patterns) + camera)
}

fn doubts(sessions: &[Session], outcomes: &[Outcome<'_>]) -> Vec<String> {
    let mut doubts = undetermined(outcomes);
    for outcome in outcomes {
        for (problem, split) in
            [(&outcome.train, Split::Train), (&outcome.held_out, Split::Validation)]
        {
            let named = stages(sessions, outcome.kind, split).map(|(session, _)| &session.name);
            for (part, session) in problem.parts.iter().zip(named) {
                doubts.extend(part.incidents.iter().map(|own| left_out(session, own)));
            }
        }
        if let Some(unknown) = &outcome.unexplained {
            doubts.push(format!(
                "what is left of {} still depends on {} ({:.0} % of it)",
                unknown.signal,
                unknown.name,
                100.0 * unknown.share
            ));
        }
        if outcome.held_out.parts.is_empty() {
            doubts.push(format!("{:?}: nothing was held out, so no name is tested", outcome.kind));
        }
    }
    doubts
}

/// Numbers that no link determines, of those to which they mean anything.
fn undetermined(outcomes: &[Outcome<'_>]) -> Vec<String> {
    let mut numbers: Vec<(String, bool)> = Vec::new();
    for outcome in outcomes {
        for (index, slot) in outcome.last.slots.iter().enumerate() {
            let instance = &outcome.last.point.twin.instances[slot.instance];
            let Parameter { name, .. } = instance.effect.parameters[slot.parameter];
            let number = format!("{}.{name} on {}", instance.effect.name, instance.axis);
            let is_known = !outcome.uncertainty.undetermined[index];
            match numbers.iter_mut().find(|(other, _)| *other == number) {
                Some((_, known)) => *known |= is_known,
                None => numbers.push((number, is_known)),
            }
        }
    }
    let unknown = numbers.into_iter().filter(|(_, is_known)| !is_known);
    unknown.map(|(number, _)| format!("the data do not determine {number}")).collect()
}

/// Tells of an incident of the session of that name.
fn left_out(session: &str, incident: &Incident) -> String {
    let Incident { signal, unit, farthest, span } = incident;
    format!(
        "{session}: {signal} is off by up to {farthest:.3} {unit} from {:.1} to {:.1} s and by nothing like it \
         anywhere else; this was left out (something that was touched, or the end of a rail?)",
        span.start, span.end
    )
}
