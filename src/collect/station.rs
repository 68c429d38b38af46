//! Operator's station: the link, the state of the table, and the recording. Every incoming and
//! outgoing message passes through here once.

use super::{
    reason::StopReason,
    recorder::{Entry, Recorder},
    traffic::{Traffic, TrafficWatch},
    watch::{Armed, CameraWatch, CarriageWatch, DriveWatch, Pairing},
};
use crate::{
    can::{
        self, AxisState, BROADCAST_NODE, Command, Decoded, Direction, Frame, FrameKind, Message,
        Payload,
    },
    gantry::{BeltError, CoreXy, DriveReport, MotorPair, MotorSeat, Robot},
    link::{BusFault, Event, Link, LinkError, parse_detections},
    recording::{
        message::{CameraDetections, MotorState, SessionEvent, VelocityCommand},
        topic::Player,
    },
    units::Nanos,
};
use std::{
    collections::BTreeMap,
    sync::atomic::{AtomicUsize, Ordering},
};

/// Number of repetitions of an emergency stop, against a single lost frame.
const ESTOP_REPEATS: usize = 3;
/// Longest wait of an emergency stop for a full transmit queue (s).
const ESTOP_PATIENCE_SECONDS: f64 = 0.005;
/// Retry interval of a full transmit queue (s).
const RETRY_SECONDS: f64 = 0.0002;
/// Interval of temperature requests to a drive that does not report its temperature (s).
const TEMPERATURE_SECONDS: f64 = 1.0;

/// Policy for commands of other programs to the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ForeignOrders {
    /// They end the session.
    Alarm,
    /// They are recorded.
    Record,
}

/// Policy for raw frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawFrames {
    /// Every frame, both directions, on `/can/frames`.
    Record,
    /// Only decoded messages.
    Omit,
}

/// Counters of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Counts {
    pub(super) frames_received: u64,
    pub(super) frames_sent: u64,
    pub(super) camera_frames: u64,
    pub(super) setpoints_dropped: u64,
    /// Frames that do not decode.
    pub(super) not_understood: u64,
    pub(super) faults: BTreeMap<String, u64>,
    pub(super) by_node: BTreeMap<(u8, u8), u64>,
}

/// Operator's station; see the module.
pub(super) struct Station<'a> {
    link: &'a mut dyn Link,
    pub(super) robot: &'a Robot,
    pub(super) gantry: CoreXy,
    pub(super) drives: Vec<DriveWatch>,
    carriages: [CarriageWatch; 2],
    foreign_setpoints: [Pairing<f64>; 2],
    pub(super) camera: CameraWatch,
    /// Camera frames that a pilot has not taken yet, with their capture time; `None` without a
    /// pilot.
    unseen: Option<Vec<(Nanos, CameraDetections)>>,
    pub(super) counts: Counts,
    traffic: TrafficWatch,
    pub(super) foreign_orders: ForeignOrders,
    pub(super) first_foreign: Option<(u8, Command)>,
    /// Time and number of the last temperature request.
    temperature_asked: (Nanos, usize),
    raw: RawFrames,
    recorder: Option<Recorder>,
    presses: &'a AtomicUsize,
    alarm: Option<StopReason>,
    pub(super) ended: bool,
}

impl<'a> Station<'a> {
    /// Create a station for the drives of `players`, without a recording.
    pub(super) fn new(
        link: &'a mut dyn Link,
        robot: &'a Robot,
        players: &[Player],
        raw: RawFrames,
        presses: &'a AtomicUsize,
    ) -> Result<Self, BeltError> {
        let gantry = robot.kinematics()?;
        let of_players = |seat: &&MotorSeat| players.contains(&seat.player);
        let seats = robot.drives.iter().filter(of_players);
        Ok(Self {
            link,
            robot,
            gantry,
            drives: seats.map(|seat| DriveWatch::new(*seat)).collect(),
            carriages: [CarriageWatch::new(gantry), CarriageWatch::new(gantry)],
            foreign_setpoints: [Pairing::default(), Pairing::default()],
            camera: CameraWatch::default(),
            unseen: None,
            counts: Counts::default(),
            traffic: TrafficWatch::default(),
            foreign_orders: ForeignOrders::Alarm,
            first_foreign: None,
            temperature_asked: (Nanos(0), 0),
            raw,
            recorder: None,
            presses,
            alarm: None,
            ended: false,
        })
    }

