//! A single axis driven by force: its measured motion to the input that it took.
//!
//! The input follows from the measured motion by inverse dynamics, u = chain^-1(M a - F +
//! friction), because the position of a controlled axis hardly shows its friction. Position is
//! low-pass filtered without phase and differentiated centrally; measured and predicted input pass
//! one more filter of that kind and are decimated (Gautier and Janot's procedure for robots, as in
//! the EMPS benchmark). All physics comes from the twin's instances by its place; motor and rail
//! are one coordinate here.
//!
//! At rest friction takes any value within its level, so there the input is predicted as near to
//! the measured one as friction allows, and those samples are not compared.

mod chain;
mod filter;
mod forward;
mod load;

pub use forward::FreeRun;
pub(super) use forward::respond;
pub use load::AxisError;
pub(super) use load::{resampled, unit_of};

use super::{Channel, Stage, StageKind, Twin};
use crate::effects::{Domain, Effect, Motion, Physics, Regressor};
use chain::Chain;
use filter::{LowPass, derivative};
use std::{f64::consts::TAU, ops::Range};

/// Edge of the low-pass filter for position and input (Hz), where the samples allow.
const CUTOFF_HZ: f64 = 100.0;
/// Its edge at most, in cycles per sample.
const CUTOFF_SHARE: f64 = 0.1;
/// Compared samples left out at both ends, where the filters know one side only.
const ENDS: usize = 5;
/// Standard deviations of its noise within which a velocity counts as rest.
const REST_DEVIATIONS: f64 = 3.0;
/// Least duration of a rest (s): a reversal that does not stick passes through zero faster.
const REST_S: f64 = 0.01;
/// Fraction of moving samples below which the noise estimate is checked against the range of the position.
const LEAST_MOVING: f64 = 0.02;
/// Range of the position, in standard deviations of its noise, that is motion and no noise.
const MOTION_DEVIATIONS: f64 = 30.0;

/// What was measured on one axis, at equal steps.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Name of the axis in its topics.
    pub name: String,
    /// Unit of the input.
    pub unit: &'static str,
    /// Time of the first sample since the session began (s).
    pub start: f64,
    /// Step (s).
    pub dt: f64,
    /// Input, in its unit.
    pub input: Vec<f64>,
    /// Position (m or rad).
    pub position: Vec<f64>,
}

/// One force-driven axis of one session: motion in, input out.
#[derive(Debug, Clone)]
pub struct AxisStage {
    start: f64,
    dt: f64,
    factor: usize,
    decimation: LowPass,
    /// Samples that were recorded without interruption: no filter crosses their borders.
    segments: Vec<Range<usize>>,
    /// Input as recorded, and behind the first filter.
    raw_input: Vec<f64>,
    input: Vec<f64>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    acceleration: Vec<f64>,
    resting: Vec<bool>,
    channels: Vec<Channel>,
}

impl AxisStage {
    /// Measured signals, to exclude samples.
    pub(super) fn channels_mut(&mut self) -> &mut [Channel] {
        &mut self.channels
    }

    /// The stage of `measured`, recorded without interruption, cut into the runs `spans` (s since the session began).
    #[cfg(test)]
    pub(super) fn new(measured: Measured, spans: &[Range<f64>]) -> Self {
        let whole = 0..measured.position.len();
        Self::in_segments(measured, vec![whole], spans)
    }

    /// The stage of `measured`, of which each of `segments` was recorded without interruption, cut into the runs
    /// `spans` (s since the session began).
    pub(super) fn in_segments(
        measured: Measured,
        segments: Vec<Range<usize>>,
        spans: &[Range<f64>],
    ) -> Self {
        let Measured { name, unit, start, dt, input: raw_input, position: raw } = measured;
        let cutoff = (CUTOFF_HZ * dt).min(CUTOFF_SHARE);
        let low_pass = LowPass::butterworth(cutoff);
        let factor = ((1.0 / cutoff).round() as usize).max(1);
        let filtered = |values: &[f64]| each_segment(&segments, values, |own| low_pass.apply(own));
        let slope = |values: &[f64]| each_segment(&segments, values, |own| derivative(own, dt));
        let position = filtered(&raw);
        let velocity = slope(&position);
        let acceleration = slope(&velocity);
        let resting = resting(&segments, (&raw, &position, &velocity), cutoff, dt);
        let input = filtered(&raw_input);
        let mut stage = Self {
            start,
            dt,
            factor,
            decimation: LowPass::before_decimation(factor),
            segments,
            input,
            raw_input,
            position,
            velocity,
            acceleration,
            resting,
            channels: Vec::new(),
        };
        stage.channels.push(stage.channel(&name, unit, spans));
        stage
    }

