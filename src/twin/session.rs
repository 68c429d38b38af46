//! Recordings as sessions: measured input and output of each stage, cut into runs.

mod gantry;
mod links;
mod options;
mod readings;
#[cfg(test)]
mod tests;

use super::{
    AxisError, AxisStage, BallStage, CameraStage, DriveStage, EstimatorStage, Machine, Stage, Twin,
    machine_of,
};
use crate::{
    gantry::BELT_METRES_PER_TURN,
    recording::{MarkedRun, Recording, RecordingError, Split, topic},
};
use gantry::Gantry;
pub(super) use links::STRIKER_HEIGHT;
pub use options::{Mask, SessionOptions};
use readings::Readings;
use std::ops::Range;

/// Length of the runs into which a recording without markers is cut (s).
const UNMARKED_RUN: f64 = 5.0;

/// Reasons why a recording gives no session.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// It could not be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A single axis cannot be used.
    #[error(transparent)]
    Axis(#[from] AxisError),
    /// A given twin describes another kind of machine.
    #[error(
        "the twin describes a {twin}, the recordings a {recorded}; give the twin of that machine"
    )]
    OtherMachine {
        /// Of the twin.
        twin: Machine,
        /// Of the recordings.
        recorded: Machine,
    },
    /// Recordings, or recordings and twin, are of machines with different belts.
    #[error(
        "{path} was recorded with {found} m of belt per motor turn, {other} has {expected} m: these are different \
         machines; correct belt_metres_per_turn in the recording's metadata, or give the twin of that machine"
    )]
    OtherBelt {
        /// The recording.
        path: String,
        /// Its belt per motor turn (m).
        found: f64,
        /// The other recording, or the twin.
        other: String,
        /// Its belt per motor turn (m).
        expected: f64,
    },
    /// Single axes, or axis and twin, with different units.
    #[error(
        "{path} has an input in {} and a position in {}, {other} {} and {}: these are different machines; give the twin of \
         that machine, or correct the units at the import",
        found.0, found.1, expected.0, expected.1
    )]
    OtherUnits {
        /// The recording.
        path: String,
        /// Its units of input and position.
        found: (&'static str, &'static str),
        /// The other recording, or the twin.
        other: String,
        /// Its units.
        expected: (&'static str, &'static str),
    },
    /// A name is that of no session.
    #[error("'{name}' is none of the recordings; the sessions are {known}")]
    UnknownSession {
        /// Name as it was given.
        name: String,
        /// Names of the sessions.
        known: String,
    },
    /// A mask begins behind the end of its session.
    #[error("the mask {mask} begins behind the end of the session, which is {length:.1} s long")]
    MaskBehindEnd {
        /// Mask as it was given.
        mask: String,
        /// Length of the longest session that it concerns (s).
        length: f64,
    },
    /// None of the stages has both input and output.
    #[error(
        "{path} holds no stage with measured input and output: needed are commands with motor or \
         carriage states, carriage with camera, free rolls of the ball, or /axis/NAME/input with \
         /axis/NAME/output"
    )]
    NoLink {
        /// The file.
        path: String,
    },
}

/// One scripted run, or a piece of a recording without markers.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Start and end (s since the recording began).
    pub span: Range<f64>,
    /// Name of its pattern; empty without markers.
    pub pattern: String,
    /// Purpose, if markers or metadata state it.
    pub split: Option<Split>,
}

/// Source of a recording, as its metadata state it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RecordedSource {
    /// `hardware`, `import`, `virtual` or `simulation`; `None` where it is not stated.
    pub kind: Option<String>,
    /// Live bus of a real table, such as `socketcan:can0`.
    pub bus: Option<String>,
}

impl RecordedSource {
    fn of(recording: &Recording) -> Self {
        let is_live = |bus: &&str| *bus != "virtual" && !bus.starts_with("replay:");
        Self {
            kind: recording.info("source").map(str::to_owned),
            bus: recording.info("bus").filter(is_live).map(str::to_owned),
        }
    }

    /// Return whether a real machine was recorded.
    #[must_use]
    pub fn is_real(&self) -> bool {
        self.bus.is_some() || matches!(self.kind.as_deref(), Some("hardware" | "import"))
    }
}

