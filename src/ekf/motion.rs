//! Motion of an object between two instants: rolling, process noise, and impacts.

use super::matrix::{Matrix4, add_outer, congruence};
use crate::stats::{normal_cdf, normal_density};
use serde::{Deserialize, Serialize};

/// State estimate of one object: (x, y, vx, vy) in the board frame, m and m/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Mean.
    pub mean: [f64; 4],
    /// Covariance, symmetric.
    pub covariance: Matrix4,
}

/// Speed below which rolling resistance fades (m/s): no sign change at rest, and the Jacobian
/// exists.
const FADING_SPEED: f64 = 0.02;

/// Rolling resistance: a = -(c / (|v| + 0.02 m/s) + b) v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rolling {
    /// Coefficient c (m/s2).
    pub(super) deceleration: f64,
    /// Coefficient b (1/s).
    pub(super) drag: f64,
}

/// A wall: the line `normal . p = reach`, which moves along its normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Obstacle {
    /// Unit vector into the obstacle.
    pub(super) normal: [f64; 2],
    /// `normal . p` of the ball's centre at contact (m).
    pub(super) reach: f64,
    /// Speed of the obstacle along its normal (m/s).
    pub(super) speed: f64,
    /// Restitution: relative normal speed after over before the impact.
    pub(super) restitution: f64,
    /// Standard deviation of the restitution.
    pub(super) restitution_sigma: f64,
    /// Standard deviation of the tangential velocity change, per relative normal speed.
    pub(super) tangential_sigma: f64,
}

impl Rolling {
    /// Constant velocity.
    pub(super) const NONE: Self = Self { deceleration: 0.0, drag: 0.0 };

    /// Propagate an estimate by `dt` (s), without noise.
    #[inline]
    pub(super) fn advance(self, estimate: &mut Estimate, dt: f64) {
        let (mean, velocities) = self.step(&estimate.mean, dt);
        estimate.mean = mean;
        transform(&mut estimate.covariance, velocities, dt);
    }

    /// State after `dt` (s), and the derivative of the new velocities with respect to the old ones:
    /// xx, xy, yy of a symmetric matrix. Explicit Euler for the velocity, trapezoidal rule for the
    /// position; exact for constant deceleration and for constant velocity.
    #[inline]
    fn step(self, state: &[f64; 4], dt: f64) -> ([f64; 4], [f64; 3]) {
        let [x, y, vx, vy] = *state;
        let speed = (vx * vx + vy * vy).sqrt();
        let slow = self.deceleration * dt / (speed + FADING_SPEED);
        let kept = 1.0 - self.drag * dt - slow;
        // d(kept v)/dv = kept I + slow / (|v| + v0) v v' / |v|
        let turn = slow / ((speed + FADING_SPEED) * speed.max(f64::MIN_POSITIVE));
        let along = 0.5 * dt * (1.0 + kept);
        let mean = [x + along * vx, y + along * vy, kept * vx, kept * vy];
        (mean, [kept + turn * vx * vx, turn * vx * vy, kept + turn * vy * vy])
    }
}

/// F P F' for F = [[I, B], [0, D]] with B = dt/2 (I + D), the Jacobian of [`Rolling::step`], by
/// blocks. With V and W the position-velocity and velocity blocks and T = V + B W, the new blocks
/// are P + T B + B V', T D and D W D.
#[inline]
fn transform(p: &mut Matrix4, velocities: [f64; 3], dt: f64) {
    let [d0, d1, d2] = velocities;
    let half = 0.5 * dt;
    let (b0, b1, b2) = (half * (1.0 + d0), half * d1, half * (1.0 + d2));
    let [v00, v01, v10, v11] = [p[0][2], p[0][3], p[1][2], p[1][3]];
    let [w0, w1, w2] = [p[2][2], p[2][3], p[3][3]];
    let [t00, t01] = [v00 + b0 * w0 + b1 * w1, v01 + b0 * w1 + b1 * w2];
    let [t10, t11] = [v10 + b1 * w0 + b2 * w1, v11 + b1 * w1 + b2 * w2];
    p[0][0] += t00 * b0 + t01 * b1 + b0 * v00 + b1 * v01;
    p[0][1] += t00 * b1 + t01 * b2 + b0 * v10 + b1 * v11;
    p[1][1] += t10 * b1 + t11 * b2 + b1 * v10 + b2 * v11;
    p[0][2] = t00 * d0 + t01 * d1;
    p[0][3] = t00 * d1 + t01 * d2;
    p[1][2] = t10 * d0 + t11 * d1;
    p[1][3] = t10 * d1 + t11 * d2;
    let [s00, s01] = [d0 * w0 + d1 * w1, d0 * w1 + d1 * w2];
    let [s10, s11] = [d1 * w0 + d2 * w1, d1 * w1 + d2 * w2];
    p[2][2] = s00 * d0 + s01 * d1;
    p[2][3] = s00 * d1 + s01 * d2;
    p[3][3] = s10 * d1 + s11 * d2;
    for (row, column) in [(1, 0), (2, 0), (3, 0), (2, 1), (3, 1), (3, 2)] {
        p[row][column] = p[column][row];
    }
}

