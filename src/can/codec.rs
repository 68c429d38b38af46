//! ODrive CANSimple of firmware 0.6.x: `id = node << 5 | command`, little endian, 11-bit ids.
//!
//! Source: ODrive's message table (Arduino library `can_simple_messages.hpp`, 2026-04), which
//! agrees with the DBC file of 0.6.10 in all shared messages. Heartbeats of firmware 0.5.x have
//! another layout and are not supported. A frame may be longer than its fields need.
//! `Set_Axis_State`, `Set_Input_Torque` and `Clear_Errors` may be as short as their first field. A
//! remote frame, or a data frame without data on a reporting id, is a [`Message::Request`].

use super::frame::{Frame, FrameKind, IdWidth, MAX_DATA_BYTES, Payload};

/// Broadcast node id, received by every drive.
pub const BROADCAST_NODE: u8 = 0x3F;

const NODE_SHIFT: u32 = 5;
const COMMAND_MASK: u32 = 0x1F;
/// Resolution of a feed-forward field of `Set_Input_Pos` with the drive's default scales.
const FEED_FORWARD_STEP: f64 = 0.001;

/// Declaration of the command ids: the enum, its numbers and its names.
macro_rules! commands {
    ($($(#[$doc:meta])* $name:ident = $id:literal, $spelled:literal;)*) => {
        /// Command id: the lower five bits of a frame's id.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[repr(u8)]
        pub enum Command { $($(#[$doc])* $name = $id,)* }

        impl Command {
            /// All commands of the protocol by id.
            pub const ALL: &[Self] = &[$(Self::$name,)*];

            /// Return the command with this id; `None` for ids that 0.6.x does not use.
            #[must_use]
            pub fn from_id(id: u8) -> Option<Self> {
                match id { $($id => Some(Self::$name),)* _ => None }
            }

            /// Return the name in ODrive's spelling.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$name => $spelled,)* }
            }
        }
    };
}

commands! {
    /// Versions of protocol, hardware and firmware.
    Version = 0x00, "Get_Version";
    /// State of the axis, every 100 ms by default.
    Heartbeat = 0x01, "Heartbeat";
    /// Disarm now.
    Estop = 0x02, "Estop";
    /// Error flags.
    Error = 0x03, "Get_Error";
    /// Read or write of an endpoint.
    RxSdo = 0x04, "RxSdo";
    /// Reply to `RxSdo`.
    TxSdo = 0x05, "TxSdo";
    /// Discovery and assignment of node ids.
    Address = 0x06, "Address";
    /// Requested axis state.
    SetAxisState = 0x07, "Set_Axis_State";
    /// Position and velocity.
    EncoderEstimates = 0x09, "Get_Encoder_Estimates";
    /// Control and input mode.
    SetControllerMode = 0x0B, "Set_Controller_Mode";
    /// Position setpoint.
    SetInputPos = 0x0C, "Set_Input_Pos";
    /// Velocity setpoint.
    SetInputVel = 0x0D, "Set_Input_Vel";
    /// Torque setpoint.
    SetInputTorque = 0x0E, "Set_Input_Torque";
    /// Velocity and current limits.
    SetLimits = 0x0F, "Set_Limits";
    /// Velocity limit of trajectories.
    SetTrajVelLimit = 0x11, "Set_Traj_Vel_Limit";
    /// Acceleration limits of trajectories.
    SetTrajAccelLimits = 0x12, "Set_Traj_Accel_Limits";
    /// Inertia of trajectories.
    SetTrajInertia = 0x13, "Set_Traj_Inertia";
    /// Torque-producing current.
    Iq = 0x14, "Get_Iq";
    /// Temperatures.
    Temperature = 0x15, "Get_Temperature";
    /// Reboot and configuration.
    Reboot = 0x16, "Reboot";
    /// Bus voltage and current.
    BusVoltageCurrent = 0x17, "Get_Bus_Voltage_Current";
    /// Clear errors.
    ClearErrors = 0x18, "Clear_Errors";
    /// Set the present position.
    SetAbsolutePosition = 0x19, "Set_Absolute_Position";
    /// Position gain.
    SetPosGain = 0x1A, "Set_Pos_Gain";
    /// Velocity gains.
    SetVelGains = 0x1B, "Set_Vel_Gains";
    /// Torques.
    Torques = 0x1C, "Get_Torques";
    /// Powers.
    Powers = 0x1D, "Get_Powers";
    /// Enter the boot loader.
    EnterDfuMode = 0x1F, "Enter_DFU_Mode";
}

/// One message to or from a drive. States and modes are plain numbers, so that values newer than
/// this table are preserved.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(missing_docs, reason = "fields have their unit in the name and follow ODrive's table")]
pub enum Message {
    /// Request for this message: a remote frame, or an empty data frame on a reporting id.
    Request(Command),
    /// Protocol, hardware major, minor, variant, firmware major, minor, revision, unreleased.
    Version([u8; 8]),
    /// Axis state and its last procedure.
    Heartbeat { axis_error: u32, axis_state: u8, procedure_result: u8, trajectory: TrajectoryState },
    /// Disarm now.
    Estop,
    /// Error flags now, and those of the last disarm.
    Error { active_errors: u32, disarm_reason: u32 },
    /// Read (opcode 0) or write (1) of an endpoint; the value as sent.
    RxSdo { opcode: u8, endpoint: u16, value: Payload },
    /// Reply to `RxSdo`.
    TxSdo { endpoint: u16, value: Payload },
    /// Node id, 48-bit serial number, connection id (0 before firmware 0.6.11).
    Address { node: u8, serial: u64, connection: u8 },
    /// Requested axis state.
    SetAxisState { state: u32 },
    /// Position and velocity of the motor.
    EncoderEstimates { position_turns: f32, velocity_turns_per_s: f32 },
    /// Control mode and input mode.
    SetControllerMode { control_mode: u32, input_mode: u32 },
    /// Position setpoint with feed-forwards in counts of 0.001 turns/s and 0.001 N m.
    SetInputPos { position_turns: f32, velocity_counts: i16, torque_counts: i16 },
    /// Velocity setpoint with feed-forward.
    SetInputVel { velocity_turns_per_s: f32, torque_newton_metres: f32 },
    /// Torque setpoint.
    SetInputTorque { torque_newton_metres: f32 },
    /// Limits.
    SetLimits { velocity_turns_per_s: f32, current_amps: f32 },
    /// Velocity limit of trajectories.
    SetTrajVelLimit { velocity_turns_per_s: f32 },
    /// Acceleration limits of trajectories (turns/s^2).
    SetTrajAccelLimits { acceleration: f32, deceleration: f32 },
    /// Inertia of trajectories (N m/(turn/s^2)).
    SetTrajInertia { inertia: f32 },
    /// Torque-producing current.
    Iq { setpoint_amps: f32, measured_amps: f32 },
    /// Temperatures; the motor temperature is invalid without a thermistor.
    Temperature { fet_celsius: f32, motor_celsius: f32 },
    /// 0 reboot, 1 save, 2 erase the configuration, 3 enter DFU.
    Reboot { action: u8 },
    /// Supply of the drive.
    BusVoltageCurrent { voltage_volts: f32, current_amps: f32 },
    /// Clear errors; 1 also blinks the LED.
    ClearErrors { identify: u8 },
    /// Set the present position.
    SetAbsolutePosition { position_turns: f32 },
    /// Position gain ((turns/s)/turn).
    SetPosGain { gain: f32 },
    /// Velocity gain (N m/(turn/s)) and integrator gain (N m/turn).
    SetVelGains { gain: f32, integrator_gain: f32 },
    /// Torques of the controller.
    Torques { target_newton_metres: f32, estimate_newton_metres: f32 },
    /// Powers.
    Powers { electrical_watts: f32, mechanical_watts: f32 },
    /// Enter the boot loader.
    EnterDfuMode,
}

/// State of the last trajectory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrajectoryState {
    /// In progress, or no trajectory was started.
    Pending,
    /// Completed.
    Done,
}

/// Decoded message and its node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decoded {
    /// Node id, 0 to 0x3F; 0x3F is broadcast.
    pub node: u8,
    /// Decoded message.
    pub message: Message,
}

/// Error of decoding a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum CodecError {
    /// 29-bit id; CANSimple 0.6.x has 11-bit ids only.
    #[error("frame {id:08X} has a 29-bit id; ODrive 0.6.x uses 11-bit ids")]
    Extended {
        /// The id.
        id: u32,
    },
    /// Error frame of the bus.
    #[error("frame {id:08X} is an error frame of the bus")]
    ErrorFrame {
        /// Error classes.
        id: u32,
    },
    /// Id that the protocol does not use.
    #[error("frame {id:03X} has command 0x{command:02X}, which ODrive 0.6.x does not use")]
    UnknownCommand {
        /// The id.
        id: u32,
        /// Its lower five bits.
        command: u8,
    },
    /// Frame shorter than the fields of its message.
    #[error("frame {id:03X} ({}) has {found} data bytes, it needs {needed}", command.name())]
    TooShort {
        /// The id.
        id: u32,
        /// The command.
        command: Command,
        /// Number of data bytes.
        found: usize,
        /// Required number of data bytes.
        needed: usize,
    },
}

/// Decode one frame.
///
/// # Errors
/// When the frame does not belong to the protocol; see [`CodecError`].
pub fn decode(frame: &Frame) -> Result<Decoded, CodecError> {
    let id = frame.id;
    if frame.kind == FrameKind::Error {
        return Err(CodecError::ErrorFrame { id });
    }
    if frame.width == IdWidth::Extended {
        return Err(CodecError::Extended { id });
    }
    let node = (id >> NODE_SHIFT & u32::from(BROADCAST_NODE)) as u8;
    let number = (id & COMMAND_MASK) as u8;
    let command =
        Command::from_id(number).ok_or(CodecError::UnknownCommand { id, command: number })?;
    let data = frame.data.as_slice();
    if frame.kind == FrameKind::Remote || (data.is_empty() && command.is_report()) {
        return Ok(Decoded { node, message: Message::Request(command) });
    }
    let needed = command.least_bytes();
    let message = Message::read(command, data).ok_or(CodecError::TooShort {
        id,
        command,
        found: data.len(),
        needed,
    })?;
    Ok(Decoded { node, message })
}

/// Encode `message` to or from the drive `node`, in full length.
///
/// # Panics
/// When `node` needs more than 6 bits or the value of an SDO more than 4 bytes. No decoded message
/// has these.
#[must_use]
pub fn encode(node: u8, message: &Message) -> Frame {
    assert!(node <= BROADCAST_NODE, "node {node} is above {BROADCAST_NODE}");
    let id = u32::from(node) << NODE_SHIFT | message.command() as u32;
    let mut data = Vec::with_capacity(MAX_DATA_BYTES);
    message.write(&mut data);
    let kind = match message {
        Message::Request(_) => FrameKind::Remote,
        _ => FrameKind::Data,
    };
    let data = Payload::new(&data).expect("messages of the protocol have at most 8 bytes");
    Frame { id, width: IdWidth::Standard, kind, data }
}

impl Command {
    /// Return whether drives send the message, cyclically or on request.
    #[must_use]
    pub fn is_report(self) -> bool {
        matches!(
            self,
            Self::Version
                | Self::Heartbeat
                | Self::Error
                | Self::EncoderEstimates
                | Self::Iq
                | Self::Temperature
                | Self::BusVoltageCurrent
                | Self::Torques
                | Self::Powers
        )
    }

    /// Return whether only a host sends the message, to command a drive.
    #[must_use]
    pub fn is_order(self) -> bool {
        !self.is_report() && !matches!(self, Self::RxSdo | Self::TxSdo | Self::Address)
    }

    /// Return the least number of data bytes of the message.
    #[must_use]
    pub fn least_bytes(self) -> usize {
        match self {
            Self::Estop | Self::EnterDfuMode | Self::ClearErrors => 0,
            Self::Reboot => 1,
            Self::RxSdo
            | Self::TxSdo
            | Self::SetAxisState
            | Self::SetInputTorque
            | Self::SetTrajVelLimit
            | Self::SetTrajInertia
            | Self::SetAbsolutePosition
            | Self::SetPosGain => 4,
            Self::Heartbeat | Self::Address => 7,
            _ => 8,
        }
    }
}

fn u16_at(data: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(data.get(at..at + 2)?.try_into().ok()?))
}

