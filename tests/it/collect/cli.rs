//! `klasktron collect` as it is typed: plans, dry runs, logs that are listened to, and mistakes.

use crate::support::{Mistake, check_mistakes, klasktron, said};
use klasktron::recording::{
    Recording,
    message::{CarriageState, VelocityCommand},
    topic::{self, Player},
};
use std::{fs, path::Path};

fn file(dir: &Path, name: &str) -> String {
    dir.join(name).to_str().unwrap().to_owned()
}

#[test]
fn a_typed_pattern_is_driven_and_can_be_fitted_to() {
    let dir = tempfile::tempdir().unwrap();
    let out = file(dir.path(), "out.mcap");
    let typed = ["collect", "--speed", "max", "--pattern", "random_walk", "--seconds", "4"];
    let more =
        ["--repeat", "2", "--validation-every", "2", "--player", "left", "--json", "-o", &out];
    let (stdout, stderr, status) = said(&klasktron(&[&typed[..], &more[..]].concat()));
    assert_eq!(status, 0, "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(report["samples"], 400);
    let recording = Recording::open(Path::new(&out)).unwrap();
    assert_eq!(recording.info("split"), Some("by_run"));
    assert_eq!(recording.info("source"), Some("virtual"));
    assert!(recording.info("rig_json").is_some() && recording.info("plan_json").is_some());
    // A frame of 111 bits after the other at 250 kbit/s, and nothing about a player that was not driven.
    assert_eq!(recording.command_arrivals(Player::Left).unwrap(), [444e-6, 888e-6]);
    assert_eq!(recording.command_arrivals(Player::Right).unwrap(), [0.0; 2]);
    let (stdout, stderr, status) = said(&klasktron(&["info", &out]));
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.contains("no warnings"), "{stdout}");
    assert!(stdout.contains("random_walk  validation     1"), "{stdout}");
}

#[test]
fn a_dry_run_writes_the_plan_and_opens_no_bus() {
    let dir = tempfile::tempdir().unwrap();
    let plan = file(dir.path(), "plan");
    let bus = "socketcan:nowhere";
    let typed =
        ["collect", "--bus", bus, "--plan", "paper", "--player", "left", "--dry-run", &plan];
    let (_, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("96 runs, 69669 samples"), "{stderr}");
    for name in ["index.html", "plan.csv", "plan.json"] {
        assert!(0 < fs::metadata(dir.path().join("plan").join(name)).unwrap().len());
    }
    // The plan can be given back.
    let again = file(dir.path(), "again");
    let json = file(dir.path(), "plan/plan.json");
    let typed = ["collect", "--plan", &json, "--player", "left", "--dry-run", &again];
    let (_, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 0, "{stderr}");
    let csv = |folder: &str| fs::read(dir.path().join(folder).join("plan.csv")).unwrap();
    assert_eq!(csv("plan"), csv("again"));
}

/// One velocity of both motors of the left player, then where they report to be.
const LOG: &str = "\
(1700000000.000000) can0 04D#0000A0C000000000 T
(1700000000.000100) can0 06D#0000A0C000000000 T
(1700000000.005000) can0 049#0000000000000000
(1700000000.005300) can0 069#0000000000000000
(1700000000.015000) can0 049#CDCC4CBD0000A0C0
(1700000000.015300) can0 069#CDCC4CBD0000A0C0
(1700000000.100000) can0 041#0000000008000000
";

#[test]
fn a_log_is_listened_to() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("bus.log"), LOG).unwrap();
    let bus = format!("replay:{}", file(dir.path(), "bus.log"));
    let out = file(dir.path(), "out.mcap");
    let (_, stderr, status) = said(&klasktron(&["collect", "--bus", &bus, "--listen", "-o", &out]));
    assert_eq!(status, 0, "{stderr}");
    let recording = Recording::open(Path::new(&out)).unwrap();
    // -5 turns/s of both drives of the left player, whose signs are -1: +0.2 m/s along x.
    let commands = recording.series::<VelocityCommand>(&topic::command(Player::Left)).unwrap();
    assert_eq!(commands.values.len(), 1);
    assert!((commands.values[0].vx - 0.2).abs() < 1e-6 && commands.values[0].vy.abs() < 1e-6);
    // And -0.05 turns of both are 2 mm from the motors' zero.
    let carriage = recording.series::<CarriageState>(&topic::carriage(Player::Left)).unwrap();
    assert!((carriage.values[1].x - 0.002).abs() < 1e-6 && carriage.values[1].y.abs() < 1e-6);
    assert_eq!(recording.info("carriage_origin"), Some("unknown"));
    // It cannot be driven.
    let typed = ["collect", "--bus", &bus, "--pattern", "circle", "-o", "never.mcap"];
    let (_, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 1);
    assert!(stderr.contains("it can be recorded with --listen, not driven"), "{stderr}");
}

