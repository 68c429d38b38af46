//! The carriage as a guide to the striker. Encoders measure the motion of the carriage, so the
//! camera only has to measure the difference of the striker from it.
//!
//! Encoders resolve a jump of the acceleration that noisy frames do not. Only the small difference
//! of both remains to be smoothed, over a longer window and therefore with less noise.

use crate::{effects::both, twin::MeasuredPath};
use faer::{Mat, linalg::solvers::Solve};

/// Delays of the frames behind the carriage that are searched (s), and the steps of the search.
const DELAYS: (f64, f64) = (-0.05, 0.2);
const STEPS: [f64; 4] = [5e-3, 5e-4, 5e-5, 5e-6];

/// Largest fraction of the striker's variance that its carriage may leave unexplained; above it
/// they do not belong together.
const MOST_LEFT: f64 = 0.02;

/// A carriage as the camera would see it, were the striker rigid on it.
pub(super) struct Guide<'p> {
    pub(super) path: &'p MeasuredPath,
    /// Delay of the frames behind the carriage (s).
    pub(super) delay: f64,
    /// Delay of the carriage's velocities behind its positions (s).
    velocity_lag: f64,
    /// Map to positions in the camera: `[axis][x, y, 1]`.
    pub(super) map: [[f64; 3]; 2],
}

impl<'p> Guide<'p> {
    /// Delay and affine map with which `path` is nearest to `places` at `times`; `None` where they
    /// do not follow it.
    pub(super) fn of(
        path: &'p MeasuredPath,
        times: &[f64],
        places: &[[f64; 2]],
    ) -> Option<Guide<'p>> {
        let velocity_lag = path.velocity_lag();
        let mut best: Option<(f64, Self)> = None;
        let mut range = DELAYS;
        for step in STEPS {
            let count = ((range.1 - range.0) / step).round() as usize;
            for delay in (0..=count).map(|k| range.0 + step * k as f64) {
                if let Some((left, map)) = fitted(path, delay, (times, places))
                    && best.as_ref().is_none_or(|(least, _)| left < *least)
                {
                    best = Some((left, Self { path, delay, velocity_lag, map }));
                }
            }
            let delay = best.as_ref()?.1.delay;
            range = (delay - step, delay + step);
        }
        best.filter(|(left, _)| *left < MOST_LEFT).map(|(_, guide)| guide)
    }

    /// Position (m) and velocity (m/s) at `time` (s).
    pub(super) fn at(&self, time: f64) -> ([f64; 2], [f64; 2]) {
        let then = time - self.delay;
        let ([x, y], ..) = self.path.at(then, &mut self.cursor(then));
        let told = then + self.velocity_lag;
        let (_, [vx, vy], _) = self.path.at(told, &mut self.cursor(told));
        let image = |axis: usize, [x, y, one]: [f64; 3]| {
            let [by_x, by_y, shift] = self.map[axis];
            by_x * x + by_y * y + shift * one
        };
        (both(|axis| image(axis, [x, y, 1.0])), both(|axis| image(axis, [vx, vy, 0.0])))
    }

    /// Index in the path at which to look.
    fn cursor(&self, then: f64) -> usize {
        self.path.times().partition_point(|at| *at < then).saturating_sub(1)
    }
}

/// Fraction of the variance of `places` that the best affine map of the path with this `delay`
/// leaves, and the map; `None` where the motion does not determine it.
fn fitted(
    path: &MeasuredPath,
    delay: f64,
    (times, places): (&[f64], &[[f64; 2]]),
) -> Option<(f64, [[f64; 3]; 2])> {
    let mut cursor = 0;
    let (mut gram, mut right, mut sums) = ([[0.0; 3]; 3], [[0.0; 3]; 2], [[0.0; 2]; 2]);
    for (time, place) in times.iter().zip(places) {
        let ([x, y], ..) = path.at(time - delay, &mut cursor);
        let row = [x, y, 1.0];
        for i in 0..3 {
            (0..3).for_each(|j| gram[i][j] += row[i] * row[j]);
            (0..2).for_each(|axis| right[axis][i] += row[i] * place[axis]);
        }
        for (axis, value) in place.iter().enumerate() {
            sums[axis][0] += value;
            sums[axis][1] += value * value;
        }
    }
    let left = Mat::from_fn(3, 3, |i, j| gram[i][j]).partial_piv_lu();
    let solved = left.solve(&Mat::from_fn(3, 2, |i, axis| right[axis][i]));
    let map = both(|axis| [solved[(0, axis)], solved[(1, axis)], solved[(2, axis)]]);
    let explained = |axis: usize| (0..3).map(|i| map[axis][i] * right[axis][i]).sum::<f64>();
    let whole = |axis: usize| sums[axis][1] - sums[axis][0].powi(2) / times.len() as f64;
    let rest: f64 = (0..2).map(|axis| sums[axis][1] - explained(axis)).sum();
    let share = rest / (whole(0) + whole(1));
    share.is_finite().then_some((share, map))
}