    fn channel(&self, name: &str, unit: &'static str, spans: &[Range<f64>]) -> Channel {
        let mut measured = self.compared(&self.raw_input);
        for (value, index) in measured.iter_mut().zip(self.kept()) {
            if !self.is_inside(index) {
                *value = f64::NAN;
                continue;
            }
            let beside = index.saturating_sub(self.factor)
                ..(index + self.factor + 1).min(self.resting.len());
            if self.resting[beside].iter().any(|rests| *rests) {
                *value = f64::NAN;
            }
        }
        let times: Vec<f64> = self.kept().map(|index| self.time(index)).collect();
        let runs = spans
            .iter()
            .map(|span| {
                let first = times.partition_point(|time| *time < span.start);
                first..times.partition_point(|time| *time < span.end).max(first)
            })
            .filter(|run| !run.is_empty())
            .collect();
        Channel {
            signal: format!("axis.{name}.force"),
            unit,
            domain: Domain::Drive,
            axis: "q",
            rate_hz: 1.0 / (self.dt * self.factor as f64),
            times,
            measured,
            runs,
        }
    }

    fn time(&self, index: usize) -> f64 {
        self.start + self.dt * index as f64
    }

    /// Indices of the compared samples.
    fn kept(&self) -> impl Iterator<Item = usize> + use<> {
        let count = self.position.len().div_ceil(self.factor);
        let factor = self.factor;
        (ENDS..count.saturating_sub(ENDS)).map(move |index| index * factor)
    }

    /// Return whether the filters know both sides of the sample `index`.
    fn is_inside(&self, index: usize) -> bool {
        let margin = ENDS * self.factor;
        self.segments.iter().any(|own| own.start + margin <= index && index + margin < own.end)
    }

    /// `values` of all samples as they are compared: filtered and decimated.
    fn compared(&self, values: &[f64]) -> Vec<f64> {
        let smooth = each_segment(&self.segments, values, |own| self.decimation.apply(own));
        self.kept().map(|index| smooth[index]).collect()
    }

    /// Edge of the filters for position and input (Hz).
    #[must_use]
    pub fn cutoff_hz(&self) -> f64 {
        1.0 / (self.dt * self.factor as f64)
    }

    /// Distance that the axis moved towards positive and towards negative positions (m), rests aside.
    #[must_use]
    pub fn ways(&self) -> [f64; 2] {
        let moving = self.velocity.iter().zip(&self.resting).filter(|(_, rests)| !**rests);
        let steps = moving.map(|(velocity, _)| velocity * self.dt);
        steps.fold([0.0; 2], |[up, down], step| [up + step.max(0.0), down + (-step).max(0.0)])
    }

    /// Input of the compared samples with the motion behind it: input, acceleration, velocity, direction, position.
    #[must_use]
    pub fn motion_and_input(&self) -> Vec<[f64; 5]> {
        let direction: Vec<f64> = self.velocity.iter().map(|velocity| sign(*velocity)).collect();
        let columns = [&self.acceleration, &self.velocity, &direction, &self.position]
            .map(|own| self.compared(own));
        let channel = &self.channels[0];
        let samples = channel.runs.iter().flat_map(Clone::clone);
        samples
            .filter(|k| channel.measured[*k].is_finite())
            .map(|k| {
                let [a, v, s, q] = &columns;
                [channel.measured[k], a[k], v[k], s[k], q[k]]
            })
            .collect()
    }

