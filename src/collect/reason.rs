//! Stop reasons of a session, and the reaction to each.

use crate::{
    can::{AxisErrors, AxisState, Command},
    gantry::MotorSeat,
    link::BusFault,
    recording::{SESSION_COMPLETED, topic::Player},
};
use std::fmt;

/// Stop reason of a session. The display text is the sentence that the person reads.
#[derive(Debug, Clone, PartialEq)]
pub enum StopReason {
    /// All runs completed.
    Completed,
    /// Ctrl-C, once.
    Interrupted,
    /// Ctrl-C, twice.
    InterruptedTwice,
    /// Heartbeat of a drive lost.
    HeartbeatLost {
        /// Drive.
        seat: MotorSeat,
        /// Time since the last heartbeat (s).
        age_s: f64,
        /// Limit (s).
        limit_s: f64,
    },
    /// Positions of a drive lost.
    EncoderLost {
        /// Drive.
        seat: MotorSeat,
        /// Time since the last position (s).
        age_s: f64,
        /// Limit (s).
        limit_s: f64,
    },
    /// Armed drive left closed loop or reported an error.
    AxisLeft {
        /// Drive.
        seat: MotorSeat,
        /// Reported state.
        state: AxisState,
        /// Reported errors.
        errors: AxisErrors,
    },
    /// Drive did not enter closed loop.
    NotArmed {
        /// Drive.
        seat: MotorSeat,
        /// Reported state.
        state: AxisState,
        /// Reported errors.
        errors: AxisErrors,
        /// Waiting time (s).
        waited_s: f64,
    },
    /// Drive stayed armed without commands.
    NoWatchdog {
        /// Drive.
        seat: MotorSeat,
        /// Waiting time (s).
        waited_s: f64,
    },
    /// Power stage or motor too hot.
    TooHot {
        /// Drive.
        seat: MotorSeat,
        /// Part of the drive.
        part: HotPart,
        /// Temperature (C).
        celsius: f64,
        /// Limit (C).
        limit_celsius: f64,
    },
    /// Carriage too far from its reference.
    FollowingError {
        /// Player.
        player: Player,
        /// Distance (m).
        error_m: f64,
        /// Limit (m).
        limit_m: f64,
    },
    /// Carriage could no longer stop inside its workspace.
    SoftLimit {
        /// Player.
        player: Player,
        /// Position (m).
        position_m: [f64; 2],
        /// Standstill point (m).
        standstill_m: [f64; 2],
    },
    /// Striker too far from its magnet in the camera frames.
    StrikerLost {
        /// Player.
        player: Player,
        /// Distance (m).
        error_m: f64,
        /// Limit (m).
        limit_m: f64,
    },
    /// Camera frames lost in a session that requires them.
    CameraSilent {
        /// Time since the last frame (s).
        age_s: f64,
        /// Limit (s).
        limit_s: f64,
    },
    /// Ball not in play, in a match.
    BallMissing {
        /// Time since the ball was in play (s).
        age_s: f64,
        /// Limit (s).
        limit_s: f64,
    },
    /// Pilot returned a non-finite velocity.
    NoDecision {
        /// Player.
        player: Player,
        /// Velocity (m/s).
        velocity: [f64; 2],
    },
    /// Another program sent a command to a drive.
    ForeignCommand {
        /// Addressed node.
        node: u8,
        /// Command.
        command: Command,
    },
    /// Bus failed.
    BusFailed {
        /// Fault.
        fault: BusFault,
    },
    /// Bus took no setpoints for several periods.
    BusFull {
        /// Number of consecutive periods.
        periods: u32,
    },
    /// Connection broken.
    LinkBroken {
        /// Cause.
        reason: String,
    },
    /// Control loop stalled.
    LoopStalled {
        /// LoopTiming of a period (s).
        lateness_s: f64,
        /// Limit (s).
        limit_s: f64,
    },
    /// Writing the recording failed.
    RecordingFailed {
        /// Cause.
        reason: String,
    },
}

