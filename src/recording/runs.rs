//! Scripted runs of a recording, paired from its markers.
//!
//! At most one run is in progress at any time. Runs therefore never overlap, and no sample belongs
//! to both a training run and a held-out run:
//! - a START begins a run and ends a run in progress; an earlier attempt with the same number
//!   counts as a separate run;
//! - an END ends the run in progress if it has its number; any other END is ignored;
//! - a run without an end extends to the end of the recording, including its last message.

use super::{
    Recording, RecordingError, Series, Split,
    message::{RunMarker, run_marker::Phase},
};
use crate::units::Nanos;
use std::ops::Range;

/// One scripted run from the markers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MarkedRun {
    /// Number, not necessarily unique.
    pub number: u32,
    /// Commanded pattern, such as `circle`.
    pub pattern: String,
    /// Split of its marker, or else of the file's metadata; `None` where neither is `train` or
    /// `validation`.
    pub split: Option<Split>,
    /// Log times from its START up to its end; never empty.
    pub span: Range<Nanos>,
}

impl MarkedRun {
    /// Return the span in seconds since `origin`.
    #[must_use]
    pub fn seconds_since(&self, origin: Nanos) -> Range<f64> {
        self.span.start.seconds_since(origin)..self.span.end.seconds_since(origin)
    }
}

/// Paired markers, as indices in the series.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Pairs {
    /// Every START in order, with its END if it has one.
    pub(super) runs: Vec<(usize, Option<usize>)>,
    /// Every END of a run that was not in progress.
    pub(super) stray_ends: Vec<usize>,
}

impl Pairs {
    pub(super) fn of(markers: &Series<RunMarker>) -> Self {
        let mut pairs = Self { runs: Vec::new(), stray_ends: Vec::new() };
        for (index, marker) in markers.values.iter().enumerate() {
            if marker.phase() == Phase::Start {
                pairs.runs.push((index, None));
                continue;
            }
            match pairs.runs.last_mut() {
                Some((start, end @ None)) if markers.values[*start].run == marker.run => {
                    *end = Some(index);
                }
                _ => pairs.stray_ends.push(index),
            }
        }
        pairs
    }

    /// Return the time from START up to the end of the `run`th run of a recording whose last
    /// message is at `last`.
    pub(super) fn span(&self, run: usize, times: &[Nanos], last: Nanos) -> Range<Nanos> {
        let (start, end) = self.runs[run];
        let next = self.runs.get(run + 1).map(|(start, _)| *start);
        let after_last = Nanos(last.0.saturating_add(1));
        times[start]..end.or(next).map_or(after_last, |index| times[index])
    }
}

impl Recording {
    /// Return the runs between the markers, in order of time. They never overlap: a START ends a
    /// run in progress, also one of the same number, and an END of a run that is not in progress is
    /// ignored. A run without an end extends to the end of the recording, including its last
    /// message. The result is empty without markers; a run without length is skipped.
    ///
    /// # Errors
    /// When a marker cannot be decoded.
    pub fn marked_runs(&self) -> Result<Vec<MarkedRun>, RecordingError> {
        let markers = self.markers()?;
        let Some((_, last)) = self.time_range() else { return Ok(Vec::new()) };
        let file_split = self.info("split").and_then(Split::from_text);
        let pairs = Pairs::of(&markers);
        let runs = pairs.runs.iter().enumerate().map(|(run, (start, _))| {
            let marker = &markers.values[*start];
            MarkedRun {
                number: marker.run,
                pattern: marker.pattern.clone(),
                split: Split::from_text(&marker.split).or(file_split),
                span: pairs.span(run, &markers.times, last),
            }
        });
        Ok(runs.filter(|run| run.span.start < run.span.end).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::{ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingWriter, topic};

    const START: Phase = Phase::Start;
    const END: Phase = Phase::End;

    /// A recording from 0 to 90 ns with these markers (time, number, phase, split).
    fn recording(file_split: &str, markers: &[(u64, u32, Phase, &str)]) -> Recording {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("runs.mcap");
        let mut writer =
            RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
        let metadata = [("split".to_owned(), file_split.to_owned())].into();
        writer.metadata(RECORDING_METADATA, metadata).unwrap();
        for time in [0, 90] {
            let still = crate::recording::message::VelocityCommand::default();
            let left = topic::command(topic::Player::Left);
            writer.write(&left, Nanos(time), &still).unwrap();
        }
        for (time, run, phase, split) in markers {
            let marker = RunMarker {
                run: *run,
                pattern: format!("pattern {run}"),
                phase: (*phase).into(),
                split: (*split).to_owned(),
            };
            writer.write(topic::RUN_MARKER, Nanos(*time), &marker).unwrap();
        }
        writer.finish().unwrap();
        Recording::open(&path).unwrap()
    }

    /// Number, start and end of each run.
    fn runs(markers: &[(u64, u32, Phase)]) -> Vec<(u32, u64, u64)> {
        let markers: Vec<_> =
            markers.iter().map(|(t, run, phase)| (*t, *run, *phase, "")).collect();
        let found = recording("", &markers).marked_runs().unwrap();
        found.iter().map(|run| (run.number, run.span.start.0, run.span.end.0)).collect()
    }

    #[test]
    fn a_run_reaches_from_start_to_end() {
        let markers = [(10, 4, START), (20, 4, END), (30, 5, START), (40, 5, END)];
        assert_eq!(runs(&markers), [(4, 10, 20), (5, 30, 40)]);
        assert_eq!(runs(&[]), []);
        assert_eq!(runs(&[(10, 4, START), (10, 4, END)]), []);
    }

    #[test]
    fn a_run_without_end_reaches_to_the_next_or_holds_the_last_message() {
        let markers = [(10, 1, START), (30, 2, START), (40, 2, END), (50, 3, START)];
        assert_eq!(runs(&markers), [(1, 10, 30), (2, 30, 40), (3, 50, 91)]);
    }

    #[test]
    fn a_run_that_is_begun_again_counts_twice() {
        let markers = [(10, 1, START), (30, 1, START), (40, 1, END)];
        assert_eq!(runs(&markers), [(1, 10, 30), (1, 30, 40)]);
    }

    #[test]
    fn an_end_of_a_run_that_is_not_under_way_means_nothing() {
        let markers = [(5, 1, END), (10, 1, START), (20, 2, END), (30, 1, END), (40, 1, END)];
        assert_eq!(runs(&markers), [(1, 10, 30)]);
    }

    #[test]
    fn runs_never_overlap() {
        let markers = [(10, 1, START), (20, 2, START), (30, 1, END), (40, 2, END)];
        assert_eq!(runs(&markers), [(1, 10, 20), (2, 20, 40)]);
    }

    #[test]
    fn the_markers_word_on_the_purpose_goes_before_that_of_the_file() {
        let marked = [(10, 1, START, ""), (20, 1, END, ""), (30, 2, START, "validation")];
        let splits = |file| {
            let found = recording(file, &marked).marked_runs().unwrap();
            found.iter().map(|run| run.split).collect::<Vec<_>>()
        };
        assert_eq!(splits("train"), [Some(Split::Train), Some(Split::Validation)]);
        assert_eq!(splits("whatever"), [None, Some(Split::Validation)]);
        let first = &recording("", &marked).marked_runs().unwrap()[0];
        assert_eq!(first.pattern, "pattern 1");
        assert_eq!(first.seconds_since(Nanos(5)), 5e-9..15e-9);
    }
}
