//! Topics of the data contract and their schemas.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Player; `left` owns y < 0 and `right` y > 0 of the board frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Player {
    /// Player at y < 0.
    Left,
    /// Player at y > 0.
    Right,
}

impl Player {
    /// Both players, left first.
    pub const BOTH: [Self; 2] = [Self::Left, Self::Right];

    /// Return `left` or `right`, as in topics.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
        }
    }
}

impl fmt::Display for Player {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// Motor of a CoreXY gantry: `a` measures (x + y), `b` (x - y) per turn of belt.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motor {
    /// Motor of x + y.
    A,
    /// Motor of x - y.
    B,
}

impl Motor {
    /// Both motors.
    pub const BOTH: [Self; 2] = [Self::A, Self::B];

    /// Return `a` or `b`, as in topics.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::A => "a",
            Self::B => "b",
        }
    }
}

/// Return the topic of the commanded striker velocity (`VelocityCommand`).
#[must_use]
pub fn command(player: Player) -> String {
    format!("/striker/{player}/command")
}

/// Return the topic of the carriage under the board (`CarriageState`).
#[must_use]
pub fn carriage(player: Player) -> String {
    format!("/striker/{player}/carriage")
}

/// Return the topic of one motor's motion (`MotorState`).
#[must_use]
pub fn motor(player: Player, motor: Motor) -> String {
    format!("/motor/{player}/{}", motor.name())
}

/// Return the topic of the health of one drive (`DriveStatus`).
#[must_use]
pub fn drive(player: Player, motor: Motor) -> String {
    format!("/drive/{player}/{}", motor.name())
}

/// Raw frames on the bus (`CanFrame`).
pub const CAN_FRAMES: &str = "/can/frames";
/// Detections in each camera frame (`CameraDetections`).
pub const CAMERA_DETECTIONS: &str = "/camera/detections";
/// Processing of each camera frame (`CameraFrame`).
pub const CAMERA_FRAME: &str = "/camera/frame";
/// Recorded camera frames (`foxglove.CompressedImage`).
pub const CAMERA_IMAGE: &str = "/camera/image";
/// Scene for three-dimensional viewers (`foxglove.SceneUpdate`).
pub const SCENE: &str = "/scene";
/// Filtered state of the board (`BoardState`).
pub const BOARD_STATE: &str = "/board/state";
/// True state of the board from a simulator (`BoardState`).
pub const TRUE_BOARD_STATE: &str = "/truth/board/state";
/// Start and end of each scripted run (`RunMarker`).
pub const RUN_MARKER: &str = "/run/marker";
/// Events seen by the referee (`MatchEvent`).
pub const MATCH_EVENT: &str = "/match/event";

/// Periods of the control loop (`ControlTick`).
pub const CONTROL_TICK: &str = "/collect/tick";
/// Events of a collection session (`SessionEvent`).
pub const SESSION_EVENT: &str = "/collect/event";

/// Return the topic of a single axis' input (`AxisInput`).
#[must_use]
pub fn axis_input(name: &str) -> String {
    format!("/axis/{name}/input")
}

/// Return the topic of a single axis' measured motion (`AxisOutput`).
#[must_use]
pub fn axis_output(name: &str) -> String {
    format!("/axis/{name}/output")
}

/// Return the full name of the contract's schema of `topic`; `None` for an unknown topic, which is
/// copied unchanged. `/truth/...` mirrors the topic behind it.
///
/// ```
/// use klasktron::recording::topic::schema_of;
/// assert_eq!(schema_of("/striker/left/command"), Some("klasktron.VelocityCommand"));
/// assert_eq!(schema_of("/truth/board/state"), Some("klasktron.BoardState"));
/// assert_eq!(schema_of("/axis/slide/input"), Some("klasktron.AxisInput"));
/// assert_eq!(schema_of("/cmd_vel/left_player"), None);
/// ```
#[must_use]
pub fn schema_of(topic: &str) -> Option<&'static str> {
    let parts: Vec<&str> = topic.strip_prefix('/')?.split('/').collect();
    match parts.as_slice() {
        ["truth", rest @ ..] if !rest.is_empty() => schema_of(&format!("/{}", rest.join("/"))),
        ["striker", "left" | "right", "command"] => Some("klasktron.VelocityCommand"),
        ["striker", "left" | "right", "carriage"] => Some("klasktron.CarriageState"),
        ["motor", "left" | "right", "a" | "b"] => Some("klasktron.MotorState"),
        ["drive", "left" | "right", "a" | "b"] => Some("klasktron.DriveStatus"),
        ["can", "frames"] => Some("klasktron.CanFrame"),
        ["camera", "detections"] => Some("klasktron.CameraDetections"),
        ["camera", "frame"] => Some("klasktron.CameraFrame"),
        ["board", "state"] => Some("klasktron.BoardState"),
        ["run", "marker"] => Some("klasktron.RunMarker"),
        ["match", "event"] => Some("klasktron.MatchEvent"),
        ["collect", "tick"] => Some("klasktron.ControlTick"),
        ["collect", "event"] => Some("klasktron.SessionEvent"),
        ["axis", name, "input"] if !name.is_empty() => Some("klasktron.AxisInput"),
        ["axis", name, "output"] if !name.is_empty() => Some("klasktron.AxisOutput"),
        _ => None,
    }
}
