//! Limits of the motors: position, speed, acceleration and temperature.
//!
//! The stopping distance from speed `v` is `v t + v^2 / (2 a)`: the carriage moves on for the
//! reaction time `t` and then brakes with `a`. A point may be passed only if the carriage can still
//! stop inside the workspace from there.

use super::robot::{RobotError, check_range};
use crate::recording::topic::Player;
use serde::{Deserialize, Serialize};

/// Limits of one robot, equal for both players.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Limits {
    /// Largest commanded speed along each axis (m/s); 0.7 as in the paper's data set. The game
    /// stays within 0.4.
    pub speed_m_per_s: f64,
    /// Largest commanded speed along any direction (m/s); 1.0, both axes at 0.7.
    pub total_speed_m_per_s: f64,
    /// Largest change of a commanded velocity along each axis (m/s^2); 10, as upstream's simulation.
    pub slew_m_per_s2: f64,
    /// Guaranteed braking deceleration (m/s^2); 5, below the mean of 6.25 that the paper measured.
    pub braking_m_per_s2: f64,
    /// Reaction time from a detection to the braking of the motors (s): one control period, the bus
    /// and the delay of the drive.
    pub reaction_s: f64,
    /// Current limit of each drive, set before arming (A).
    pub current_a: f64,
    /// Largest temperature of a power stage (C).
    pub fet_temperature_c: f64,
    /// Largest temperature of a motor (C), where a thermistor reports it.
    pub motor_temperature_c: f64,
    /// Margin between every planned path, its stopping distance included, and the soft limits (m);
    /// 0.01. It covers lag and overshoot of the carriage.
    pub tracking_margin_m: f64,
    /// Largest distance of a carriage from its reference (m); 0.06. A drive that brakes with
    /// 6 m/s^2 falls behind commands of 10 m/s^2 by 40 mm at full speed.
    pub following_error_m: f64,
    /// Largest distance between a striker and its magnet in the camera frames (m), over a tenth of
    /// a second.
    pub striker_error_m: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            speed_m_per_s: 0.7,
            total_speed_m_per_s: 1.0,
            slew_m_per_s2: 10.0,
            braking_m_per_s2: 5.0,
            reaction_s: 0.04,
            current_a: 15.0,
            fet_temperature_c: 80.0,
            motor_temperature_c: 90.0,
            tracking_margin_m: 0.01,
            following_error_m: 0.06,
            striker_error_m: 0.03,
        }
    }
}

impl Limits {
    pub(super) fn check(&self) -> Result<(), RobotError> {
        for (name, value, range, top) in [
            ("limits.speed_m_per_s", self.speed_m_per_s, "(0, 2] m/s", 2.0),
            ("limits.total_speed_m_per_s", self.total_speed_m_per_s, "(0, 3] m/s", 3.0),
            ("limits.slew_m_per_s2", self.slew_m_per_s2, "(0, 100] m/s^2", 100.0),
            ("limits.braking_m_per_s2", self.braking_m_per_s2, "(0, 100] m/s^2", 100.0),
            ("limits.reaction_s", self.reaction_s, "(0, 0.5] s", 0.5),
            ("limits.current_a", self.current_a, "(0, 60] A", 60.0),
            ("limits.fet_temperature_c", self.fet_temperature_c, "(0, 120] C", 120.0),
            ("limits.motor_temperature_c", self.motor_temperature_c, "(0, 150] C", 150.0),
            ("limits.tracking_margin_m", self.tracking_margin_m, "(0, 0.1] m", 0.1),
            ("limits.following_error_m", self.following_error_m, "(0, 0.2] m", 0.2),
            ("limits.striker_error_m", self.striker_error_m, "(0, 0.2] m", 0.2),
        ] {
            check_range(name, value, range, |v| 0.0 < v && v <= top)?;
        }
        Ok(())
    }

    /// Return the stopping distance from `speed` (m/s) to standstill (m).
    #[must_use]
    pub fn stopping_distance(&self, speed: f64) -> f64 {
        let speed = speed.abs();
        speed * self.reaction_s + speed * speed / (2.0 * self.braking_m_per_s2)
    }

