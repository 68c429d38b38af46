//! From frames on the drives' bus to the topics of the contract.
//!
//! Every frame goes to `/can/frames`. Encoder estimates become motors, heartbeats become drive
//! health with what the other reports said within the last second, and pairs of velocity setpoints
//! become commands. A torque is attached to an encoder estimate only when it is at most 15 ms old.

use super::{
    drives::{DriveHealth, MOST_PAIR_SECONDS, Setpoints, push_motor},
    report::Notice,
    tape::{Outgoing, Tape},
};
use crate::{
    can::{self, BROADCAST_NODE, Direction, Frame, FrameKind, IdWidth, Message},
    gantry::{CoreXy, KLASKTRON_SEATS, MotorSeat},
    recording::{
        message::{CanFrame, MotorState, can_frame},
        topic,
    },
    units::Nanos,
};

/// Decodes frames in order of their time.
#[derive(Debug, Default)]
pub(super) struct BusDecoder {
    setpoints: Setpoints,
    health: [DriveHealth; KLASKTRON_SEATS.len()],
    torques: [Option<(Nanos, [f64; 2])>; KLASKTRON_SEATS.len()],
    foreign: Option<(usize, u8)>,
    not_decoded: Option<(usize, String)>,
}

impl BusDecoder {
    /// Adds one frame with log and publish time.
    pub(super) fn push(
        &mut self,
        tape: &mut Tape,
        times: [Nanos; 2],
        frame: &Frame,
        direction: Option<Direction>,
    ) {
        tape.push_published(topic::CAN_FRAMES, times, Outgoing::Can(recorded(frame, direction)));
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
        let drive = usize::from(seat.node);
        match *message {
            Message::EncoderEstimates { position_turns, velocity_turns_per_s }
                if position_turns.is_finite() && velocity_turns_per_s.is_finite() =>
            {
                let torque = self.torques[drive]
                    .filter(|(at, _)| time.seconds_since(*at) <= MOST_PAIR_SECONDS);
                let report = MotorState {
                    position_turns: position_turns.into(),
                    velocity_turns_per_s: velocity_turns_per_s.into(),
                    torque_target_nm: torque.map(|(_, [target, _])| target),
                    torque_estimate_nm: torque.map(|(_, [_, estimate])| estimate),
                };
                push_motor(tape, seat, time, &report);
            }
            Message::Torques { target_newton_metres, estimate_newton_metres } => {
                let torques = [target_newton_metres.into(), estimate_newton_metres.into()];
                self.torques[drive] = Some((time, torques));
            }
            Message::Heartbeat { axis_error, axis_state, .. } => {
                let status = self.health[drive].at_state(time, axis_state.into(), axis_error);
                tape.push(&topic::drive(seat.player, seat.motor), time, Outgoing::Drive(status));
            }
            Message::Error { active_errors, disarm_reason } => {
                self.health[drive].errors(active_errors, disarm_reason);
            }
            Message::BusVoltageCurrent { voltage_volts, current_amps } => {
                self.health[drive].supply(time, voltage_volts.into(), current_amps.into());
            }
            Message::Temperature { fet_celsius, motor_celsius } => {
                self.health[drive].temperatures(time, fet_celsius.into(), motor_celsius.into());
            }
            Message::SetInputVel { velocity_turns_per_s, .. }
                if velocity_turns_per_s.is_finite() =>
            {
                self.setpoints.push(seat, time, velocity_turns_per_s.into());
            }
            _ => {}
        }
    }

    /// Adds the commands, and the notices about frames that were only copied.
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

fn recorded(frame: &Frame, direction: Option<Direction>) -> CanFrame {
    let direction = match direction {
        Some(Direction::Sent) => can_frame::Direction::Sent,
        // A log that does not say which way a frame went was made by listening.
        Some(Direction::Received) | None => can_frame::Direction::Received,
    };
    CanFrame {
        id: frame.id,
        extended: frame.width == IdWidth::Extended,
        remote: frame.kind == FrameKind::Remote,
        error: frame.kind == FrameKind::Error,
        data: frame.data.as_slice().to_vec(),
        direction: direction.into(),
    }
}
