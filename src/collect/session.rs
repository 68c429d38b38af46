//! One session: look, home, arm, drive every leg or a free stretch, switch off, and say how it went.

mod free;

use super::{
    arming::{self, WatchdogPolicy},
    control::{self, ControlLoop, Tick},
    guard::{CameraDuty, Guard, MOST_LAG_SECONDS},
    homing::{self, HomingPolicy},
    leg::{Leg, RunLabel},
    pilot::Work,
    preflight::{self, Census, Problem},
    reason::StopReason,
    recorder::{Entry, Recorder},
    report::{PictureToCommand, Progress, SessionReport},
    station::{Counts, ForeignOrders, RawFrames, Station},
};
use crate::{
    can::Command,
    gantry::{BeltError, Limits, Reference, Robot, Setpoint},
    link::Link,
    recording::{
        RecordingError, RecordingWriter, SESSION_METADATA,
        message::{RunMarker, run_marker::Phase},
        topic::Player,
    },
    units::Nanos,
};
use std::{collections::BTreeMap, sync::atomic::AtomicUsize};

/// Before each run the carriage stands still for this long (s).
const SETTLE_SECONDS: f64 = 0.4;
/// Corrections of the position never add more than this to a command (m/s).
const MOST_CORRECTION: f64 = 0.05;
/// How far a carriage is behind its reference when all is well (s): half a period, the bus, the delay
/// and the lag of the drive; the paper's figures give 40 to 60 ms.
const USUAL_LAG_SECONDS: f64 = 0.05;
/// A larger share of lost periods, setpoints or positions makes a recording incomplete.
const MOST_LOST_SHARE: f64 = 0.01;
/// The live view is told this often (s).
const PROGRESS_SECONDS: f64 = 0.1;

/// How a session is run.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionConfig {
    /// Whose carriages are driven.
    pub players: Vec<Player>,
    /// Rate of the control loop (Hz).
    pub rate_hz: f64,
    /// How positions are referenced.
    pub homing: HomingPolicy,
    /// How it is made sure that drives stop by themselves.
    pub watchdog: WatchdogPolicy,
    /// Whether every frame is recorded.
    pub raw: RawFrames,
    /// Firmware besides 0.6.x that the operator accepts, as `major.minor.revision`.
    pub accepted_firmware: Vec<String>,
    /// How strongly commands pull a carriage back to its path ((m/s)/m): enough to cancel drift, far
    /// below what would hide the drive's own behaviour.
    pub hold_gain_per_s: f64,
    /// Entries of the metadata record that every recording carries.
    pub metadata: BTreeMap<String, String>,
}

/// Why a session did not begin, or left no recording.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The first look has found problems.
    #[error("not armed: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Preflight(Vec<Problem>),
    /// Positions cannot be referenced.
    #[error(transparent)]
    Homing(#[from] homing::HomingError),
    /// The recording.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The belt of the robot file.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// The session has stopped, and the recording could not be completed either.
    #[error("{stop}; the file could not be completed: {recording}")]
    StoppedAndLost {
        /// Why it stopped.
        stop: String,
        /// What is wrong with the recording.
        recording: String,
    },
}

/// Runs a session on `link` and writes it with `writer`. `presses` counts Ctrl-C: one ramps down, two
/// stop at once. `show` is called ten times a second.
///
/// # Errors
/// When nothing was armed; a session that began ends with a report, whatever stopped it.
pub fn run_session(
    link: &mut dyn Link,
    robot: &Robot,
    config: &SessionConfig,
    work: Work<'_>,
    output: SessionOutput<'_>,
) -> Result<SessionReport, SessionError> {
    let SessionOutput { writer, presses, show } = output;
    let mut station = Station::new(link, robot, &config.players, config.raw, presses)?;
    let started = station.now();
    let (census, mut problems) =
        preflight::look(&mut station, config.rate_hz, &config.accepted_firmware);
    log::info!("{} drives on the bus", census.firmware.len());
    if matches!(work, Work::Free(_)) && station.counts.pictures == 0 {
        problems.push(Problem::NoPictures);
    }
    if !problems.is_empty() {
        writer.discard();
        return Err(SessionError::Preflight(problems));
    }
    if let Err(error) = homing::reference(&mut station, &config.players, config.homing) {
        writer.discard();
        return Err(error.into());
    }
    log::info!("positions are referenced; recording begins");
    let mut metadata = config.metadata.clone();
    metadata.extend(control::arrivals(&config.players, &robot.can));
    station.record_to(Recorder::start(writer, metadata)?);
    let mut session = Session::new(station, config, &work, show);
    let reason = session.drive(work).err().unwrap_or(StopReason::Completed);
    log::info!("{reason}");
    session.close(&reason, started, census)
}

