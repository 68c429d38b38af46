//! Summary of a recording and checks of its data quality.
//!
//! Every MCAP file is supported: topics, rates and dropouts of any file, and ranges of every number
//! of protobuf topics. Recordings of the contract also get runs, speeds, and the relation of motion
//! to command. Every limit is a constant with its reason, next to its check. The limits are wide on
//! purpose, so that a healthy recording with the jitter of real devices has no warning.

mod issue;
mod motion;
mod runs;
mod timing;
mod topics;
mod track;

use super::{
    BELT_METRES_PER_TURN, Channel, Recording, RecordingError,
    table::Table,
    topic::{self, Motor, Player},
};
use crate::units::Nanos;
pub use issue::{DataQualityIssue, QualityWarning};
use motion::GantryTracks;
pub use motion::SpeedReport;
pub use runs::RunReport;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
pub use timing::Timing;
use topics::TopicStudy;
pub use topics::{FieldReport, TopicReport};
use track::Track;

/// Version of the [`Inspection`] document.
pub const SCHEMA_VERSION: u32 = 2;

/// Metadata that must agree between files that are used together.
const ROBOT_KEYS: [&str; 2] = ["robot", "belt_metres_per_turn"];
/// Longest silence of a topic at the end (s). Recorders flush once a second, and the crash of one
/// writer costs up to that; twice that time has another cause.
const EARLY_STOP_S: f64 = 2.0;
/// Longest silence at the end in intervals of the topic.
const EARLY_STOP_INTERVALS: f64 = 10.0;
/// Longest silence at the end in multiples of the topic's longest dropout, for topics that pause
/// between runs.
const EARLY_STOP_DROPOUTS: f64 = 2.0;
/// Number of equal detections that excludes a coincidence: one second at 120 Hz, with noise or
/// rounding.
const MIN_CONSTANT_DETECTIONS: u64 = 120;

/// Summary of one file, as written by `klasktron info`. Times are relative to the earliest message
/// (s).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Version of this document, [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Path as given.
    pub file: String,
    /// Size of the file.
    pub bytes: u64,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
    /// Profile of the header: `klasktron` for the contract, `ros2` for bags.
    pub profile: String,
    /// Software that wrote the file.
    pub library: String,
    /// `hardware`, `virtual`, `simulation` or `import`.
    pub source: Option<String>,
    /// Session of the recording.
    pub session: Option<String>,
    /// `train` or `validation`.
    pub split: Option<String>,
    /// Name of the robot.
    pub robot: Option<String>,
    /// Metadata record `klasktron.recording`.
    pub metadata: BTreeMap<String, String>,
    /// Log time of the earliest message (ns); 0 without messages.
    pub start_ns: u64,
    /// From the earliest to the latest message (s).
    pub duration_s: f64,
    /// Messages of all topics.
    pub messages: u64,
    /// Each topic, in alphabetical order.
    pub topics: Vec<TopicReport>,
    /// Attachments of the file.
    pub attachments: Vec<AttachmentReport>,
    /// Scripted runs by their start.
    pub runs: Vec<RunReport>,
    /// Speeds per player and axis.
    pub speeds: Vec<SpeedReport>,
    /// Ranges on `/axis/...`.
    pub axes: Vec<AxisReport>,
    /// Warnings about the data quality.
    pub warnings: Vec<QualityWarning>,
}

/// Attachment of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AttachmentReport {
    /// Name.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Size.
    pub bytes: u64,
}

/// Range of one quantity of a single axis.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AxisReport {
    /// Name of the axis.
    pub axis: String,
    /// `input`, `position` or `velocity`.
    pub quantity: &'static str,
    /// Unit as recorded; that of a velocity is per second.
    pub unit: String,
    /// Smallest value, in that unit.
    pub min: f64,
    /// Largest value, in that unit.
    pub max: f64,
}

