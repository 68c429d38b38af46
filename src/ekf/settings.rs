//! Parameters of the filter, with units in their names: the object `filter` in `ekf.json`.

use super::error::EkfError;
use crate::board::{BALL_RADIUS, BoardSize};
use serde::{Deserialize, Serialize};

/// An object that the camera detects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Object {
    /// The ball.
    Ball,
    /// The striker of the player who owns y < 0.
    Left,
    /// The striker of the player who owns y > 0.
    Right,
}

impl Object {
    /// All objects; the position in this list is the index in every array of three.
    pub const ALL: [Self; 3] = [Self::Ball, Self::Left, Self::Right];

    /// Name in documents and on pages.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Ball => "ball",
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// Index in every array of three.
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

/// Settings of the filters of one board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterSettings {
    /// Geometry of walls and goals.
    pub board: BoardSettings,
    /// Latency from capture of a frame to its arrival (s); 0 if it was not measured.
    pub latency_s: f64,
    /// False-rejection probability of the gate for a correct detection.
    pub gate_probability: f64,
    /// The ball.
    pub ball: ObjectSettings,
    /// The striker of y < 0.
    pub left: ObjectSettings,
    /// The striker of y > 0.
    pub right: ObjectSettings,
}

/// The playing field.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardSettings {
    /// Length across (m).
    pub short_side_m: f64,
    /// Length from goal to goal (m).
    pub long_side_m: f64,
    /// Distance from the middle of the board to the centre of each goal (m).
    pub goal_distance_m: f64,
    /// Radius of a goal (m).
    pub goal_radius_m: f64,
}

/// Motion and measurement model of one object.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectSettings {
    /// Standard deviation in each axis (m) of a detection without a covariance; R is its square.
    pub measurement_sigma_m: f64,
    /// Factor of the covariance of a detection that carries one; R is the product. Absent: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance_scale: Option<f64>,
    /// Standard deviation of the unknown initial velocity in each axis (m/s).
    pub start_speed_sigma_m_per_s: f64,
    /// Power spectral density of the acceleration on the open board, in each axis (m2/s3).
    pub open_psd_m2_per_s3: f64,
    /// Ball model; a striker moves at constant velocity in one region and has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ball: Option<BallSettings>,
}

/// Rolling, walls and regions of the ball.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BallSettings {
    /// Radius of the ball (m).
    pub radius_m: f64,
    /// Coulomb rolling resistance: deceleration that does not depend on speed (m/s2).
    pub rolling_deceleration_m_per_s2: f64,
    /// Viscous rolling resistance: deceleration per speed (1/s).
    pub rolling_drag_per_s: f64,
    /// Restitution at walls: normal speed after over before the impact.
    pub wall_restitution: f64,
    /// Standard deviation of the restitution between impacts.
    pub wall_restitution_sigma: f64,
    /// Standard deviation of the tangential velocity change, per normal speed before the impact.
    pub wall_tangential_sigma: f64,
    /// Added spectral density of the acceleration near a wall x = const, across it (m2/s3).
    pub near_wall_x_psd_m2_per_s3: f64,
    /// Added spectral density of the acceleration near a wall y = const, across it (m2/s3).
    pub near_wall_y_psd_m2_per_s3: f64,
    /// Added spectral density of the acceleration near a striker, in each axis (m2/s3).
    pub near_striker_psd_m2_per_s3: f64,
    /// Added spectral density of the acceleration over a goal and its rim, in each axis (m2/s3).
    pub goal_rim_psd_m2_per_s3: f64,
    /// Width of the region near a wall, from the surface of the ball (m).
    pub near_wall_distance_m: f64,
    /// Radius of the region near a striker, between centres of ball and striker (m).
    pub near_striker_distance_m: f64,
    /// Width of the goal's region beyond its radius (m).
    pub goal_rim_width_m: f64,
}

impl Default for FilterSettings {
    /// Start values of the tuning, kept where the data do not determine a parameter.
    ///
    /// A detection error of half a millimetre; strikers that accelerate at 6 m/s2 for 50 ms (density
    /// about a^2 t). The ball rolls nearly straight and changes by metres per second within 50 ms near
    /// a striker. Geometry as in the platform's simulator (klask_rl, `klask_params.py`).
    fn default() -> Self {
        let size = BoardSize::default();
        let striker = ObjectSettings {
            measurement_sigma_m: 5e-4,
            covariance_scale: None,
            start_speed_sigma_m_per_s: 0.4,
            open_psd_m2_per_s3: 2.0,
            ball: None,
        };
        Self {
            board: BoardSettings {
                short_side_m: size.short_side,
                long_side_m: size.long_side,
                goal_distance_m: 0.17,
                goal_radius_m: 0.01905,
            },
            latency_s: 0.0,
            gate_probability: 1e-4,
            ball: ObjectSettings {
                start_speed_sigma_m_per_s: 1.0,
                open_psd_m2_per_s3: 0.02,
                ball: Some(BallSettings::default()),
                ..striker
            },
            left: striker,
            right: striker,
        }
    }
}

