//! One measured signal of several columns, as times and values.

use crate::{
    effects::Domain,
    stats::{mean, median},
    twin::Channel,
};
use std::ops::Range;

/// Periods without a reading that are a pause, which is not filled.
const LONGEST_GAP: f64 = 1000.0;

/// Readings of one signal, in order.
#[derive(Debug, Clone, Default)]
pub(super) struct Readings<const N: usize> {
    pub(super) times: Vec<f64>,
    pub(super) values: Vec<[f64; N]>,
}

impl<const N: usize> Readings<N> {
    /// Readings with increasing times: a reading that repeats a time is left out.
    pub(super) fn collect(from: impl Iterator<Item = (f64, [f64; N])>) -> Self {
        let mut readings = Self::default();
        for (time, value) in from {
            if readings.times.last().is_none_or(|last| last + 1e-9 < time) {
                readings.times.push(time);
                readings.values.push(value);
            }
        }
        readings
    }

    /// Median distance between readings (s); `None` below two.
    pub(super) fn period(&self) -> Option<f64> {
        let steps: Vec<f64> = self.times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        median(&steps)
    }

    /// The same on an even index: where readings are missing, empty ones (NaN) are put in.
    ///
    /// Readings are missing where there are fewer than periods since the last pause: time stamps that jitter leave long
    /// intervals and short ones, and nothing is missing.
    pub(super) fn evened(&self) -> Self {
        let Some(period) = self.mean_period() else { return self.clone() };
        let mut even = Self::default();
        let (mut begin, mut count) = (0.0, 0);
        for (index, time) in self.times.iter().enumerate() {
            match even.times.last().copied() {
                Some(last) if time - last < LONGEST_GAP * period => {
                    let gap: f64 = time - last;
                    let missing =
                        (((time - begin) / period).round() as usize).saturating_sub(count);
                    let missing = missing.min((gap / period).round() as usize);
                    for k in 1..missing {
                        even.times.push(last + gap * k as f64 / missing as f64);
                        even.values.push([f64::NAN; N]);
                    }
                    count += missing.max(1);
                }
                _ => (begin, count) = (*time, 0),
            }
            even.times.push(*time);
            even.values.push(self.values[index]);
        }
        even
    }

    /// Mean distance of neighbours that are about one median apart (s); `None` below two readings.
    fn mean_period(&self) -> Option<f64> {
        let median = self.period()?;
        let steps = self.times.windows(2).map(|pair| pair[1] - pair[0]);
        let single: Vec<f64> = steps.filter(|step| (step - median).abs() < 0.5 * median).collect();
        mean(&single).filter(|period| 0.0 < *period)
    }

    /// Indices of the readings in each of `spans`.
    pub(super) fn indices(&self, spans: &[Range<f64>]) -> Vec<Range<usize>> {
        let place = |time: f64| self.times.partition_point(|at| *at < time - 1e-9);
        spans.iter().map(|span| place(span.start)..place(span.end)).collect()
    }

    /// One channel out of the `column`th value, for the given runs.
    pub(super) fn channel(
        &self,
        column: usize,
        spans: &[Range<f64>],
        name: (&str, &'static str, Domain, &'static str),
    ) -> Channel {
        let (signal, unit, domain, axis) = name;
        Channel {
            signal: signal.to_owned(),
            unit,
            domain,
            axis,
            rate_hz: self.period().map_or(0.0, |period| 1.0 / period),
            times: self.times.clone(),
            measured: self.values.iter().map(|value| value[column]).collect(),
            runs: self.indices(spans),
        }
    }
}