    /// Return the largest speed (m/s) from which a carriage stops within `room` (m): the inverse of
    /// [`stopping_distance`](Self::stopping_distance); 0 without room.
    #[must_use]
    pub fn speed_within(&self, room: f64) -> f64 {
        let (brake, wait) = (self.braking_m_per_s2, self.reaction_s);
        brake * ((wait * wait + 2.0 * room.max(0.0) / brake).sqrt() - wait)
    }

    /// Return the standstill point of a carriage at `position` (m) with `velocity` (m/s); each axis
    /// brakes on its own.
    #[must_use]
    pub fn standstill(&self, position: [f64; 2], velocity: [f64; 2]) -> [f64; 2] {
        [0, 1].map(|axis| {
            position[axis] + self.stopping_distance(velocity[axis]).copysign(velocity[axis])
        })
    }

    /// Limit `wanted` (m/s) for a carriage at `position` (m) in `workspace`. Along each axis the
    /// speed towards an edge allows a stop before it; outside, only inward motion is allowed.
    #[must_use]
    pub fn before_edges(
        &self,
        workspace: &Rectangle,
        position: [f64; 2],
        wanted: [f64; 2],
    ) -> [f64; 2] {
        let edges =
            [[workspace.x_min_m, workspace.x_max_m], [workspace.y_min_m, workspace.y_max_m]];
        [0, 1].map(|axis| {
            let [low, high] = edges[axis];
            let down = self.speed_within(position[axis] - low);
            let up = self.speed_within(high - position[axis]);
            wanted[axis].clamp(-down, up)
        })
    }

    /// Return the velocity (m/s) that follows `previous` after `dt` seconds on the way to `wanted`.
    /// Each axis changes as far as the slew limit allows. If the total speed would be too large,
    /// both axes follow the straight line, which violates no limit that `previous` keeps.
    #[must_use]
    pub fn next_velocity(&self, previous: [f64; 2], wanted: [f64; 2], dt: f64) -> [f64; 2] {
        let step = self.slew_m_per_s2 * dt;
        let within = self.within_speed(wanted);
        let change = [0, 1].map(|axis| within[axis] - previous[axis]);
        let by_axis = [0, 1].map(|axis| previous[axis] + change[axis].clamp(-step, step));
        if by_axis[0].hypot(by_axis[1]) <= self.total_speed_m_per_s {
            return by_axis;
        }
        let share = (step / change[0].abs().max(change[1].abs())).min(1.0);
        [0, 1].map(|axis| previous[axis] + share * change[axis])
    }

    /// Limit `velocity` (m/s) to the speed limits: each axis is clamped, then the vector is
    /// shortened.
    #[must_use]
    pub fn within_speed(&self, velocity: [f64; 2]) -> [f64; 2] {
        let top = self.speed_m_per_s;
        let [x, y] = velocity.map(|v| v.clamp(-top, top));
        let shorten = (self.total_speed_m_per_s / x.hypot(y)).min(1.0);
        if shorten.is_finite() { [x * shorten, y * shorten] } else { [x, y] }
    }
}

/// An axis-parallel rectangle on the board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[expect(missing_docs, reason = "edges in the board frame (m)")]
pub struct Rectangle {
    pub x_min_m: f64,
    pub x_max_m: f64,
    pub y_min_m: f64,
    pub y_max_m: f64,
}

impl Rectangle {
    pub(super) fn check(&self, player: Player) -> Result<(), RobotError> {
        for (axis, low, high) in
            [("x", self.x_min_m, self.x_max_m), ("y", self.y_min_m, self.y_max_m)]
        {
            let name = format!("workspace.{player}: {axis}_max_m - {axis}_min_m");
            check_range(&name, high - low, "[0.02, 10] m", |v| (0.02..=10.0).contains(&v))?;
        }
        Ok(())
    }

    /// Return the rectangle with every edge moved inwards by `margin` (m).
    #[must_use]
    pub fn shrunk(&self, margin: f64) -> Self {
        Self {
            x_min_m: self.x_min_m + margin,
            x_max_m: self.x_max_m - margin,
            y_min_m: self.y_min_m + margin,
            y_max_m: self.y_max_m - margin,
        }
    }

