//! Current state of each drive, each carriage and the camera.

use crate::{
    can::{AxisErrors, AxisState, Message},
    gantry::{CoreXy, DriveReport, DriveReports, MOST_PAIR_SECONDS, MotorPair, MotorSeat},
    recording::{
        message::{CameraDetections, CarriageState, MotorState},
        topic::{Motor, Player},
    },
    units::Nanos,
};
use std::collections::VecDeque;

/// Time for which carriage positions are kept for comparison with late camera frames (s).
const TRACK_SECONDS: f64 = 1.0;
/// Largest difference between capture and arrival time with a common clock (s).
const SAME_CLOCK_SECONDS: f64 = 1.0;

/// Last heartbeat of a drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Heartbeat {
    pub(super) at: Nanos,
    pub(super) state: AxisState,
    pub(super) errors: AxisErrors,
}

/// State of arming of a drive, as seen by this program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Armed {
    /// Not requested, or disarmed again.
    No,
    /// Requested, not yet confirmed by its heartbeat.
    Asked,
    /// Confirmed: leaving closed loop is now a fault.
    Confirmed,
    /// Released: its watchdog is being tested, or its fault has been reported.
    Released,
}

/// State of one drive.
#[derive(Debug, Clone)]
pub(super) struct DriveWatch {
    pub(super) seat: MotorSeat,
    pub(super) armed: Armed,
    pub(super) heartbeat: Option<Heartbeat>,
    pub(super) encoder_at: Option<Nanos>,
    pub(super) version: Option<[u8; 8]>,
    /// Temperatures of power stage and motor (C).
    pub(super) temperatures: Option<[f64; 2]>,
    reports: DriveReports,
}

impl DriveWatch {
    pub(super) fn new(seat: MotorSeat) -> Self {
        Self {
            seat,
            armed: Armed::No,
            heartbeat: None,
            encoder_at: None,
            version: None,
            temperatures: None,
            reports: DriveReports::new(seat),
        }
    }

    /// Take one message of the drive.
    pub(super) fn push(&mut self, time: Nanos, message: &Message) -> Option<DriveReport> {
        match *message {
            Message::Heartbeat { axis_error, axis_state, .. } => {
                let state = AxisState::from_number(axis_state);
                self.heartbeat =
                    Some(Heartbeat { at: time, state, errors: AxisErrors(axis_error) });
            }
            Message::EncoderEstimates { .. } => self.encoder_at = Some(time),
            Message::Version(bytes) => self.version = Some(bytes),
            Message::Temperature { fet_celsius, motor_celsius } => {
                self.temperatures = Some([fet_celsius.into(), motor_celsius.into()]);
            }
            _ => {}
        }
        self.reports.push(time, message)
    }

    /// Return the axis state of the last heartbeat.
    pub(super) fn state(&self) -> Option<AxisState> {
        self.heartbeat.map(|heartbeat| heartbeat.state)
    }

    /// Return state and errors of the last heartbeat, `UNDEFINED` before the first.
    pub(super) fn state_and_errors(&self) -> (AxisState, AxisErrors) {
        self.heartbeat
            .map_or((AxisState::Undefined, AxisErrors::default()), |h| (h.state, h.errors))
    }
}

/// Pairing of values of the two motors of a gantry on arrival. A pair is complete when both values are
/// new since the last pair and at most [`MOST_PAIR_SECONDS`] apart.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pairing<T> {
    waiting: [Option<(Nanos, T)>; 2],
}

impl<T> Default for Pairing<T> {
    fn default() -> Self {
        Self { waiting: [None, None] }
    }
}

impl<T: Copy> Pairing<T> {
    /// Add a value of one motor; return the time of the later and both values when they pair.
    pub(super) fn push(&mut self, motor: Motor, time: Nanos, value: T) -> Option<(Nanos, [T; 2])> {
        self.waiting[motor as usize] = Some((time, value));
        let [Some((at_a, a)), Some((at_b, b))] = self.waiting else { return None };
        if MOST_PAIR_SECONDS < at_a.seconds_since(at_b).abs() {
            return None;
        }
        self.waiting = [None, None];
        Some((at_a.max(at_b), [a, b]))
    }
}

/// State of one carriage, from both its motors.
#[derive(Debug, Clone)]
pub(super) struct CarriageWatch {
    gantry: CoreXy,
    motors: Pairing<MotorState>,
    /// Offset from the motors' zero to the board (m), once it is known.
    origin: Option<[f64; 2]>,
    /// Positions without the offset (m), newest last.
    track: VecDeque<(Nanos, [f64; 2])>,
    /// Newest velocity (m/s).
    velocity: [f64; 2],
}

impl CarriageWatch {
    pub(super) fn new(gantry: CoreXy) -> Self {
        Self {
            gantry,
            motors: Pairing::default(),
            origin: None,
            track: VecDeque::new(),
            velocity: [0.0; 2],
        }
    }

    /// Take one report of a motor. Return the carriage state when both motors have reported and the
    /// origin is known.
    pub(super) fn push(
        &mut self,
        motor: Motor,
        time: Nanos,
        state: MotorState,
    ) -> Option<(Nanos, CarriageState)> {
        let (at, [a, b]) = self.motors.push(motor, time, state)?;
        let turns = MotorPair { a: a.position_turns, b: b.position_turns };
        let speeds = MotorPair { a: a.velocity_turns_per_s, b: b.velocity_turns_per_s };
        let position = self.gantry.board_from_motors(turns);
        self.velocity = self.gantry.board_from_motors(speeds);
        self.track.push_back((at, position));
        while self.track.front().is_some_and(|(t, _)| TRACK_SECONDS < at.seconds_since(*t)) {
            self.track.pop_front();
        }
        let [x0, y0] = self.origin?;
        let [vx, vy] = self.velocity;
        Some((at, CarriageState { x: position[0] + x0, y: position[1] + y0, vx, vy }))
    }

