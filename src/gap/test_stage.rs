//! Stage of unit tests: one signal, predicted by a function of twin and time.

use super::screen::{self, Candidate};
use crate::{
    effects::{Axis, Domain, Effect, Regressor, find},
    seed::Stream,
    twin::{Channel, Machine, Slot, Stage, StageKind, Twin},
};
use std::f64::consts::TAU;

/// Signal of [`TestStage::camera`].
pub(super) const CAMERA_SIGNAL: &str = "camera.striker_x";

/// RMS of its noise (m).
pub(super) const CAMERA_NOISE_RMS: f64 = 0.1;

/// Sine with the mass as frequency (Hz), and one of 1 Hz each with the lag and the delay as amplitude.
pub(super) fn sines(twin: &Twin, time: f64) -> f64 {
    let amplitude = |name: &str| {
        let own = twin.instances.iter().find(|own| own.effect.name == name);
        own.map_or(0.0, |own| own.values[0].value)
    };
    let frequency = amplitude("gantry.inertia");
    (TAU * frequency * time).sin()
        + amplitude("drive.lag1") * (TAU * time).sin()
        + amplitude("drive.delay") * (TAU * time).cos()
}

/// Pulses of 10 ms, each of which comes later by 40 s per metre of a backlash: beyond one pulse, no slope leads there.
pub(super) fn pulses_behind_a_gap(twin: &Twin, time: f64) -> f64 {
    let own = twin.instances.iter().find(|own| own.effect.name == "drive.backlash");
    own.map_or(0.0, |own| (-((time % 0.5 - 0.1 - 40.0 * own.values[0].value) / 0.01).powi(2)).exp())
}

/// Nominal single axis with this mass: for [`sines`], a frequency (Hz).
pub(super) fn axis_of_frequency(frequency: f64) -> Twin {
    let mut twin = Twin::nominal(Machine::Axis);
    let [slot] = first_parameters(&twin, ["gantry.inertia"]);
    twin.set(slot, frequency);
    twin
}

/// The same with the effect called `name`, which has one parameter.
pub(super) fn with(twin: &Twin, name: &str, value: f64) -> Twin {
    screen::with(twin, find(name).unwrap(), Axis::Single, &[value])
}

/// Significant candidate for the effect called `name`, which has one parameter.
pub(super) fn candidate(name: &str, start: f64) -> Candidate {
    Candidate {
        effect: find(name).unwrap(),
        axis: Axis::Single,
        start: vec![start],
        probe: vec![start],
        explained_fraction: 0.1,
        statistic: 30.0,
        p_value: 1e-6,
        detectability: 10.0,
        is_as_good_as_refit: false,
        tries: 1,
        parameter_offsets: vec![0.0],
        shift: vec![0.0],
        other_starts: Vec::new(),
    }
}

/// First parameter of each of `effects`, on the first axis that has it.
pub(super) fn first_parameters<const N: usize>(twin: &Twin, effects: [&str; N]) -> [Slot; N] {
    effects.map(|name| {
        let instance = twin.instances.iter().position(|own| own.effect.name == name).unwrap();
        Slot { instance, parameter: 0 }
    })
}

/// Stage with one signal, which `F` predicts from the twin and the time (s).
pub(super) struct TestStage<F> {
    kind: StageKind,
    channels: [Channel; 1],
    /// Position at each sample (m), where it is known.
    position: Option<Vec<f64>>,
    predict: F,
}

impl<F: Fn(&Twin, f64) -> f64 + Sync> TestStage<F> {
    /// Velocity of motor A at 100 Hz from 0 on: the values in `measured` (m/s).
    pub(super) fn drive(measured: Vec<f64>, predict: F) -> Self {
        let channel = Channel {
            signal: "motor_a.velocity".into(),
            unit: "m/s",
            domain: Domain::Drive,
            axis: "a",
            rate_hz: 100.0,
            times: (0..measured.len()).map(|k| 0.01 * k as f64).collect(),
            runs: std::iter::once(0..measured.len()).collect(),
            measured,
        };
        Self { kind: StageKind::Drive, channels: [channel], position: None, predict }
    }

    /// Position of the striker along x (m), 20 s at 100 Hz: the prediction of `truth` with uniform noise.
    pub(super) fn camera(truth: &Twin, predict: F, seed: u64) -> Self {
        let mut random = Stream::new(seed, "swing");
        let bound = (3f64.sqrt() * CAMERA_NOISE_RMS) as f32;
        let times: Vec<f64> = (0..2000).map(|k| 0.01 * f64::from(k)).collect();
        let mut noisy =
            |time: &f64| predict(truth, *time) + f64::from(random.uniform_f32(-bound, bound));
        let channel = Channel {
            signal: CAMERA_SIGNAL.into(),
            unit: "m",
            domain: Domain::Sensor,
            axis: "x",
            rate_hz: 100.0,
            measured: times.iter().map(&mut noisy).collect(),
            times,
            runs: std::iter::once(0..2000).collect(),
        };
        Self { kind: StageKind::Camera, channels: [channel], position: None, predict }
    }
}

impl<F> TestStage<F> {
    /// The same samples along a way of this length (m).
    pub(super) fn along(mut self, travel: f64) -> Self {
        let times = &self.channels[0].times;
        let per_second = travel / (times[times.len() - 1] - times[0]);
        self.position = Some(times.iter().map(|time| per_second * time).collect());
        self
    }

    /// The same samples, each of which took `factor` times as long.
    pub(super) fn slower(mut self, factor: f64) -> Self {
        for channel in &mut self.channels {
            channel.rate_hz /= factor;
            channel.times.iter_mut().for_each(|time| *time *= factor);
        }
        self
    }
}

impl<F: Fn(&Twin, f64) -> f64 + Sync> Stage for TestStage<F> {
    fn kind(&self) -> StageKind {
        self.kind
    }

    fn channels(&self) -> &[Channel] {
        &self.channels
    }

    fn calls(&self, _effect: &Effect) -> bool {
        true
    }

    fn positions_along(&self, _axis: Axis, _twin: &Twin) -> Vec<f64> {
        self.position.clone().unwrap_or_default()
    }

    fn regressor(&self, regressor: Regressor) -> Option<Vec<f64>> {
        self.position.clone().filter(|_| regressor == Regressor::Position)
    }

    fn predict(&self, twin: &Twin, _nuisance: &[Vec<f64>], predicted: &mut [Vec<f64>]) {
        let times = self.channels[0].times.iter();
        predicted[0] = times.map(|time| (self.predict)(twin, *time)).collect();
    }
}
