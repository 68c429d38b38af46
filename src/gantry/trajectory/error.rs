//! Why a pattern, or a reference, cannot be had.

/// Why a pattern, or a reference, cannot be had.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TrajectoryError {
    /// No such pattern.
    #[error("'{given}' is no pattern; choose one of {allowed}")]
    UnknownPattern {
        /// What was given.
        given: String,
        /// What there is.
        allowed: String,
    },
    /// No such parameter.
    #[error("'{given}' is no parameter of {pattern}; it has {allowed}, written key=value")]
    UnknownKey {
        /// Whose.
        pattern: &'static str,
        /// What was given.
        given: String,
        /// What there is.
        allowed: String,
    },
    /// A parameter twice.
    #[error("{pattern}: {key} is given twice; give it once")]
    Twice {
        /// Whose.
        pattern: &'static str,
        /// Which.
        key: &'static str,
    },
    /// A value out of its range, or none at all.
    #[error("{pattern}: {key} is '{value}'; it must be {range}")]
    OutOfRange {
        /// Whose.
        pattern: &'static str,
        /// Which.
        key: &'static str,
        /// What was given.
        value: String,
        /// What is allowed.
        range: String,
    },
    /// Two values the wrong way round.
    #[error("{pattern}: {low} is {low_value} and {high} is {high_value}; {low} must be smaller")]
    Order {
        /// Whose.
        pattern: &'static str,
        /// Which must be smaller.
        low: &'static str,
        /// Its value.
        low_value: f64,
        /// Which must be larger.
        high: &'static str,
        /// Its value.
        high_value: f64,
    },
    /// It would leave the window, or could not stop inside.
    #[error(
        "{pattern}: {key} {value} does not fit the window with its stopping distance; the largest \
         that fits is {largest}"
    )]
    TooLarge {
        /// Whose.
        pattern: &'static str,
        /// Which.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What would do.
        largest: f64,
    },
    /// Whatever its parameters, it would leave the window.
    #[error(
        "{pattern} does not fit the window ({width_m:.3} m by {height_m:.3} m) at any size or \
         speed; widen the field, or change its other parameters"
    )]
    NoRoom {
        /// Which.
        pattern: &'static str,
        /// Across (m).
        width_m: f64,
        /// Along (m).
        height_m: f64,
    },
    /// Above the speed limits.
    #[error(
        "{pattern}: speed_m_per_s {speed} passes limits.speed_m_per_s or \
         limits.total_speed_m_per_s; the largest here is {largest}"
    )]
    TooFast {
        /// Whose.
        pattern: &'static str,
        /// What was given (m/s).
        speed: f64,
        /// What would do (m/s).
        largest: f64,
    },
    /// Above the slew limit.
    #[error(
        "{pattern}: {key} {value} needs more than limits.slew_m_per_s2; the largest here is \
         {largest}"
    )]
    TooAbrupt {
        /// Whose.
        pattern: &'static str,
        /// Which.
        key: &'static str,
        /// What was given.
        value: f64,
        /// What would do.
        largest: f64,
    },
    /// Its speed is not reached within its length.
    #[error(
        "{pattern}: length_m {length} is too short to reach {speed} m/s; it needs {smallest} m, or \
         a smaller speed"
    )]
    TooShort {
        /// Whose.
        pattern: &'static str,
        /// What was given (m).
        length: f64,
        /// The speed (m/s).
        speed: f64,
        /// What would do (m).
        smallest: f64,
    },
    /// Faster than the grid can show.
    #[error(
        "{pattern}: f1_hz is {value}; at {rate_hz} commands a second the largest is {largest} Hz"
    )]
    FrequencyTooHigh {
        /// Whose.
        pattern: &'static str,
        /// What was given (Hz).
        value: f64,
        /// Commands per second (Hz).
        rate_hz: f64,
        /// What would do (Hz).
        largest: f64,
    },
    /// Two axes need more frequencies than the band has.
    #[error(
        "multisine: {lines} lines on each axis do not fit the band; with this period_s the most \
         is {largest} (0: widen the band or lengthen the period)"
    )]
    TooManyLines {
        /// What was given.
        lines: u32,
        /// What would do.
        largest: u32,
    },
    /// A rate of commands that cannot be.
    #[error("a rate of {rate_hz} Hz; it must lie in [10, 1000] Hz, the table has 50")]
    Rate {
        /// What was given (Hz).
        rate_hz: f64,
    },
    /// Too few or too many samples.
    #[error("{samples} samples; a run has 10 to 1000000")]
    Samples {
        /// What was given.
        samples: usize,
    },
    /// A point that is no number.
    #[error("a transfer from ({}, {}) to ({}, {}) m; both points must be finite", from[0], from[1], to[0], to[1])]
    Point {
        /// Start (m).
        from: [f64; 2],
        /// End (m).
        to: [f64; 2],
    },
}
