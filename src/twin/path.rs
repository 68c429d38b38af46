//! Measured motion between its samples.

use crate::effects::{Carriage, both};

/// Positions and velocities at known times, interpolated between them.
#[derive(Debug, Clone, Default)]
pub struct MeasuredPath {
    times: Vec<f64>,
    position: Vec<[f64; 2]>,
    velocity: Vec<[f64; 2]>,
    acceleration: Vec<[f64; 2]>,
}

impl MeasuredPath {
    /// A path through `position` (m) with `velocity` (m/s) at increasing `times` (s).
    #[must_use]
    pub fn new(times: Vec<f64>, position: Vec<[f64; 2]>, velocity: Vec<[f64; 2]>) -> Self {
        let last = times.len().saturating_sub(1);
        let acceleration = (0..times.len())
            .map(|index| {
                let (before, after) = (index.saturating_sub(1), (index + 1).min(last));
                let span = times[after] - times[before];
                both(|k| {
                    if 0.0 < span { (velocity[after][k] - velocity[before][k]) / span } else { 0.0 }
                })
            })
            .collect();
        Self { times, position, velocity, acceleration }
    }

    /// Times of the samples (s).
    #[must_use]
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// Measured positions (m).
    #[must_use]
    pub fn positions(&self) -> &[[f64; 2]] {
        &self.position
    }

    /// Measured velocities (m/s).
    #[must_use]
    pub fn velocities(&self) -> &[[f64; 2]] {
        &self.velocity
    }

    /// Delay of the measured velocities behind the slope of the positions (s), by least squares.
    /// Drives report the velocity of the past sampling period, or of a filter. Zero where the
    /// motion does not show it.
    #[must_use]
    pub fn velocity_lag(&self) -> f64 {
        let (mut along, mut whole) = (0.0, 0.0);
        for k in 1..self.times.len() {
            let span = self.times[k] - self.times[k - 1];
            for axis in 0..2 {
                let [before, after] = [self.velocity[k - 1][axis], self.velocity[k][axis]];
                let way = self.position[k][axis] - self.position[k - 1][axis];
                along += (way - 0.5 * span * (before + after)) * (after - before);
                whole += (after - before).powi(2);
            }
        }
        if 0.0 < whole && along.is_finite() { along / whole } else { 0.0 }
    }

    /// The carriage at `time`, for a step of `dt` (s) with a striker of `striker_mass` (kg); see [`at`](Self::at).
    pub fn carriage(&self, time: f64, dt: f64, striker_mass: f64, cursor: &mut usize) -> Carriage {
        let (position, velocity, acceleration) = self.at(time, cursor);
        Carriage { dt, position, velocity, acceleration, striker_mass }
    }

    /// Position, velocity and acceleration at `time`. The position is the cubic through the two
    /// nearest samples (Hermite), held still beyond the ends. `cursor` remembers the index between
    /// calls.
    pub fn at(&self, time: f64, cursor: &mut usize) -> ([f64; 2], [f64; 2], [f64; 2]) {
        let n = self.times.len();
        if n == 0 {
            return Default::default();
        }
        if time <= self.times[0] {
            return (self.position[0], [0.0; 2], [0.0; 2]);
        }
        if self.times[n - 1] <= time {
            return (self.position[n - 1], [0.0; 2], [0.0; 2]);
        }
        let mut k = (*cursor).min(n - 2);
        while time < self.times[k] {
            k -= 1;
        }
        while self.times[k + 1] < time {
            k += 1;
        }
        *cursor = k;
        let span = self.times[k + 1] - self.times[k];
        let s = (time - self.times[k]) / span;
        let (s2, s3) = (s * s, s * s * s);
        let (h00, h10, h01, h11) =
            (2.0 * s3 - 3.0 * s2 + 1.0, s3 - 2.0 * s2 + s, 3.0 * s2 - 2.0 * s3, s3 - s2);
        let mix = |from: &[[f64; 2]], axis: usize| {
            from[k][axis] + s * (from[k + 1][axis] - from[k][axis])
        };
        let position = both(|axis| {
            h00 * self.position[k][axis]
                + h10 * span * self.velocity[k][axis]
                + h01 * self.position[k + 1][axis]
                + h11 * span * self.velocity[k + 1][axis]
        });
        (
            position,
            both(|axis| mix(&self.velocity, axis)),
            both(|axis| mix(&self.acceleration, axis)),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn velocities_that_are_late_are_told() {
        let times: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
        for lag in [0.0, 1e-4, 3e-3] {
            let path = MeasuredPath::new(
                times.clone(),
                times.iter().map(|t| [0.1 * (5.0 * t).sin(), 0.05 * (9.0 * t).cos()]).collect(),
                times
                    .iter()
                    .map(|t| {
                        let t = t - lag;
                        [0.5 * (5.0 * t).cos(), -0.45 * (9.0 * t).sin()]
                    })
                    .collect(),
            );
            assert!((path.velocity_lag() - lag).abs() < 2e-6, "{lag} {}", path.velocity_lag());
        }
        let still = MeasuredPath::new(times, vec![[0.1; 2]; 1000], vec![[0.0; 2]; 1000]);
        assert_eq!(still.velocity_lag(), 0.0);
    }
}
