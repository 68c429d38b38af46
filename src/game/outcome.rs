//! Results of a step.

use crate::recording::topic::Player;

/// End of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// The ball fell into the other player's cup.
    Goal {
        /// Player who scored.
        scorer: Player,
    },
    /// A striker is over its own cup.
    OwnGoal {
        /// Owner of the striker.
        loser: Player,
    },
    /// Two biscuits are on one striker.
    Biscuits {
        /// Owner of the striker.
        loser: Player,
    },
    /// The ball was at rest for too long.
    BallAtRest {
        /// Player in whose half it lies.
        half: Player,
    },
    /// Time limit without a winner.
    TimeLimit,
}

impl Ending {
    /// The ball at rest at `y` in the board frame (m).
    pub(crate) fn at_rest(y: f64) -> Self {
        Self::BallAtRest { half: if y < 0.0 { Player::Left } else { Player::Right } }
    }

    /// Player who wins the point; `None` at the time limit and for a ball at rest.
    #[must_use]
    pub fn winner(self) -> Option<Player> {
        match self {
            Self::Goal { scorer } => Some(scorer),
            Self::OwnGoal { loser } | Self::Biscuits { loser } => Some(other(loser)),
            Self::BallAtRest { .. } | Self::TimeLimit => None,
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

/// Results of the last step, one entry per environment; players are left, right.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcomes {
    /// End of the episode in this step, if any.
    pub ended: Vec<Option<Ending>>,
    /// Impacts of the ball on each striker.
    pub hits: Vec<[u8; 2]>,
    /// Largest closing speed of an impact on each striker (m/s); 0 without one.
    pub hit_speeds: Vec<[f32; 2]>,
    /// Impacts of the ball on walls.
    pub wall_hits: Vec<u8>,
}

impl Outcomes {
    /// Buffers for `count` environments.
    #[must_use]
    pub fn new(count: usize) -> Self {
        Self {
            ended: vec![None; count],
            hits: vec![[0; 2]; count],
            hit_speeds: vec![[0.0; 2]; count],
            wall_hits: vec![0; count],
        }
    }

    /// Number of environments.
    #[must_use]
    pub fn len(&self) -> usize {
        self.ended.len()
    }

    /// Return whether there are no environments.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.ended.is_empty()
    }
}
