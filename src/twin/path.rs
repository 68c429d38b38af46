//! A measured motion between its samples.

use crate::effects::both;

/// Positions and velocities at known times, read anywhere between them.
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

    /// Position, velocity and acceleration at `time`: the cubic through the samples beside it
    /// (Hermite), held still beyond the ends. `cursor` remembers the place between calls.
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