    /// Variation of the input within the runs and its mean square, each summed over the samples of the runs.
    #[must_use]
    pub fn input_variation(&self) -> [f64; 2] {
        let channel = &self.channels[0];
        let (mut within, mut square) = (0.0, 0.0);
        for run in &channel.runs {
            let from = self.kept().nth(run.start);
            let to = self.kept().nth(run.end.saturating_sub(1));
            let (Some(from), Some(to)) = (from, to) else { continue };
            let values = &self.raw_input[from..=to];
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            within += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
            square += values.iter().map(|value| value * value).sum::<f64>();
        }
        [within, square]
    }

    /// The measured motion at one sample; `force` is the input as it was measured.
    fn motion(&self, index: usize) -> Motion {
        Motion {
            time: self.time(index),
            dt: self.dt,
            position: self.position[index],
            velocity: self.velocity[index],
            acceleration: self.acceleration[index],
            force: self.input[index],
            ..Motion::default()
        }
    }

    /// The input of every sample that the twin needs for the measured motion.
    fn inverse(&self, chain: &Chain) -> Vec<f64> {
        let mut memory = chain.memory();
        let mut inputs = Vec::with_capacity(self.position.len());
        for index in 0..self.position.len() {
            let begins = index == 0 || self.segments.iter().any(|own| own.start == index);
            let mut motion = self.motion(index);
            motion.mass = chain.mass(&motion);
            let (forces, level) = chain.loads(&mut memory, &motion);
            let frictionless = motion.mass * motion.acceleration - forces;
            let friction = if self.resting[index] {
                let level = level.max(0.0);
                (motion.force - frictionless).clamp(-level, level)
            } else {
                level * sign(motion.velocity)
            };
            let force = frictionless + friction;
            if begins {
                chain.settle(&mut memory, force, &motion);
            }
            inputs.push(chain.input(&mut memory, force, motion.force, &motion));
        }
        inputs
    }
}

impl Stage for AxisStage {
    fn kind(&self) -> StageKind {
        StageKind::Axis
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, effect: &Effect) -> bool {
        // A limit under load cannot be inverted: every measured force would be its own prediction.
        let limit = matches!(effect.physics, Physics::Effort(_))
            && effect.regressors.contains(&Regressor::Load);
        !limit && Chain::calls(&effect.physics)
    }

    fn regressor(&self, regressor: Regressor) -> Option<Vec<f64>> {
        let at = |values: &[f64]| Some(self.kept().map(|index| values[index]).collect());
        let each = |value: &dyn Fn(usize) -> f64| Some(self.kept().map(value).collect());
        match regressor {
            Regressor::Constant => each(&|_| 1.0),
            Regressor::Position | Regressor::Phase => at(&self.position),
            Regressor::Velocity => at(&self.velocity),
            Regressor::Direction => each(&|index| self.velocity[index].signum()),
            Regressor::Speed => each(&|index| self.velocity[index].abs()),
            Regressor::Acceleration => at(&self.acceleration),
            Regressor::Jerk => at(&derivative(&self.acceleration, self.dt)),
            Regressor::Load => each(&|index| self.input[index].abs()),
            Regressor::Command => at(&self.input),
            Regressor::SinceReversal => at(&since_reversal(&self.velocity, self.dt)),
            Regressor::Time => each(&|index| self.time(index)),
            Regressor::OtherAxis | Regressor::ImpactSpeed => None,
        }
    }

    fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let chain = Chain::new(twin);
        let mut inputs = self.inverse(&chain);
        if chain.delay != 0.0 {
            let samples = chain.delay / self.dt;
            inputs = each_segment(&self.segments, &inputs, |own| shifted(own, samples));
        }
        if let Some(values) = predicted.first_mut() {
            *values = self.compared(&inputs);
        }
    }
}