/// Where a session writes, and how it is watched.
pub struct SessionOutput<'a> {
    /// The recording to be.
    pub writer: RecordingWriter,
    /// How often Ctrl-C was pressed.
    pub presses: &'a AtomicUsize,
    /// Told ten times a second.
    pub show: &'a mut dyn FnMut(&Progress<'_>),
}

/// What the last live view has told.
struct Shown {
    at: Nanos,
    frames: u64,
    pictures: u64,
}

struct Session<'a> {
    station: Station<'a>,
    control: ControlLoop,
    guard: Guard,
    config: &'a SessionConfig,
    show: &'a mut dyn FnMut(&Progress<'_>),
    shown: Shown,
    runs_planned: usize,
    runs_done: usize,
    samples: usize,
    picture_to_command: Option<PictureToCommand>,
    /// How many periods a carriage is behind its reference when all is well.
    lag_periods: usize,
    periods_planned: usize,
    periods_done: usize,
    periods_in_leg: usize,
}

impl<'a> Session<'a> {
    fn new(
        station: Station<'a>,
        config: &'a SessionConfig,
        work: &Work<'_>,
        show: &'a mut dyn FnMut(&Progress<'_>),
    ) -> Self {
        let now = station.now();
        // Once there have been pictures, they are watched, however positions were referenced.
        let camera = match station.counts.pictures {
            0 => CameraDuty::Records,
            _ => CameraDuty::Watches,
        };
        Self {
            station,
            control: ControlLoop::new(config.rate_hz, now),
            guard: Guard::new(camera),
            config,
            show,
            shown: Shown { at: now, frames: 0, pictures: 0 },
            runs_planned: work.runs(),
            runs_done: 0,
            samples: 0,
            picture_to_command: None,
            lag_periods: (USUAL_LAG_SECONDS * config.rate_hz).round() as usize,
            periods_planned: work.periods(config.rate_hz),
            periods_done: 0,
            periods_in_leg: 0,
        }
    }

    fn drive(&mut self, work: Work<'_>) -> Result<(), StopReason> {
        arming::arm(&mut self.station, &mut self.control)?;
        if self.config.watchdog == WatchdogPolicy::Test {
            arming::prove_watchdogs(&mut self.station, &mut self.control)?;
        }
        match work {
            Work::Legs(legs) => self.drive_legs(legs),
            Work::Free(stretch) => self.drive_freely(stretch),
        }
    }

    fn drive_legs(&mut self, legs: &[Leg]) -> Result<(), StopReason> {
        self.station.note_of("phase", None, "going to the start");
        if let Some(first) = legs.first() {
            self.go_to(&first.starts())?;
        }
        for leg in legs {
            match &leg.run {
                Some(run) => {
                    self.stand(&leg.starts())?;
                    self.station.note_of("phase", None, &format!("run {}", run.number));
                    self.mark(run, Phase::Start);
                    let driven = self.follow(leg);
                    self.mark(run, Phase::End);
                    driven?;
                    self.runs_done += 1;
                    self.samples += leg.periods();
                }
                None => self.follow(leg)?,
            }
            self.periods_done += leg.periods();
            self.periods_in_leg = 0;
        }
        Ok(())
    }

    /// Leads carriages to these points (m).
    fn go_to(&mut self, points: &[(Player, [f64; 2])]) -> Result<(), StopReason> {
        let way = |(player, to): &(Player, [f64; 2])| {
            let (from, _) = self.station.carriage(*player).state()?;
            let limits = &self.station.robot.limits;
            // A rate or a point that cannot be has been refused long before.
            let way = Reference::transfer(from, *to, limits, self.config.rate_hz).ok()?;
            Some((*player, way))
        };
        let references = points.iter().filter_map(way).collect();
        self.follow(&Leg { run: None, references })
    }

    /// Stands at these points (m) for a moment.
    fn stand(&mut self, points: &[(Player, [f64; 2])]) -> Result<(), StopReason> {
        let rate = self.config.rate_hz;
        let still = vec![[0.0; 2]; (SETTLE_SECONDS * rate).round() as usize];
        let standing = |(player, point): &(Player, [f64; 2])| {
            Some((*player, Reference::from_velocities(*point, &still, rate).ok()?))
        };
        let references = points.iter().filter_map(standing).collect();
        self.follow(&Leg { run: None, references })
    }

    fn mark(&mut self, run: &RunLabel, phase: Phase) {
        let marker = RunMarker {
            run: run.number,
            pattern: run.pattern.clone(),
            phase: phase.into(),
            split: run.split.clone(),
        };
        self.station.record(self.station.now(), Entry::Marker(marker));
    }

    /// Drives one leg to its end.
    fn follow(&mut self, leg: &Leg) -> Result<(), StopReason> {
        self.guard.restart(MOST_LAG_SECONDS);
        let mut at = 0;
        while at < leg.periods() {
            let tick = self.control.wait(&mut self.station)?;
            // Periods that were left out are left out of the reference too.
            at += tick.advanced as usize - 1;
            let now = self.station.now();
            for (player, reference) in &leg.references {
                let Some(setpoint) = setpoint_at(reference, at) else { continue };
                self.guard.expect(*player, now, setpoint.position);
                let due = setpoint_at(reference, at.saturating_sub(self.lag_periods));
                let wanted = self.wanted(*player, &setpoint, due);
                self.control.command(&mut self.station, *player, wanted, tick);
            }
            at += 1;
            if leg.run.is_some() {
                self.periods_in_leg = at;
            }
            self.end_period(tick, leg.run.as_ref())?;
        }
        Ok(())
    }

    /// What follows the commands of every period.
    fn end_period(&mut self, tick: Tick, run: Option<&RunLabel>) -> Result<(), StopReason> {
        self.station.ask_temperatures();
        self.control.finish(&mut self.station, tick)?;
        self.guard.check(&self.station, self.control.all_commanded())?;
        self.show_progress(run);
        Ok(())
    }

    /// The velocity of the reference, with a weak pull towards where the carriage should have come by
    /// now.
    fn wanted(&self, player: Player, setpoint: &Setpoint, due: Option<Setpoint>) -> [f64; 2] {
        let Some((position, _)) = self.station.carriage(player).state() else {
            return setpoint.velocity;
        };
        let due = due.map_or(setpoint.position, |due| due.position);
        let pulled = [0, 1].map(|axis| {
            let pull = self.config.hold_gain_per_s * (due[axis] - position[axis]);
            setpoint.velocity[axis] + pull.clamp(-MOST_CORRECTION, MOST_CORRECTION)
        });
        let limits = &self.station.robot.limits;
        self.before_edges(player, pulled, (limits, limits.reaction_s))
    }

    /// `wanted` (m/s), but never faster towards an edge than the carriage can stop by `limits` from where it will
    /// be `ahead_s` (s) from now, when this command takes effect.
    fn before_edges(
        &self,
        player: Player,
        wanted: [f64; 2],
        (limits, ahead_s): (&Limits, f64),
    ) -> [f64; 2] {
        let Some((position, velocity)) = self.station.carriage(player).state() else {
            return wanted;
        };
        let soon = [0, 1].map(|axis| position[axis] + velocity[axis] * ahead_s);
        limits.before_edges(&self.station.robot.window(player), soon, wanted)
    }

    fn show_progress(&mut self, run: Option<&RunLabel>) {
        let now = self.station.now();
        let since = now.seconds_since(self.shown.at);
        if since < PROGRESS_SECONDS {
            return;
        }
        let counts = &self.station.counts;
        let shown = Shown { at: now, frames: counts.frames_received, pictures: counts.pictures };
        let before = std::mem::replace(&mut self.shown, shown);
        (self.show)(&Progress {
            run,
            runs_done: self.runs_done,
            runs: self.runs_planned,
            periods_done: self.periods_done + self.periods_in_leg,
            periods: self.periods_planned,
            frames_per_s: (counts.frames_received - before.frames) as f64 / since,
            pictures_per_s: (counts.pictures - before.pictures) as f64 / since,
            errors: counts.faults.values().sum::<u64>() + counts.setpoints_dropped,
            worst_tracking: self.guard.worst_tracking(),
            now,
        });
    }

    /// Stops as the reason demands, writes it down and completes the recording.
    fn close(
        mut self,
        reason: &StopReason,
        started: Nanos,
        census: Census,
    ) -> Result<SessionReport, SessionError> {
        let stop_text = reason.to_string();
        self.station.note_of("stop", reason.node(), &stop_text);
        let not_confirmed_off =
            arming::stop(&mut self.station, &mut self.control, reason.reaction());
        let twice = *reason == StopReason::Interrupted && 1 < self.station.presses();
        let reason = if twice { &StopReason::InterruptedTwice } else { reason };
        let stop_text = reason.to_string();
        if twice {
            self.station.note_of("escalation", None, &stop_text);
        }
        let losses = self.losses(&census, started);
        let Counts { frames_received, frames_sent, pictures, setpoints_dropped, .. } =
            self.station.counts;
        let report = SessionReport {
            schema_version: "1",
            stop: reason.code(),
            stop_text: stop_text.clone(),
            runs_planned: self.runs_planned,
            runs_done: self.runs_done,
            samples: self.samples,
            duration_s: self.station.now().seconds_since(started),
            not_confirmed_off,
            census,
            lateness: self.control.lateness(),
            picture_to_command: self.picture_to_command,
            worst_tracking_m: self.guard.worst_tracking(),
            frames_received,
            frames_sent,
            pictures,
            pictures_refused: self.station.camera.refused,
            setpoints_dropped,
            bus_faults: self.station.counts.faults.clone(),
            losses,
            warnings: self.warnings(),
        };
        let Some(recorder) = self.station.take_recorder() else { return Ok(report) };
        write_report(recorder, &report)
            .map_err(|error| SessionError::StoppedAndLost { stop: stop_text, recording: error })?;
        Ok(report)
    }

    fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if let Some(first) = &self.station.camera.first_refusal {
            let count = self.station.camera.refused;
            warnings.push(format!("{count} camera datagrams were not understood; first: {first}"));
        }
        if 0 < self.station.counts.not_understood {
            let count = self.station.counts.not_understood;
            warnings.push(format!("{count} frames on the bus are not of ODrive's protocol"));
        }
        if 0 < self.runs_done {
            for drive in self.station.drives.iter().filter(|drive| drive.temperatures.is_none()) {
                let node = drive.seat.node;
                warnings
                    .push(format!("node {node} reports no temperature: its heat is not watched"));
            }
        }
        warnings
    }

    /// What the recording lacks, each as a sentence: it then ends with status 3.
    fn losses(&self, census: &Census, since: Nanos) -> Vec<String> {
        let mut losses = self.station.losses();
        let late = self.control.lateness();
        if MOST_LOST_SHARE * (late.periods as f64) < late.skipped as f64 {
            let (skipped, kept) = (late.skipped, late.periods);
            losses.push(format!("{skipped} control periods were left out, {kept} kept"));
        }
        let dropped = self.station.counts.setpoints_dropped;
        if MOST_LOST_SHARE * (late.periods as f64) < dropped as f64 {
            losses.push(format!("the bus did not take {dropped} setpoints"));
        }
        let seconds = self.station.now().seconds_since(since);
        let positions = Command::EncoderEstimates;
        for rate in census.rates.iter().filter(|rate| rate.message == positions.name()) {
            let key = (rate.node, positions as u8);
            let came = self.station.counts.by_node.get(&key).copied().unwrap_or(0) as f64;
            let missing = 1.0 - came / (rate.rate_hz * seconds);
            // The rate itself is known to one message of the first look.
            let uncertainty = 1.0 / (rate.rate_hz * preflight::LISTEN_SECONDS);
            if MOST_LOST_SHARE + uncertainty < missing {
                let (node, percent) = (rate.node, 1e2 * missing);
                losses.push(format!("{percent:.0} % of the positions of node {node} are missing"));
            }
        }
        losses
    }
}

