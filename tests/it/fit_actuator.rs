//! `klasktron fit-actuator` and the export of its weights, as a person runs them.

use crate::{
    drive::{DT, Drive},
    support::{Rig, klasktron, period, said, writer},
};
use klasktron::{
    actuator::{self, Layout, LayoutKind},
    recording::{
        Recording,
        message::{CarriageState, RunMarker, VelocityCommand, run_marker::Phase},
        topic::{self, Player},
    },
    units::Nanos,
};
use serde_json::Value;
use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::Duration,
};

const DRIVE: Drive = Drive { gain: 0.95, tau: 0.04, delay: 0.02, slew: 5.0 };

/// A recording of `runs` runs of [`DRIVE`].
fn record(dir: &Path, name: &str, runs: u32, split: &str) -> PathBuf {
    record_of(DRIVE, dir, name, runs, split)
}

fn record_of(drive: Drive, dir: &Path, name: &str, runs: u32, split: &str) -> PathBuf {
    let path = dir.join(name);
    let mut writer = writer(&path, "klasktron");
    for number in 0..runs {
        let run = drive.run(number + 100 * u32::from(split == "validation"), 250, None);
        let start = period(u64::from(number) * 300);
        let time = |k: usize| start.after_seconds(k as f64 * DT);
        let marker = |phase: Phase| RunMarker {
            run: number,
            pattern: run.pattern.clone(),
            phase: phase.into(),
            split: split.to_owned(),
        };
        writer.write(topic::RUN_MARKER, time(0), &marker(Phase::Start)).unwrap();
        for k in 0..run.len() {
            let [vx, vy] = run.commands[k];
            let command = VelocityCommand { vx, vy };
            writer.write(&topic::command(Player::Left), time(k), &command).unwrap();
            let [vx, vy] = run.velocities[k];
            let state = CarriageState { vx, vy, ..CarriageState::default() };
            writer.write(&topic::carriage(Player::Left), time(k), &state).unwrap();
        }
        writer.write(topic::RUN_MARKER, time(run.len()), &marker(Phase::End)).unwrap();
    }
    writer.finish().unwrap();
    path
}

fn pair(dir: &Path) -> [String; 2] {
    let train = record(dir, "train.mcap", 6, "train");
    let validation = record(dir, "validation.mcap", 2, "validation");
    [train, validation].map(|path| path.display().to_string())
}

/// Fits small networks; `more` options come last.
fn fit(files: &[String], out: &Path, more: &[&str]) -> (String, String, i32) {
    let out = out.display().to_string();
    let mut args = vec!["fit-actuator"];
    args.extend(files.iter().map(String::as_str));
    args.extend(["--output", &out, "--epochs", "20", "--width", "32", "--batch", "64"]);
    args.extend(more);
    said(&klasktron(&args))
}

#[test]
fn a_fit_writes_a_model_a_page_and_a_document() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let (stdout, stderr, status) = fit(&pair(dir.path()), &out, &["--seeds", "3", "--json"]);
    assert_eq!(status, 0, "{stderr}");
    let document: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(document["schema_version"], 2);
    assert_eq!(document["train"]["runs"], 6);
    assert_eq!(document["held_out"]["samples"], 500);
    assert_eq!(document["seeds"].as_array().unwrap().len(), 3);
    assert_eq!(document["inputs"][0]["sha256"].as_str().unwrap().len(), 64);
    for row in document["errors"].as_array().unwrap() {
        assert!(row["rmse_m_per_s"].as_f64().is_some_and(|error| 0.0 < error), "{row}");
    }
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("class=\"chart\"") && !page.contains("src=\"http"));
    let recording = Recording::open(&out.join("actuator.mcap")).unwrap();
    assert!(recording.loss.is_none());
    for topic in ["/actuator/measured", "/actuator/predicted/seed_2", "/actuator/predicted/arx"] {
        assert!(0 < recording.count(topic), "{topic}");
    }
    let stored = actuator::read_actuator(&recording).unwrap();
    assert_eq!(stored.weights.len(), 3);
    let layout = Layout { kind: LayoutKind::Klasktron, history_steps: 10 };
    assert_eq!(stored.model.layout, layout);
    assert!(stored.coverage.contains([0.1, 0.1], [0.1, 0.1]));
    assert!(!stored.coverage.contains([0.1, 0.1], [3.0, 0.1]), "far outside what was fitted");
}

#[test]
fn the_result_does_not_depend_on_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let files = pair(dir.path());
    let bytes = |threads: &str| {
        let out = dir.path().join(threads);
        let (_, stderr, status) = fit(&files, &out, &["--seeds", "3", "--threads", threads]);
        assert_eq!(status, 0, "{stderr}");
        ["actuator.mcap", "index.html"].map(|name| fs::read(out.join(name)).unwrap())
    };
    assert!(bytes("1") == bytes("3"), "the same seeds on 1 and on 3 threads differ");
}

