//! The program: files, flags, refusals.

use super::support::{settings_file, tiny};
use crate::support::{Rig, klasktron, said};
use klasktron::{
    effects::{Axis, find},
    opponent::Scripted,
    recording::{Recording, message::TrainingUpdate},
    train::{TrainSettings, UPDATE_TOPIC, read_policy},
    twin::{Instance, Machine, Source, Twin},
};
use prost::Message;
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
    thread,
    time::Duration,
};

/// Trains with `settings` into `out`, with further `flags`.
fn train(settings: &Path, out: &Path, flags: &[&str]) -> (String, String, i32) {
    let (settings, out) = (settings.display().to_string(), out.display().to_string());
    let mut args = vec!["train", "--settings", &settings, "--output", &out];
    args.extend(flags);
    said(&klasktron(&args))
}

#[test]
fn a_resumed_run_is_the_uninterrupted_one_byte_for_byte() {
    let dir = tempfile::tempdir().unwrap();
    let settings = settings_file(dir.path(), &tiny());
    let [whole, parts] = ["whole", "parts"].map(|name| dir.path().join(name));
    let (text, errors, status) = train(&settings, &whole, &["--threads", "2"]);
    assert_eq!(status, 0, "{errors}");
    assert!(text.contains("steps per second: physics"), "{text}");
    // Ends in the middle between two checkpoints: update 3 is done again.
    let three = (3 * tiny().transitions_per_update()).to_string();
    assert_eq!(train(&settings, &parts, &["--steps", &three]).2, 0);
    let half = Recording::open(&parts.join("policy.mcap")).unwrap();
    assert_eq!(half.count(UPDATE_TOPIC), 3);
    let (_, errors, status) = train(&settings, &parts, &["--resume", "--threads", "1"]);
    assert_eq!(status, 0, "{errors}");
    for name in ["policy.mcap", "index.html", "curve.parquet"] {
        let [a, b] = [&whole, &parts].map(|folder| fs::read(folder.join(name)).unwrap());
        assert!(a == b, "{name} differs: {} and {} bytes", a.len(), b.len());
    }
    // Once more, with nothing left to do.
    assert_eq!(train(&settings, &parts, &["--resume"]).2, 0);
    let [a, b] = [&whole, &parts].map(|folder| fs::read(folder.join("policy.mcap")).unwrap());
    assert!(a == b);
}

#[test]
fn with_more_steps_a_finished_run_learns_on() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("policy");
    let run = |steps: &str, more: &[&str]| {
        let output = out.to_str().unwrap();
        let fixed = ["train", "--envs", "32", "--hidden", "8", "--games", "0", "--output", output];
        let (_, errors, status) =
            said(&klasktron(&[&fixed[..], &["--steps", steps], more].concat()));
        assert_eq!(status, 0, "{errors}");
        let recording = Recording::open(&out.join("policy.mcap")).unwrap();
        recording.series::<TrainingUpdate>(UPDATE_TOPIC).unwrap().values
    };
    // Two updates, then two more: the rate of the longer run at half of its way.
    assert_eq!(run("2048", &[]).len(), 2);
    let curve = run("4096", &["--resume"]);
    let rates: Vec<f32> = curve.iter().map(|update| update.learning_rate).collect();
    assert_eq!(rates.len(), 4);
    assert!((rates[2] / rates[0] - 0.5).abs() < 1e-6, "{rates:?}");
}

#[test]
fn the_file_holds_curve_weights_and_games_that_eval_reads() {
    let dir = tempfile::tempdir().unwrap();
    let settings = settings_file(dir.path(), &tiny());
    let out = dir.path().join("p/tiny.mcap");
    let events = dir.path().join("events");
    let flags = ["--json", "--tensorboard", &events.display().to_string()];
    let (text, errors, status) = train(&settings, &out, &flags);
    assert_eq!(status, 0, "{errors}");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["finished"], true);
    assert_eq!(json["evaluation"]["opponents"].as_array().unwrap().len(), Scripted::ALL.len());
    let shares = json["time_shares"].as_object().unwrap();
    let sum: f64 = shares.values().filter_map(serde_json::Value::as_f64).sum();
    assert!((sum - 1.0).abs() < 1e-6, "{shares:?}");
    let recording = Recording::open(&out).unwrap();
    let curve = recording.series::<TrainingUpdate>(UPDATE_TOPIC).unwrap().values;
    assert_eq!(curve.iter().map(|point| point.update).collect::<Vec<_>>(), [1, 2, 3, 4, 5, 6]);
    let stored = read_policy(&recording).unwrap();
    assert_eq!((stored.policy.network().inputs(), stored.action_scale_m_per_s), (37, 0.4));
    assert!(recording.attachment("policy.onnx").is_some());
    assert!(out.with_extension("html").exists());
    check_events(&events, &curve);
    let scores = dir.path().join("eval");
    let eval = ["eval", &out.display().to_string(), "--output", &scores.display().to_string()];
    let (_, errors, status) = said(&klasktron(&eval));
    assert_eq!(status, 0, "{errors}");
    let score: serde_json::Value =
        serde_json::from_slice(&fs::read(scores.join("score.json")).unwrap()).unwrap();
    assert!(score.to_string().contains("episodes"), "{score}");
}