/// Part of a drive with a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HotPart {
    /// Transistors of the power stage.
    PowerStage,
    /// Motor, by its thermistor.
    Motor,
}

/// Reaction to a stop reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reaction {
    /// Ramp every carriage to zero within the slew limit, then disarm.
    Ramp,
    /// Command zero at once, then disarm: the shortest stopping distance.
    Brake,
    /// Command zero at once to both drives of a gantry, because a single running drive moves the
    /// carriage on a diagonal; ramp the other gantry. An emergency stop follows at standstill: a
    /// disarmed drive coasts, so braking comes first.
    BrakeGantry(Player),
    /// Disarm every drive at once and let it coast, when no setpoint can be trusted.
    EstopAll,
}

impl StopReason {
    /// Return the reaction to the reason.
    #[must_use]
    pub fn reaction(&self) -> Reaction {
        match self {
            Self::Completed
            | Self::Interrupted
            | Self::TooHot { .. }
            | Self::CameraSilent { .. }
            | Self::StrikerLost { .. }
            | Self::BallMissing { .. }
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

    /// Return the name in results, in snake case.
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
            Self::BallMissing { .. } => "ball_missing",
            Self::NoDecision { .. } => "no_decision",
            Self::ForeignCommand { .. } => "foreign_command",
            Self::BusFailed { .. } => "bus_failed",
            Self::BusFull { .. } => "bus_full",
            Self::LinkBroken { .. } => "link_broken",
            Self::LoopStalled { .. } => "loop_stalled",
            Self::RecordingFailed { .. } => "recording_failed",
        }
    }

    /// Return the affected drive, where there is one.
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

/// Display form of a drive: `node 2 (left a)`.
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
            Self::Completed => f.write_str("all runs completed"),
            Self::Interrupted => f.write_str("interrupted by Ctrl-C"),
            Self::InterruptedTwice => f.write_str("emergency stop by a second Ctrl-C"),
            Self::HeartbeatLost { seat, age_s, limit_s } => write!(
                f,
                "no heartbeat from {} for {age_s:.2} s (limit {limit_s} s); check its supply and cable",
                Named(*seat)
            ),
            Self::EncoderLost { seat, age_s, limit_s } => write!(
                f,
                "no position from {} for {age_s:.3} s (limit {limit_s} s); check its encoder and \
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
                "the {player} carriage is {:.0} mm from its reference (limit {:.0} mm): \
                 jammed, slipping, or a wrong sign in the robot file",
                1e3 * error_m,
                1e3 * limit_m
            ),
            Self::SoftLimit { player, position_m, standstill_m } => write!(
                f,
                "the {player} carriage at {} would stop only at {}, outside its workspace",
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
                write!(f, "no camera frame for {age_s:.2} s (limit {limit_s} s)")
            }
            Self::BallMissing { age_s, limit_s } => write!(
                f,
                "the ball was not in play for {age_s:.0} s (limit {limit_s:.0} s): not seen by the camera, or in a \
                 cup; serve it and start the match again"
            ),
            Self::NoDecision { player, velocity: [x, y] } => write!(
                f,
                "the {player} player commanded ({x}, {y}) m/s, which is not finite; its policy is \
                 invalid: train it again"
            ),
            Self::ForeignCommand { node, command } => write!(
                f,
                "another program sent {} to node {node}; end it before collecting",
                command.name()
            ),
            Self::BusFailed { fault } => write!(f, "the bus has failed: {fault}"),
            Self::BusFull { periods } => {
                write!(f, "the bus took no setpoints for {periods} consecutive periods")
            }
            Self::LinkBroken { reason } => f.write_str(reason),
            Self::LoopStalled { lateness_s, limit_s } => write!(
                f,
                "a control period was {:.0} ms late on this computer (limit {:.0} ms); close \
                 other programs",
                1e3 * lateness_s,
                1e3 * limit_s
            ),
            Self::RecordingFailed { reason } => write!(f, "the recording failed: {reason}"),
        }
    }
}
