//! Capture and arrival times of the camera's frames, on the recording's clock.

use super::{Series, message::CameraDetections};
use crate::{stats::median, units::Nanos};

/// Largest typical difference between stamps and arrivals on a common clock (s). Camera frames
/// arrive within half a second, and unset clocks are hours apart.
const SAME_EPOCH_S: f64 = 1.0;

/// Largest deviation of a stamp from the fitted clock (s); beyond it, the stamp is an error of the
/// camera and the arrival time is used.
const WRONG_STAMP_S: f64 = 1.0;

/// Largest drift of a clock, as a fraction; a quartz clock keeps 1e-4.
const LARGEST_DRIFT: f64 = 0.01;

/// Largest step between stamps that counts as no advance (s).
const STANDING_S: f64 = 1e-6;

/// Largest fraction of frames whose stamp does not advance; above it, the clock is too coarse to
/// distinguish frames.
const LARGEST_STANDING_SHARE: f64 = 0.01;

/// Capture and arrival time of each frame, on the recording's clock.
///
/// Messages have the host's time of arrival (`log_time`) and the camera's stamp
/// (`capture_time_ns`). The use of the stamp depends on its clock:
///
/// | clock of the stamps | capture time | latency of the stamps |
/// |---|---|---|
/// | the recording's: typically within 1 s of the arrivals | the stamp, unchanged | observable, and
/// so is drift |
/// | a separate clock, such as the time since the camera's boot | the stamp, mapped to the arrivals
/// by offset and drift | not observable, nor is drift |
/// | none: no stamps, or stamps that do not advance or run 1 % too fast or slow | the arrival | not
/// observable |
///
/// In the last two rows the time from exposure to arrival is not identifiable. The camera latency
/// of a fit then includes transport and processing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameTimes {
    /// Capture time of each frame, as in the table.
    pub taken: Vec<Nanos>,
    /// Arrival time of each frame, without the jitter of arrivals where the camera has a clock.
    pub arrived: Vec<Nanos>,
}

impl FrameTimes {
    /// Compute the times of detections in order of their arrival; both lists are as long as
    /// `detections`.
    #[must_use]
    pub fn of(detections: &Series<CameraDetections>) -> Self {
        let stamps: Vec<Option<Nanos>> = detections
            .values
            .iter()
            .map(|frame| (frame.capture_time_ns != 0).then_some(Nanos(frame.capture_time_ns)))
            .collect();
        let arrivals = &detections.times;
        let arrived = match Clock::of(arrivals, &stamps) {
            Some(clock) => clock.arrivals(arrivals, &stamps),
            None => arrivals.clone(),
        };
        let taken = match same_epoch(arrivals, &stamps) {
            Some(age) => stamped_times(arrivals, &stamps, age),
            None => arrived.clone(),
        };
        Self { taken, arrived }
    }
}

