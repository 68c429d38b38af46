//! The operator's station: the link, what is known about the table, and the recording. Everything
//! that comes in passes through here once, and everything that goes out.

use super::{
    reason::StopReason,
    recorder::{Entry, Recorder},
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

/// How often an emergency stop is repeated, so that a single lost frame does not undo it.
const ESTOP_REPEATS: usize = 3;
/// How long each emergency stop waits for a full transmit queue (s).
const ESTOP_PATIENCE_SECONDS: f64 = 0.005;
/// A full transmit queue is tried again after this time (s).
const RETRY_SECONDS: f64 = 0.0002;
/// A drive that does not tell its temperature is asked this often (s).
const TEMPERATURE_SECONDS: f64 = 1.0;

/// What is done about orders of other programs to the drives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ForeignOrders {
    /// They end the session.
    Alarm,
    /// They are what is being recorded.
    Record,
}

/// Whether every frame is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawFrames {
    /// Every frame, both directions, on `/can/frames`.
    Record,
    /// Only what the frames mean.
    Omit,
}

/// Counts of a session.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Counts {
    pub(super) frames_received: u64,
    pub(super) frames_sent: u64,
    pub(super) pictures: u64,
    pub(super) setpoints_dropped: u64,
    /// Frames that are not of the protocol, or of nodes that the robot file does not have.
    pub(super) not_understood: u64,
    pub(super) faults: BTreeMap<String, u64>,
    /// Frames by node and command.
    pub(super) by_node: BTreeMap<(u8, u8), u64>,
}

/// See the module.
pub(super) struct Station<'a> {
    link: &'a mut dyn Link,
    pub(super) robot: &'a Robot,
    pub(super) gantry: CoreXy,
    pub(super) drives: Vec<DriveWatch>,
    carriages: [CarriageWatch; 2],
    foreign_setpoints: [Pairing<f64>; 2],
    pub(super) camera: CameraWatch,
    /// Pictures that a pilot has not seen yet, with the time at which they show the board; `None` while
    /// there is no pilot.
    unseen: Option<Vec<(Nanos, CameraDetections)>>,
    pub(super) counts: Counts,
    pub(super) foreign_orders: ForeignOrders,
    pub(super) first_foreign: Option<(u8, Command)>,
    /// When a temperature was asked for last, and how often.
    temperature_asked: (Nanos, usize),
    raw: RawFrames,
    recorder: Option<Recorder>,
    presses: &'a AtomicUsize,
    alarm: Option<StopReason>,
    pub(super) ended: bool,
}

impl<'a> Station<'a> {
    /// A station for the drives of `players`, which records nothing yet.
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

    /// Records what is really the case, where a simulator tells it.
    pub(super) fn record_truth(&mut self) {
        if let Some(state) = self.link.true_state() {
            self.record(self.link.now(), Entry::Truth(state));
        }
    }

    /// What the link could not deliver, and that nothing came at all.
    pub(super) fn losses(&self) -> Vec<String> {
        let mut losses = self.link.losses();
        if self.counts.frames_received == 0 {
            losses.push("no frame came in; check cable, supply and bit rate".to_owned());
        }
        losses
    }

    /// From now on pictures are kept for [`take_pictures`](Self::take_pictures).
    pub(super) fn keep_pictures(&mut self) {
        self.unseen = Some(Vec::new());
    }

    /// Pictures since the last call, in order of their arrival, with the time at which they show the board.
    pub(super) fn take_pictures(&mut self) -> Vec<(Nanos, CameraDetections)> {
        self.unseen.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// How often the person has pressed Ctrl-C.
    pub(super) fn presses(&self) -> usize {
        self.presses.load(Ordering::Relaxed)
    }

    /// Takes events until `until`; ends early with a reason to stop.
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

    /// Notes a reason to stop; the first one counts.
    pub(super) fn raise(&mut self, reason: StopReason) {
        self.alarm.get_or_insert(reason);
    }

    fn absorb(&mut self, event: Event) {
        match event {
            Event::Frame { received_at, stamped_at, frame, direction } => {
                self.counts.frames_received += 1;
                let stamp = stamped_at.unwrap_or(received_at);
                self.record_frame([received_at, stamp], &frame, direction);
                self.absorb_frame(received_at, &frame);
            }
            Event::Camera { received_at, datagram } => self.absorb_picture(received_at, &datagram),
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

    /// An armed drive that is in closed loop no more, or reports an error, is a fault at once.
    fn check_armed(&mut self, index: usize) {
        let drive = &mut self.drives[index];
        let (state, errors) = drive.state_and_errors();
        let seat = drive.seat;
        match drive.armed {
            Armed::Asked if state == AxisState::ClosedLoopControl && errors.is_empty() => {
                drive.armed = Armed::Confirmed;
            }
            Armed::Confirmed if state != AxisState::ClosedLoopControl || !errors.is_empty() => {
                drive.armed = Armed::LetGo; // told once
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

    fn absorb_picture(&mut self, time: Nanos, datagram: &[u8]) {
        match parse_detections(datagram) {
            Ok(detections) => {
                self.counts.pictures += 1;
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
                self.camera.refused += 1;
                self.camera.first_refusal.get_or_insert_with(|| error.to_string());
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

    /// Sends one message to a drive and records it.
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

    /// Asks one drive after the other how warm it is, each about once a second, unless they tell it by
    /// themselves. An answer that does not come is no fault: it is in the session's warnings.
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

    /// Sends now, or as soon as the transmit queue takes it, or not at all after `give_up`: nothing is
    /// kept for later.
    ///
    /// # Errors
    /// When the queue stays full, or the bus is broken.
    pub(super) fn send_by(
        &mut self,
        give_up: Nanos,
        node: u8,
        message: &Message,
    ) -> Result<(), LinkError> {
        loop {
            match self.send(node, message) {
                Err(LinkError::Full { .. }) if self.link.now() < give_up => {
                    log::debug!("node {node}: the transmit queue is full; trying again");
                    let again = self.link.now().after_seconds(RETRY_SECONDS).min(give_up);
                    if let Err(reason) = self.wait_until(again) {
                        self.raise(reason); // the next wait of the control loop tells it
                    }
                }
                result => return result,
            }
        }
    }

    /// Emergency stop of the drives of `players`: each node first, since its id wins arbitration
    /// over the broadcast, which follows when all are meant; three times.
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
                // The bus may be what has failed; the drives' watchdog is the last resort.
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

    /// Records a message whose source has no clock of its own.
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

    /// Notes something in the recording.
    pub(super) fn note_of(&mut self, kind: &str, node: Option<u8>, text: &str) {
        let event = SessionEvent {
            kind: kind.to_owned(),
            text: text.to_owned(),
            node: node.map(u32::from),
        };
        self.record(self.link.now(), Entry::Event(event));
    }

    /// Notes a doubt in the recording.
    pub(super) fn warn(&mut self, text: &str) {
        self.note_of("warning", None, text);
    }
}

impl Drop for Station<'_> {
    /// After a panic, or any way out that forgot to: no drive stays armed.
    fn drop(&mut self) {
        if self.drives.iter().any(|drive| drive.armed != Armed::No) {
            self.estop(&Player::BOTH);
        }
    }
}
