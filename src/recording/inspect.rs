//! What is in a recording, and what is doubtful about it.
//!
//! Works on every MCAP file: topics, rates and gaps of any, ranges of every number of protobuf
//! topics, and for recordings of the contract the runs, the speeds and whether motion follows
//! command. Every limit is a constant with its reason, beside the judgement that it serves; they
//! are wide on purpose, so that a healthy recording with the jitter of real devices has no doubt.

mod doubt;
mod motion;
mod runs;
mod timing;
mod topics;
mod track;

use super::{
    Channel, Recording, RecordingError,
    table::Table,
    topic::{self, Motor, Player},
};
use crate::units::Nanos;
pub use doubt::{Doubt, StatedDoubt};
use motion::GantryTracks;
pub use motion::SpeedReport;
pub use runs::RunReport;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
pub use timing::Timing;
use topics::Studied;
pub use topics::{FieldReport, TopicReport};
use track::Track;

/// Version of the [`Inspection`] document.
pub const SCHEMA_VERSION: u32 = 1;

/// Belt per turn of a motor (m) where the recording's metadata do not tell: GT2, 20 teeth.
const BELT_METRES_PER_TURN: f64 = 0.04;
/// Metadata that must agree between files that are used together.
const ROBOT_KEYS: [&str; 2] = ["robot", "belt_metres_per_turn"];
/// A topic may be silent this long at the end (s): recorders flush once a second, and a crash of
/// one writer costs up to that; twice it is something else.
const EARLY_STOP_S: f64 = 2.0;
/// And this many of its own intervals.
const EARLY_STOP_INTERVALS: f64 = 10.0;
/// And this many times its own largest gap, for topics that pause between runs.
const EARLY_STOP_GAPS: f64 = 2.0;
/// As many equal detections are no coincidence: one second at 120 Hz, with noise or rounding.
const MIN_CONSTANT_DETECTIONS: u64 = 120;

/// Everything that `klasktron info` tells about one file. Times are relative to the earliest
/// message (s).
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Inspection {
    /// Version of this document, [`SCHEMA_VERSION`].
    pub schema_version: u32,
    /// Path as it was given.
    pub file: String,
    /// Size of the file.
    pub bytes: u64,
    /// SHA-256 of the file, in hexadecimal.
    pub sha256: String,
    /// Profile of the header: `klasktron` for the contract, `ros2` for bags.
    pub profile: String,
    /// Software that wrote it.
    pub library: String,
    /// `hardware`, `virtual`, `simulation` or `import`.
    pub source: Option<String>,
    /// Session it belongs to.
    pub session: Option<String>,
    /// `train` or `validation`.
    pub split: Option<String>,
    /// Name of the robot.
    pub robot: Option<String>,
    /// The whole metadata record `klasktron.recording`.
    pub metadata: BTreeMap<String, String>,
    /// Log time of the earliest message (ns); 0 without messages.
    pub start_ns: u64,
    /// From the earliest to the latest message (s).
    pub duration_s: f64,
    /// Messages of all topics.
    pub messages: u64,
    /// Each topic, in alphabetical order.
    pub topics: Vec<TopicReport>,
    /// Binary parts.
    pub attachments: Vec<AttachmentReport>,
    /// Scripted runs by their start.
    pub runs: Vec<RunReport>,
    /// Speeds per player and axis.
    pub speeds: Vec<SpeedReport>,
    /// Ranges on `/axis/...`.
    pub axes: Vec<AxisReport>,
    /// What is doubtful.
    pub doubts: Vec<StatedDoubt>,
}

/// A binary part of the file.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AttachmentReport {
    /// Its name.
    pub name: String,
    /// Its media type.
    pub media_type: String,
    /// Its size.
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

/// Looks at a whole recording.
///
/// # Errors
/// When a run marker or an axis message does not decode as the contract says.
pub fn inspect(recording: &Recording) -> Result<Inspection, RecordingError> {
    let (start, end) = recording.time_range().unwrap_or_default();
    let mut doubts = file_doubts(recording);
    let mut gantries: BTreeMap<Player, GantryTracks> = BTreeMap::new();
    let mut studied = Vec::new();
    for channels in by_topic_and_schema(recording) {
        let Some(mut topic) = topics::study(recording, &channels, start) else { continue };
        if let Some(table) = topic.table.take() {
            keep_tracks(&mut gantries, &table, start);
        }
        doubts.append(&mut topic.doubts);
        studied.push(topic);
    }
    let (runs, run_doubts) = runs::find_runs(recording, (start, end))?;
    doubts.extend(early_stops(&studied));
    doubts.extend(large_gaps(&studied, &runs));
    doubts.extend(constant_ball(&studied));
    let axes = axis_reports(recording, &studied)?;
    doubts.extend(run_doubts);
    let (speeds, speed_doubts) = judge_gantries(recording, &gantries);
    doubts.extend(speed_doubts);
    doubts.extend(contract_doubts(recording, &studied, &speeds, &axes));
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
        doubts: doubts.into_iter().map(StatedDoubt::from).collect(),
    })
}