/// Return the age of each stamp at the arrival of its frame (s); NaN without a stamp.
fn ages(arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Vec<f64> {
    let age = |(arrival, stamp): (&Nanos, &Option<Nanos>)| {
        stamp.map_or(f64::NAN, |stamp| arrival.seconds_since(stamp))
    };
    arrivals.iter().zip(stamps).map(age).collect()
}

/// Return the medians of the first and of the last third of `values`.
fn ends(values: &[f64]) -> Option<[f64; 2]> {
    let third = values.len().div_ceil(3);
    Some([median(&values[..third])?, median(&values[values.len() - third..])?])
}

/// Return the median age of the stamps (s) at the start and at the end, where they share the clock
/// of the arrivals.
fn same_epoch(arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Option<f64> {
    let ages = ages(arrivals, stamps);
    let same = ends(&ages)?.iter().all(|age| age.abs() <= SAME_EPOCH_S);
    median(&ages).filter(|_| same)
}

/// Return the stamps; a frame with a missing or wrong stamp was captured `age` (s) before it
/// arrived.
fn stamped_times(arrivals: &[Nanos], stamps: &[Option<Nanos>], age: f64) -> Vec<Nanos> {
    let right = |arrival: Nanos, stamp: &Nanos| {
        (arrival.seconds_since(*stamp) - age).abs() <= WRONG_STAMP_S
    };
    let time = |(arrival, stamp): (&Nanos, &Option<Nanos>)| {
        stamp.filter(|stamp| right(*arrival, stamp)).unwrap_or(arrival.after_seconds(-age))
    };
    arrivals.iter().zip(stamps).map(time).collect()
}

/// Camera clock relative to the arrivals: a stamp `c` seconds after the first arrived `c + offset +
/// drift * (c - at)` seconds after the first arrival.
struct Clock {
    first: Nanos,
    first_arrival: Nanos,
    at: f64,
    offset: f64,
    drift: f64,
}

impl Clock {
    /// Fit by the medians of the first and of the last third; `None` where the stamps are not a
    /// clock.
    fn of(arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Option<Self> {
        let first = (*stamps.iter().find(|stamp| stamp.is_some())?)?;
        let first_arrival = *arrivals.first()?;
        let since_first =
            |stamp: &Option<Nanos>| stamp.map_or(f64::NAN, |stamp| stamp.seconds_since(first));
        let stamped: Vec<f64> = stamps.iter().map(since_first).collect();
        let ages: Vec<f64> = arrivals
            .iter()
            .zip(&stamped)
            .map(|(arrival, stamp)| arrival.seconds_since(first_arrival) - stamp)
            .collect();
        // A missing stamp is not finite, and neither is its step.
        let steps = stamped.windows(2).map(|pair| pair[1] - pair[0]);
        let standing = steps.filter(|step| *step <= STANDING_S).count() as f64;
        let [at, at_late] = ends(&stamped)?;
        let [offset, late] = ends(&ages)?;
        let drift = (late - offset) / (at_late - at);
        let runs = standing <= LARGEST_STANDING_SHARE * stamps.len() as f64;
        (runs && drift.abs() <= LARGEST_DRIFT).then_some(Self {
            first,
            first_arrival,
            at,
            offset,
            drift,
        })
    }

    /// Return the arrivals by this clock; frames with a missing or wrong stamp keep the recorded
    /// arrival.
    fn arrivals(&self, arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Vec<Nanos> {
        let by_clock = |stamp: Nanos| {
            let c = stamp.seconds_since(self.first);
            self.first_arrival.after_seconds(c + self.offset + self.drift * (c - self.at))
        };
        let right =
            |arrival: Nanos, time: &Nanos| time.seconds_since(arrival).abs() <= WRONG_STAMP_S;
        let time = |(arrival, stamp): (&Nanos, &Option<Nanos>)| {
            stamp.map(by_clock).filter(|time| right(*arrival, time)).unwrap_or(*arrival)
        };
        arrivals.iter().zip(stamps).map(time).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BEGAN: Nanos = Nanos(1_700_000_000_000_000_000);

    /// Exposure time of frame `k` after the first (s).
    fn exposed(k: u32) -> f64 {
        f64::from(k) / 120.0
    }

    /// Jitter of the arrivals (s).
    fn scatter(k: u32) -> f64 {
        0.002 * (f64::from(k) * 2.399_963).sin()
    }

    /// A minute of frames that arrive 30 ms after their exposure, with jitter, and have `stamp(k)`.
    fn frames(stamp: impl Fn(u32) -> Nanos) -> Series<CameraDetections> {
        let detections =
            |k| CameraDetections { capture_time_ns: stamp(k).0, ..CameraDetections::default() };
        Series {
            times: (0..7200).map(|k| BEGAN.after_seconds(exposed(k) + 0.03 + scatter(k))).collect(),
            values: (0..7200).map(detections).collect(),
        }
    }

    /// Largest distance of `times` from the exposures plus `delay` (s).
    fn farthest(times: &[Nanos], delay: f64) -> f64 {
        let off = |(k, time): (u32, &Nanos)| (time.seconds_since(BEGAN) - exposed(k) - delay).abs();
        (0..).zip(times).map(off).fold(0.0, f64::max)
    }

    #[test]
    fn stamps_on_the_recordings_clock_are_kept_with_their_latency_and_drift() {
        for (early, drift) in [(0.0, 0.0), (0.02, 0.0), (0.45, 0.0), (-0.01, 2e-4)] {
            let stamp = |k| BEGAN.after_seconds(exposed(k) * (1.0 + drift) - early);
            let found = FrameTimes::of(&frames(stamp));
            let stamps: Vec<Nanos> = (0..7200).map(stamp).collect();
            assert_eq!(found.taken, stamps, "{early} {drift}");
            assert!(farthest(&found.arrived, 0.03) < 3e-4, "{early} {drift}");
        }
    }

    #[test]
    fn stamps_of_another_epoch_are_mapped_to_the_arrivals_without_their_scatter() {
        for (boot, drift) in [(12_345.0, 0.0), (3.0, 1e-4), (2.0, -5e-4)] {
            let stamp = |k| Nanos(0).after_seconds(boot + exposed(k) * (1.0 + drift));
            let found = FrameTimes::of(&frames(stamp));
            assert_eq!(found.taken, found.arrived);
            assert!(farthest(&found.taken, 0.03) < 3e-4, "{}", farthest(&found.taken, 0.03));
        }
    }

    #[test]
    fn without_a_clock_frames_go_by_their_arrival() {
        let arrivals = frames(|_| Nanos(0)).times;
        let coarse = |k| Nanos(0).after_seconds(9e3 + (exposed(k) * 50.0).floor() / 50.0);
        let fast = |k| Nanos(0).after_seconds(9e3 + 1000.0 * exposed(k));
        for series in [frames(|_| Nanos(0)), frames(|_| Nanos(77)), frames(coarse), frames(fast)] {
            let found = FrameTimes::of(&series);
            assert!(found.taken == arrivals && found.arrived == arrivals);
        }
        let none = FrameTimes::of(&Series::default());
        assert!(none.taken.is_empty() && none.arrived.is_empty());
    }

    #[test]
    fn a_frame_without_right_stamp_is_placed_by_its_arrival() {
        let odd = |k: u32, right: Nanos| match k {
            7 => Nanos(0),
            3000 => right.after_seconds(50.0),
            _ => right,
        };
        let own = FrameTimes::of(&frames(|k| odd(k, BEGAN.after_seconds(exposed(k)))));
        let boot = FrameTimes::of(&frames(|k| odd(k, Nanos(0).after_seconds(40.0 + exposed(k)))));
        for k in [7, 3000] {
            let expected = exposed(k) + scatter(k);
            let place = |times: &[Nanos]| times[k as usize].seconds_since(BEGAN) - expected;
            assert!(place(&own.taken).abs() < 1e-4, "{}", place(&own.taken));
            assert!((place(&boot.taken) - 0.03).abs() < 1e-9, "{}", place(&boot.taken));
        }
        assert_eq!(own.taken[8], BEGAN.after_seconds(exposed(8)));
    }
}
