//! Enumerations of ODrive 0.6.x: states, modes, results and error flags.
//!
//! Source: PyPI `odrive` 0.6.11 `enums.py` and the DBC of 0.6.10. Numbers that are not listed
//! become `Unknown`, so that values of newer firmware are preserved.

use std::fmt;

/// Declaration of an open enumeration: its variants, their numbers and their names.
macro_rules! open_enum {
    ($(#[$doc:meta])* $kind:ident: $($name:ident = $number:literal, $spelled:literal;)*) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $kind {
            $(#[doc = $spelled] $name,)*
            /// Number missing in this table.
            Unknown(u8),
        }

        impl $kind {
            /// All named values.
            pub const NAMED: &[Self] = &[$(Self::$name,)*];

            /// Return the value with this number.
            #[must_use]
            pub fn from_number(number: u8) -> Self {
                match number { $($number => Self::$name,)* other => Self::Unknown(other) }
            }

            /// Return the number used on the bus.
            #[must_use]
            pub fn number(self) -> u8 {
                match self { $(Self::$name => $number,)* Self::Unknown(number) => number }
            }
        }

        impl fmt::Display for $kind {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self {
                    $(Self::$name => f.write_str($spelled),)*
                    Self::Unknown(number) => write!(f, "unknown({number})"),
                }
            }
        }
    };
}

open_enum! {
    /// State of an axis.
    AxisState:
    Undefined = 0, "UNDEFINED";
    Idle = 1, "IDLE";
    StartupSequence = 2, "STARTUP_SEQUENCE";
    FullCalibrationSequence = 3, "FULL_CALIBRATION_SEQUENCE";
    MotorCalibration = 4, "MOTOR_CALIBRATION";
    SensorlessControl = 5, "SENSORLESS_CONTROL";
    EncoderIndexSearch = 6, "ENCODER_INDEX_SEARCH";
    EncoderOffsetCalibration = 7, "ENCODER_OFFSET_CALIBRATION";
    ClosedLoopControl = 8, "CLOSED_LOOP_CONTROL";
    LockinSpin = 9, "LOCKIN_SPIN";
    EncoderDirFind = 10, "ENCODER_DIR_FIND";
    Homing = 11, "HOMING";
    EncoderHallPolarityCalibration = 12, "ENCODER_HALL_POLARITY_CALIBRATION";
    EncoderHallPhaseCalibration = 13, "ENCODER_HALL_PHASE_CALIBRATION";
    AnticoggingCalibration = 14, "ANTICOGGING_CALIBRATION";
    HarmonicCalibration = 15, "HARMONIC_CALIBRATION";
    HarmonicCalibrationCommutation = 16, "HARMONIC_CALIBRATION_COMMUTATION";
}

open_enum! {
    /// Result of the last procedure of an axis.
    ProcedureResult:
    Success = 0, "SUCCESS";
    Busy = 1, "BUSY";
    Cancelled = 2, "CANCELLED";
    Disarmed = 3, "DISARMED";
    NoResponse = 4, "NO_RESPONSE";
    PolePairCprMismatch = 5, "POLE_PAIR_CPR_MISMATCH";
    PhaseResistanceOutOfRange = 6, "PHASE_RESISTANCE_OUT_OF_RANGE";
    PhaseInductanceOutOfRange = 7, "PHASE_INDUCTANCE_OUT_OF_RANGE";
    UnbalancedPhases = 8, "UNBALANCED_PHASES";
    InvalidMotorType = 9, "INVALID_MOTOR_TYPE";
    IllegalHallState = 10, "ILLEGAL_HALL_STATE";
    Timeout = 11, "TIMEOUT";
    HomingWithoutEndstop = 12, "HOMING_WITHOUT_ENDSTOP";
    InvalidState = 13, "INVALID_STATE";
    NotCalibrated = 14, "NOT_CALIBRATED";
    NotConverging = 15, "NOT_CONVERGING";
    RequestedCurrentTooHigh = 16, "REQUESTED_CURRENT_TOO_HIGH";
}

open_enum! {
    /// Control mode of a drive.
    ControlMode:
    Voltage = 0, "VOLTAGE_CONTROL";
    Torque = 1, "TORQUE_CONTROL";
    Velocity = 2, "VELOCITY_CONTROL";
    Position = 3, "POSITION_CONTROL";
}

