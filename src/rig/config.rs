//! Configuration of the virtual rig: all parameters of physics, drives, bus and camera.
//!
//! Every field has a default and a range; a file contains only the changed fields, and an unknown
//! name is an error. The defaults reproduce the measurements of the KlaskTron paper (RSS 2026). Its mean
//! acceleration is 6.25 m/s^2; a stop from 0.5 m/s takes 77 ms and 2 cm, a reversal 111 ms. The
//! striker lags its magnet by about 4 mm. Masses, friction and belts are not in the paper; they are
//! engineering estimates.

mod ball;
mod camera;
mod drive;
mod fault;
mod gantry;
mod ranged;

pub use ball::{BallConfig, CupConfig, Launch, PatchConfig, WallShift};
pub use camera::{CameraConfig, StampMode};
pub use drive::{CyclicMs, DriveConfig, Guards, MotorFriction, Ripple, Seat, ThermalConfig};
pub use fault::{FaultKind, FaultPlan, FaultStart};
pub use gantry::{GantryConfig, GuideFriction, MagnetConfig, PegConfig};

use crate::{
    board::{BoardSize, BoardSizeError},
    can::BROADCAST_NODE,
};
use ranged::ranged;
use serde::{Deserialize, Serialize};

/// Error of a configuration.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The text is not JSON of this form.
    #[error("invalid rig configuration: {0}")]
    Syntax(#[from] serde_json::Error),
    /// Error of the board size.
    #[error(transparent)]
    Board(#[from] BoardSizeError),
    /// A value outside its range.
    #[error("{name} is {value}; it must lie in [{low}, {high}]")]
    OutOfRange {
        /// Path of the field, with its unit.
        name: String,
        /// Value of the field.
        value: f64,
        /// Lower limit.
        low: f64,
        /// Upper limit.
        high: f64,
    },
    /// Two drives with one node id or for one motor.
    #[error("drives[{idx}] {conflict}; every drive needs a node id and a motor of its own")]
    Seat {
        /// Index in the list.
        idx: usize,
        /// Description of the conflict.
        conflict: &'static str,
    },
    /// A fault of a drive that does not exist.
    #[error("{path}node is {node}, but no entry of drives has this node")]
    NoSuchNode {
        /// Path of the fault.
        path: String,
        /// Node id of the fault.
        node: u8,
    },
    /// The step is too long for the stiffest spring of the configuration.
    #[error(
        "step_s is {step_s}; the stiffest spring ({spring}) needs at most {longest_s:.2e} s to stay \
         stable"
    )]
    Unstable {
        /// Step (s).
        step_s: f64,
        /// Name of the spring.
        spring: &'static str,
        /// Longest stable step (s).
        longest_s: f64,
    },
}

ranged! {
    /// Configuration of the virtual rig.
    RigConfig {
        /// Step of the integration and of the drives' control loop (s); the ODrive S1 runs at 8
        /// kHz.
        step_s: 0.000_125 in [1e-6, 1e-3];
        /// Belt travel per motor turn (m); 20 teeth of 2 mm.
        belt_metres_per_turn: 0.04 in [1e-3, 1.0];
        /// Fraction of the friction of motors and guides that is lost when warm.
        friction_drift_fraction: 0.0 in [0.0, 0.9];
        /// Time constant of warming up (s).
        friction_drift_time_s: 300.0 in [1.0, 1e5];
    }
    other {
        /// Seed of all random streams.
        seed: u64 = 0;
        /// Size of the playing field.
        board: BoardConfig = BoardConfig::default();
        /// The bus.
        bus: BusConfig = BusConfig::default();
        /// Supply shared by all drives.
        supply: SupplyConfig = SupplyConfig::default();
        /// Settings common to all drives.
        drive: DriveConfig = DriveConfig::default();
        /// Assignment of drives to motors, with settings of single drives.
        drives: Vec<Seat> = Seat::klasktron();
        /// The two gantries.
        gantry: PerPlayer<GantryConfig> = PerPlayer {
            left: GantryConfig::at(0.0, -0.10),
            right: GantryConfig::at(0.0, 0.10),
        };
        /// The two magnetic couplings between carriage and striker.
        magnet: PerPlayer<MagnetConfig> = PerPlayer::default();
        /// The two strikers.
        peg: PerPlayer<PegConfig> = PerPlayer::default();
        /// The ball.
        ball: BallConfig = BallConfig::default();
        /// The two goal cups.
        cups: CupConfig = CupConfig::default();
        /// The camera.
        camera: CameraConfig = CameraConfig::default();
        /// Faults with their times.
        faults: Vec<FaultPlan> = Vec::new();
    }
}

