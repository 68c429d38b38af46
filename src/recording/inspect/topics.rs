//! One topic: how many messages, when, and the range of each of its numbers.

use super::{
    super::{
        Channel, PROTOBUF, Recording, RecordingError,
        table::{self, Column, Selection, Table},
    },
    doubt::Doubt,
    timing::{self, Rhythm, Timing},
};
use crate::units::Nanos;
use serde::Serialize;

/// A smaller step back is the order in which threads of one recorder reach the file (s).
const BACKWARD_TOLERANCE_S: f64 = 1e-3;

/// All messages of one topic with one schema.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicReport {
    /// Topic name.
    pub topic: String,
    /// Full name of the schema; empty when there is none.
    pub schema: String,
    /// Encoding of the messages, such as `protobuf` or `cdr`.
    pub encoding: String,
    /// How many messages.
    pub messages: u64,
    /// When they arrived.
    #[serde(flatten)]
    pub timing: Timing,
    /// Messages whose log time and bytes an earlier one has already.
    pub duplicates: u64,
    /// Range of each number, of protobuf topics; units are those of the schema.
    pub fields: Vec<FieldReport>,
}

/// Range of one number of a topic.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FieldReport {
    /// Its name, `ball.x` for one in a nested message.
    pub field: String,
    /// Messages that carry it.
    pub messages: u64,
    /// Smallest finite value.
    pub min: Option<f64>,
    /// Largest finite value.
    pub max: Option<f64>,
    /// Messages in which it is NaN or infinite.
    pub non_finite: u64,
}

/// A topic that was looked at, with what the other judgements need.
pub(super) struct Studied {
    pub(super) report: TopicReport,
    pub(super) rhythm: Rhythm,
    /// Its numbers, when it is a protobuf topic that decodes.
    pub(super) table: Option<Table>,
    pub(super) doubts: Vec<Doubt>,
}

/// Looks at `channels`, which have one topic and one schema.
pub(super) fn study(recording: &Recording, channels: &[&Channel], start: Nanos) -> Option<Studied> {
    let first = channels.first()?;
    let times: Vec<Nanos> =
        channels.iter().flat_map(|c| c.messages.iter().map(|m| m.log_time)).collect();
    let (mut timing, rhythm) = timing::measure(&times, start);
    if super::is_event(&first.topic) {
        (timing.measured_rate_hz, timing.jitter_ms) = (None, None);
        (timing.largest_gap_s, timing.largest_gap_at_s) = (None, None);
    }
    let (table, fields, mut doubts) = study_values(recording, channels);
    let report = TopicReport {
        topic: first.topic.clone(),
        schema: first.schema.clone(),
        encoding: first.encoding.clone(),
        messages: times.len() as u64,
        timing,
        duplicates: count_duplicates(channels),
        fields,
    };
    doubts.extend(doubts_of(&report));
    Some(Studied { report, rhythm, table, doubts })
}

fn study_values(
    recording: &Recording,
    channels: &[&Channel],
) -> (Option<Table>, Vec<FieldReport>, Vec<Doubt>) {
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
            (None, vec![], vec![Doubt::NotDecodable { topic, reason }])
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

fn doubts_of(report: &TopicReport) -> Vec<Doubt> {
    let topic = || report.topic.clone();
    let mut doubts = Vec::new();
    if BACKWARD_TOLERANCE_S < report.timing.largest_backward_step_s {
        doubts.push(Doubt::TimeBackwards {
            topic: topic(),
            steps: report.timing.backward_steps,
            largest_step_s: report.timing.largest_backward_step_s,
        });
    }
    if 0 < report.duplicates {
        doubts.push(Doubt::Duplicates { topic: topic(), count: report.duplicates });
    }
    for field in report.fields.iter().filter(|field| 0 < field.non_finite) {
        doubts.push(Doubt::NonFinite {
            topic: topic(),
            field: field.field.clone(),
            count: field.non_finite,
        });
    }
    doubts
}

/// Messages whose log time and bytes an earlier one has already.
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
