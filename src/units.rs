//! Time stamps: one integer type, and its conversions to seconds.
//!
//! Inside the library every quantity is SI (metres, m/s, radians, newtons, seconds as `f64`).
//! Recorded time is an integer count of nanoseconds, so that equal stamps compare equal.

use std::fmt;

/// Nanoseconds per second.
pub const NANOS_PER_SECOND: u64 = 1_000_000_000;

/// Recorded time: nanoseconds since the Unix epoch, or since any other fixed start.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Default,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct Nanos(pub u64);

impl Nanos {
    /// Return the time as a Protocol Buffers message.
    ///
    /// ```
    /// use klasktron::units::Nanos;
    /// let time = Nanos(1_500_000_000).timestamp();
    /// assert_eq!((time.seconds, time.nanos), (1, 500_000_000));
    /// ```
    #[must_use]
    pub fn timestamp(self) -> prost_types::Timestamp {
        prost_types::Timestamp {
            seconds: (self.0 / NANOS_PER_SECOND) as i64,
            nanos: (self.0 % NANOS_PER_SECOND) as i32,
        }
    }

    /// Return the seconds from `earlier` to `self`; negative when `self` is before it.
    ///
    /// ```
    /// use klasktron::units::Nanos;
    /// assert_eq!(Nanos(1_500_000_000).seconds_since(Nanos(1_000_000_000)), 0.5);
    /// assert_eq!(Nanos(0).seconds_since(Nanos(20_000_000)), -0.02);
    /// ```
    #[must_use]
    pub fn seconds_since(self, earlier: Self) -> f64 {
        let seconds = self.0.abs_diff(earlier.0) as f64 / NANOS_PER_SECOND as f64;
        if earlier <= self { seconds } else { -seconds }
    }

    /// Return the time `seconds` later (earlier when negative), rounded to the nearest nanosecond
    /// and saturated at the limits of the type.
    #[must_use]
    pub fn after_seconds(self, seconds: f64) -> Self {
        let step = (seconds.abs() * NANOS_PER_SECOND as f64).round() as u64;
        Self(if seconds < 0.0 { self.0.saturating_sub(step) } else { self.0.saturating_add(step) })
    }
}

impl fmt::Display for Nanos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{:09} s", self.0 / NANOS_PER_SECOND, self.0 % NANOS_PER_SECOND)
    }
}
