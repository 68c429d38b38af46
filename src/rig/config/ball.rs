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
        /// Rolling resistance `c` in the deceleration `c g`.
        rolling_resistance: 0.008 in [0.0, 1.0];
        /// Deceleration per speed (1/s).
        viscous_per_s: 0.02 in [0.0, 100.0];
        /// Deceleration per speed squared: air (1/m).
        quadratic_per_m: 0.02 in [0.0, 10.0];
        /// Slope of the board along x (rad); the ball runs towards positive x when it is negative.
        x_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Slope of the board along y (rad).
        y_tilt_rad: 0.0 in [-0.2, 0.2];
        /// Height of the middle of the board above its edges (m); negative when it sags.
        crown_m: 0.0 in [-0.01, 0.01];
        /// Restitution at walls, at small speed.
        wall_restitution: 0.8 in [0.0, 1.0];
        /// Its loss per speed of impact (s/m).
        wall_restitution_loss_s_per_m: 0.0 in [0.0, 1.0];
        /// Friction coefficient of walls.
        wall_friction: 0.1 in [0.0, 2.0];
        /// Restitution at strikers, at small speed.
        peg_restitution: 0.75 in [0.0, 1.0];
        /// Its loss per speed of impact (s/m).
        peg_restitution_loss_s_per_m: 0.0 in [0.0, 1.0];
        /// Friction coefficient of strikers.
        peg_friction: 0.1 in [0.0, 2.0];
        /// Every so often somebody rolls the ball from a random place in a random direction (s); 0 is
        /// never.
        launch_every_s: 0.0 in [0.0, 3600.0];
        /// Largest speed of these rolls (m/s); the least is a fifth of it.
        launch_speed_m_per_s: 1.5 in [0.01, 10.0];
        /// Time after a goal until the ball is put back where it started (s); 0 is never.
        put_back_after_s: 2.0 in [0.0, 3600.0];
    }
    other {
        /// Where it starts; without it there is no ball until somebody rolls one.
        start: Option<Launch> = Some(Launch::default());
    }
}

/// A place and a velocity.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Launch {
    /// Across (m).
    pub x_m: f64,
    /// From goal to goal (m).
    pub y_m: f64,
    /// Across (m/s).
    pub vx_m_per_s: f64,
    /// From goal to goal (m/s).
    pub vy_m_per_s: f64,
}

ranged! {
    /// The two goal cups.
    CupConfig {
        /// Distance of their centres from the middle of the board (m).
        distance_m: 0.17 in [0.0, 10.0];
        /// Radius (m).
        radius_m: 0.01905 in [0.0, 1.0];
        /// A faster ball rolls over them (m/s).
        capture_speed_m_per_s: 1.5 in [0.0, 100.0];
    }
}

impl BallConfig {
    pub(super) fn check(&self, path: &str) -> Result<(), ConfigError> {
        self.check_numbers(path)?;
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