/// `Event`, `Summary` and `Value` of TensorBoard, as far as this reader needs them.
#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(string, optional, tag = "3")]
    file_version: Option<String>,
    #[prost(message, optional, tag = "5")]
    summary: Option<Summary>,
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    values: Vec<Value>,
}

#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, tag = "2")]
    simple_value: f32,
}

fn check_events(folder: &Path, curve: &[TrainingUpdate]) {
    let files: Vec<_> = fs::read_dir(folder).unwrap().map(|file| file.unwrap().path()).collect();
    assert_eq!(files.len(), 1);
    assert!(files[0].to_string_lossy().contains("tfevents"));
    let bytes = fs::read(&files[0]).unwrap();
    let mut rest = bytes.as_slice();
    let mut events = Vec::new();
    while !rest.is_empty() {
        let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
        events.push(Event::decode(&rest[12..12 + length]).unwrap());
        rest = &rest[12 + length + 4..];
    }
    assert_eq!(events[0].file_version.as_deref(), Some("brain.Event:2"));
    assert_eq!(events.len(), curve.len() + 1);
    for (event, point) in events[1..].iter().zip(curve) {
        assert_eq!(event.step as u64, point.transitions);
        let values = &event.summary.as_ref().unwrap().values;
        let find = |tag: &str| values.iter().find(|value| value.tag == tag).unwrap().simple_value;
        assert_eq!(find("play/elo"), point.elo as f32);
        assert_eq!(find("losses/value"), point.value_loss as f32);
    }
}

#[test]
fn what_does_not_belong_together_is_refused_with_both_values() {
    let dir = tempfile::tempdir().unwrap();
    let settings = settings_file(dir.path(), &tiny());
    let out = dir.path().join("out");
    let one = tiny().transitions_per_update().to_string();
    assert_eq!(train(&settings, &out, &["--steps", &one]).2, 0);
    let (_, errors, status) = train(&settings, &out, &["--steps", &one]);
    assert_eq!(status, 1);
    assert!(errors.contains("exists already; continue with --resume"), "{errors}");
    let (_, errors, status) = train(&settings, &out, &["--resume", "--seed", "9"]);
    assert_eq!(status, 1);
    assert!(errors.contains("seed is 7, but this command has 9"), "{errors}");
    let (_, errors, status) = train(&settings, &out, &["--resume", "--hidden", "4,4"]);
    assert_eq!(status, 1);
    assert!(errors.contains("ppo.hidden is [8], but this command has [4,4]"), "{errors}");
    let file = out.join("policy.mcap");
    let recording = tests_data("example-match.mcap");
    fs::copy(recording, &file).unwrap();
    let (_, errors, status) = train(&settings, &out, &["--resume"]);
    assert_eq!(status, 1);
    assert!(errors.contains("no policy in this file"), "{errors}");
    fs::write(&file, b"not an mcap").unwrap();
    assert_eq!(train(&settings, &out, &["--resume"]).2, 1);
}

fn tests_data(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

#[test]
fn typos_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = settings_file(dir.path(), &tiny());
    let out = dir.path().join("out");
    for flags in [["--stepz", "5"], ["--opponents", "chasr"], ["--steps", "1.5"]] {
        let (_, errors, status) = train(&path, &out, &flags);
        assert_eq!(status, 2, "{errors}");
        assert!(errors.contains(flags[1]) || errors.contains(flags[0]), "{errors}");
    }
    let (_, errors, status) = train(&path, &out, &["--actuator", "idael"]);
    assert_eq!(status, 1);
    assert!(errors.contains("an actuator is 'ideal', a twin.json"), "{errors}");
    let text = fs::read_to_string(&path).unwrap().replace("gamma", "gama");
    fs::write(&path, text).unwrap();
    let (_, errors, status) = train(&path, &out, &[]);
    assert_eq!(status, 1);
    assert!(errors.contains("unknown field `gama`"), "{errors}");
    assert!(errors.contains("--print-settings"), "{errors}");
    assert!(!out.exists());
    let (text, _, status) =
        said(&klasktron(&["train", "--preset", "upstream", "--print-settings"]));
    assert_eq!(status, 0);
    let settings: TrainSettings = serde_json::from_str(&text).unwrap();
    assert_eq!(settings.ppo.hidden, [256, 128, 64]);
}

