//! Configuration of simulated faults.

use super::{ConfigError, Seat, ranged::within};
use crate::recording::topic::Player;
use serde::{Deserialize, Serialize, de::Error as _};
use serde_json::{Map, Value};

/// Start of a fault.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaultStart {
    /// Time after the rig's start (s).
    AtSeconds(f64),
    /// Time after a drive first enters closed loop (s).
    AfterArmingSeconds(f64),
}

/// Kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
#[expect(missing_docs, reason = "fields carry their unit in the name; node is a node id")]
pub enum FaultKind {
    /// The drive stops sending heartbeats.
    HeartbeatStops { node: u8 },
    /// The drive disarms with these error flags.
    AxisFault { node: u8, errors: u32 },
    /// The drive stops sending positions.
    EncoderStops { node: u8 },
    /// The power stage reaches this temperature.
    Overheat { node: u8, fet_celsius: f64 },
    /// Frames are lost between bus and program, in both directions, each with this probability.
    FramesDropped { probability: f64 },
    /// Frames reach the program with an additional delay.
    FramesDelayed {
        #[serde(alias = "seconds")]
        delay_s: f64,
    },
    /// The drive neither sends nor receives; it continues with its last command.
    DriveSilent { node: u8 },
    /// The program's controller leaves the bus.
    BusOff,
    /// The program's CAN interface goes down.
    LinkDown,
    /// The magnet no longer pulls the striker.
    PegLost { player: Player },
    /// The camera sends no frames.
    CameraStops,
    /// The camera moves by this much parallel to the board.
    CameraShifts { x_m: f64, y_m: f64 },
    /// Another controller on the bus commands a velocity.
    ForeignCommand {
        node: u8,
        #[serde(alias = "velocity")]
        velocity_turns_per_s: f64,
    },
    /// The carriage is jammed.
    Stuck { player: Player },
}

/// A fault with its time. In JSON: `{"at_s": 2.0, "kind": "heartbeat_stops", "node": 1}`, with
/// `after_arming_s` instead of `at_s` when the time counts from the first arming, and `for_s` for a
/// limited duration.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Fields", into = "Fields")]
pub struct FaultPlan {
    /// Start of the fault.
    pub start: FaultStart,
    /// Duration (s); unlimited if absent. An axis fault and a foreign command are instantaneous.
    pub for_s: Option<f64>,
    /// Kind of the fault.
    pub kind: FaultKind,
}

/// JSON fields of a fault.
type Fields = Map<String, Value>;

/// Remove the number called `name` from `fields`.
fn take_number(fields: &mut Fields, name: &str) -> Result<Option<f64>, serde_json::Error> {
    fields.remove(name).map(serde_json::from_value).transpose()
}

impl TryFrom<Fields> for FaultPlan {
    type Error = serde_json::Error;

    fn try_from(mut fields: Fields) -> Result<Self, serde_json::Error> {
        let at = take_number(&mut fields, "at_s")?;
        let after_arming = take_number(&mut fields, "after_arming_s")?;
        let start = match (at, after_arming) {
            (Some(at), None) => FaultStart::AtSeconds(at),
            (None, Some(after)) => FaultStart::AfterArmingSeconds(after),
            _ => return Err(Self::Error::custom("a fault needs either at_s or after_arming_s")),
        };
        let for_s = take_number(&mut fields, "for_s")?;
        let kind = serde_json::from_value(Value::Object(fields))?;
        Ok(Self { start, for_s, kind })
    }
}

impl From<FaultPlan> for Fields {
    fn from(plan: FaultPlan) -> Self {
        let mut fields = match serde_json::to_value(plan.kind) {
            Ok(Value::Object(fields)) => fields,
            _ => Self::new(),
        };
        let (name, seconds) = match plan.start {
            FaultStart::AtSeconds(at) => ("at_s", at),
            FaultStart::AfterArmingSeconds(after) => ("after_arming_s", after),
        };
        fields.insert(name.to_owned(), seconds.into());
        if let Some(for_s) = plan.for_s {
            fields.insert("for_s".to_owned(), for_s.into());
        }
        fields
    }
}

impl FaultKind {
    /// Node of the fault, if it has one.
    #[must_use]
    pub fn node(self) -> Option<u8> {
        match self {
            Self::HeartbeatStops { node }
            | Self::AxisFault { node, .. }
            | Self::EncoderStops { node }
            | Self::Overheat { node, .. }
            | Self::DriveSilent { node }
            | Self::ForeignCommand { node, .. } => Some(node),
            _ => None,
        }
    }
}

impl FaultPlan {
    pub(super) fn check(&self, path: &str, seats: &[Seat]) -> Result<(), ConfigError> {
        let (FaultStart::AtSeconds(start) | FaultStart::AfterArmingSeconds(start)) = self.start;
        within(&format!("{path}at_s or after_arming_s"), start, 0.0, 1e6)?;
        within(&format!("{path}for_s"), self.for_s.unwrap_or(0.0), 0.0, 1e6)?;
        if let Some(node) = self.kind.node()
            && !seats.iter().any(|seat| seat.node == node)
        {
            return Err(ConfigError::NoSuchNode { path: path.to_owned(), node });
        }
        match self.kind {
            FaultKind::Overheat { fet_celsius, .. } => {
                within(&format!("{path}fet_celsius"), fet_celsius, -40.0, 300.0)
            }
            FaultKind::FramesDropped { probability } => {
                within(&format!("{path}probability"), probability, 0.0, 1.0)
            }
            FaultKind::FramesDelayed { delay_s } => {
                within(&format!("{path}delay_s"), delay_s, 0.0, 60.0)
            }
            FaultKind::CameraShifts { x_m, y_m } => {
                within(&format!("{path}x_m"), x_m, -0.1, 0.1)?;
                within(&format!("{path}y_m"), y_m, -0.1, 0.1)
            }
            FaultKind::ForeignCommand { velocity_turns_per_s, .. } => {
                within(&format!("{path}velocity_turns_per_s"), velocity_turns_per_s, -1e3, 1e3)
            }
            _ => Ok(()),
        }
    }
}
