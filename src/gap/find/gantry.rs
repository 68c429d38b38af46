//! Search of the drives and of the camera, which depend on each other.

use super::{Request, search_stage, stages, stated};
use crate::{
    effects::{Effect, Physics},
    gap::{
        journal::{JournalEntry, MoveKind},
        rounds::{Outcome, Task},
    },
    recording::Split,
    twin::{Instance, Session, Slot, StageKind, Twin},
};

/// Most searches of the drives. The reaction force is first that of the camera stage alone, then zero, then that of the
/// camera stage after the fit of the drives.
const MOST_DRIVE_SEARCHES: usize = 3;

/// Effect added on the camera stage that acts behind the carriage and exerts a reaction force on the drives.
fn reaction_of(camera: &Outcome<'_>) -> Option<Instance> {
    let is_felt = |effect: &Effect| {
        effect.physics.equations().iter().any(|own| matches!(own, Physics::Reaction(_)))
    };
    let step = camera.added.iter().find(|step| is_felt(step.effect))?;
    camera.last.point.twin.instance(step.effect.name, step.axis).cloned()
}

/// Search of drives and camera, and the twin after both.
///
/// The striker's motion on the camera implies a reaction force on the drives, and the camera stage starts from the
/// fitted drives. The search repeats until the assumed reaction is the identified one. The `journal` receives the
/// decisions of repeated searches.
pub(super) fn search<'a>(
    sessions: &'a [Session],
    start: &Twin,
    request: Request<'a>,
    journal: &mut Vec<JournalEntry>,
) -> (Vec<Outcome<'a>>, Twin) {
    let of = |kind, twin: &Twin, before: &[Outcome<'_>]| {
        search_stage(sessions, kind, twin, request, before)
    };
    let has_drives = stages(sessions, StageKind::Drive, Split::Train).next().is_some();
    let precedes_drives = request.task == Task::CloseGap && has_drives;
    let mut first = precedes_drives.then(|| of(StageKind::Camera, start, &[])).flatten();
    let mut reaction = first.as_ref().and_then(reaction_of);
    let mut searches = 0;
    loop {
        searches += 1;
        let mut outcomes = Vec::new();
        let mut twin = start.clone();
        twin.instances.extend(reaction.clone());
        if let Some(drive) = of(StageKind::Drive, &twin, &outcomes) {
            twin = stated(start, &drive);
            outcomes.push(drive);
        }
        let is_reaction = |own: &Instance| {
            reaction.as_ref().is_some_and(|reaction| own.effect == reaction.effect)
        };
        twin.instances.retain(|own| !is_reaction(own));
        let camera = match (first.take(), outcomes.first()) {
            (Some(camera), Some(drive)) if is_independent(&camera, drive, start) => {
                Some(after_drives(camera, start, &twin))
            }
            (camera, _) => {
                journal.extend(camera.into_iter().flat_map(|own| own.journal));
                of(StageKind::Camera, &twin, &outcomes)
            }
        };
        let Some(camera) = camera else {
            return (outcomes, twin);
        };
        let shown = reaction_of(&camera);
        let effect = |reaction: &Option<Instance>| reaction.as_ref().map(|own| own.effect);
        let is_without_consequence =
            reaction.is_none() && outcomes.iter().all(|drive| drive.added.is_empty());
        twin = stated(start, &camera);
        outcomes.push(camera);
        if effect(&shown) == effect(&reaction)
            || is_without_consequence
            || searches == MOST_DRIVE_SEARCHES
        {
            return (outcomes, twin);
        }
        reaction = shown;
        log::info!("the force of the striker on the drives changed: the drives are searched again");
        journal.extend(outcomes.iter().flat_map(|outcome| outcome.journal.clone()));
        journal.push(JournalEntry::new(
            MoveKind::Refit,
            Some(StageKind::Drive),
            "The camera shows another force of the striker on the carriage than was assumed: the drives are searched again",
        ));
    }
}

/// Return whether a search of the camera from the twin `start` would find the same after the `drive` stage.
///
/// The camera stage predicts from the measured carriage. Masses and friction act there only through compliance or
/// backlash. So the search would repeat itself where the drives fitted no parameter that acts there, and where the twin has
/// neither.
fn is_independent(camera: &Outcome<'_>, drive: &Outcome<'_>, start: &Twin) -> bool {
    let (own, fitted) = (&camera.last.point.twin, &drive.last.point.twin);
    let acts = |slot: &Slot| is_called(camera, fitted.instances[slot.instance].effect);
    !drive.last.slots.iter().any(acts)
        && !own.instances.iter().any(|own| is_play(own.effect))
        && begins_with(own, start)
        && begins_with(fitted, start)
}

