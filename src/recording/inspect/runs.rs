//! The scripted runs of a recording, from its markers.

use super::{
    super::{Recording, RecordingError, message::run_marker::Phase},
    doubt::Doubt,
};
use crate::units::Nanos;
use serde::Serialize;

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

/// The runs in order of their start, and what is doubtful about the markers.
pub(super) fn find_runs(
    recording: &Recording,
    start: Nanos,
) -> Result<(Vec<RunReport>, Vec<Doubt>), RecordingError> {
    let mut runs: Vec<RunReport> = Vec::new();
    let mut doubts = Vec::new();
    for (time, marker) in recording.markers()?.iter() {
        let at_s = time.seconds_since(start);
        if marker.phase() == Phase::Start {
            runs.push(RunReport {
                run: marker.run,
                pattern: marker.pattern.clone(),
                split: marker.split.clone(),
                start_s: at_s,
                duration_s: None,
                samples: 0,
            });
            continue;
        }
        let open = runs.iter_mut().rev().find(|r| r.run == marker.run && r.duration_s.is_none());
        match open {
            Some(run) => run.duration_s = Some(at_s - run.start_s),
            None => doubts.push(Doubt::RunWithoutStart {
                run: marker.run,
                pattern: marker.pattern.clone(),
                end_s: at_s,
            }),
        }
    }
    count_samples(recording, start, &mut runs);
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

fn count_samples(recording: &Recording, start: Nanos, runs: &mut [RunReport]) {
    let has_commands = recording
        .channels
        .iter()
        .any(|channel| super::is_command(&channel.topic) && !channel.messages.is_empty());
    for channel in &recording.channels {
        let counts = if has_commands {
            super::is_command(&channel.topic)
        } else {
            !super::is_event(&channel.topic)
        };
        if runs.is_empty() || !counts {
            continue;
        }
        let mut times: Vec<f64> =
            channel.messages.iter().map(|m| m.log_time.seconds_since(start)).collect();
        times.sort_by(f64::total_cmp);
        for run in runs.iter_mut() {
            let end_s = run.duration_s.map_or(f64::INFINITY, |duration| run.start_s + duration);
            let first = times.partition_point(|time| *time < run.start_s);
            let after = times.partition_point(|time| *time < end_s);
            run.samples = run.samples.max((after - first) as u64);
        }
    }
}