/// Add the noise of a white acceleration with density `psd` (m2/s3) in each axis over `dt` (s).
///
/// Q = q [[dt^3/3, dt^2/2], [dt^2/2, dt]] (Bar-Shalom, Li and Kirubarajan, "Estimation with
/// Applications to Tracking and Navigation", 2001, section 6.2.2).
#[inline]
pub(super) fn add_acceleration_noise(p: &mut Matrix4, psd: [f64; 2], dt: f64) {
    for (axis, q) in psd.into_iter().enumerate() {
        let place_speed = 0.5 * q * dt * dt;
        p[axis][axis] += q * dt * dt * dt / 3.0;
        p[axis][axis + 2] += place_speed;
        p[axis + 2][axis] += place_speed;
        p[axis + 2][axis + 2] += q * dt;
    }
}

impl Obstacle {
    /// Number of standard deviations beyond which an impact has certainly occurred or not occurred.
    pub(super) const CERTAIN: f64 = 5.0;

    /// Reflect the part of the estimate beyond the wall. The estimate is split at the wall into a
    /// part that has reached it and a part that has not, each with the moments of a truncated
    /// normal distribution. The first part is reflected with the noise of the impact; both are
    /// merged into the mean and covariance of the mixture. Away from the wall nothing changes; well
    /// beyond it the result is the plain Jacobian of the reflection.
    pub(super) fn bounce(&self, estimate: &mut Estimate) {
        let [n0, n1] = self.normal;
        let p = &estimate.covariance;
        let across: [f64; 4] = std::array::from_fn(|row| n0 * p[row][0] + n1 * p[row][1]);
        let variance = n0 * across[0] + n1 * across[1];
        let beyond = n0 * estimate.mean[0] + n1 * estimate.mean[1] - self.reach;
        if variance <= 0.0 || beyond * beyond.abs() < -Self::CERTAIN * Self::CERTAIN * variance {
            return;
        }
        let sigma = variance.sqrt();
        let depth = beyond / sigma;
        let slope = across.map(|cell| cell / variance);
        if Self::CERTAIN < depth {
            self.reflect(estimate);
            return;
        }
        let reached = normal_cdf(depth);
        let (part, rest) =
            (normal_density(depth) / reached, normal_density(depth) / (1.0 - reached));
        let mut inside = *estimate;
        shift(&mut inside, &slope, -sigma * rest, variance * (depth * rest - rest * rest));
        shift(estimate, &slope, sigma * part, variance * (-depth * part - part * part));
        self.reflect(estimate);
        mix(estimate, reached, &inside);
    }

    /// Reflect the whole estimate, if it moves into the wall.
    fn reflect(&self, estimate: &mut Estimate) {
        let [n0, n1] = self.normal;
        let [x, y, vx, vy] = estimate.mean;
        let beyond = n0 * x + n1 * y - self.reach;
        let closing = n0 * vx + n1 * vy - self.speed;
        if closing <= 0.0 {
            return;
        }
        let turn = 1.0 + self.restitution;
        estimate.mean = [
            x - turn * n0 * beyond,
            y - turn * n1 * beyond,
            vx - turn * n0 * closing,
            vy - turn * n1 * closing,
        ];
        let (a, b, c) = (1.0 - turn * n0 * n0, -turn * n0 * n1, 1.0 - turn * n1 * n1);
        let map = [[a, b, 0.0, 0.0], [b, c, 0.0, 0.0], [0.0, 0.0, a, b], [0.0, 0.0, b, c]];
        let p = &mut estimate.covariance;
        *p = congruence(&map, p);
        let along = [n0 * beyond, n1 * beyond, n0 * closing, n1 * closing];
        let across = [-n1 * beyond, n0 * beyond, -n1 * closing, n0 * closing];
        add_outer(p, &along, self.restitution_sigma.powi(2));
        add_outer(p, &across, self.tangential_sigma.powi(2));
    }
}

/// Set mean and variance of the coordinate across a wall; the other coordinates follow by the
/// regression `slope`.
fn shift(estimate: &mut Estimate, slope: &[f64; 4], mean: f64, variance: f64) {
    for (value, slope) in estimate.mean.iter_mut().zip(slope) {
        *value += slope * mean;
    }
    add_outer(&mut estimate.covariance, slope, variance);
}

/// Merge two estimates: mean and covariance of the mixture with weight `share` of the first.
fn mix(estimate: &mut Estimate, share: f64, other: &Estimate) {
    let apart: [f64; 4] = std::array::from_fn(|k| other.mean[k] - estimate.mean[k]);
    for (row, other) in estimate.covariance.iter_mut().zip(&other.covariance) {
        for (cell, other) in row.iter_mut().zip(other) {
            *cell = share * *cell + (1.0 - share) * other;
        }
    }
    for (value, apart) in estimate.mean.iter_mut().zip(&apart) {
        *value += (1.0 - share) * apart;
    }
    add_outer(&mut estimate.covariance, &apart, share * (1.0 - share));
}
