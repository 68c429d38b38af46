//! When the messages of one topic arrived: rate, jitter, gaps and steps back.

use crate::{
    stats::{half_central_spread, median, quantile},
    units::{NANOS_PER_SECOND, Nanos},
};
use serde::Serialize;

/// Fewer messages than this do not tell whether a topic has a rate.
const MIN_PERIODIC_MESSAGES: usize = 20;
/// A topic has a rate when 95 of 100 intervals are at most this many times the middle one; a
/// topic of events is far above it.
const PERIODIC_SPREAD: f64 = 4.0;
/// A gap of a topic with a rate counts above this (s): a dozen control periods of 20 ms, and longer
/// than a busy computer delays a process.
const LARGE_GAP_S: f64 = 0.25;
/// And above this many intervals of the topic itself, for slow topics.
const LARGE_GAP_INTERVALS: f64 = 10.0;

/// Arrival of the messages of one topic. Times are relative to the recording's first message.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Earliest log time (s).
    pub first_s: f64,
    /// Latest log time (s).
    pub last_s: f64,
    /// One over the middle interval (Hz); of a topic whose stamps often coincide, messages over
    /// time. `None` below three messages, and for topics of events, as are the next three.
    pub measured_rate_hz: Option<f64>,
    /// Half the width of the central 68 % of the intervals (ms): their standard deviation where
    /// they are normal.
    pub jitter_ms: Option<f64>,
    /// Longest time between two messages (s).
    pub largest_gap_s: Option<f64>,
    /// When that began (s).
    pub largest_gap_at_s: Option<f64>,
    /// Messages in file order whose log time is before that of the one before.
    pub backward_steps: u64,
    /// The largest such step (s); 0 when there is none.
    pub largest_backward_step_s: f64,
}

/// A time without messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Gap {
    /// When it began (s).
    pub(super) at_s: f64,
    /// How long it was (s).
    pub(super) length_s: f64,
}

/// What [`Timing`] leaves out since it serves other judgements only.
#[derive(Debug, Clone, Default)]
pub(super) struct Rhythm {
    /// Middle interval (s); `None` for a topic without a rate.
    pub(super) period_s: Option<f64>,
    /// A time without messages counts above this (s).
    pub(super) large_gap_s: f64,
    /// Gaps that are unusually large for the topic, by time; of a topic without a rate none.
    pub(super) gaps: Vec<Gap>,
}

/// Measures `times`, in file order, relative to `start`.
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
        timing.largest_gap_s = Some(*length);
        timing.largest_gap_at_s = Some(sorted[at].seconds_since(start));
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
    let limit = LARGE_GAP_S.max(LARGE_GAP_INTERVALS * middle);
    let gaps = intervals
        .iter()
        .zip(sorted)
        .filter(|(length, _)| limit < **length)
        .map(|(length, time)| Gap { at_s: time.seconds_since(start), length_s: *length })
        .collect();
    Rhythm { period_s: Some(middle), large_gap_s: limit, gaps }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn every_20_ms(count: u64) -> Vec<Nanos> {
        (0..count).map(|k| Nanos(1_000_000_000 + k * 20_000_000)).collect()
    }

    #[test]
    fn a_steady_topic_has_its_rate_and_no_gap() {
        let (timing, rhythm) = measure(&every_20_ms(100), Nanos(1_000_000_000));
        assert_eq!(timing.measured_rate_hz, Some(50.0));
        assert_eq!((timing.first_s, timing.last_s, timing.jitter_ms), (0.0, 1.98, Some(0.0)));
        assert_eq!((rhythm.period_s, rhythm.gaps.len()), (Some(0.02), 0));
    }

    #[test]
    fn a_gap_and_a_step_back_are_found_where_they_are() {
        let mut times = every_20_ms(100);
        times.drain(40..60);
        times.swap(10, 11);
        let (timing, rhythm) = measure(&times, times[0]);
        assert_eq!(timing.backward_steps, 1);
        assert_eq!(timing.largest_backward_step_s, 0.02);
        assert_eq!(rhythm.gaps, [Gap { at_s: 0.78, length_s: 0.42 }]);
        assert_eq!(timing.largest_gap_at_s, Some(0.78));
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