/// The setpoint of a period; after its end a motion rests there, since a drive must be told something
/// in every period.
fn setpoint_at(reference: &Reference, at: usize) -> Option<Setpoint> {
    let rest = || Some(Setpoint { position: reference.end()?, velocity: [0.0; 2] });
    reference.setpoints().get(at).copied().or_else(rest)
}

fn write_report(mut recorder: Recorder, report: &SessionReport) -> Result<(), String> {
    let text = serde_json::to_string(report).map_err(|error| error.to_string())?;
    let values = [
        ("stop".to_owned(), report.stop.to_owned()),
        ("stop_text".to_owned(), report.stop_text.clone()),
        ("report_json".to_owned(), text),
    ];
    recorder.metadata(SESSION_METADATA, values.into())?;
    recorder.finish().map_err(|error| error.to_string())
}

/// Records what is on the bus for `seconds`, or until a log ends, and sends nothing. Carriages count from
/// the motors' zero; orders of other programs become commands.
///
/// # Errors
/// When the recording cannot be written.
pub fn listen(
    link: &mut dyn Link,
    robot: &Robot,
    config: &SessionConfig,
    seconds: f64,
    output: SessionOutput<'_>,
) -> Result<SessionReport, SessionError> {
    let SessionOutput { writer, presses, show } = output;
    let mut station = Station::new(link, robot, &config.players, config.raw, presses)?;
    station.foreign_orders = ForeignOrders::Record;
    for player in Player::BOTH {
        station.carriage_mut(player).count_from_zero();
    }
    let mut metadata = config.metadata.clone();
    metadata.insert("carriage_origin".to_owned(), "unknown".to_owned());
    station.record_to(Recorder::start(writer, metadata)?);
    let started = station.now();
    let mut session = Session::new(station, config, &Work::Legs(&[]), show);
    let reason = session.hear(started.after_seconds(seconds)).err();
    session.close(&reason.unwrap_or(StopReason::Completed), started, Census::default())
}

impl Session<'_> {
    fn hear(&mut self, until: Nanos) -> Result<(), StopReason> {
        while self.station.now() < until && !self.station.ended {
            let soon = self.station.now().after_seconds(PROGRESS_SECONDS).min(until);
            self.station.wait_until(soon)?;
            if 0 < self.station.presses() {
                return Err(StopReason::Interrupted);
            }
            self.show_progress(None);
        }
        Ok(())
    }
}
