//! Checks before arming: the nodes on the bus, their message rates and firmware, and all reasons
//! not to arm. Only version requests are sent. All problems are collected in one pass and reported
//! together, each with its remedy.
//! together, each with its way out.

use super::{
    reason::{Named, StopReason},
    station::Station,
};
use crate::{
    can::{AxisState, BROADCAST_NODE, Command, Message},
    gantry::{BusConfig, MotorSeat},
};
use serde::Serialize;
use std::fmt;

/// Duration of listening to the bus (s); twelve heartbeats.
pub(super) const LISTEN_SECONDS: f64 = 1.2;
/// Number of version requests, and the wait for each answer (s). A drive that never answers takes
/// one second in total; otherwise the wait ends with the answers.
const VERSION_ATTEMPTS: usize = 10;
const VERSION_SECONDS: f64 = 0.1;
/// Bits of a standard frame with eight data bytes, the interframe space and the most stuff bits
/// possible.
const WORST_FRAME_BITS: f64 = 135.0;
/// Largest bus load at which motors are driven, as a fraction.
pub const MOST_BUS_LOAD: f64 = 0.75;
/// Firmware supported by the codec: 0.6.x.
const FIRMWARE: [u8; 2] = [0, 6];
/// Index of major, minor and revision of the firmware in the version message.
const FIRMWARE_AT: usize = 4;

/// Rate of one message of one node.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MessageRate {
    /// Node id.
    pub node: u8,
    /// Name of the message in ODrive's spelling.
    pub message: &'static str,
    /// Rate (Hz).
    pub rate_hz: f64,
}

/// Firmware of one drive.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct NodeFirmware {
    /// Node id.
    pub node: u8,
    /// Version as `major.minor.revision`.
    pub version: String,
}

/// State of the bus before arming.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct BusState {
    /// Rates of the messages by node.
    pub rates: Vec<MessageRate>,
    /// Firmware of each drive.
    pub firmware: Vec<NodeFirmware>,
    /// Bus load while driving as a fraction, without stuff bits.
    pub bus_load: f64,
    /// Bus load with the most stuff bits possible, as a fraction.
    pub worst_case_bus_load: f64,
}

/// Problem that prevents arming.
#[derive(Debug, Clone, PartialEq)]
pub enum Problem {
    /// A drive of the robot file was not heard.
    Silent {
        /// Drive.
        seat: MotorSeat,
        /// Other nodes heard, which are not in the robot file.
        others: Vec<u8>,
    },
    /// A required message was not heard.
    Missing {
        /// Drive.
        seat: MotorSeat,
        /// Setting of the drive.
        setting: &'static str,
        /// Required value of the setting (ms).
        period_ms: u32,
    },
    /// The version request was not answered.
    NoVersion {
        /// Drive.
        seat: MotorSeat,
    },
    /// The firmware is not supported.
    Firmware {
        /// Drive.
        seat: MotorSeat,
        /// Version of the firmware.
        found: String,
    },
    /// The axis is not idle.
    NotIdle {
        /// Drive.
        seat: MotorSeat,
        /// State of the axis.
        state: AxisState,
    },
    /// Another program sends commands.
    Foreign {
        /// Node that the command is for.
        node: u8,
        /// Command.
        command: Command,
    },
    /// The bus load would be too high.
    BusLoad {
        /// Bus load while driving, as a fraction.
        load: f64,
        /// Bit rate (bit/s).
        bitrate: u32,
        /// Rate of the control loop (Hz).
        rate_hz: f64,
    },
    /// A pilot requires camera frames, and none arrived.
    NoCameraFrames,
    /// The bus has failed.
    Stopped(StopReason),
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Silent { seat, others } => {
                write!(f, "{} is silent; check its supply, id and bit rate", Named(*seat))?;
                if !others.is_empty() {
                    let others: Vec<String> = others.iter().map(ToString::to_string).collect();
                    let nodes = others.join(", ");
                    write!(f, "; node {nodes} was heard but is not in the robot file")?;
                }
                Ok(())
            }
            Self::Missing { seat, setting, period_ms } => write!(
                f,
                "{} does not send a required message: set axis0.config.can.{setting} = {period_ms}",
                Named(*seat)
            ),
            Self::NoVersion { seat } => write!(
                f,
                "{} does not answer Get_Version, so it may run firmware 0.5.x, whose heartbeat \
                 has another layout; update it to 0.6",
                Named(*seat)
            ),
            Self::Firmware { seat, found } => write!(
                f,
                "{} runs firmware {found}, klasktron supports 0.6.x; update it, or \
                 accept it with --accept-firmware {found} if you know that it is compatible",
                Named(*seat)
            ),
            Self::NotIdle { seat, state } => write!(
                f,
                "{} is in state {state}, not IDLE: end the program that drives it, or idle it first",
                Named(*seat)
            ),
            Self::Foreign { node, command } => {
                write!(f, "another program sends {} to node {node}; end it first", command.name())
            }
            Self::BusLoad { load, bitrate, rate_hz } => write!(
                f,
                "the bus load would be {:.0} % at {rate_hz} Hz and {bitrate} bit/s (limit {:.0} %): \
                 lower --rate-hz or the drives' cyclic rates, or raise the bit rate (can.bitrate \
                 in the robot file)",
                1e2 * load,
                1e2 * MOST_BUS_LOAD
            ),
            Self::NoCameraFrames => write!(
                f,
                "no camera frame arrived within {LISTEN_SECONDS} s, and a player needs the camera; \
                 check --camera and the program that sends detections there"
            ),
            Self::Stopped(reason) => reason.fmt(f),
        }
    }
}