#[test]
fn finished_fits_are_found_again() {
    let dir = tempfile::tempdir().unwrap();
    let (files, out) = (pair(dir.path()), dir.path().join("out"));
    fit(&files, &out, &["--seeds", "2"]);
    let kept = || {
        let mut times: Vec<_> = fs::read_dir(out.join("fits"))
            .unwrap()
            .map(|entry| entry.unwrap())
            .map(|entry| (entry.file_name(), entry.metadata().unwrap().modified().unwrap()))
            .collect();
        times.sort();
        times
    };
    let first = kept();
    assert_eq!(first.len(), 2);
    fit(&files, &out, &["--seeds", "3"]);
    let second = kept();
    assert_eq!(second.len(), 3);
    assert!(first.iter().all(|fit| second.contains(fit)), "a finished fit was made again");
}

#[test]
fn an_ablation_chooses_a_configuration() {
    let dir = tempfile::tempdir().unwrap();
    let more = ["--seeds", "1", "--epochs", "2", "--ablate", "--json"];
    let files = pair(dir.path());
    let out = dir.path().join("out").display().to_string();
    let mut args = vec!["fit-actuator", &files[0], &files[1], "--output", &out];
    args.extend(more);
    let (stdout, stderr, status) = said(&klasktron(&args));
    assert_eq!(status, 0, "{stderr}");
    let document: Value = serde_json::from_str(&stdout).unwrap();
    let ablation = &document["ablation"];
    assert_eq!(ablation["cells"].as_array().unwrap().len(), 9);
    let chosen = &ablation["cells"][ablation["chosen"].as_u64().unwrap() as usize];
    assert_eq!(chosen["width"], document["chosen"]["width"]);
    assert_eq!(chosen["history_steps"], document["chosen"]["history_steps"]);
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_what_is_finished_and_the_same_command_continues() {
    let dir = tempfile::tempdir().unwrap();
    let (files, out) = (pair(dir.path()), dir.path().join("out"));
    let out_text = out.display().to_string();
    // One quick seed, then seeds that take far longer than this test waits.
    fit(&files, &out, &["--seeds", "1"]);
    let quick = ["--epochs", "20", "--width", "32", "--batch", "64"];
    let mut child = Command::new(env!("CARGO_BIN_EXE_klasktron"))
        .args(["fit-actuator", &files[0], &files[1], "--output", &out_text, "--seeds", "400"])
        .args(["--threads", "1"])
        .args(quick)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    while fs::read_dir(out.join("fits")).unwrap().count() < 3 {
        thread::sleep(Duration::from_millis(5));
    }
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let status = child.wait().unwrap();
    let mut stderr = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut stderr).unwrap();
    assert_eq!(status.code(), Some(130), "{stderr}");
    assert!(
        stderr.contains("of 400 fits are finished; repeat the same command to continue"),
        "{stderr}"
    );
    let recording = Recording::open(&out.join("actuator.mcap")).unwrap();
    assert!(recording.loss.is_none());
    assert!(3 <= actuator::read_actuator(&recording).unwrap().weights.len());
}

#[test]
fn upstreams_layout_has_its_shapes_and_names() {
    let dir = tempfile::tempdir().unwrap();
    let (files, out) = (pair(dir.path()), dir.path().join("out"));
    let more = ["--layout", "klask-rl", "--seeds", "1", "--epochs", "2", "--width", "64"];
    let out_text = out.display().to_string();
    let mut args = vec!["fit-actuator", &files[0], &files[1], "--output", &out_text];
    args.extend(more);
    assert_eq!(said(&klasktron(&args)).2, 0);
    let weights = dir.path().join("weights.safetensors");
    let (file, to) = (out.join("actuator.mcap"), weights.display().to_string());
    let file = file.display().to_string();
    let export = |format: &str, to: &str| {
        said(&klasktron(&["export", &file, "--to", format, "--output", to, "--overwrite"]))
    };
    assert_eq!(export("safetensors", &to).2, 0);
    let bytes = fs::read(&weights).unwrap();
    let tensors = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    for (name, shape) in [
        ("fc1.weight", vec![64, 38]),
        ("fc2.weight", vec![64, 64]),
        ("fc3.weight", vec![64, 64]),
        ("fc_out.weight", vec![2, 64]),
        ("fc_out.bias", vec![2]),
    ] {
        assert_eq!(tensors.tensor(name).unwrap().shape(), shape, "{name}");
    }
    for format in ["onnx", "torchscript", "npz"] {
        let (_, stderr, status) = export(format, &to);
        assert_eq!(status, 0, "{format}: {stderr}");
    }
    let (_, stderr, status) =
        said(&klasktron(&["export", &files[0], "--to", "onnx", "--output", &to, "--overwrite"]));
    assert_eq!(status, 1);
    assert!(stderr.contains("no actuator model in this file"), "{stderr}");
}

