//! The robot file, `robot.json`: which drives turn which motors, where the carriages may go and how
//! fast, and when to stop. Every entry has the value of the KlaskTron table as its default, so a
//! file holds only what differs.

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
    /// Which drive turns which motor; source: the upstream motor launch file.
    pub drives: Vec<MotorSeat>,
    /// Where the carriages may be, before clearance. Source: upstream `player_params.yaml`, newer.
    pub field: PerPlayer<Rectangle>,
    /// Kept free at every edge of the field (m); 13.5 mm, 1.8 striker radii, upstream.
    pub clearance_m: f64,
    /// Where runs start and end (m), board frame; home of upstream's identification nodes.
    pub home: PerPlayer<Point>,
    /// Speeds, accelerations, temperatures.
    pub limits: Limits,
    /// How long silence is tolerated.
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

/// One value for each player.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerPlayer<T> {
    /// Of the player who owns y < 0.
    pub left: T,
    /// Of the player who owns y > 0.
    pub right: T,
}

impl<T> PerPlayer<T> {
    /// The value of `player`.
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
    /// Across (m).
    pub x_m: f64,
    /// From goal to goal (m).
    pub y_m: f64,
}

/// How long silence is tolerated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Timeouts {
    /// Without a heartbeat of a drive (s); three periods of 100 ms.
    pub heartbeat_s: f64,
    /// Without a position of a drive while it is armed (s); ten periods of 10 ms.
    pub encoder_s: f64,
    /// For a drive to enter closed loop after it was asked to (s).
    pub arming_s: f64,
    /// Without the camera while it is needed (s).
    pub camera_s: f64,
    /// Longest acceptable watchdog of a drive (s): the motion after this program dies.
    pub watchdog_s: f64,
}

impl Default for Timeouts {
    fn default() -> Self {
        Self { heartbeat_s: 0.3, encoder_s: 0.1, arming_s: 2.0, camera_s: 0.5, watchdog_s: 0.5 }
    }
}

/// Bit rate and cyclic messages as the drives are configured.
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
    /// Time that a frame takes on the bus (s): a standard one with eight data bytes and the gap after it,
    /// 111 bits without stuffing.
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
    /// Frames per second of one drive.
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
        let field =
            |y_min_m, y_max_m| Rectangle { x_min_m: -0.155, x_max_m: 0.145, y_min_m, y_max_m };
        Self {
            name: "klasktron".to_owned(),
            board: BoardEntry { short_side_m: size.short_side, long_side_m: size.long_side },
            belt_metres_per_turn: BELT_METRES_PER_TURN,
            drives: KLASKTRON_SEATS.to_vec(),
            field: PerPlayer { left: field(-0.21, -0.01), right: field(0.01, 0.21) },
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

/// What is wrong with a robot file.
#[derive(Debug, thiserror::Error)]
pub enum RobotError {
    /// It is no JSON of this form.
    #[error("the robot file is not understood: {0}")]
    Syntax(#[from] serde_json::Error),
    /// The belt.
    #[error(transparent)]
    Belt(#[from] BeltError),
    /// The board.
    #[error(transparent)]
    Board(#[from] BoardSizeError),
    /// A number out of its range.
    #[error("{name} is {value}; it must lie in {range}")]
    OutOfRange {
        /// Which.
        name: String,
        /// What was given.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// Two drives with one node id, or two for one motor.
    #[error(
        "{0}; the KlaskTron table has nodes 0, 1 (right player) and 2, 3 (left), motors a and b each"
    )]
    Seats(String),
    /// The home point lies outside the field.
    #[error("the home point of the {0} player lies outside its field less the clearance")]
    Home(Player),
}

impl Robot {
    /// Reads and checks a robot file.
    ///
    /// # Errors
    /// When it is not understood, or a value cannot be.
    pub fn from_json(text: &str) -> Result<Self, RobotError> {
        let robot: Self = serde_json::from_str(text)?;
        robot.check()?;
        Ok(robot)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// At the first value that cannot be.
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
            self.field.of(player).check(player)?;
            let home = self.home.of(player);
            if !self.window(player).contains([home.x_m, home.y_m]) {
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

    /// The kinematics of its gantries.
    ///
    /// # Errors
    /// When the belt cannot be.
    pub fn kinematics(&self) -> Result<CoreXy, BeltError> {
        CoreXy::new(self.belt_metres_per_turn)
    }

    /// Players that have a drive, left first.
    #[must_use]
    pub fn players(&self) -> Vec<Player> {
        let has = |player: &Player| self.drives.iter().any(|seat| seat.player == *player);
        Player::BOTH.into_iter().filter(has).collect()
    }

    /// The drive of one motor.
    #[must_use]
    pub fn seat(&self, player: Player, motor: Motor) -> Option<MotorSeat> {
        self.drives.iter().copied().find(|seat| seat.player == player && seat.motor == motor)
    }

    /// The seat with this node id.
    #[must_use]
    pub fn seat_of_node(&self, node: u8) -> Option<MotorSeat> {
        self.drives.iter().copied().find(|seat| seat.node == node)
    }

    /// Where a carriage that leaves its window is stopped: the field less half the clearance.
    #[must_use]
    pub fn stop_window(&self, player: Player) -> Rectangle {
        self.field.of(player).shrunk(self.clearance_m / 2.0)
    }

    /// Where the centre of a player's carriage may be: the field less the clearance.
    #[must_use]
    pub fn window(&self, player: Player) -> Rectangle {
        self.field.of(player).shrunk(self.clearance_m)
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
