//! Robot file, `robot.json`: drives and their motors, workspace, limits and time-outs. Every entry
//! has the value of the KlaskTron table as its default, so a file has only the differences.

use super::{
    kinematics::{BELT_METRES_PER_TURN, BeltError, CoreXy, KLASKTRON_SEATS, MotorSeat},
    limits::{Limits, Rectangle},
};
use crate::{
    board::{BoardSize, BoardSizeError},
    can::BROADCAST_NODE,
    recording::topic::{Motor, Player},
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// A robot: drives, geometry, limits and time-outs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Robot {
    /// Name in the metadata of recordings.
    pub name: String,
    /// Size of the playing field.
    pub board: BoardEntry,
    /// Belt per motor turn (m).
    pub belt_metres_per_turn: f64,
    /// Assignment of drives to motors; source: the upstream motor launch file.
    pub drives: Vec<MotorSeat>,
    /// Workspace of each carriage, before clearance. Source: upstream `player_params.yaml`, newer.
    #[serde(alias = "field")]
    pub workspace: PerPlayer<Rectangle>,
    /// Clearance at every edge of the workspace (m); 13.5 mm, 1.8 striker radii, upstream.
    pub clearance_m: f64,
    /// Start and end point of runs (m), board frame; home of upstream's identification nodes.
    pub home: PerPlayer<Point>,
    /// Limits of speed, acceleration and temperature.
    pub limits: Limits,
    /// Time-outs.
    pub timeouts: Timeouts,
    /// Bit rate and cyclic messages of the bus.
    pub can: BusConfig,
}

/// Size of the board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoardEntry {
    /// Short side (m).
    pub short_side_m: f64,
    /// Long side (m).
    pub long_side_m: f64,
}

/// Pair of values, one for each player.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerPlayer<T> {
    /// Value of the player who owns y < 0.
    pub left: T,
    /// Value of the player who owns y > 0.
    pub right: T,
}

impl<T> PerPlayer<T> {
    /// Return the value of `player`.
    pub fn of(&self, player: Player) -> &T {
        match player {
            Player::Left => &self.left,
            Player::Right => &self.right,
        }
    }
}

/// A point on the board.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Point {
    /// Position across the board (m).
    pub x_m: f64,
    /// Position from goal to goal (m).
    pub y_m: f64,
}

/// Time-outs of the session.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Timeouts {
    /// Longest time without a heartbeat of a drive (s); three periods of 100 ms.
    pub heartbeat_s: f64,
    /// Longest time without a position of an armed drive (s); ten periods of 10 ms.
    pub encoder_s: f64,
    /// Longest time from the request of closed loop to its confirmation (s).
    pub arming_s: f64,
    /// Longest time without a required camera frame (s).
    pub camera_s: f64,
    /// Longest acceptable watchdog of a drive (s), which limits the motion after this program dies.
    pub watchdog_s: f64,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self { heartbeat_s: 0.3, encoder_s: 0.1, arming_s: 2.0, camera_s: 0.5, watchdog_s: 0.5 }
    }
}

/// Bit rate and cyclic messages in the configuration of the drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BusConfig {
    /// Nominal bit rate (bit/s); 250 kbit/s on the KlaskTron table.
    pub bitrate: u32,
    /// Period of each cyclic message of every drive (ms); 0 is off.
    pub cyclic_ms: CyclicPeriods,
}

impl Default for BusConfig {
    fn default() -> Self {
        Self { bitrate: 250_000, cyclic_ms: CyclicPeriods::default() }
    }
}

impl BusConfig {
    /// Return the duration of a frame on the bus (s): a standard frame with eight data bytes and
    /// the interframe space, 111 bits without stuffing.
    #[must_use]
    pub fn frame_seconds(&self) -> f64 {
        111.0 / f64::from(self.bitrate)
    }
}

/// Periods (ms) of the cyclic messages, with ODrive's defaults; 0 is off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[expect(missing_docs, reason = "named after the settings of the drive")]
pub struct CyclicPeriods {
    pub heartbeat: u32,
    pub encoder: u32,
    pub iq: u32,
    pub error: u32,
    pub temperature: u32,
    pub bus_voltage: u32,
    pub torques: u32,
    pub powers: u32,
}

