//! The next experiment: the recording that would answer the first open question, on this machine.

use super::{
    findings::{Indistinguishable, NextExperiment},
    rounds::{Outcome, Reason},
};
use crate::{
    effects::{self, Domain, Effect},
    twin::{Machine, Session, StageKind},
};

/// Address of the camera's detections unless the user gives another.
const CAMERA: &str = " --camera udp:127.0.0.1:9870";

/// Bus of a real table whose recordings do not state it.
const BUS: &str = "socketcan:can0";

/// Effects between two axes or two motors, which no motion of a single axis shows.
const OF_TWO_AXES: [&str; 6] = [
    "gantry.cross_coupling",
    "gantry.racking",
    "gantry.squareness",
    "gantry.belt_asymmetry",
    "drive.supply_sag",
    "sensor.camera_scale_rotation",
];

/// Effects of a single axis that its known parameters imitate in most motions: a constant force is its offset, and a gain
/// multiplies its mass and frictions.
const IMITATED: [&str; 2] = ["gantry.tilt", "drive.gain"];

/// Requirement of an experiment on a table; a recording of a single axis always meets it.
const WITH_TORQUE: &str = ", with the torque recorded";

/// Most patterns of one experiment.
const MOST_PATTERNS: usize = 4;

/// Most effects that a question lists.
const MOST_NAMES: usize = 4;

/// Machine on which an experiment is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Setup<'a> {
    machine: Machine,
    /// Bus of a real table; `None` for the virtual one and for simulations.
    bus: Option<&'a str>,
    has_camera: bool,
    /// `true` where the outcomes have a drive that klasktron commands.
    is_driven: bool,
    /// `true` where the experiment adds a camera that the recordings lack.
    adds_camera: bool,
}

impl<'a> Setup<'a> {
    /// Setup with which `sessions` were recorded.
    pub(super) fn of(machine: Machine, sessions: &'a [Session]) -> Self {
        let is_real = sessions.iter().any(|session| session.source.is_real());
        let stated = sessions.iter().find_map(|session| session.source.bus.as_deref());
        Self {
            machine,
            bus: is_real.then(|| stated.unwrap_or(BUS)),
            has_camera: sessions.iter().any(|session| session.camera.is_some()),
            is_driven: false,
            adds_camera: false,
        }
    }

    /// Return whether a motion of this machine can show `effect`.
    fn can_show(&self, effect: &Effect) -> bool {
        self.machine == Machine::Table
            || !OF_TWO_AXES.contains(&effect.name) && !IMITATED.contains(&effect.name)
    }

