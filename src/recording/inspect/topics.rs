//! Report of one topic: number and timing of messages, and the range of each number.

use super::{
    super::{
        Channel, PROTOBUF, Recording, RecordingError,
        table::{self, Column, Selection, Table},
    },
    issue::DataQualityIssue,
    timing::{self, Rhythm, Timing},
};
use crate::units::Nanos;
use serde::Serialize;

/// Largest step back that is due to the order of threads of one recorder (s).
const BACKWARD_TOLERANCE_S: f64 = 1e-3;

/// Report of all messages of one topic with one schema.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicReport {
    /// Topic name.
    pub topic: String,
    /// Full name of the schema; empty without a schema.
    pub schema: String,
    /// Encoding of the messages, such as `protobuf` or `cdr`.
    pub encoding: String,
    /// Number of messages.
    pub messages: u64,
    /// Timing of the messages.
    #[serde(flatten)]
    pub timing: Timing,
    /// Number of messages with the log time and bytes of an earlier one.
    pub duplicates: u64,
    /// Range of each number, of protobuf topics; units are those of the schema.
    pub fields: Vec<FieldReport>,
}

/// Range of one number of a topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldReport {
    /// Name of the field, `ball.x` for one in a nested message.
    pub field: String,
    /// Number of messages with the field.
    pub messages: u64,
    /// Smallest finite value.
    pub min: Option<f64>,
    /// Largest finite value.
    pub max: Option<f64>,
    /// Number of messages with NaN or infinity.
    pub non_finite: u64,
}

/// Report of a topic with intermediate results for other checks.
pub(super) struct TopicStudy {
    pub(super) report: TopicReport,
    pub(super) rhythm: Rhythm,
    /// Numbers of a decodable protobuf topic.
    pub(super) table: Option<Table>,
    pub(super) issues: Vec<DataQualityIssue>,
}

/// Inspect `channels`, which have one topic and one schema.
pub(super) fn study(
    recording: &Recording,
    channels: &[&Channel],
    start: Nanos,
) -> Option<TopicStudy> {
    let first = channels.first()?;
    let times: Vec<Nanos> =
        channels.iter().flat_map(|c| c.messages.iter().map(|m| m.log_time)).collect();
    let (mut timing, rhythm) = timing::measure(&times, start);
    if super::is_event(&first.topic) {
        (timing.measured_rate_hz, timing.jitter_ms) = (None, None);
        (timing.longest_dropout_s, timing.longest_dropout_at_s) = (None, None);
    }
    let (table, fields, mut issues) = study_values(recording, channels);
    let report = TopicReport {
        topic: first.topic.clone(),
        schema: first.schema.clone(),
        encoding: first.encoding.clone(),
        messages: times.len() as u64,
        timing,
        duplicates: count_duplicates(channels),
        fields,
    };
    issues.extend(issues_of(&report));
    Some(TopicStudy { report, rhythm, table, issues })
}

fn study_values(
    recording: &Recording,
    channels: &[&Channel],
) -> (Option<Table>, Vec<FieldReport>, Vec<DataQualityIssue>) {
    match table::read_channels(recording, channels, Selection::Numbers) {
        Ok(table) => {
            let fields = table.columns.iter().map(field_report).collect();
            (Some(table), fields, vec![])
        }
        // Bags and others are described without their values.
        Err(RecordingError::NotTabular { .. })
            if channels.iter().all(|c| c.encoding != PROTOBUF) =>
        {
            (None, vec![], vec![])
        }
        Err(error) => {
            let topic = channels[0].topic.clone();
            let reason = error.to_string();
            let file = format!("{}: ", recording.path.display());
            let reason = reason.strip_prefix(&file).unwrap_or(&reason).to_owned();
            (None, vec![], vec![DataQualityIssue::NotDecodable { topic, reason }])
        }
    }
}

fn field_report(column: &Column) -> FieldReport {
    let mut report = FieldReport {
        field: column.name.clone(),
        messages: 0,
        min: None,
        max: None,
        non_finite: 0,
    };
    column.for_each_number(&mut |value| {
        report.messages += 1;
        if value.is_finite() {
            report.min = Some(report.min.map_or(value, |min| min.min(value)));
            report.max = Some(report.max.map_or(value, |max| max.max(value)));
        } else {
            report.non_finite += 1;
        }
    });
    report
}

fn issues_of(report: &TopicReport) -> Vec<DataQualityIssue> {
    let topic = || report.topic.clone();
    let mut issues = Vec::new();
    if BACKWARD_TOLERANCE_S < report.timing.largest_backward_step_s {
        issues.push(DataQualityIssue::TimeBackwards {
            topic: topic(),
            steps: report.timing.backward_steps,
            largest_step_s: report.timing.largest_backward_step_s,
        });
    }
    if 0 < report.duplicates {
        issues.push(DataQualityIssue::Duplicates { topic: topic(), count: report.duplicates });
    }
    for field in report.fields.iter().filter(|field| 0 < field.non_finite) {
        issues.push(DataQualityIssue::NonFinite {
            topic: topic(),
            field: field.field.clone(),
            count: field.non_finite,
        });
    }
    issues
}

/// Count the messages with the log time and bytes of an earlier one.
fn count_duplicates(channels: &[&Channel]) -> u64 {
    let mut stamped: Vec<(Nanos, &[u8])> = channels
        .iter()
        .flat_map(|c| c.raw().map(|(index, bytes)| (index.log_time, bytes)))
        .collect();
    if !stamped.is_sorted_by_key(|(time, _)| *time) {
        stamped.sort_by_key(|(time, _)| *time);
    }
    let mut duplicates = 0;
    for same_time in stamped.chunk_by_mut(|a, b| a.0 == b.0).filter(|group| 1 < group.len()) {
        same_time.sort_unstable();
        duplicates += same_time.windows(2).filter(|pair| pair[0].1 == pair[1].1).count() as u64;
    }
    duplicates
}
