//! Errors of a game: settings, arguments, non-finite states.

use crate::recording::topic::Player;

/// Error of building or stepping a game.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GameError {
    /// A setting out of its range.
    #[error("{name} is {value}; it must lie in [{low}, {high}]")]
    Setting {
        /// Name of the setting, with its unit.
        name: &'static str,
        /// Value of the setting.
        value: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// A range with reversed ends.
    #[error("{name} reaches from {low} to {high}; the first must not exceed the second")]
    Range {
        /// Name of the setting, with its unit.
        name: &'static str,
        /// First end of the range.
        low: f64,
        /// Second end of the range.
        high: f64,
    },
    /// A twin without a two-axis gantry.
    #[error("this twin describes a {machine}; a game needs a twin of the whole table")]
    NotATable {
        /// Machine that the twin describes.
        machine: String,
    },
    /// A wall limiter on the motion, behind a twin whose carriage has inertia.
    #[error(
        "the wall limiter cannot act behind a twin, whose carriage has inertia; \
         let it act on the command (LimiterPlace::Command)"
    )]
    LimiterBehindTwin,
    /// An array of the wrong length.
    #[error("{what} has {found} entries, but these games need {expected}")]
    Shape {
        /// Name of the array.
        what: &'static str,
        /// Number of entries given.
        found: usize,
        /// Number of entries required.
        expected: usize,
    },
    /// A command that is not finite.
    #[error(
        "the command of the {player} player in environment {environment} is ({x}, {y}) m/s; it must be finite"
    )]
    Command {
        /// Number of the environment, counted over all ranges.
        environment: usize,
        /// Player of the command.
        player: Player,
        /// Velocity across, in the player's own frame (m/s).
        x: f32,
        /// Velocity towards the other player (m/s).
        y: f32,
    },
    /// A virtual rig as an environment that cannot go on.
    #[error("the rig of environment {environment}: {reason}")]
    Rig {
        /// Number of the environment, counted over all ranges.
        environment: usize,
        /// Reason of the session or of the configuration.
        reason: String,
    },
    /// An environment with a state that is not finite.
    #[error(
        "environment {environment}: the state is not finite in step {step} of episode {episode}, seed {seed}"
    )]
    NotFinite {
        /// Number of the environment, counted over all ranges.
        environment: usize,
        /// Episode of the environment, from 0.
        episode: u64,
        /// Control period within the episode, from 0.
        step: u32,
        /// Seed of the games.
        seed: u64,
    },
}

/// Check that `value` is in `[low, high]`.
pub(super) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), GameError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(GameError::Setting { name, value, low, high })
    }
}
