//! Messages gathered from a source, then written in order of their log time.

use super::{
    error::ImportError,
    report::{ImportReport, Notice, TopicCount},
};
use crate::{
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingError, RecordingWriter,
        message::{
            AxisInput, AxisOutput, BoardState, CanFrame, CarriageState, DriveStatus, MotorState,
            RunMarker, VelocityCommand, run_marker::Phase,
        },
        topic,
    },
    units::Nanos,
};
use std::{collections::BTreeMap, path::Path};

/// One message of the contract.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Outgoing {
    Command(VelocityCommand),
    Carriage(CarriageState),
    Motor(MotorState),
    Drive(DriveStatus),
    Can(CanFrame),
    Board(Box<BoardState>),
    Marker(RunMarker),
    AxisInput(AxisInput),
    AxisOutput(AxisOutput),
}

#[derive(Debug, Clone)]
struct Stamped {
    log_time: Nanos,
    publish_time: Nanos,
    topic: usize,
    message: Outgoing,
}

/// Messages of one import, with notices and metadata.
#[derive(Debug, Default)]
pub(super) struct Tape {
    topics: Vec<String>,
    index_by_topic: BTreeMap<String, usize>,
    messages: Vec<Stamped>,
    /// Notices for the user and the report.
    pub(super) notices: Vec<Notice>,
    /// Entries of the metadata record beyond the common ones.
    pub(super) metadata: BTreeMap<String, String>,
}

impl Tape {
    /// Add a message whose source has no clock.
    pub(super) fn push(&mut self, topic: &str, log_time: Nanos, message: Outgoing) {
        self.push_published(topic, [log_time, log_time], message);
    }

    /// Add a message with log and publish time.
    pub(super) fn push_published(&mut self, topic: &str, times: [Nanos; 2], message: Outgoing) {
        let topic = self.position(topic);
        let [log_time, publish_time] = times;
        self.messages.push(Stamped { log_time, publish_time, topic, message });
    }

    /// Return the first and last log time; `None` for an empty tape.
    pub(super) fn time_range(&self) -> Option<(Nanos, Nanos)> {
        let times = || self.messages.iter().map(|message| message.log_time);
        Some((times().min()?, times().max()?))
    }

    /// Append another tape. Of two metadata entries that differ both are kept.
    pub(super) fn append(&mut self, other: Self) {
        let positions: Vec<usize> = other.topics.iter().map(|topic| self.position(topic)).collect();
        self.messages
            .extend(other.messages.into_iter().map(|m| Stamped { topic: positions[m.topic], ..m }));
        self.notices.extend(other.notices);
        for (key, value) in other.metadata {
            match self.metadata.get_mut(&key) {
                Some(known) if *known != value => *known = format!("{known}; {value}"),
                Some(_) => {}
                None => {
                    self.metadata.insert(key, value);
                }
            }
        }
    }

    fn position(&mut self, topic: &str) -> usize {
        if let Some(known) = self.index_by_topic.get(topic) {
            return *known;
        }
        self.index_by_topic.insert(topic.to_owned(), self.topics.len());
        self.topics.push(topic.to_owned());
        self.topics.len() - 1
    }

    /// Return log times and values of one topic in order of log time.
    pub(super) fn series<'a, T: 'a>(
        &'a self,
        topic: &str,
        pick: impl Fn(&'a Outgoing) -> Option<&'a T>,
    ) -> Vec<(Nanos, &'a T)> {
        let Some(index) = self.index_by_topic.get(topic) else { return Vec::new() };
        let mut series: Vec<_> = self
            .messages
            .iter()
            .filter(|stamped| stamped.topic == *index)
            .filter_map(|stamped| Some((stamped.log_time, pick(&stamped.message)?)))
            .collect();
        series.sort_by_key(|(time, _)| *time);
        series
    }

    /// Add markers around all data.
    pub(super) fn mark_run(&mut self, run: u32, pattern: &str, split: &str) {
        if let Some((first, last)) = self.time_range() {
            self.push_markers([first, last], run, pattern, split);
        }
    }

    /// Add the markers of one run from `span[0]` to `span[1]`.
    pub(super) fn push_markers(&mut self, span: [Nanos; 2], run: u32, pattern: &str, split: &str) {
        for (time, phase) in span.into_iter().zip([Phase::Start, Phase::End]) {
            let marker = RunMarker {
                run,
                pattern: pattern.to_owned(),
                phase: phase.into(),
                split: split.to_owned(),
            };
            self.push(topic::RUN_MARKER, time, Outgoing::Marker(marker));
        }
    }

    /// Write the recording. At equal times run starts come first and run ends last.
    pub(super) fn write(
        mut self,
        output: &Path,
        existing: ExistingFile,
    ) -> Result<ImportReport, ImportError> {
        self.messages.sort_by_key(|stamped| (stamped.log_time, rank(&stamped.message)));
        let mut writer = RecordingWriter::create(output, existing, FlushPolicy::WhenFull)?;
        let metadata = std::mem::take(&mut self.metadata);
        match self.write_all(&mut writer, metadata) {
            Ok(()) => writer.finish()?,
            Err(error) => {
                writer.discard();
                return Err(error.into());
            }
        }
        Ok(ImportReport { written: self.counts(), notices: self.notices })
    }

    fn write_all(
        &self,
        writer: &mut RecordingWriter,
        metadata: BTreeMap<String, String>,
    ) -> Result<(), RecordingError> {
        writer.metadata(RECORDING_METADATA, metadata)?;
        for stamped in &self.messages {
            let topic = &self.topics[stamped.topic];
            let [log, publish] = [stamped.log_time, stamped.publish_time];
            match &stamped.message {
                Outgoing::Command(m) => writer.write_published(topic, log, publish, m),
                Outgoing::Carriage(m) => writer.write_published(topic, log, publish, m),
                Outgoing::Motor(m) => writer.write_published(topic, log, publish, m),
                Outgoing::Drive(m) => writer.write_published(topic, log, publish, m),
                Outgoing::Can(m) => writer.write_published(topic, log, publish, m),
                Outgoing::Board(m) => writer.write_published(topic, log, publish, m.as_ref()),
                Outgoing::Marker(m) => writer.write_published(topic, log, publish, m),
                Outgoing::AxisInput(m) => writer.write_published(topic, log, publish, m),
                Outgoing::AxisOutput(m) => writer.write_published(topic, log, publish, m),
            }?;
        }
        Ok(())
    }

    fn counts(&self) -> Vec<TopicCount> {
        let mut counts = vec![0; self.topics.len()];
        for stamped in &self.messages {
            counts[stamped.topic] += 1;
        }
        self.index_by_topic
            .iter()
            .map(|(topic, index)| TopicCount { topic: topic.clone(), messages: counts[*index] })
            .collect()
    }
}

fn rank(message: &Outgoing) -> u8 {
    match message {
        Outgoing::Marker(marker) if marker.phase() == Phase::Start => 0,
        Outgoing::Marker(_) => 2,
        _ => 1,
    }
}
