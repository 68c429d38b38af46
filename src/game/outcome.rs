//! What a step brought about.

use crate::recording::topic::Player;

/// How an episode ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The ball fell into the other player's cup.
    Goal {
        /// Who scored.
        scorer: Player,
    },
    /// A striker stood over its own cup.
    OwnGoal {
        /// Whose it is.
        loser: Player,
    },
    /// Two biscuits stick to one striker.
    Biscuits {
        /// Whose it is.
        loser: Player,
    },
    /// Nobody won in time, or the ball lay still for too long.
    TimeLimit,
}

impl Ending {
    /// Who wins the point; `None` at the time limit.
    #[must_use]
    pub fn winner(self) -> Option<Player> {
        match self {
            Self::Goal { scorer } => Some(scorer),
            Self::OwnGoal { loser } | Self::Biscuits { loser } => Some(other(loser)),
            Self::TimeLimit => None,
        }
    }
}

/// The other player.
fn other(player: Player) -> Player {
    match player {
        Player::Left => Player::Right,
        Player::Right => Player::Left,
    }
}

/// What the last step brought about, one entry per board; players are left, right.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcomes {
    /// How the episode ended in this step, if it did.
    pub ended: Vec<Option<Ending>>,
    /// Impacts of the ball on each striker.
    pub hits: Vec<[u8; 2]>,
    /// Largest closing speed of an impact on each striker (m/s); 0 without one.
    pub hit_speeds: Vec<[f32; 2]>,
    /// Impacts of the ball on walls.
    pub wall_hits: Vec<u8>,
}

impl Outcomes {
    /// Room for `count` boards.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self {
            ended: vec![None; count],
            hits: vec![[0; 2]; count],
            hit_speeds: vec![[0.0; 2]; count],
            wall_hits: vec![0; count],
        }
    }

    /// Number of boards.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ended.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ended.is_empty()
    }
}