/// One recording, or the part of it that has one purpose.
pub struct Session {
    /// File name without folder and ending, or the session's name from the metadata.
    pub name: String,
    /// SHA-256 of the file.
    pub sha256: String,
    /// Purpose of the session.
    pub split: Split,
    /// Its runs.
    pub runs: Vec<Run>,
    /// The whole recording's length (s).
    pub length: f64,
    /// Number of recorded commands.
    pub commands: usize,
    /// Machine and bus, as the recording states them.
    pub source: RecordedSource,
    /// Belt per motor turn (m): from the metadata, or that of the KlaskTron gantry.
    pub belt_metres_per_turn: f64,
    /// Commands to motors.
    pub drive: Option<DriveStage>,
    /// Carriage to camera.
    pub camera: Option<CameraStage>,
    /// Free rolls, in pieces and whole.
    pub ball: Vec<BallStage>,
    /// Positions to reported velocities.
    pub estimator: Option<EstimatorStage>,
    /// Single axes.
    pub axes: Vec<AxisStage>,
}

impl Session {
    /// Return whether a carriage moved and nothing states the cause of its motion.
    #[must_use]
    pub fn is_without_input(&self) -> bool {
        self.commands == 0 && self.ball.is_empty() && self.axes.is_empty()
    }

    /// Its stages.
    #[must_use]
    pub fn stages(&self) -> Vec<&dyn Stage> {
        let mut stages: Vec<&dyn Stage> = Vec::new();
        stages.extend(self.drive.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.camera.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.estimator.as_ref().map(|stage| stage as &dyn Stage));
        stages.extend(self.ball.iter().map(|stage| stage as &dyn Stage));
        stages.extend(self.axes.iter().map(|stage| stage as &dyn Stage));
        stages
    }
}

/// The runs of a recording by its markers; pieces of equal length without any.
///
/// # Errors
/// When a marker does not decode.
pub fn runs_of(recording: &Recording) -> Result<Vec<Run>, RecordingError> {
    let Some((origin, end)) = recording.time_range() else { return Ok(Vec::new()) };
    let marked = recording.marked_runs()?;
    if marked.is_empty() {
        let split = recording.info("split").and_then(Split::from_text);
        return Ok(unmarked_runs(end.seconds_since(origin), split));
    }
    let run = |run: MarkedRun| Run {
        span: run.seconds_since(origin),
        pattern: run.pattern,
        split: run.split,
    };
    Ok(marked.into_iter().map(run).collect())
}

/// Equal pieces of a recording of `length` (s), all for one purpose.
fn unmarked_runs(length: f64, split: Option<Split>) -> Vec<Run> {
    let count = (length / UNMARKED_RUN).floor().max(1.0);
    let each = length / count;
    let piece = |k: usize| k as f64 * each..(k + 1) as f64 * each;
    (0..count as usize).map(|k| Run { span: piece(k), pattern: String::new(), split }).collect()
}

/// Every this many runs one is held out, if recordings do not state their purpose.
const HELD_OUT_EVERY: usize = 3;

/// The sessions of `recordings`: each file's runs by their purpose. If nothing states the held-out
/// data, it is the last of several recordings, or every third run of one.
///
/// # Errors
/// When a message does not decode, or a recording has no stage that can be compared.
pub fn sessions_of(recordings: &[Recording]) -> Result<Vec<Session>, SessionError> {
    sessions_with(recordings, &SessionOptions::default())
}

/// As [`sessions_of`], with validation sessions and masks that the user chooses.
///
/// # Errors
/// As [`sessions_of`]; or an option names no session, or a mask lies behind the end.
pub fn sessions_with(
    recordings: &[Recording],
    options: &SessionOptions,
) -> Result<Vec<Session>, SessionError> {
    let mut runs: Vec<Vec<Run>> =
        recordings.iter().map(runs_of).collect::<Result<_, RecordingError>>()?;
    options.divide(recordings, &mut runs)?;
    divide(&mut runs);
    let mut sessions = Vec::new();
    for (recording, runs) in recordings.iter().zip(&runs) {
        let before = sessions.len();
        let belt = recording.belt_metres_per_turn()?.unwrap_or(BELT_METRES_PER_TURN);
        let gantry = Gantry::moving(recording, belt)?;
        for split in [Split::Train, Split::Validation] {
            let own: Vec<Run> =
                runs.iter().filter(|run| run.split == Some(split)).cloned().collect();
            if own.is_empty() {
                continue;
            }
            let session = session_of(recording, (gantry.as_ref(), belt), own, split)?;
            if !session.stages().is_empty() {
                sessions.push(session);
            }
        }
        if sessions.len() == before {
            return Err(SessionError::NoLink { path: recording.path.display().to_string() });
        }
    }
    options.mask(recordings, &mut sessions)?;
    Ok(sessions)
}

