//! Files that other software wrote, against numbers that other software computed.
//!
//! `scripts/make_foreign_files.py FOLDER` writes them (rosbags, numpy, python-can); the test runs when
//! `KLASKTRON_FOREIGN_FILES` names that folder.

use klasktron::{
    recording::{
        Recording,
        message::{
            BoardState, CarriageState, DriveStatus, MotorState, ObjectState, VelocityCommand,
        },
        topic::{self, schema_of},
    },
    units::Nanos,
};
use prost::Message;
use serde_json::Value;
use std::{
    collections::BTreeMap,
    env,
    path::{Path, PathBuf},
    process::Command,
};

/// Half a unit in the last place of single precision at 100 turns, and of a nanosecond clock.
const TOLERANCE: f64 = 1e-5;

type Fields = BTreeMap<String, f64>;

fn object(fields: &mut Fields, name: &str, state: Option<ObjectState>) {
    let Some(state) = state else { return };
    for (field, value) in [("x", state.x), ("y", state.y), ("vx", state.vx), ("vy", state.vy)] {
        fields.insert(format!("{name}.{field}"), value);
    }
}

/// The numbers of a message by name.
fn fields(schema: &str, bytes: &[u8]) -> Fields {
    let mut fields = Fields::new();
    let mut put = |name: &str, value: f64| {
        fields.insert(name.to_owned(), value);
    };
    match schema {
        "klasktron.VelocityCommand" => {
            let m = VelocityCommand::decode(bytes).unwrap();
            put("vx", m.vx);
            put("vy", m.vy);
        }
        "klasktron.CarriageState" => {
            let m = CarriageState::decode(bytes).unwrap();
            for (name, value) in [("x", m.x), ("y", m.y), ("vx", m.vx), ("vy", m.vy)] {
                put(name, value);
            }
        }
        "klasktron.MotorState" => {
            let m = MotorState::decode(bytes).unwrap();
            put("position_turns", m.position_turns);
            put("velocity_turns_per_s", m.velocity_turns_per_s);
            m.torque_target_nm.iter().for_each(|v| put("torque_target_nm", *v));
            m.torque_estimate_nm.iter().for_each(|v| put("torque_estimate_nm", *v));
        }
        "klasktron.DriveStatus" => {
            let m = DriveStatus::decode(bytes).unwrap();
            put("axis_state", m.axis_state.into());
            m.bus_voltage_v.iter().for_each(|v| put("bus_voltage_v", *v));
        }
        "klasktron.BoardState" => {
            let m = BoardState::decode(bytes).unwrap();
            put("status", m.status as f64);
            object(&mut fields, "ball", m.ball);
            object(&mut fields, "left", m.left);
            object(&mut fields, "right", m.right);
        }
        _ => {}
    }
    fields
}

/// Log time, publish time and fields of every message of a topic, in order of log time.
fn messages(recording: &Recording, topic: &str) -> Vec<(Nanos, Nanos, Fields)> {
    let schema = schema_of(topic).unwrap();
    let mut messages: Vec<_> = recording
        .channels_of(topic)
        .flat_map(|channel| channel.raw())
        .map(|(at, bytes)| (at.log_time, at.publish_time, fields(schema, bytes)))
        .collect();
    messages.sort_by_key(|message| message.0);
    messages
}

fn check_message(place: &str, found: &(Nanos, Nanos, Fields), expected: &Value) {
    for (name, time) in [("log_time", found.0), ("publish_time", found.1)] {
        let wanted = expected[name].as_u64().unwrap();
        // python-can writes microseconds from a float of seconds, whose step is 240 ns.
        assert!(time.0.abs_diff(wanted) <= 1000, "{place}: {name} {time:?}, expected {wanted}");
    }
    for (name, value) in expected["fields"].as_object().unwrap() {
        let wanted = value.as_f64().unwrap();
        let found = found.2.get(name).unwrap_or_else(|| panic!("{place}: no {name}"));
        assert!(
            (found - wanted).abs() < TOLERANCE,
            "{place}: {name} is {found}, expected {wanted}"
        );
    }
}

fn check_topics(name: &str, recording: &Recording, expected: &Value) {
    for (topic, wanted) in expected.as_object().unwrap() {
        let found = messages(recording, topic);
        assert_eq!(found.len() as u64, wanted["count"].as_u64().unwrap(), "{name}: {topic}");
        for (end, message) in [("first", found.first()), ("last", found.last())] {
            if wanted[end]["fields"].is_object() && topic != topic::RUN_MARKER {
                check_message(&format!("{name}: {topic}, {end}"), message.unwrap(), &wanted[end]);
            }
        }
    }
}

fn check_case(folder: &Path, case: &Value) {
    let name = case["name"].as_str().unwrap();
    let output = folder.join("klasktron-output.mcap");
    let args: Vec<&str> =
        case["args"].as_array().unwrap().iter().map(|arg| arg.as_str().unwrap()).collect();
    let run = Command::new(env!("CARGO_BIN_EXE_klasktron"))
        .current_dir(folder)
        .arg("import")
        .args(&args)
        .arg("-o")
        .arg(&output)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stderr);
    let exit = case["exit"].as_i64().unwrap();
    assert_eq!(i64::from(run.status.code().unwrap()), exit, "{name}: {said}");
    for text in case["says"].as_array().unwrap() {
        let text = text.as_str().unwrap();
        assert!(said.contains(text), "{name} does not say '{text}': {said}");
    }
    if exit == 1 {
        assert!(!output.exists(), "{name}: nothing is left behind");
        return;
    }
    let recording = Recording::open(&output).unwrap();
    assert!(recording.loss.is_none());
    check_topics(name, &recording, &case["topics"]);
    for (key, value) in case["metadata"].as_object().unwrap() {
        assert_eq!(recording.info(key), value.as_str(), "{name}: {key}");
    }
    if let Some(pattern) = case["pattern"].as_str() {
        assert_eq!(recording.markers().unwrap().values[0].pattern, pattern, "{name}");
    }
    std::fs::remove_file(output).unwrap();
}

#[test]
fn foreign_files_are_read_as_their_writers_meant_them() {
    let Some(folder) = env::var_os("KLASKTRON_FOREIGN_FILES").map(PathBuf::from) else {
        println!(
            "skipped: set KLASKTRON_FOREIGN_FILES to a folder made by scripts/make_foreign_files.py"
        );
        return;
    };
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let cases = expected["cases"].as_array().unwrap();
    assert!(30 <= cases.len(), "only {} cases; make the files again", cases.len());
    for case in cases {
        check_case(&folder, case);
    }
    println!("{} foreign cases agree", cases.len());
}
