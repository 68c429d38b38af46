//! Configuration of the virtual rig: every number of its physics, its drives, its bus, its camera.
//!
//! Every field has a default and a range; a file holds only what differs, and a mistyped name is an
//! error. The defaults are chosen so that the rig reproduces what the KlaskTron paper (RSS 2026)
//! measured: mean acceleration 6.25 m/s^2, a stop from 0.5 m/s within 77 ms and 2 cm, a reversal in
//! 111 ms, a striker that lags its magnet by about 4 mm. What the paper does not give (masses,
//! friction, belts) is an engineering estimate.

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

/// Why a configuration is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// It is no JSON of this form.
    #[error("the rig's configuration is not understood: {0}")]
    Syntax(#[from] serde_json::Error),
    /// The board.
    #[error(transparent)]
    Board(#[from] BoardSizeError),
    /// A number out of its range.
    #[error("{name} is {value}; it must lie in [{low}, {high}]")]
    OutOfRange {
        /// Path of the field; its unit is in the name.
        name: String,
        /// What was given.
        value: f64,
        /// Least allowed.
        low: f64,
        /// Most allowed.
        high: f64,
    },
    /// Two drives with one node id, or two for one motor.
    #[error("drives[{idx}] {conflict}; every drive needs a node id and a motor of its own")]
    Seat {
        /// Position in the list.
        idx: usize,
        /// What it collides with.
        conflict: &'static str,
    },
    /// A fault of a drive that there is not.
    #[error("{path}node is {node}, but no entry of drives has this node")]
    NoSuchNode {
        /// Where.
        path: String,
        /// The node.
        node: u8,
    },
    /// The step is too long for the springs of the configuration.
    #[error(
        "step_s is {step_s}; the stiffest spring ({spring}) needs at most {longest_s:.2e} s to stay \
         stable"
    )]
    Unstable {
        /// The step (s).
        step_s: f64,
        /// Which spring.
        spring: &'static str,
        /// Longest stable step (s).
        longest_s: f64,
    },
}

ranged! {
    /// Everything about the rig.
    RigConfig {
        /// Step of the integration and of the drives' control loop (s); the S1's loop runs at 8 kHz.
        step_s: 0.000_125 in [1e-6, 1e-3];
        /// Belt per motor turn (m); 20 teeth of 2 mm.
        belt_metres_per_turn: 0.04 in [1e-3, 1.0];
        /// Friction lost once everything is warm (share of every motor's and rail's friction).
        friction_drift_fraction: 0.0 in [0.0, 0.9];
        /// Time constant of that warming (s).
        friction_drift_time_s: 300.0 in [1.0, 1e5];
    }
    other {
        /// Seed of every random stream.
        seed: u64 = 0;
        /// Size of the playing field.
        board: BoardConfig = BoardConfig::default();
        /// The bus.
        bus: BusConfig = BusConfig::default();
        /// The supply that all drives share.
        supply: SupplyConfig = SupplyConfig::default();
        /// What all drives have in common.
        drive: DriveConfig = DriveConfig::default();
        /// Which drive turns which motor, and what is its own.
        drives: Vec<Seat> = Seat::klasktron();
        /// The two gantries.
        gantry: PerPlayer<GantryConfig> = PerPlayer {
            left: GantryConfig::at(0.0, -0.10),
            right: GantryConfig::at(0.0, 0.10),
        };
        /// The two couplings between carriage and striker.
        magnet: PerPlayer<MagnetConfig> = PerPlayer::default();
        /// The two strikers.
        peg: PerPlayer<PegConfig> = PerPlayer::default();
        /// The ball.
        ball: BallConfig = BallConfig::default();
        /// The two goal cups.
        cups: CupConfig = CupConfig::default();
        /// The camera.
        camera: CameraConfig = CameraConfig::default();
        /// What goes wrong, and when.
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
    /// The bus.
    BusConfig {
        /// Bits per frame beside its data: 47 nominal, so 111 with eight bytes.
        overhead_bits: 47.0 in [44.0, 80.0];
        /// Largest random delay between the end of a frame and the host's time of it (s).
        receive_jitter_s: 0.0 in [0.0, 0.1];
    }
    other {
        /// Nominal bit rate (bit/s).
        bitrate: u32 = 250_000;
        /// Frames of the host that wait at most; one more is refused as the kernel does.
        transmit_queue: u32 = 10;
    }
}

ranged! {
    /// The supply.
    SupplyConfig {
        /// Without load (V).
        open_volts: 24.0 in [0.0, 60.0];
        /// Inner resistance (ohm); the voltage falls with the current of all drives together.
        resistance_ohm: 0.05 in [0.0, 10.0];
    }
}

/// One value for each player.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PerPlayer<T: Default> {
    /// Of the player who owns y < 0.
    pub left: T,
    /// Of the player who owns y > 0.
    pub right: T,
}

impl RigConfig {
    /// Reads and checks a configuration.
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
    /// When it is not understood, or a value cannot be.
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        let config: Self = serde_json::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// Checks every value.
    ///
    /// # Errors
    /// At the first value that cannot be.
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
