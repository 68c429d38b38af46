//! Legs: the motions that a session executes, one after the other.

use super::safety::CheckedPlan;
use crate::{gantry::Reference, recording::topic::Player, scene::PlannedPath};
use std::collections::BTreeMap;

/// One leg: a run that is marked in the recording, or a move between runs.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Number, pattern and split of the run; `None` for a move between runs.
    pub run: Option<RunLabel>,
    /// Motion of each player, all of equal length.
    pub references: Vec<(Player, Reference)>,
}

/// Content of the markers of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunLabel {
    /// Number of the run.
    pub number: u32,
    /// Name of the pattern.
    pub pattern: String,
    /// `train` or `validation`; empty where the split is decided later.
    pub split: String,
}

/// Return the planned paths of all runs by their numbers, for a scene.
#[must_use]
pub fn planned_paths(legs: &[Leg]) -> BTreeMap<u32, Vec<PlannedPath>> {
    let of_player = |(player, reference): &(Player, Reference)| {
        (*player, reference.setpoints().iter().map(|setpoint| setpoint.position).collect())
    };
    let of_leg = |leg: &Leg| {
        let run = leg.run.as_ref()?;
        Some((run.number, leg.references.iter().map(of_player).collect()))
    };
    legs.iter().filter_map(of_leg).collect()
}

impl Leg {
    /// Return the legs of a checked plan: a move to each run, the run, and a move home at the end.
    #[must_use]
    pub fn of_plan(checked: &CheckedPlan) -> Vec<Self> {
        let of_players = |references: &[Reference]| {
            checked.players().iter().copied().zip(references.iter().cloned()).collect()
        };
        let mut legs = Vec::new();
        for checked in checked.runs() {
            let planned = checked.planned();
            let label = RunLabel {
                number: planned.number,
                pattern: planned.pattern.name().to_owned(),
                split: planned.split.to_string(),
            };
            legs.push(Self { run: None, references: of_players(checked.approach()) });
            legs.push(Self { run: Some(label), references: of_players(checked.references()) });
        }
        legs.push(Self { run: None, references: of_players(checked.home()) });
        legs
    }

    /// Return the start position of each player (m).
    pub(super) fn starts(&self) -> Vec<(Player, [f64; 2])> {
        let start = |(player, reference): &(Player, Reference)| Some((*player, reference.start()?));
        self.references.iter().filter_map(start).collect()
    }

    /// Return the length in control periods.
    #[must_use]
    pub fn periods(&self) -> usize {
        self.references.iter().map(|(_, reference)| reference.setpoints().len()).max().unwrap_or(0)
    }
}
