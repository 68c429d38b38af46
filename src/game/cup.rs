//! The ball over a goal cup: capture, or exit over the far rim.
//!
//! While its centre is over the cup the ball is in free flight (a sphere that leaves an edge;
//! Holmes, "Putting: How a golf ball and hole interact", Am. J. Phys. 59, 1991). After the time `t`
//! it has fallen by `h = g t^2 / 2` and falls with `w = g t`. After falling by its radius `r` it is
//! captured. If its centre reaches the far rim before that with the radial velocity `v_r`, it hits
//! the rim at the height `r - h` below its centre, with `sin a = 1 - h/r`. The rim absorbs the
//! velocity along the line of centres; the remaining velocity around the rim must lift the ball by
//! `h`:
//!
//! ```text
//! along the pivot   q = v_r sin a - w cos a
//! leaves when       0 < q and 2 g h <= q^2,   with   v_r' = sqrt(q^2 - 2 g h),  v_t' = v_t
//! ```
//!
//! Since `2 g h = w^2` the ball leaves only if `v_r >= w (1 + cos a) / sin a >= w`. On a chord of
//! half-length `a` in a cup of radius `R` that is `v a / R >= g 2 a / v`. A ball slower than
//! `sqrt(2 g R)` (0.61 m/s) is therefore always captured ([`sure_fall_speed`]). A faster one is
//! captured if its path over the cup is long enough. Friction at the rim and the rotation of the
//! rolling ball are neglected.

use crate::board::BALL_RADIUS;

/// Standard gravity (m/s^2), the value of the effects' catalogue.
pub(super) const GRAVITY: f64 = 9.81;

/// Speed (m/s) below which a ball whose centre crosses the rim of a cup of `radius` (m) is always
/// captured.
///
/// ```
/// use klasktron::{board::CUP_RADIUS, game::sure_fall_speed};
/// assert!((sure_fall_speed(CUP_RADIUS) - 0.611).abs() < 1e-3);
/// ```
#[must_use]
pub fn sure_fall_speed(radius: f64) -> f64 {
    (2.0 * GRAVITY * radius).sqrt()
}

/// Time over the cup after which the ball has fallen by its radius (s).
pub(super) fn fall_time() -> f64 {
    (2.0 * BALL_RADIUS / GRAVITY).sqrt()
}

/// Radial velocity (m/s) of a ball that leaves a cup, for the radial velocity `radial` (m/s) at the
/// rim and `over_cup` seconds of flight; `None` if the ball is captured.
pub(super) fn leaves_with(radial: f64, over_cup: f64) -> Option<f64> {
    let sunk = 0.5 * GRAVITY * over_cup * over_cup;
    if BALL_RADIUS <= sunk {
        return None;
    }
    let sine = 1.0 - sunk / BALL_RADIUS;
    let cosine = (1.0 - sine * sine).sqrt();
    let pivot = radial * sine - GRAVITY * over_cup * cosine;
    let left = pivot * pivot - 2.0 * GRAVITY * sunk;
    (0.0 < pivot && 0.0 <= left).then(|| left.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ball_that_has_not_sunk_leaves_as_it_came_and_one_sunk_by_its_radius_stays() {
        assert_eq!(leaves_with(1.0, 0.0), Some(1.0));
        assert_eq!(leaves_with(100.0, fall_time()), None);
    }

    #[test]
    fn the_rim_takes_what_the_pivot_does_not_keep() {
        // Sunk by 3.5 mm (sin 0.5): q = 2 * 0.5 - 0.262 * 0.866, v' = sqrt(q^2 - 2 * 9.81 * 0.0035).
        let time = (2.0 * 0.0035 / GRAVITY).sqrt();
        let q: f64 = 1.0 - (2.0 * GRAVITY * 0.0035_f64).sqrt() * 0.75_f64.sqrt();
        let want = (q * q - 2.0 * GRAVITY * 0.0035).sqrt();
        let found = leaves_with(2.0, time).unwrap();
        assert!((found - want).abs() < 1e-12, "{found} {want}");
    }

    #[test]
    fn leaving_never_gains_speed_and_slow_balls_fall_on_every_chord() {
        let radius = 0.01905;
        for step in 1..200 {
            let chord = 2.0 * radius * f64::from(step) / 200.0;
            for speed in 1..300 {
                let speed = f64::from(speed) / 100.0;
                let radial = speed * chord / (2.0 * radius);
                match leaves_with(radial, chord / speed) {
                    Some(after) => {
                        assert!(after <= radial && sure_fall_speed(radius) <= speed, "{speed}");
                    }
                    None => assert!(speed < 3.0),
                }
            }
        }
    }
}