/// Inspect a whole recording.
///
/// # Errors
/// When a run marker or an axis message cannot be decoded.
pub fn inspect(recording: &Recording) -> Result<Inspection, RecordingError> {
    let (start, end) = recording.time_range().unwrap_or_default();
    let mut issues = file_issues(recording);
    let mut gantries: BTreeMap<Player, GantryTracks> = BTreeMap::new();
    let mut studied = Vec::new();
    for channels in by_topic_and_schema(recording) {
        let Some(mut topic) = topics::study(recording, &channels, start) else { continue };
        if let Some(table) = topic.table.take() {
            keep_tracks(&mut gantries, &table, start);
        }
        issues.append(&mut topic.issues);
        studied.push(topic);
    }
    let (runs, run_issues) = runs::find_runs(recording, (start, end))?;
    issues.extend(early_stops(&studied));
    issues.extend(dropouts(&studied, &runs));
    issues.extend(constant_ball(&studied));
    let axes = axis_reports(recording, &studied)?;
    issues.extend(run_issues);
    let (speeds, speed_issues) = check_gantries(recording, &gantries);
    issues.extend(speed_issues);
    issues.extend(contract_issues(recording, &studied, &speeds, &axes));
    let info = |key| recording.info(key).map(ToOwned::to_owned);
    Ok(Inspection {
        schema_version: SCHEMA_VERSION,
        file: recording.path.display().to_string(),
        bytes: recording.bytes,
        sha256: recording.sha256.clone(),
        profile: recording.profile.clone(),
        library: recording.library.clone(),
        source: info("source"),
        session: info("session"),
        split: info("split"),
        robot: info("robot"),
        metadata: recording.metadata.get(super::RECORDING_METADATA).cloned().unwrap_or_default(),
        start_ns: start.0,
        duration_s: end.seconds_since(start),
        messages: studied.iter().map(|topic| topic.report.messages).sum(),
        topics: studied.into_iter().map(|topic| topic.report).collect(),
        attachments: attachment_reports(recording),
        runs,
        speeds,
        axes,
        warnings: issues.into_iter().map(QualityWarning::from).collect(),
    })
}

/// Compare files that are used together: [`DataQualityIssue::MixedRobots`].
#[must_use]
pub fn compare(files: &[Inspection]) -> Vec<QualityWarning> {
    let differs = |key: &&str| {
        let values: BTreeSet<String> =
            files.iter().filter_map(|file| file.metadata.get(*key)).cloned().collect();
        (1 < values.len()).then(|| DataQualityIssue::MixedRobots {
            key: (*key).to_owned(),
            values: values.into_iter().collect(),
        })
    };
    ROBOT_KEYS.iter().filter_map(differs).map(QualityWarning::from).collect()
}

/// Return whether `topic` has the commands of a machine.
fn is_command(topic: &str) -> bool {
    matches!(topic::schema_of(topic), Some("klasktron.VelocityCommand" | "klasktron.AxisInput"))
        && !topic.starts_with("/truth/")
}

/// Return whether `topic` has the motion of a machine.
fn is_motion(topic: &str) -> bool {
    matches!(
        topic::schema_of(topic),
        Some("klasktron.CarriageState" | "klasktron.MotorState" | "klasktron.AxisOutput")
    ) && !topic.starts_with("/truth/")
}

/// Return whether `topic` has events, without a rate.
fn is_event(topic: &str) -> bool {
    matches!(topic::schema_of(topic), Some("klasktron.RunMarker" | "klasktron.MatchEvent"))
}

fn by_topic_and_schema(recording: &Recording) -> Vec<Vec<&Channel>> {
    let mut groups: BTreeMap<(&str, &str, &str), Vec<&Channel>> = BTreeMap::new();
    for channel in &recording.channels {
        let key = (channel.topic.as_str(), channel.schema.as_str(), channel.encoding.as_str());
        groups.entry(key).or_default().push(channel);
    }
    groups.into_values().collect()
}

fn keep_tracks(gantries: &mut BTreeMap<Player, GantryTracks>, table: &Table, start: Nanos) {
    for player in Player::BOTH {
        let name = table.topic.as_str();
        if name == topic::CAMERA_DETECTIONS {
            let columns = [format!("{player}.x"), format!("{player}.y")];
            gantries.entry(player).or_default().peg =
                Track::new(table, [columns[0].as_str(), columns[1].as_str()], start);
        } else if name == topic::command(player) {
            gantries.entry(player).or_default().command = Track::new(table, ["vx", "vy"], start);
        } else if name == topic::carriage(player) {
            gantries.entry(player).or_default().carriage =
                Track::new(table, ["x", "y", "vx", "vy"], start);
        }
        for motor in Motor::BOTH.into_iter().filter(|motor| name == topic::motor(player, *motor)) {
            let turns = Track::new(table, ["position_turns"], start).range(0);
            gantries
                .entry(player)
                .or_default()
                .motor_turns
                .extend(turns.map(|turns| (motor, turns)));
        }
    }
}

