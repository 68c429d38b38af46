//! Data-quality issues of a recording: a closed list, each with a sentence about the remedy.

use super::super::topic::Player;
use serde::Serialize;

/// Data-quality issue of a recording.
#[derive(Debug, Clone, PartialEq, Serialize, thiserror::Error)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum DataQualityIssue {
    /// The file is truncated or damaged.
    #[error("{lost}; write the readable part to a complete file with `klasktron recover`")]
    Damaged {
        /// Description of the loss.
        lost: String,
        /// Offset at which the file ends too early (bytes from its start).
        cut_off_at_byte: Option<u64>,
        /// Number of chunks that cannot be decompressed or fail their checksum.
        bad_chunks: u64,
        /// Number of records that could not be decoded.
        bad_records: u64,
        /// Number of bytes without content.
        bytes_lost: u64,
    },
    /// All messages are complete, but the summary after them is missing.
    #[error(
        "the file ends without its summary: every message is complete, but other readers refuse it; \
         write a complete file with `klasktron recover`"
    )]
    NoSummary,
    /// The recording session was stopped before its end.
    #[error("the session was stopped: {reason}; its last run is not complete")]
    SessionStopped {
        /// Reason.
        reason: String,
    },
    /// The file has no message.
    #[error("the file has no message; record it again")]
    NoMessages,
    /// A topic stops well before the others.
    #[error(
        "{topic} stops {missing_s:.1} s before the end; use the first {last_s:.1} s only, and check \
         that device's cable and power"
    )]
    StopsEarly {
        /// The topic.
        topic: String,
        /// Time of its last message (s).
        last_s: f64,
        /// Time from its last message to the end (s).
        missing_s: f64,
    },
    /// Log times decrease within a topic.
    #[error(
        "time runs backwards on {topic}: {steps} steps, the largest {largest_step_s:.3} s; readers \
         sort by time, so check the host's clock (NTP) and record again when order matters"
    )]
    TimeBackwards {
        /// The topic.
        topic: String,
        /// Number of steps.
        steps: u64,
        /// Largest step back (s).
        largest_step_s: f64,
    },
    /// A sensor is constant while its axis is commanded to move.
    #[error(
        "{topic} {field} never moves although {commanded_m:.2} m of travel are commanded; check \
         the sensor, its topic and that the drive was enabled"
    )]
    SensorStuck {
        /// The topic.
        topic: String,
        /// Field of the topic.
        field: String,
        /// Commanded travel along that field (m).
        commanded_m: f64,
    },
    /// A single axis is constant while its input varies.
    #[error(
        "{topic} {field} never changes although the input does; check the sensor and the drive"
    )]
    AxisStuck {
        /// The topic.
        topic: String,
        /// Field of the topic.
        field: String,
    },
    /// A sensor repeats one value, without the noise of a live sensor.
    #[error("{topic} {field} has one value in all {messages} messages; check that it is alive")]
    SensorConstant {
        /// The topic.
        topic: String,
        /// Field of the topic.
        field: String,
        /// Number of messages with the value.
        messages: u64,
    },
    /// Values are NaN or infinite.
    #[error(
        "{topic} {field} is NaN or infinite in {count} messages; exclude these and repair their \
         source"
    )]
    NonFinite {
        /// The topic.
        topic: String,
        /// Field of the topic.
        field: String,
        /// Number of messages.
        count: u64,
    },
    /// A message cannot be decoded with its schema.
    #[error("{topic}: {reason}; it is counted, but its values are not checked")]
    NotDecodable {
        /// The topic.
        topic: String,
        /// Error of the decoder.
        reason: String,
    },
    /// Motion is recorded, but no command.
    #[error(
        "motion is recorded, but no command: record {expected} as well, an actuator model cannot \
         be fitted without it"
    )]
    NoCommands {
        /// Missing topic.
        expected: String,
    },
    /// Commands never change.
    #[error("the commands never change, so the drive is not identifiable; excite it")]
    NoExcitation,
    /// Commands have no markers of runs.
    #[error(
        "no run markers on /run/marker: data cannot be split by run; split by session instead, or \
         write a START and an END for each run"
    )]
    NoRunMarkers,
    /// Messages have equal stamps and bytes.
    #[error(
        "{topic} has {count} duplicate messages with equal stamp and bytes; remove one of each"
    )]
    Duplicates {
        /// The topic.
        topic: String,
        /// Number of copies.
        count: u64,
    },
    /// A topic with a rate has dropouts.
    #[error(
        "{topic} has {count} dropouts, the longest {longest_s:.2} s at {longest_at_s:.2} s; the \
         median interval is {median_interval_ms:.1} ms; exclude these times from a fit"
    )]
    Dropouts {
        /// The topic.
        topic: String,
        /// Number of dropouts.
        count: u64,
        /// Longest dropout (s).
        longest_s: f64,
        /// Start of the longest dropout (s).
        longest_at_s: f64,
        /// Median interval (ms).
        median_interval_ms: f64,
    },
    /// A run starts and never ends.
    #[error("run {run} ({pattern}) starts at {start_s:.1} s and has no END; exclude it")]
    RunWithoutEnd {
        /// Number of the run.
        run: u32,
        /// Pattern of the run.
        pattern: String,
        /// Start of the run (s).
        start_s: f64,
    },
    /// A run ends and never started.
    #[error("run {run} ({pattern}) ends at {end_s:.1} s and has no START; exclude it")]
    RunWithoutStart {
        /// Number of the run.
        run: u32,
        /// Pattern of the run.
        pattern: String,
        /// End of the run (s).
        end_s: f64,
    },
    /// A run has fewer than two samples.
    #[error("run {run} ({pattern}) has {samples} samples, and a velocity needs two; exclude it")]
    RunTooShort {
        /// Number of the run.
        run: u32,
        /// Pattern of the run.
        pattern: String,
        /// Number of messages in the run.
        samples: u64,
    },
    /// A topic has messages of several types.
    #[error("{topic} has several schemas ({}); give each its own topic", schemas.join(", "))]
    SeveralSchemas {
        /// The topic.
        topic: String,
        /// Full names of the schemas.
        schemas: Vec<String>,
    },
    /// The recording is older than the commander's factor-two fix.
    #[error(
        "the {player} carriage moves {slope:.2} times as fast as commanded along {axis}: recorded \
         before the factor-two fix of the commander? do not mix it with later recordings"
    )]
    TwiceTheCommand {
        /// Player.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Ratio of measured to commanded velocity.
        slope: f64,
    },
    /// The sign of an axis is wrong.
    #[error(
        "the {player} carriage moves against its command along {axis} (slope {slope:.2}): check the \
         sign of that axis in the frame transform or the motor signs in the robot file"
    )]
    Mirrored {
        /// Player.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Ratio of measured to commanded velocity.
        slope: f64,
    },
    /// The axes are swapped: commands along x move y.
    #[error(
        "the {player} carriage moves along y when x is commanded and the other way round: one of \
         both is still in the image frame, convert it (x = y_img - 0.16, y = x_img - 0.21)"
    )]
    AxesSwapped {
        /// Player.
        player: Player,
    },
    /// Motion and command are uncorrelated.
    #[error(
        "command and motion of the {player} carriage are uncorrelated along {axis} (variance explained: \
         {variance_explained_percent:.0} %); check that both are of one player and \
         one clock"
    )]
    Uncorrelated {
        /// Player.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Variance explained by the command (%).
        variance_explained_percent: f64,
    },
    /// Camera and encoders disagree on the scale of motion.
    #[error(
        "the camera sees the {player} peg move {scale:.3} m along {axis} for each metre of the \
         encoders: check the board length (0.42 or 0.44 m) that the camera was set to"
    )]
    CameraScale {
        /// Player.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Ratio of camera to encoder displacement.
        scale: f64,
    },
    /// Files of several robots are used together.
    #[error("the files differ in {key} ({}); do not fit them together", values.join(", "))]
    MixedRobots {
        /// Key of the metadata record.
        key: String,
        /// Values that occur, in alphabetical order.
        values: Vec<String>,
    },
}

/// Data-quality issue with its sentence, as written in documents.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct QualityWarning {
    /// Issue.
    #[serde(flatten)]
    pub issue: DataQualityIssue,
    /// Meaning of the issue and its remedy.
    pub message: String,
}

impl From<DataQualityIssue> for QualityWarning {
    fn from(issue: DataQualityIssue) -> Self {
        let message = issue.to_string();
        Self { issue, message }
    }
}
