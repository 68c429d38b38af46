//! What can be wrong with a game: its settings, what it is given, what it computes.

use crate::recording::topic::Player;

/// Why there is no game, or no next step.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GameError {
    /// A setting out of its range.
    #[error("{name} is {value}; it must lie in [{low}, {high}]")]
    Setting {
        /// Which; its unit is in the name.
        name: &'static str,
        /// What was given.
        value: f64,
        /// Least allowed.
        low: f64,
        /// Most allowed.
        high: f64,
    },
    /// A range whose ends are the wrong way round.
    #[error("{name} reaches from {low} to {high}; the first must not exceed the second")]
    Range {
        /// Which; its unit is in the name.
        name: &'static str,
        /// First end.
        low: f64,
        /// Second end.
        high: f64,
    },
    /// A twin that has no two rails.
    #[error("this twin describes a {machine}; a game needs one of the whole table")]
    NotATable {
        /// What it describes.
        machine: String,
    },
    /// The twin drives the carriage by forces, so a limit on what comes out of it has no meaning.
    #[error(
        "the wall limiter cannot act behind a twin, whose carriage has inertia; \
         let it act on the command (LimiterPlace::Command)"
    )]
    LimiterBehindTwin,
    /// Arrays of the wrong length.
    #[error("{what} has {found} entries, but these games need {expected}")]
    Shape {
        /// Which array.
        what: &'static str,
        /// Entries that were given.
        found: usize,
        /// Entries that are needed.
        expected: usize,
    },
    /// A command that is no number.
    #[error(
        "the command of the {player} player on board {board} is ({x}, {y}) m/s; it must be finite"
    )]
    Command {
        /// Board, counted over all ranges.
        board: usize,
        /// Whose.
        player: Player,
        /// Across, in the player's own frame (m/s).
        x: f32,
        /// Towards the other player (m/s).
        y: f32,
    },
    /// A board on which something is no longer a number.
    #[error("board {board} is no longer finite in step {step} of episode {episode}, seed {seed}")]
    NotFinite {
        /// Board, counted over all ranges.
        board: usize,
        /// Its episode, from 0.
        episode: u64,
        /// Control period within the episode, from 0.
        step: u32,
        /// Seed of the games.
        seed: u64,
    },
}

/// Checks that `value` lies in `[low, high]`.
pub(super) fn within(name: &'static str, value: f64, low: f64, high: f64) -> Result<(), GameError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(GameError::Setting { name, value, low, high })
    }
}
