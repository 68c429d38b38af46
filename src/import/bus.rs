//! Conversion of frames on the drives' bus into the topics of the contract.
//!
//! Every frame goes to `/can/frames`. Encoder estimates become motors. Heartbeats become drive
//! health, with the values of other reports of the last second. Pairs of velocity setpoints become
//! commands. A torque is attached to an encoder estimate only when it is at most 15 ms old.

use super::{
    drives::Setpoints,
    report::Notice,
    tape::{Outgoing, Tape},
};
use crate::{
    can::{self, BROADCAST_NODE, Direction, Frame, FrameKind, Message},
    gantry::{CoreXy, DriveReport, DriveReports, KLASKTRON_SEATS, MotorSeat},
    recording::topic,
    units::Nanos,
};

/// Decoder of frames in order of their time.
#[derive(Debug)]
pub(super) struct BusDecoder {
    setpoints: Setpoints,
    reports: [DriveReports; KLASKTRON_SEATS.len()],
    foreign: Option<(usize, u8)>,
    not_decoded: Option<(usize, String)>,
}

impl Default for BusDecoder {
    fn default() -> Self {
        Self {
            setpoints: Setpoints::default(),
            // Seats are listed by node id, 0 to 3.
            reports: KLASKTRON_SEATS.map(DriveReports::new),
            foreign: None,
            not_decoded: None,
        }
    }
}

impl BusDecoder {
    /// Add one frame with log and publish time.
    pub(super) fn push(
        &mut self,
        tape: &mut Tape,
        times: [Nanos; 2],
        frame: &Frame,
        direction: Option<Direction>,
    ) {
        // A log without directions was recorded by listening.
        let copy = frame.recorded(direction.unwrap_or(Direction::Received));
        tape.push_published(topic::CAN_FRAMES, times, Outgoing::Can(copy));
        if frame.kind == FrameKind::Error {
            return;
        }
        match can::decode(frame) {
            Ok(decoded) => match MotorSeat::of_node(decoded.node) {
                Some(seat) => self.message(tape, seat, times[0], &decoded.message),
                None if decoded.node == BROADCAST_NODE => {}
                None => self.foreign.get_or_insert((0, decoded.node)).0 += 1,
            },
            Err(error) => {
                self.not_decoded.get_or_insert_with(|| (0, error.to_string())).0 += 1;
            }
        }
    }

    fn message(&mut self, tape: &mut Tape, seat: MotorSeat, time: Nanos, message: &Message) {
        if let Message::SetInputVel { velocity_turns_per_s, .. } = message
            && velocity_turns_per_s.is_finite()
        {
            self.setpoints.push(seat, time, f64::from(*velocity_turns_per_s));
        }
        match self.reports[usize::from(seat.node)].push(time, message) {
            Some(DriveReport::Motor(motor)) => {
                tape.push(&topic::motor(seat.player, seat.motor), time, Outgoing::Motor(motor));
            }
            Some(DriveReport::Status(status)) => {
                tape.push(&topic::drive(seat.player, seat.motor), time, Outgoing::Drive(status));
            }
            None => {}
        }
    }

    /// Add the commands, and the notices about frames that were only copied.
    pub(super) fn finish(self, tape: &mut Tape, gantry: CoreXy) {
        self.setpoints.push_commands(tape, gantry);
        if let Some((frames, node)) = self.foreign {
            tape.notices.push(Notice::ForeignNodes { frames, node });
        }
        if let Some((frames, reason)) = self.not_decoded {
            tape.notices.push(Notice::NotOdrive { frames, reason });
        }
    }
}
