//! Simulation of one ODrive S1 with firmware 0.6.x: messages in, messages and torque out.
//!
//! States IDLE and CLOSED_LOOP_CONTROL. Modes are latched on entering closed loop, so later changes
//! have no effect until the next arming. Control of velocity, torque and position, each with
//! PASSTHROUGH; velocity also with VEL_RAMP. Other modes, calibration, homing, trajectories,
//! endpoints (SDO) and DFU are not simulated: arming in such a mode, and requests for such states,
//! end with procedure result INVALID_STATE. The watchdog counts while the drive is armed or arming
//! and is fed by `Set_Axis_State` and `Set_Input_*`. Firmware 0.5.x is fed by every frame to its
//! node, sends the heartbeat of 0.5.6 and does not answer `Get_Version`. Without current the motor
//! coasts: the drive has no brake. Source: ODrive's documentation and reports of its users, in
//! particular for the watchdog; 0.6.x firmware itself is closed source.

mod control;
mod report;

use super::config::{DriveConfig, Seat};
use crate::{
    can::{
        AxisErrors, AxisState, BROADCAST_NODE, Command, ControlMode, Decoded, Frame, InputMode,
        Message, ProcedureResult,
    },
    seed::Stream,
};
use report::Cyclic;
use std::collections::VecDeque;

/// Maximum number of setpoints in the delay line of a drive.
const MOST_DELAYED: usize = 256;
const NANOS: f64 = 1e9;

/// A frame ready to be sent.
#[derive(Debug, Clone, Copy)]
pub(super) struct Outgoing {
    /// Time at which it is ready (ns since the rig's start).
    pub(super) ready_ns: u64,
    /// The frame.
    pub(super) frame: Frame,
}

/// Setpoint from the host, in the drive's own direction.
#[derive(Debug, Clone, Copy, Default)]
struct Setpoint {
    position_turns: f64,
    velocity: f64,
    torque: f64,
}

/// Active faults of a drive.
#[derive(Debug, Clone, Copy, Default)]
#[expect(clippy::struct_excessive_bools, reason = "three independent faults, not states")]
pub(super) struct DriveFaults {
    pub(super) heartbeat_off: bool,
    pub(super) encoder_off: bool,
    pub(super) silent: bool,
    pub(super) fet_celsius: Option<f64>,
}

/// State of one drive.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    pub(super) node: u8,
    pub(super) config: DriveConfig,
    pub(super) faults: DriveFaults,
    serial: u64,
    state: AxisState,
    errors: u32,
    disarm_reason: u32,
    procedure: ProcedureResult,
    /// Time of entering closed loop (ns), while arming.
    armed_at_ns: Option<u64>,
    fed_until_ns: u64,
    /// Requested modes, and the modes latched at the last arming.
    modes: (ControlMode, InputMode),
    latched: (ControlMode, InputMode),
    velocity_limit: f64,
    current_limit: f64,
    input: Setpoint,
    delayed: VecDeque<(u64, Setpoint)>,
    control: control::Loop,
    cyclic: Cyclic,
}

impl Drive {
    /// Build the drive of `seat`; its control loop runs every `dt` seconds. `phases` draws the
    /// phases of its cyclic messages.
    pub(super) fn new(config: &DriveConfig, seat: &Seat, dt: f64, phases: &mut Stream) -> Self {
        let modes = (ControlMode::Velocity, InputMode::Passthrough);
        Self {
            node: seat.node,
            faults: DriveFaults::default(),
            serial: seat.serial,
            state: AxisState::Idle,
            errors: 0,
            disarm_reason: 0,
            procedure: ProcedureResult::Success,
            armed_at_ns: None,
            fed_until_ns: 0,
            modes,
            latched: modes,
            velocity_limit: config.velocity_limit_turns_per_s,
            current_limit: config.current_limit_a,
            input: Setpoint::default(),
            delayed: VecDeque::with_capacity(MOST_DELAYED),
            control: control::Loop::new(config, dt),
            cyclic: Cyclic::new(&config.cyclic_ms, phases),
            config: config.clone(),
        }
    }

    /// State of the axis.
    pub(super) fn state(&self) -> AxisState {
        self.state
    }

    /// Error flags.
    pub(super) fn errors(&self) -> AxisErrors {
        AxisErrors(self.errors)
    }

    /// Torque of the motor (N m), without cogging.
    pub(super) fn torque(&self) -> f64 {
        self.control.torque()
    }

    /// Current from the supply (A).
    pub(super) fn supply_current(&self) -> f64 {
        self.control.supply_current()
    }

    /// Temperature of the power stage (C).
    pub(super) fn fet_celsius(&self) -> f64 {
        self.control.fet_celsius()
    }

    fn is_old(&self) -> bool {
        self.config.firmware[..2] == [0, 5]
    }

