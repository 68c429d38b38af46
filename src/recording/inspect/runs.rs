//! Scripted runs of a recording, from its markers.

use super::{
    super::{Recording, RecordingError, runs::Pairs},
    issue::DataQualityIssue,
};
use crate::units::Nanos;
use serde::Serialize;
use std::ops::Range;

/// Least number of samples of a run, for a velocity.
const MIN_RUN_SAMPLES: u64 = 2;

/// One scripted run. Times are relative to the recording's first message.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunReport {
    /// Number.
    pub run: u32,
    /// Commanded pattern, such as `circle`.
    pub pattern: String,
    /// `train` or `validation`.
    pub split: String,
    /// Time of its START (s).
    pub start_s: f64,
    /// Duration from START to END (s); `None` without END.
    pub duration_s: Option<f64>,
    /// Number of messages of the command topic with the most messages in the run; in a recording
    /// without commands, of any topic.
    pub samples: u64,
}

/// Return the runs in order of their start, and the issues of the markers. They are paired as in
/// [`Recording::marked_runs`].
pub(super) fn find_runs(
    recording: &Recording,
    (start, last): (Nanos, Nanos),
) -> Result<(Vec<RunReport>, Vec<DataQualityIssue>), RecordingError> {
    let markers = recording.markers()?;
    let pairs = Pairs::of(&markers);
    let at_s = |index: usize| markers.times[index].seconds_since(start);
    let stray = |index: &usize| DataQualityIssue::RunWithoutStart {
        run: markers.values[*index].run,
        pattern: markers.values[*index].pattern.clone(),
        end_s: at_s(*index),
    };
    let mut issues: Vec<DataQualityIssue> = pairs.stray_ends.iter().map(stray).collect();
    let times = counted_times(recording);
    let mut runs = Vec::new();
    for (index, (begins, ends)) in pairs.runs.iter().enumerate() {
        let marker = &markers.values[*begins];
        runs.push(RunReport {
            run: marker.run,
            pattern: marker.pattern.clone(),
            split: marker.split.clone(),
            start_s: at_s(*begins),
            duration_s: ends.map(|ends| at_s(ends) - at_s(*begins)),
            samples: most_within(&times, &pairs.span(index, &markers.times, last)),
        });
    }
    issues.extend(runs.iter().filter_map(issue_of));
    Ok((runs, issues))
}

fn issue_of(run: &RunReport) -> Option<DataQualityIssue> {
    let pattern = run.pattern.clone();
    if run.duration_s.is_none() {
        return Some(DataQualityIssue::RunWithoutEnd {
            run: run.run,
            pattern,
            start_s: run.start_s,
        });
    }
    (run.samples < MIN_RUN_SAMPLES).then_some(DataQualityIssue::RunTooShort {
        run: run.run,
        pattern,
        samples: run.samples,
    })
}

/// Return the log times of the channels that count samples, each in order: those of commands, if
/// any.
fn counted_times(recording: &Recording) -> Vec<Vec<Nanos>> {
    let filled = || recording.channels.iter().filter(|channel| !channel.messages.is_empty());
    let has_commands = filled().any(|channel| super::is_command(&channel.topic));
    let counts = |topic: &str| {
        if has_commands { super::is_command(topic) } else { !super::is_event(topic) }
    };
    filled()
        .filter(|channel| counts(&channel.topic))
        .map(|channel| {
            let mut times: Vec<Nanos> = channel.messages.iter().map(|m| m.log_time).collect();
            times.sort_unstable();
            times
        })
        .collect()
}

/// Return the largest number of `times` of one channel in `span`.
fn most_within(times: &[Vec<Nanos>], span: &Range<Nanos>) -> u64 {
    let within = |times: &Vec<Nanos>| {
        let before = |end: Nanos| times.partition_point(|time| *time < end);
        before(span.end).saturating_sub(before(span.start)) as u64
    };
    times.iter().map(within).max().unwrap_or(0)
}
