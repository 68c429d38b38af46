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

    /// The stage of `measured`, cut into the runs `spans` (s since the session began).
    pub(super) fn new(measured: Measured, spans: &[Range<f64>]) -> Self {
        let Measured { name, unit, start, dt, input: raw_input, position: raw } = measured;
        let cutoff = (CUTOFF_HZ * dt).min(CUTOFF_SHARE);
        let low_pass = LowPass::butterworth(cutoff);
        let factor = ((1.0 / cutoff).round() as usize).max(1);
        let position = low_pass.apply(&raw);
        let velocity = derivative(&position, dt);
        let acceleration = derivative(&velocity, dt);
        let resting = rests(&velocity, velocity_noise(&raw, &position, cutoff, dt), dt);
        let mut stage = Self {
            start,
            dt,
            factor,
            decimation: LowPass::before_decimation(factor),
            input: low_pass.apply(&raw_input),
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

    /// `values` of all samples as they are compared: filtered and decimated.
    fn compared(&self, values: &[f64]) -> Vec<f64> {
        let smooth = self.decimation.apply(values);
        self.kept().map(|index| smooth[index]).collect()
    }

    /// Edge of the filters for position and input (Hz).
    #[must_use]
    pub fn cutoff_hz(&self) -> f64 {
        1.0 / (self.dt * self.factor as f64)
    }

    /// How far it went towards positive and towards negative positions (m), rests aside.
    #[must_use]
    pub fn ways(&self) -> [f64; 2] {
        let moving = self.velocity.iter().zip(&self.resting).filter(|(_, rests)| !**rests);
        let steps = moving.map(|(velocity, _)| velocity * self.dt);
        steps.fold([0.0; 2], |[up, down], step| [up + step.max(0.0), down + (-step).max(0.0)])
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
            if index == 0 {
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
            inputs = shifted(&inputs, chain.delay / self.dt);
        }
        if let Some(values) = predicted.first_mut() {
            *values = self.compared(&inputs);
        }
    }
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

/// Standard deviation of the velocity's noise: the position's, from what the filter removed of it,
/// taken as white.
fn velocity_noise(raw: &[f64], smooth: &[f64], cutoff: f64, dt: f64) -> f64 {
    let mut removed: Vec<f64> = raw.iter().zip(smooth).map(|(a, b)| (a - b).abs()).collect();
    removed.sort_by(f64::total_cmp);
    let spread = removed.get(removed.len() / 2).copied().unwrap_or(0.0) / 0.6745;
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
