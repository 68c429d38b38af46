//! Inverse dynamics of a single axis, driven by a force or a velocity setpoint: its input from its
//! measured motion.
//!
//! The input follows from the measured motion by inverse dynamics, u = chain^-1(M a - F +
//! friction), because the position of a controlled axis hardly shows its friction. A velocity
//! setpoint is u = chain^-1(v + controller^-1(T a - F + friction)). A velocity controller makes a
//! force from the velocity error, so forces are in the unit of the setpoint, and the mass is a time
//! constant T. The position passes a zero-phase low-pass filter and is differentiated centrally.
//! Measured and predicted input pass one more filter of that kind and are decimated (Gautier and
//! Janot's procedure for robots, as in the EMPS benchmark). All physics comes from the twin's
//! instances, by their position in the chain. Motor and guide are one coordinate here.
//!
//! While the axis stands, rigid friction takes any value within its level. The input predicted
//! there is as near to the measured one as friction allows. The friction of elastic contacts
//! follows from their deflection, except in longer rests, which are not compared. An axis stands
//! where its velocity near a reversal does not differ from zero beyond its noise.

mod chain;
mod filter;
mod forward;
mod load;
mod signals;

pub use forward::FreeRun;
pub(super) use forward::respond;
pub use load::AxisError;
pub(super) use load::{INPUT_UNITS, POSITION_UNITS, position_unit, resampled, unit_of};

use super::{Channel, Stage, StageKind, Twin, axis_frame::MotionSums};
use crate::effects::{Axis, Domain, Effect, InputKind, Motion, Physics, Regressor, Resonance};
use chain::Chain;
use filter::{Decimation, derivative};
use signals::{Signals, each_segment};
use std::ops::Range;

/// Compared samples left out at the end of a segment, where the filters know one side only.
const LAST: usize = 5;
/// Those left out at its start, where the state of the machine is unknown too. The decimation then responds to an impulse
/// before them with less than 1 % of its peak.
const FIRST: usize = 17;
/// Compared samples of a block over which errors count as dependent: twice the longest memory of the noise model.
const BLOCK: usize = 25;
/// Least determinant of the normal equations of a load's start, relative to their diagonal: below it, the responses to
/// both states are the same.
const LEAST_DETERMINANT: f64 = 1e-9;
/// Effect of an amplifier that ignores small inputs.
const DEAD_BAND: &str = "drive.input_deadband";
/// Unit of a voltage, the only force with a dead band and a back-EMF: the current loop of other amplifiers removes both.
const VOLT: &str = "V";
/// Effect of an angle.
const GRAVITY: &str = "gantry.gravity";

/// Measurements of one axis, at equal steps.
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
    /// Velocity, per second, where the position is its integral.
    pub velocity: Option<Vec<f64>>,
}

