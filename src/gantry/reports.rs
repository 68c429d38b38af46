//! Conversion of drive reports into recorded messages: motion and health.
//!
//! Encoder estimates become motor states with the drive's sign applied. Heartbeats become health
//! reports, with the values of other messages of the last second. A torque is attached to an
//! encoder estimate only when it is at most [`MOST_PAIR_SECONDS`] old.

use super::kinematics::MotorSeat;
use crate::{
    can::Message,
    recording::message::{DriveStatus, MotorState},
    units::Nanos,
};

/// Largest time difference between two messages that form a pair (s).
pub const MOST_PAIR_SECONDS: f64 = 0.015;
/// Time for which a health value is repeated after its report (s).
const HEALTH_SECONDS: f64 = 1.0;

/// Result of a message of a drive.
#[derive(Debug, Clone, PartialEq)]
pub enum DriveReport {
    /// Motion of the motor, in the gantry's direction.
    Motor(MotorState),
    /// Health of the drive.
    Status(DriveStatus),
}

/// Converter of the reports of one drive.
#[derive(Debug, Clone, Copy)]
pub struct DriveReports {
    seat: MotorSeat,
    health: DriveHealth,
    torques: Option<(Nanos, [f64; 2])>,
}

impl DriveReports {
    /// Create a converter without reports.
    #[must_use]
    pub fn new(seat: MotorSeat) -> Self {
        Self { seat, health: DriveHealth::default(), torques: None }
    }

    /// Take one message of the drive; return the resulting report, if any.
    pub fn push(&mut self, time: Nanos, message: &Message) -> Option<DriveReport> {
        match *message {
            Message::EncoderEstimates { position_turns, velocity_turns_per_s }
                if position_turns.is_finite() && velocity_turns_per_s.is_finite() =>
            {
                let motor = self.motor(time, position_turns.into(), velocity_turns_per_s.into());
                return Some(DriveReport::Motor(motor));
            }
            Message::Torques { target_newton_metres, estimate_newton_metres } => {
                let torques = [target_newton_metres.into(), estimate_newton_metres.into()];
                self.torques = Some((time, torques));
            }
            Message::Heartbeat { axis_error, axis_state, .. } => {
                let status = self.health.at_state(time, axis_state.into(), axis_error);
                return Some(DriveReport::Status(status));
            }
            Message::Error { active_errors, disarm_reason } => {
                self.health.errors(active_errors, disarm_reason);
            }
            Message::BusVoltageCurrent { voltage_volts, current_amps } => {
                self.health.supply(time, voltage_volts.into(), current_amps.into());
            }
            Message::Temperature { fet_celsius, motor_celsius } => {
                self.health.temperatures(time, fet_celsius.into(), motor_celsius.into());
            }
            _ => {}
        }
        None
    }

    fn motor(&self, time: Nanos, position_turns: f64, velocity_turns_per_s: f64) -> MotorState {
        let fresh = |(at, _): &(Nanos, _)| time.seconds_since(*at) <= MOST_PAIR_SECONDS;
        let torque = self.torques.filter(fresh);
        self.seat.directed_motor(&MotorState {
            position_turns,
            velocity_turns_per_s,
            torque_target_nm: torque.map(|(_, [target, _])| target),
            torque_estimate_nm: torque.map(|(_, [_, estimate])| estimate),
            torque_age_s: torque.map(|(at, _)| time.seconds_since(at)),
        })
    }
}

/// Collector of the health of one drive, which is reported in separate messages. Values older than
/// a second are not repeated.
#[derive(Debug, Clone, Copy, Default)]
pub struct DriveHealth {
    status: DriveStatus,
    supply_at: Nanos,
    temperature_at: Nanos,
}

impl DriveHealth {
    /// Store the error flags.
    pub fn errors(&mut self, active_errors: u32, disarm_reason: u32) {
        self.status.active_errors = active_errors;
        self.status.disarm_reason = disarm_reason;
    }

    /// Store bus voltage (V) and current (A).
    pub fn supply(&mut self, time: Nanos, voltage: f64, current: f64) {
        self.status.bus_voltage_v = Some(voltage);
        self.status.bus_current_a = Some(current);
        self.supply_at = time;
    }

    /// Store the temperatures (C) of power stage and motor.
    pub fn temperatures(&mut self, time: Nanos, fet: f64, motor: f64) {
        self.status.fet_temperature_c = Some(fet);
        // A drive without a thermistor reports NaN or an arbitrary number.
        self.status.motor_temperature_c = motor.is_finite().then_some(motor);
        self.temperature_at = time;
    }

    /// Store state and errors, and return the health at `time`.
    pub fn at_state(&mut self, time: Nanos, axis_state: u32, errors: u32) -> DriveStatus {
        self.status.axis_state = axis_state;
        self.status.active_errors = errors;
        self.now(time)
    }

    /// Return the health at `time`.
    pub fn now(&mut self, time: Nanos) -> DriveStatus {
        if HEALTH_SECONDS < time.seconds_since(self.supply_at) {
            self.status.bus_voltage_v = None;
            self.status.bus_current_a = None;
        }
        if HEALTH_SECONDS < time.seconds_since(self.temperature_at) {
            self.status.fet_temperature_c = None;
            self.status.motor_temperature_c = None;
        }
        self.status
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn old_health_values_are_not_repeated() {
        let mut health = DriveHealth::default();
        health.supply(Nanos(0), 24.0, 1.0);
        assert_eq!(health.at_state(Nanos(900 * MS), 8, 0).bus_voltage_v, Some(24.0));
        assert_eq!(health.at_state(Nanos(1100 * MS), 8, 0).bus_voltage_v, None);
    }

    #[test]
    fn signs_are_applied_and_old_torques_left_out() {
        let mut reports = DriveReports::new(MotorSeat::of_node(2).unwrap());
        let torques = Message::Torques { target_newton_metres: 0.5, estimate_newton_metres: -0.25 };
        let encoder = Message::EncoderEstimates { position_turns: 2.0, velocity_turns_per_s: -1.0 };
        assert_eq!(reports.push(Nanos(0), &torques), None);
        let Some(DriveReport::Motor(motor)) = reports.push(Nanos(15 * MS), &encoder) else {
            panic!("no motion")
        };
        assert_eq!([motor.position_turns, motor.velocity_turns_per_s], [-2.0, 1.0]);
        assert_eq!([motor.torque_target_nm, motor.torque_estimate_nm], [Some(-0.5), Some(0.25)]);
        assert_eq!(motor.torque_age_s, Some(0.015));
        let Some(DriveReport::Motor(motor)) = reports.push(Nanos(16 * MS), &encoder) else {
            panic!("no motion")
        };
        assert_eq!((motor.torque_target_nm, motor.torque_age_s), (None, None));
    }
}