/// What is doubtful about files that are used together: [`Doubt::MixedRobots`].
#[must_use]
pub fn compare(files: &[Inspection]) -> Vec<StatedDoubt> {
    let differs = |key: &&str| {
        let values: BTreeSet<String> =
            files.iter().filter_map(|file| file.metadata.get(*key)).cloned().collect();
        (1 < values.len()).then(|| Doubt::MixedRobots {
            key: (*key).to_owned(),
            values: values.into_iter().collect(),
        })
    };
    ROBOT_KEYS.iter().filter_map(differs).map(StatedDoubt::from).collect()
}

/// Whether `topic` carries what a machine is told to do.
fn is_command(topic: &str) -> bool {
    matches!(topic::schema_of(topic), Some("klasktron.VelocityCommand" | "klasktron.AxisInput"))
        && !topic.starts_with("/truth/")
}

/// Whether `topic` carries what a machine does.
fn is_motion(topic: &str) -> bool {
    matches!(
        topic::schema_of(topic),
        Some("klasktron.CarriageState" | "klasktron.MotorState" | "klasktron.AxisOutput")
    ) && !topic.starts_with("/truth/")
}

/// Whether messages of `topic` come when something happens, so that it has no rate.
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

fn judge_gantries(
    recording: &Recording,
    gantries: &BTreeMap<Player, GantryTracks>,
) -> (Vec<SpeedReport>, Vec<Doubt>) {
    let belt = recording.info("belt_metres_per_turn").and_then(|text| text.parse().ok());
    let mut speeds = Vec::new();
    let mut doubts = Vec::new();
    for (player, tracks) in gantries {
        let judged = motion::judge(*player, tracks, belt.unwrap_or(BELT_METRES_PER_TURN));
        speeds.extend(judged.0);
        doubts.extend(judged.1);
    }
    (speeds, doubts)
}

fn file_doubts(recording: &Recording) -> Vec<Doubt> {
    let loss = &recording.loss;
    let mut doubts = Vec::new();
    if !loss.is_none() {
        doubts.push(Doubt::Damaged {
            lost: loss.to_string(),
            cut_off_at_byte: loss.cut_off_at,
            bad_chunks: loss.bad_chunks,
            bad_records: loss.bad_records,
            bytes_lost: loss.bytes,
        });
    } else if !recording.ends_whole {
        doubts.push(Doubt::NoSummary);
    }
    if recording.channels.iter().all(|channel| channel.messages.is_empty()) {
        doubts.push(Doubt::NoMessages);
    }
    let session = recording.metadata.get(super::SESSION_METADATA);
    if let Some(session) = session
        && session.get("stop").is_some_and(|stop| stop != super::SESSION_COMPLETED)
    {
        let reason = session.get("stop_text").cloned().unwrap_or_default();
        doubts.push(Doubt::SessionStopped { reason });
    }
    let mut schemas: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for channel in &recording.channels {
        schemas.entry(&channel.topic).or_default().insert(&channel.schema);
    }
    for (topic, names) in schemas.iter().filter(|(_, names)| 1 < names.len()) {
        doubts.push(Doubt::SeveralSchemas {
            topic: (*topic).to_owned(),
            schemas: names.iter().map(|name| (*name).to_owned()).collect(),
        });
    }
    doubts
}

fn early_stops(studied: &[Studied]) -> Vec<Doubt> {
    let with_rate = || studied.iter().filter(|topic| topic.rhythm.period_s.is_some());
    let end_s = with_rate().map(|topic| topic.report.timing.last_s).fold(0.0, f64::max);
    let stops = with_rate().filter_map(|topic| {
        let last_s = topic.report.timing.last_s;
        let missing_s = end_s - last_s;
        let own_gap = topic.report.timing.largest_gap_s.unwrap_or_default();
        let limit = EARLY_STOP_S
            .max(EARLY_STOP_INTERVALS * topic.rhythm.period_s.unwrap_or_default())
            .max(EARLY_STOP_GAPS * own_gap);
        (limit < missing_s).then(|| Doubt::StopsEarly {
            topic: topic.report.topic.clone(),
            last_s,
            missing_s,
        })
    });
    stops.collect()
}

