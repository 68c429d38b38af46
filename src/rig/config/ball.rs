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
        /// Friction coefficient while it slides after a hit, until it rolls; 0 is always rolling.
        sliding_friction: 0.0 in [0.0, 2.0];
        /// Attraction by a striker that it touches (m/s^2); negative repels.
        peg_attraction_m_per_s2: 0.0 in [-10.0, 10.0];
        /// Distance over which the attraction fades to 1/e (m).
        peg_attraction_range_m: 0.01 in [1e-3, 0.1];
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
        /// Time for which the ball lies still on the board until it is put back (s); 0 is never.
        put_back_still_after_s: 0.0 in [0.0, 3600.0];
        /// Largest random distance, along each axis, of the ball that is put back from where it started
        /// (m); the first ball is put there alike.
        serve_spread_m: 0.0 in [0.0, 1.0];
        /// Largest speed that the ball is given in a random direction as it is put back (m/s), beside that of
        /// its start; the least is half of it.
        serve_speed_m_per_s: 0.0 in [0.0, 10.0];
    }
    other {
        /// Where it starts; without it there is no ball until somebody rolls one.
        start: Option<Launch> = Some(Launch::default());
        /// A place where it rolls worse.
        patch: PatchConfig = PatchConfig::default();
        /// Where the walls are.
        wall_shift: WallShift = WallShift::default();
    }
}

ranged! {
    /// A round place with more rolling resistance.
    PatchConfig {
        /// Its centre, across (m).
        x_m: 0.0 in [-1.0, 1.0];
        /// Its centre, from goal to goal (m).
        y_m: 0.0 in [-1.0, 1.0];
        /// Its radius (m); 0 is none.
        radius_m: 0.0 in [0.0, 1.0];
        /// Added to the rolling resistance.
        extra_resistance: 0.0 in [0.0, 1.0];
    }
}

ranged! {
    /// How far each wall stands outside its nominal place, for the ball.
    WallShift {
        /// The wall at the least x (m).
        x_low_m: 0.0 in [-0.02, 0.02];
        /// The wall at the largest x (m).
        x_high_m: 0.0 in [-0.02, 0.02];
        /// The wall at the least y (m).
        y_low_m: 0.0 in [-0.02, 0.02];
        /// The wall at the largest y (m).
        y_high_m: 0.0 in [-0.02, 0.02];
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
    /// A ball that people keep in play: put back 1 s after a goal and after 3 s at rest, with a push out of
    /// the strip along the middle that no striker reaches. The push ends before either cup.
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
