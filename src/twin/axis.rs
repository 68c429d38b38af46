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
pub(super) use load::{INPUT_UNITS, POSITION_UNITS, resampled, unit_of};

use super::{Channel, Stage, StageKind, Twin, axis_frame::MotionSums};
use crate::effects::{Domain, Effect, Motion, Physics, Regressor};
use chain::Chain;
use filter::{LowPass, derivative};
use std::{f64::consts::TAU, ops::Range};

/// Edges of the low-pass filter for position and input that are tried, in cycles per sample, the widest first.
const EDGES: [f64; 7] = [0.1, 0.07, 0.05, 0.035, 0.025, 0.0175, 0.0125];
/// Standard deviation of the acceleration's noise over the RMS of the acceleration, up to which an edge is taken: noise
/// of a regressor biases its coefficient by the square of this ratio.
const ACCELERATION_NOISE: f64 = 0.1;
/// Compared samples left out at both ends, where the filters know one side only.
const ENDS: usize = 5;
/// Compared samples of a block over which errors count as dependent: twice the memory of the noise model.
const BLOCK: usize = 25;
/// Standard deviations of its noise within which a velocity counts as rest.
const REST_DEVIATIONS: f64 = 3.0;
/// Least duration of a rest (samples): a reversal that does not stick passes through zero faster.
const REST: usize = 10;

/// What was measured on one axis, at equal steps.
#[derive(Debug, Clone)]
pub(super) struct Measured {
    /// Name of the axis in its topics.
    pub name: String,
    /// Unit of the input.
    pub unit: &'static str,
    /// Unit of the position.
    pub position_unit: &'static str,
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
    position_unit: &'static str,
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
        let Measured { name, unit, position_unit, start, dt, input: raw_input, position: raw } =
            measured;
        let noise = position_noise(&segments, &raw);
        let cutoff = edge(&segments, &raw, noise);
        let low_pass = LowPass::butterworth(cutoff);
        let factor = ((1.0 / cutoff).round() as usize).max(1);
        let filtered = |values: &[f64]| each_segment(&segments, values, |own| low_pass.apply(own));
        let slope = |values: &[f64]| each_segment(&segments, values, |own| derivative(own, dt));
        let position = filtered(&raw);
        let velocity = slope(&position);
        let acceleration = slope(&velocity);
        let resting = resting(&segments, &velocity, velocity_noise(noise, cutoff, dt));
        let input = filtered(&raw_input);
        let mut stage = Self {
            start,
            dt,
            position_unit,
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

    /// Units of input and position.
    #[must_use]
    pub fn units(&self) -> (&'static str, &'static str) {
        (self.channels[0].unit, self.position_unit)
    }

    /// Sums over the recorded samples, from which the typical sizes of the axis follow.
    pub(super) fn motion_sums(&self) -> MotionSums {
        let inside = || self.segments.iter().flat_map(Clone::clone);
        let moving = || inside().filter(|index| !self.resting[*index]);
        let square = |values: &[f64]| moving().map(|index| values[index].powi(2)).sum();
        let positions = inside().map(|index| self.position[index]);
        let (low, high) = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), own| {
            (low.min(own), high.max(own))
        });
        MotionSums {
            positions: low..high,
            squares: [square(&self.input), square(&self.velocity), square(&self.acceleration)],
            count: moving().count() as f64,
            sample_period: self.dt,
            duration: self.dt * self.position.len() as f64,
        }
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

    /// When the segment of a sample began (s).
    fn run_start_time(&self, index: usize) -> f64 {
        let begins = self.segments.partition_point(|own| own.start <= index);
        begins.checked_sub(1).map_or(0.0, |own| self.time(self.segments[own].start))
    }

    /// The measured motion at one sample, with the position from `origin`; `force` is the input as it was measured.
    fn motion(&self, index: usize, origin: f64) -> Motion {
        Motion {
            time: self.time(index),
            run_start_time: self.run_start_time(index),
            dt: self.dt,
            position: self.position[index] - origin,
            position_origin: origin,
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
            let mut motion = self.motion(index, chain.origin);
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

    fn block_seconds(&self) -> f64 {
        BLOCK as f64 * self.factor as f64 * self.dt
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

/// Samples at rest, with `noise` of the velocity; all samples outside of `segments` are.
fn resting(segments: &[Range<usize>], velocity: &[f64], noise: f64) -> Vec<bool> {
    let mut resting = vec![true; velocity.len()];
    for own in segments {
        resting[own.clone()].copy_from_slice(&rests(&velocity[own.clone()], noise));
    }
    resting
}

/// The widest edge at which the acceleration of `position` is measured above its `noise`, in cycles per sample; the
/// narrowest where there is none.
fn edge(segments: &[Range<usize>], position: &[f64], noise: f64) -> f64 {
    let is_measured = |edge: &f64| {
        let low_pass = LowPass::butterworth(*edge);
        let second = each_segment(segments, position, |own| {
            derivative(&derivative(&low_pass.apply(own), 1.0), 1.0)
        });
        let inside = segments.iter().map(|own| own.len()).sum::<usize>().max(1) as f64;
        let rms = (second.iter().map(|value| value * value).sum::<f64>() / inside).sqrt();
        // White noise below the edge, differentiated twice: 2 times the integral of (2 pi f)^4.
        let of_noise = noise * TAU * TAU * (2.0 * edge.powi(5) / 5.0).sqrt();
        of_noise <= ACCELERATION_NOISE * rms
    };
    let narrowest = EDGES[EDGES.len() - 1];
    EDGES.into_iter().find(is_measured).unwrap_or(narrowest)
}

/// Standard deviation of the white noise of a position: from its sixth differences, which hardly show motion (a wave of
/// eight samples counts as a fiftieth of noise of its size), and at least that of its quantization.
fn position_noise(segments: &[Range<usize>], position: &[f64]) -> f64 {
    let own = || segments.iter().map(|own| &position[own.clone()]);
    let sixth = own().flat_map(|values| {
        values
            .windows(7)
            .map(|seven| seven.iter().zip(SIXTH).map(|(value, weight)| value * weight).sum::<f64>())
    });
    let white = noise_of(sixth) / SIXTH.iter().map(|weight| weight * weight).sum::<f64>().sqrt();
    let steps = own().flat_map(|values| values.windows(2).map(|pair| (pair[1] - pair[0]).abs()));
    let quantum = steps.filter(|step| 0.0 < *step).fold(f64::INFINITY, f64::min);
    if quantum.is_finite() { white.max(quantum / 12.0_f64.sqrt()) } else { white }
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

/// Standard deviation of the velocity (per second) for white noise of the position of standard deviation `noise`.
fn velocity_noise(noise: f64, cutoff: f64, dt: f64) -> f64 {
    noise * TAU * (2.0 * cutoff.powi(3) / 3.0).sqrt() / dt
}

/// Samples of rests: stretches of at least [`REST`] samples without a velocity beyond the noise.
fn rests(velocity: &[f64], noise: f64) -> Vec<bool> {
    let mut resting = vec![false; velocity.len()];
    let still = |index: usize| velocity[index].abs() <= REST_DEVIATIONS * noise;
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