/// Return whether the camera stage calls the physics of `effect`.
fn is_called(camera: &Outcome<'_>, effect: &Effect) -> bool {
    camera.train.parts.iter().any(|part| part.stage.calls(effect))
}

/// Return whether an effect lets the carriage move relative to its motors.
fn is_play(effect: &Effect) -> bool {
    let is_between = |own: &Physics| matches!(own, Physics::Backlash(_) | Physics::Transmission(_));
    effect.physics.equations().iter().any(is_between)
}

/// Return whether the first effects of `twin` are those of `start`.
fn begins_with(twin: &Twin, start: &Twin) -> bool {
    let same =
        |(own, first): (&Instance, &Instance)| own.effect == first.effect && own.axis == first.axis;
    start.instances.len() <= twin.instances.len()
        && twin.instances.iter().zip(&start.instances).all(same)
}

/// Result of a search of the camera from the twin `start`, on the `drives` twin that begins with the same effects. Added
/// effects keep their index, before those of the drives.
fn after_drives<'a>(mut camera: Outcome<'a>, start: &Twin, drives: &Twin) -> Outcome<'a> {
    let on_drives = |own: &Twin| {
        merged([own, drives], start.instances.len(), |effect| is_called(&camera, effect))
    };
    let [last, held_out] = [&camera.last.point.twin, &camera.last_held_out.twin].map(on_drives);
    (camera.last.point.twin, camera.last_held_out.twin) = (last, held_out);
    camera
}

/// The twin of the drives with the effects of that of the camera that it calls. Their first effects, `shared` ones, are
/// the same; further ones of the camera come before those of the drives.
fn merged(
    [camera, drives]: [&Twin; 2],
    shared: usize,
    is_called: impl Fn(&Effect) -> bool,
) -> Twin {
    let pairs = camera.instances[..shared].iter().zip(&drives.instances[..shared]);
    let first = pairs.map(|(own, drive)| if is_called(own.effect) { own } else { drive });
    let added = camera.instances[shared..].iter().chain(&drives.instances[shared..]);
    Twin { instances: first.chain(added).cloned().collect(), ..drives.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{Axis, find};

    const LATENCY: &str = "sensor.camera_latency";
    const DELAY: &str = "drive.delay";

    #[test]
    fn each_stage_keeps_its_values_and_the_effects_that_it_added() {
        let scaled = |scale: f64, effect: &str, axis: Axis, value: f64| {
            let own = ("sensor.camera_scale_rotation", Axis::Whole, &[scale, 0.0][..]);
            Twin::table_with(&[own, (effect, axis, &[value])])
        };
        let camera = scaled(1.02, LATENCY, Axis::Whole, 0.02);
        let mut drives = scaled(1.0, DELAY, Axis::Motors, 0.01);
        let shared = camera.instances.len() - 1;
        let scale = Slot { instance: shared - 1, parameter: 0 };
        drives.controller_reference_mass = Some(3.0);
        let frequency = Slot { instance: 0, parameter: 0 };
        drives.set(frequency, 17.0);
        let both = merged([&camera, &drives], shared, |effect| effect.name.starts_with("sensor"));
        assert_eq!((both.get(frequency), both.get(scale)), (17.0, 1.02));
        assert_eq!(
            both.instances[shared..].iter().map(|own| own.effect.name).collect::<Vec<_>>(),
            [LATENCY, DELAY]
        );
        assert_eq!(both.controller_reference_mass, Some(3.0));
    }

    #[test]
    fn a_twin_with_another_effect_among_the_first_does_not_begin_with_them() {
        let start = Twin::table_with(&[(DELAY, Axis::Motors, &[0.01])]);
        assert!(begins_with(&Twin::table_with(&[(DELAY, Axis::Motors, &[0.02])]), &start));
        let longer =
            Twin::table_with(&[(DELAY, Axis::Motors, &[0.02]), (LATENCY, Axis::Whole, &[0.0])]);
        assert!(begins_with(&longer, &start));
        let split = Twin::table_with(&[(DELAY, Axis::A, &[0.02]), (DELAY, Axis::B, &[0.02])]);
        assert!(!begins_with(&split, &start) && !begins_with(&Twin::table_with(&[]), &start));
    }

    #[test]
    fn compliance_and_backlash_let_the_carriage_move_relative_to_its_motors() {
        for name in ["drive.backlash", "drive.compliance.belt", "gantry.belt_asymmetry"] {
            assert!(is_play(find(name).unwrap()), "{name}");
        }
        for name in [DELAY, LATENCY, "coupling.magnet_spring", "gantry.squareness"] {
            assert!(!is_play(find(name).unwrap()), "{name}");
        }
    }
}