/// One force-driven axis of one session: motion in, input out.
#[derive(Debug, Clone)]
pub struct AxisStage {
    start: f64,
    dt: f64,
    position_unit: &'static str,
    input_kind: InputKind,
    factor: usize,
    decimation: Decimation,
    /// Samples that were recorded without interruption: no filter crosses their borders.
    segments: Vec<Range<usize>>,
    /// Input as recorded.
    raw_input: Vec<f64>,
    signals: Signals,
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
        let Measured { name, unit, position_unit, start, dt, input: raw_input, position, velocity } =
            measured;
        let signals = Signals::of(&segments, &raw_input, (&position, velocity.as_deref()), dt);
        let factor = ((1.0 / signals.cutoff).round() as usize).max(1);
        let mut stage = Self {
            start,
            dt,
            position_unit,
            input_kind: InputKind::of(unit, position_unit),
            factor,
            decimation: Decimation::before_decimation(factor),
            segments,
            raw_input,
            signals,
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
                ..(index + self.factor + 1).min(self.signals.resting.len());
            if self.signals.resting[beside].iter().any(|rests| *rests) {
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
        let quantity = match self.input_kind {
            InputKind::Force => "force",
            InputKind::Velocity => "setpoint",
        };
        Channel {
            signal: format!("axis.{name}.{quantity}"),
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
        let count = self.signals.position.len().div_ceil(self.factor);
        let factor = self.factor;
        (FIRST..count.saturating_sub(LAST)).map(move |index| index * factor)
    }

    /// Return whether the filters know both sides of the sample `index`.
    fn is_inside(&self, index: usize) -> bool {
        let [first, last] = [FIRST, LAST].map(|samples| samples * self.factor);
        self.segments.iter().any(|own| own.start + first <= index && index + last < own.end)
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

    /// Distance that the axis moved towards positive and towards negative positions (m), without
    /// rests.
    #[must_use]
    pub fn ways(&self) -> [f64; 2] {
        let moving =
            self.signals.velocity.iter().zip(&self.signals.resting).filter(|(_, rests)| !**rests);
        let steps = moving.map(|(velocity, _)| velocity * self.dt);
        steps.fold([0.0; 2], |[up, down], step| [up + step.max(0.0), down + (-step).max(0.0)])
    }

    /// Quantity that the input sets.
    #[must_use]
    pub fn input_kind(&self) -> InputKind {
        self.input_kind
    }

    /// Units of input and position.
    #[must_use]
    pub fn units(&self) -> (&'static str, &'static str) {
        (self.channels[0].unit, self.position_unit)
    }

    /// Sums over the recorded samples, from which the typical magnitudes of the axis follow.
    pub(super) fn motion_sums(&self) -> MotionSums {
        let inside = || self.segments.iter().flat_map(Clone::clone);
        let moving = || inside().filter(|index| !self.signals.resting[*index]);
        let square = |values: &[f64]| moving().map(|index| values[index].powi(2)).sum();
        let positions = inside().map(|index| self.signals.position[index]);
        let (low, high) = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), own| {
            (low.min(own), high.max(own))
        });
        MotionSums {
            positions: low..high,
            squares: [
                square(&self.signals.input),
                square(&self.signals.velocity),
                square(&self.signals.acceleration),
            ],
            count: moving().count() as f64,
            sample_period: self.dt,
            band: Decimation::decimation_edge(self.factor) / self.dt,
            duration: self.dt * self.signals.position.len() as f64,
        }
    }

    /// Input of the compared samples with the motion behind it: input, acceleration, velocity, direction, position.
    #[must_use]
    pub fn motion_and_input(&self) -> Vec<[f64; 5]> {
        let columns = [
            &self.signals.acceleration,
            &self.signals.velocity,
            &self.signals.direction,
            &self.signals.position,
        ]
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

    /// Start time of the segment of a sample (s).
    fn run_start_time(&self, index: usize) -> f64 {
        let begins = self.segments.partition_point(|own| own.start <= index);
        begins.checked_sub(1).map_or(0.0, |own| self.time(self.segments[own].start))
    }

    /// Measured motion at one sample, with the position from `origin`; `force` is the measured
    /// input.
    fn motion(&self, index: usize, origin: f64) -> Motion {
        Motion {
            time: self.time(index),
            run_start_time: self.run_start_time(index),
            dt: self.dt,
            position: self.signals.position[index] - origin,
            position_origin: origin,
            velocity: self.signals.velocity[index],
            acceleration: self.signals.acceleration[index],
            force: self.signals.input[index],
            ..Motion::default()
        }
    }

    /// `values` of all samples, read `delay` seconds later within each segment.
    fn shifted_in_segments(&self, values: &[f64], delay: f64) -> Vec<f64> {
        if delay == 0.0 {
            return values.to_vec();
        }
        each_segment(&self.segments, values, |own| shifted(own, delay / self.dt))
    }

    /// `values` of all samples that `pass` the resonance of `chain`, each segment by itself.
    fn through_resonance(
        &self,
        chain: &Chain,
        values: Vec<f64>,
        pass: fn(&Resonance, &[f64], f64) -> Vec<f64>,
    ) -> Vec<f64> {
        match &chain.resonance {
            Some(own) => each_segment(&self.segments, &values, |values| pass(own, values, self.dt)),
            None => values,
        }
    }

    /// The input of every sample that the twin needs for the measured motion, on the load side of a resonance. Each segment
    /// begins with an elastic load that follows the motor, but for the `difference` of its position and velocity.
    fn inverse(&self, chain: &Chain, difference: [f64; 2]) -> Vec<f64> {
        let mut memory = chain.memory();
        // The measured input, when it acts.
        let acting = self.shifted_in_segments(&self.signals.inner_input, -chain.delay);
        let acting = self.through_resonance(chain, acting, Resonance::forwards);
        let mut starts = self.segments.iter().map(|own| own.start).peekable();
        let mut inputs = Vec::with_capacity(self.signals.position.len());
        for (index, input) in acting.into_iter().enumerate() {
            let begins = starts.next_if_eq(&index).is_some() || index == 0;
            let mut motion = self.motion(index, chain.origin);
            motion.acceleration = self.signals.inner_acceleration[index];
            motion.force = input;
            motion.mass = chain.mass(&motion);
            if begins {
                memory = chain.memory();
                chain.settle_input(&mut memory, motion.force, &motion);
                chain.start_load(&mut memory, difference, &motion);
            }
            let loads = chain.loads(&mut memory, &motion);
            let frictionless = loads.mass * motion.acceleration - loads.forces;
            let missing = || {
                let given = chain.given(&memory, motion.force, &motion);
                chain.force_of(&memory, given, &motion) - frictionless
            };
            let friction = if self.signals.resting[index] {
                within(missing(), 0.0, loads.rigid + loads.elastic)
            } else if self.signals.standing[index] {
                within(missing(), loads.contacts, loads.rigid)
            } else {
                loads.contacts + loads.rigid * self.signals.direction[index]
            };
            let force = frictionless + friction;
            if begins {
                chain.settle(&mut memory, force, &motion);
            }
            let demand = chain.demand(&mut memory, force, &motion);
            inputs.push(chain.input(&mut memory, demand, motion.force, &motion));
        }
        inputs
    }

    /// Prediction of the compared samples.
    fn predicted(&self, twin: &Twin) -> Vec<f64> {
        let chain = Chain::new(twin);
        let of_start = |difference| {
            let inputs = self.shifted_in_segments(&self.inverse(&chain, difference), chain.delay);
            self.compared(&self.through_resonance(&chain, inputs, Resonance::backwards))
        };
        let following = of_start([0.0; 2]);
        match self.load_displacement(&chain) {
            None => following,
            Some([position, velocity]) => {
                let displaced = [[position, 0.0], [0.0, velocity]].map(of_start);
                self.with_fitted_starts(following, &displaced)
            }
        }
    }

    /// Typical displacement of an elastic load from the motor, and its velocity; `None` for a rigid axis.
    fn load_displacement(&self, chain: &Chain) -> Option<[f64; 2]> {
        let rate = chain.moving_load()?.angular_frequency;
        let squares = self.signals.acceleration.iter().map(|value| value * value);
        let rms = (squares.sum::<f64>() / self.signals.acceleration.len() as f64).sqrt();
        Some([rms / (rate * rate), rms / rate]).filter(|own| own.iter().all(|own| 0.0 < *own))
    }

    /// Prediction with an elastic load in the state at the start of each segment that fits the measured input best: a
    /// recording may begin while the load swings. `following` is the prediction with loads that follow the motor, and
    /// the response to the two `displaced` states is linear. Linear parameters of a nonlinear problem are eliminated
    /// by such a projection (Golub and Pereyra 1973, SIAM Journal on Numerical Analysis 10, 413-432).
    fn with_fitted_starts(&self, following: Vec<f64>, displaced: &[Vec<f64>; 2]) -> Vec<f64> {
        let measured = &self.channels[0].measured;
        let responses: Vec<[f64; 2]> = (0..following.len())
            .map(|k| [0, 1].map(|state| displaced[state][k] - following[k]))
            .collect();
        let mut predicted = following;
        let places: Vec<usize> = self.kept().collect();
        for segment in &self.segments {
            let first = places.partition_point(|index| *index < segment.start);
            let own = first..places.partition_point(|index| *index < segment.end);
            let compared = own.clone().filter(|k| measured[*k].is_finite());
            let errors = compared.map(|k| (responses[k], measured[k] - predicted[k]));
            let Some(factors) = two_factors(errors) else { continue };
            for k in own {
                predicted[k] += factors[0] * responses[k][0] + factors[1] * responses[k][1];
            }
        }
        predicted
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
        // A velocity setpoint does not contain the load.
        let is_loaded = effect.regressors.contains(&Regressor::Load)
            && (matches!(effect.physics, Physics::Effort(_))
                || self.input_kind == InputKind::Velocity);
        let is_possible = match effect.name {
            DEAD_BAND => self.input_kind == InputKind::Velocity || self.channels[0].unit == VOLT,
            GRAVITY => self.position_unit == "rad",
            _ if effect.regressors.contains(&Regressor::OtherAxis) => false,
            _ => true,
        };
        is_possible && !is_loaded && Chain::calls(&effect.physics, self.input_kind)
    }

    fn positions_along(&self, _axis: Axis, twin: &Twin) -> Vec<f64> {
        let origin = twin.position_origin();
        self.signals.position.iter().map(|position| position - origin).collect()
    }

    fn regressor(&self, regressor: Regressor) -> Option<Vec<f64>> {
        let at = |values: &[f64]| Some(self.kept().map(|index| values[index]).collect());
        let each = |value: &dyn Fn(usize) -> f64| Some(self.kept().map(value).collect());
        match regressor {
            Regressor::Constant => each(&|_| 1.0),
            Regressor::Position | Regressor::Phase => at(&self.signals.position),
            Regressor::Velocity => at(&self.signals.velocity),
            Regressor::Direction => at(&self.signals.direction),
            Regressor::Speed => each(&|index| self.signals.velocity[index].abs()),
            Regressor::Acceleration => at(&self.signals.acceleration),
            Regressor::Jerk => at(&derivative(&self.signals.acceleration, self.dt)),
            Regressor::Load => each(&|index| self.signals.input[index].abs()),
            Regressor::Command => at(&self.signals.input),
            Regressor::SinceReversal => at(&since_reversal(&self.signals.velocity, self.dt)),
            Regressor::Time => each(&|index| self.time(index)),
            Regressor::OtherAxis | Regressor::ImpactSpeed => None,
        }
    }

    fn block_seconds(&self) -> f64 {
        BLOCK as f64 * self.factor as f64 * self.dt
    }

    /// Propagation of distributions by simulation (JCGM 101) with one draw, as long as the recording.
    fn noise(&self, twin: &Twin) -> Vec<f64> {
        let signals = self.signals.with_more_noise(&self.segments, self.dt);
        let noisy = Self { signals, ..self.clone() };
        let (plain, noisy) = (self.predicted(twin), noisy.predicted(twin));
        let measured = self.compared(&self.signals.more_input_noise());
        let channel = &self.channels[0];
        let is_compared = |k: &usize| channel.measured[*k].is_finite();
        let samples: Vec<usize> =
            channel.runs.iter().flat_map(Clone::clone).filter(is_compared).collect();
        let error = |k: &usize| measured[*k] + plain[*k] - noisy[*k];
        let square: f64 = samples.iter().map(|k| error(k).powi(2)).sum();
        vec![(square / samples.len().max(1) as f64).sqrt()]
    }

    fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        if let Some(values) = predicted.first_mut() {
            *values = self.predicted(twin);
        }
    }
}

/// Least-squares factors of two responses on an error, given sample by sample; `None` where the responses are alike.
fn two_factors(samples: impl Iterator<Item = ([f64; 2], f64)>) -> Option<[f64; 2]> {
    let [mut aa, mut ab, mut bb, mut ae, mut be] = [0.0; 5];
    for ([a, b], error) in samples {
        aa += a * a;
        ab += a * b;
        bb += b * b;
        ae += a * error;
        be += b * error;
    }
    let determinant = aa * bb - ab * ab;
    (LEAST_DETERMINANT * aa * bb < determinant)
        .then(|| [(bb * ae - ab * be) / determinant, (aa * be - ab * ae) / determinant])
}

/// Value nearest to `wanted` that differs from `middle` by at most `reach`.
fn within(wanted: f64, middle: f64, reach: f64) -> f64 {
    let reach = reach.max(0.0);
    // Not `clamp`, which panics where a number is undefined.
    wanted.max(middle - reach).min(middle + reach)
}

/// `values` read `samples` later, by the cubic through the four nearest samples (Catmull-Rom),
/// constant beyond the ends.
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
