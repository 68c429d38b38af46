//! Recording of a session. A separate thread writes it, so that a slow disk never delays the
//! control loop.

use crate::{
    recording::{
        RECORDING_METADATA, RecordingError, RecordingWriter,
        message::{
            BoardState, CameraDetections, CanFrame, CarriageState, ControlTick, DriveStatus,
            MotorState, RunMarker, SessionEvent, VelocityCommand,
        },
        topic::{self, Motor, Player},
    },
    scene::{Scene, SceneSettings, Sight},
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    sync::mpsc::{Receiver, SyncSender, sync_channel},
    thread::JoinHandle,
    time::Duration,
};

/// Capacity of the queue: about half a minute of a busy bus.
const QUEUE_LENGTH: usize = 1 << 16;

/// Rest of the writing thread once the queue is empty. A thread that waits for each message must be woken for each,
/// which took a fifth of the processor time of a simulated match.
const REST: Duration = Duration::from_millis(1);

/// One recorded message with its topic.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Entry {
    Can(CanFrame),
    Command(Player, VelocityCommand),
    Carriage(Player, CarriageState),
    Motor(Player, Motor, MotorState),
    Drive(Player, Motor, DriveStatus),
    Camera(CameraDetections),
    Board(BoardState),
    Truth(BoardState),
    Marker(RunMarker),
    Tick(ControlTick),
    Event(SessionEvent),
}

enum Job {
    Write { times: [Nanos; 2], entry: Box<Entry> },
    Metadata { name: &'static str, values: BTreeMap<String, String> },
}

/// Queue of messages to the writing thread.
pub(super) struct Recorder {
    jobs: Option<SyncSender<Job>>,
    thread: Option<JoinHandle<Result<(), RecordingError>>>,
}

impl Recorder {
    /// Start the writing thread; `metadata` is the record that every recording has. With `scene`, a
    /// scene is recorded as well.
    pub(super) fn start(
        mut writer: RecordingWriter,
        metadata: BTreeMap<String, String>,
        scene: Option<SceneSettings>,
    ) -> Result<Self, RecordingError> {
        writer.metadata(RECORDING_METADATA, metadata)?;
        let (jobs, queue) = sync_channel(QUEUE_LENGTH);
        let thread = std::thread::spawn(move || write_all(writer, &queue, scene));
        Ok(Self { jobs: Some(jobs), thread: Some(thread) })
    }

    /// Queue one message with log and publish time.
    ///
    /// # Errors
    /// The cause, when writing has failed.
    pub(super) fn write(&mut self, times: [Nanos; 2], entry: Entry) -> Result<(), String> {
        self.hand_over(Job::Write { times, entry: Box::new(entry) })
    }

    /// Queue a metadata record.
    ///
    /// # Errors
    /// As [`write`](Self::write).
    pub(super) fn metadata(
        &mut self,
        name: &'static str,
        values: BTreeMap<String, String>,
    ) -> Result<(), String> {
        self.hand_over(Job::Metadata { name, values })
    }

    fn hand_over(&mut self, job: Job) -> Result<(), String> {
        let taken = self.jobs.as_ref().is_some_and(|jobs| jobs.send(job).is_ok());
        if taken {
            return Ok(());
        }
        Err(match self.join() {
            Err(error) => with_causes(&error),
            Ok(()) => "it failed before".to_owned(),
        })
    }

    /// Wait until everything is written and the file has its final name.
    ///
    /// # Errors
    /// When writing to the disk fails; the partial file has the messages written so far.
    pub(super) fn finish(mut self) -> Result<(), RecordingError> {
        self.join()
    }

    fn join(&mut self) -> Result<(), RecordingError> {
        drop(self.jobs.take());
        match self.thread.take().map(JoinHandle::join) {
            Some(Ok(result)) => result,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Ok(()),
        }
    }
}

fn write_all(
    mut writer: RecordingWriter,
    queue: &Receiver<Job>,
    scene: Option<SceneSettings>,
) -> Result<(), RecordingError> {
    let mut scene = scene.map(Scene::new);
    while let Ok(job) = queue.recv() {
        write_job(&mut writer, scene.as_mut(), job)?;
        for job in queue.try_iter() {
            write_job(&mut writer, scene.as_mut(), job)?;
        }
        std::thread::sleep(REST);
    }
    writer.finish()
}

fn write_job(
    writer: &mut RecordingWriter,
    scene: Option<&mut Scene>,
    job: Job,
) -> Result<(), RecordingError> {
    let (times, entry) = match job {
        Job::Metadata { name, values } => return writer.metadata(name, values),
        Job::Write { times, entry } => (times, entry),
    };
    write_entry(writer, times, &entry)?;
    let update = scene.zip(sight(&entry)).and_then(|(scene, own)| scene.see(times, &own));
    update.map_or(Ok(()), |update| update.write(writer, times[0]))
}

fn write_entry(
    writer: &mut RecordingWriter,
    [log, publish]: [Nanos; 2],
    entry: &Entry,
) -> Result<(), RecordingError> {
    match entry {
        Entry::Can(m) => writer.write_published(topic::CAN_FRAMES, log, publish, m),
        Entry::Command(p, m) => writer.write(&topic::command(*p), log, m),
        Entry::Carriage(p, m) => writer.write(&topic::carriage(*p), log, m),
        Entry::Motor(p, which, m) => writer.write(&topic::motor(*p, *which), log, m),
        Entry::Drive(p, which, m) => writer.write(&topic::drive(*p, *which), log, m),
        Entry::Camera(m) => writer.write_published(topic::CAMERA_DETECTIONS, log, publish, m),
        Entry::Board(m) => writer.write(topic::BOARD_STATE, log, m),
        Entry::Truth(m) => writer.write(topic::TRUE_BOARD_STATE, log, m),
        Entry::Marker(m) => writer.write(topic::RUN_MARKER, log, m),
        Entry::Tick(m) => writer.write(topic::CONTROL_TICK, log, m),
        Entry::Event(m) => writer.write(topic::SESSION_EVENT, log, m),
    }
}

/// What a scene shows of an entry.
fn sight(entry: &Entry) -> Option<Sight> {
    match entry {
        Entry::Camera(m) => Some(Sight::Camera(*m)),
        Entry::Carriage(player, m) => Some(Sight::Carriage(*player, *m)),
        Entry::Board(m) => Some(Sight::Board(*m)),
        Entry::Truth(m) => Some(Sight::Truth(*m)),
        Entry::Marker(m) => Some(Sight::Marker(m.clone())),
        _ => None,
    }
}

/// Return an error with all its causes as text.
fn with_causes(error: &RecordingError) -> String {
    let mut text = error.to_string();
    let mut cause = std::error::Error::source(error);
    while let Some(inner) = cause {
        let inner_text = inner.to_string();
        if !text.contains(&inner_text) {
            text = format!("{text}: {inner_text}");
        }
        cause = inner.source();
    }
    text
}

impl Drop for Recorder {
    /// After a panic too, queued messages are written; a failure is reported elsewhere.
    fn drop(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            thread.join().ok();
        }
    }
}
