//! Players of a match.

use super::PlayError;
use crate::{
    ekf::FilterSettings,
    gantry::Robot,
    opponent::Scripted,
    recording::Recording,
    train::{StoredPolicy, read_policy},
};
use std::{fmt, path::PathBuf, str::FromStr};

/// Player of one side, as typed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Who {
    /// `none`: this gantry is not driven.
    Nobody,
    /// The name of a scripted player.
    Scripted(Scripted),
    /// The file of a policy.
    Policy(PathBuf),
}

/// A word that is not a player.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no player; the players are {names}, none, or a policy.mcap of `klasktron train`",
    names = Scripted::ALL.map(Scripted::name).join(", ")
)]
pub struct WhoError(String);

impl FromStr for Who {
    type Err = WhoError;

    fn from_str(text: &str) -> Result<Self, WhoError> {
        if text == "none" {
            return Ok(Self::Nobody);
        }
        if let Some(script) = Scripted::ALL.into_iter().find(|script| script.name() == text) {
            return Ok(Self::Scripted(script));
        }
        let path = PathBuf::from(text);
        let is_file =
            path.extension().is_some_and(|extension| extension == "mcap") || path.is_file();
        if is_file { Ok(Self::Policy(path)) } else { Err(WhoError(text.to_owned())) }
    }
}

/// A player that can decide.
#[derive(Debug, Clone)]
pub enum Seat {
    /// A scripted player.
    Scripted(Scripted),
    /// A trained policy.
    Policy {
        /// Name of the policy file.
        file: String,
        /// SHA-256 of the file, in hexadecimal.
        sha256: String,
        /// Content of the file.
        policy: Box<StoredPolicy>,
    },
}

impl Seat {
    /// Load the player `who`; `None` for an empty seat.
    ///
    /// # Errors
    /// When the file cannot be read, or holds no policy for this game; the error has the values
    /// that differ.
    pub fn read(who: &Who) -> Result<Option<Self>, PlayError> {
        let path = match who {
            Who::Nobody => return Ok(None),
            Who::Scripted(script) => return Ok(Some(Self::Scripted(*script))),
            Who::Policy(path) => path,
        };
        let recording = Recording::open(path)?;
        let policy = Box::new(read_policy(&recording)?);
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        Ok(Some(Self::Policy { file, sha256: recording.sha256, policy }))
    }

    /// Difference between the filter in the training of a policy and that of the match.
    pub(super) fn filter_warning(&self, filter: &FilterSettings) -> Option<String> {
        let Self::Policy { file, policy, .. } = self else { return None };
        let trained = policy.settings.sensors?.filter;
        let of = |own: &FilterSettings| {
            let (latency_ms, noise_mm) = (1e3 * own.latency_s, 1e3 * own.ball.measurement_sigma_m);
            format!("{latency_ms:.1} ms latency and {noise_mm:.2} mm noise of the ball")
        };
        (trained != *filter).then(|| {
            format!(
                "{file} was trained with the filter of another ekf.json ({}) than this match uses ({}); give its \
                 own with --ekf",
                of(&trained),
                of(filter)
            )
        })
    }

    /// Difference between the training of a policy and `robot` that can degrade its play.
    pub(super) fn slew_warning(&self, robot: &Robot) -> Option<String> {
        let Self::Policy { file, policy, .. } = self else { return None };
        let (learned, has) = (policy.command_slew_m_per_s2?, robot.limits.slew_m_per_s2);
        (has < learned).then(|| {
            format!(
                "{file} was trained with a slew limit of {learned} m/s^2, but limits.slew_m_per_s2 of \
                 the robot file is {has}: the strikers will react later than in training"
            )
        })
    }
}

impl fmt::Display for Seat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scripted(script) => script.fmt(f),
            Self::Policy { file, .. } => f.write_str(file),
        }
    }
}
