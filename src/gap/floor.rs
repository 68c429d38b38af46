//! Noise floor of a signal, from measurements alone: never from the residual of a model.
//!
//! The floor of a signal of a table follows from its third differences: a cubic has none, and white
//! noise of standard deviation s gives them s sqrt(20). Their median is taken, so that starts and
//! stops do not count.
//!
//! The input of a single axis is compared after filtering and decimation, so its differences are
//! mostly motion. Its floor combines measurement noise and model error. The noise is the white
//! noise of input and position, measured at the rate of the recording and propagated to the
//! residual. The model error of the simulation is a fraction of the input's standard deviation.

use super::thresholds::Thresholds;
use crate::{
    stats::{median, standard_deviation},
    twin::{Channel, ReferenceResidual, Stage, Twin},
};
use serde::{Deserialize, Serialize};

/// Fewest differences from which a floor is stated.
const LEAST_DIFFERENCES: usize = 100;

/// Median of |z| of a standard normal variable.
const MEDIAN_OF_HALF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// Method of a noise floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorSource {
    /// Third differences of the measured signal.
    Smoothness,
    /// Propagated noise of all measured signals, and the model error of the simulation.
    Propagated,
    /// Reference residual of the given twin: measurement noise and model error.
    Reference,
    /// Too few samples.
    Unknown,
}

/// The noise floor of one signal.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// Standard deviation, in the signal's unit; zero when unknown.
    pub rms: f64,
    /// Method.
    pub source: FloorSource,
    /// Number of samples.
    pub samples: usize,
}

impl Floor {
    /// The floor, or the `reference` residual of the given twin where that is larger or the only one.
    #[must_use]
    pub(super) fn at_least(self, reference: Option<f64>) -> Self {
        match reference.filter(|rms| rms.is_finite() && self.rms < *rms) {
            Some(rms) => Self { rms, source: FloorSource::Reference, samples: self.samples },
            None => self,
        }
    }
}

/// Floor of each channel of `stage`. If the `fitted` twin predicts from measurements, their noise,
/// propagated by that twin, sets the floor; otherwise it follows from the channel. The reference
/// residual of the `given` twin replaces a smaller floor.
#[must_use]
pub(super) fn floors(
    stage: &dyn Stage,
    given: &Twin,
    fitted: &Twin,
    thresholds: &Thresholds,
) -> Vec<Floor> {
    let propagated = stage.noise(fitted);
    let of_channel = |(index, channel): (usize, &Channel)| {
        let is_known = |own: &&ReferenceResidual| own.signal == channel.signal && own.searched;
        let reference = given.reference_residuals.iter().find(is_known);
        let own = match propagated.get(index) {
            Some(noise) => predicted_from_measurements(channel, *noise, thresholds.model_error),
            None => floor(channel),
        };
        own.at_least(reference.map(|own| own.residual_rms))
    };
    stage.channels().iter().enumerate().map(of_channel).collect()
}

/// The floor of `channel`, which is predicted from measured signals: the `noise` of all of them, and the `model_error` of
/// its standard deviation, because a simulation follows no change exactly.
fn predicted_from_measurements(channel: &Channel, noise: f64, model_error: f64) -> Floor {
    let samples = channel.runs.iter().flat_map(|run| &channel.measured[run.clone()]);
    let compared: Vec<f64> = samples.copied().filter(|value| value.is_finite()).collect();
    match standard_deviation(&compared) {
        Some(deviation) => Floor {
            rms: noise.hypot(model_error * deviation),
            source: FloorSource::Propagated,
            samples: compared.len(),
        },
        None => Floor { rms: 0.0, source: FloorSource::Unknown, samples: 0 },
    }
}

/// The floor of `channel` by itself.
#[must_use]
pub(super) fn floor(channel: &Channel) -> Floor {
    let mut thirds = Vec::new();
    for run in &channel.runs {
        for four in channel.measured[run.clone()].windows(4) {
            let third = four[3] - 3.0 * four[2] + 3.0 * four[1] - four[0];
            if third.is_finite() {
                thirds.push(third.abs());
            }
        }
    }
    match median(&thirds) {
        Some(middle) if LEAST_DIFFERENCES <= thirds.len() => Floor {
            rms: middle / (MEDIAN_OF_HALF_NORMAL * 20.0_f64.sqrt()),
            source: FloorSource::Smoothness,
            samples: thirds.len(),
        },
        _ => Floor { rms: 0.0, source: FloorSource::Unknown, samples: 0 },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{effects::Domain, seed::Stream};

    fn channel(measured: Vec<f64>) -> Channel {
        let whole = 0..measured.len();
        Channel {
            signal: "test".into(),
            unit: "m",
            domain: Domain::Sensor,
            axis: "x",
            rate_hz: 100.0,
            times: whole.clone().map(|k| k as f64 * 0.01).collect(),
            measured,
            runs: vec![whole],
        }
    }

    fn noise(count: usize) -> Vec<f64> {
        let mut stream = Stream::new(4, "noise");
        // Twelve uniform numbers make a normal one of standard deviation 1.
        (0..count)
            .map(|_| (0..12).map(|_| f64::from(stream.uniform_f32(-0.5, 0.5))).sum::<f64>())
            .collect()
    }

    #[test]
    fn a_moving_signal_has_the_floor_of_its_noise() {
        let moving: Vec<f64> = noise(4000)
            .iter()
            .enumerate()
            .map(|(k, n)| 30.0 * (k as f64 * 0.01).sin() + n)
            .collect();
        let found = floor(&channel(moving));
        assert_eq!(found.source, FloorSource::Smoothness);
        assert!((found.rms - 1.0).abs() < 0.05, "{}", found.rms);
    }

    #[test]
    fn model_error_is_a_fraction_of_the_variation_of_the_signal() {
        let found = predicted_from_measurements(&channel(noise(4000)), 0.3, 0.4);
        assert_eq!((found.source, found.samples), (FloorSource::Propagated, 4000));
        assert!((found.rms - 0.5).abs() < 0.02, "{}", found.rms);
        let shifted = noise(4000).into_iter().map(|value| value + 70.0).collect();
        let other = predicted_from_measurements(&channel(shifted), 0.3, 0.4);
        assert!((other.rms - found.rms).abs() < 1e-9, "{}", other.rms);
        let nothing = predicted_from_measurements(&channel(vec![]), 0.3, 0.4);
        assert_eq!(nothing.source, FloorSource::Unknown);
    }

    #[test]
    fn a_larger_reference_residual_is_the_floor() {
        let found = Floor { rms: 1.0, source: FloorSource::Smoothness, samples: 200 };
        assert_eq!(found.at_least(None), found);
        assert_eq!(found.at_least(Some(0.5)), found);
        let higher = found.at_least(Some(1.2));
        assert_eq!((higher.rms, higher.source), (1.2, FloorSource::Reference));
    }
}
