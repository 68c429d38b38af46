//! Configuration of the drives and their motors.

use super::{
    ConfigError,
    ranged::{ranged, within},
};
use crate::recording::topic::{Motor, Player};
use serde::{Deserialize, Serialize};

ranged! {
    /// One drive with its motor. Source of the defaults: ODrive S1 with M8325s motor; the gains are
    /// tuned to the paper's step response.
    DriveConfig {
        /// Timeout of an enabled watchdog (s).
        watchdog_timeout_s: 0.2 in [0.001, 60.0];
        /// Time from the request to closed loop (s).
        arming_s: 0.010 in [0.0, 5.0];
        /// Velocity gain (N m/(turn/s)); close to ODrive's 1/6.
        velocity_gain_nm_s_per_turn: 0.2 in [0.0, 100.0];
        /// Integral gain of the velocity loop (N m/turn).
        velocity_integrator_nm_per_turn: 0.6 in [0.0, 1e4];
        /// Position gain ((turn/s)/turn).
        position_gain_per_s: 20.0 in [0.0, 1e3];
        /// Torque constant (N m/A); 8.27/100 of the M8325s.
        torque_constant_nm_per_a: 0.0827 in [1e-4, 10.0];
        /// Current limit until `Set_Limits` (A).
        current_limit_a: 15.0 in [0.0, 150.0];
        /// Velocity limit until `Set_Limits` (turn/s).
        velocity_limit_turns_per_s: 40.0 in [0.1, 1e3];
        /// Ratio of speed to velocity limit at which the drive disarms.
        overspeed_ratio: 1.2 in [1.0, 100.0];
        /// Acceleration limit of VEL_RAMP (turn/s^2).
        ramp_turns_per_s2: 250.0 in [0.0, 1e6];
        /// Dead time from the frame to the controller (s); tuned to the paper's stop.
        command_delay_s: 0.008 in [0.0, 0.2];
        /// Relative error of setpoints: they are multiplied by 1 plus this.
        gain_error: 0.0 in [-0.5, 0.5];
        /// Offset of every setpoint (turn/s).
        offset_turns_per_s: 0.0 in [-10.0, 10.0];
        /// Dead band: smaller setpoints are taken as zero (turn/s).
        deadband_turns_per_s: 0.0 in [0.0, 10.0];
        /// Slew limit of the setpoint at the controller (turn/s^2); 0 for none. By default 9.6
        /// m/s^2 along an axis.
        slew_turns_per_s2: 240.0 in [0.0, 1e6];
        /// Time constant of the first-order lag of the setpoint (s).
        lag_s: 0.0 in [0.0, 0.5];
        /// Time constant of the first-order lag of the torque, i.e. of the current loop (s).
        current_lag_s: 0.0005 in [0.0, 0.1];
        /// Phase resistance (ohm): torque decreases with speed when the supply voltage is
        /// exhausted.
        phase_resistance_ohm: 0.03 in [1e-4, 100.0];
        /// Bandwidth of the estimator of position and velocity (1/s).
        encoder_bandwidth_per_s: 1000.0 in [1.0, 1e5];
        /// Encoder resolution (turn); 0 for none.
        encoder_step_turns: 0.000_015_26 in [0.0, 0.01];
        /// Amplitude of the encoder error once per turn (turn).
        encoder_eccentricity_turns: 0.0 in [0.0, 0.05];
        /// Rotor inertia (kg m^2).
        rotor_inertia_kg_m2: 0.0004 in [1e-6, 1.0];
        /// Minimum supply voltage (V).
        least_supply_volts: 10.5 in [0.0, 60.0];
    }
    other {
        /// Firmware version: major, minor, revision. 0.5.x behaves as 0.5.6 does.
        firmware: [u8; 3] = [0, 6, 11];
        /// Hardware version: major, minor, variant; S1 is 5.2.x.
        hardware: [u8; 3] = [5, 2, 0];
        /// Periods of the cyclic messages.
        cyclic_ms: CyclicMs = CyclicMs::default();
        /// Protections of the drive.
        guards: Guards = Guards::default();
        /// Friction at the motor shaft.
        friction: MotorFriction = MotorFriction::default();
        /// Cogging torque.
        cogging: Vec<Ripple> = vec![Ripple { amplitude_nm: 0.004, periods_per_turn: 24.0, phase_turns: 0.0 }];
        /// Thermal model.
        thermal: ThermalConfig = ThermalConfig::default();
    }
}

/// Protections of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Guards {
    /// Enable the watchdog.
    pub watchdog_enabled: bool,
    /// Disarm a drive whose motor pushes without turning (`SPINOUT_DETECTED`).
    pub spinout_enabled: bool,
    /// The motor has a thermistor; without one its temperature reads 0.
    pub motor_thermistor: bool,
}

impl Default for Guards {
    fn default() -> Self {
        Self { watchdog_enabled: true, spinout_enabled: false, motor_thermistor: true }
    }
}

/// Periods (ms) of the cyclic messages; 0 for off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[expect(missing_docs, reason = "named after the settings of the drive")]
pub struct CyclicMs {
    pub heartbeat: u32,
    pub encoder: u32,
    pub iq: u32,
    pub error: u32,
    pub temperature: u32,
    pub bus_voltage: u32,
    pub torques: u32,
    pub powers: u32,
}

