//! Configuration of the ball and the goal cups.

use super::{
    ConfigError,
    ranged::{ranged, within},
};
use serde::{Deserialize, Serialize};

ranged! {
    /// The ball.
    BallConfig {
        /// Radius (m).
        radius_m: 0.007 in [1e-3, 0.1];
        /// Mass (kg).
        mass_kg: 0.0017 in [1e-5, 1.0];
        /// Coulomb rolling resistance: coefficient `c` in the deceleration `c g`.
        rolling_resistance: 0.008 in [0.0, 1.0];
        /// Viscous rolling resistance: deceleration per speed (1/s).
        viscous_per_s: 0.02 in [0.0, 100.0];
        /// Air drag: deceleration per squared speed (1/m).
        quadratic_per_m: 0.02 in [0.0, 10.0];
        /// Kinetic friction coefficient while sliding after an impact; 0 for rolling at all times.
        sliding_friction: 0.0 in [0.0, 2.0];
        /// Attraction by a striker in contact (m/s^2); negative repels.
        peg_attraction_m_per_s2: 0.0 in [-10.0, 10.0];
        /// Decay length of the attraction (m).
        peg_attraction_range_m: 0.01 in [1e-3, 0.1];
        /// Tilt of the board along x (rad); the ball runs towards positive x for a negative tilt.
        x_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Tilt of the board along y (rad).
        y_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Height of the middle of the board above its edges (m); negative when it sags.
        crown_m: 0.0 in [-0.01, 0.01];
        /// Restitution at walls in the limit of low speed.
        wall_restitution: 0.8 in [0.0, 1.0];
        /// Decrease of that restitution per impact speed (s/m).
        wall_restitution_loss_s_per_m: 0.0 in [0.0, 1.0];
        /// Friction coefficient of walls.
        wall_friction: 0.1 in [0.0, 2.0];
        /// Restitution at strikers in the limit of low speed.
        peg_restitution: 0.75 in [0.0, 1.0];
        /// Decrease of that restitution per impact speed (s/m).
        peg_restitution_loss_s_per_m: 0.0 in [0.0, 1.0];
        /// Friction coefficient of strikers.
        peg_friction: 0.1 in [0.0, 2.0];
        /// Interval at which the ball is rolled from a random position in a random direction (s); 0
        /// for never.
        launch_every_s: 0.0 in [0.0, 3600.0];
        /// Maximum speed of these rolls (m/s); the minimum is a fifth of it.
        launch_speed_m_per_s: 1.5 in [0.01, 10.0];
        /// Delay between a goal and the return of the ball to its start (s); 0 for never.
        put_back_after_s: 2.0 in [0.0, 3600.0];
        /// Rest time on the board after which the ball is returned (s); 0 for never.
        put_back_still_after_s: 0.0 in [0.0, 3600.0];
        /// Maximum random displacement of the returned ball from its start, along each axis (m);
        /// also used for the first ball.
        serve_spread_m: 0.0 in [0.0, 1.0];
        /// Maximum random speed of the returned ball (m/s), in addition to that of its start; the
        /// minimum is half of it.
        serve_speed_m_per_s: 0.0 in [0.0, 10.0];
    }
    other {
        /// Start of the ball; without it there is no ball until one is rolled.
        start: Option<Launch> = Some(Launch::default());
        /// A region with more rolling resistance.
        patch: PatchConfig = PatchConfig::default();
        /// Displacement of the walls.
        wall_shift: WallShift = WallShift::default();
    }
}

ranged! {
    /// A circular region with more rolling resistance.
    PatchConfig {
        /// Centre, across (m).
        x_m: 0.0 in [-1.0, 1.0];
        /// Centre, from goal to goal (m).
        y_m: 0.0 in [-1.0, 1.0];
        /// Radius (m); 0 for no region.
        radius_m: 0.0 in [0.0, 1.0];
        /// Increase of the rolling resistance coefficient.
        extra_resistance: 0.0 in [0.0, 1.0];
    }
}

ranged! {
    /// Outward displacement of each wall from its nominal position, for the ball.
    WallShift {
        /// Wall at the lowest x (m).
        x_low_m: 0.0 in [-0.02, 0.02];
        /// Wall at the highest x (m).
        x_high_m: 0.0 in [-0.02, 0.02];
        /// Wall at the lowest y (m).
        y_low_m: 0.0 in [-0.02, 0.02];
        /// Wall at the highest y (m).
        y_high_m: 0.0 in [-0.02, 0.02];
    }
}

/// Initial position and velocity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Launch {
    /// Position across (m).
    pub x_m: f64,
    /// Position from goal to goal (m).
    pub y_m: f64,
    /// Velocity across (m/s).
    pub vx_m_per_s: f64,
    /// Velocity from goal to goal (m/s).
    pub vy_m_per_s: f64,
}

ranged! {
    /// The two goal cups.
    CupConfig {
        /// Distance of their centres from the middle of the board (m).
        distance_m: 0.17 in [0.0, 10.0];
        /// Radius (m).
        radius_m: 0.01905 in [0.0, 1.0];
        /// Speed above which a ball passes over a cup (m/s).
        capture_speed_m_per_s: 1.5 in [0.0, 100.0];
    }
}

impl BallConfig {
    /// A ball that people keep in play: returned 1 s after a goal and after 3 s at rest, with a
    /// push out of the strip along the middle that no striker reaches. The push ends before either
    /// cup.
    #[must_use]
    pub fn in_a_match() -> Self {
        Self {
            put_back_after_s: 1.0,
            put_back_still_after_s: 3.0,
            serve_spread_m: 0.03,
            serve_speed_m_per_s: 0.12,
            ..Self::default()
        }
    }

    pub(super) fn check(&self, path: &str) -> Result<(), ConfigError> {
        self.check_numbers(path)?;
        self.patch.check_numbers(&format!("{path}patch."))?;
        self.wall_shift.check_numbers(&format!("{path}wall_shift."))?;
        if let Some(start) = &self.start {
            for (name, value, top) in [
                ("x_m", start.x_m, 10.0),
                ("y_m", start.y_m, 10.0),
                ("vx_m_per_s", start.vx_m_per_s, 20.0),
                ("vy_m_per_s", start.vy_m_per_s, 20.0),
            ] {
                within(&format!("{path}start.{name}"), value, -top, top)?;
            }
        }
        Ok(())
    }
}
