//! What the README and the contract's page say must hold.

use klasktron::recording::topic::schema_of;
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// Lines that a person is told to type, in order, without those of cargo.
fn typed(readme: &str) -> Vec<&str> {
    readme
        .lines()
        .filter_map(|line| line.strip_prefix("$ "))
        .filter(|line| !line.starts_with("cargo test"))
        .collect()
}

#[cfg(unix)]
#[test]
fn every_command_of_the_readme_works() {
    let readme = fs::read_to_string(root().join("README.md")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("tests/data");
    fs::create_dir_all(&data).unwrap();
    for entry in fs::read_dir(root().join("tests/data")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), data.join(entry.file_name())).unwrap();
    }
    let program = env!("CARGO_BIN_EXE_klasktron");
    let commands = typed(&readme);
    assert!(5 <= commands.len(), "{commands:?}");
    for line in commands {
        // The installed name stands for the program under test, and few epochs and steps for many.
        let run = line
            .replace("cargo run --release --", "klasktron")
            .replace("klasktron ", &format!("{program} "))
            .replace("--epochs 300", "--epochs 3")
            .replace("demo --quick", "demo --help")
            .replace("train --steps 20e6", "train --steps 500 --envs 16 --hidden 8 --games 0");
        let status = Command::new("sh")
            .args(["-c", &run])
            .current_dir(dir.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status()
            .unwrap();
        let expected = if line.contains("recover") { 3 } else { 0 };
        assert_eq!(status.code(), Some(expected), "{line}");
    }
}

#[test]
fn the_contracts_table_names_the_schema_of_every_topic() {
    let page = fs::read_to_string(root().join("datasets_schema/README.md")).unwrap();
    let mut checked = 0;
    for line in page.lines().filter(|line| line.starts_with("| `/")) {
        let cells: Vec<&str> = line.split(" | ").collect();
        let schema = cells[1].trim_matches('`');
        for topic in cells[0].trim_start_matches("| ").split(", ") {
            let topic = topic.trim_matches('`').replace("{left,right}", "left");
            let topic = topic.replace("{a,b}", "a").replace("{name}", "slide");
            if topic.starts_with("/truth") {
                continue;
            }
            assert_eq!(schema_of(&topic), Some(format!("klasktron.{schema}").as_str()), "{topic}");
            checked += 1;
        }
    }
    assert!(11 <= checked, "{checked}");
}
