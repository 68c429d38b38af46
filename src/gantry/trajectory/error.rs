//! Errors of a pattern or a reference.

/// Error of a pattern or a reference.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// Unknown pattern.
    #[error("'{given}' is no pattern; choose one of {allowed}")]
    UnknownPattern {
        /// Text given.
        given: String,
        /// Known patterns.
        allowed: String,
    },
    /// Unknown parameter.
    #[error("'{given}' is no parameter of {pattern}; it has {allowed}, written key=value")]
    UnknownKey {
        /// Pattern.
        pattern: &'static str,
        /// Text given.
        given: String,
        /// Known parameters.
        allowed: String,
    },
    /// Parameter given twice.
    #[error("{pattern}: {key} is given twice; give it once")]
    Twice {
        /// Pattern.
        pattern: &'static str,
        /// Parameter.
        key: &'static str,
    },
    /// Value out of range, or missing.
    #[error("{pattern}: {key} is '{value}'; it must be {range}")]
    OutOfRange {
        /// Pattern.
        pattern: &'static str,
        /// Parameter.
        key: &'static str,
        /// Value given.
        value: String,
        /// Allowed range.
        range: String,
    },
    /// Two values in the wrong order.
    #[error("{pattern}: {low} is {low_value} and {high} is {high_value}; {low} must be smaller")]
    Order {
        /// Pattern.
        pattern: &'static str,
        /// Parameter that must be smaller.
        low: &'static str,
        /// Its value.
        low_value: f64,
        /// Parameter that must be larger.
        high: &'static str,
        /// Its value.
        high_value: f64,
    },
    /// Pattern that would leave the workspace, or could not stop inside.
    #[error(
        "{pattern}: {key} {value} does not fit the workspace with its stopping distance; the largest \
         that fits is {largest}"
    )]
    TooLarge {
        /// Pattern.
        pattern: &'static str,
        /// Parameter.
        key: &'static str,
        /// Value given.
        value: f64,
        /// Largest value that fits.
        largest: f64,
    },
    /// Pattern that fits the workspace with no parameters.
    #[error(
        "{pattern} does not fit the workspace ({width_m:.3} m by {height_m:.3} m) at any size or \
         speed; widen the field, or change its other parameters"
    )]
    NoRoom {
        /// Pattern.
        pattern: &'static str,
        /// Width across (m).
        width_m: f64,
        /// Length along (m).
        height_m: f64,
    },
    /// Speed above the limits.
    #[error(
        "{pattern}: speed_m_per_s {speed} passes limits.speed_m_per_s or \
         limits.total_speed_m_per_s; the largest here is {largest}"
    )]
    TooFast {
        /// Pattern.
        pattern: &'static str,
        /// Speed given (m/s).
        speed: f64,
        /// Largest speed (m/s).
        largest: f64,
    },
    /// Acceleration above the slew limit.
    #[error(
        "{pattern}: {key} {value} needs more than limits.slew_m_per_s2; the largest here is \
         {largest}"
    )]
    TooAbrupt {
        /// Pattern.
        pattern: &'static str,
        /// Parameter.
        key: &'static str,
        /// Value given.
        value: f64,
        /// Largest value that fits.
        largest: f64,
    },
    /// Length too short to reach the speed.
    #[error(
        "{pattern}: length_m {length} is too short to reach {speed} m/s; it needs {smallest} m, or \
         a smaller speed"
    )]
    TooShort {
        /// Pattern.
        pattern: &'static str,
        /// Length given (m).
        length: f64,
        /// Speed (m/s).
        speed: f64,
        /// Smallest length (m).
        smallest: f64,
    },
    /// Frequency too high for the rate of commands.
    #[error(
        "{pattern}: f1_hz is {value}; at {rate_hz} commands a second the largest is {largest} Hz"
    )]
    FrequencyTooHigh {
        /// Pattern.
        pattern: &'static str,
        /// Frequency given (Hz).
        value: f64,
        /// Commands per second (Hz).
        rate_hz: f64,
        /// Largest frequency (Hz).
        largest: f64,
    },
    /// Too many lines of a multisine for its band.
    #[error(
        "multisine: {lines} lines on each axis do not fit the band; with this period_s the most \
         is {largest} (0: widen the band or lengthen the period)"
    )]
    TooManyLines {
        /// Number given.
        lines: u32,
        /// Largest number.
        largest: u32,
    },
    /// Rate of commands out of range.
    #[error("a rate of {rate_hz} Hz; it must lie in [10, 1000] Hz, the table has 50")]
    Rate {
        /// Rate given (Hz).
        rate_hz: f64,
    },
    /// Number of samples out of range.
    #[error("{samples} samples; a run has 10 to 1000000")]
    Samples {
        /// Number given.
        samples: usize,
    },
    /// Non-finite point.
    #[error("a transfer from ({}, {}) to ({}, {}) m; both points must be finite", from[0], from[1], to[0], to[1])]
    Point {
        /// Start (m).
        from: [f64; 2],
        /// End (m).
        to: [f64; 2],
    },
}
