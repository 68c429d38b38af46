//! Session: preflight, homing, arming, the legs or a free run, disarming, and the report.

mod free;

use super::{
    arming::{self, WatchdogPolicy},
    control::{self, ControlLoop, LoopTiming, Tick},
    guard::{CameraDuty, Expected, Guard, MOST_LAG_SECONDS},
    homing::{self, HomingPolicy},
    leg::{Leg, RunLabel},
    pilot::Work,
    preflight::{self, BusState, Problem},
    reason::StopReason,
    recorder::{Entry, Recorder},
    report::{ImageToCommand, Progress, SessionReport},
    station::{Counts, ForeignOrders, RawFrames, Station},
};
use crate::{
    can::{BROADCAST_NODE, Command},
    gantry::{BeltError, Limits, MotorSeat, Reference, Robot, Setpoint},
    link::Link,
    recording::{
        RecordingError, RecordingWriter, SESSION_METADATA,
        message::{RunMarker, run_marker::Phase},
        topic::Player,
    },
    scene::SceneSettings,
    units::Nanos,
};
use std::{collections::BTreeMap, sync::atomic::AtomicUsize};

/// Duration of standstill before each run (s).
const SETTLE_SECONDS: f64 = 0.4;
/// Largest position correction in a command (m/s).
const MOST_CORRECTION: f64 = 0.05;
/// Usual lag of a carriage behind its reference (s): half a period, the bus, and delay and lag of
/// the drive. The paper reports 40 to 60 ms.
const USUAL_LAG_SECONDS: f64 = 0.05;
/// Fraction of lost periods, setpoints or positions above which a recording is incomplete.
const MOST_LOST_FRACTION: f64 = 0.01;
/// Interval of the live view (s).
const PROGRESS_SECONDS: f64 = 0.1;

/// Settings of a session.
#[derive(Debug, Clone, PartialEq)]
pub struct SessionConfig {
    /// Players whose carriages are driven.
    pub players: Vec<Player>,
    /// Rate of the control loop (Hz).
    pub rate_hz: f64,
    /// Method of referencing positions.
    pub homing: HomingPolicy,
    /// Policy for the drives' watchdogs.
    pub watchdog: WatchdogPolicy,
    /// Recording of raw frames.
    pub raw: RawFrames,
    /// Firmware other than 0.6.x that the operator accepts, as `major.minor.revision`.
    pub accepted_firmware: Vec<String>,
    /// Gain of the position correction towards the path ((m/s)/m): enough to cancel drift, and
    /// small enough to leave the drive's own response visible.
    pub hold_gain_per_s: f64,
    /// Scene to record on `/scene`; `None` for no scene.
    pub scene: Option<SceneSettings>,
    /// Entries of the metadata record that every recording has.
    pub metadata: BTreeMap<String, String>,
}

/// Error of a session that did not start, or left no recording.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The preflight check found problems.
    #[error("not armed: {}", .0.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
    Preflight(Vec<Problem>),
    /// Positions cannot be referenced.
    #[error(transparent)]
    Homing(#[from] homing::HomingError),
    /// Writing the recording failed.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The belt of the robot file is invalid.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// The session stopped, and the recording could not be completed either.
    #[error("{stop}; the file could not be completed: {recording}")]
    StoppedAndLost {
        /// Stop reason.
        stop: String,
        /// Error of the recording.
        recording: String,
    },
}

/// Run a session on `link` and write it with `writer`. `presses` counts Ctrl-C: one ramps down, two
/// stop at once. `show` is called ten times a second.
///
/// # Errors
/// When nothing was armed. A session that started ends with a report for any stop reason.
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
    let (bus, mut problems) =
        preflight::look(&mut station, config.rate_hz, &config.accepted_firmware);
    log::info!("{} drives on the bus", bus.firmware.len());
    if matches!(work, Work::Free(_)) && station.counts.camera_frames == 0 {
        problems.push(Problem::NoCameraFrames);
    }
    if !problems.is_empty() {
        discard(writer);
        return Err(SessionError::Preflight(problems));
    }
    if let Err(error) = homing::reference(&mut station, &config.players, config.homing) {
        discard(writer);
        return Err(error.into());
    }
    log::info!("positions are referenced");
    record(&mut station, writer, config, control::arrivals(&config.players, &robot.can))?;
    let mut session = Session::new(station, config, &work, show);
    let reason = session.drive(work).err().unwrap_or(StopReason::Completed);
    log::info!("{reason}");
    session.close(&reason, started, bus)
}

/// Begin the recording, if there is one, with the metadata of `config` and `more` entries.
fn record(
    station: &mut Station<'_>,
    writer: Option<RecordingWriter>,
    config: &SessionConfig,
    more: impl IntoIterator<Item = (String, String)>,
) -> Result<(), SessionError> {
    let Some(writer) = writer else { return Ok(()) };
    let mut metadata = config.metadata.clone();
    metadata.extend(more);
    station.record_to(Recorder::start(writer, metadata, config.scene.clone())?);
    Ok(())
}