fn i16_at(data: &[u8], at: usize) -> Option<i16> {
    Some(i16::from_le_bytes(data.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(data: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?))
}

fn f32_at(data: &[u8], at: usize) -> Option<f32> {
    Some(f32::from_le_bytes(data.get(at..at + 4)?.try_into().ok()?))
}

fn write_sdo(data: &mut Vec<u8>, opcode: u8, endpoint: u16, value: Payload) {
    data.push(opcode);
    data.extend(endpoint.to_le_bytes());
    data.push(0);
    data.extend(value.as_slice());
}

fn serial_at(data: &[u8], at: usize) -> Option<u64> {
    let mut bytes = [0; 8];
    bytes[..6].copy_from_slice(data.get(at..at + 6)?);
    Some(u64::from_le_bytes(bytes))
}

impl Message {
    /// Read the fields of `command`; `None` when the data is too short.
    #[expect(clippy::too_many_lines, reason = "a flat table, one arm per message of the protocol")]
    fn read(command: Command, data: &[u8]) -> Option<Self> {
        let f32_of = |at| f32_at(data, at);
        let u32_of = |at| u32_at(data, at);
        Some(match command {
            Command::Version => Self::Version(data.get(..8)?.try_into().ok()?),
            Command::Heartbeat => Self::Heartbeat {
                axis_error: u32_of(0)?,
                axis_state: *data.get(4)?,
                procedure_result: *data.get(5)?,
                trajectory: match data.get(6)? & 1 {
                    0 => TrajectoryState::Pending,
                    _ => TrajectoryState::Done,
                },
            },
            Command::Estop => Self::Estop,
            Command::Error => Self::Error { active_errors: u32_of(0)?, disarm_reason: u32_of(4)? },
            Command::RxSdo => Self::RxSdo {
                opcode: *data.first()?,
                endpoint: u16_at(data, 1)?,
                value: Payload::new(data.get(4..)?)?,
            },
            Command::TxSdo => {
                Self::TxSdo { endpoint: u16_at(data, 1)?, value: Payload::new(data.get(4..)?)? }
            }
            Command::Address => Self::Address {
                node: *data.first()?,
                serial: serial_at(data, 1)?,
                connection: data.get(7).copied().unwrap_or(0),
            },
            Command::SetAxisState => Self::SetAxisState { state: u32_of(0)? },
            Command::EncoderEstimates => Self::EncoderEstimates {
                position_turns: f32_of(0)?,
                velocity_turns_per_s: f32_of(4)?,
            },
            Command::SetControllerMode => {
                Self::SetControllerMode { control_mode: u32_of(0)?, input_mode: u32_of(4)? }
            }
            Command::SetInputPos => Self::SetInputPos {
                position_turns: f32_of(0)?,
                velocity_counts: i16_at(data, 4)?,
                torque_counts: i16_at(data, 6)?,
            },
            Command::SetInputVel => Self::SetInputVel {
                velocity_turns_per_s: f32_of(0)?,
                torque_newton_metres: f32_of(4)?,
            },
            Command::SetInputTorque => Self::SetInputTorque { torque_newton_metres: f32_of(0)? },
            Command::SetLimits => {
                Self::SetLimits { velocity_turns_per_s: f32_of(0)?, current_amps: f32_of(4)? }
            }
            Command::SetTrajVelLimit => Self::SetTrajVelLimit { velocity_turns_per_s: f32_of(0)? },
            Command::SetTrajAccelLimits => {
                Self::SetTrajAccelLimits { acceleration: f32_of(0)?, deceleration: f32_of(4)? }
            }
            Command::SetTrajInertia => Self::SetTrajInertia { inertia: f32_of(0)? },
            Command::Iq => Self::Iq { setpoint_amps: f32_of(0)?, measured_amps: f32_of(4)? },
            Command::Temperature => {
                Self::Temperature { fet_celsius: f32_of(0)?, motor_celsius: f32_of(4)? }
            }
            Command::Reboot => Self::Reboot { action: *data.first()? },
            Command::BusVoltageCurrent => {
                Self::BusVoltageCurrent { voltage_volts: f32_of(0)?, current_amps: f32_of(4)? }
            }
            Command::ClearErrors => {
                Self::ClearErrors { identify: data.first().copied().unwrap_or(0) }
            }
            Command::SetAbsolutePosition => {
                Self::SetAbsolutePosition { position_turns: f32_of(0)? }
            }
            Command::SetPosGain => Self::SetPosGain { gain: f32_of(0)? },
            Command::SetVelGains => {
                Self::SetVelGains { gain: f32_of(0)?, integrator_gain: f32_of(4)? }
            }
            Command::Torques => Self::Torques {
                target_newton_metres: f32_of(0)?,
                estimate_newton_metres: f32_of(4)?,
            },
            Command::Powers => {
                Self::Powers { electrical_watts: f32_of(0)?, mechanical_watts: f32_of(4)? }
            }
            Command::EnterDfuMode => Self::EnterDfuMode,
        })
    }

    /// Append the fields in the order of the protocol.
    fn write(&self, data: &mut Vec<u8>) {
        let mut f32s = |values: &[f32]| values.iter().for_each(|v| data.extend(v.to_le_bytes()));
        match *self {
            Self::Request(_) | Self::Estop | Self::EnterDfuMode => {}
            Self::Version(bytes) => data.extend(bytes),
            Self::Heartbeat { axis_error, axis_state, procedure_result, trajectory } => {
                data.extend(axis_error.to_le_bytes());
                data.extend([axis_state, procedure_result, trajectory as u8, 0]);
            }
            Self::Error { active_errors: low, disarm_reason: high }
            | Self::SetControllerMode { control_mode: low, input_mode: high } => {
                data.extend(low.to_le_bytes());
                data.extend(high.to_le_bytes());
            }
            Self::RxSdo { opcode, endpoint, value } => write_sdo(data, opcode, endpoint, value),
            Self::TxSdo { endpoint, value } => write_sdo(data, 0, endpoint, value),
            Self::Address { node, serial, connection } => {
                data.push(node);
                data.extend(&serial.to_le_bytes()[..6]);
                data.push(connection);
            }
            Self::SetAxisState { state } => {
                data.extend(state.to_le_bytes());
                data.extend([0; 4]);
            }
            Self::SetInputPos { position_turns, velocity_counts, torque_counts } => {
                data.extend(position_turns.to_le_bytes());
                data.extend(velocity_counts.to_le_bytes());
                data.extend(torque_counts.to_le_bytes());
            }
            Self::SetInputTorque { torque_newton_metres: value }
            | Self::SetTrajVelLimit { velocity_turns_per_s: value }
            | Self::SetTrajInertia { inertia: value }
            | Self::SetAbsolutePosition { position_turns: value }
            | Self::SetPosGain { gain: value } => f32s(&[value, 0.0]),
            Self::Reboot { action: byte } | Self::ClearErrors { identify: byte } => data.push(byte),
            Self::EncoderEstimates { position_turns: a, velocity_turns_per_s: b }
            | Self::SetInputVel { velocity_turns_per_s: a, torque_newton_metres: b }
            | Self::SetLimits { velocity_turns_per_s: a, current_amps: b }
            | Self::SetTrajAccelLimits { acceleration: a, deceleration: b }
            | Self::Iq { setpoint_amps: a, measured_amps: b }
            | Self::Temperature { fet_celsius: a, motor_celsius: b }
            | Self::BusVoltageCurrent { voltage_volts: a, current_amps: b }
            | Self::SetVelGains { gain: a, integrator_gain: b }
            | Self::Torques { target_newton_metres: a, estimate_newton_metres: b }
            | Self::Powers { electrical_watts: a, mechanical_watts: b } => f32s(&[a, b]),
        }
    }

    /// Return the command that the message carries or requests.
    #[must_use]
    pub fn command(&self) -> Command {
        match self {
            Self::Request(command) => *command,
            Self::Version(_) => Command::Version,
            Self::Heartbeat { .. } => Command::Heartbeat,
            Self::Estop => Command::Estop,
            Self::Error { .. } => Command::Error,
            Self::RxSdo { .. } => Command::RxSdo,
            Self::TxSdo { .. } => Command::TxSdo,
            Self::Address { .. } => Command::Address,
            Self::SetAxisState { .. } => Command::SetAxisState,
            Self::EncoderEstimates { .. } => Command::EncoderEstimates,
            Self::SetControllerMode { .. } => Command::SetControllerMode,
            Self::SetInputPos { .. } => Command::SetInputPos,
            Self::SetInputVel { .. } => Command::SetInputVel,
            Self::SetInputTorque { .. } => Command::SetInputTorque,
            Self::SetLimits { .. } => Command::SetLimits,
            Self::SetTrajVelLimit { .. } => Command::SetTrajVelLimit,
            Self::SetTrajAccelLimits { .. } => Command::SetTrajAccelLimits,
            Self::SetTrajInertia { .. } => Command::SetTrajInertia,
            Self::Iq { .. } => Command::Iq,
            Self::Temperature { .. } => Command::Temperature,
            Self::Reboot { .. } => Command::Reboot,
            Self::BusVoltageCurrent { .. } => Command::BusVoltageCurrent,
            Self::ClearErrors { .. } => Command::ClearErrors,
            Self::SetAbsolutePosition { .. } => Command::SetAbsolutePosition,
            Self::SetPosGain { .. } => Command::SetPosGain,
            Self::SetVelGains { .. } => Command::SetVelGains,
            Self::Torques { .. } => Command::Torques,
            Self::Powers { .. } => Command::Powers,
            Self::EnterDfuMode => Command::EnterDfuMode,
        }
    }

    /// Return velocity (turns/s) and torque (N m) feed-forward of `Set_Input_Pos` with the drive's
    /// default scales; `None` for every other message.
    #[must_use]
    pub fn feed_forward(&self) -> Option<[f64; 2]> {
        match *self {
            Self::SetInputPos { velocity_counts, torque_counts, .. } => {
                Some([velocity_counts, torque_counts].map(|c| f64::from(c) * FEED_FORWARD_STEP))
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn frame(id: u32, data: &[u8]) -> Frame {
        Frame {
            id,
            width: IdWidth::Standard,
            kind: FrameKind::Data,
            data: Payload::new(data).unwrap(),
        }
    }

    fn message(id: u32, data: &[u8]) -> Message {
        decode(&frame(id, data)).unwrap().message
    }

    #[test]
    fn known_frames_decode() {
        // An expired watchdog as a real drive reported it: error 0x1000000, IDLE, DISARMED.
        let decoded = decode(&frame(0x061, &[0, 0, 0, 1, 1, 3, 0, 0])).unwrap();
        assert_eq!(decoded.node, 3);
        assert_eq!(
            decoded.message,
            Message::Heartbeat {
                axis_error: 0x0100_0000,
                axis_state: 1,
                procedure_result: 3,
                trajectory: TrajectoryState::Pending,
            }
        );
        let velocity = message(0x04D, &[0, 0, 0xC0, 0x3F, 0, 0, 0, 0xBF]);
        assert_eq!(
            velocity,
            Message::SetInputVel { velocity_turns_per_s: 1.5, torque_newton_metres: -0.5 }
        );
        assert_eq!(
            message(0x006, &[5, 1, 0, 0, 0, 0, 0x80]),
            Message::Address { node: 5, serial: 0x8000_0000_0001, connection: 0 }
        );
        let position = message(0x00C, &[0, 0, 0x80, 0x3F, 0x18, 0xFC, 0xE8, 0x03]);
        assert_eq!(position.feed_forward(), Some([-1.0, 1.0]));
    }

    #[test]
    fn short_frames_are_accepted_where_the_protocol_allows() {
        assert_eq!(message(0x007, &[8, 0, 0, 0]), Message::SetAxisState { state: 8 });
        assert_eq!(message(0x018, &[1]), Message::ClearErrors { identify: 1 });
        let error = decode(&frame(0x009, &[0, 0, 0, 0])).unwrap_err();
        assert_eq!(
            error.to_string(),
            "frame 009 (Get_Encoder_Estimates) has 4 data bytes, it needs 8"
        );
    }

    #[test]
    fn requests_and_foreign_frames_are_distinguished() {
        let mut remote = frame(0x037, &[]);
        remote.kind = FrameKind::Remote;
        assert_eq!(
            decode(&remote).unwrap(),
            Decoded { node: 1, message: Message::Request(Command::BusVoltageCurrent) }
        );
        assert_eq!(message(0x029, &[]), Message::Request(Command::EncoderEstimates));
        assert_eq!(message(0x022, &[]), Message::Estop);
        let unknown = decode(&frame(0x02A, &[0; 8])).unwrap_err();
        assert_eq!(unknown, CodecError::UnknownCommand { id: 0x02A, command: 0x0A });
        let mut extended = frame(0x029, &[0; 8]);
        extended.width = IdWidth::Extended;
        assert!(matches!(decode(&extended), Err(CodecError::Extended { .. })));
        extended.kind = FrameKind::Error;
        assert!(matches!(decode(&extended), Err(CodecError::ErrorFrame { .. })));
    }

    #[test]
    fn unknown_states_are_kept() {
        assert!(matches!(
            message(0x001, &[0, 0, 0, 0, 200, 77, 1, 0]),
            Message::Heartbeat {
                axis_state: 200,
                procedure_result: 77,
                trajectory: TrajectoryState::Done,
                ..
            }
        ));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Any frame: no panic, and the least length given is exactly the least accepted.
        #[test]
        fn least_lengths_are_exact(id in 0_u32..0x800, data in proptest::collection::vec(any::<u8>(), 0..=8)) {
            if let Some(command) = Command::from_id((id & 0x1F) as u8) {
                let enough = command.least_bytes() <= data.len();
                match decode(&frame(id, &data)) {
                    Ok(Decoded { message: Message::Request(asked), .. }) => {
                        prop_assert!(data.is_empty() && asked == command);
                    }
                    Ok(decoded) => prop_assert!(enough && decoded.message.command() == command),
                    Err(_) => prop_assert!(!enough),
                }
            } else {
                prop_assert!(decode(&frame(id, &data)).is_err());
            }
        }

        /// Encoding a decoded frame restores its fields. The comparison is of bytes, so that NaN
        /// counts.
        #[test]
        fn fields_survive_a_round_trip(id in 0_u32..0x800, data in proptest::collection::vec(any::<u8>(), 0..=8)) {
            if let Ok(decoded) = decode(&frame(id, &data)) {
                let encoded = encode(decoded.node, &decoded.message);
                prop_assert_eq!(encoded.id, id);
                let again = decode(&encoded).unwrap();
                prop_assert_eq!(format!("{decoded:?}"), format!("{again:?}"));
            }
        }
    }
}
