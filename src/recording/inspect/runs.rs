//! The scripted runs of a recording, from its markers.

use super::{
    super::{Recording, RecordingError, runs::Pairs},
    doubt::Doubt,
};
use crate::units::Nanos;
use serde::Serialize;
use std::ops::Range;

/// A velocity needs two samples.
const MIN_RUN_SAMPLES: u64 = 2;

/// One scripted run. Times are relative to the recording's first message.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RunReport {
    /// Its number.
    pub run: u32,
    /// What was commanded, such as `circle`.
    pub pattern: String,
    /// `train` or `validation`.
    pub split: String,
    /// Its START (s).
    pub start_s: f64,
    /// From START to END (s); `None` without END.
    pub duration_s: Option<f64>,
    /// Most messages within it that a command topic has; of a recording without commands, that
    /// any topic has.
    pub samples: u64,
}

/// The runs in order of their start, and what is doubtful about the markers. They are paired as
/// [`Recording::marked_runs`] does it.
pub(super) fn find_runs(
    recording: &Recording,
    (start, last): (Nanos, Nanos),
) -> Result<(Vec<RunReport>, Vec<Doubt>), RecordingError> {
    let markers = recording.markers()?;
    let pairs = Pairs::of(&markers);
    let at_s = |index: usize| markers.times[index].seconds_since(start);
    let stray = |index: &usize| Doubt::RunWithoutStart {
        run: markers.values[*index].run,
        pattern: markers.values[*index].pattern.clone(),
        end_s: at_s(*index),
    };
    let mut doubts: Vec<Doubt> = pairs.stray_ends.iter().map(stray).collect();
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
    doubts.extend(runs.iter().filter_map(doubt_of));
    Ok((runs, doubts))
}

fn doubt_of(run: &RunReport) -> Option<Doubt> {
    let pattern = run.pattern.clone();
    if run.duration_s.is_none() {
        return Some(Doubt::RunWithoutEnd { run: run.run, pattern, start_s: run.start_s });
    }
    (run.samples < MIN_RUN_SAMPLES).then_some(Doubt::RunTooShort {
        run: run.run,
        pattern,
        samples: run.samples,
    })
}

/// Log times of the channels that count samples, each in order: those of commands where there are
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

/// Most of `times` of one channel that lie in `span`.
fn most_within(times: &[Vec<Nanos>], span: &Range<Nanos>) -> u64 {
    let within = |times: &Vec<Nanos>| {
        let before = |end: Nanos| times.partition_point(|time| *time < end);
        before(span.end).saturating_sub(before(span.start)) as u64
    };
    times.iter().map(within).max().unwrap_or(0)
}