fn check_gantries(
    recording: &Recording,
    gantries: &BTreeMap<Player, GantryTracks>,
) -> (Vec<SpeedReport>, Vec<DataQualityIssue>) {
    let belt = recording.info("belt_metres_per_turn").and_then(|text| text.parse().ok());
    let mut speeds = Vec::new();
    let mut issues = Vec::new();
    for (player, tracks) in gantries {
        let found = motion::check(*player, tracks, belt.unwrap_or(BELT_METRES_PER_TURN));
        speeds.extend(found.0);
        issues.extend(found.1);
    }
    (speeds, issues)
}

fn file_issues(recording: &Recording) -> Vec<DataQualityIssue> {
    let loss = &recording.loss;
    let mut issues = Vec::new();
    if !loss.is_none() {
        issues.push(DataQualityIssue::Damaged {
            lost: loss.to_string(),
            cut_off_at_byte: loss.cut_off_at,
            bad_chunks: loss.bad_chunks,
            bad_records: loss.bad_records,
            bytes_lost: loss.bytes,
        });
    } else if !recording.ends_whole {
        issues.push(DataQualityIssue::NoSummary);
    }
    if recording.channels.iter().all(|channel| channel.messages.is_empty()) {
        issues.push(DataQualityIssue::NoMessages);
    }
    let session = recording.metadata.get(super::SESSION_METADATA);
    if let Some(session) = session
        && session.get("stop").is_some_and(|stop| stop != super::SESSION_COMPLETED)
    {
        let reason = session.get("stop_text").cloned().unwrap_or_default();
        issues.push(DataQualityIssue::SessionStopped { reason });
    }
    let mut schemas: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for channel in &recording.channels {
        schemas.entry(&channel.topic).or_default().insert(&channel.schema);
    }
    for (topic, names) in schemas.iter().filter(|(_, names)| 1 < names.len()) {
        issues.push(DataQualityIssue::SeveralSchemas {
            topic: (*topic).to_owned(),
            schemas: names.iter().map(|name| (*name).to_owned()).collect(),
        });
    }
    issues
}

fn early_stops(studied: &[TopicStudy]) -> Vec<DataQualityIssue> {
    let with_rate = || studied.iter().filter(|topic| topic.rhythm.period_s.is_some());
    let end_s = with_rate().map(|topic| topic.report.timing.last_s).fold(0.0, f64::max);
    let stops = with_rate().filter_map(|topic| {
        let last_s = topic.report.timing.last_s;
        let missing_s = end_s - last_s;
        let own_dropout = topic.report.timing.longest_dropout_s.unwrap_or_default();
        let limit = EARLY_STOP_S
            .max(EARLY_STOP_INTERVALS * topic.rhythm.period_s.unwrap_or_default())
            .max(EARLY_STOP_DROPOUTS * own_dropout);
        (limit < missing_s).then(|| DataQualityIssue::StopsEarly {
            topic: topic.report.topic.clone(),
            last_s,
            missing_s,
        })
    });
    stops.collect()
}

/// Find dropouts during runs. Without runs, all dropouts count, except those of commands, which
/// pause when nothing is commanded.
fn dropouts(studied: &[TopicStudy], runs: &[RunReport]) -> Vec<DataQualityIssue> {
    let longest_during_run = |dropout: &timing::Dropout| {
        let overlaps = runs.iter().map(|run| {
            let end_s = run.start_s + run.duration_s.unwrap_or_default();
            end_s.min(dropout.at_s + dropout.length_s) - run.start_s.max(dropout.at_s)
        });
        overlaps.fold(0.0, f64::max)
    };
    let issue = |topic: &TopicStudy| {
        let name = &topic.report.topic;
        let counts = |dropout: &&timing::Dropout| match runs {
            [] => !is_command(name),
            _ => topic.rhythm.dropout_s < longest_during_run(dropout),
        };
        let dropouts: Vec<_> = topic.rhythm.dropouts.iter().filter(counts).collect();
        let longest = dropouts.iter().max_by(|a, b| a.length_s.total_cmp(&b.length_s))?;
        Some(DataQualityIssue::Dropouts {
            topic: name.clone(),
            count: dropouts.len() as u64,
            longest_s: longest.length_s,
            longest_at_s: longest.at_s,
            median_interval_ms: topic.rhythm.period_s? * 1e3,
        })
    };
    studied.iter().filter(|topic| !is_event(&topic.report.topic)).filter_map(issue).collect()
}

