//! Every threshold of the referee, in one place.

use crate::{
    board::{BALL_RADIUS, BoardSize, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    recording::topic::Player,
};

/// What counts as what. The defaults are those of the definitions on the room's front page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Playing field; from the recording's metadata where it says so.
    pub board: BoardSize,
    /// Least change of the ball's velocity that is a touch or a bounce (m/s). Below it a ball that
    /// rests against something would touch it all the time, and 0.5 mm of camera noise over ten
    /// frames is 0.007 m/s of velocity.
    pub least_impulse: f64,
    /// Impulses of one striker closer than this belong to one touch (s).
    pub same_touch: f64,
    /// Nearer than this to touching (m), the ball has not left the striker, and the touch goes on.
    pub still_touching: f64,
    /// A ball is coming or leaving when its speed along the board is at least this (m/s).
    pub least_approach: f64,
    /// In the cup at least so long is in (s). Upstream counts 30 frames, 0.25 s; a ball can circle on
    /// the rim longer than that.
    pub goal_stay: f64,
    /// The striker's centre over its own cup so long is in (s), as upstream.
    pub striker_stay: f64,
    /// Unseen for so long is lost (s).
    pub lost_after: f64,
    /// Lying still for so long ends the episode (s).
    pub timeout_after: f64,
    /// A ball that stays within this of one position lies still (m).
    pub still_within: f64,
    /// Longest pause of the ball's track over which events are told (s).
    pub longest_gap: f64,
    /// How exactly the distances between ball, strikers and walls are known (m, one standard
    /// deviation): calibration and parallax, beside the camera's noise.
    pub place_tolerance: f64,
}

impl Default for Rules {
    fn default() -> Self {
        Self {
            board: BoardSize::default(),
            least_impulse: 0.03,
            same_touch: 0.1,
            still_touching: 0.004,
            least_approach: 0.1,
            goal_stay: 0.5,
            striker_stay: 0.25,
            lost_after: 1.0,
            timeout_after: 10.0,
            still_within: 0.004,
            longest_gap: 0.15,
            place_tolerance: 0.001,
        }
    }
}

/// Sign of y on a player's side of the board.
pub(super) fn side(player: Player) -> f64 {
    match player {
        Player::Left => -1.0,
        Player::Right => 1.0,
    }
}

/// The player across the board.
pub(super) fn opponent(player: Player) -> Player {
    match player {
        Player::Left => Player::Right,
        Player::Right => Player::Left,
    }
}

impl Rules {
    /// Largest |x| and |y| of the ball's centre (m).
    #[must_use]
    pub fn reach(&self) -> [f64; 2] {
        [self.board.short_side / 2.0 - BALL_RADIUS, self.board.long_side / 2.0 - BALL_RADIUS]
    }

    /// Distance between the centres of ball and striker when they touch (m).
    #[must_use]
    pub fn touching(&self) -> f64 {
        BALL_RADIUS + STRIKER_RADIUS
    }

    /// Centre of a player's own cup (m).
    #[must_use]
    pub fn cup(&self, player: Player) -> [f64; 2] {
        [0.0, side(player) * CUP_DISTANCE]
    }

    /// Radius of a cup (m).
    #[must_use]
    pub fn cup_radius(&self) -> f64 {
        CUP_RADIUS
    }

    /// Whose cup `position` lies over, if any.
    #[must_use]
    pub fn cup_at(&self, position: [f64; 2]) -> Option<Player> {
        Player::BOTH.into_iter().find(|player| {
            let [x, y] = self.cup(*player);
            (position[0] - x).hypot(position[1] - y) < CUP_RADIUS
        })
    }
}
