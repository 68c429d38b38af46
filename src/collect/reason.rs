//! Why a session stopped, and what is done about each reason.

use crate::{
    can::{AxisErrors, AxisState, Command},
    gantry::MotorSeat,
    link::BusFault,
    recording::{SESSION_COMPLETED, topic::Player},
};
use std::fmt;

/// Why a session came to its end. The display text is the sentence that the person reads.
#[derive(Debug, Clone, PartialEq)]
pub enum StopReason {
    /// Every run was done.
    Completed,
    /// Ctrl-C, once.
    Interrupted,
    /// Ctrl-C, twice.
    InterruptedTwice,
    /// A drive's heartbeat is missing.
    HeartbeatLost {
        /// Its drive.
        seat: MotorSeat,
        /// Since the last one (s).
        age_s: f64,
        /// Tolerated (s).
        limit_s: f64,
    },
    /// A drive's positions are missing.
    EncoderLost {
        /// Its drive.
        seat: MotorSeat,
        /// Since the last one (s).
        age_s: f64,
        /// Tolerated (s).
        limit_s: f64,
    },
    /// An armed drive is in closed loop no more, or reports an error.
    AxisLeft {
        /// Its drive.
        seat: MotorSeat,
        /// The state that it reports.
        state: AxisState,
        /// The errors that it reports.
        errors: AxisErrors,
    },
    /// A drive did not enter closed loop.
    NotArmed {
        /// Its drive.
        seat: MotorSeat,
        /// The state that it reports.
        state: AxisState,
        /// The errors that it reports.
        errors: AxisErrors,
        /// How long it was waited for (s).
        waited_s: f64,
    },
    /// A drive kept running although nothing was sent to it.
    NoWatchdog {
        /// Its drive.
        seat: MotorSeat,
        /// How long it was waited for (s).
        waited_s: f64,
    },
    /// A power stage or motor is too hot.
    TooHot {
        /// Its drive.
        seat: MotorSeat,
        /// Which part.
        part: HotPart,
        /// How hot (C).
        celsius: f64,
        /// Allowed (C).
        limit_celsius: f64,
    },
    /// A carriage is not where its commands lead.
    FollowingError {
        /// Whose.
        player: Player,
        /// Distance (m).
        error_m: f64,
        /// Allowed (m).
        limit_m: f64,
    },
    /// A carriage could no longer stop inside its window.
    SoftLimit {
        /// Whose.
        player: Player,
        /// Where it is (m).
        position_m: [f64; 2],
        /// Where it would come to stand (m).
        standstill_m: [f64; 2],
    },
    /// The camera sees a striker far from its magnet.
    StrikerLost {
        /// Whose.
        player: Player,
        /// Distance (m).
        error_m: f64,
        /// Allowed (m).
        limit_m: f64,
    },
    /// The camera is silent although it is in use.
    CameraSilent {
        /// Since the last picture (s).
        age_s: f64,
        /// Tolerated (s).
        limit_s: f64,
    },
    /// A pilot wants a velocity that is no number.
    NoDecision {
        /// For whom.
        player: Player,
        /// What it wants (m/s).
        velocity: [f64; 2],
    },
    /// Another program gives orders to a drive.
    ForeignCommand {
        /// The node that they are for.
        node: u8,
        /// What was sent.
        command: Command,
    },
    /// The bus has failed.
    BusFailed {
        /// How.
        fault: BusFault,
    },
    /// The bus took no setpoints for several periods.
    BusFull {
        /// How many in a row.
        periods: u32,
    },
    /// The connection is broken.
    LinkBroken {
        /// Why.
        reason: String,
    },
    /// This computer was away for too long.
    LoopStalled {
        /// How late a period was (s).
        lateness_s: f64,
        /// Tolerated (s).
        limit_s: f64,
    },
    /// Nothing more could be written.
    RecordingFailed {
        /// Why.
        reason: String,
    },
}

/// A part of a drive with a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HotPart {
    /// The transistors.
    PowerStage,
    /// The motor, by its thermistor.
    Motor,
}

/// What is done when a session stops.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaction {
    /// Ramp every carriage to zero within the slew limit, then idle.
    Ramp,
    /// Command zero at once, then idle: the shortest way.
    Brake,
    /// Command zero at once to both drives of a gantry, since one that runs alone moves its carriage
    /// on a diagonal; ramp the other gantry. An emergency stop follows when it stands: a drive that is
    /// disarmed coasts, so braking comes first.
    BrakeGantry(Player),
    /// Disarm every drive at once, and let it coast: for what no setpoint can be trusted in.
    EstopAll,
}

impl StopReason {
    /// What is done about it.
    #[must_use]
    pub fn reaction(&self) -> Reaction {
        match self {
            Self::Completed
            | Self::Interrupted
            | Self::TooHot { .. }
            | Self::CameraSilent { .. }
            | Self::StrikerLost { .. }
            | Self::NoDecision { .. }
            | Self::LoopStalled { .. }
            | Self::RecordingFailed { .. } => Reaction::Ramp,
            Self::SoftLimit { .. } => Reaction::Brake,
            Self::HeartbeatLost { seat, .. }
            | Self::EncoderLost { seat, .. }
            | Self::AxisLeft { seat, .. } => Reaction::BrakeGantry(seat.player),
            Self::FollowingError { player, .. } => Reaction::BrakeGantry(*player),
            Self::InterruptedTwice
            | Self::NotArmed { .. }
            | Self::NoWatchdog { .. }
            | Self::ForeignCommand { .. }
            | Self::BusFailed { .. }
            | Self::BusFull { .. }
            | Self::LinkBroken { .. } => Reaction::EstopAll,
        }
    }

