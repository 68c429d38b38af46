//! Fit of a pattern to its workspace and limits, with the largest parameters that fit.

use super::{
    Pattern, Reference, Sampling, TrajectoryError,
    course::{Course, Grid, course},
    reference::checked_rate,
};
use crate::gantry::{Limits, Rectangle};

/// Allowed number of samples of a run.
const SAMPLES: std::ops::RangeInclusive<usize> = 10..=1_000_000;
/// Relative tolerance of a limit for rounding.
const ROUNDING: f64 = 1e-9;
/// Ratio of successive values in the search for a value that fits.
const SHRINK: f64 = 0.93;
/// Number of search steps: down to a thousandth.
const STEPS: usize = 96;
/// Number of bisections of the refinement.
const HALVINGS: usize = 12;

impl Pattern {
    /// Generate the motion in the centre of `workspace`. It starts and ends at rest, keeps the
    /// limits of speed and slew, and can stop inside at each moment. Periodic patterns are
    /// repeated.
    ///
    /// # Errors
    /// When a parameter is out of range, or the pattern does not fit; the error gives a value that
    /// fits.
    pub fn reference(
        &self,
        workspace: &Rectangle,
        limits: &Limits,
        sampling: &Sampling,
    ) -> Result<Reference, TrajectoryError> {
        let Sampling { rate_hz, samples, seed } = *sampling;
        self.check()?;
        let rate = checked_rate(rate_hz)?;
        if !SAMPLES.contains(&samples) {
            return Err(TrajectoryError::Samples { samples });
        }
        let grid = Grid { workspace, limits, rate, samples, seed };
        if !workspace.contains(workspace.centre()) {
            return Err(self.no_room(workspace));
        }
        let Course { start, velocities } = self.course_in_limits(&grid)?;
        let reference = Reference::from_velocities(start, &velocities, rate)?;
        if stays_inside(&reference, &grid) {
            return Ok(reference);
        }
        Err(self.what_fits(&grid))
    }

    fn no_room(&self, workspace: &Rectangle) -> TrajectoryError {
        TrajectoryError::NoRoom {
            pattern: self.name(),
            width_m: workspace.x_max_m - workspace.x_min_m,
            height_m: workspace.y_max_m - workspace.y_min_m,
        }
    }

    fn course_in_limits(&self, grid: &Grid<'_>) -> Result<Course, TrajectoryError> {
        let found = course(self, grid)?;
        let limits = grid.limits;
        let (pattern, speed) = (self.name(), self.speed());
        let largest = |fraction: f64| (speed * fraction * 1e4).floor() / 1e4;
        let fraction = found.velocities.iter().fold(f64::INFINITY, |fraction, [x, y]| {
            let axis = limits.speed_m_per_s / x.abs().max(y.abs());
            fraction.min(axis).min(limits.total_speed_m_per_s / x.hypot(*y))
        });
        if fraction < 1.0 - ROUNDING {
            return Err(TrajectoryError::TooFast { pattern, speed, largest: largest(fraction) });
        }
        let step = limits.slew_m_per_s2 * grid.dt();
        let fraction = found.velocities.windows(2).fold(f64::INFINITY, |fraction, pair| {
            let change = [0, 1].map(|axis| (pair[1][axis] - pair[0][axis]).abs());
            fraction.min(step / change[0].max(change[1]))
        });
        if fraction < 1.0 - ROUNDING {
            let (key, largest) = ("speed_m_per_s", largest(fraction));
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

    /// Return the error with the largest radius, length, time or speed that fits.
    fn what_fits(&self, grid: &Grid<'_>) -> TrajectoryError {
        for key in ["radius_m", "length_m", "hold_s", "speed_m_per_s"] {
            let Some(value) = self.number(key) else { continue };
            let fits = |value: f64| self.with(key, value).fits(grid);
            if let Some(largest) = largest_below(value, fits) {
                return TrajectoryError::TooLarge { pattern: self.name(), key, value, largest };
            }
        }
        self.no_room(grid.workspace)
    }
}

/// Return the largest value below `value`, to a ten-thousandth, that fits. Values that fit may have
/// a lower limit too (a small circle needs more slew), so the search starts from above.
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
        grid.workspace.contains(setpoint.position) && grid.workspace.contains(stands)
    })
}
