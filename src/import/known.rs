//! Definitions of the KlaskTron stack's messages, for bags without definitions (ROS 2 Humble and
//! older).
//!
//! If a type has several variants, all are listed, and the first that matches a payload
//! exactly is used. Source: the upstream interface packages (field lists, not code) and the common
//! ROS 2 interfaces.

use super::{
    cdr::{self, CdrError, Value},
    rosmsg::{RosMsgError, Schema, short_name},
};

const HEADER: &str = "\
====
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
";
const VECTORS: &str = "\
====
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
====
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
====
MSG: geometry_msgs/Twist
Vector3 linear
Vector3 angular
";
const STATE: &str = "\
std_msgs/Header header
ObjectState ball
ObjectState left_peg
ObjectState right_peg
geometry_msgs/Point left_goal_pos
geometry_msgs/Point right_goal_pos
";
const OBJECT_STATE: &str = "\
====
MSG: klask_interfaces/ObjectState
geometry_msgs/Point position
geometry_msgs/Point velocity
====
MSG: std_msgs/UInt64
uint64 data
====
MSG: std_msgs/UInt8
uint8 data
";
const CONTROLLER_STATUS: &str = "\
float32 pos_estimate
float32 vel_estimate
float32 torque_target
float32 torque_estimate
float32 iq_setpoint
float32 iq_measured
uint32 active_errors
uint8 axis_state
uint8 procedure_result
bool trajectory_done_flag
";
const ODRIVE_STATUS: &str = "\
float32 bus_voltage
float32 bus_current
float32 fet_temperature
float32 motor_temperature
uint32 active_errors
uint32 disarm_reason
";
const CONTROL_MESSAGE: &str = "\
uint32 control_mode
uint32 input_mode
float32 input_pos
float32 input_vel
float32 input_torque
";
const FLOAT_ARRAY: &str = "\
MultiArrayLayout layout
float32[] data
====
MSG: std_msgs/MultiArrayLayout
MultiArrayDimension[] dim
uint32 data_offset
====
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
";
const CAN_FRAME: &str = "\
std_msgs/Header header
uint32 id
bool is_rtr
bool is_extended
bool is_error
uint8 dlc
uint8[8] data
";

/// Decoder of the messages of one topic, by one definition or by the matching variant.
#[derive(Debug, Clone)]
pub struct Decoder {
    variants: Vec<Schema>,
}

impl Decoder {
    /// Create a decoder for the definition in the bag.
    ///
    /// # Errors
    /// When the text is not a message definition.
    pub fn of_definition(type_name: &str, definition: &str) -> Result<Self, RosMsgError> {
        Ok(Self { variants: vec![Schema::parse(type_name, definition)?] })
    }

    /// Create a decoder for a known type; `None` for any other.
    #[must_use]
    pub fn of_known_type(type_name: &str) -> Option<Self> {
        let name = short_name(type_name);
        let variants: Option<Vec<Schema>> =
            known_texts(&name)?.iter().map(|text| Schema::parse(&name, text).ok()).collect();
        Some(Self { variants: variants? })
    }

    /// Read one message.
    ///
    /// # Errors
    /// When no variant matches the bytes; the error is that of the first variant.
    pub fn read(&self, bytes: &[u8]) -> Result<Value, CdrError> {
        let mut first = None;
        for schema in &self.variants {
            match cdr::read_message(schema, bytes) {
                Ok(value) => return Ok(value),
                Err(error) => {
                    first.get_or_insert(error);
                }
            }
        }
        Err(first.unwrap_or(CdrError::NoHeader { length: bytes.len() }))
    }
}

fn known_texts(name: &str) -> Option<Vec<String>> {
    Some(match name {
        "geometry_msgs/Twist" => vec![format!("Vector3 linear\nVector3 angular\n{VECTORS}")],
        "geometry_msgs/TwistStamped" => {
            vec![format!("std_msgs/Header header\nTwist twist\n{VECTORS}{HEADER}")]
        }
        "klask_interfaces/State" => ["UInt64", "UInt8"]
            .map(|status| {
                format!("{STATE}std_msgs/{status} status\n{OBJECT_STATE}{VECTORS}{HEADER}")
            })
            .to_vec(),
        "odrive_can/ControllerStatus" => vec![CONTROLLER_STATUS.to_owned()],
        "odrive_can/ODriveStatus" => vec![
            ODRIVE_STATUS.to_owned(),
            format!("std_msgs/Header header\nuint32 node_id\n{ODRIVE_STATUS}{HEADER}"),
        ],
        "odrive_can/ControlMessage" => vec![CONTROL_MESSAGE.to_owned()],
        "std_msgs/Float32MultiArray" => vec![FLOAT_ARRAY.to_owned()],
        "can_msgs/Frame" => vec![format!("{CAN_FRAME}{HEADER}")],
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAMES: [&str; 8] = [
        "geometry_msgs/msg/Twist",
        "geometry_msgs/msg/TwistStamped",
        "klask_interfaces/msg/State",
        "odrive_can/msg/ControllerStatus",
        "odrive_can/msg/ODriveStatus",
        "odrive_can/msg/ControlMessage",
        "std_msgs/msg/Float32MultiArray",
        "can_msgs/msg/Frame",
    ];

    #[test]
    fn every_known_definition_parses() {
        for name in NAMES {
            assert!(Decoder::of_known_type(name).is_some(), "{name}");
        }
        assert!(Decoder::of_known_type("sensor_msgs/msg/Image").is_none());
    }

    /// Sizes with an empty `frame_id`, header included.
    #[test]
    fn sizes_are_those_of_recorded_bags() {
        for (name, size) in [
            ("geometry_msgs/msg/Twist", 52),
            ("odrive_can/msg/ControlMessage", 24),
            ("odrive_can/msg/ControllerStatus", 35),
            ("odrive_can/msg/ODriveStatus", 28),
        ] {
            let mut bytes = vec![0; size];
            bytes[1] = 1;
            let decoder = Decoder::of_known_type(name).unwrap();
            assert!(decoder.read(&bytes).is_ok(), "{name}");
            assert!(decoder.read(&bytes[..size - 1]).is_err(), "{name}");
        }
        for size in [213, 216, 220] {
            let mut bytes = vec![0; size];
            bytes[1] = 1;
            bytes[12] = 1; // length of the empty frame_id with its NUL
            assert!(
                Decoder::of_known_type("klask_interfaces/msg/State").unwrap().read(&bytes).is_ok()
            );
        }
    }
}