impl Default for CyclicPeriods {
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

impl CyclicPeriods {
    /// Return the frames per second of one drive.
    #[must_use]
    pub fn frames_per_second(self) -> f64 {
        [
            self.heartbeat,
            self.encoder,
            self.iq,
            self.error,
            self.temperature,
            self.bus_voltage,
            self.torques,
            self.powers,
        ]
        .into_iter()
        .filter(|period| 0 < *period)
        .map(|period| 1000.0 / f64::from(period))
        .sum()
    }
}

impl Default for Robot {
    fn default() -> Self {
        let size = BoardSize::default();
        let rectangle =
            |y_min_m, y_max_m| Rectangle { x_min_m: -0.155, x_max_m: 0.145, y_min_m, y_max_m };
        Self {
            name: "klasktron".to_owned(),
            board: BoardEntry { short_side_m: size.short_side, long_side_m: size.long_side },
            belt_metres_per_turn: BELT_METRES_PER_TURN,
            drives: KLASKTRON_SEATS.to_vec(),
            workspace: PerPlayer { left: rectangle(-0.21, -0.01), right: rectangle(0.01, 0.21) },
            clearance_m: 0.0135,
            home: PerPlayer {
                left: Point { x_m: 0.0, y_m: -0.10 },
                right: Point { x_m: 0.0, y_m: 0.10 },
            },
            limits: Limits::default(),
            timeouts: Timeouts::default(),
            can: BusConfig::default(),
        }
    }
}

/// Error of a robot file.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// Invalid JSON.
    #[error("the robot file is not valid: {0}")]
    Syntax(#[from] serde_json::Error),
    /// Invalid belt.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// Invalid board.
    #[error(transparent)]
    Board(#[from] BoardSizeError),
    /// Number out of range.
    #[error("{name} is {value}; it must lie in {range}")]
    OutOfRange {
        /// Name of the number.
        name: String,
        /// Value given.
        value: f64,
        /// Allowed range.
        range: &'static str,
    },
    /// Two drives with one node id, or two for one motor.
    #[error(
        "{0}; the KlaskTron table has nodes 0, 1 (right player) and 2, 3 (left), motors a and b each"
    )]
    Seats(String),
    /// Home point outside the workspace.
    #[error("the home point of the {0} player lies outside its workspace less the clearance")]
    Home(Player),
}

impl Robot {
    /// Read and check a robot file.
    ///
    /// # Errors
    /// When the JSON is invalid, or a value is out of range.
    pub fn from_json(text: &str) -> Result<Self, RobotError> {
        let robot: Self = serde_json::from_str(text)?;
        robot.check()?;
        Ok(robot)
    }

    /// Check every value.
    ///
    /// # Errors
    /// At the first value out of range.
    pub fn check(&self) -> Result<(), RobotError> {
        self.kinematics()?;
        BoardSize::new(self.board.short_side_m, self.board.long_side_m)?;
        self.check_seats()?;
        self.limits.check()?;
        let seconds = "(0, 60] s";
        let timeouts = &self.timeouts;
        for (name, value) in [
            ("timeouts.heartbeat_s", timeouts.heartbeat_s),
            ("timeouts.encoder_s", timeouts.encoder_s),
            ("timeouts.arming_s", timeouts.arming_s),
            ("timeouts.camera_s", timeouts.camera_s),
            ("timeouts.watchdog_s", timeouts.watchdog_s),
        ] {
            check_range(name, value, seconds, |v| 0.0 < v && v <= 60.0)?;
        }
        check_range("clearance_m", self.clearance_m, "[0, 0.1] m", |v| (0.0..=0.1).contains(&v))?;
        let bitrate = f64::from(self.can.bitrate);
        check_range("can.bitrate", bitrate, "[10000, 1000000] bit/s", |v| {
            (10_000.0..=1_000_000.0).contains(&v)
        })?;
        for player in self.players() {
            self.workspace.of(player).check(player)?;
            let home = self.home.of(player);
            if !self.soft_limits(player).contains([home.x_m, home.y_m]) {
                return Err(RobotError::Home(player));
            }
        }
        Ok(())
    }

