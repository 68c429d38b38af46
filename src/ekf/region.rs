//! Regions of process noise along the predicted path (figure 4 of the KlaskTron paper).

use super::settings::{BallSettings, BoardSettings, FilterSettings};
use serde::{Deserialize, Serialize};

/// Region of the predicted path of the ball. Noise of overlapping regions is added, and the
/// name is the first that applies of: goal rim, striker, nearer wall.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Region {
    /// Away from walls, strikers and goals.
    Open,
    /// Near a wall x = const: noise across it.
    NearWallX,
    /// Near a wall y = const: noise across it.
    NearWallY,
    /// Near a striker: noise in both axes.
    NearStriker,
    /// Over a goal or its rim: noise in both axes.
    GoalRim,
}

impl Region {
    /// All regions; the position in this list is the index in tables.
    pub const ALL: [Self; 5] =
        [Self::Open, Self::NearWallX, Self::NearWallY, Self::NearStriker, Self::GoalRim];

    /// Name in documents.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::NearWallX => "near_wall_x",
            Self::NearWallY => "near_wall_y",
            Self::NearStriker => "near_striker",
            Self::GoalRim => "goal_rim",
        }
    }

    /// Name for people.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Open => "open board",
            Self::NearWallX => "near a wall x = const",
            Self::NearWallY => "near a wall y = const",
            Self::NearStriker => "near a striker",
            Self::GoalRim => "goal and rim",
        }
    }
}

/// Positions of the left and the right striker (m).
pub type Strikers = [Option<[f64; 2]>; 2];

/// Precomputed regions of one ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Regions {
    /// Largest coordinates of the ball's centre (m).
    pub(super) reach: [f64; 2],
    open: f64,
    near_wall: [f64; 2],
    near_striker: f64,
    goal_rim: f64,
    wall_distance: f64,
    striker_distance_squared: f64,
    goal_distance: f64,
    goal_reach_squared: f64,
}

impl Regions {
    pub(super) fn new(board: &BoardSettings, open: f64, ball: &BallSettings) -> Self {
        Self {
            reach: [board.short_side_m, board.long_side_m].map(|side| side / 2.0 - ball.radius_m),
            open,
            near_wall: [ball.near_wall_x_psd_m2_per_s3, ball.near_wall_y_psd_m2_per_s3],
            near_striker: ball.near_striker_psd_m2_per_s3,
            goal_rim: ball.goal_rim_psd_m2_per_s3,
            wall_distance: ball.near_wall_distance_m,
            striker_distance_squared: ball.near_striker_distance_m.powi(2),
            goal_distance: board.goal_distance_m,
            goal_reach_squared: (board.goal_radius_m + ball.goal_rim_width_m).powi(2),
        }
    }

    /// Region of a straight path and spectral density of the acceleration in each axis (m2/s3).
    #[inline]
    pub(super) fn along(
        &self,
        from: [f64; 2],
        to: [f64; 2],
        strikers: &Strikers,
    ) -> (Region, [f64; 2]) {
        let mut psd = [self.open; 2];
        let mut region = Region::Open;
        let mut nearest = self.wall_distance;
        for axis in 0..2 {
            let gap = self.reach[axis] - from[axis].abs().max(to[axis].abs());
            if gap < self.wall_distance {
                psd[axis] += self.near_wall[axis];
                if gap < nearest {
                    nearest = gap;
                    region = if axis == 0 { Region::NearWallX } else { Region::NearWallY };
                }
            }
        }
        for striker in strikers.iter().flatten() {
            if distance_squared(from, to, *striker) < self.striker_distance_squared {
                psd = psd.map(|q| q + self.near_striker);
                region = Region::NearStriker;
            }
        }
        let goal = [0.0, self.goal_distance.copysign(to[1])];
        if distance_squared(from, to, goal) < self.goal_reach_squared {
            psd = psd.map(|q| q + self.goal_rim);
            region = Region::GoalRim;
        }
        (region, psd)
    }
}

/// Region of a ball at rest at `position` (m); the open board for settings without a ball.
#[must_use]
pub fn region_at(settings: &FilterSettings, position: [f64; 2], strikers: &Strikers) -> Region {
    settings.ball.ball.map_or(Region::Open, |ball| {
        Regions::new(&settings.board, 0.0, &ball).along(position, position, strikers).0
    })
}

/// Square of the distance of `point` from a segment.
#[inline]
fn distance_squared(from: [f64; 2], to: [f64; 2], point: [f64; 2]) -> f64 {
    let way = [to[0] - from[0], to[1] - from[1]];
    let off = [point[0] - from[0], point[1] - from[1]];
    let length = way[0] * way[0] + way[1] * way[1];
    let along = off[0] * way[0] + off[1] * way[1];
    if along <= 0.0 {
        off[0] * off[0] + off[1] * off[1]
    } else if length <= along {
        (off[0] - way[0]).powi(2) + (off[1] - way[1]).powi(2)
    } else {
        (off[0] * way[1] - off[1] * way[0]).powi(2) / length
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(position: [f64; 2], strikers: &Strikers) -> Region {
        region_at(&FilterSettings::default(), position, strikers)
    }

    #[test]
    fn places_have_their_names() {
        let away: Strikers = [Some([0.0, -0.12]), Some([0.0, 0.12])];
        // Reach 0.153 m and 0.203 m; near is 0.02 m.
        assert_eq!(region([0.0, 0.0], &away), Region::Open);
        assert_eq!(region([0.132, 0.0], &away), Region::Open);
        assert_eq!(region([-0.134, 0.0], &away), Region::NearWallX);
        assert_eq!(region([0.1, 0.184], &away), Region::NearWallY);
        assert_eq!(region([0.15, 0.19], &away), Region::NearWallX);
        assert_eq!(region([0.01, -0.10], &away), Region::NearStriker);
        assert_eq!(region([0.0, 0.19], &away), Region::GoalRim);
        assert_eq!(region([0.01, -0.10], &[None, away[1]]), Region::Open);
    }

    #[test]
    fn a_path_past_a_striker_is_near_it_and_noises_add() {
        let settings = FilterSettings::default();
        let ball = settings.ball.ball.unwrap();
        let regions = Regions::new(&settings.board, 1.0, &ball);
        let strikers = [Some([0.0, 0.05]), None];
        let (name, psd) = regions.along([-0.05, 0.06], [0.05, 0.06], &strikers);
        assert_eq!((name, psd), (Region::NearStriker, [1.0 + ball.near_striker_psd_m2_per_s3; 2]));
        let (name, psd) = regions.along([0.14, 0.0], [0.14, 0.0], &strikers);
        assert_eq!(name, Region::NearWallX);
        assert_eq!(psd, [1.0 + ball.near_wall_x_psd_m2_per_s3, 1.0]);
    }
}
