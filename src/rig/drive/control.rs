//! Control loop of a drive: estimator, velocity loop, current, temperatures, protections.
//!
//! Estimator: a second-order phase-locked loop of bandwidth `w`, `p' = v + 2 w e`, `v' = w^2 e`.
//! Velocity loop: `torque = Kv e + Ki int(e) + feed-forward`, bounded by the current limit and by
//! the voltage reserve at this speed, `I <= (V - Kt omega)/R`; the integrator stops while bounded
//! (anti-windup). Source of the structure: ODrive's documentation of its controller.

use super::{Drive, NANOS};
use crate::{
    can::{AxisErrors, AxisState, ControlMode, InputMode, ProcedureResult},
    rig::config::DriveConfig,
};
use std::f64::consts::TAU;

const OVER_TEMPERATURE_FET: u32 = 0x4000;
const OVER_TEMPERATURE_MOTOR: u32 = 0x2000;
const UNDER_VOLTAGE: u32 = 0x200;
const OVERSPEED: u32 = 0x8000;
const SPINOUT: u32 = 0x400_0000;
/// Spinout: minimum torque, as a fraction of the limit.
const SPINOUT_FRACTION: f64 = 0.9;
/// Spinout: maximum speed (turn/s).
const SPINOUT_SPEED: f64 = 0.2;
/// Spinout: minimum duration (s).
const SPINOUT_TIME: f64 = 0.2;

/// Return whether the simulated controller supports these modes.
pub(super) fn can_control((control, input): (ControlMode, InputMode)) -> bool {
    match control {
        ControlMode::Velocity => matches!(input, InputMode::Passthrough | InputMode::VelRamp),
        ControlMode::Torque | ControlMode::Position => input == InputMode::Passthrough,
        _ => false,
    }
}

/// State of the loop.
#[derive(Debug, Clone)]
pub(super) struct Loop {
    dt: f64,
    /// Declared minus true position (turn).
    zero: f64,
    position: f64,
    velocity: f64,
    /// True speed (turn/s).
    speed: f64,
    /// Setpoint after ramp, slew and lag (turn/s).
    wanted: f64,
    integral: f64,
    target: f64,
    torque: f64,
    torque_constant: f64,
    resistance: f64,
    supply_volts: f64,
    supply_current: f64,
    fet_celsius: f64,
    motor_celsius: f64,
    pushing_s: f64,
}

impl Loop {
    pub(super) fn new(config: &DriveConfig, dt: f64) -> Self {
        Self {
            dt,
            zero: 0.0,
            position: 0.0,
            velocity: 0.0,
            speed: 0.0,
            wanted: 0.0,
            integral: 0.0,
            target: 0.0,
            torque: 0.0,
            torque_constant: config.torque_constant_nm_per_a,
            resistance: config.phase_resistance_ohm,
            supply_volts: 0.0,
            supply_current: 0.0,
            fet_celsius: config.thermal.ambient_celsius,
            motor_celsius: config.thermal.ambient_celsius,
            pushing_s: 0.0,
        }
    }

    pub(super) fn torque(&self) -> f64 {
        self.torque
    }

    pub(super) fn target(&self) -> f64 {
        self.target
    }

    pub(super) fn supply_current(&self) -> f64 {
        self.supply_current
    }

    pub(super) fn supply_volts(&self) -> f64 {
        self.supply_volts
    }

    pub(super) fn fet_celsius(&self) -> f64 {
        self.fet_celsius
    }

    pub(super) fn motor_celsius(&self) -> f64 {
        self.motor_celsius
    }

    /// Current of the requested torque and of the actual torque (A).
    pub(super) fn currents(&self) -> [f64; 2] {
        [self.target / self.torque_constant, self.torque / self.torque_constant]
    }

    /// Electrical and mechanical power (W).
    pub(super) fn powers(&self) -> [f64; 2] {
        [self.supply_current * self.supply_volts, self.torque * self.speed * TAU]
    }

    /// Estimated position (turn) and velocity (turn/s).
    pub(super) fn estimates(&self) -> [f64; 2] {
        [self.position + self.zero, self.velocity]
    }

    pub(super) fn declare_position(&mut self, position: f64) {
        self.zero = position - self.position;
    }

    fn estimate(&mut self, config: &DriveConfig, turns: f64) {
        let mut seen = turns;
        if config.encoder_eccentricity_turns != 0.0 {
            seen += config.encoder_eccentricity_turns * (TAU * turns).sin();
        }
        if config.encoder_step_turns != 0.0 {
            seen = (seen / config.encoder_step_turns).floor() * config.encoder_step_turns;
        }
        let bandwidth = config.encoder_bandwidth_per_s;
        self.position += self.velocity * self.dt;
        let error = seen - self.position;
        self.position += 2.0 * bandwidth * self.dt * error;
        self.velocity += bandwidth * bandwidth * self.dt * error;
    }

    fn warm(&mut self, config: &DriveConfig, forced: Option<f64>) {
        let thermal = &config.thermal;
        let square = (self.torque / self.torque_constant).powi(2);
        let fet = thermal.ambient_celsius + thermal.fet_rise_celsius_per_a2 * square;
        let motor = thermal.ambient_celsius + thermal.motor_rise_celsius_per_a2 * square;
        self.fet_celsius += (fet - self.fet_celsius) / thermal.fet_time_s * self.dt;
        self.motor_celsius += (motor - self.motor_celsius) / thermal.motor_time_s * self.dt;
        if let Some(celsius) = forced {
            self.fet_celsius = celsius;
        }
    }