/// `change` of `values` in each of `segments` by itself; zero outside of them.
fn each_segment(
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

/// Samples at rest; all samples outside of `segments` are. Where the filter takes the motion for noise, since samples are
/// too few for it, and nearly everything would be rest, third differences of the position give the noise.
fn resting(
    segments: &[Range<usize>],
    (raw, position, velocity): (&[f64], &[f64], &[f64]),
    cutoff: f64,
    dt: f64,
) -> Vec<bool> {
    let inside = |values: &[f64]| -> Vec<f64> {
        segments.iter().flat_map(|own| values[own.clone()].iter().copied()).collect()
    };
    let of = |noise: f64| {
        let mut resting = vec![true; velocity.len()];
        for own in segments {
            let rests = rests(&velocity[own.clone()], noise, dt);
            resting[own.clone()].copy_from_slice(&rests);
        }
        resting
    };
    let spread = noise_of(inside(raw).iter().zip(inside(position)).map(|(a, b)| a - b));
    let found = of(velocity_noise(spread, cutoff, dt));
    let moving = found.iter().filter(|rests| !**rests).count() as f64;
    let thirds = segments.iter().flat_map(|own| {
        raw[own.clone()].windows(4).map(|four| four[3] - 3.0 * (four[2] - four[1]) - four[0])
    });
    let smooth = noise_of(thirds) / THIRD_DIFFERENCE;
    let all = inside(raw);
    let range = all.iter().copied().fold(f64::NEG_INFINITY, f64::max)
        - all.iter().copied().fold(f64::INFINITY, f64::min);
    let is_motion =
        moving < LEAST_MOVING * inside(velocity).len() as f64 && MOTION_DEVIATIONS * smooth < range;
    if is_motion { of(velocity_noise(smooth, cutoff, dt)) } else { found }
}

/// Factor by which third differences enlarge the standard deviation of white noise: the root of 1 + 9 + 9 + 1.
const THIRD_DIFFERENCE: f64 = 4.472_135_954_999_58;

/// Standard deviation of normal values from their median magnitude.
fn noise_of(values: impl Iterator<Item = f64>) -> f64 {
    let mut magnitudes: Vec<f64> = values.map(f64::abs).collect();
    magnitudes.sort_by(f64::total_cmp);
    magnitudes.get(magnitudes.len() / 2).copied().unwrap_or(0.0) / 0.6745
}

/// Sign of a velocity, zero at rest.
fn sign(velocity: f64) -> f64 {
    if velocity == 0.0 { 0.0 } else { velocity.signum() }
}

/// `values` read `samples` later, by the cubic through the four beside each place (Catmull-Rom),
/// held still beyond the ends.
fn shifted(values: &[f64], samples: f64) -> Vec<f64> {
    let last = values.len().saturating_sub(1) as f64;
    let at = |index: f64| values[index.clamp(0.0, last) as usize];
    (0..values.len())
        .map(|index| {
            let place = index as f64 + samples;
            let (floor, s) = (place.floor(), place - place.floor());
            let [a, b, c, d] = [-1.0, 0.0, 1.0, 2.0].map(|offset| at(floor + offset));
            b + 0.5
                * s
                * (c - a + s * (2.0 * a - 5.0 * b + 4.0 * c - d + s * (3.0 * (b - c) + d - a)))
        })
        .collect()
}

/// Standard deviation of the velocity's noise for white noise of the position of which the filter removes the standard
/// deviation `spread`.
fn velocity_noise(spread: f64, cutoff: f64, dt: f64) -> f64 {
    let passed = spread * (cutoff / (0.5 - cutoff)).sqrt();
    passed * TAU * cutoff / dt / 3.0_f64.sqrt()
}

/// Samples of rests: stretches of at least [`REST_S`] without a velocity beyond the noise.
fn rests(velocity: &[f64], noise: f64, dt: f64) -> Vec<bool> {
    let mut resting = vec![false; velocity.len()];
    let still = |index: usize| velocity[index].abs() <= REST_DEVIATIONS * noise;
    let mut begin = 0;
    for index in 0..=velocity.len() {
        if index < velocity.len() && still(index) {
            continue;
        }
        if REST_S <= (index - begin) as f64 * dt {
            resting[begin..index].fill(true);
        }
        begin = index + 1;
    }
    resting
}

/// Time since the velocity last changed its sign (s).
fn since_reversal(velocity: &[f64], dt: f64) -> Vec<f64> {
    let mut since = 0.0;
    let mut before = 0.0;
    velocity
        .iter()
        .map(|velocity| {
            since = if velocity * before < 0.0 { 0.0 } else { since + dt };
            before = *velocity;
            since
        })
        .collect()
}

#[cfg(test)]
mod tests;
