//! Timing of the messages of one topic: rate, jitter, dropouts and steps back.

use crate::{
    stats::{half_central_spread, median, quantile},
    units::{NANOS_PER_SECOND, Nanos},
};
use serde::Serialize;

/// Least number of messages for the estimate of a rate.
const MIN_PERIODIC_MESSAGES: usize = 20;
/// Largest ratio of the 95 % quantile of intervals to their median for a topic with a rate; a topic
/// of events is far above it.
const PERIODIC_SPREAD: f64 = 4.0;
/// Least length of a dropout of a topic with a rate (s): a dozen control periods of 20 ms, and
/// longer than a loaded computer delays a process.
const DROPOUT_S: f64 = 0.25;
/// Least length of a dropout in intervals of the topic, for slow topics.
const DROPOUT_INTERVALS: f64 = 10.0;

/// Timing of the messages of one topic. Times are relative to the recording's first message.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Earliest log time (s).
    pub first_s: f64,
    /// Latest log time (s).
    pub last_s: f64,
    /// Reciprocal of the median interval (Hz); messages over time for a topic whose stamps often
    /// coincide. `None` below three messages and for topics of events, like the next three.
    pub measured_rate_hz: Option<f64>,
    /// Half the width of the central 68 % of the intervals (ms): the standard deviation of a normal
    /// distribution.
    pub jitter_ms: Option<f64>,
    /// Longest dropout (s).
    pub longest_dropout_s: Option<f64>,
    /// Start of the longest dropout (s).
    pub longest_dropout_at_s: Option<f64>,
    /// Number of messages in file order with a log time before that of the previous one.
    pub backward_steps: u64,
    /// Largest such step (s); 0 without steps.
    pub largest_backward_step_s: f64,
}

/// Time without messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dropout {
    /// Start (s).
    pub(super) at_s: f64,
    /// Length (s).
    pub(super) length_s: f64,
}

/// Intermediate results of [`Timing`] for other checks.
#[derive(Debug, Clone, Default)]
pub(super) struct Rhythm {
    /// Median interval (s); `None` for a topic without a rate.
    pub(super) period_s: Option<f64>,
    /// Least length of a dropout of this topic (s).
    pub(super) dropout_s: f64,
    /// Dropouts by time; empty for a topic without a rate.
    pub(super) dropouts: Vec<Dropout>,
}

/// Measure `times`, in file order, relative to `start`.
pub(super) fn measure(times: &[Nanos], start: Nanos) -> (Timing, Rhythm) {
    let mut timing = Timing::default();
    for pair in times.windows(2).filter(|pair| pair[1] < pair[0]) {
        timing.backward_steps += 1;
        let step = pair[0].seconds_since(pair[1]);
        timing.largest_backward_step_s = timing.largest_backward_step_s.max(step);
    }
    let mut sorted = times.to_vec();
    sorted.sort_unstable();
    let (Some(first), Some(last)) = (sorted.first(), sorted.last()) else {
        return (timing, Rhythm::default());
    };
    timing.first_s = first.seconds_since(start);
    timing.last_s = last.seconds_since(start);
    let intervals: Vec<f64> = sorted
        .windows(2)
        .map(|pair| (pair[1].0 - pair[0].0) as f64 / NANOS_PER_SECOND as f64)
        .collect();
    let largest = intervals.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
    if let Some((at, length)) = largest {
        timing.longest_dropout_s = Some(*length);
        timing.longest_dropout_at_s = Some(sorted[at].seconds_since(start));
    }
    if intervals.len() < 2 {
        return (timing, Rhythm::default());
    }
    let middle = median(&intervals).unwrap_or_default();
    let mean = (timing.last_s - timing.first_s) / intervals.len() as f64;
    let period = if 0.0 < middle { middle } else { mean };
    timing.measured_rate_hz = (0.0 < period).then(|| 1.0 / period);
    timing.jitter_ms = half_central_spread(&intervals).map(|spread| spread * 1e3);
    (timing, rhythm(&sorted, &intervals, middle, start))
}

fn rhythm(sorted: &[Nanos], intervals: &[f64], middle: f64, start: Nanos) -> Rhythm {
    let spread = quantile(intervals, 0.95).unwrap_or_default();
    if sorted.len() < MIN_PERIODIC_MESSAGES || !(0.0 < middle && spread <= PERIODIC_SPREAD * middle)
    {
        return Rhythm::default();
    }
    let limit = DROPOUT_S.max(DROPOUT_INTERVALS * middle);
    let dropouts = intervals
        .iter()
        .zip(sorted)
        .filter(|(length, _)| limit < **length)
        .map(|(length, time)| Dropout { at_s: time.seconds_since(start), length_s: *length })
        .collect();
    Rhythm { period_s: Some(middle), dropout_s: limit, dropouts }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_20_ms(count: u64) -> Vec<Nanos> {
        (0..count).map(|k| Nanos(1_000_000_000 + k * 20_000_000)).collect()
    }

    #[test]
    fn a_steady_topic_has_its_rate_and_no_dropout() {
        let (timing, rhythm) = measure(&every_20_ms(100), Nanos(1_000_000_000));
        assert_eq!(timing.measured_rate_hz, Some(50.0));
        assert_eq!((timing.first_s, timing.last_s, timing.jitter_ms), (0.0, 1.98, Some(0.0)));
        assert_eq!((rhythm.period_s, rhythm.dropouts.len()), (Some(0.02), 0));
    }

    #[test]
    fn a_dropout_and_a_step_back_are_found_where_they_are() {
        let mut times = every_20_ms(100);
        times.drain(40..60);
        times.swap(10, 11);
        let (timing, rhythm) = measure(&times, times[0]);
        assert_eq!(timing.backward_steps, 1);
        assert_eq!(timing.largest_backward_step_s, 0.02);
        assert_eq!(rhythm.dropouts, [Dropout { at_s: 0.78, length_s: 0.42 }]);
        assert_eq!(timing.longest_dropout_at_s, Some(0.78));
    }

    #[test]
    fn events_have_no_rhythm() {
        let bursts: Vec<_> =
            (0..100_u64).map(|k| Nanos(k / 5 * 3_000_000_000 + k % 5 * 1_000_000)).collect();
        let (_, rhythm) = measure(&bursts, Nanos(0));
        assert_eq!(rhythm.period_s, None);
        assert_eq!(measure(&[], Nanos(0)).0, Timing::default());
    }
}
