//! Errors before a match.

use crate::{
    game::GameError, recording::RecordingError, recording::topic::Player, train::TrainError,
};

/// Error of setting up a match.
#[derive(Debug, thiserror::Error)]
pub enum PlayError {
    /// The file of a policy cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The file holds no policy, or a policy for something else.
    #[error(transparent)]
    Policy(#[from] TrainError),
    /// A simulated match with an empty seat.
    #[error("a simulated match needs two players, but a side is `none`; name a player for it")]
    EmptySeat,
    /// A rig without a ball to serve.
    #[error(
        "the rig file has no ball.start, so there is no serve; add it, such as {{\"y_m\": 0.065}}"
    )]
    NoServe,
    /// A rig that never returns the ball to its start.
    #[error(
        "ball.{name} of the rig file is 0, so the ball is never returned and an episode never begins; set it to \
         seconds, such as 1"
    )]
    BallNotReturned {
        /// Name of the field.
        name: &'static str,
    },
    /// A setting of the simulation, or a state that is not finite.
    #[error(transparent)]
    Game(#[from] GameError),
    /// Both seats are empty.
    #[error("nobody plays; name a player or a policy for at least one side")]
    NobodyPlays,
    /// The robot file has no gantry on this side.
    #[error(
        "the robot file has no drive of the {0} player; leave that side to `none`, or add its drives"
    )]
    NoDrives(Player),
}