    fn check_seats(&self) -> Result<(), RobotError> {
        let mut nodes = BTreeSet::new();
        let mut motors = BTreeSet::new();
        for seat in &self.drives {
            if BROADCAST_NODE <= seat.node || !nodes.insert(seat.node) {
                return Err(RobotError::Seats(format!(
                    "node {} is given twice, or is not in 0 to 62",
                    seat.node
                )));
            }
            if seat.sign.abs() != 1 || !motors.insert((seat.player, seat.motor)) {
                return Err(RobotError::Seats(format!(
                    "motor {} of the {} player has two drives, or a sign that is not 1 or -1",
                    seat.motor.name(),
                    seat.player
                )));
            }
        }
        match self
            .players()
            .iter()
            .find(|p| Motor::BOTH.iter().any(|m| self.seat(**p, *m).is_none()))
        {
            Some(player) => {
                Err(RobotError::Seats(format!("the {player} player lacks the drive of a motor")))
            }
            None if self.drives.is_empty() => {
                Err(RobotError::Seats("no drive is listed".to_owned()))
            }
            None => Ok(()),
        }
    }

    /// Return the kinematics of the gantries.
    ///
    /// # Errors
    /// When the belt is out of range.
    pub fn kinematics(&self) -> Result<CoreXy, BeltError> {
        CoreXy::new(self.belt_metres_per_turn)
    }

    /// Return the players that have a drive, left first.
    #[must_use]
    pub fn players(&self) -> Vec<Player> {
        let has = |player: &Player| self.drives.iter().any(|seat| seat.player == *player);
        Player::BOTH.into_iter().filter(has).collect()
    }

    /// Return the drive of one motor.
    #[must_use]
    pub fn seat(&self, player: Player, motor: Motor) -> Option<MotorSeat> {
        self.drives.iter().copied().find(|seat| seat.player == player && seat.motor == motor)
    }

    /// Return the seat with this node id.
    #[must_use]
    pub fn seat_of_node(&self, node: u8) -> Option<MotorSeat> {
        self.drives.iter().copied().find(|seat| seat.node == node)
    }

    /// Return the stop limits: a carriage that leaves them is stopped. They are the workspace less
    /// half the clearance.
    #[must_use]
    pub fn stop_limits(&self, player: Player) -> Rectangle {
        self.workspace.of(player).shrunk(self.clearance_m / 2.0)
    }

    /// Return the soft limits for the centre of a player's carriage: the workspace less the
    /// clearance.
    #[must_use]
    pub fn soft_limits(&self, player: Player) -> Rectangle {
        self.workspace.of(player).shrunk(self.clearance_m)
    }
}

pub(super) fn check_range(
    name: &str,
    value: f64,
    range: &'static str,
    holds: impl Fn(f64) -> bool,
) -> Result<(), RobotError> {
    if holds(value) {
        return Ok(());
    }
    Err(RobotError::OutOfRange { name: name.to_owned(), value, range })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_the_klasktron_table_and_survives_json() {
        let robot = Robot::default();
        robot.check().unwrap();
        let text = serde_json::to_string(&robot).unwrap();
        assert_eq!(Robot::from_json(&text).unwrap(), robot);
        assert_eq!(Robot::from_json("{}").unwrap(), robot);
        // 10 heartbeats and 100 positions a second.
        assert!((robot.can.cyclic_ms.frames_per_second() - 110.0).abs() < 1e-9);
    }

    #[test]
    fn wrong_files_are_refused_with_the_value() {
        let said = |text: &str| Robot::from_json(text).unwrap_err().to_string();
        assert!(said("{\"bellt\": 1}").contains("bellt"));
        assert!(said("{\"belt_metres_per_turn\": 0}").contains("0 m per motor turn"));
        assert!(
            said("{\"timeouts\": {\"heartbeat_s\": -1}}").contains("timeouts.heartbeat_s is -1")
        );
        assert!(said("{\"clearance_m\": 0.2}").contains("[0, 0.1] m"));
        let twice = "{\"drives\": [{\"node\":0,\"player\":\"left\",\"motor\":\"a\",\"sign\":1},\
                     {\"node\":0,\"player\":\"left\",\"motor\":\"b\",\"sign\":1}]}";
        assert!(said(twice).contains("node 0 is given twice"));
        let alone = "{\"drives\": [{\"node\":0,\"player\":\"left\",\"motor\":\"a\",\"sign\":1}]}";
        assert!(said(alone).contains("the left player lacks"));
        let home =
            "{\"home\": {\"left\": {\"x_m\":0,\"y_m\":0.1}, \"right\": {\"x_m\":0,\"y_m\":0.1}}}";
        assert!(said(home).contains("left player"));
    }
}
