//! Errors before a match.

use crate::{recording::RecordingError, recording::topic::Player, train::TrainError};

/// Error of setting up a match.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The file of a policy cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The file holds no policy, or a policy for something else.
    #[error(transparent)]
    Policy(#[from] TrainError),
    /// Both seats are empty.
    #[error("nobody plays; name a player or a policy for at least one side")]
    NobodyPlays,
    /// The robot file has no gantry on this side.
    #[error(
        "the robot file has no drive of the {0} player; leave that side to `none`, or add its drives"
    )]
    NoDrives(Player),
}