/// Return the bus load of cyclic messages and setpoints as fractions: without and with the most
/// stuff bits.
#[must_use]
pub fn bus_load(can: &BusConfig, drive_frames_per_s: f64, setpoints_per_s: f64) -> [f64; 2] {
    let frames = drive_frames_per_s + setpoints_per_s;
    [frames * can.frame_seconds(), frames * WORST_FRAME_BITS / f64::from(can.bitrate)]
}

/// Listen to the bus; return its state and the problems that prevent arming.
pub(super) fn look(
    station: &mut Station<'_>,
    rate_hz: f64,
    accepted_firmware: &[String],
) -> (BusState, Vec<Problem>) {
    if let Err(reason) = listen(station) {
        return (BusState::default(), vec![Problem::Stopped(reason)]);
    }
    let bus = measure_bus(station, rate_hz);
    let mut problems = Vec::new();
    if let Err(reason) = ask_versions(station) {
        problems.push(Problem::Stopped(reason));
    }
    let bus = BusState { firmware: firmware_of(station), ..bus };
    if let Some((node, command)) = station.first_foreign {
        problems.push(Problem::Foreign { node, command });
    }
    problems.extend(drive_problems(station, accepted_firmware));
    if MOST_BUS_LOAD < bus.bus_load {
        let bitrate = station.robot.can.bitrate;
        problems.push(Problem::BusLoad { load: bus.bus_load, bitrate, rate_hz });
    }
    (bus, problems)
}

/// Return the bus load of recorded traffic, without sending.
pub(super) fn load_of_traffic(station: &Station<'_>) -> BusState {
    let frames = station.traffic().frames_per_s.unwrap_or(0.0);
    let [bus_load, worst_case_bus_load] = bus_load(&station.robot.can, frames, 0.0);
    BusState { bus_load, worst_case_bus_load, ..BusState::default() }
}

/// Listen for [`LISTEN_SECONDS`].
pub(super) fn listen(station: &mut Station<'_>) -> Result<(), StopReason> {
    station.counts.by_node.clear();
    station.wait_until(station.now().after_seconds(LISTEN_SECONDS))
}

/// Compute rates from the counts, and the bus load from the larger of the configured and the
/// counted rates.
fn measure_bus(station: &Station<'_>, rate_hz: f64) -> BusState {
    let rates: Vec<MessageRate> = station
        .counts
        .by_node
        .iter()
        .filter_map(|((node, command), count)| {
            let message = Command::from_id(*command)?.name();
            Some(MessageRate { node: *node, message, rate_hz: *count as f64 / LISTEN_SECONDS })
        })
        .collect();
    let heard: f64 = rates.iter().map(|rate| rate.rate_hz).sum();
    let drives = station.robot.drives.len() as f64;
    let configured = drives * station.robot.can.cyclic_ms.frames_per_second();
    let setpoints = rate_hz * station.drives.len() as f64;
    let [bus_load, worst_case_bus_load] =
        bus_load(&station.robot.can, heard.max(configured), setpoints);
    BusState { rates, firmware: Vec::new(), bus_load, worst_case_bus_load }
}

fn ask_versions(station: &mut Station<'_>) -> Result<(), StopReason> {
    for _ in 0..VERSION_ATTEMPTS {
        let missing: Vec<u8> = station
            .drives
            .iter()
            .filter(|drive| drive.version.is_none() && drive.heartbeat.is_some())
            .map(|drive| drive.seat.node)
            .collect();
        for node in &missing {
            station
                .send(*node, &Message::Request(Command::Version))
                .map_err(|error| StopReason::LinkBroken { reason: error.to_string() })?;
        }
        if missing.is_empty() {
            break;
        }
        station.wait_until(station.now().after_seconds(VERSION_SECONDS))?;
    }
    Ok(())
}

