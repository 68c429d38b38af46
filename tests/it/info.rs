//! `klasktron info` as a process: exit statuses, the document, and a warning for each planted fault.

use crate::support::{Rig, klasktron, period, said, writer};
use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RawSchema, RecordingWriter,
        message::{CarriageState, RunMarker, VelocityCommand, run_marker::Phase},
        topic::{self, Player},
    },
    units::Nanos,
};
use serde_json::Value;
use std::{collections::BTreeMap, fs, path::Path};

fn document(files: &[&Path]) -> Value {
    let mut args = vec!["info", "--json"];
    args.extend(files.iter().map(|path| path.to_str().unwrap()));
    let (stdout, stderr, status) = said(&klasktron(&args));
    assert_eq!((status, stderr.as_str()), (0, ""));
    let document = serde_json::from_str(&stdout).unwrap();
    crate::schema::assert_valid("info", &document);
    document
}

/// Kinds of the warnings about one file.
fn kinds(path: &Path) -> Vec<String> {
    let document = document(&[path]);
    let warnings = document["files"][0]["warnings"].as_array().unwrap().clone();
    assert!(warnings.iter().all(|warning| warning["message"].is_string()));
    warnings.iter().map(|warning| warning["kind"].as_str().unwrap().to_owned()).collect()
}

fn kinds_of(rig: &Rig) -> Vec<String> {
    let dir = tempfile::tempdir().unwrap();
    kinds(&rig.write(dir.path(), "made.mcap"))
}

#[test]
fn a_healthy_recording_is_described_and_has_no_warning() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig::default().write(dir.path(), "good.mcap");
    let document = document(&[&path]);
    let file = &document["files"][0];
    assert_eq!(document["schema_version"], 2);
    assert_eq!((&file["robot"], &file["split"]), (&"klasktron".into(), &"train".into()));
    assert_eq!(file["messages"], 1002);
    assert_eq!(file["duration_s"], 10.0);
    let command = &file["topics"][2];
    assert_eq!(command["topic"], "/striker/left/command");
    assert_eq!((&command["measured_rate_hz"], &command["messages"]), (&50.0.into(), &500.into()));
    let run = &file["runs"][0];
    assert_eq!((&run["pattern"], &run["samples"]), (&"sines".into(), &500.into()));
    let speed = &file["speeds"][0];
    assert!((speed["velocity_per_command"].as_f64().unwrap() - 1.0).abs() < 0.05, "{speed}");
    assert_eq!(file["warnings"].as_array().unwrap().len(), 0, "{}", file["warnings"]);
}

#[test]
fn the_table_fits_its_columns() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig::default().write(dir.path(), "good.mcap");
    let (stdout, _, status) = said(&klasktron(&["info", path.to_str().unwrap()]));
    assert_eq!(status, 0);
    assert!(stdout.contains("/striker/left/command"), "{stdout}");
    assert!(stdout.trim_end().ends_with("no warnings"), "{stdout}");
    let table = stdout.lines().filter(|line| !line.contains("good.mcap"));
    assert!(table.map(|line| line.chars().count()).max() <= Some(100), "{stdout}");
}

