//! The next experiment: the recording that would answer the first open question, on this machine.

use super::{
    findings::{Indistinguishable, NextExperiment},
    rounds::{Outcome, Reason},
};
use crate::{
    effects::{self, Domain, Effect},
    twin::{Machine, StageKind},
};

/// Address of the camera's detections unless the user gives another.
const CAMERA: &str = " --camera udp:127.0.0.1:9870";

/// Most patterns of one experiment.
const MOST_PATTERNS: usize = 4;

/// Most effects that a question lists.
const MOST_NAMES: usize = 4;

/// A `collect` command that drives `patterns` twice each.
fn collect_command(patterns: &[&str]) -> String {
    let patterns: Vec<String> = patterns.iter().map(|name| format!("--pattern {name}")).collect();
    format!("klasktron collect {} --seconds 10 --repeat 2 --output next.mcap", patterns.join(" "))
}

/// The experiment for a `machine` whose recordings were refused.
pub(super) fn after_refusal(machine: Machine) -> NextExperiment {
    let is_driven = machine == Machine::Table;
    NextExperiment {
        command: is_driven.then(|| collect_command(&["x_line", "y_line", "random_walk"])),
        motion: "moves in both directions at several speeds, with command and motion on one clock, in at least two \
                 sessions"
            .to_owned(),
        decides: "whether the twin describes this machine".to_owned(),
    }
}

/// The experiment that answers the first open question: indistinguishable effects, then effects that this motion does
/// not show, then effects that no signal shows. `None` where nothing is open.
pub(super) fn next_experiment(
    machine: Machine,
    indistinguishable: &[Indistinguishable],
    outcomes: &[Outcome<'_>],
    unseen: &[&'static Effect],
) -> Option<NextExperiment> {
    let is_driven = machine == Machine::Table
        && outcomes.iter().any(|outcome| outcome.kind == StageKind::Drive);
    if let Some(first) = indistinguishable.first() {
        let of_set = first.names.iter().filter_map(|name| effects::find(name)).collect::<Vec<_>>();
        let decides = format!("which of {} is present", first.names.join(" and "));
        return Some(experiment(&of_set, decides, is_driven, ""));
    }
    let rejected = outcomes.iter().flat_map(|outcome| &outcome.rejected);
    let hidden = rejected.filter(|own| own.reason == Reason::NotTestable);
    let mut open: Vec<&'static Effect> = Vec::new();
    for effect in hidden.map(|own| own.candidate.effect) {
        if !open.contains(&effect) {
            open.push(effect);
        }
    }
    let without_camera: Vec<&'static Effect> = unseen
        .iter()
        .copied()
        .filter(|effect| is_driven && effect.domain == Domain::Coupling)
        .collect();
    let camera = if without_camera.is_empty() { "" } else { CAMERA };
    open.extend(without_camera);
    let fits = |effect: &&'static Effect| !is_driven || !effect.experiment.is_empty();
    if open.iter().any(|effect| fits(effect)) {
        open.retain(fits);
    }
    (!open.is_empty()).then(|| {
        let decides = format!("whether {} act", listed(&open));
        experiment(&open, decides, is_driven, camera)
    })
}

/// Motion and command that show `effects`, the first before the others.
fn experiment(
    effects: &[&'static Effect],
    decides: String,
    is_driven: bool,
    camera: &str,
) -> NextExperiment {
    let mut patterns: Vec<&str> = Vec::new();
    let mut motions: Vec<&str> = Vec::new();
    for effect in effects {
        if !effect.experiment.is_empty() && !patterns.contains(&effect.experiment) {
            patterns.push(effect.experiment);
        }
        if !motions.contains(&effect.excitation) {
            motions.push(effect.excitation);
        }
    }
    patterns.truncate(MOST_PATTERNS);
    motions.truncate(MOST_PATTERNS);
    let is_collected = is_driven && !patterns.is_empty();
    NextExperiment {
        command: is_collected.then(|| collect_command(&patterns) + camera),
        motion: motions.join("; "),
        decides,
    }
}

/// Names of the first effects, and how many more there are.
fn listed(effects: &[&'static Effect]) -> String {
    let names: Vec<&str> = effects.iter().take(MOST_NAMES).map(|effect| effect.name).collect();
    match effects.len().saturating_sub(MOST_NAMES) {
        0 => names.join(", "),
        more => format!("{} and {more} more effects", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(names: &[&str]) -> Indistinguishable {
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        Indistinguishable { names, experiment: String::new() }
    }

    #[test]
    fn no_carriage_moves_for_a_wall_or_a_ball_and_none_for_an_axis() {
        let walls = set(&["impact.wall_restitution_speed", "impact.wall_friction_spin"]);
        let next = next_experiment(Machine::Table, &[walls], &[], &[]).unwrap();
        assert_eq!(next.command, None);
        assert!(next.motion.starts_with("impacts over a factor of two"), "{next:?}");
        assert!(
            next.decides.starts_with("which of impact.wall_restitution_speed and "),
            "{next:?}"
        );
        let friction = set(&["drive.friction.stribeck", "drive.friction.coulomb"]);
        let next = next_experiment(Machine::Axis, &[friction], &[], &[]).unwrap();
        assert!(next.command.is_none() && next.motion.contains("slow reversals"), "{next:?}");
        assert_eq!(next_experiment(Machine::Axis, &[], &[], &[]), None);
        assert!(after_refusal(Machine::Axis).command.is_none());
        assert!(after_refusal(Machine::Table).command.is_some());
    }
}