    /// Approach the requested torque, within `current_limit` (A) and the voltage reserve.
    fn push(&mut self, config: &DriveConfig, wanted: f64, current_limit: f64) {
        let back_emf = self.torque_constant * self.speed * TAU;
        let most = ((self.supply_volts - back_emf) / self.resistance).clamp(0.0, current_limit);
        let least = ((-self.supply_volts - back_emf) / self.resistance).clamp(-current_limit, 0.0);
        self.target = wanted.clamp(least * self.torque_constant, most * self.torque_constant);
        self.torque += (self.target - self.torque) * self.dt / (config.current_lag_s + self.dt);
        self.draw();
    }

    /// Reset the torque: no current.
    fn release(&mut self) {
        (self.target, self.integral, self.wanted, self.pushing_s) = (0.0, 0.0, 0.0, 0.0);
        self.torque = 0.0;
        self.draw();
    }

    fn draw(&mut self) {
        let current = self.torque / self.torque_constant;
        let power = self.torque * self.speed * TAU + self.resistance * current * current;
        self.supply_current = if 1.0 < self.supply_volts { power / self.supply_volts } else { 0.0 };
    }
}

impl Drive {
    /// One control step: from the true `turns` and `speed` (turn/s) of the motor and the supply
    /// voltage to the torque on the shaft (N m), cogging included.
    pub(in crate::rig) fn tick(&mut self, now_ns: u64, motion: [f64; 2], supply_volts: f64) -> f64 {
        let [turns, speed] = motion;
        self.control.speed = speed;
        self.control.supply_volts = supply_volts;
        self.control.estimate(&self.config, turns);
        self.control.warm(&self.config, self.faults.fet_celsius);
        self.guard(now_ns);
        while let Some((_, setpoint)) = self.delayed.pop_front_if(|(due, _)| *due <= now_ns) {
            self.input = setpoint;
        }
        if self.armed_at_ns.is_some_and(|at| at <= now_ns) {
            self.armed_at_ns = None;
            self.state = AxisState::ClosedLoopControl;
            self.procedure = ProcedureResult::Success;
            self.latched = self.modes;
        }
        if self.state == AxisState::ClosedLoopControl {
            let wanted = self.wanted_torque();
            self.control.push(&self.config, wanted, self.current_limit);
        } else {
            self.control.release();
        }
        let cogging = |ripple: &crate::rig::config::Ripple| {
            let phase = ripple.periods_per_turn * turns + ripple.phase_turns;
            ripple.amplitude_nm * (TAU * phase).sin()
        };
        self.control.torque + self.config.cogging.iter().map(cogging).sum::<f64>()
    }

    fn guard(&mut self, now_ns: u64) {
        let thermal = &self.config.thermal;
        let mut reason = 0;
        if thermal.fet_limit_celsius < self.control.fet_celsius {
            reason |= OVER_TEMPERATURE_FET;
        }
        let guards = self.config.guards;
        if guards.motor_thermistor && thermal.motor_limit_celsius < self.control.motor_celsius {
            reason |= OVER_TEMPERATURE_MOTOR;
        }
        let armed = self.state == AxisState::ClosedLoopControl;
        if (armed || self.armed_at_ns.is_some())
            && guards.watchdog_enabled
            && self.fed_until_ns < now_ns
        {
            reason |= AxisErrors::WATCHDOG_TIMER_EXPIRED.0;
        }
        if armed {
            let fast = self.velocity_limit * self.config.overspeed_ratio;
            if fast < self.control.velocity.abs() {
                reason |= OVERSPEED;
            }
            if self.control.supply_volts < self.config.least_supply_volts {
                reason |= UNDER_VOLTAGE;
            }
            if guards.spinout_enabled && self.has_spun_out() {
                reason |= SPINOUT;
            }
        }
        if reason != 0 && reason & !self.errors != 0 {
            self.disarm(reason);
        }
    }

    fn has_spun_out(&mut self) -> bool {
        let limit = self.current_limit * self.config.torque_constant_nm_per_a;
        let pushing = SPINOUT_FRACTION * limit < self.control.target.abs();
        let standing = self.control.velocity.abs() < SPINOUT_SPEED;
        let control = &mut self.control;
        control.pushing_s = if pushing && standing { control.pushing_s + control.dt } else { 0.0 };
        SPINOUT_TIME < control.pushing_s
    }

    fn wanted_torque(&mut self) -> f64 {
        let (control, input) = self.latched;
        if control == ControlMode::Torque {
            return self.input.torque;
        }
        let asked = if control == ControlMode::Position {
            let error = self.input.position_turns - self.control.estimates()[0];
            self.config.position_gain_per_s * error + self.input.velocity
        } else {
            self.input.velocity
        };
        let config = &self.config;
        let state = &mut self.control;
        let mut asked = asked * (1.0 + config.gain_error) + config.offset_turns_per_s;
        if asked.abs() < config.deadband_turns_per_s {
            asked = 0.0;
        }
        let ramp =
            if input == InputMode::VelRamp { config.ramp_turns_per_s2 } else { f64::INFINITY };
        let slew =
            if config.slew_turns_per_s2 == 0.0 { ramp } else { config.slew_turns_per_s2.min(ramp) };
        let step = slew * state.dt;
        let lagged = state.wanted + (asked - state.wanted) * state.dt / (config.lag_s + state.dt);
        state.wanted = lagged
            .clamp(state.wanted - step, state.wanted + step)
            .clamp(-self.velocity_limit, self.velocity_limit);
        let error = state.wanted - state.velocity;
        let wanted =
            config.velocity_gain_nm_s_per_turn * error + state.integral + self.input.torque;
        let limit = self.current_limit * state.torque_constant;
        if wanted.abs() < limit {
            state.integral += config.velocity_integrator_nm_per_turn * error * state.dt;
        }
        wanted
    }
}

/// Period of a cyclic message (ns).
pub(super) fn period_ns(millis: u32) -> u64 {
    (f64::from(millis) * 1e-3 * NANOS) as u64
}
