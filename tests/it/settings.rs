//! `klasktron.toml` beside the results that come of it. What each line of it turns into is tested in the
//! program itself (`src/cli/tests.rs`).

use crate::support::said;
use std::{fs, path::Path, process::Command};

/// Runs the program in `dir`.
fn run_in(dir: &Path, line: &str) -> (String, String, i32) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
    command.env_remove("RUST_LOG").current_dir(dir);
    said(&command.args(line.split_whitespace()).output().unwrap())
}

/// A folder with the example recordings.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for name in ["train", "validation"] {
        let from =
            Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/example-{name}.mcap"));
        fs::copy(from, dir.path().join(format!("{name}.mcap"))).unwrap();
    }
    dir
}

/// What came from the file is recorded as if it had been typed, so that the result can be made again without.
#[test]
fn settings_give_the_bytes_of_typed_options() {
    let dir = folder();
    let settings = "[fit-actuator]\nepochs = 2\nseeds = 1\nwidth = 8\nlearning-rate = 0.01\n";
    fs::write(dir.path().join("klasktron.toml"), settings).unwrap();
    let fit = "fit-actuator train.mcap validation.mcap";
    let (_, stderr, status) = run_in(dir.path(), &format!("{fit} --output set -v"));
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("klasktron.toml:2: --epochs=2"), "{stderr}");
    let typed = "--epochs 2 --seeds 1 --width 8 --learning-rate 0.01 --no-config --output typed -v";
    let (_, stderr, status) = run_in(dir.path(), &format!("{fit} {typed}"));
    assert_eq!(status, 0, "{stderr}");
    assert!(!stderr.contains("klasktron.toml"), "{stderr}");
    for file in ["actuator.mcap", "index.html"] {
        let read = |folder: &str| fs::read(dir.path().join(folder).join(file)).unwrap();
        assert!(read("set") == read("typed"), "{file} differs");
    }
    let page = fs::read_to_string(dir.path().join("set/index.html")).unwrap();
    assert!(page.contains("--epochs 2 ") && page.contains("--learning-rate 0.01 "));
}

#[test]
fn a_typed_option_wins_over_the_file() {
    let dir = folder();
    fs::write(dir.path().join("klasktron.toml"), "[train]\nseed = 7\nrandomize = true\n").unwrap();
    let seed = |line: &str| {
        let (stdout, stderr, status) =
            run_in(dir.path(), &format!("train --print-settings {line}"));
        assert_eq!(status, 0, "{stderr}");
        let settings: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        (settings["seed"].as_u64().unwrap(), settings["randomization"] != "off")
    };
    assert_eq!(seed(""), (7, true));
    assert_eq!(seed("--seed 3"), (3, true));
    assert_eq!(seed("--randomize=false"), (7, false));
    assert_eq!(seed("--no-config"), (0, false));
    fs::write(dir.path().join("other.toml"), "[train]\nseed = 9\n").unwrap();
    assert_eq!(seed("--config other.toml"), (9, false));
}

#[test]
fn a_wrong_file_is_wrong_usage_in_one_sentence() {
    let dir = folder();
    fs::write(dir.path().join("klasktron.toml"), "[train]\nsede = 7\n").unwrap();
    let (stdout, stderr, status) = run_in(dir.path(), "info train.mcap");
    assert_eq!((stdout.as_str(), status), ("", 2));
    assert_eq!(
        stderr,
        "error: klasktron.toml:2: [train] has no option `sede`; did you mean `seed`?\n"
    );
    assert_eq!(run_in(dir.path(), "info train.mcap --no-config").2, 0);
    let (_, stderr, status) = run_in(dir.path(), "info train.mcap --config missing.toml");
    assert!(
        stderr.starts_with("error: missing.toml: cannot read the settings") && status == 2,
        "{stderr}"
    );
    let (_, stderr, status) = run_in(dir.path(), "info train.mcap --config x --no-config");
    assert!(stderr.contains("cannot be used with") && status == 2, "{stderr}");
}

/// A mistake that only arises together with what was typed names the file, too.
#[test]
fn a_wrong_command_line_shows_what_the_file_added() {
    let dir = folder();
    fs::write(dir.path().join("klasktron.toml"), "[play]\nleft = \"chaser\"\n").unwrap();
    let (_, stderr, status) = run_in(dir.path(), "play");
    assert_eq!(status, 2);
    assert!(
        stderr.contains("--right") && stderr.contains("--left=chaser (klasktron.toml:2)"),
        "{stderr}"
    );
}

/// The steps of a demo are what its page shows, whatever file lies in its folder.
#[test]
fn a_demo_is_not_changed_by_a_file_in_its_own_folder() {
    let dir = tempfile::tempdir().unwrap();
    fs::create_dir(dir.path().join("demo")).unwrap();
    fs::write(dir.path().join("demo/klasktron.toml"), "nonsense").unwrap();
    fs::write(dir.path().join("demo/monday.mcap"), "").unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_klasktron"))
        .args(["demo", "--smallest"])
        .current_dir(dir.path())
        .stderr(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let record = dir.path().join("demo/steps/collect-monday.json");
    let begun = std::time::Instant::now();
    while !record.exists() && begun.elapsed().as_secs() < 60 {
        assert!(child.try_wait().unwrap().is_none(), "it has stopped at its first step");
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(record.exists());
}