#[test]
fn each_planted_fault_has_its_warning() {
    let healthy = Rig::default();
    let twice = Rig { gain: [2.0, 0.0, 0.0, 2.0], ..healthy.clone() };
    assert_eq!(kinds_of(&twice), ["twice_the_command", "twice_the_command"]);
    let mirrored = Rig { gain: [-1.0, 0.0, 0.0, 1.0], ..healthy.clone() };
    assert_eq!(kinds_of(&mirrored), ["mirrored"]);
    let swapped = Rig { gain: [0.0, 1.0, 1.0, 0.0], ..healthy.clone() };
    assert_eq!(kinds_of(&swapped), ["axes_swapped"]);
    let stuck: fn(usize, CarriageState) -> _ = |_, _| Some(CarriageState::default());
    assert_eq!(kinds_of(&Rig { carriage: stuck, ..healthy.clone() }), ["sensor_stuck"; 4]);
    let nan: fn(usize, CarriageState) -> _ =
        |k, state| Some(CarriageState { vx: if k == 9 { f64::NAN } else { state.vx }, ..state });
    assert_eq!(kinds_of(&Rig { carriage: nan, ..healthy.clone() }), ["non_finite"]);
    let silent: fn(usize, CarriageState) -> _ = |k, state| (k < 300).then_some(state);
    assert_eq!(kinds_of(&Rig { carriage: silent, ..healthy.clone() }), ["stops_early"]);
    let dropout: fn(usize, CarriageState) -> _ =
        |k, state| (!(200..250).contains(&k)).then_some(state);
    assert_eq!(kinds_of(&Rig { carriage: dropout, ..healthy.clone() }), ["dropouts"]);
    let uncorrelated: fn(usize, CarriageState) -> _ = |k, state| {
        let t = k as f64 / 50.0;
        let (vx, vy) = (0.1 * (2.3 * t * t).sin(), 0.1 * (1.7 * t * t).cos());
        Some(CarriageState { vx, vy, ..state })
    };
    assert_eq!(
        kinds_of(&Rig { carriage: uncorrelated, ..healthy }),
        ["uncorrelated", "uncorrelated"]
    );
}

#[test]
fn time_running_backwards_is_a_warning_and_jitter_is_none() {
    let backwards: fn(u64) -> Nanos = |k| period(if k % 100 == 50 { k - 10 } else { k });
    let found = kinds_of(&Rig { time: backwards, ..Rig::default() });
    assert_eq!(found, ["time_backwards", "time_backwards"]);
    // Two milliseconds to and fro, and a pause of 0.1 s.
    let jitter: fn(u64) -> Nanos =
        |k| Nanos(period(k).0 + k * 7919 % 2_000_000 + if 250 < k { 100_000_000 } else { 0 });
    assert_eq!(kinds_of(&Rig { time: jitter, ..Rig::default() }), [""; 0]);
}

#[test]
fn warnings_about_runs_commands_and_copies() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("odd.mcap");
    let mut made = writer(&path, "klasktron");
    let marker = |run, phase: Phase| RunMarker { run, phase: phase.into(), ..Default::default() };
    let command = topic::command(Player::Right);
    for (k, run, phase) in [(0, 1, Phase::Start), (1, 1, Phase::End), (5, 2, Phase::Start)] {
        made.write(topic::RUN_MARKER, period(k), &marker(run, phase)).unwrap();
    }
    made.write(topic::RUN_MARKER, period(6), &marker(7, Phase::End)).unwrap();
    for _ in 0..2 {
        made.write(&command, period(0), &VelocityCommand { vx: 0.1, vy: 0.1 }).unwrap();
    }
    made.finish().unwrap();
    let mut found = kinds(&path);
    found.sort();
    // Run 1 holds the copy as well, so it has two samples.
    let expected = ["duplicates", "no_excitation", "run_without_end", "run_without_start"];
    assert_eq!(found, expected);

    let path = dir.path().join("motion.mcap");
    let mut made = writer(&path, "klasktron");
    made.write(&topic::carriage(Player::Left), period(0), &CarriageState::default()).unwrap();
    made.finish().unwrap();
    assert_eq!(kinds(&path), ["no_commands"]);

    let path = dir.path().join("nothing.mcap");
    writer(&path, "klasktron").finish().unwrap();
    assert_eq!(kinds(&path), ["no_messages"]);
}

#[test]
fn a_run_with_one_sample_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("short.mcap");
    let mut made = writer(&path, "klasktron");
    for (k, phase) in [(0, Phase::Start), (1, Phase::End)] {
        let marker = RunMarker { run: 4, phase: phase.into(), ..Default::default() };
        made.write(topic::RUN_MARKER, period(k), &marker).unwrap();
    }
    let still = VelocityCommand::default();
    made.write(&topic::command(Player::Left), period(0), &still).unwrap();
    made.finish().unwrap();
    assert_eq!(kinds(&path), ["run_too_short"]);
}

