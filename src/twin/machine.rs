//! The kind of machine that a twin describes.

use super::{Session, StageKind};
use crate::effects::{Axis, Site};
use serde::{Deserialize, Serialize};

/// Kind of machine that a twin describes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Machine {
    /// The KlaskTron table: two motors, two axes, magnet, striker, camera, ball.
    Table,
    /// A single axis.
    Axis,
}

impl std::fmt::Display for Machine {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Table => "table",
            Self::Axis => "single axis",
        })
    }
}

impl Machine {
    /// Motors of one gantry.
    #[must_use]
    pub fn motors(self) -> usize {
        match self {
            Self::Table => 2,
            Self::Axis => 1,
        }
    }

    /// Locations at which an effect of `site` may act on this machine.
    #[must_use]
    pub fn axes(self, site: Site) -> Vec<Axis> {
        match self {
            Self::Table if site == Site::SingleAxis => Vec::new(),
            Self::Table => site.axes().to_vec(),
            Self::Axis if matches!(site, Site::OneMotor | Site::EachBelt) => Vec::new(),
            Self::Axis => vec![Axis::Single],
        }
    }

    /// `axis` as it is called on this machine: twins of a single axis once had the locations of a table.
    #[must_use]
    pub(super) fn own_name(self, axis: Axis) -> Axis {
        match self {
            Self::Table => axis,
            Self::Axis => Axis::Single,
        }
    }
}

/// Kind of machine on which `sessions` were recorded: a single axis when nothing else is there.
#[must_use]
pub fn machine_of(sessions: &[Session]) -> Machine {
    let only_axes =
        |session: &Session| session.stages().iter().all(|stage| stage.kind() == StageKind::Axis);
    if sessions.iter().all(only_axes) { Machine::Axis } else { Machine::Table }
}
