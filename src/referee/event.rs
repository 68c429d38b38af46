//! Events of a match.

use crate::recording::topic::Player;

/// Kinds of events, defined in [`crate::referee`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// A touch that diverts a ball from the player's own goal.
    Block,
    /// A touch that sends the ball towards the other goal, faster than before.
    Strike,
    /// Any other touch.
    Touch,
    /// The ball bounces off a wall.
    WallBounce,
    /// The ball is in a cup and stays.
    Goal,
    /// The ball was over a cup and left it.
    RimOut,
    /// A striker is in its own cup.
    StrikerInGoal,
    /// Two biscuits are on one striker.
    TwoBiscuits,
    /// The ball was at rest for too long.
    Timeout,
    /// The ball was not detected for too long.
    BallLost,
    /// The ball is back in play.
    Restart,
}

impl EventKind {
    /// All kinds.
    pub const ALL: [Self; 11] = [
        Self::Block,
        Self::Strike,
        Self::Touch,
        Self::WallBounce,
        Self::Goal,
        Self::RimOut,
        Self::StrikerInGoal,
        Self::TwoBiscuits,
        Self::Timeout,
        Self::BallLost,
        Self::Restart,
    ];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Block => "block",
            Self::Strike => "strike",
            Self::Touch => "touch",
            Self::WallBounce => "wall_bounce",
            Self::Goal => "goal",
            Self::RimOut => "rim_out",
            Self::StrikerInGoal => "striker_in_goal",
            Self::TwoBiscuits => "two_biscuits",
            Self::Timeout => "timeout",
            Self::BallLost => "ball_lost",
            Self::Restart => "restart",
        }
    }

    /// Return whether it is a touch of any kind.
    #[must_use]
    pub fn is_touch(self) -> bool {
        matches!(self, Self::Block | Self::Strike | Self::Touch)
    }
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// Time since the recording began (s).
    pub time: f64,
    /// Kind of the event.
    pub kind: EventKind,
    /// Player who touched the ball, owner of the cup, or owner of the striker.
    pub player: Option<Player>,
    /// Index of its episode.
    pub episode: usize,
    /// Position (m).
    pub position: [f64; 2],
    /// Velocity of the ball before (m/s).
    pub velocity_in: [f64; 2],
    /// Velocity of the ball after (m/s).
    pub velocity_out: [f64; 2],
    /// True for a strike whose straight continuation passes over the other player's cup.
    pub goal_directed: bool,
    /// Probability of the event, 0 to 1.
    pub confidence: f64,
}

impl Event {
    /// Speed of the ball before (m/s).
    #[must_use]
    pub fn speed_in(&self) -> f64 {
        self.velocity_in[0].hypot(self.velocity_in[1])
    }

    /// Speed of the ball after (m/s).
    #[must_use]
    pub fn speed_out(&self) -> f64 {
        self.velocity_out[0].hypot(self.velocity_out[1])
    }
}
