//! Noise floor of a signal, from measurements alone: never from the residual of a model.
//!
//! The standard deviation at rest is preferred. Without enough rest, the floor follows from the third differences of the
//! measured signal: a cubic has none, and white noise of standard deviation s gives them s sqrt(20). Their median is
//! taken, so that starts and stops do not count.

use crate::{
    stats::median,
    twin::{Channel, ReferenceResidual, Twin},
};
use serde::{Deserialize, Serialize};

/// Fewest samples at rest on which a floor is stated.
const LEAST_REST: usize = 100;

/// Samples over which a signal counts as resting when it stays within a few quanta.
const REST_WINDOW: usize = 25;

/// Median of |z| of a standard normal variable.
const MEDIAN_OF_HALF_NORMAL: f64 = 0.674_489_750_196_081_7;

/// Method of a noise floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorSource {
    /// Standard deviation at rest.
    Rest,
    /// Third differences of the measured signal.
    Smoothness,
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

/// Floor of each of `channels`: from the measurement, or the reference residual of the `given` twin where that is larger.
#[must_use]
pub(super) fn floors(channels: &[Channel], given: &Twin) -> Vec<Floor> {
    let of_channel = |channel: &Channel| {
        let is_known = |own: &&ReferenceResidual| own.signal == channel.signal && own.searched;
        let reference = given.reference_residuals.iter().find(is_known);
        floor(channel, &[]).at_least(reference.map(|own| own.residual_rms))
    };
    channels.iter().map(of_channel).collect()
}

/// The floor of `channel`, where `at_rest[sample]` says when nothing moved.
#[must_use]
pub(super) fn floor(channel: &Channel, at_rest: &[bool]) -> Floor {
    let mut squares = 0.0;
    let mut count = 0;
    for run in &channel.runs {
        for start in (run.start..run.end.saturating_sub(REST_WINDOW)).step_by(REST_WINDOW) {
            let window = start..start + REST_WINDOW;
            let values = &channel.measured[window.clone()];
            if !window
                .clone()
                .all(|k| at_rest.get(k) == Some(&true) && channel.measured[k].is_finite())
            {
                continue;
            }
            let mean = values.iter().sum::<f64>() / REST_WINDOW as f64;
            squares += values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
            count += REST_WINDOW;
        }
    }
    if LEAST_REST <= count {
        let freedom = count as f64 * (1.0 - 1.0 / REST_WINDOW as f64);
        return Floor {
            rms: (squares / freedom).sqrt(),
            source: FloorSource::Rest,
            samples: count,
        };
    }
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
        Some(middle) if LEAST_REST <= thirds.len() => Floor {
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
        let found = floor(&channel(moving), &[]);
        assert_eq!(found.source, FloorSource::Smoothness);
        assert!((found.rms - 1.0).abs() < 0.05, "{}", found.rms);
    }

    #[test]
    fn a_larger_reference_residual_is_the_floor() {
        let found = Floor { rms: 1.0, source: FloorSource::Rest, samples: 200 };
        assert_eq!(found.at_least(None), found);
        assert_eq!(found.at_least(Some(0.5)), found);
        let higher = found.at_least(Some(1.2));
        assert_eq!((higher.rms, higher.source), (1.2, FloorSource::Reference));
    }

    #[test]
    fn rest_is_preferred() {
        let found = floor(&channel(noise(1000)), &vec![true; 1000]);
        assert_eq!(found.source, FloorSource::Rest);
        assert!((found.rms - 1.0).abs() < 0.05, "{}", found.rms);
    }
}
