//! Whether a pattern fits its window and limits, and what would.

use super::{
    Pattern, Reference, Sampling, TrajectoryError,
    course::{Course, Grid, course},
    reference::checked_rate,
};
use crate::gantry::{Limits, Rectangle};

/// Fewest and most samples of a run.
const SAMPLES: std::ops::RangeInclusive<usize> = 10..=1_000_000;
/// Rounding that a limit forgives, as a share of it.
const ROUNDING: f64 = 1e-9;
/// Each step of the search for what fits is this share of the one before.
const SHRINK: f64 = 0.93;
/// How many such steps: down to a thousandth.
const STEPS: usize = 96;
/// Halvings that then refine it.
const HALVINGS: usize = 12;

impl Pattern {
    /// Its motion in the middle of `window`: it starts and ends at rest, keeps the limits of speed
    /// and slew, and could at each moment stop inside. What is periodic is repeated.
    ///
    /// # Errors
    /// When a parameter is out of its range, or the pattern cannot be had here; the error tells
    /// what can.
    pub fn reference(
        &self,
        window: &Rectangle,
        limits: &Limits,
        sampling: &Sampling,
    ) -> Result<Reference, TrajectoryError> {
        let Sampling { rate_hz, samples, seed } = *sampling;
        self.check()?;
        let rate = checked_rate(rate_hz)?;
        if !SAMPLES.contains(&samples) {
            return Err(TrajectoryError::Samples { samples });
        }
        let grid = Grid { window, limits, rate, samples, seed };
        if !window.contains(window.centre()) {
            return Err(self.no_room(window));
        }
        let Course { start, velocities } = self.course_in_limits(&grid)?;
        let reference = Reference::from_velocities(start, &velocities, rate)?;
        if stays_inside(&reference, &grid) {
            return Ok(reference);
        }
        Err(self.what_fits(&grid))
    }

    fn no_room(&self, window: &Rectangle) -> TrajectoryError {
        TrajectoryError::NoRoom {
            pattern: self.name(),
            width_m: window.x_max_m - window.x_min_m,
            height_m: window.y_max_m - window.y_min_m,
        }
    }

    fn course_in_limits(&self, grid: &Grid<'_>) -> Result<Course, TrajectoryError> {
        let found = course(self, grid)?;
        let limits = grid.limits;
        let (pattern, speed) = (self.name(), self.speed());
        let largest = |share: f64| (speed * share * 1e4).floor() / 1e4;
        let share = found.velocities.iter().fold(f64::INFINITY, |share, [x, y]| {
            let axis = limits.speed_m_per_s / x.abs().max(y.abs());
            share.min(axis).min(limits.total_speed_m_per_s / x.hypot(*y))
        });
        if share < 1.0 - ROUNDING {
            return Err(TrajectoryError::TooFast { pattern, speed, largest: largest(share) });
        }
        let step = limits.slew_m_per_s2 * grid.dt();
        let share = found.velocities.windows(2).fold(f64::INFINITY, |share, pair| {
            let change = [0, 1].map(|axis| (pair[1][axis] - pair[0][axis]).abs());
            share.min(step / change[0].max(change[1]))
        });
        if share < 1.0 - ROUNDING {
            let (key, largest) = ("speed_m_per_s", largest(share));
            return Err(TrajectoryError::TooAbrupt { pattern, key, value: speed, largest });
        }
        Ok(found)
    }

    fn fits(&self, grid: &Grid<'_>) -> bool {
        self.check().is_ok()
            && self.course_in_limits(grid).is_ok_and(|Course { start, velocities }| {
                Reference::from_velocities(start, &velocities, grid.rate)
                    .is_ok_and(|reference| stays_inside(&reference, grid))
            })
    }

    /// The error with the largest radius, length, time or speed that fits.
    fn what_fits(&self, grid: &Grid<'_>) -> TrajectoryError {
        for key in ["radius_m", "length_m", "hold_s", "speed_m_per_s"] {
            let Some(value) = self.number(key) else { continue };
            let fits = |value: f64| self.with(key, value).fits(grid);
            if let Some(largest) = largest_below(value, fits) {
                return TrajectoryError::TooLarge { pattern: self.name(), key, value, largest };
            }
        }
        self.no_room(grid.window)
    }
}

/// The largest value below `value`, to a ten-thousandth, that fits. What fits may have a lower end
/// too (a small circle needs more slew), so it is sought from above.
fn largest_below(value: f64, fits: impl Fn(f64) -> bool) -> Option<f64> {
    let powers = (1..=STEPS as i32).map(|step| value * SHRINK.powi(step));
    let mut good = powers.into_iter().find(|candidate| fits(*candidate))?;
    let mut bad = good / SHRINK;
    for _ in 0..HALVINGS {
        let middle = f64::midpoint(good, bad);
        if fits(middle) {
            good = middle;
        } else {
            bad = middle;
        }
    }
    let rounded = (good * 1e4).floor() / 1e4;
    Some(if fits(rounded) { rounded } else { good })
}

fn stays_inside(reference: &Reference, grid: &Grid<'_>) -> bool {
    reference.setpoints().iter().all(|setpoint| {
        let stands = grid.limits.standstill(setpoint.position, setpoint.velocity);
        grid.window.contains(setpoint.position) && grid.window.contains(stands)
    })
}