#[test]
fn several_robots_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let one = Rig::default().write(dir.path(), "one.mcap");
    let two = Rig { robot: "other", ..Rig::default() }.write(dir.path(), "two.mcap");
    let document = document(&[&one, &two]);
    assert_eq!(document["warnings"][0]["kind"], "mixed_robots");
    assert_eq!(document["warnings"][0]["key"], "robot");
}

#[test]
fn any_mcap_file_is_described() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bag.mcap");
    let mut bag =
        RecordingWriter::with_profile(&path, "ros2", ExistingFile::Refuse, FlushPolicy::WhenFull)
            .unwrap();
    let schema = |name| RawSchema {
        name,
        encoding: "ros2msg",
        data: b"float64 data",
        message_encoding: "cdr",
        channel_metadata: const { &BTreeMap::new() },
    };
    for k in 0..3 {
        bag.write_raw("/a", &schema("std_msgs/msg/Float64"), [period(k); 2], &[0; 12]).unwrap();
    }
    bag.write_raw("/a", &schema("std_msgs/msg/Other"), [period(9); 2], &[]).unwrap();
    bag.finish().unwrap();
    assert_eq!(kinds(&path), ["several_schemas"]);
    let (stdout, _, status) = said(&klasktron(&["info", path.to_str().unwrap()]));
    assert_eq!(status, 0);
    assert!(stdout.contains("Float64") && stdout.contains("profile ros2"), "{stdout}");
}

#[test]
fn a_broken_file_among_good_ones_costs_itself_only() {
    let dir = tempfile::tempdir().unwrap();
    let good = Rig::default().write(dir.path(), "good.mcap");
    let empty = dir.path().join("empty.mcap");
    fs::write(&empty, b"").unwrap();
    let args = ["info", empty.to_str().unwrap(), good.to_str().unwrap(), "--json"];
    let (stdout, stderr, status) = said(&klasktron(&args));
    assert_eq!(status, 3);
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(stderr.contains("the file is empty"), "{stderr}");
    let document: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(document["files"].as_array().unwrap().len(), 1);
}

#[test]
fn what_cannot_be_read_is_one_sentence_and_status_1() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    fs::write(path("empty.mcap"), b"").unwrap();
    fs::write(path("text.mcap"), b"time,x\n0,1\n").unwrap();
    let mut wrong = writer(Path::new(&path("wrong.mcap")), "klasktron");
    wrong.write(&topic::command(Player::Left), period(0), &CarriageState::default()).unwrap();
    wrong.finish().unwrap();
    let expected = [
        ("empty.mcap", "the file is empty"),
        ("text.mcap", "not an MCAP file"),
        ("missing.mcap", "cannot open"),
        ("", "cannot read"),
        ("wrong.mcap", "topic /striker/left/command has schema 'klasktron.CarriageState"),
    ];
    for (name, reason) in expected {
        let (stdout, stderr, status) = said(&klasktron(&["info", &path(name)]));
        assert_eq!((status, stdout.as_str()), (1, ""), "{stderr}");
        assert!(stderr.contains(reason) && stderr.lines().count() == 1, "{stderr}");
    }
    let two = ["info", &path("empty.mcap"), &path("text.mcap")];
    assert_eq!(said(&klasktron(&two)).2, 1);
    assert_eq!(said(&klasktron(&["info"])).2, 2);
}

#[test]
fn a_cut_off_file_is_shown_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig::default().write(dir.path(), "good.mcap");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let (stdout, stderr, status) = said(&klasktron(&["info", path.to_str().unwrap()]));
    assert_eq!(status, 3);
    assert!(stderr.contains("klasktron recover") && stderr.lines().count() == 1, "{stderr}");
    assert!(stdout.contains("cut off at byte"), "{stdout}");
}
