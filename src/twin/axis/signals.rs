//! Filtered signals of a single axis.
//!
//! Friction changes its sign where the velocity does, and makes a kink in the velocity there. One
//! filter for all samples moves that moment, which looks like presliding, or averages too little
//! elsewhere. The velocity of each sample near a reversal is therefore the slope of a straight line
//! through the positions around it. The window is the longest one whose confidence interval
//! intersects those of all shorter ones (intersection of confidence intervals: Goldenshluger and
//! Nemirovski 1997, Mathematical Methods of Statistics 6, 135-170). A window within a rest is
//! independent of the motion around it, whereas a recursive filter rings there.
//!
//! The acceleration in the inverse dynamics passes a wider filter than the regressors. Its
//! contribution passes the last filter like the friction, with which it makes the input continuous
//! at a kink.

use super::filter::{Smoothing, derivative};
use crate::seed::Stream;
use std::{f64::consts::TAU, ops::Range};

/// Edges of the low-pass filter for position and input that are tried, in cycles per sample, the widest first.
const EDGES: [f64; 7] = [0.1, 0.07, 0.05, 0.035, 0.025, 0.0175, 0.0125];
/// Further edges that are tried for what passes one more filter.
const WIDER_EDGES: [f64; 4] = [0.4, 0.28, 0.2, 0.14];
/// Samples to each side through which the straight lines go, the shortest first.
const REACHES: [usize; 11] = [1, 2, 3, 4, 5, 7, 10, 14, 20, 28, 40];
/// Largest ratio of the standard deviation of the acceleration's noise to the RMS of the
/// acceleration at which an edge is chosen. Noise of a regressor biases its coefficient by the
/// square of this ratio.
const ACCELERATION_NOISE: f64 = 0.1;
/// The same ratio before the last filter, which removes most of this noise.
const INNER_ACCELERATION_NOISE: f64 = 0.5;
/// Standard deviations of its noise within which a velocity counts as rest, or agrees with that of another filter.
const VELOCITY_DEVIATIONS: f64 = 3.0;
/// Error of the filters by rounding, as a fraction of the largest position.
const ROUNDING: f64 = 16.0 * f64::EPSILON;
/// Least duration of a rest (samples): a reversal that does not stick passes through zero faster.
const REST: usize = 10;

/// Signals of all recorded samples, each segment filtered by itself.
#[derive(Debug, Clone)]
pub(super) struct Signals {
    /// Edge of the low-pass filter (cycles per sample).
    pub(super) cutoff: f64,
    /// Input and position behind that filter.
    pub(super) input: Vec<f64>,
    pub(super) position: Vec<f64>,
    /// Velocity; near reversals over a shorter window.
    pub(super) velocity: Vec<f64>,
    /// Mean sign of the velocity over the period of a sample.
    pub(super) direction: Vec<f64>,
    /// Acceleration behind the filter of the position.
    pub(super) acceleration: Vec<f64>,
    /// Input and acceleration behind a wider filter, for the inverse dynamics.
    pub(super) inner_input: Vec<f64>,
    pub(super) inner_acceleration: Vec<f64>,
    /// True where the axis may stand: friction takes any value within its level there.
    pub(super) standing: Vec<bool>,
    /// True where the sample belongs to a longer rest.
    pub(super) resting: Vec<bool>,
    /// Edge of the wider filter (cycles per sample).
    inner: f64,
    /// White noise of the measured motion.
    noise: MotionNoise,
    /// Standard deviation of the white noise of the measured input.
    input_noise: f64,
}

/// Standard deviations of the white noise of the measured motion. The noise of a velocity that was computed from positions is
/// theirs.
#[derive(Debug, Clone, Copy)]
struct MotionNoise {
    /// Of the position.
    position: f64,
    /// Of the velocity (per second).
    velocity: f64,
}

/// Variance of a difference of white noise of variance 1, as sixth differences of each sample and of every second one see
/// it. The first is the ratio of the binomial coefficients of 14 over 7 and of 12 over 6.
const DIFFERENCE_VARIANCES: [f64; 2] = [3432.0 / 924.0, 2.0];

