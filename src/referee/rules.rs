//! Every threshold of the referee, in one place.

use crate::{
    board::{BALL_RADIUS, BoardSize, CUP_DISTANCE, CUP_RADIUS, STRIKER_RADIUS},
    recording::topic::Player,
};

/// Thresholds of the analysis. The defaults are those of the definitions in [`crate::referee`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rules {
    /// Playing field; from the recording's metadata if present.
    pub board: BoardSize,
    /// Minimum velocity change of a touch or a bounce (m/s). With a lower threshold a resting ball
    /// in contact would cause touches all the time. 0.5 mm of camera noise over ten frames
    /// corresponds to 0.007 m/s.
    pub least_impulse: f64,
    /// Maximum interval between impulses of one striker that belong to one touch (s).
    pub same_touch: f64,
    /// Maximum gap between ball and striker while a touch continues (m).
    pub still_touching: f64,
    /// Minimum speed along the board of an approaching or departing ball (m/s).
    pub least_approach: f64,
    /// Minimum time in the cup for a goal (s). Upstream counts 30 frames, 0.25 s; a ball can circle
    /// on the rim for longer.
    pub goal_stay: f64,
    /// Minimum time of a striker's centre over its own cup for an own goal (s), as upstream.
    pub striker_stay: f64,
    /// Distance of centres within which a biscuit is on a striker (m): that at which the striker's magnet captures
    /// it in the game ([`BiscuitSettings::capture_distance`](crate::game::BiscuitSettings)).
    pub biscuit_within: f64,
    /// Minimum time of two biscuits on a striker (s), as for a goal.
    pub biscuit_stay: f64,
    /// Time without a detection after which the ball is lost (s).
    pub lost_after: f64,
    /// Rest time of the ball after which the episode ends (s).
    pub timeout_after: f64,
    /// Maximum displacement of a resting ball (m).
    pub still_within: f64,
    /// Longest gap of the ball's track across which events are inferred (s).
    pub longest_gap: f64,
    /// Standard deviation of the distances between ball, strikers and walls (m), in addition to
    /// camera noise: calibration and parallax.
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
            biscuit_within: 0.02,
            biscuit_stay: 0.5,
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

/// The opposite player.
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

    /// Distance between the centres of ball and striker at contact (m).
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

    /// Owner of the cup under `position`, if any.
    #[must_use]
    pub fn cup_at(&self, position: [f64; 2]) -> Option<Player> {
        Player::BOTH.into_iter().find(|player| {
            let [x, y] = self.cup(*player);
            (position[0] - x).hypot(position[1] - y) < CUP_RADIUS
        })
    }
}