impl Default for CyclicMs {
    fn default() -> Self {
        Self {
            heartbeat: 100,
            encoder: 10,
            iq: 0,
            error: 0,
            temperature: 0,
            bus_voltage: 0,
            torques: 0,
            powers: 0,
        }
    }
}

ranged! {
    /// Friction at the shaft of a motor; [`crate::rig`] has the law.
    MotorFriction {
        /// Coulomb friction (N m).
        coulomb_nm: 0.015 in [0.0, 10.0];
        /// Breakaway friction (N m); Stribeck friction when above Coulomb, none when below.
        breakaway_nm: 0.0 in [0.0, 10.0];
        /// Stribeck speed (turn/s).
        stribeck_turns_per_s: 0.3 in [1e-3, 100.0];
        /// Viscous friction (N m/(turn/s)).
        viscous_nm_s_per_turn: 0.0005 in [0.0, 10.0];
        /// Quadratic friction (N m/(turn/s)^2).
        quadratic_nm_s2_per_turn2: 0.0 in [0.0, 1.0];
        /// Ratio of backward to forward friction.
        backward_ratio: 1.0 in [0.1, 10.0];
        /// Additional friction as a fraction of the belt's tension.
        load_fraction: 0.0 in [0.0, 0.5];
    }
}

/// Torque ripple: a torque that repeats with the rotor angle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ripple {
    /// Amplitude (N m).
    pub amplitude_nm: f64,
    /// Periods per turn.
    pub periods_per_turn: f64,
    /// Phase (turns of one period).
    #[serde(default)]
    pub phase_turns: f64,
}

ranged! {
    /// First-order thermal model: `T' = (ambient + rise I^2 - T) / time`.
    ThermalConfig {
        /// Ambient temperature (C).
        ambient_celsius: 25.0 in [-40.0, 80.0];
        /// Temperature rise of the power stage (C/A^2).
        fet_rise_celsius_per_a2: 0.15 in [0.0, 100.0];
        /// Time constant of the power stage (s).
        fet_time_s: 20.0 in [0.1, 1e5];
        /// Power stage temperature at which the drive disarms (C).
        fet_limit_celsius: 100.0 in [0.0, 200.0];
        /// Temperature rise of the motor (C/A^2).
        motor_rise_celsius_per_a2: 0.3 in [0.0, 100.0];
        /// Time constant of the motor (s).
        motor_time_s: 300.0 in [0.1, 1e5];
        /// Motor temperature at which a drive with a thermistor disarms (C).
        motor_limit_celsius: 120.0 in [0.0, 300.0];
    }
}

/// Assignment of a drive to a motor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Seat {
    /// Node id, 0 to 62.
    pub node: u8,
    /// Player of the gantry.
    pub player: Player,
    /// Motor of the gantry.
    pub motor: Motor,
    /// Direction, +1 or -1: turns of the drive times this are turns of the gantry.
    pub sign: i8,
    /// Serial number (48 bits).
    #[serde(default)]
    pub serial: u64,
    /// Settings of this drive alone, instead of the common `drive`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own: Option<Box<DriveConfig>>,
}

impl Seat {
    /// The KlaskTron table: nodes 0 and 1 drive the right player's motors a and b, 2 and 3 the left
    /// player's with reversed direction. Source: the upstream motor launch file.
    #[must_use]
    pub fn klasktron() -> Vec<Self> {
        [
            (0, Player::Right, Motor::A, 1),
            (1, Player::Right, Motor::B, 1),
            (2, Player::Left, Motor::A, -1),
            (3, Player::Left, Motor::B, -1),
        ]
        .map(|(node, player, motor, sign)| Self {
            node,
            player,
            motor,
            sign,
            serial: 0x3957_0000_0000 + u64::from(node),
            own: None,
        })
        .to_vec()
    }

    pub(super) fn check(&self, path: &str, step_s: f64) -> Result<(), ConfigError> {
        within(&format!("|{path}sign|"), f64::from(self.sign).abs(), 1.0, 1.0)?;
        within(&format!("{path}serial"), self.serial as f64, 0.0, (1_u64 << 48) as f64)?;
        match &self.own {
            Some(own) => own.check(&format!("{path}own."), step_s),
            None => Ok(()),
        }
    }
}

impl DriveConfig {
    pub(super) fn check(&self, path: &str, step_s: f64) -> Result<(), ConfigError> {
        self.check_numbers(path)?;
        self.friction.check_numbers(&format!("{path}friction."))?;
        self.thermal.check_numbers(&format!("{path}thermal."))?;
        for (idx, ripple) in self.cogging.iter().enumerate() {
            let path = format!("{path}cogging[{idx}].");
            within(&format!("{path}amplitude_nm"), ripple.amplitude_nm, 0.0, 10.0)?;
            within(&format!("{path}periods_per_turn"), ripple.periods_per_turn, 0.0, 1000.0)?;
            within(&format!("{path}phase_turns"), ripple.phase_turns, -1.0, 1.0)?;
        }
        let longest_s = 0.5 / self.encoder_bandwidth_per_s;
        if longest_s < step_s {
            return Err(ConfigError::Unstable { step_s, spring: "encoder estimator", longest_s });
        }
        Ok(())
    }
}