/// Check that `sessions` are of one machine, that of the `given` twin if there is one.
///
/// # Errors
/// When the kind of machine, its belt or the units of an axis differ.
pub fn check_machine(sessions: &[Session], given: Option<&Twin>) -> Result<(), SessionError> {
    let recorded = machine_of(sessions);
    if let Some(twin) = given.filter(|twin| twin.machine != recorded) {
        return Err(SessionError::OtherMachine { twin: twin.machine, recorded });
    }
    check_units(sessions, given)?;
    let mut driven = sessions.iter().filter(|own| own.drive.is_some() || own.camera.is_some());
    let first = given.map(|twin| ("the twin", twin.belt_metres_per_turn));
    let own = |session: &'_ Session| session.belt_metres_per_turn;
    let known = first.or_else(|| driven.next().map(|one| (one.name.as_str(), own(one))));
    let Some((other, expected)) = known else { return Ok(()) };
    match driven.find(|session| SAME_BELT * expected < (own(session) - expected).abs()) {
        None => Ok(()),
        Some(session) => Err(SessionError::OtherBelt {
            path: session.name.clone(),
            found: own(session),
            other: other.to_owned(),
            expected,
        }),
    }
}

/// Check that all single axes of `sessions` have the same units, those of the `given` twin if it is of an axis.
fn check_units(sessions: &[Session], given: Option<&Twin>) -> Result<(), SessionError> {
    let scales = given.and_then(|twin| twin.axis_frame).map(|frame| frame.scales);
    let of_twin = scales.map(|own| ("the twin", (own.input_unit, own.position_unit)));
    let mut recorded = sessions
        .iter()
        .flat_map(|session| session.axes.iter().map(|axis| (session.name.as_str(), axis.units())));
    let Some((other, expected)) = of_twin.or_else(|| recorded.next()) else { return Ok(()) };
    match recorded.find(|(_, units)| *units != expected) {
        None => Ok(()),
        Some((path, found)) => Err(SessionError::OtherUnits {
            path: path.to_owned(),
            found,
            other: other.to_owned(),
            expected,
        }),
    }
}

/// Relative difference of two belts per turn that is rounding.
const SAME_BELT: f64 = 1e-6;

fn session_name(recording: &Recording) -> String {
    recording.info("session").map_or_else(
        || recording.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        str::to_owned,
    )
}

/// Set the purpose of every run of every recording that markers and metadata leave open: the last
/// of several recordings is held out, or every third run of one.
pub fn divide(recordings: &mut [Vec<Run>]) {
    let says = |split| move |runs: &Vec<Run>| runs.iter().any(|run| run.split == Some(split));
    let held_out_known = recordings.iter().any(says(Split::Validation));
    let several = 1 < recordings.len();
    let last = recordings.len().saturating_sub(1);
    for (index, runs) in recordings.iter_mut().enumerate() {
        for (number, run) in runs.iter_mut().enumerate() {
            let held_out = !held_out_known
                && if several {
                    index == last
                } else {
                    number % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
                };
            if held_out {
                run.split = Some(Split::Validation);
            } else {
                run.split = run.split.or(Some(Split::Train));
            }
        }
    }
}

/// Session of one recording with this gantry and belt per motor turn (m), in `runs`.
fn session_of(
    recording: &Recording,
    (gantry, belt): (Option<&Gantry>, f64),
    runs: Vec<Run>,
    split: Split,
) -> Result<Session, SessionError> {
    let (mut drive, mut camera, mut commands) = (None, None, 0);
    if let Some(gantry) = gantry {
        drive = links::drive_stage(recording, gantry, &runs)?;
        camera = links::camera_stage(recording, gantry, (&runs, drive.is_some()))?;
        commands = recording.count(&topic::command(gantry.player));
    }
    let spans: Vec<Range<f64>> = runs.iter().map(|run| run.span.clone()).collect();
    let carriage = gantry.zip(camera.as_ref()).map(|(own, seen)| (own.player, &seen.carriage));
    let estimator = EstimatorStage::from_recording(recording, &spans, carriage)?;
    Ok(Session {
        name: session_name(recording),
        sha256: recording.sha256.clone(),
        split,
        length: recording.time_range().map_or(0.0, |(start, end)| end.seconds_since(start)),
        commands,
        belt_metres_per_turn: belt,
        source: RecordedSource::of(recording),
        runs,
        drive,
        camera,
        ball: BallStage::from_recording(recording, &spans)?,
        estimator,
        axes: AxisStage::from_recording(recording, &spans)?,
    })
}
