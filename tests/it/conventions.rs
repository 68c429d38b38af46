//! Conventions of all commands: existing results, Ctrl-C, environment variables, and one sentence for each mistake.

use crate::support::{klasktron, said};
use std::{
    fs,
    path::Path,
    process::Command,
    time::{Duration, Instant},
};
#[cfg(target_os = "linux")]
use std::{process::Stdio, thread};

const TRAIN: &str = "tests/data/example-train.mcap";
const VALIDATION: &str = "tests/data/example-validation.mcap";
const MATCH: &str = "tests/data/example-match.mcap";

#[test]
fn existing_results_are_refused_before_any_work_and_stay_as_they_are() {
    let dir = tempfile::tempdir().unwrap();
    let cases: [(&[&str], &str); 9] = [
        (&["gap", TRAIN, VALIDATION], "gap.json"),
        (&["calibrate", TRAIN, VALIDATION], ""),
        (&["tune-ekf", TRAIN, VALIDATION], "ekf.json"),
        (&["eval", MATCH], "score.json"),
        (&["train", "--games", "0"], "policy.mcap"),
        (&["export", TRAIN, "--to", "csv", "--topic", "/striker/left/command"], ""),
        (&["recover", TRAIN], ""),
        (&["man"], "klasktron-gap.1"),
        (&["import", "bag", TRAIN], ""),
    ];
    for (number, (words, name)) in cases.into_iter().enumerate() {
        let output = dir.path().join(number.to_string());
        let existing = if name.is_empty() { output.clone() } else { output.join(name) };
        fs::create_dir_all(existing.parent().unwrap()).unwrap();
        fs::write(&existing, "precious").unwrap();
        let begun = Instant::now();
        let typed = [words, &["-o", output.to_str().unwrap()]].concat();
        let (stdout, stderr, status) = said(&klasktron(&typed));
        assert_eq!((stdout.as_str(), status), ("", 1), "{words:?}: {stderr}");
        assert!(stderr.contains("exists already"), "{words:?}: {stderr}");
        assert!(stderr.contains("--overwrite"), "{words:?}: {stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
        assert!(begun.elapsed() < Duration::from_secs(20), "{words:?}");
        assert_eq!(fs::read_to_string(&existing).unwrap(), "precious");
        if !name.is_empty() {
            assert_eq!(fs::read_dir(&output).unwrap().count(), 1, "{words:?}");
        }
    }
}

#[test]
fn overwrite_replaces_all_results() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out");
    let words = ["eval", MATCH, "-o", output.to_str().unwrap()];
    assert_eq!(said(&klasktron(&words)).2, 0);
    let page = fs::read(output.join("index.html")).unwrap();
    fs::write(output.join("index.html"), "old").unwrap();
    let (_, stderr, status) = said(&klasktron(&words));
    assert!(status == 1 && stderr.contains("holds score.json, events.mcap,"), "{stderr}");
    // The old name of the option.
    let words = ["eval", MATCH, "--out", output.to_str().unwrap(), "--overwrite"];
    assert_eq!(said(&klasktron(&words)).2, 0);
    assert!(fs::read(output.join("index.html")).unwrap() == page);
    assert_eq!(fs::read_dir(&output).unwrap().count(), 5);
}

#[test]
fn a_folder_and_a_file_are_not_confused() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    let (folder, file) = (dir.path().to_str().unwrap(), file.to_str().unwrap());
    for (words, expected) in [
        (
            [&["calibrate", TRAIN, "-o"][..], &[folder]].concat(),
            "is a folder; --output takes a file",
        ),
        (
            [&["gap", TRAIN, VALIDATION, "-o"][..], &[file]].concat(),
            "is a file; --output takes a folder",
        ),
    ] {
        let (_, stderr, status) = said(&klasktron(&words));
        assert!(status == 1 && stderr.contains(expected), "{stderr}");
    }
}

