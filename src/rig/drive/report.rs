//! Messages of a drive: cyclic messages, and answers to requests.

use super::{Drive, Outgoing, control::period_ns};
use crate::{
    can::{
        AxisErrors, AxisState, Command, Frame, FrameKind, IdWidth, Message, Payload,
        TrajectoryState, encode,
    },
    rig::config::CyclicMs,
    seed::Stream,
};

/// Protocol version in `Get_Version`.
const PROTOCOL: u8 = 2;

/// Cyclic messages with their periods and next times (ns).
#[derive(Debug, Clone)]
pub(super) struct Cyclic {
    entries: Vec<(Command, u64, u64)>,
    next_ns: u64,
}

impl Cyclic {
    /// Each message starts at a random phase of its period, as drives that are switched on by hand.
    pub(super) fn new(periods: &CyclicMs, phases: &mut Stream) -> Self {
        let mut entries = Vec::new();
        for (command, millis) in [
            (Command::Heartbeat, periods.heartbeat),
            (Command::EncoderEstimates, periods.encoder),
            (Command::Iq, periods.iq),
            (Command::Error, periods.error),
            (Command::Temperature, periods.temperature),
            (Command::BusVoltageCurrent, periods.bus_voltage),
            (Command::Torques, periods.torques),
            (Command::Powers, periods.powers),
        ] {
            let phase = f64::from(phases.uniform_f32(0.0, 1.0));
            if millis != 0 {
                let period = period_ns(millis);
                entries.push((command, period, (period as f64 * phase) as u64));
            }
        }
        let next_ns = entries.iter().map(|entry| entry.2).min().unwrap_or(u64::MAX);
        Self { entries, next_ns }
    }
}

impl Drive {
    /// Send the cyclic messages that are due.
    pub(in crate::rig) fn report(&mut self, now_ns: u64, out: &mut Vec<Outgoing>) {
        if now_ns < self.cyclic.next_ns {
            return;
        }
        let mut next_ns = u64::MAX;
        for idx in 0..self.cyclic.entries.len() {
            let (command, period, due) = self.cyclic.entries[idx];
            let mut due = due;
            while due <= now_ns {
                self.send(command, due, out);
                due += period;
            }
            self.cyclic.entries[idx].2 = due;
            next_ns = next_ns.min(due);
        }
        self.cyclic.next_ns = next_ns;
    }

    /// Send one message unless a fault blocks it.
    pub(super) fn send(&self, command: Command, ready_ns: u64, out: &mut Vec<Outgoing>) {
        let kept_back = self.faults.silent
            || (self.faults.heartbeat_off && command == Command::Heartbeat)
            || (self.faults.encoder_off && command == Command::EncoderEstimates)
            || (self.is_old() && command == Command::Version);
        if kept_back {
            return;
        }
        if self.is_old() && command == Command::Heartbeat {
            out.push(Outgoing { ready_ns, frame: self.old_heartbeat() });
        } else if let Some(message) = self.message(command) {
            out.push(Outgoing { ready_ns, frame: encode(self.node, &message) });
        }
    }

    fn message(&self, command: Command) -> Option<Message> {
        let control = &self.control;
        let [f0, f1] = match command {
            Command::EncoderEstimates => control.estimates(),
            Command::Iq => control.currents(),
            Command::Torques => [control.target(), control.torque()],
            Command::Powers => control.powers(),
            Command::BusVoltageCurrent => [control.supply_volts(), control.supply_current()],
            Command::Temperature if self.config.guards.motor_thermistor => {
                [control.fet_celsius(), control.motor_celsius()]
            }
            Command::Temperature => [control.fet_celsius(), 0.0],
            _ => [0.0; 2],
        }
        .map(|value| value as f32);
        Some(match command {
            Command::Version => {
                let [major, minor, revision] = self.config.firmware;
                let [product, version, variant] = self.config.hardware;
                Message::Version([PROTOCOL, product, version, variant, major, minor, revision, 0])
            }
            Command::Heartbeat => Message::Heartbeat {
                axis_error: self.errors,
                axis_state: self.state.number(),
                procedure_result: self.procedure.number(),
                trajectory: TrajectoryState::Pending,
            },
            Command::Error => {
                Message::Error { active_errors: self.errors, disarm_reason: self.disarm_reason }
            }
            Command::Address => Message::Address {
                node: self.node,
                serial: self.serial,
                connection: u8::from((0, 6, 11) <= self.config.firmware.into()),
            },
            Command::EncoderEstimates => {
                Message::EncoderEstimates { position_turns: f0, velocity_turns_per_s: f1 }
            }
            Command::Iq => Message::Iq { setpoint_amps: f0, measured_amps: f1 },
            Command::Torques => {
                Message::Torques { target_newton_metres: f0, estimate_newton_metres: f1 }
            }
            Command::Powers => Message::Powers { electrical_watts: f0, mechanical_watts: f1 },
            Command::BusVoltageCurrent => {
                Message::BusVoltageCurrent { voltage_volts: f0, current_amps: f1 }
            }
            Command::Temperature => Message::Temperature { fet_celsius: f0, motor_celsius: f1 },
            _ => return None,
        })
    }

    /// Heartbeat of firmware 0.5.6: error, state, and one error bit each for motor (bit 40), encoder
    /// (48) and controller (56); trajectory done (63) is not simulated. The watchdog is an error of
    /// the axis alone.
    fn old_heartbeat(&self) -> Frame {
        let [e0, e1, e2, e3] = self.errors.to_le_bytes();
        let axis_only = AxisErrors::WATCHDOG_TIMER_EXPIRED.0 | AxisErrors::ESTOP_REQUESTED.0;
        let motor = u8::from(self.errors & !axis_only != 0);
        let state = match self.state {
            AxisState::ClosedLoopControl => 8,
            other => other.number(),
        };
        let bytes = [e0, e1, e2, e3, state, motor, 0, 0];
        Frame {
            id: u32::from(self.node) << 5 | Command::Heartbeat as u32,
            width: IdWidth::Standard,
            kind: FrameKind::Data,
            data: Payload::new(&bytes).unwrap_or_default(),
        }
    }
}
