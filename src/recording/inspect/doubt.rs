//! What is doubtful about a recording: a closed list, each a sentence that tells what to do.

use super::super::topic::Player;
use serde::Serialize;

/// One reason not to trust a recording blindly.
#[derive(Debug, Clone, PartialEq, Serialize, thiserror::Error)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Doubt {
    /// The file is cut off or damaged.
    #[error("{lost}; make a whole file of the rest with `klasktron recover`")]
    Damaged {
        /// What was lost, as a sentence.
        lost: String,
        /// Where the file ends too early (bytes from its start).
        cut_off_at_byte: Option<u64>,
        /// Chunks that do not unpack or fail their checksum.
        bad_chunks: u64,
        /// Records that could not be understood.
        bad_records: u64,
        /// Bytes that yielded nothing.
        bytes_lost: u64,
    },
    /// All messages are there, but not the summary behind them.
    #[error(
        "the file ends without its summary: every message is here, but other readers refuse it; \
         write a whole one with `klasktron recover`"
    )]
    NoSummary,
    /// The session that recorded it was stopped before its end.
    #[error("the session was stopped: {reason}; its last run is not complete")]
    SessionStopped {
        /// Why.
        reason: String,
    },
    /// No message at all.
    #[error("the file holds no message; record it again")]
    NoMessages,
    /// A topic falls silent well before the others.
    #[error(
        "{topic} stops {missing_s:.1} s before the end; use the first {last_s:.1} s only, and check \
         that device's cable and power"
    )]
    StopsEarly {
        /// The topic.
        topic: String,
        /// Its last message (s).
        last_s: f64,
        /// From there to the end (s).
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
        /// How often.
        steps: u64,
        /// The largest step back (s).
        largest_step_s: f64,
    },
    /// A sensor stands still while its axis is commanded to move.
    #[error(
        "{topic} {field} never moves although {commanded_m:.2} m of travel are commanded; check \
         the sensor, its topic and that the drive was enabled"
    )]
    SensorStuck {
        /// The topic.
        topic: String,
        /// Its field.
        field: String,
        /// Commanded travel along that field (m).
        commanded_m: f64,
    },
    /// A single axis stands still while its input varies.
    #[error(
        "{topic} {field} never changes although the input does; check the sensor and the drive"
    )]
    AxisStuck {
        /// The topic.
        topic: String,
        /// Its field.
        field: String,
    },
    /// A live sensor has noise; this one repeats one value.
    #[error("{topic} {field} has one value in all {messages} messages; check that it is alive")]
    SensorConstant {
        /// The topic.
        topic: String,
        /// Its field.
        field: String,
        /// How many messages carry it.
        messages: u64,
    },
    /// NaN or infinity.
    #[error(
        "{topic} {field} is NaN or infinite in {count} messages; leave those out and mend what \
         writes them"
    )]
    NonFinite {
        /// The topic.
        topic: String,
        /// Its field.
        field: String,
        /// How many messages.
        count: u64,
    },
    /// A message does not decode as its schema says.
    #[error("{topic}: {reason}; it counts, but its values are not judged")]
    NotDecodable {
        /// The topic.
        topic: String,
        /// The decoder's sentence.
        reason: String,
    },
    /// Motion is measured, but no command is recorded.
    #[error(
        "motion is recorded, but no command: record {expected} as well, an actuator model cannot \
         be fitted without"
    )]
    NoCommands {
        /// The topic that is missing.
        expected: String,
    },
    /// There are commands, but they never change.
    #[error("no command ever changes, so nothing can be learnt about the drive; excite it")]
    NoExcitation,
    /// Commands without a start and end of runs.
    #[error(
        "no run markers on /run/marker: data cannot be split by run; split by session instead, or \
         write a START and an END for each run"
    )]
    NoRunMarkers,
    /// Equal messages with equal stamps.
    #[error("{topic} holds {count} messages twice, stamp and bytes; drop one of each")]
    Duplicates {
        /// The topic.
        topic: String,
        /// How many are copies.
        count: u64,
    },
    /// Time without messages on a topic that has a rate.
    #[error(
        "{topic} has {count} large gaps, the largest {largest_s:.2} s at {at_s:.2} s where {usual_ms:.1} \
         ms are usual; leave these times out of a fit"
    )]
    LargeGap {
        /// The topic.
        topic: String,
        /// How many.
        count: u64,
        /// The largest (s).
        largest_s: f64,
        /// Where it begins (s).
        at_s: f64,
        /// The middle interval (ms).
        usual_ms: f64,
    },
    /// A run that starts and never ends.
    #[error("run {run} ({pattern}) starts at {start_s:.1} s and has no END; leave it out")]
    RunWithoutEnd {
        /// Its number.
        run: u32,
        /// Its pattern.
        pattern: String,
        /// Its start (s).
        start_s: f64,
    },
    /// A run that ends and never started.
    #[error("run {run} ({pattern}) ends at {end_s:.1} s and has no START; leave it out")]
    RunWithoutStart {
        /// Its number.
        run: u32,
        /// Its pattern.
        pattern: String,
        /// Its end (s).
        end_s: f64,
    },
    /// A run with one sample or none.
    #[error(
        "run {run} ({pattern}) holds {samples} samples, and a velocity needs two; leave it out"
    )]
    RunTooShort {
        /// Its number.
        run: u32,
        /// Its pattern.
        pattern: String,
        /// Messages within it.
        samples: u64,
    },
    /// Messages of several types on one topic.
    #[error("{topic} carries several schemas ({}); give each its own topic", schemas.join(", "))]
    SeveralSchemas {
        /// The topic.
        topic: String,
        /// Their full names.
        schemas: Vec<String>,
    },
    /// Recorded before the commander's factor-two fix.
    #[error(
        "the {player} carriage moves {slope:.2} times as fast as commanded along {axis}: recorded \
         before the factor-two fix of the commander? do not mix it with later recordings"
    )]
    TwiceTheCommand {
        /// Whose carriage.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Measured over commanded velocity.
        slope: f64,
    },
    /// A sign is wrong.
    #[error(
        "the {player} carriage moves against its command along {axis} (slope {slope:.2}): check the \
         sign of that axis in the frame transform or the motor signs in the robot file"
    )]
    Mirrored {
        /// Whose carriage.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Measured over commanded velocity.
        slope: f64,
    },
    /// Commands along x move y and the other way round.
    #[error(
        "the {player} carriage moves along y when x is commanded and the other way round: one of \
         both is still in the image frame, convert it (x = y_img - 0.16, y = x_img - 0.21)"
    )]
    AxesSwapped {
        /// Whose carriage.
        player: Player,
    },
    /// The motion is not that of the command.
    #[error(
        "command and motion of the {player} carriage are unrelated along {axis} (the command \
         explains {explained_percent:.0} % of the motion); check that both are of one player and \
         one clock"
    )]
    Unrelated {
        /// Whose carriage.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Share of the motion's variance (%).
        explained_percent: f64,
    },
    /// Camera and encoders disagree about the length of a metre.
    #[error(
        "the camera sees the {player} peg move {scale:.3} m along {axis} for each metre of the \
         encoders: check the board length (0.42 or 0.44 m) that the camera was set to"
    )]
    CameraScale {
        /// Whose peg.
        player: Player,
        /// `x` or `y`.
        axis: char,
        /// Camera over encoder displacement.
        scale: f64,
    },
    /// Files of several robots are looked at together.
    #[error("the files differ in {key} ({}); do not fit them together", values.join(", "))]
    MixedRobots {
        /// Key of the metadata record.
        key: String,
        /// The values that occur, in alphabetical order.
        values: Vec<String>,
    },
}

/// A doubt with its sentence, as documents carry it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StatedDoubt {
    /// What it is.
    #[serde(flatten)]
    pub doubt: Doubt,
    /// What it means and what to do.
    pub sentence: String,
}

impl From<Doubt> for StatedDoubt {
    fn from(doubt: Doubt) -> Self {
        let sentence = doubt.to_string();
        Self { doubt, sentence }
    }
}