/// Run the program and press Ctrl-C when `is_running` holds; returns standard error and status.
#[cfg(target_os = "linux")]
fn interrupted(words: &[&str], is_running: impl Fn() -> bool) -> (String, Option<i32>) {
    // The program respects signals that its parent ignores, as those of background jobs and of nohup.
    let mut command = Command::new("env");
    command.args(["--default-signal=INT,TERM,HUP", env!("CARGO_BIN_EXE_klasktron")]);
    let piped = command.args(words).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = piped.spawn().unwrap();
    let begun = Instant::now();
    while !is_running() && child.try_wait().unwrap().is_none() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{words:?} does not begin");
        thread::sleep(Duration::from_millis(5));
    }
    let pid = child.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let output = child.wait_with_output().unwrap();
    (String::from_utf8(output.stderr).unwrap(), output.status.code())
}

#[cfg(target_os = "linux")]
#[test]
fn ctrl_c_ends_with_130_a_sentence_and_no_half_written_result() {
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("out");
    let words = ["gap", TRAIN, VALIDATION, "-q", "-o", output.to_str().unwrap()];
    let (stderr, status) = interrupted(&words, || output.exists());
    assert_eq!(status, Some(130), "{stderr}");
    assert_eq!(stderr.trim_end().lines().last(), Some("interrupted; nothing was written"));
    let left = || fs::read_dir(&output).map_or(0, Iterator::count);
    assert_eq!(left(), 0);
}

#[test]
fn a_typed_option_wins_over_the_environment_and_that_over_the_file() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["typed", "environment", "file"] {
        let robot = format!("{{\"name\": \"{name}\"}}");
        fs::write(dir.path().join(format!("{name}.json")), robot).unwrap();
    }
    let settings = "[collect]\nrobot = \"file.json\"\n";
    fs::write(dir.path().join("klasktron.toml"), settings).unwrap();
    let name = |variable: Option<&str>, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
        command.current_dir(dir.path()).args(["collect", "--print-robot"]).args(more);
        command.env_remove("KLASKTRON_ROBOT");
        command.envs(variable.map(|value| ("KLASKTRON_ROBOT", value)));
        let (stdout, stderr, status) = said(&command.output().unwrap());
        assert_eq!(status, 0, "{stderr}");
        let robot: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        robot["name"].as_str().unwrap().to_owned()
    };
    assert_eq!(name(None, &[]), "file");
    assert_eq!(name(Some("environment.json"), &[]), "environment");
    assert_eq!(name(Some("environment.json"), &["--robot", "typed.json"]), "typed");
    assert_ne!(name(None, &["--no-config"]), "file");
}

#[test]
fn a_wrong_environment_variable_is_named() {
    let collect = |variable: (&str, &str), more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
        command.args(["collect", "--pattern", "circle"]).args(more).envs([variable]);
        said(&command.output().unwrap())
    };
    let (_, stderr, status) = collect(("KLASKTRON_BUS", "can0"), &[]);
    assert_eq!(status, 2, "{stderr}");
    assert!(stderr.contains("--bus=can0 (KLASKTRON_BUS)"), "{stderr}");
    // The camera of the real table does not disturb the virtual one; a typed one is a mistake.
    let dir = tempfile::tempdir().unwrap();
    let output = dir.path().join("a.mcap");
    let quick = ["--seconds", "1", "--speed", "max", "-o", output.to_str().unwrap()];
    let camera = ("KLASKTRON_CAMERA", "udp:127.0.0.1:9870");
    let (_, stderr, status) = collect(camera, &quick);
    assert_eq!(status, 0, "{stderr}");
    assert!(Path::new(&output).exists());
    let typed = [&quick[..], &["--overwrite", "--camera", "udp:127.0.0.1:1"]].concat();
    let (_, stderr, status) = collect(camera, &typed);
    assert!(status == 1 && stderr.contains("omit --camera"), "{stderr}");
}