    /// Return the distance of `point` (m) from the nearest edge (m), positive inside.
    #[must_use]
    pub fn depth(&self, [x, y]: [f64; 2]) -> f64 {
        let across = (x - self.x_min_m).min(self.x_max_m - x);
        let along = (y - self.y_min_m).min(self.y_max_m - y);
        across.min(along)
    }

    /// Return whether `point` (m) lies inside or on an edge; never for a non-finite point.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        0.0 <= self.depth(point) && point.iter().all(|value| value.is_finite())
    }

    /// Return the centre (m).
    #[must_use]
    pub fn centre(&self) -> [f64; 2] {
        [f64::midpoint(self.x_min_m, self.x_max_m), f64::midpoint(self.y_min_m, self.y_max_m)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn stopping_distance_is_reaction_plus_braking() {
        let limits = Limits { braking_m_per_s2: 5.0, reaction_s: 0.04, ..Limits::default() };
        // 0.5 * 0.04 + 0.25 / 10
        assert!((limits.stopping_distance(-0.5) - 0.045).abs() < 1e-12);
        assert!((limits.speed_within(0.045) - 0.5).abs() < 1e-12);
        assert_eq!(limits.speed_within(-1.0), 0.0);
        let [x, y] = limits.standstill([0.1, 0.1], [-0.5, 0.0]);
        assert!((x - 0.055).abs() < 1e-12 && (y - 0.1).abs() < 1e-12);
    }

    #[test]
    fn a_point_that_is_no_number_is_nowhere() {
        let area = Rectangle { x_min_m: -1.0, x_max_m: 1.0, y_min_m: -1.0, y_max_m: 1.0 };
        assert!(area.contains([1.0, -1.0]));
        assert!(!area.contains([f64::NAN, 0.0]) && !area.contains([0.0, f64::NAN]));
        assert!(!area.shrunk(0.1).contains([0.95, 0.0]));
    }

    #[test]
    fn speed_towards_an_edge_is_what_can_be_stopped() {
        let workspace = Rectangle { x_min_m: -0.1, x_max_m: 0.1, y_min_m: -0.1, y_max_m: 0.1 };
        let limits = Limits { braking_m_per_s2: 5.0, reaction_s: 0.04, ..Limits::default() };
        // 45 mm are enough for 0.5 m/s; away from the edge, and across, nothing is limited.
        let [x, y] = limits.before_edges(&workspace, [0.055, 0.0], [0.7, -0.6]);
        assert!((x - 0.5).abs() < 1e-12 && (y + 0.6).abs() < 1e-12);
        assert_eq!(limits.before_edges(&workspace, [0.055, 0.0], [-0.7, 0.0]), [-0.7, 0.0]);
        assert_eq!(limits.before_edges(&workspace, [0.12, 0.0], [0.3, 0.0]), [0.0, 0.0]);
        assert_eq!(limits.before_edges(&workspace, [0.12, 0.0], [-0.3, 0.0]), [-0.3, 0.0]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        #[test]
        fn commands_never_pass_a_limit(previous in [-0.7..0.7_f64, -0.7..0.7], wanted in [-9.0..9.0_f64, -9.0..9.0], dt in 0.001..0.05_f64) {
            let limits = Limits::default();
            let next = limits.next_velocity(previous, wanted, dt);
            let total = |[x, y]: [f64; 2]| x.hypot(y);
            prop_assert!(total(next) <= total(limits.within_speed(previous)).max(limits.total_speed_m_per_s) + 1e-12);
            for axis in 0..2 {
                prop_assert!((next[axis] - previous[axis]).abs() <= limits.slew_m_per_s2 * dt + 1e-12);
                prop_assert!(next[axis].abs() <= limits.speed_m_per_s + 1e-12);
            }
            let [x, y] = limits.within_speed(wanted);
            prop_assert!(x.hypot(y) <= limits.total_speed_m_per_s + 1e-12);
        }
    }
}