open_enum! {
    /// Input mode of a drive. In mode 1 the input reaches the controller unchanged; older KlaskTron
    /// software calls it a ramp, which is mode 2.
    InputMode:
    Inactive = 0, "INACTIVE";
    Passthrough = 1, "PASSTHROUGH";
    VelRamp = 2, "VEL_RAMP";
    PosFilter = 3, "POS_FILTER";
    MixChannels = 4, "MIX_CHANNELS";
    TrapTraj = 5, "TRAP_TRAJ";
    TorqueRamp = 6, "TORQUE_RAMP";
    Mirror = 7, "MIRROR";
    Tuning = 8, "TUNING";
}

/// Error flags of an axis. The heartbeat, the active errors and the disarm reason use the same
/// bits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AxisErrors(pub u32);

impl AxisErrors {
    /// The watchdog was not fed in time.
    pub const WATCHDOG_TIMER_EXPIRED: Self = Self(0x0100_0000);
    /// An emergency stop arrived.
    pub const ESTOP_REQUESTED: Self = Self(0x0200_0000);

    const NAMES: [(u32, &str); 23] = [
        (0x1, "INITIALIZING"),
        (0x2, "SYSTEM_LEVEL"),
        (0x4, "TIMING_ERROR"),
        (0x8, "MISSING_ESTIMATE"),
        (0x10, "BAD_CONFIG"),
        (0x20, "DRV_FAULT"),
        (0x40, "MISSING_INPUT"),
        (0x100, "DC_BUS_OVER_VOLTAGE"),
        (0x200, "DC_BUS_UNDER_VOLTAGE"),
        (0x400, "DC_BUS_OVER_CURRENT"),
        (0x800, "DC_BUS_OVER_REGEN_CURRENT"),
        (0x1000, "CURRENT_LIMIT_VIOLATION"),
        (0x2000, "MOTOR_OVER_TEMP"),
        (0x4000, "INVERTER_OVER_TEMP"),
        (0x8000, "VELOCITY_LIMIT_VIOLATION"),
        (0x1_0000, "POSITION_LIMIT_VIOLATION"),
        (0x2_0000, "REQUESTED_CURRENT_TOO_HIGH"),
        (0x100_0000, "WATCHDOG_TIMER_EXPIRED"),
        (0x200_0000, "ESTOP_REQUESTED"),
        (0x400_0000, "SPINOUT_DETECTED"),
        (0x800_0000, "BRAKE_RESISTOR_DISARMED"),
        (0x1000_0000, "THERMISTOR_DISCONNECTED"),
        (0x4000_0000, "CALIBRATION_ERROR"),
    ];

    /// Return whether no flag is set.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Return whether every flag of `other` is set.
    #[must_use]
    pub fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }
}

impl fmt::Display for AxisErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_empty() {
            return f.write_str("none");
        }
        let mut rest = self.0;
        let mut separator = "";
        for (bit, name) in Self::NAMES {
            if rest & bit != 0 {
                write!(f, "{separator}{name}")?;
                separator = " | ";
                rest &= !bit;
            }
        }
        if rest != 0 {
            write!(f, "{separator}unknown(0x{rest:X})")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_and_values_are_one_map() {
        for number in 0..=u8::MAX {
            assert_eq!(AxisState::from_number(number).number(), number);
            assert_eq!(ProcedureResult::from_number(number).number(), number);
            assert_eq!(ControlMode::from_number(number).number(), number);
            assert_eq!(InputMode::from_number(number).number(), number);
        }
        assert_eq!(AxisState::from_number(200).to_string(), "unknown(200)");
        assert_eq!(AxisState::from_number(8), AxisState::ClosedLoopControl);
    }

    #[test]
    fn error_flags_are_all_named() {
        assert_eq!(AxisErrors(0).to_string(), "none");
        let both = AxisErrors(0x0300_0000);
        assert_eq!(both.to_string(), "WATCHDOG_TIMER_EXPIRED | ESTOP_REQUESTED");
        assert!(both.contains(AxisErrors::ESTOP_REQUESTED));
        assert_eq!(AxisErrors(0x8000_0082).to_string(), "SYSTEM_LEVEL | unknown(0x80000080)");
    }
}
