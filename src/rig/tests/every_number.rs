//! Test that every number of the configuration has an effect on the rig's output.

use super::support::START;
use crate::{
    can::{Message, encode},
    link::{Event, Link},
    rig::{RigConfig, Speed, VirtualLink},
};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

/// A rig on which as much as possible happens within a third of a second.
fn busy(ball: [f64; 4]) -> Value {
    let [x_m, y_m, vx_m_per_s, vy_m_per_s] = ball;
    let rail = json!({"breakaway_n": 3.0, "position_fraction": 0.1});
    let gantry = |y: f64| {
        json!({"x_friction": rail, "y_friction": rail, "backlash_m": 1e-4, "y_start_m": y,
               "x_travel_m": 0.003, "y_travel_near_m": 0.085, "y_travel_far_m": 0.0995,
               "racking_kg_per_m": 1.0})
    };
    let peg = json!({"wobble_hz": 20.0});
    let magnet = json!({"caught_at_m": 0.0029, "lost_at_m": 0.003, "stiffness_n_per_m": 100.0});
    json!({
        "friction_drift_fraction": 0.2, "friction_drift_time_s": 1.0,
        "bus": {"bitrate": 1_000_000, "receive_jitter_s": 1e-5},
        "drive": {"friction": {"breakaway_nm": 0.03, "load_fraction": 0.01}, "offset_turns_per_s": 0.05,
                  "deadband_turns_per_s": 4.0, "lag_s": 0.001,
                  "velocity_limit_turns_per_s": 9.0, "current_limit_a": 8.0,
                  "cogging": [{"amplitude_nm": 0.01, "periods_per_turn": 7.0, "phase_turns": 0.1}],
                  "cyclic_ms": {"iq": 10, "error": 100, "temperature": 50, "bus_voltage": 50,
                                "torques": 10, "powers": 50}},
        "supply": {"open_volts": 6.0},
        "gantry": {"left": gantry(-0.1), "right": gantry(0.1)},
        "peg": {"left": peg, "right": peg}, "magnet": {"left": magnet, "right": magnet},
        "ball": {"start": {"x_m": x_m, "y_m": y_m, "vx_m_per_s": vx_m_per_s, "vy_m_per_s": vy_m_per_s},
                 "put_back_after_s": 0.05, "launch_every_s": 0.12, "launch_speed_m_per_s": 5.0,
                 "serve_spread_m": 1e-3, "serve_speed_m_per_s": 0.02,
                 "peg_attraction_m_per_s2": 0.1, "sliding_friction": 0.1, "crown_m": 0.001,
                 "patch": {"radius_m": 0.1, "extra_resistance": 0.01},
                 "wall_restitution_loss_s_per_m": 0.05, "peg_restitution_loss_s_per_m": 0.05},
        "camera": {"latency_s": 0.005, "quantisation_m": 1e-6, "drop_fraction": 0.1,
                   "miss_fraction": 0.1, "outlier_fraction": 0.1, "exposure_s": 0.001,
                   "stamp_jitter_s": 1e-6, "repeat_fraction": 0.5}
    })
}

/// Numbers that matter only in a situation that the busy rig does not reach. Each has its own test,
/// or is plainly a threshold.
const QUIET: [&str; 18] = [
    "drive.watchdog_timeout_s",
    "drive.position_gain_per_s",
    "drive.overspeed_ratio",
    "drive.ramp_turns_per_s2",
    "drive.least_supply_volts",
    "drive.thermal.fet_limit_celsius",
    "drive.thermal.motor_limit_celsius",
    "bus.transmit_queue",
    "bus.overhead_bits",
    "belt_metres_per_turn",
    "drive.firmware",
    "drive.hardware",
    "seed",
    "drives",
    "step_s",
    "board",
    "cups.capture_speed_m_per_s",
    "ball.put_back_still_after_s",
];

fn digest(config: RigConfig) -> [u8; 32] {
    let mut link = VirtualLink::new(config, Speed::Maximum, START).unwrap();
    let mut digest = Sha256::new();
    for node in 0..4 {
        link.send(&encode(node, &Message::SetAxisState { state: 8 })).unwrap();
    }
    for tick in 0..16 {
        let sign = if tick / 4 % 2 == 0 { 1.0 } else { -1.0 };
        for (node, turns) in [(0, 12.0), (1, 5.0), (2, -5.0), (3, 12.0)] {
            let turns = if tick < 12 { turns * sign } else { 1.0 };
            let message =
                Message::SetInputVel { velocity_turns_per_s: turns, torque_newton_metres: 0.0 };
            link.send(&encode(node, &message)).unwrap();
        }
        let until = link.now().after_seconds(0.02);
        while let Some(event) = link.next_event(until).unwrap() {
            match event {
                Event::Frame { received_at, frame, .. } => {
                    digest.update(received_at.0.to_le_bytes());
                    digest.update(frame.id.to_le_bytes());
                    digest.update(frame.data.as_slice());
                }
                Event::Camera { received_at, datagram } => {
                    digest.update(received_at.0.to_le_bytes());
                    digest.update(datagram);
                }
                _ => {}
            }
        }
    }
    digest.finalize().into()
}

/// Pointers to all numbers below `value`.
fn numbers(value: &Value, path: &str, found: &mut Vec<String>) {
    match value {
        Value::Number(_) => found.push(path.to_owned()),
        Value::Object(fields) => {
            fields
                .iter()
                .for_each(|(name, field)| numbers(field, &format!("{path}/{name}"), found));
        }
        Value::Array(items) => {
            let each = |(idx, item)| numbers(item, &format!("{path}/{idx}"), found);
            items.iter().enumerate().for_each(each);
        }
        _ => {}
    }
}

/// The configuration with another value at `pointer`.
fn changed(config: &Value, pointer: &str) -> RigConfig {
    let number = config.pointer(pointer).unwrap();
    let whole = number.is_u64() && !number.is_f64();
    let old = number.as_f64().unwrap();
    for new in [old * 1.25, old * 0.8, old + 0.05, old + 0.004, old - 0.004] {
        let mut config = config.clone();
        let new = if whole { json!(new.ceil() as u64) } else { json!(new) };
        *config.pointer_mut(pointer).unwrap() = new.clone();
        let checked = RigConfig::from_json(&config.to_string());
        if new != *number
            && let Ok(checked) = checked
        {
            return checked;
        }
    }
    panic!("{pointer} cannot be changed");
}

/// Numbers among `pointers`, or among all, without effect on a rig whose ball starts at `ball`.
fn dead_numbers(ball: [f64; 4], pointers: Option<Vec<String>>) -> Vec<String> {
    let mut base = RigConfig::from_json(&busy(ball).to_string()).unwrap();
    base.drive.least_supply_volts = 0.0;
    let value = serde_json::to_value(&base).unwrap();
    let first = digest(base);
    let mut dead = pointers.unwrap_or_else(|| {
        let mut found = Vec::new();
        numbers(&value, "", &mut found);
        let name = |pointer: &String| pointer[1..].replace('/', ".");
        found.retain(|pointer| !QUIET.iter().any(|quiet| name(pointer).starts_with(quiet)));
        found
    });
    assert!(!dead.is_empty());
    dead.retain(|pointer| digest(changed(&value, pointer)) == first);
    dead
}

#[test]
fn every_number_has_an_effect() {
    let without_hit = dead_numbers([0.03, 0.17, -0.5, 0.01], None);
    let dead = dead_numbers([0.008, 0.125, 0.01, -0.9], Some(without_hit));
    assert!(dead.is_empty(), "without effect: {dead:#?}");
}