/// A twin has sensors, so training uses them unless it is told not to.
#[test]
fn a_twin_implies_camera_and_estimator() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("twin.json");
    let mut twin = Twin::nominal(Machine::Table);
    let latency = find("sensor.camera_latency").unwrap();
    twin.instances.push(Instance::new(latency, Axis::Whole, &[0.014], Source::Nominal));
    fs::write(&file, twin.to_json().unwrap()).unwrap();
    let sensors = |more: &[&str]| -> serde_json::Value {
        let (stdout, errors, status) =
            said(&klasktron(&[&["train", "--print-settings"], more].concat()));
        assert_eq!(status, 0, "{errors}");
        serde_json::from_str::<serde_json::Value>(&stdout).unwrap()["sensors"].clone()
    };
    let file = file.to_str().unwrap();
    let own = sensors(&["--actuator", file]);
    assert_eq!((&own["latency_s"], &own["filter"]["latency_s"]), (&0.014.into(), &0.014.into()));
    assert!(sensors(&["--actuator", file, "--no-sensors"]).is_null());
    assert!(sensors(&[]).is_null());
}

#[test]
fn numbers_that_are_none_stop_training_and_the_checkpoint_is_kept() {
    let dir = tempfile::tempdir().unwrap();
    let mut settings = tiny();
    settings.ppo.learning_rate = 1e38;
    settings.ppo.max_gradient_norm = None;
    let path = settings_file(dir.path(), &settings);
    let out = dir.path().join("out");
    let (_, errors, status) = train(&path, &out, &[]);
    assert_eq!(status, 1);
    for part in ["not finite", "seed 7", "transitions", "policy.mcap", "lower learning_rate"] {
        assert!(errors.contains(part), "{part}: {errors}");
    }
    assert_eq!(errors.trim().lines().count(), 1, "{errors}");
    let kept = read_policy(&Recording::open(&out.join("policy.mcap")).unwrap()).unwrap();
    let weights = kept.policy.network().layers.iter().flat_map(|layer| &layer.weight);
    assert!(weights.clone().all(|weight| weight.is_finite()));
}

#[test]
fn a_fitted_actuator_must_have_the_rate_of_the_game_and_its_guesses_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let recording = Rig::default().write(dir.path(), "a.mcap").display().to_string();
    let other = Rig { seconds: 12, ..Rig::default() };
    let other = other.write(dir.path(), "b.mcap").display().to_string();
    let fit = |name: &str, rate: &str| {
        let out = dir.path().join(name).display().to_string();
        let mut args = vec!["fit-actuator", &recording, &other, "--output", &out];
        args.extend(["--epochs", "1", "--seeds", "1", "--width", "4", "--hidden-layers", "1"]);
        args.extend(["--history", "2", "--rate-hz", rate]);
        let output = said(&klasktron(&args));
        assert_eq!(output.2, 0, "{}", output.1);
        format!("{out}/actuator.mcap")
    };
    let mut settings = tiny();
    settings.steps = settings.transitions_per_update();
    let path = settings_file(dir.path(), &settings);
    let slow = fit("slow", "25");
    let (_, errors, status) = train(&path, &dir.path().join("p"), &["--actuator", &slow]);
    assert_eq!(status, 1);
    assert!(errors.contains("the rate is 25 Hz, but the game has 50 Hz"), "{errors}");
    let fitted = fit("fitted", "50");
    let flags = ["--actuator", &fitted, "--json"];
    let (text, errors, status) = train(&path, &dir.path().join("p"), &flags);
    assert_eq!(status, 0, "{errors}");
    // The rig was driven with at most 0.2 m/s, the policy drives with up to 0.4 m/s.
    assert!(errors.contains("far from its training data"), "{errors}");
    let json: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(json["actuator_queries"]["total"], 2 * 16 * 32);
    assert!(0.1 < json["actuator_extrapolation_fraction"].as_f64().unwrap(), "{text}");
    let (_, errors, status) = train(&path, &dir.path().join("p"), &["--resume"]);
    assert_eq!(status, 1);
    assert!(errors.contains("actuator is learned, but this command has ideal"), "{errors}");
}