/// Gaps during runs; of a recording without runs all gaps, but those of commands, which pause when
/// nobody commands.
fn large_gaps(studied: &[Studied], runs: &[RunReport]) -> Vec<Doubt> {
    let longest_during_run = |gap: &timing::Gap| {
        let overlaps = runs.iter().map(|run| {
            let end_s = run.start_s + run.duration_s.unwrap_or_default();
            end_s.min(gap.at_s + gap.length_s) - run.start_s.max(gap.at_s)
        });
        overlaps.fold(0.0, f64::max)
    };
    let doubt = |topic: &Studied| {
        let name = &topic.report.topic;
        let counts = |gap: &&timing::Gap| match runs {
            [] => !is_command(name),
            _ => topic.rhythm.large_gap_s < longest_during_run(gap),
        };
        let gaps: Vec<_> = topic.rhythm.gaps.iter().filter(counts).collect();
        let largest = gaps.iter().max_by(|a, b| a.length_s.total_cmp(&b.length_s))?;
        Some(Doubt::LargeGap {
            topic: name.clone(),
            count: gaps.len() as u64,
            largest_s: largest.length_s,
            at_s: largest.at_s,
            usual_ms: topic.rhythm.period_s? * 1e3,
        })
    };
    studied.iter().filter(|topic| !is_event(&topic.report.topic)).filter_map(doubt).collect()
}

/// A ball that has one and the same place in every frame. Pegs are judged by their commands: they
/// may be parked.
fn constant_ball(studied: &[Studied]) -> Vec<Doubt> {
    let is_constant = |field: &FieldReport| {
        MIN_CONSTANT_DETECTIONS <= field.messages && field.min == field.max && field.min.is_some()
    };
    let mut doubts = Vec::new();
    for report in studied.iter().map(|topic| &topic.report) {
        if report.topic != topic::CAMERA_DETECTIONS {
            continue;
        }
        let of =
            |name| report.fields.iter().find(|field| field.field == name && is_constant(field));
        if let (Some(x), Some(_)) = (of("ball.x"), of("ball.y")) {
            doubts.push(Doubt::SensorConstant {
                topic: report.topic.clone(),
                field: "ball".to_owned(),
                messages: x.messages,
            });
        }
    }
    doubts
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
    studied: &[Studied],
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

/// What a recording of the contract should have and has not.
fn contract_doubts(
    recording: &Recording,
    studied: &[Studied],
    speeds: &[SpeedReport],
    axes: &[AxisReport],
) -> Vec<Doubt> {
    let has = |wanted: fn(&str) -> bool| {
        studied.iter().map(|topic| &topic.report).find(|r| wanted(&r.topic) && 0 < r.messages)
    };
    let mut doubts = stuck_axes(axes);
    let Some(command) = has(is_command) else {
        if let Some(motion) = has(is_motion) {
            let expected = match motion.topic.strip_suffix("/output") {
                Some(axis) => format!("{axis}/input"),
                None => "/striker/{left,right}/command".to_owned(),
            };
            doubts.push(Doubt::NoCommands { expected });
        }
        return doubts;
    };
    let varies = |range: [f64; 2]| range[0] < range[1];
    let excited = speeds.iter().filter_map(|speed| speed.commanded_m_per_s).any(varies)
        || axes.iter().any(|axis| axis.quantity == "input" && axis.min < axis.max);
    if !excited && 1 < command.messages {
        doubts.push(Doubt::NoExcitation);
    }
    let is_match = 0 < recording.count(topic::MATCH_EVENT);
    if recording.count(topic::RUN_MARKER) == 0 && !is_match {
        doubts.push(Doubt::NoRunMarkers);
    }
    doubts
}

/// Single axes whose motion stands still while their input varies.
fn stuck_axes(axes: &[AxisReport]) -> Vec<Doubt> {
    let driven =
        |name: &str| axes.iter().any(|a| a.axis == name && a.quantity == "input" && a.min < a.max);
    let stuck = axes
        .iter()
        .filter(|axis| axis.quantity != "input" && axis.max <= axis.min && driven(&axis.axis));
    stuck
        .map(|axis| Doubt::AxisStuck {
            topic: topic::axis_output(&axis.axis),
            field: axis.quantity.to_owned(),
        })
        .collect()
}