impl Default for BallSettings {
    fn default() -> Self {
        Self {
            radius_m: BALL_RADIUS,
            rolling_deceleration_m_per_s2: 0.1,
            rolling_drag_per_s: 0.1,
            wall_restitution: 0.8,
            wall_restitution_sigma: 0.05,
            wall_tangential_sigma: 0.05,
            near_wall_x_psd_m2_per_s3: 0.1,
            near_wall_y_psd_m2_per_s3: 0.1,
            near_striker_psd_m2_per_s3: 20.0,
            goal_rim_psd_m2_per_s3: 2.0,
            near_wall_distance_m: 0.02,
            near_striker_distance_m: 0.025,
            goal_rim_width_m: 0.007,
        }
    }
}

impl FilterSettings {
    /// Settings of `object`.
    #[must_use]
    pub fn object(&self, object: Object) -> &ObjectSettings {
        match object {
            Object::Ball => &self.ball,
            Object::Left => &self.left,
            Object::Right => &self.right,
        }
    }

    /// Mutable settings of `object`.
    pub fn object_mut(&mut self, object: Object) -> &mut ObjectSettings {
        match object {
            Object::Ball => &mut self.ball,
            Object::Left => &mut self.left,
            Object::Right => &mut self.right,
        }
    }

    /// Check that every value is in its range.
    ///
    /// # Errors
    /// The first field outside its range.
    pub fn check(&self) -> Result<(), EkfError> {
        let board = &self.board;
        within("board.short_side_m", board.short_side_m, 0.01, 10.0)?;
        within("board.long_side_m", board.long_side_m, 0.01, 10.0)?;
        within("board.goal_distance_m", board.goal_distance_m, 0.0, 10.0)?;
        within("board.goal_radius_m", board.goal_radius_m, 0.0, 1.0)?;
        within("latency_s", self.latency_s, 0.0, 1.0)?;
        within("gate_probability", self.gate_probability, 1e-12, 0.5)?;
        for object in Object::ALL {
            self.object(object).check(object.name())?;
        }
        Ok(())
    }
}

impl ObjectSettings {
    fn check(&self, name: &str) -> Result<(), EkfError> {
        let is = |field: &str, value: f64, low: f64, high: f64| {
            within(&format!("{name}.{field}"), value, low, high)
        };
        is("measurement_sigma_m", self.measurement_sigma_m, 1e-7, 0.1)?;
        is("covariance_scale", self.covariance_scale.unwrap_or(1.0), 1e-3, 1e3)?;
        is("start_speed_sigma_m_per_s", self.start_speed_sigma_m_per_s, 1e-3, 100.0)?;
        is("open_psd_m2_per_s3", self.open_psd_m2_per_s3, 1e-12, 1e6)?;
        let Some(ball) = &self.ball else { return Ok(()) };
        is("ball.radius_m", ball.radius_m, 0.0, 0.1)?;
        is("ball.rolling_deceleration_m_per_s2", ball.rolling_deceleration_m_per_s2, 0.0, 1.0)?;
        is("ball.rolling_drag_per_s", ball.rolling_drag_per_s, 0.0, 10.0)?;
        is("ball.wall_restitution", ball.wall_restitution, 0.0, 1.0)?;
        is("ball.wall_restitution_sigma", ball.wall_restitution_sigma, 0.0, 1.0)?;
        is("ball.wall_tangential_sigma", ball.wall_tangential_sigma, 0.0, 1.0)?;
        is("ball.near_wall_x_psd_m2_per_s3", ball.near_wall_x_psd_m2_per_s3, 0.0, 1e6)?;
        is("ball.near_wall_y_psd_m2_per_s3", ball.near_wall_y_psd_m2_per_s3, 0.0, 1e6)?;
        is("ball.near_striker_psd_m2_per_s3", ball.near_striker_psd_m2_per_s3, 0.0, 1e6)?;
        is("ball.goal_rim_psd_m2_per_s3", ball.goal_rim_psd_m2_per_s3, 0.0, 1e6)?;
        is("ball.near_wall_distance_m", ball.near_wall_distance_m, 0.0, 1.0)?;
        is("ball.near_striker_distance_m", ball.near_striker_distance_m, 0.0, 1.0)?;
        is("ball.goal_rim_width_m", ball.goal_rim_width_m, 0.0, 1.0)
    }
}

fn within(field: &str, value: f64, low: f64, high: f64) -> Result<(), EkfError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(EkfError::Setting { field: field.to_owned(), value, low, high })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_survive_json_and_refuse_what_they_do_not_know() {
        let settings = FilterSettings::default();
        settings.check().unwrap();
        let text = serde_json::to_string(&settings).unwrap();
        assert_eq!(serde_json::from_str::<FilterSettings>(&text).unwrap(), settings);
        let foreign = text.replace("latency_s", "latency_ms");
        assert!(serde_json::from_str::<FilterSettings>(&foreign).is_err());
    }

    #[test]
    fn a_number_outside_its_range_is_named() {
        let mut settings = FilterSettings::default();
        settings.left.open_psd_m2_per_s3 = f64::NAN;
        let error = settings.check().unwrap_err().to_string();
        assert!(error.contains("left.open_psd_m2_per_s3 is NaN"), "{error}");
    }
}
