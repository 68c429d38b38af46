//! Tests of each fault, as the program observes it.

use super::support::Host;
use crate::{
    can::{Command, Message, encode},
    link::{BusFault, Link, LinkError},
};

/// An armed host whose rig has the faults of `list`, after half a second of commands.
fn run(list: &str) -> Host {
    let mut host = Host::from_json(&format!(r#"{{"faults": [{list}]}}"#));
    host.arm();
    for _ in 0..25 {
        for node in 0..4 {
            let message = Message::SetInputVel {
                velocity_turns_per_s: if node < 2 { 1.0 } else { 0.0 },
                torque_newton_metres: 0.0,
            };
            // Refused frames are part of some faults.
            let _ = host.link.send(&encode(node, &message));
        }
        host.wait(0.02);
    }
    host
}

/// Time of the last message of a node (s).
fn last_heard(host: &Host, node: u8, command: Command) -> f64 {
    let of = |d: &crate::can::Decoded| d.node == node && d.message.command() == command;
    host.messages.iter().filter(|(_, d)| of(d)).map(|(at, _)| *at).fold(0.0, f64::max)
}

#[test]
fn a_heartbeat_or_an_encoder_can_stop_alone() {
    let host = run(r#"{"at_s": 0.2, "kind": "heartbeat_stops", "node": 1},
                      {"at_s": 0.3, "kind": "encoder_stops", "node": 2}"#);
    assert!(last_heard(&host, 1, Command::Heartbeat) < 0.202);
    assert!(0.5 < last_heard(&host, 1, Command::EncoderEstimates));
    assert!(last_heard(&host, 2, Command::EncoderEstimates) < 0.302);
    assert!(0.4 < last_heard(&host, 2, Command::Heartbeat));
    assert!(0.4 < last_heard(&host, 0, Command::Heartbeat));
}

#[test]
fn an_axis_fault_disarms_one_drive_after_arming() {
    let host = run(r#"{"after_arming_s": 0.1, "kind": "axis_fault", "node": 0, "errors": 32}"#);
    assert_eq!(host.heartbeat(0), (1, 32, 3));
    assert_eq!(host.heartbeat(1), (8, 0, 0));
}

#[test]
fn an_overheated_drive_disarms() {
    let mut host =
        run(r#"{"after_arming_s": 0.1, "kind": "overheat", "node": 3, "fet_celsius": 105.0}"#);
    assert_eq!(host.heartbeat(3), (1, 0x4000, 3));
    host.send(3, Message::Request(Command::Temperature));
    host.wait(0.01);
    let fet = |m: &Message| match m {
        Message::Temperature { fet_celsius, .. } => Some(*fet_celsius),
        _ => None,
    };
    assert_eq!(host.last(3, fet), Some(105.0));
}

#[test]
fn hard_work_warms_a_drive() {
    let mut host = Host::from_json(r#"{"drive": {"thermal": {"fet_time_s": 1.0}}}"#);
    host.arm();
    let before = host.link.truth().drives[0].fet_celsius;
    for _ in 0..10 {
        host.drive([0.5, 0.0], 0.1);
        host.drive([-0.5, 0.0], 0.1);
    }
    assert!(before + 0.5 < host.link.truth().drives[0].fet_celsius);
}

#[test]
fn frames_are_dropped_and_delayed() {
    let count = |host: &Host| host.messages.iter().filter(|(at, _)| 0.1 < *at).count() as f64;
    let all = count(&run(""));
    let some = count(&run(r#"{"at_s": 0.1, "kind": "frames_dropped", "probability": 0.3}"#));
    assert!((some / all - 0.7).abs() < 0.1, "{some} of {all}");
    let host = run(r#"{"at_s": 0.3, "for_s": 0.1, "kind": "frames_delayed", "seconds": 0.05}"#);
    let gap = host.messages.windows(2).map(|pair| pair[1].0 - pair[0].0).fold(0.0, f64::max);
    assert!((0.04..0.08).contains(&gap), "{gap}");
}

#[test]
fn a_silent_drive_neither_speaks_nor_listens() {
    let host = run(r#"{"after_arming_s": 0.1, "kind": "drive_silent", "node": 1}"#);
    assert!(last_heard(&host, 1, Command::EncoderEstimates) < 0.2);
    // It receives no setpoints either, so its watchdog expires.
    assert_eq!(host.link.truth().drives[1].errors.0, 0x100_0000);
}

#[test]
fn bus_off_and_link_down_are_reported_and_refuse_frames() {
    let mut host = run(r#"{"at_s": 0.3, "kind": "bus_off"}"#);
    assert_eq!(host.troubles.len(), 1);
    assert!((host.troubles[0].0 - 0.3).abs() < 1e-3);
    assert_eq!(host.troubles[0].1, BusFault::BusOff);
    let frame = encode(0, &Message::Estop);
    assert!(matches!(host.link.send(&frame), Err(LinkError::Full { .. })));
    assert!(host.messages.iter().all(|(at, _)| *at < 0.301));
    // No frames feed the watchdogs any more.
    assert!(host.link.truth().drives.iter().all(|drive| drive.errors.0 == 0x100_0000));
    assert!(host.pictures.iter().any(|(at, _)| 0.5 < *at), "the camera has its own cable");

    let mut host = run(r#"{"at_s": 0.3, "for_s": 0.1, "kind": "link_down"},
                          {"at_s": 0.45, "for_s": 0.05, "kind": "bus_off"}"#);
    let faults: Vec<BusFault> = host.troubles.iter().map(|(_, fault)| *fault).collect();
    assert_eq!(faults, [BusFault::LinkDown, BusFault::BusOff, BusFault::Restarted]);
    assert!(host.link.send(&frame).is_ok());
    let mut host = run(r#"{"at_s": 0.5, "kind": "link_down"}"#);
    assert!(matches!(host.link.send(&frame), Err(LinkError::Down { .. })));
}

#[test]
fn a_striker_can_be_lost_and_found() {
    let host = run(r#"{"at_s": 0.1, "kind": "peg_lost", "player": "right"}"#);
    let right = host.link.truth().right;
    assert!(!right.coupled);
    assert!(right.peg.x.abs() < 1e-3 && 0.01 < right.carriage.x);
    assert!(host.link.truth().left.coupled);
}

#[test]
fn the_camera_can_stop() {
    let host = run(r#"{"at_s": 0.2, "for_s": 0.2, "kind": "camera_stops"}"#);
    let none = |(at, _): &&(f64, Vec<u8>)| (0.24..0.42).contains(at);
    assert_eq!(host.pictures.iter().filter(none).count(), 0);
    assert!(host.pictures.iter().any(|(at, _)| 0.45 < *at));
}

#[test]
fn a_foreign_controller_is_heard_by_program_and_drive() {
    let mut host = Host::from_json(
        r#"{"faults": [{"at_s": 0.1, "kind": "foreign_command", "node": 2, "velocity": 3.0}]}"#,
    );
    host.arm();
    host.wait(0.15);
    let foreign = |m: &Message| match m {
        Message::SetInputVel { velocity_turns_per_s, .. } => Some(*velocity_turns_per_s),
        _ => None,
    };
    assert_eq!(host.last(2, foreign), Some(3.0));
    assert!(2.0 < host.link.truth().drives[2].velocity_turns_per_s);
}