/// Find a ball at a constant position in every frame. Pegs are checked by their commands, because
/// they may be parked.
fn constant_ball(studied: &[TopicStudy]) -> Vec<DataQualityIssue> {
    let is_constant = |field: &FieldReport| {
        MIN_CONSTANT_DETECTIONS <= field.messages && field.min == field.max && field.min.is_some()
    };
    let mut issues = Vec::new();
    for report in studied.iter().map(|topic| &topic.report) {
        if report.topic != topic::CAMERA_DETECTIONS {
            continue;
        }
        let of =
            |name| report.fields.iter().find(|field| field.field == name && is_constant(field));
        if let (Some(x), Some(_)) = (of("ball.x"), of("ball.y")) {
            issues.push(DataQualityIssue::SensorConstant {
                topic: report.topic.clone(),
                field: "ball".to_owned(),
                messages: x.messages,
            });
        }
    }
    issues
}

fn attachment_reports(recording: &Recording) -> Vec<AttachmentReport> {
    let report = |attachment: &super::Attachment| AttachmentReport {
        name: attachment.name.clone(),
        media_type: attachment.media_type.clone(),
        bytes: attachment.data.len() as u64,
    };
    recording.attachments.iter().map(report).collect()
}

fn axis_reports(
    recording: &Recording,
    studied: &[TopicStudy],
) -> Result<Vec<AxisReport>, RecordingError> {
    use super::message::{AxisInput, AxisOutput};
    let mut reports = Vec::new();
    for report in studied.iter().map(|topic| &topic.report) {
        let parts: Vec<&str> = report.topic.split('/').collect();
        let ["", "axis", name, side] = parts.as_slice() else { continue };
        // The unit is that of the first message.
        let unit = match *side {
            "input" => recording.first::<AxisInput>(&report.topic)?.map(|first| first.unit),
            _ => recording.first::<AxisOutput>(&report.topic)?.map(|first| first.position_unit),
        };
        let unit = unit.unwrap_or_default();
        for field in &report.fields {
            let (Some(min), Some(max)) = (field.min, field.max) else { continue };
            let (quantity, unit) = match field.field.as_str() {
                "value" => ("input", unit.clone()),
                "position" => ("position", unit.clone()),
                "velocity" => ("velocity", format!("{unit}/s")),
                _ => continue,
            };
            reports.push(AxisReport { axis: (*name).to_owned(), quantity, unit, min, max });
        }
    }
    Ok(reports)
}

/// Find missing content of a recording of the contract.
fn contract_issues(
    recording: &Recording,
    studied: &[TopicStudy],
    speeds: &[SpeedReport],
    axes: &[AxisReport],
) -> Vec<DataQualityIssue> {
    let has = |wanted: fn(&str) -> bool| {
        studied.iter().map(|topic| &topic.report).find(|r| wanted(&r.topic) && 0 < r.messages)
    };
    let mut issues = stuck_axes(axes);
    let Some(command) = has(is_command) else {
        if let Some(motion) = has(is_motion) {
            let expected = match motion.topic.strip_suffix("/output") {
                Some(axis) => format!("{axis}/input"),
                None => "/striker/{left,right}/command".to_owned(),
            };
            issues.push(DataQualityIssue::NoCommands { expected });
        }
        return issues;
    };
    let varies = |range: [f64; 2]| range[0] < range[1];
    let excited = speeds.iter().filter_map(|speed| speed.commanded_m_per_s).any(varies)
        || axes.iter().any(|axis| axis.quantity == "input" && axis.min < axis.max);
    if !excited && 1 < command.messages {
        issues.push(DataQualityIssue::NoExcitation);
    }
    let is_match = 0 < recording.count(topic::MATCH_EVENT);
    if recording.count(topic::RUN_MARKER) == 0 && !is_match {
        issues.push(DataQualityIssue::NoRunMarkers);
    }
    issues
}

/// Find single axes whose motion is constant while their input varies.
fn stuck_axes(axes: &[AxisReport]) -> Vec<DataQualityIssue> {
    let driven =
        |name: &str| axes.iter().any(|a| a.axis == name && a.quantity == "input" && a.min < a.max);
    let stuck = axes
        .iter()
        .filter(|axis| axis.quantity != "input" && axis.max <= axis.min && driven(&axis.axis));
    stuck
        .map(|axis| DataQualityIssue::AxisStuck {
            topic: topic::axis_output(&axis.axis),
            field: axis.quantity.to_owned(),
        })
        .collect()
}