/// The one sentence with which a fit to `files` fails.
fn refusal(files: &[&Path]) -> String {
    let dir = tempfile::tempdir().unwrap();
    let files: Vec<String> = files.iter().map(|path| path.display().to_string()).collect();
    let out = dir.path().join("out");
    let (stdout, stderr, status) = fit(&files, &out, &["--seeds", "1"]);
    assert_eq!((stdout.as_str(), status), ("", 1), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(!out.join("actuator.mcap").exists());
    stderr
}

fn expect(sentence: &str, parts: &[&str]) {
    for part in parts {
        assert!(sentence.contains(part), "'{part}' is not in: {sentence}");
    }
}

#[test]
fn bad_inputs_end_in_one_sentence_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("empty.mcap"), b"").unwrap();
    expect(&refusal(&[&at("empty.mcap")]), &["empty.mcap", "the file is empty"]);
    fs::write(at("text.mcap"), b"not an mcap file").unwrap();
    expect(&refusal(&[&at("text.mcap")]), &["not an MCAP file", "klasktron import"]);
    expect(&refusal(&[&at("absent.mcap")]), &["absent.mcap", "cannot open"]);

    let still: fn(usize, CarriageState) -> Option<CarriageState> =
        |_, _| Some(CarriageState::default());
    let nan: fn(usize, CarriageState) -> Option<CarriageState> =
        |k, state| Some(if k == 7 { CarriageState { vy: f64::NAN, ..state } } else { state });
    let rig = |carriage| Rig { carriage, ..Rig::default() };
    let stuck = rig(still).write(dir.path(), "stuck.mcap");
    expect(&refusal(&[&stuck]), &["/striker/left/carriage never changes", "motors were armed"]);
    let broken = rig(nan).write(dir.path(), "nan.mcap");
    expect(&refusal(&[&broken]), &["/striker/left/carriage, message 7: vy is NaN"]);
    let unmeasured = rig(|_, _| None).write(dir.path(), "unmeasured.mcap");
    expect(
        &refusal(&[&unmeasured]),
        &["no messages on /striker/left/carriage", "/striker/left/command"],
    );

    let backwards: fn(u64) -> Nanos = |k| if k == 40 { period(30) } else { period(k) };
    let back = Rig { time: backwards, ..Rig::default() }.write(dir.path(), "back.mcap");
    expect(&refusal(&[&back]), &["time runs backwards on /striker/left/command at message 40"]);

    let one = Rig::default().write(dir.path(), "one.mcap");
    expect(&refusal(&[&one]), &["all the data is one run", "whole runs are held out"]);
    let short = Rig { seconds: 0, ..Rig::default() }.write(dir.path(), "short.mcap");
    expect(&refusal(&[&short]), &["short.mcap"]);

    let other = Rig { robot: "another", ..Rig::default() }.write(dir.path(), "other.mcap");
    expect(
        &refusal(&[&one, &other]),
        &["robot=klasktron", "robot=another", "each robot on its own"],
    );
    let single = record_of(DRIVE, dir.path(), "single.mcap", 3, "train");
    let twice = Drive { gain: 2.0 * DRIVE.gain, ..DRIVE };
    let doubled = record_of(twice, dir.path(), "doubled.mcap", 3, "train");
    let sentence = refusal(&[&single, &doubled]);
    expect(&sentence, &["single.mcap moves at 0.", "times its command", "fit each on its own"]);
    let judged = record(dir.path(), "judged.mcap", 2, "validation");
    expect(&refusal(&[&judged]), &["all 2 runs are marked split=validation"]);
}

#[test]
fn a_cut_off_recording_is_used_as_far_as_it_goes_with_status_3() {
    let dir = tempfile::tempdir().unwrap();
    let [train, validation] = pair(dir.path());
    let bytes = fs::read(&train).unwrap();
    fs::write(&train, &bytes[..bytes.len() / 2]).unwrap();
    let (_, stderr, status) = fit(&[train, validation], &dir.path().join("out"), &["--seeds", "1"]);
    assert_eq!(status, 3, "{stderr}");
    expect(&stderr, &["train.mcap: cut off at byte", "the readable part was used"]);
}

#[test]
fn a_recording_given_twice_counts_once() {
    let dir = tempfile::tempdir().unwrap();
    let [train, validation] = pair(dir.path());
    let copy = dir.path().join("copy.mcap");
    fs::copy(&train, &copy).unwrap();
    let files = [train, copy.display().to_string(), validation];
    let more = ["--seeds", "1", "--json"];
    let (stdout, stderr, status) = fit(&files, &dir.path().join("out"), &more);
    assert_eq!(status, 0, "{stderr}");
    expect(&stderr, &["copy.mcap has the same bytes as train.mcap and was skipped"]);
    let document: Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(document["train"]["runs"], 6);
}

#[test]
fn wrong_usage_names_the_option_and_the_range() {
    for (args, part) in [
        (["fit-actuator", "x.mcap", "--epochs", "0"], "whole number from 1 to"),
        (["fit-actuator", "x.mcap", "--learning-rate", "-1"], "a number above 0"),
        (["fit-actuator", "x.mcap", "--layout", "upstream"], "klask-rl"),
    ] {
        let (_, stderr, status) = said(&klasktron(&args));
        assert_eq!(status, 2, "{stderr}");
        expect(&stderr, &[part]);
    }
}