/// Two standard deviations of the white part of the variance for a difference alone. It is a fraction of the variance, times
/// the root of the number of samples. By 400 simulations each: 11.6, 12.1 and 11.0 for 1000, 4000 and 16 000 samples.
const WHITE_VARIANCE_ERROR: f64 = 11.6;

impl MotionNoise {
    /// Noise of `position`, or of `velocity` where that was measured `dt` seconds apart. Its spectrum is then the sum of that
    /// of white noise and of a difference of white noise, or of the latter alone if the former is within its error.
    fn of(
        segments: &[Range<usize>],
        (position, velocity): (&[f64], Option<&[f64]>),
        dt: f64,
    ) -> Self {
        let Some(velocity) = velocity else {
            return Self { position: white_noise(segments, position), velocity: 0.0 };
        };
        let fast = white_noise(segments, velocity);
        let slow = sixth_difference_noise(segments, velocity, 2);
        let [of_fast, of_slow] = DIFFERENCE_VARIANCES;
        let difference = ((fast * fast - slow * slow) / (of_fast - of_slow)).max(0.0);
        let white = fast * fast - of_fast * difference;
        let count = segments.iter().map(|own| own.len()).sum::<usize>().max(1) as f64;
        let error = fast * fast * WHITE_VARIANCE_ERROR / count.sqrt();
        match 0.0 < difference && white < error {
            true => Self { position: fast / of_fast.sqrt() * dt, velocity: 0.0 },
            false => Self { position: difference.sqrt() * dt, velocity: white.max(0.0).sqrt() },
        }
    }

    /// Standard deviation of the velocity (per second) behind a low-pass filter with the `edge` (cycles per sample): the
    /// root of the integral of the spectrum below the edge.
    fn of_velocity(self, edge: f64, dt: f64) -> f64 {
        let of_position = self.position * TAU / dt * (2.0 * edge.powi(3) / 3.0).sqrt();
        of_position.hypot(self.velocity * (2.0 * edge).sqrt())
    }

    /// The same of the acceleration (per second squared).
    fn of_acceleration(self, edge: f64, dt: f64) -> f64 {
        let rate = TAU / dt;
        let of_position = self.position * rate * rate * (2.0 * edge.powi(5) / 5.0).sqrt();
        of_position.hypot(self.velocity * rate * (2.0 * edge.powi(3) / 3.0).sqrt())
    }

    /// Standard deviation of the slope (per second) of a straight line through the positions up to `reach` samples to each
    /// side.
    fn of_line_slope(self, reach: usize, dt: f64) -> f64 {
        let squares = squared_distances(reach);
        // The velocity between two positions acts on all positions beyond it.
        let weight = |step: usize| (step..=reach).sum::<usize>() as f64 / squares;
        let weights = 2.0 * (1..=reach).map(|step| weight(step).powi(2)).sum::<f64>();
        (self.position / (dt * squares.sqrt())).hypot(self.velocity * weights.sqrt())
    }

    /// `count` positions with this noise, `dt` seconds apart.
    fn positions(self, count: usize, dt: f64) -> Vec<f64> {
        let mut positions = white_samples(self.position, "position noise", count);
        if 0.0 < self.velocity {
            let mut moved = 0.0;
            let velocities = white_samples(self.velocity, "velocity noise", count);
            for (position, velocity) in positions.iter_mut().zip(velocities) {
                moved += velocity * dt;
                *position += moved;
            }
        }
        positions
    }
}

