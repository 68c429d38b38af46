//! Stretches of motion: what a session drives, one after the other.

use super::proof::Proof;
use crate::{gantry::Reference, recording::topic::Player};

/// One stretch of motion: a run that is marked in the recording, or the way to the next one.
#[derive(Debug, Clone, PartialEq)]
pub struct Leg {
    /// Number, pattern and split of the run; `None` on the way between runs.
    pub run: Option<RunLabel>,
    /// The motion of each player, all of one length.
    pub references: Vec<(Player, Reference)>,
}

/// What the markers of a run say.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunLabel {
    /// Number of the run.
    pub number: u32,
    /// Pattern, as in the markers.
    pub pattern: String,
    /// `train` or `validation`; empty where whoever reads the recording decides.
    pub split: String,
}

impl Leg {
    /// The legs of a proven plan: to each run, the run, and home at the end.
    #[must_use]
    pub fn of_proof(proof: &Proof) -> Vec<Self> {
        let of_players = |references: &[Reference]| {
            proof.players().iter().copied().zip(references.iter().cloned()).collect()
        };
        let mut legs = Vec::new();
        for proven in proof.runs() {
            let planned = proven.planned();
            let label = RunLabel {
                number: planned.number,
                pattern: planned.pattern.name().to_owned(),
                split: planned.split.to_string(),
            };
            legs.push(Self { run: None, references: of_players(proven.approach()) });
            legs.push(Self { run: Some(label), references: of_players(proven.references()) });
        }
        legs.push(Self { run: None, references: of_players(proof.home()) });
        legs
    }

    /// Where each player begins (m).
    pub(super) fn starts(&self) -> Vec<(Player, [f64; 2])> {
        let start = |(player, reference): &(Player, Reference)| Some((*player, reference.start()?));
        self.references.iter().filter_map(start).collect()
    }

    /// Its length in control periods.
    #[must_use]
    pub fn periods(&self) -> usize {
        self.references.iter().map(|(_, reference)| reference.setpoints().len()).max().unwrap_or(0)
    }
}
