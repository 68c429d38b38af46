//! When the camera's frames were taken and when they arrived, on the recording's clock.

use super::{Series, message::CameraDetections};
use crate::{stats::median, units::Nanos};

/// Stamps that typically differ less than this from the arrivals (s) count from the same instant: a
/// camera's pictures come within half a second, and unset clocks are hours apart.
const SAME_EPOCH_S: f64 = 1.0;

/// A stamp further than this from where the clock puts its frame's arrival (s) is an error of the
/// camera; its frame goes by its arrival.
const WRONG_STAMP_S: f64 = 1.0;

/// A clock that gains or loses more than this share is none: quartz keeps 1e-4.
const LARGEST_DRIFT: f64 = 0.01;

/// Stamps this close together stand (s).
const STANDING_S: f64 = 1e-6;

/// Largest share of frames whose stamp does not advance: above, the clock is too coarse to tell
/// frames apart.
const LARGEST_STANDING_SHARE: f64 = 0.01;

/// When each frame was taken and when it arrived, on the recording's clock.
///
/// Messages carry the host's time of arrival (`log_time`) and the camera's stamp
/// (`capture_time_ns`). What the stamp is worth depends on the clock behind it:
///
/// | clock of the stamps | taken | latency of the stamps |
/// |---|---|---|
/// | the recording's: typically within 1 s of the arrivals | the stamp, untouched | observable, and so is drift |
/// | one of its own, such as the time since the camera's boot | the stamp, mapped to the arrivals by offset and drift | not observable, nor is drift |
/// | none: no stamps, or stamps that stand or run 1 % too fast or slow | the arrival | not observable |
///
/// In the last two rows nothing tells the time from exposure to arrival apart from the rest. What a
/// fit then calls the camera's latency is that whole time, transport and processing included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameTimes {
    /// When each was taken, as the table says.
    pub taken: Vec<Nanos>,
    /// When each arrived, freed from the scatter of arrivals by the camera's clock where it has one.
    pub arrived: Vec<Nanos>,
}

impl FrameTimes {
    /// Of detections in order of their arrival; both times are as many as `detections`.
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

/// Age of each stamp at the arrival of its frame (s); NaN without a stamp.
fn ages(arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Vec<f64> {
    let age = |(arrival, stamp): (&Nanos, &Option<Nanos>)| {
        stamp.map_or(f64::NAN, |stamp| arrival.seconds_since(stamp))
    };
    arrivals.iter().zip(stamps).map(age).collect()
}

/// Medians of the first and of the last third of `values`.
fn ends(values: &[f64]) -> Option<[f64; 2]> {
    let third = values.len().div_ceil(3);
    Some([median(&values[..third])?, median(&values[values.len() - third..])?])
}

/// Median age of the stamps (s) where they count from the same instant as the arrivals, at the
/// beginning and at the end.
fn same_epoch(arrivals: &[Nanos], stamps: &[Option<Nanos>]) -> Option<f64> {
    let ages = ages(arrivals, stamps);
    let same = ends(&ages)?.iter().all(|age| age.abs() <= SAME_EPOCH_S);
    median(&ages).filter(|_| same)
}

/// The stamps; a frame with a missing or wrong one was taken `age` (s) before it arrived.
fn stamped_times(arrivals: &[Nanos], stamps: &[Option<Nanos>], age: f64) -> Vec<Nanos> {
    let right = |arrival: Nanos, stamp: &Nanos| {
        (arrival.seconds_since(*stamp) - age).abs() <= WRONG_STAMP_S
    };
    let time = |(arrival, stamp): (&Nanos, &Option<Nanos>)| {
        stamp.filter(|stamp| right(*arrival, stamp)).unwrap_or(arrival.after_seconds(-age))
    };
    arrivals.iter().zip(stamps).map(time).collect()
}

/// The camera's clock against the arrivals: a stamp `c` seconds after the first arrived
/// `c + offset + drift * (c - at)` seconds after the first arrival.
struct Clock {
    first: Nanos,
    first_arrival: Nanos,
    at: f64,
    offset: f64,
    drift: f64,
}

impl Clock {
    /// By the medians of the first and of the last third; `None` where the stamps are no clock.
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
        // A missing stamp does not stand: it is not finite, and neither is its step.
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

    /// Arrivals by this clock; of frames with a missing or wrong stamp as they were recorded.
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

    /// Frame `k` is exposed this long after the first (s).
    fn exposed(k: u32) -> f64 {
        f64::from(k) / 120.0
    }

    /// Scatter of the arrivals (s).
    fn scatter(k: u32) -> f64 {
        0.002 * (f64::from(k) * 2.399_963).sin()
    }

    /// A minute of frames that arrive 30 ms after their exposure, with scatter, and carry
    /// `stamp(k)`.
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