    /// Its name in results, in snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Completed => SESSION_COMPLETED,
            Self::Interrupted => "interrupted",
            Self::InterruptedTwice => "interrupted_twice",
            Self::HeartbeatLost { .. } => "heartbeat_lost",
            Self::EncoderLost { .. } => "encoder_lost",
            Self::AxisLeft { .. } => "axis_left_closed_loop",
            Self::NotArmed { .. } => "not_armed",
            Self::NoWatchdog { .. } => "no_watchdog",
            Self::TooHot { .. } => "too_hot",
            Self::FollowingError { .. } => "following_error",
            Self::SoftLimit { .. } => "soft_limit",
            Self::StrikerLost { .. } => "striker_lost",
            Self::CameraSilent { .. } => "camera_silent",
            Self::NoDecision { .. } => "no_decision",
            Self::ForeignCommand { .. } => "foreign_command",
            Self::BusFailed { .. } => "bus_failed",
            Self::BusFull { .. } => "bus_full",
            Self::LinkBroken { .. } => "link_broken",
            Self::LoopStalled { .. } => "loop_stalled",
            Self::RecordingFailed { .. } => "recording_failed",
        }
    }

    /// The drive that it is about, where it is about one.
    #[must_use]
    pub fn node(&self) -> Option<u8> {
        match self {
            Self::HeartbeatLost { seat, .. }
            | Self::EncoderLost { seat, .. }
            | Self::AxisLeft { seat, .. }
            | Self::NotArmed { seat, .. }
            | Self::NoWatchdog { seat, .. }
            | Self::TooHot { seat, .. } => Some(seat.node),
            Self::ForeignCommand { node, .. } => Some(*node),
            _ => None,
        }
    }
}

/// `node 2 (left a)`.
pub(super) struct Named(pub(super) MotorSeat);

impl fmt::Display for Named {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "node {} ({} {})", self.0.node, self.0.player, self.0.motor.name())
    }
}

fn millimetres([x, y]: [f64; 2]) -> String {
    format!("({:.0}, {:.0}) mm", 1e3 * x, 1e3 * y)
}

impl fmt::Display for StopReason {
    #[expect(clippy::too_many_lines, reason = "a flat table, one sentence per reason")]
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Completed => f.write_str("every run is done"),
            Self::Interrupted => f.write_str("interrupted by Ctrl-C"),
            Self::InterruptedTwice => f.write_str("emergency stop by a second Ctrl-C"),
            Self::HeartbeatLost { seat, age_s, limit_s } => write!(
                f,
                "no heartbeat of {} for {age_s:.2} s (limit {limit_s} s); check its supply and cable",
                Named(*seat)
            ),
            Self::EncoderLost { seat, age_s, limit_s } => write!(
                f,
                "no position of {} for {age_s:.3} s (limit {limit_s} s); check its encoder and \
                 encoder_msg_rate_ms",
                Named(*seat)
            ),
            Self::AxisLeft { seat, state, errors } => {
                write!(f, "{} left closed loop: state {state}, errors {errors}", Named(*seat))
            }
            Self::NotArmed { seat, state, errors, waited_s } => write!(
                f,
                "{} did not enter closed loop within {waited_s:.1} s: state {state}, errors \
                 {errors}; is it calibrated?",
                Named(*seat)
            ),
            Self::NoWatchdog { seat, waited_s } => write!(
                f,
                "{} was still in closed loop {waited_s:.2} s after the last setpoint, so its \
                 watchdog is off or slow: set axis0.config.enable_watchdog = True and \
                 watchdog_timeout = 0.2, or accept the risk with --watchdog none",
                Named(*seat)
            ),
            Self::TooHot { seat, part, celsius, limit_celsius } => {
                let part = match part {
                    HotPart::PowerStage => "power stage",
                    HotPart::Motor => "motor",
                };
                write!(f, "{part} of {} at {celsius:.0} C (limit {limit_celsius} C)", Named(*seat))
            }
            Self::FollowingError { player, error_m, limit_m } => write!(
                f,
                "the {player} carriage is {:.0} mm from where its commands lead (limit {:.0} mm): \
                 jammed, slipping, or a wrong sign in the robot file",
                1e3 * error_m,
                1e3 * limit_m
            ),
            Self::SoftLimit { player, position_m, standstill_m } => write!(
                f,
                "the {player} carriage at {} would stop only at {}, outside its window",
                millimetres(*position_m),
                millimetres(*standstill_m)
            ),
            Self::StrikerLost { player, error_m, limit_m } => write!(
                f,
                "the camera sees the {player} striker {:.0} mm from its magnet (limit {:.0} mm): \
                 coupling lost, homing offset wrong, or a wrong sign or belt in the robot file",
                1e3 * error_m,
                1e3 * limit_m
            ),
            Self::CameraSilent { age_s, limit_s } => {
                write!(f, "no picture of the camera for {age_s:.2} s (limit {limit_s} s)")
            }
            Self::NoDecision { player, velocity: [x, y] } => write!(
                f,
                "the {player} player decided on ({x}, {y}) m/s, which is no velocity; its policy is \
                 broken: train it again"
            ),
            Self::ForeignCommand { node, command } => write!(
                f,
                "another program sent {} to node {node}; end it before collecting",
                command.name()
            ),
            Self::BusFailed { fault } => write!(f, "the bus has failed: {fault}"),
            Self::BusFull { periods } => {
                write!(f, "the bus took no setpoints for {periods} periods in a row")
            }
            Self::LinkBroken { reason } => f.write_str(reason),
            Self::LoopStalled { lateness_s, limit_s } => write!(
                f,
                "this computer was {:.0} ms late with a control period (limit {:.0} ms); close \
                 other programs",
                1e3 * lateness_s,
                1e3 * limit_s
            ),
            Self::RecordingFailed { reason } => write!(f, "the recording cannot go on: {reason}"),
        }
    }
}