    pub(super) fn record_to(&mut self, recorder: Recorder) {
        self.recorder = Some(recorder);
    }

    pub(super) fn take_recorder(&mut self) -> Option<Recorder> {
        self.recorder.take()
    }

    pub(super) fn now(&self) -> Nanos {
        self.link.now()
    }

    pub(super) fn carriage(&self, player: Player) -> &CarriageWatch {
        &self.carriages[player as usize]
    }

    pub(super) fn carriage_mut(&mut self, player: Player) -> &mut CarriageWatch {
        &mut self.carriages[player as usize]
    }

    /// Record the true state, where a simulator provides it.
    pub(super) fn record_truth(&mut self) {
        if let Some(state) = self.link.true_state() {
            self.record(self.link.now(), Entry::Truth(state));
        }
    }

    /// Return the losses of the link, and whether no frame arrived at all.
    pub(super) fn losses(&self) -> Vec<String> {
        let mut losses = self.link.losses();
        if self.counts.frames_received == 0 {
            losses.push("no frame came in; check cable, supply and bit rate".to_owned());
        }
        losses
    }

    /// Return the traffic of the session so far.
    pub(super) fn traffic(&self) -> Traffic {
        self.traffic.summary(self.robot, self.camera.rejected)
    }

    /// Keep camera frames from now on for [`take_camera_frames`](Self::take_camera_frames).
    pub(super) fn keep_camera_frames(&mut self) {
        self.unseen = Some(Vec::new());
    }