impl Signals {
    /// Signals of the recorded `input` and `position` at steps of `dt` seconds, of which each of `segments` was recorded
    /// without interruption. The position may be the integral of a measured `velocity`.
    pub(super) fn of(
        segments: &[Range<usize>],
        input: &[f64],
        (position, velocity): (&[f64], Option<&[f64]>),
        dt: f64,
    ) -> Self {
        let noise = MotionNoise::of(segments, (position, velocity), dt);
        let edge = |edges: &[f64], fraction| edge(edges, segments, (position, noise), fraction, dt);
        let cutoff = edge(&EDGES, ACCELERATION_NOISE);
        let inner = edge(&[&WIDER_EDGES[..], &EDGES].concat(), INNER_ACCELERATION_NOISE);
        let filtered = |values: &[f64], edge: f64| filtered(segments, values, edge);
        let slope = |values: &[f64]| slope(segments, values, dt);
        let smooth = filtered(position, cutoff);
        let narrowest = slope(&smooth);
        // A line as long as half a period of the filter averages about as much.
        let estimates: Vec<(Vec<f64>, f64)> = REACHES
            .into_iter()
            .filter(|reach| *reach as f64 <= 0.5 / cutoff)
            .map(|reach| {
                let slopes = each_segment(segments, position, |own| line_slopes(own, reach, dt));
                (slopes, noise.of_line_slope(reach, dt))
            })
            .collect();
        let beside = beside_reversals(
            &narrowest,
            VELOCITY_DEVIATIONS * noise.of_velocity(cutoff, dt),
            (1.0 / cutoff) as usize,
        );
        let (velocity, may_stand) = adapted(&narrowest, &beside, &estimates);
        Self {
            cutoff,
            inner,
            noise,
            input_noise: white_noise(segments, input),
            input: filtered(input, cutoff),
            direction: each_segment(segments, &velocity, mean_sign),
            acceleration: slope(&narrowest),
            inner_input: filtered(input, inner),
            inner_acceleration: slope(&slope(&filtered(position, inner))),
            // As far as the filter of the acceleration spreads the rest.
            standing: spread(&may_stand, (0.5 / inner).ceil() as usize),
            resting: resting(segments, &narrowest, noise.of_velocity(cutoff, dt)),
            position: smooth,
            velocity,
        }
    }

    /// Additional white noise of the input, as large as the measured one.
    pub(super) fn more_input_noise(&self) -> Vec<f64> {
        white_samples(self.input_noise, "input noise", self.input.len())
    }

    /// Copy with additional noise of the motion, as large as the measured one. Directions and
    /// rests remain.
    pub(super) fn with_more_noise(&self, segments: &[Range<usize>], dt: f64) -> Self {
        let noise = self.noise.positions(self.position.len(), dt);
        let slope = |values: &[f64]| slope(segments, values, dt);
        let position = filtered(segments, &noise, self.cutoff);
        let velocity = slope(&position);
        let added = |values: &mut [f64], noise: &[f64]| {
            values.iter_mut().zip(noise).for_each(|(value, noise)| *value += noise);
        };
        let mut noisy = self.clone();
        added(&mut noisy.acceleration, &slope(&velocity));
        added(
            &mut noisy.inner_acceleration,
            &slope(&slope(&filtered(segments, &noise, self.inner))),
        );
        added(&mut noisy.velocity, &velocity);
        added(&mut noisy.position, &position);
        noisy
    }
}

/// `count` independent samples with this standard `deviation`, from the random stream called `name`.
fn white_samples(deviation: f64, name: &str, count: usize) -> Vec<f64> {
    let mut stream = Stream::new(0, name);
    let half_width = 3.0_f64.sqrt() * deviation;
    (0..count).map(|_| half_width * f64::from(stream.uniform_f32(-1.0, 1.0))).collect()
}

/// Velocity of each sample, and whether the axis may stand there. The velocity is the `narrowest`
/// estimate, or that of a shorter window for the samples `beside` reversals.
fn adapted(
    narrowest: &[f64],
    beside: &[bool],
    estimates: &[(Vec<f64>, f64)],
) -> (Vec<f64>, Vec<bool>) {
    let (agreeing, deviations) = longest_agreeing(estimates);
    let of_sample = |index: usize| {
        if !beside[index] {
            return (narrowest[index], false);
        }
        let velocity = agreeing[index];
        (velocity, velocity.abs() <= VELOCITY_DEVIATIONS * deviations[index])
    };
    (0..narrowest.len()).map(of_sample).unzip()
}

/// `change` of `values` in each of `segments` by itself; zero outside of them.
pub(super) fn each_segment(
    segments: &[Range<usize>],
    values: &[f64],
    change: impl Fn(&[f64]) -> Vec<f64>,
) -> Vec<f64> {
    let mut changed = vec![0.0; values.len()];
    for segment in segments {
        changed[segment.clone()].copy_from_slice(&change(&values[segment.clone()]));
    }
    changed
}