    /// Process a frame of the bus that was sent to this node or to all.
    pub(super) fn receive(&mut self, decoded: &Decoded, now_ns: u64, out: &mut Vec<Outgoing>) {
        let mine = decoded.node == self.node;
        if self.faults.silent || !(mine || decoded.node == BROADCAST_NODE) {
            return;
        }
        if mine && self.is_old() {
            self.feed(now_ns);
        }
        match decoded.message {
            // Address requests are remote frames to all nodes; every other request is for one node.
            Message::Request(command) if mine || command == Command::Address => {
                self.send(command, now_ns, out);
            }
            Message::Address { node, serial, .. } if !mine && serial == self.serial => {
                self.node = node.min(BROADCAST_NODE - 1);
            }
            Message::Estop => self.disarm(AxisErrors::ESTOP_REQUESTED.0),
            _ if !mine => {}
            Message::SetAxisState { state } => self.request_state(state, now_ns),
            Message::SetControllerMode { control_mode, input_mode } => {
                let number = |mode: u32| u8::try_from(mode).unwrap_or(u8::MAX);
                self.modes = (
                    ControlMode::from_number(number(control_mode)),
                    InputMode::from_number(number(input_mode)),
                );
            }
            Message::ClearErrors { .. } => {
                self.errors = 0;
                self.disarm_reason = 0;
            }
            Message::Reboot { .. } => self.reboot(),
            other => self.take_value(other, now_ns),
        }
    }

    fn take_value(&mut self, message: Message, now_ns: u64) {
        match message {
            Message::SetInputVel {
                velocity_turns_per_s: velocity,
                torque_newton_metres: torque,
            } => {
                self.take_input(now_ns, [self.input.position_turns as f32, velocity, torque]);
            }
            Message::SetInputTorque { torque_newton_metres: torque } => {
                let [position, velocity] = [self.input.position_turns, self.input.velocity];
                self.take_input(now_ns, [position as f32, velocity as f32, torque]);
            }
            Message::SetInputPos { position_turns, .. } => {
                let [velocity, torque] = message.feed_forward().unwrap_or_default();
                self.take_input(now_ns, [position_turns, velocity as f32, torque as f32]);
            }
            Message::SetLimits { velocity_turns_per_s: velocity, current_amps: current }
                if velocity.is_finite() && current.is_finite() =>
            {
                self.velocity_limit = f64::from(velocity).max(0.0);
                self.current_limit = f64::from(current).max(0.0);
            }
            Message::SetPosGain { gain } if gain.is_finite() => {
                self.config.position_gain_per_s = f64::from(gain);
            }
            Message::SetVelGains { gain, integrator_gain }
                if gain.is_finite() && integrator_gain.is_finite() =>
            {
                self.config.velocity_gain_nm_s_per_turn = f64::from(gain);
                self.config.velocity_integrator_nm_per_turn = f64::from(integrator_gain);
            }
            Message::SetAbsolutePosition { position_turns } if position_turns.is_finite() => {
                self.control.declare_position(f64::from(position_turns));
            }
            _ => {}
        }
    }

    /// Process an input. Any input feeds the watchdog; one with NaN or infinity changes nothing
    /// else.
    fn take_input(&mut self, now_ns: u64, values: [f32; 3]) {
        self.feed(now_ns);
        if !values.iter().all(|value| value.is_finite()) {
            return;
        }
        let [position_turns, velocity, torque] = values.map(f64::from);
        let setpoint = Setpoint { position_turns, velocity, torque };
        let delay_ns = (self.config.command_delay_s * NANOS).round() as u64;
        if delay_ns == 0 {
            self.input = setpoint;
            return;
        }
        if MOST_DELAYED <= self.delayed.len() {
            self.delayed.pop_front();
        }
        self.delayed.push_back((now_ns + delay_ns, setpoint));
    }

    fn feed(&mut self, now_ns: u64) {
        let timeout_ns = (self.config.watchdog_timeout_s * NANOS).round() as u64;
        self.fed_until_ns = now_ns + timeout_ns;
    }

    fn request_state(&mut self, state: u32, now_ns: u64) {
        self.feed(now_ns);
        match AxisState::from_number(u8::try_from(state).unwrap_or(u8::MAX)) {
            AxisState::Idle => {
                self.procedure = if self.armed_at_ns.take().is_some() {
                    ProcedureResult::Cancelled
                } else {
                    ProcedureResult::Success
                };
                self.state = AxisState::Idle;
            }
            AxisState::ClosedLoopControl if self.state == AxisState::ClosedLoopControl => {}
            AxisState::ClosedLoopControl if self.errors != 0 => {
                self.procedure = ProcedureResult::Disarmed;
            }
            AxisState::ClosedLoopControl if control::can_control(self.modes) => {
                let wait_ns = (self.config.arming_s * NANOS).round() as u64;
                self.procedure = ProcedureResult::Busy;
                self.armed_at_ns.get_or_insert(now_ns + wait_ns);
            }
            _ => self.procedure = ProcedureResult::InvalidState,
        }
    }

    fn reboot(&mut self) {
        self.state = AxisState::Idle;
        self.armed_at_ns = None;
        (self.errors, self.disarm_reason) = (0, 0);
        self.procedure = ProcedureResult::Success;
        self.input = Setpoint::default();
        self.delayed.clear();
        self.modes = (ControlMode::Velocity, InputMode::Passthrough);
        self.velocity_limit = self.config.velocity_limit_turns_per_s;
        self.current_limit = self.config.current_limit_a;
    }

    /// Leave closed loop, or cancel arming, with `reason`; the flags persist until `Clear_Errors`.
    pub(super) fn disarm(&mut self, reason: u32) {
        self.errors |= reason;
        if self.state == AxisState::ClosedLoopControl || self.armed_at_ns.is_some() {
            self.disarm_reason = reason;
            self.procedure = ProcedureResult::Disarmed;
        }
        self.state = AxisState::Idle;
        self.armed_at_ns = None;
    }
}