ranged! {
    /// Size of the playing field.
    BoardConfig {
        /// Short side (m).
        short_side_m: 0.32 in [0.05, 10.0];
        /// Long side (m).
        long_side_m: 0.42 in [0.05, 10.0];
    }
}

ranged! {
    /// CAN bus.
    BusConfig {
        /// Bits per frame in addition to its data: 47 nominal, so 111 with eight bytes.
        overhead_bits: 47.0 in [44.0, 80.0];
        /// Maximum random delay between the end of a frame and the host's timestamp (s).
        receive_jitter_s: 0.0 in [0.0, 0.1];
    }
    other {
        /// Nominal bit rate (bit/s).
        bitrate: u32 = 250_000;
        /// Maximum number of queued frames of the host; one more is refused, as by the kernel.
        transmit_queue: u32 = 10;
    }
}

ranged! {
    /// Power supply.
    SupplyConfig {
        /// Open-circuit voltage (V).
        open_volts: 24.0 in [0.0, 60.0];
        /// Internal resistance (ohm); the voltage falls with the total current of all drives.
        resistance_ohm: 0.05 in [0.0, 10.0];
    }
}

/// One value per player.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PerPlayer<T: Default> {
    /// Value of the player who owns y < 0.
    pub left: T,
    /// Value of the player who owns y > 0.
    pub right: T,
}

impl RigConfig {
    /// Read and check a configuration.
    ///
    /// ```
    /// use klasktron::rig::RigConfig;
    /// let config = RigConfig::from_json(r#"{"seed": 7, "camera": {"latency_s": 0.03}}"#).unwrap();
    /// assert_eq!(config.camera.latency_s, 0.03);
    /// let error = RigConfig::from_json(r#"{"camera": {"latency_s": -1}}"#).unwrap_err();
    /// assert_eq!(error.to_string(), "camera.latency_s is -1; it must lie in [0, 1]");
    /// ```
    ///
    /// # Errors
    /// When the text is not a configuration, or a value is outside its range.
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        let config: Self = serde_json::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// Check every value.
    ///
    /// # Errors
    /// The first value outside its range.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_numbers("")?;
        self.board.check_numbers("board.")?;
        BoardSize::new(self.board.short_side_m, self.board.long_side_m)?;
        self.bus.check_numbers("bus.")?;
        ranged::within("bus.bitrate", f64::from(self.bus.bitrate), 10_000.0, 1_000_000.0)?;
        ranged::within("bus.transmit_queue", f64::from(self.bus.transmit_queue), 1.0, 10_000.0)?;
        self.supply.check_numbers("supply.")?;
        self.drive.check("drive.", self.step_s)?;
        self.check_seats()?;
        self.ball.check("ball.")?;
        self.cups.check_numbers("cups.")?;
        self.camera.check_numbers("camera.")?;
        self.check_players()?;
        for (idx, fault) in self.faults.iter().enumerate() {
            fault.check(&format!("faults[{idx}]."), &self.drives)?;
        }
        Ok(())
    }

    fn check_players(&self) -> Result<(), ConfigError> {
        for (name, gantry, magnet, peg) in [
            ("left", &self.gantry.left, &self.magnet.left, &self.peg.left),
            ("right", &self.gantry.right, &self.magnet.right, &self.peg.right),
        ] {
            gantry.check(&format!("gantry.{name}."), self)?;
            magnet.check(&format!("magnet.{name}."), peg, self.step_s)?;
            peg.check_numbers(&format!("peg.{name}."))?;
        }
        Ok(())
    }

    fn check_seats(&self) -> Result<(), ConfigError> {
        ranged::within("the number of drives", self.drives.len() as f64, 1.0, 4.0)?;
        for (idx, seat) in self.drives.iter().enumerate() {
            seat.check(&format!("drives[{idx}]."), self.step_s)?;
            for earlier in &self.drives[..idx] {
                if earlier.node == seat.node {
                    return Err(ConfigError::Seat { idx, conflict: "has the node of another" });
                }
                if (earlier.player, earlier.motor) == (seat.player, seat.motor) {
                    return Err(ConfigError::Seat { idx, conflict: "turns the motor of another" });
                }
            }
            let top = f64::from(BROADCAST_NODE - 1);
            ranged::within(&format!("drives[{idx}].node"), f64::from(seat.node), 0.0, top)?;
        }
        Ok(())
    }
}