/// `values` behind a low-pass filter with the `edge` (cycles per sample).
fn filtered(segments: &[Range<usize>], values: &[f64], edge: f64) -> Vec<f64> {
    let low_pass = Smoothing::butterworth(edge);
    each_segment(segments, values, |own| low_pass.apply(own))
}

/// Derivative of `values`, which are `dt` apart.
fn slope(segments: &[Range<usize>], values: &[f64], dt: f64) -> Vec<f64> {
    each_segment(segments, values, |own| derivative(own, dt))
}

/// Samples at rest, with `noise` of the velocity; all samples outside of `segments` count as rest.
fn resting(segments: &[Range<usize>], velocity: &[f64], noise: f64) -> Vec<bool> {
    let mut resting = vec![true; velocity.len()];
    for own in segments {
        resting[own.clone()].copy_from_slice(&rests(&velocity[own.clone()], noise));
    }
    resting
}

/// First of `edges` (cycles per sample) at which the acceleration has little noise; without one,
/// the last edge. The `noise` of `position` then makes at most the `fraction` of the RMS of its
/// acceleration.
fn edge(
    edges: &[f64],
    segments: &[Range<usize>],
    (position, noise): (&[f64], MotionNoise),
    fraction: f64,
    dt: f64,
) -> f64 {
    let is_measured = |edge: &f64| {
        let second =
            slope(segments, &slope(segments, &filtered(segments, position, *edge), dt), dt);
        let inside = segments.iter().map(|own| own.len()).sum::<usize>().max(1) as f64;
        let rms = (second.iter().map(|value| value * value).sum::<f64>() / inside).sqrt();
        noise.of_acceleration(*edge, dt) <= fraction * rms
    };
    let narrowest = edges[edges.len() - 1];
    edges.iter().copied().find(is_measured).unwrap_or(narrowest)
}

/// Samples that are at most `reach` from one whose `velocity` is within its `noise` or changes its sign.
fn beside_reversals(velocity: &[f64], noise: f64, reach: usize) -> Vec<bool> {
    let is_reversal = |(index, own): (usize, &f64)| {
        let turns = index.checked_sub(1).is_some_and(|before| velocity[before] * own < 0.0);
        turns || own.abs() <= noise
    };
    let reversals: Vec<bool> = velocity.iter().enumerate().map(is_reversal).collect();
    spread(&reversals, reach)
}

/// Slope (per second) of the straight line through each value and up to `reach` values on each
/// side, which are `dt` apart. Near the ends, the line uses fewer values, as many on either side.
/// The first and last slope are those to the neighbour.
fn line_slopes(values: &[f64], reach: usize, dt: f64) -> Vec<f64> {
    let mut slopes = derivative(values, dt);
    for (k, slope) in slopes.iter_mut().enumerate() {
        let reach = reach.min(k).min(values.len() - 1 - k);
        if 0 < reach {
            let sum: f64 = (1..=reach).map(|j| j as f64 * (values[k + j] - values[k - j])).sum();
            *slope = sum / (dt * squared_distances(reach));
        }
    }
    slopes
}

/// Sum of the squared distances of up to `reach` samples on each side.
fn squared_distances(reach: usize) -> f64 {
    (reach * (reach + 1) * (2 * reach + 1)) as f64 / 3.0
}

/// `marks`, and all samples that are at most `reach` from one of them.
fn spread(marks: &[bool], reach: usize) -> Vec<bool> {
    let mut wider = vec![false; marks.len()];
    for index in (0..marks.len()).filter(|index| marks[*index]) {
        let end = (index + reach + 1).min(marks.len());
        wider[index.saturating_sub(reach)..end].fill(true);
    }
    wider
}

