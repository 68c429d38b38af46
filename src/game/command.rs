//! Command limits: clamp, slew limit, wall limiter.
//!
//! Sources: the upstream commander and simulator. For each axis, `D` is the distance from the
//! carriage to the edge in the direction of motion, `r` the radius of the striker, `c` the
//! clearance and `b` the deceleration distance:
//!
//! ```text
//! r + b < D           free
//! c < D <= r + b      |v| <= v_max (D - c) / b
//! D <= c              blocked
//! ```
//!
//! At the entry of the zone the limit is below `v_max` (0.93 of it with upstream's parameters), as
//! in upstream. The slew limit compares consecutive commands before the wall limiter.

use super::settings::{CONTROL_PERIOD, CommandLimits};
use crate::{board::STRIKER_RADIUS, gantry::Rectangle};

impl CommandLimits {
    /// Slew-limited command (m/s) from `previous` towards `wanted`, each axis separately.
    pub(super) fn slewed(&self, previous: [f64; 2], wanted: [f64; 2]) -> [f64; 2] {
        let step = self.slew * CONTROL_PERIOD;
        let axis = |k: usize| {
            let clamped: f64 = wanted[k].clamp(-self.speed, self.speed);
            previous[k] + (clamped - previous[k]).clamp(-step, step)
        };
        [axis(0), axis(1)]
    }

    /// Limit `velocity` (m/s) of a carriage at `position` (m) near the edges of `field`.
    ///
    /// ```
    /// use klasktron::game::CommandLimits;
    /// let limits = CommandLimits::default();
    /// // 58.5 mm from the far edge of x: half of the top speed, and none of the way back is held.
    /// let field = limits.field.left;
    /// let [out, _] = limits.before_walls(&field, [0.16 - 0.0585, -0.115], [0.4, 0.0]);
    /// assert!((out - 0.2).abs() < 1e-12);
    /// assert_eq!(limits.before_walls(&field, [0.1015, -0.115], [-0.4, 0.0]), [-0.4, 0.0]);
    /// ```
    #[must_use]
    pub fn before_walls(
        &self,
        field: &Rectangle,
        position: [f64; 2],
        velocity: [f64; 2],
    ) -> [f64; 2] {
        let edges = [[field.x_min_m, field.x_max_m], [field.y_min_m, field.y_max_m]];
        let axis = |k: usize| {
            let [low, high] = edges[k];
            velocity[k].clamp(-self.cap(position[k] - low), self.cap(high - position[k]))
        };
        [axis(0), axis(1)]
    }

    /// Maximum speed (m/s) towards an edge that is `distance` (m) away.
    fn cap(&self, distance: f64) -> f64 {
        if STRIKER_RADIUS + self.deceleration_distance < distance {
            f64::INFINITY
        } else {
            let room = (distance - self.clearance).max(0.0);
            self.speed * room / self.deceleration_distance
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_wall_limiter_follows_the_formula_of_the_commander() {
        let limits = CommandLimits::default();
        let field = limits.field.right;
        // y from 0.02 to 0.21: at 0.115 both edges are 0.095 m away, within the zone.
        let [_, y] = limits.before_walls(&field, [0.0, 0.115], [0.0, 0.4]);
        assert!((y - 0.4 * (0.095 - 0.0135) / 0.09).abs() < 1e-12);
        // 0.906 of the top speed, as computed in the facts about the platform.
        assert!((y / 0.4 - 0.906).abs() < 1e-3);
        // Free beyond 0.0975 m; at the entry 0.93 of the top speed.
        assert_eq!(limits.before_walls(&field, [0.0624, 0.1], [0.4, 0.0])[0], 0.4);
        let [x, _] = limits.before_walls(&field, [0.0626, 0.1], [0.4, 0.0]);
        assert!((x / 0.4 - 0.933).abs() < 2e-3, "{x}");
        // Blocked from 0.0135 m on, also outside, and never limited on the way back.
        for x in [0.1465, 0.15, 0.17] {
            let [towards, _] = limits.before_walls(&field, [x, 0.1], [0.3, 0.0]);
            assert!(towards.abs() < 1e-12, "{x}: {towards}");
            assert_eq!(limits.before_walls(&field, [x, 0.1], [-0.3, 0.0])[0], -0.3);
        }
    }

    #[test]
    fn commands_are_clamped_and_change_by_the_slew_limit() {
        let limits = CommandLimits::default();
        let near = |found: [f64; 2], want: [f64; 2]| {
            assert!((found[0] - want[0]).abs() + (found[1] - want[1]).abs() < 1e-12, "{found:?}");
        };
        near(limits.slewed([0.0, 0.3], [9.0, -9.0]), [0.2, 0.1]);
        near(limits.slewed([0.35, 0.0], [9.0, 0.1]), [0.4, 0.1]);
    }
}