    /// Set the present position of the carriage (m).
    pub(super) fn set_position(&mut self, now: [f64; 2]) {
        if let Some((_, [x, y])) = self.track.back() {
            self.origin = Some([now[0] - x, now[1] - y]);
        }
    }

    /// Use the motors' zero as the middle of the board, without a better reference.
    pub(super) fn count_from_zero(&mut self) {
        self.origin = Some([0.0; 2]);
    }

    /// Return whether both motors have reported together.
    pub(super) fn has_reported(&self) -> bool {
        !self.track.is_empty()
    }

    /// Return position (m) and velocity (m/s), once the origin is known.
    pub(super) fn state(&self) -> Option<([f64; 2], [f64; 2])> {
        let (_, [x, y]) = self.track.back()?;
        let [x0, y0] = self.origin?;
        Some(([x + x0, y + y0], self.velocity))
    }

    /// Return the time at which the newest position was measured.
    pub(super) fn measured_at(&self) -> Option<Nanos> {
        self.track.back().map(|(at, _)| *at)
    }

    /// Return the position at `time` (m), the nearest that is kept.
    pub(super) fn position_at(&self, time: Nanos) -> Option<[f64; 2]> {
        let [x0, y0] = self.origin?;
        let after = self.track.partition_point(|(t, _)| *t < time);
        let (_, [x, y]) = self.track.get(after).or(self.track.back())?;
        Some([x + x0, y + y0])
    }

    /// Return the range of motion within the kept positions (m).
    pub(super) fn recent_travel(&self) -> f64 {
        let Some((_, last)) = self.track.back() else { return 0.0 };
        let distance = |[x, y]: [f64; 2]| (x - last[0]).hypot(y - last[1]);
        self.track.iter().map(|(_, position)| distance(*position)).fold(0.0, f64::max)
    }
}

/// State of the camera.
#[derive(Debug, Clone, Default)]
pub(super) struct CameraWatch {
    pub(super) last_at: Option<Nanos>,
    /// Number of datagrams that could not be decoded, and the error of the first.
    pub(super) rejected: u64,
    pub(super) first_rejection: Option<String>,
    /// Strikers in the newest frames with the time of each frame, newest last.
    strikers: [VecDeque<(Nanos, [f64; 2])>; 2],
}

impl CameraWatch {
    /// Take one camera frame; return its capture time.
    pub(super) fn push(&mut self, arrived: Nanos, detections: &CameraDetections) -> Nanos {
        self.last_at = Some(arrived);
        let own = Nanos(detections.capture_time_ns);
        let same_clock = arrived.seconds_since(own).abs() <= SAME_CLOCK_SECONDS;
        let shown = if same_clock { own } else { arrived };
        for (kept, seen) in self.strikers.iter_mut().zip([&detections.left, &detections.right]) {
            if let Some(point) = seen {
                kept.push_back((shown, [point.x, point.y]));
            }
            while kept.front().is_some_and(|(t, _)| TRACK_SECONDS < shown.seconds_since(*t)) {
                kept.pop_front();
            }
        }
        shown
    }

    /// Return time and position (m) of a striker in the newest frame that shows it.
    pub(super) fn newest_striker(&self, player: Player) -> Option<(Nanos, [f64; 2])> {
        self.strikers[player as usize].back().copied()
    }

    /// Return the positions of a striker within the last second (m), oldest first.
    pub(super) fn striker(&self, player: Player) -> Vec<[f64; 2]> {
        self.strikers[player as usize].iter().map(|(_, position)| *position).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: u64 = 1_000_000;

    #[test]
    fn pairs_are_new_and_close() {
        let mut pairing = Pairing::default();
        assert_eq!(pairing.push(Motor::A, Nanos(0), 1), None);
        assert_eq!(pairing.push(Motor::A, Nanos(10 * MS), 2), None);
        assert_eq!(pairing.push(Motor::B, Nanos(11 * MS), 3), Some((Nanos(11 * MS), [2, 3])));
        assert_eq!(pairing.push(Motor::B, Nanos(20 * MS), 4), None);
        assert_eq!(pairing.push(Motor::A, Nanos(36 * MS), 5), None);
        assert_eq!(pairing.push(Motor::B, Nanos(37 * MS), 6), Some((Nanos(37 * MS), [5, 6])));
    }

    #[test]
    fn a_carriage_counts_from_where_it_was_declared_to_be() {
        let mut carriage = CarriageWatch::new(CoreXy::default());
        let motor = |turns| MotorState { position_turns: turns, ..MotorState::default() };
        assert_eq!(carriage.push(Motor::A, Nanos(0), motor(7.0)), None);
        assert_eq!(carriage.push(Motor::B, Nanos(MS), motor(5.0)), None);
        carriage.set_position([0.0, -0.1]);
        carriage.push(Motor::A, Nanos(10 * MS), motor(8.0));
        let (at, state) = carriage.push(Motor::B, Nanos(11 * MS), motor(6.0)).unwrap();
        // One turn of both motors is 40 mm along x.
        assert_eq!(at, Nanos(11 * MS));
        assert!((state.x - 0.04).abs() < 1e-12 && (state.y + 0.1).abs() < 1e-12);
        assert_eq!(carriage.position_at(Nanos(0)).unwrap(), [0.0, -0.1]);
        assert!((carriage.recent_travel() - 0.04).abs() < 1e-12);
    }
}