/// Longest agreeing estimate of a velocity in each sample, with its standard deviation. The
/// `estimates`, each with its standard deviation, are ordered from the shortest window to the
/// longest. The last one before the intersection of the confidence intervals becomes empty is
/// taken.
fn longest_agreeing(estimates: &[(Vec<f64>, f64)]) -> (Vec<f64>, Vec<f64>) {
    let count = estimates.first().map_or(0, |(velocities, _)| velocities.len());
    let of_sample = |index: usize| {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        let mut agreeing = (0.0, 0.0);
        for (velocities, deviation) in estimates {
            let half = VELOCITY_DEVIATIONS * deviation;
            low = low.max(velocities[index] - half);
            high = high.min(velocities[index] + half);
            if high < low {
                break;
            }
            agreeing = (velocities[index], *deviation);
        }
        agreeing
    };
    (0..count).map(of_sample).unzip()
}

/// Mean sign of each velocity over the period of its sample, in which it changes by half of the difference of its
/// neighbours.
fn mean_sign(velocity: &[f64]) -> Vec<f64> {
    let last = velocity.len().saturating_sub(1);
    let of_sample = |k: usize| {
        let change = 0.5 * (velocity[(k + 1).min(last)] - velocity[k.saturating_sub(1)]);
        if 2.0 * velocity[k].abs() < change.abs() {
            2.0 * velocity[k] / change.abs()
        } else {
            sign(velocity[k])
        }
    };
    (0..velocity.len()).map(of_sample).collect()
}

/// Standard deviation of the white noise of a measured signal, from its sixth differences, and at
/// least that of its quantization. Sixth differences hardly show motion: a wave of eight samples
/// counts as a fiftieth of noise of its magnitude.
fn white_noise(segments: &[Range<usize>], signal: &[f64]) -> f64 {
    let own = || segments.iter().map(|own| &signal[own.clone()]);
    let white = sixth_difference_noise(segments, signal, 1);
    let steps = own().flat_map(|values| values.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
    let quantum = steps.filter(|step| 0.0 < *step).fold(f64::INFINITY, f64::min);
    let largest = own().flatten().fold(0.0_f64, |largest, value| largest.max(value.abs()));
    let least = white.max(ROUNDING * largest);
    if quantum.is_finite() { least.max(quantum / 12.0_f64.sqrt()) } else { least }
}

/// Standard deviation of the white noise of `signal` from sixth differences of samples that are `stride` apart.
fn sixth_difference_noise(segments: &[Range<usize>], signal: &[f64], stride: usize) -> f64 {
    let values = segments.iter().map(|own| &signal[own.clone()]);
    let sixth = values.flat_map(|values| {
        values.windows(6 * stride + 1).map(|window| {
            window
                .iter()
                .step_by(stride)
                .zip(SIXTH)
                .map(|(value, weight)| value * weight)
                .sum::<f64>()
        })
    });
    noise_of(sixth) / SIXTH.iter().map(|weight| weight * weight).sum::<f64>().sqrt()
}

/// Weights of a sixth difference.
const SIXTH: [f64; 7] = [1.0, -6.0, 15.0, -20.0, 15.0, -6.0, 1.0];

/// Standard deviation of normal values from their median magnitude.
fn noise_of(values: impl Iterator<Item = f64>) -> f64 {
    let mut magnitudes: Vec<f64> = values.map(f64::abs).collect();
    magnitudes.sort_by(f64::total_cmp);
    magnitudes.get(magnitudes.len() / 2).copied().unwrap_or(0.0) / 0.6745
}

/// Sign of a velocity, zero at rest.
pub(super) fn sign(velocity: f64) -> f64 {
    if velocity == 0.0 { 0.0 } else { velocity.signum() }
}

/// Samples of rests: stretches of at least [`REST`] samples without a velocity beyond the noise.
fn rests(velocity: &[f64], noise: f64) -> Vec<bool> {
    let mut resting = vec![false; velocity.len()];
    let still = |index: usize| velocity[index].abs() <= VELOCITY_DEVIATIONS * noise;
    let mut begin = 0;
    for index in 0..=velocity.len() {
        if index < velocity.len() && still(index) {
            continue;
        }
        if begin + REST <= index {
            resting[begin..index].fill(true);
        }
        begin = index + 1;
    }
    resting
}

#[cfg(test)]
mod tests;