    /// The motion that shows `effect`.
    fn motion(&self, effect: &'static Effect) -> &'static str {
        match self.machine {
            Machine::Table => effect.excitation,
            Machine::Axis => effect.excitation.trim_end_matches(WITH_TORQUE),
        }
    }

    /// A `collect` command that drives `patterns` twice each.
    fn command(&self, patterns: &[&str]) -> String {
        let bus = self.bus.map_or_else(String::new, |bus| format!(" --bus {bus}"));
        let patterns: String = patterns.iter().map(|name| format!(" --pattern {name}")).collect();
        // The virtual table has its own camera.
        let camera =
            if self.adds_camera || self.bus.is_some() && self.has_camera { CAMERA } else { "" };
        format!(
            "klasktron collect{bus}{patterns} --seconds 10 --repeat 2 --output next.mcap{camera}"
        )
    }
}

/// The experiment for a machine whose recordings were refused.
pub(super) fn after_refusal(setup: Setup<'_>) -> NextExperiment {
    let is_driven = setup.machine == Machine::Table;
    NextExperiment {
        command: is_driven.then(|| setup.command(&["x_line", "y_line", "random_walk"])),
        motion: "moves in both directions at several speeds, with command and motion on one clock, in at least two \
                 sessions"
            .to_owned(),
        decides: "whether the twin describes this machine".to_owned(),
    }
}

/// The experiment that answers the first open question: indistinguishable effects, then effects that this motion does
/// not show, then effects that no signal shows. `None` where nothing is open.
pub(super) fn next_experiment(
    setup: Setup<'_>,
    indistinguishable: &[Indistinguishable],
    outcomes: &[Outcome<'_>],
    unseen: &[&'static Effect],
) -> Option<NextExperiment> {
    let is_driven = setup.machine == Machine::Table
        && outcomes.iter().any(|outcome| outcome.kind == StageKind::Drive);
    let setup = Setup { is_driven, ..setup };
    if let Some(first) = indistinguishable.first() {
        let of_set = first.names.iter().filter_map(|name| effects::find(name)).collect::<Vec<_>>();
        let decides = format!("which of {} is present", first.names.join(" and "));
        return Some(experiment(&of_set, decides, setup));
    }
    let rejected = outcomes.iter().flat_map(|outcome| &outcome.rejected);
    let hidden = rejected.filter(|own| own.reason == Reason::NotTestable);
    let mut open: Vec<&'static Effect> = Vec::new();
    for effect in hidden.map(|own| own.candidate.effect) {
        if setup.can_show(effect) && !open.contains(&effect) {
            open.push(effect);
        }
    }
    let without_camera: Vec<&'static Effect> = unseen
        .iter()
        .copied()
        .filter(|effect| is_driven && effect.domain == Domain::Coupling)
        .collect();
    let setup = Setup { adds_camera: !without_camera.is_empty(), ..setup };
    open.extend(without_camera);
    let fits = |effect: &&'static Effect| !is_driven || !effect.experiment.is_empty();
    if open.iter().any(&fits) {
        open.retain(fits);
    }
    (!open.is_empty()).then(|| {
        let verb = if open.len() == 1 { "acts" } else { "act" };
        let decides = format!("whether {} {verb}", listed(&open));
        experiment(&open, decides, setup)
    })
}

/// Motion that shows `effects`, the first before the others, and its command if klasktron drives the machine of `setup`.
fn experiment(effects: &[&'static Effect], decides: String, setup: Setup<'_>) -> NextExperiment {
    let mut patterns: Vec<&str> = Vec::new();
    let mut motions: Vec<&str> = Vec::new();
    for effect in effects {
        if !effect.experiment.is_empty() && !patterns.contains(&effect.experiment) {
            patterns.push(effect.experiment);
        }
        let motion = setup.motion(effect);
        if !motions.contains(&motion) {
            motions.push(motion);
        }
    }
    patterns.truncate(MOST_PATTERNS);
    motions.truncate(MOST_PATTERNS);
    NextExperiment {
        command: (setup.is_driven && !patterns.is_empty()).then(|| setup.command(&patterns)),
        motion: motions.join("; "),
        decides,
    }
}

/// Names of the first effects, and how many more there are.
fn listed(effects: &[&'static Effect]) -> String {
    let names: Vec<&str> = effects.iter().take(MOST_NAMES).map(|effect| effect.name).collect();
    match effects.len().saturating_sub(MOST_NAMES) {
        0 => names.join(", "),
        1 => format!("{} and 1 more effect", names.join(", ")),
        more => format!("{} and {more} more effects", names.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VIRTUAL: Setup<'_> = Setup {
        machine: Machine::Table,
        bus: None,
        has_camera: true,
        is_driven: false,
        adds_camera: false,
    };
    const AXIS: Setup<'_> = Setup { machine: Machine::Axis, ..VIRTUAL };

    fn set(names: &[&str]) -> Indistinguishable {
        let names = names.iter().map(|name| (*name).to_owned()).collect();
        Indistinguishable { names, experiment: String::new() }
    }

    #[test]
    fn no_carriage_moves_for_a_wall_or_a_ball_and_none_for_an_axis() {
        let walls = set(&["impact.wall_restitution_speed", "impact.wall_friction_spin"]);
        let next = next_experiment(VIRTUAL, &[walls], &[], &[]).unwrap();
        assert_eq!(next.command, None);
        assert!(next.motion.starts_with("impacts over a factor of two"), "{next:?}");
        assert!(
            next.decides.starts_with("which of impact.wall_restitution_speed and "),
            "{next:?}"
        );
        let friction = set(&["drive.friction.stribeck", "drive.friction.coulomb"]);
        let next = next_experiment(AXIS, &[friction], &[], &[]).unwrap();
        assert!(next.command.is_none() && next.motion.contains("slow reversals"), "{next:?}");
        assert_eq!(next_experiment(AXIS, &[], &[], &[]), None);
        assert!(after_refusal(AXIS).command.is_none());
        assert!(after_refusal(VIRTUAL).command.is_some());
    }

    #[test]
    fn the_command_drives_the_machine_that_was_recorded() {
        let command = |setup: Setup<'_>| after_refusal(setup).command.unwrap();
        assert!(!command(VIRTUAL).contains("--bus") && !command(VIRTUAL).contains("--camera"));
        for name in OF_TWO_AXES {
            let effect = effects::find(name).unwrap();
            assert!(VIRTUAL.can_show(effect) && !AXIS.can_show(effect), "{name}");
        }
        let real = Setup { bus: Some("slcan:/dev/ttyACM0"), ..VIRTUAL };
        assert!(command(real).starts_with("klasktron collect --bus slcan:/dev/ttyACM0 --pattern"));
        assert!(command(real).ends_with(CAMERA), "{}", command(real));
        assert!(!command(Setup { has_camera: false, ..real }).contains("--camera"));
    }
}
