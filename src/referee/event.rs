//! What the referee says happened.

use crate::recording::topic::Player;

/// Kinds of events; each is defined on the room's front page.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum EventKind {
    /// A touch that turned away a ball on its way to the toucher's goal.
    Block,
    /// A touch that sent the ball towards the other goal, faster than it came.
    Strike,
    /// A touch that is neither.
    Touch,
    /// The ball met a wall.
    WallBounce,
    /// The ball is in a cup and stays.
    Goal,
    /// The ball was over a cup and came out.
    RimOut,
    /// A striker is in its own cup.
    StrikerInGoal,
    /// The ball lay still too long.
    Timeout,
    /// The ball was not seen for too long.
    BallLost,
    /// The ball is back in play.
    Restart,
}

impl EventKind {
    /// All kinds.
    pub const ALL: [Self; 10] = [
        Self::Block,
        Self::Strike,
        Self::Touch,
        Self::WallBounce,
        Self::Goal,
        Self::RimOut,
        Self::StrikerInGoal,
        Self::Timeout,
        Self::BallLost,
        Self::Restart,
    ];

    /// As files spell it.
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
            Self::Timeout => "timeout",
            Self::BallLost => "ball_lost",
            Self::Restart => "restart",
        }
    }

    /// Whether it is a touch of any kind.
    #[must_use]
    pub fn is_touch(self) -> bool {
        matches!(self, Self::Block | Self::Strike | Self::Touch)
    }
}

/// One event.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// Since the recording began (s).
    pub time: f64,
    /// What.
    pub kind: EventKind,
    /// Who touched the ball, whose cup it went into or over, or whose striker went in.
    pub player: Option<Player>,
    /// Index of the episode to which it belongs.
    pub episode: usize,
    /// Where (m).
    pub position: [f64; 2],
    /// Velocity of the ball before and after (m/s).
    pub velocity_in: [f64; 2],
    /// Velocity of the ball after (m/s).
    pub velocity_out: [f64; 2],
    /// Of a strike: whether its straight way on leads over the other player's cup.
    pub goal_directed: bool,
    /// How likely it is that it happened, 0 to 1.
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