/// Firmware 0.6.11 of node 2, and a node outside of the robot file with an expired watchdog.
const OTHERS: &str = "\
(1700000000.110000) can0 040#0204043A00060B00
(1700000000.120000) can0 121#0000000101030000
";

#[test]
fn listening_names_nodes_firmware_and_errors() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("bus.log"), format!("{LOG}{OTHERS}")).unwrap();
    let bus = format!("replay:{}", file(dir.path(), "bus.log"));
    let out = file(dir.path(), "out.mcap");
    let typed = ["collect", "--bus", &bus, "--listen", "--json", "-o", &out];
    let (stdout, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 0, "{stderr}");
    for expected in [
        "node 2 (left a): firmware 0.6.11, state CLOSED_LOOP_CONTROL, errors none; Get_Version once",
        "node 9 (not in the robot file): firmware not reported, state IDLE, errors \
         WATCHDOG_TIMER_EXPIRED; Heartbeat once",
        "camera: 0 frames, 0 rejected",
        "warning: node 0 (right a) was not heard",
        "warning: node 9 is not in the robot file",
        "warning: node 9 reports errors WATCHDOG_TIMER_EXPIRED",
    ] {
        assert!(stderr.contains(expected), "{expected}: {stderr}");
    }
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(report["schema_version"], 2);
    let node = &report["traffic"]["nodes"][0];
    assert_eq!((&node["node"], &node["firmware"]), (&2.into(), &"0.6.11".into()));
    let encoder = &node["messages"][2];
    assert_eq!(encoder["message"], "Get_Encoder_Estimates");
    assert!((encoder["rate_hz"].as_f64().unwrap() - 100.0).abs() < 1.0, "{encoder}");
}

#[test]
fn mistakes_are_reported_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let robot = file(dir.path(), "robot.json");
    fs::write(&robot, r#"{"limits": {"speed_m_per_s": 9}}"#).unwrap();
    let taken = file(dir.path(), "taken.mcap");
    fs::write(&taken, "x").unwrap();
    let out = file(dir.path(), "out.mcap");
    let circle = "--pattern=circle";
    let cases: &[Mistake<'_>] = &[
        (&["--pattern", "cirle"], 2, "circle, diagonal"),
        (&["--pattern", "circle:radius=0.05"], 2, "radius_m"),
        (&["--pattern", "circle:radius_m=0.5", "--speed", "max"], 1, "radius_m"),
        (&[circle, "--bus", "can0"], 2, "socketcan:INTERFACE"),
        (&[circle, "--bus", "slcan:/dev/nothing", "--homing", "declared"], 1, "/dev/nothing"),
        (&[circle, "--bus", "slcan:/dev/nothing"], 1, "--homing declared"),
        (&[circle, "--bus", "socketcan:can0", "--speed", "max"], 1, "--bus virtual"),
        (&[circle, "--robot", &robot], 1, "limits.speed_m_per_s is 9; it must lie in (0, 2] m/s"),
        (&[circle, "--rate-hz", "5000"], 2, "from 10 to 500 Hz"),
        (&[circle, "--speed", "max", "-o", &taken], 1, "taken.mcap"),
        (&[circle, "--speed", "max", "-o", "/nowhere/x.mcap"], 1, "/nowhere/x.mcap"),
        (&[], 2, "--plan <PLAN>"),
        (&["--plan", "papr"], 1, "--plan takes `paper`"),
    ];
    check_mistakes("collect", &out, cases);
    assert_eq!(fs::read(&taken).unwrap(), b"x");
}

#[test]
fn an_unfinished_recording_is_never_written_over() {
    let dir = tempfile::tempdir().unwrap();
    let partial = dir.path().join(".out.mcap.partial");
    fs::write(&partial, "what a killed session wrote").unwrap();
    let out = file(dir.path(), "out.mcap");
    let typed = ["collect", "--speed", "max", "--pattern", "circle", "--overwrite", "-o", &out];
    let (_, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 1);
    assert!(
        stderr.contains("klasktron recover") && stderr.contains(".out.mcap.partial"),
        "{stderr}"
    );
    assert_eq!(fs::read(&partial).unwrap(), b"what a killed session wrote");
}

#[test]
fn a_bad_log_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    for (name, text, expected) in [
        ("mid.log", format!("{LOG}this is no frame\n"), "1 lines of the log could not be parsed"),
        ("empty.log", String::new(), "no frame came in"),
    ] {
        fs::write(dir.path().join(name), text).unwrap();
        let bus = format!("replay:{}", file(dir.path(), name));
        let out = file(dir.path(), &format!("{name}.mcap"));
        let typed = ["collect", "--bus", &bus, "--listen", "-o", &out];
        let (_, stderr, status) = said(&klasktron(&typed));
        assert_eq!(status, 3, "{name}: {stderr}");
        assert!(stderr.contains(expected), "{name}: {stderr}");
    }
}