    /// Return the camera frames since the last call in order of arrival, with their capture time.
    pub(super) fn take_camera_frames(&mut self) -> Vec<(Nanos, CameraDetections)> {
        self.unseen.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// Return the number of Ctrl-C presses.
    pub(super) fn presses(&self) -> usize {
        self.presses.load(Ordering::Relaxed)
    }

    /// Process events until `until`; return early with a stop reason.
    pub(super) fn wait_until(&mut self, until: Nanos) -> Result<(), StopReason> {
        loop {
            match self.link.next_event(until) {
                Ok(Some(event)) => self.absorb(event),
                Ok(None) => return self.alarm.take().map_or(Ok(()), Err),
                Err(error) => return Err(StopReason::LinkBroken { reason: error.to_string() }),
            }
            if let Some(reason) = self.alarm.take() {
                return Err(reason);
            }
            if self.ended {
                return Ok(());
            }
        }
    }

    /// Raise a stop reason; the first one counts.
    pub(super) fn raise(&mut self, reason: StopReason) {
        self.alarm.get_or_insert(reason);
    }

    fn absorb(&mut self, event: Event) {
        match event {
            Event::Frame { received_at, stamped_at, frame, direction } => {
                self.counts.frames_received += 1;
                self.traffic.push_frame(received_at);
                let stamp = stamped_at.unwrap_or(received_at);
                self.record_frame([received_at, stamp], &frame, direction);
                self.absorb_frame(received_at, &frame);
            }
            Event::Camera { received_at, datagram } => {
                self.absorb_camera_frame(received_at, &datagram)
            }
            Event::Fault { fault, .. } => self.absorb_fault(fault),
            Event::End => self.ended = true,
        }
    }

    fn absorb_frame(&mut self, time: Nanos, frame: &Frame) {
        if frame.kind == FrameKind::Error {
            return;
        }
        let Ok(Decoded { node, message }) = can::decode(frame) else {
            self.counts.not_understood += 1;
            return;
        };
        let command = message.command();
        *self.counts.by_node.entry((node, command as u8)).or_default() += 1;
        self.traffic.push_message(time, node, &message);
        if matches!(message, Message::Request(_)) {
            return;
        }
        if command.is_order() {
            self.absorb_foreign_order(time, node, &message);
        } else if let Some(index) = self.drives.iter().position(|drive| drive.seat.node == node) {
            self.absorb_report(index, time, &message);
        }
    }

    fn absorb_foreign_order(&mut self, time: Nanos, node: u8, message: &Message) {
        if self.foreign_orders == ForeignOrders::Record {
            self.record_foreign_setpoint(time, node, message);
        } else if node == BROADCAST_NODE || self.robot.seat_of_node(node).is_some() {
            let command = message.command();
            self.first_foreign.get_or_insert((node, command));
            if self.drives.iter().any(|drive| drive.armed != Armed::No) {
                self.raise(StopReason::ForeignCommand { node, command });
            }
        }
    }

    fn record_foreign_setpoint(&mut self, time: Nanos, node: u8, message: &Message) {
        let Message::SetInputVel { velocity_turns_per_s, .. } = *message else { return };
        let Some(seat) = self.robot.seat_of_node(node) else { return };
        let directed = seat.directed(velocity_turns_per_s.into());
        let pairing = &mut self.foreign_setpoints[seat.player as usize];
        if let Some((at, [a, b])) = pairing.push(seat.motor, time, directed) {
            let [vx, vy] = self.gantry.board_from_motors(MotorPair { a, b });
            self.record(at, Entry::Command(seat.player, VelocityCommand { vx, vy }));
        }
    }

    fn absorb_report(&mut self, index: usize, time: Nanos, message: &Message) {
        let drive = &mut self.drives[index];
        let seat = drive.seat;
        let before = drive.state();
        let report = drive.push(time, message);
        let after = drive.state();
        match report {
            Some(DriveReport::Motor(motor)) => self.absorb_motor(seat, time, motor),
            Some(DriveReport::Status(status)) => {
                self.record(time, Entry::Drive(seat.player, seat.motor, status));
            }
            None => {}
        }
        if before != after {
            let text = after.map(|state| state.to_string()).unwrap_or_default();
            self.note_of("drive", Some(seat.node), &text);
        }
        self.check_armed(index);
    }

    /// Raise a fault when an armed drive leaves closed loop or reports an error.
    fn check_armed(&mut self, index: usize) {
        let drive = &mut self.drives[index];
        let (state, errors) = drive.state_and_errors();
        let seat = drive.seat;
        match drive.armed {
            Armed::Asked if state == AxisState::ClosedLoopControl && errors.is_empty() => {
                drive.armed = Armed::Confirmed;
            }
            Armed::Confirmed if state != AxisState::ClosedLoopControl || !errors.is_empty() => {
                drive.armed = Armed::Released; // reported once
                self.raise(StopReason::AxisLeft { seat, state, errors });
            }
            _ => {}
        }
    }

    fn absorb_motor(&mut self, seat: MotorSeat, time: Nanos, motor: MotorState) {
        self.record(time, Entry::Motor(seat.player, seat.motor, motor));
        let carriage = &mut self.carriages[seat.player as usize];
        if let Some((at, state)) = carriage.push(seat.motor, time, motor) {
            self.record(at, Entry::Carriage(seat.player, state));
        }
    }

    fn absorb_camera_frame(&mut self, time: Nanos, datagram: &[u8]) {
        match parse_detections(datagram) {
            Ok(detections) => {
                self.counts.camera_frames += 1;
                self.traffic.push_camera_frame(time);
                let shown = self.camera.push(time, &detections);
                if let Some(unseen) = &mut self.unseen {
                    unseen.push((shown, detections));
                }
                self.record_at([time, shown], Entry::Camera(detections));
                if self.unseen.is_some() {
                    self.record_truth();
                }
            }
            Err(error) => {
                self.camera.rejected += 1;
                self.camera.first_rejection.get_or_insert_with(|| error.to_string());
            }
        }
    }

    fn absorb_fault(&mut self, fault: BusFault) {
        let count = self.counts.faults.entry(fault.to_string()).or_default();
        *count += 1;
        if *count == 1 {
            self.warn(&format!("the bus reports: {fault}"));
        }
        if fault.is_fatal() {
            self.raise(StopReason::BusFailed { fault });
        }
    }

    /// Send one message to a drive and record it.
    ///
    /// # Errors
    /// When the bus does not take it.
    pub(super) fn send(&mut self, node: u8, message: &Message) -> Result<(), LinkError> {
        let mut frame = can::encode(node, message);
        if frame.kind == FrameKind::Remote && !self.link.capabilities().remote_frames {
            frame.kind = FrameKind::Data;
            frame.data = Payload::default();
        }
        self.link.send(&frame)?;
        self.counts.frames_sent += 1;
        let now = self.link.now();
        self.record_frame([now, now], &frame, Direction::Sent);
        Ok(())
    }

    /// Request the temperature of one drive after the other, each about once a second, unless it
    /// reports cyclically. A missing answer is not a fault; it is a warning of the session.
    pub(super) fn ask_temperatures(&mut self) {
        let now = self.link.now();
        let every = TEMPERATURE_SECONDS / self.drives.len() as f64;
        let told = 0 < self.robot.can.cyclic_ms.temperature;
        if told || !self.link.capabilities().remote_frames {
            return;
        }
        if now.seconds_since(self.temperature_asked.0) < every {
            return;
        }
        let (_, turn) = self.temperature_asked;
        self.temperature_asked = (now, turn + 1);
        let node = self.drives[turn % self.drives.len()].seat.node;
        self.send(node, &Message::Request(Command::Temperature)).ok();
    }

    /// Send now, or as soon as the transmit queue takes the message, or not at all after `give_up`.
    /// No message is queued.
    ///
    /// # Errors
    /// When the queue stays full, or the connection is broken.
    pub(super) fn send_by(
        &mut self,
        give_up: Nanos,
        node: u8,
        message: &Message,
    ) -> Result<(), LinkError> {
        loop {
            match self.send(node, message) {
                Err(LinkError::Full { .. }) if self.link.now() < give_up => {
                    log::debug!("node {node}: the transmit queue is full; retrying");
                    let again = self.link.now().after_seconds(RETRY_SECONDS).min(give_up);
                    if let Err(reason) = self.wait_until(again) {
                        self.raise(reason); // returned by the next wait of the control loop
                    }
                }
                result => return result,
            }
        }
    }

    /// Send an emergency stop to the drives of `players`, three times. Each node comes first, since
    /// its id wins arbitration over the broadcast, which follows when all are meant.
    pub(super) fn estop(&mut self, players: &[Player]) {
        let all = self.drives.iter().all(|drive| players.contains(&drive.seat.player));
        let nodes: Vec<u8> = self
            .drives
            .iter()
            .filter(|drive| players.contains(&drive.seat.player))
            .map(|drive| drive.seat.node)
            .chain(all.then_some(BROADCAST_NODE))
            .collect();
        for _ in 0..ESTOP_REPEATS {
            for node in &nodes {
                // The bus may have failed; the drives' watchdog is the last resort.
                let give_up = self.link.now().after_seconds(ESTOP_PATIENCE_SECONDS);
                self.send_by(give_up, *node, &Message::Estop).ok();
            }
        }
        for drive in &mut self.drives {
            if players.contains(&drive.seat.player) {
                drive.armed = Armed::No;
            }
        }
    }

    /// Record a message whose source has no clock.
    pub(super) fn record(&mut self, time: Nanos, entry: Entry) {
        self.record_at([time, time], entry);
    }

    fn record_at(&mut self, times: [Nanos; 2], entry: Entry) {
        let Some(recorder) = &mut self.recorder else { return };
        if let Err(reason) = recorder.write(times, entry) {
            self.recorder = None;
            self.raise(StopReason::RecordingFailed { reason });
        }
    }

    fn record_frame(&mut self, times: [Nanos; 2], frame: &Frame, direction: Direction) {
        if self.raw == RawFrames::Record {
            self.record_at(times, Entry::Can(frame.recorded(direction)));
        }
    }

    /// Add a note to the recording.
    pub(super) fn note_of(&mut self, kind: &str, node: Option<u8>, text: &str) {
        let event = SessionEvent {
            kind: kind.to_owned(),
            text: text.to_owned(),
            node: node.map(u32::from),
        };
        self.record(self.link.now(), Entry::Event(event));
    }

    /// Add a warning to the recording.
    pub(super) fn warn(&mut self, text: &str) {
        self.note_of("warning", None, text);
    }
}

impl Drop for Station<'_> {
    /// After a panic, or any early return: no drive stays armed.
    fn drop(&mut self) {
        if self.drives.iter().any(|drive| drive.armed != Armed::No) {
            self.estop(&Player::BOTH);
        }
    }
}