#[cfg(unix)]
#[test]
fn ctrl_c_leaves_a_whole_file_and_resume_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let path = settings_file(dir.path(), &tiny()).display().to_string();
    let out = dir.path().join("out");
    let mut child = Command::new(env!("CARGO_BIN_EXE_klasktron"))
        .args(["train", "--settings", &path, "--steps", "1e12", "--output"])
        .arg(&out)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let file = out.join("policy.mcap");
    while !file.exists() && child.try_wait().unwrap().is_none() {
        thread::sleep(Duration::from_millis(20));
    }
    let id = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    let errors = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(130), "{errors}");
    assert!(errors.contains("the same command with --resume continues"), "{errors}");
    let done = Recording::open(&file).unwrap().count(UPDATE_TOPIC) as u64;
    let steps = ((done + 1) * tiny().transitions_per_update()).to_string();
    let [resumed, whole] = [out, dir.path().join("whole")];
    let path = Path::new(&path);
    assert_eq!(train(path, &resumed, &["--resume", "--steps", &steps]).2, 0);
    assert_eq!(train(path, &whole, &["--steps", &steps]).2, 0);
    let [a, b] = [&resumed, &whole].map(|folder| fs::read(folder.join("policy.mcap")).unwrap());
    assert!(a == b, "{done} updates before the interruption");
}

#[test]
fn training_on_a_virtual_rig_repeats_itself_on_any_threads_and_resumes() {
    let dir = tempfile::tempdir().unwrap();
    let mut small = tiny();
    small.environments = 8;
    small.steps = 4 * small.transitions_per_update();
    let settings = settings_file(dir.path(), &small);
    let rig = dir.path().join("rig.json");
    fs::write(&rig, r#"{"ball": {"start": {"y_m": -0.065}, "put_back_still_after_s": 2.0}}"#)
        .unwrap();
    let rig = rig.to_str().unwrap();
    let policies = ["1", "2"].map(|threads| {
        let out = dir.path().join(threads);
        let (_, errors, status) = train(&settings, &out, &["--rig", rig, "--threads", threads]);
        assert_eq!(status, 0, "{errors}");
        fs::read(out.join("policy.mcap")).unwrap()
    });
    assert!(policies[0] == policies[1]);
    let simulated = dir.path().join("simulated");
    assert_eq!(train(&settings, &simulated, &[]).2, 0);
    assert!(policies[0] != fs::read(simulated.join("policy.mcap")).unwrap());

    // A rig cannot be saved: the resumed run begins new episodes and ends with all updates.
    let more = (6 * small.transitions_per_update()).to_string();
    let out = dir.path().join("1");
    let resumed = ["--rig", rig, "--resume", "--steps", &more];
    let (_, errors, status) = train(&settings, &out, &resumed);
    assert_eq!(status, 0, "{errors}");
    assert_eq!(Recording::open(&out.join("policy.mcap")).unwrap().count(UPDATE_TOPIC), 6);
    // Continuing in a simulation is another training.
    let (_, errors, status) = train(&settings, &out, &["--resume", "--steps", &more]);
    assert_eq!(status, 1);
    assert!(errors.contains("virtual_rig"), "{errors}");
}

#[test]
fn a_rig_that_cannot_be_trained_on_is_refused_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let settings = settings_file(dir.path(), &tiny());
    let out = dir.path().join("policy");
    for (text, want) in [
        (r#"{"ball": {"put_back_after_s": 0.0}}"#, "ball.put_back_after_s of the rig file is 0"),
        (r#"{"ball": {"start": null}}"#, "no ball.start"),
        (r#"{"balls": 2}"#, "balls"),
        (
            r#"{"ball": {"put_back_still_after_s": 1.0}, "camera": {"drop_fraction": 1.0}}"#,
            "the rig of environment 0: ",
        ),
    ] {
        let rig = dir.path().join("rig.json");
        fs::write(&rig, text).unwrap();
        let (_, errors, status) = train(&settings, &out, &["--rig", rig.to_str().unwrap()]);
        assert_eq!(status, 1, "{text}: {errors}");
        assert!(errors.contains(want), "{text}: {errors}");
        assert!(!out.join("policy.mcap").exists(), "{text}");
    }
    let (_, errors, status) = train(&settings, &out, &["--rig", "rig.json", "--no-sensors"]);
    assert_eq!(status, 2, "{errors}");
}