/// Return the firmware version as `major.minor.revision`.
pub(super) fn firmware_text(version: [u8; 8]) -> String {
    let [major, minor, revision] = [0, 1, 2].map(|part| version[FIRMWARE_AT + part]);
    format!("{major}.{minor}.{revision}")
}

fn firmware_of(station: &Station<'_>) -> Vec<NodeFirmware> {
    let known = |drive: &super::watch::DriveWatch| {
        Some(NodeFirmware { node: drive.seat.node, version: firmware_text(drive.version?) })
    };
    station.drives.iter().filter_map(known).collect()
}

fn drive_problems(station: &Station<'_>, accepted_firmware: &[String]) -> Vec<Problem> {
    let others: Vec<u8> = station
        .counts
        .by_node
        .keys()
        .map(|(node, _)| *node)
        .filter(|node| *node != BROADCAST_NODE && station.robot.seat_of_node(*node).is_none())
        .collect::<std::collections::BTreeSet<u8>>()
        .into_iter()
        .collect();
    let mut problems = Vec::new();
    for drive in &station.drives {
        let seat = drive.seat;
        let heartbeat_ms = station.robot.can.cyclic_ms.heartbeat.max(10);
        let encoder_ms = station.robot.can.cyclic_ms.encoder.max(1);
        match (drive.heartbeat, drive.encoder_at) {
            (None, None) => problems.push(Problem::Silent { seat, others: others.clone() }),
            (None, Some(_)) => problems.push(Problem::Missing {
                seat,
                setting: "heartbeat_msg_rate_ms",
                period_ms: heartbeat_ms,
            }),
            (Some(heartbeat), encoder) => {
                if encoder.is_none() {
                    let setting = "encoder_msg_rate_ms";
                    problems.push(Problem::Missing { seat, setting, period_ms: encoder_ms });
                }
                if let Some(problem) = firmware_problem(seat, drive.version, accepted_firmware) {
                    problems.push(problem);
                } else if heartbeat.state != AxisState::Idle {
                    problems.push(Problem::NotIdle { seat, state: heartbeat.state });
                }
            }
        }
    }
    problems
}

fn firmware_problem(
    seat: MotorSeat,
    version: Option<[u8; 8]>,
    accepted: &[String],
) -> Option<Problem> {
    let Some(version) = version else { return Some(Problem::NoVersion { seat }) };
    let found = firmware_text(version);
    let fits = version[FIRMWARE_AT..FIRMWARE_AT + 2] == FIRMWARE || accepted.contains(&found);
    (!fits).then_some(Problem::Firmware { seat, found })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gantry::CyclicPeriods;

    #[test]
    fn loads_are_those_of_the_fact_sheet() {
        // Four axes: heartbeat 10, encoder 100, setpoints 50 Hz: 640 frames/s, 28 % of 250 kbit/s.
        let can = BusConfig::default();
        let drives = 4.0 * can.cyclic_ms.frames_per_second();
        let [load, worst] = bus_load(&can, drives, 4.0 * 50.0);
        assert!((load - 0.28).abs() < 0.005 && (worst - 0.35).abs() < 0.005, "{load} {worst}");
        // Encoder, torques and setpoints at 500 Hz, heartbeat 10, bus 10: 68 % of 1 Mbit/s.
        let cyclic_ms =
            CyclicPeriods { encoder: 2, torques: 2, bus_voltage: 100, ..CyclicPeriods::default() };
        let fast = BusConfig { bitrate: 1_000_000, cyclic_ms };
        let drives = 4.0 * fast.cyclic_ms.frames_per_second();
        let [load, worst] = bus_load(&fast, drives, 4.0 * 500.0);
        assert!((load - 0.675).abs() < 0.005 && (worst - 0.82).abs() < 0.005, "{load} {worst}");
        assert!(load < MOST_BUS_LOAD);
    }

    #[test]
    fn only_firmware_0_6_passes_unless_accepted() {
        let seat = MotorSeat::of_node(1).unwrap();
        let version = |major, minor| Some([2, 5, 2, 0, major, minor, 11, 0]);
        assert_eq!(firmware_problem(seat, version(0, 6), &[]), None);
        let problem = firmware_problem(seat, version(0, 5), &[]).unwrap();
        assert!(problem.to_string().contains("runs firmware 0.5.11"), "{problem}");
        assert_eq!(firmware_problem(seat, version(0, 0), &["0.0.11".to_owned()]), None);
        assert!(firmware_problem(seat, None, &[]).unwrap().to_string().contains("0.5.x"));
    }
}