fn discard(writer: Option<RecordingWriter>) {
    if let Some(writer) = writer {
        writer.discard();
    }
}

/// Output of a session: recording, interruption and live view.
pub struct SessionOutput<'a> {
    /// Writer of the recording; `None` for a session that is not recorded.
    pub writer: Option<RecordingWriter>,
    /// Number of Ctrl-C presses.
    pub presses: &'a AtomicUsize,
    /// Live view, called ten times a second.
    pub show: &'a mut dyn FnMut(&Progress<'_>),
}

/// State of the last live view.
struct Shown {
    at: Nanos,
    frames: u64,
    camera_frames: u64,
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
    image_to_command: Option<ImageToCommand>,
    /// Usual lag of a carriage behind its reference, in periods.
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
        // Once frames have arrived, the camera is monitored, for any method of referencing.
        let camera = match station.counts.camera_frames {
            0 => CameraDuty::Records,
            _ => CameraDuty::Watches,
        };
        let encoder_s = station.robot.timeouts.encoder_s;
        Self {
            station,
            control: ControlLoop::new(config.rate_hz, now),
            guard: Guard::new(camera, encoder_s),
            config,
            show,
            shown: Shown { at: now, frames: 0, camera_frames: 0 },
            runs_planned: work.runs(),
            runs_done: 0,
            samples: 0,
            image_to_command: None,
            lag_periods: (USUAL_LAG_SECONDS * config.rate_hz).round() as usize,
            periods_planned: work.periods(config.rate_hz),
            periods_done: 0,
            periods_in_leg: 0,
        }
    }

    fn drive(&mut self, work: Work<'_>) -> Result<(), StopReason> {
        arming::arm(&mut self.station, &mut self.control)?;
        if self.config.watchdog == WatchdogPolicy::Test {
            arming::test_watchdogs(&mut self.station, &mut self.control)?;
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

    /// Move the carriages to these points (m).
    fn go_to(&mut self, points: &[(Player, [f64; 2])]) -> Result<(), StopReason> {
        let way = |(player, to): &(Player, [f64; 2])| {
            let (from, _) = self.station.carriage(*player).state()?;
            let limits = &self.station.robot.limits;
            // An invalid rate or point was refused before.
            let way = Reference::transfer(from, *to, limits, self.config.rate_hz).ok()?;
            Some((*player, way))
        };
        let references = points.iter().filter_map(way).collect();
        self.follow(&Leg { run: None, references })
    }

    /// Hold the carriages at these points (m) for a moment.
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

    /// Execute one leg to its end.
    fn follow(&mut self, leg: &Leg) -> Result<(), StopReason> {
        self.guard.restart(MOST_LAG_SECONDS);
        let mut at = 0;
        while at < leg.periods() {
            let tick = self.control.wait(&mut self.station)?;
            // Missed periods are skipped in the reference too.
            at += tick.advanced as usize - 1;
            let now = self.station.now();
            for (player, reference) in &leg.references {
                let Some(setpoint) = setpoint_at(reference, at) else { continue };
                self.guard.expect(*player, now, Expected::at(setpoint.position));
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

    /// Finish a period after its commands.
    fn end_period(&mut self, tick: Tick, run: Option<&RunLabel>) -> Result<(), StopReason> {
        self.station.ask_temperatures();
        self.control.finish(&mut self.station, tick)?;
        self.guard.check(&self.station, self.control.all_commanded())?;
        self.show_progress(run);
        Ok(())
    }

    /// Return the velocity of the reference plus a weak correction towards the position expected by
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

    /// Limit `wanted` (m/s) towards edges to the speed from which the carriage can stop within
    /// `limits`. The position is that at `ahead_s` (s) from now, when this command takes effect.
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
        limits.before_edges(&self.station.robot.soft_limits(player), soon, wanted)
    }

    fn show_progress(&mut self, run: Option<&RunLabel>) {
        let now = self.station.now();
        let since = now.seconds_since(self.shown.at);
        if since < PROGRESS_SECONDS {
            return;
        }
        let counts = &self.station.counts;
        let shown =
            Shown { at: now, frames: counts.frames_received, camera_frames: counts.camera_frames };
        let before = std::mem::replace(&mut self.shown, shown);
        (self.show)(&Progress {
            run,
            runs_done: self.runs_done,
            runs: self.runs_planned,
            periods_done: self.periods_done + self.periods_in_leg,
            periods: self.periods_planned,
            frames_per_s: (counts.frames_received - before.frames) as f64 / since,
            camera_frames_per_s: (counts.camera_frames - before.camera_frames) as f64 / since,
            errors: counts.faults.values().sum::<u64>() + counts.setpoints_dropped,
            worst_tracking: self.guard.worst_tracking(),
            now,
        });
    }

    /// Stop as the reason demands, record it and complete the recording.
    fn close(
        mut self,
        reason: &StopReason,
        started: Nanos,
        bus: BusState,
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
        let losses = self.losses(&bus, started);
        let Counts { frames_received, frames_sent, camera_frames, setpoints_dropped, .. } =
            self.station.counts;
        let report = SessionReport {
            schema_version: 2,
            stop: reason.code(),
            stop_text: stop_text.clone(),
            runs_planned: self.runs_planned,
            runs_done: self.runs_done,
            samples: self.samples,
            duration_s: self.station.now().seconds_since(started),
            not_confirmed_off,
            bus,
            traffic: self.station.traffic(),
            control_loop: self.control.timing(),
            image_to_command: self.image_to_command,
            worst_tracking_m: self.guard.worst_tracking(),
            frames_received,
            frames_sent,
            camera_frames,
            camera_frames_rejected: self.station.camera.rejected,
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
        if let Some(first) = &self.station.camera.first_rejection {
            let count = self.station.camera.rejected;
            warnings
                .push(format!("{count} camera datagrams could not be decoded; the first: {first}"));
        }
        if 0 < self.station.counts.not_understood {
            let count = self.station.counts.not_understood;
            warnings.push(format!("{count} frames on the bus do not belong to ODrive's protocol"));
        }
        if self.station.foreign_orders == ForeignOrders::Record {
            warnings.extend(traffic_warnings(&self.station));
        }
        if 0 < self.runs_done {
            for drive in self.station.drives.iter().filter(|drive| drive.temperatures.is_none()) {
                let node = drive.seat.node;
                warnings.push(format!(
                    "node {node} reports no temperature: overheating is not monitored"
                ));
            }
        }
        warnings
    }

    /// Return the losses in the recording, each as a sentence; any loss means exit status 3.
    fn losses(&self, bus: &BusState, since: Nanos) -> Vec<String> {
        let mut losses = self.station.losses();
        let LoopTiming { periods, missed_deadlines, .. } = self.control.timing();
        let allowed = MOST_LOST_FRACTION * periods as f64;
        if allowed < missed_deadlines as f64 {
            losses.push(format!(
                "{missed_deadlines} missed deadlines of the control loop, {periods} kept"
            ));
        }
        let dropped = self.station.counts.setpoints_dropped;
        if allowed < dropped as f64 {
            losses.push(format!("the bus did not take {dropped} setpoints"));
        }
        let seconds = self.station.now().seconds_since(since);
        let positions = Command::EncoderEstimates;
        for rate in bus.rates.iter().filter(|rate| rate.message == positions.name()) {
            let key = (rate.node, positions as u8);
            let came = self.station.counts.by_node.get(&key).copied().unwrap_or(0) as f64;
            let missing = 1.0 - came / (rate.rate_hz * seconds);
            // The rate itself is known to one message of the preflight check.
            let uncertainty = 1.0 / (rate.rate_hz * preflight::LISTEN_SECONDS);
            if MOST_LOST_FRACTION + uncertainty < missing {
                let (node, percent) = (rate.node, 1e2 * missing);
                losses.push(format!("{percent:.0} % of the positions of node {node} are missing"));
            }
        }
        losses
    }
}

/// Return the setpoint of a period. After the end of a motion it rests there, because a drive needs
/// a command in every period.
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

/// Record the bus for `seconds`, or until the end of a log, without sending. Carriage positions
/// count from the motors' zero; commands of other programs are recorded as commands.
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
    let unknown_origin = [("carriage_origin".to_owned(), "unknown".to_owned())];
    record(&mut station, writer, config, unknown_origin)?;
    let started = station.now();
    let mut session = Session::new(station, config, &Work::Legs(&[]), show);
    let reason = session.hear(started.after_seconds(seconds)).err();
    let bus = preflight::load_of_traffic(&session.station);
    session.close(&reason.unwrap_or(StopReason::Completed), started, bus)
}

/// Return warnings about silent drives, unknown nodes and reported errors.
fn traffic_warnings(station: &Station<'_>) -> Vec<String> {
    let traffic = station.traffic();
    let mut warnings = Vec::new();
    for MotorSeat { node, player, motor, .. } in station.drives.iter().map(|drive| drive.seat) {
        if !traffic.nodes.iter().any(|heard| heard.node == node) {
            warnings.push(format!("node {node} ({player} {}) was not heard", motor.name()));
        }
    }
    for node in &traffic.nodes {
        if node.motor.is_none() && node.node != BROADCAST_NODE {
            warnings.push(format!("node {} is not in the robot file", node.node));
        }
        if let Some(errors) = node.errors.as_ref().filter(|_| node.has_errors()) {
            warnings.push(format!("node {} reports errors {errors}", node.node));
        }
    }
    warnings
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
