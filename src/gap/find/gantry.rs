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

/// Most searches of the drives. The reaction force is first that of the camera stage alone, then that of the camera stage
/// after the drives.
const MOST_DRIVE_SEARCHES: usize = 3;

/// Friction of the striker, in every effect that exerts a reaction force.
const STRIKER_FRICTION: &str = "force_n";

/// Return whether an effect acts behind the carriage and exerts a reaction force on the drives.
fn reacts(effect: &Effect) -> bool {
    effect.physics.equations().iter().any(|own| matches!(own, Physics::Reaction(_)))
}

/// All effects of `twin` with a reaction force on the drives.
fn reactions_of(twin: &Twin) -> Vec<Instance> {
    twin.instances.iter().filter(|own| reacts(own.effect)).cloned().collect()
}

/// `twin` with these `reactions` in place of its own. Other effects keep their index. Of an effect that the twin has, only the
/// friction changes: a spring of any stiffness transmits it, and the camera may take a soft belt for a soft spring.
fn with_reactions(twin: &Twin, reactions: &[Instance]) -> Twin {
    let is_same =
        |one: &Instance, other: &Instance| one.effect == other.effect && one.axis == other.axis;
    let mut twin = twin.clone();
    twin.instances.retain_mut(|own| {
        if !reacts(own.effect) {
            return true;
        }
        let reaction = reactions.iter().find(|reaction| is_same(own, reaction));
        let Some(reaction) = reaction else { return false };
        let mut parameters = own.effect.parameters.iter();
        let friction = parameters.position(|parameter| parameter.name == STRIKER_FRICTION);
        if let Some(friction) = friction {
            own.values[friction].clone_from(&reaction.values[friction]);
        }
        true
    });
    let further: Vec<Instance> = reactions
        .iter()
        .filter(|reaction| !twin.instances.iter().any(|own| is_same(own, reaction)))
        .cloned()
        .collect();
    twin.instances.extend(further);
    twin
}

/// Search of drives and camera, and the twin after both.
///
/// The striker's motion on the camera implies a reaction force on the drives, and the camera stage starts from the
/// fitted drives. The search repeats if a reaction was assumed and none is identified, or the other way round. The `journal`
/// receives the decisions of repeated searches.
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
    let given = reactions_of(start);
    let reactions = |camera: &Outcome<'_>| reactions_of(&camera.last.point.twin);
    let mut assumed = first.as_ref().map_or_else(|| given.clone(), reactions);
    let mut searches = 0;
    loop {
        searches += 1;
        let mut outcomes = Vec::new();
        let mut twin = with_reactions(start, &assumed);
        if let Some(drive) = of(StageKind::Drive, &twin, &outcomes) {
            twin = stated(start, &drive);
            outcomes.push(drive);
        }
        // The camera starts from the given reactions.
        twin = with_reactions(&twin, &given);
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
        let shown = reactions(&camera);
        let is_as_assumed = shown.is_empty() == assumed.is_empty();
        let is_without_consequence =
            assumed.is_empty() && outcomes.iter().all(|drive| drive.added.is_empty());
        twin = stated(start, &camera);
        outcomes.push(camera);
        if is_as_assumed || is_without_consequence || searches == MOST_DRIVE_SEARCHES {
            return (outcomes, twin);
        }
        assumed = shown;
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
    let is_between = |own: &Physics| {
        matches!(own, Physics::Stretch(_) | Physics::Gap(_) | Physics::Transmission(_))
    };
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

    const RUBS: &str = "coupling.striker_friction";

    #[test]
    fn the_drives_feel_the_striker_as_the_camera_has_shown_it() {
        let soft =
            |force: f64, stiffness: f64| (RUBS, Axis::Whole, vec![force, stiffness, 0.3, 0.01]);
        let rubs = |force: f64| soft(force, 600.0);
        let twin = |delay: f64, striker: &[(&'static str, Axis, Vec<f64>)]| {
            let mut list = vec![(DELAY, Axis::Motors, vec![delay])];
            list.extend(striker.iter().cloned());
            let list: Vec<_> = list.iter().map(|own| (own.0, own.1, &own.2[..])).collect();
            Twin::table_with(&list)
        };
        let start = twin(0.01, &[rubs(0.01)]);
        let given = reactions_of(&start);
        let shown = reactions_of(&twin(0.02, &[soft(0.6, 300.0)]));
        assert_eq!(with_reactions(&start, &shown).instances, twin(0.01, &[rubs(0.6)]).instances);
        assert_eq!(with_reactions(&start, &given).instances, start.instances);
        // Added by the camera, and left out again before it searches.
        let plain = twin(0.01, &[]);
        let felt = with_reactions(&plain, &shown);
        assert_eq!(felt.instances, twin(0.01, &[soft(0.6, 300.0)]).instances);
        assert_eq!(with_reactions(&felt, &[]).instances, plain.instances);
    }

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
