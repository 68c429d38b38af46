//! The examples at the end of each `--help`: those that need no table and are done quickly are run. That all
//! of them parse is tested in the program itself (`src/cli/tests.rs`).

use crate::support::{klasktron, said};
use ::klasktron::twin::{Machine, Twin};
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};
use tempfile::TempDir;

/// Subcommands whose examples are run, each in a folder of its own, in which a later one reads what an earlier
/// one wrote.
const RUN: [&str; 12] = [
    "info",
    "recover",
    "import",
    "import csv",
    "import candump",
    "tune-ekf",
    "export",
    "collect",
    "play",
    "schema",
    "completions",
    "man",
];

/// What an example needs that a test has not: hardware, a pager, or minutes.
const LEFT_OUT: [&str; 6] =
    ["socketcan:", "replay:", "actuator/actuator.mcap", "| man", "--plan paper -o", "--live"];

fn examples(words: &str) -> Vec<String> {
    let line: Vec<&str> = words.split(' ').chain(["--help"]).collect();
    let (help, _, status) = said(&klasktron(&line));
    assert_eq!(status, 0);
    let help = help.replace("\\\n", " ");
    let behind = help.lines().skip_while(|line| !line.starts_with("Example"));
    let lines = behind.map(str::trim).filter(|line| line.starts_with("klasktron "));
    lines.map(ToOwned::to_owned).collect()
}

/// A folder with files by the names that the examples use; `play` writes match.mcap itself.
fn folder(words: &str) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let example = |name: &str| fs::read(data.join(format!("example-{name}.mcap"))).unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(dir.path().join(name), bytes).unwrap();
    let (train, validation) = (example("train"), example("validation"));
    for name in ["train.mcap", "monday.mcap"] {
        put(name, &train);
    }
    for name in ["validation.mcap", "tuesday.mcap"] {
        put(name, &validation);
    }
    if words != "play" {
        put("match.mcap", &example("match"));
    }
    put("cut.mcap", &train[..500_000]);
    put("axis.csv", b"t_s,force_n,position_m\n0,0,0\n0.01,1,0.001\n0.02,1,0.003\n");
    put("bench.csv", b"test,t,i,x\nup,0,9,0\nup,10,9,1\ndown,0,-9,1\ndown,10,-9,0\n");
    let log = "(1.000000) can0 009#0000000000000000\n(1.010000) can0 009#0000803F00000000\n";
    put("bus.log", log.as_bytes());
    fs::create_dir(dir.path().join("gap")).unwrap();
    put("gap/twin.json", Twin::nominal(Machine::Table).to_json().unwrap().as_bytes());
    dir
}

#[cfg(unix)]
#[test]
fn quick_examples_of_the_help_run() {
    let program = env!("CARGO_BIN_EXE_klasktron");
    let mut run = 0;
    for words in RUN {
        let dir = folder(words);
        for line in examples(words) {
            if LEFT_OUT.iter().any(|what| line.contains(what)) {
                continue;
            }
            let typed = line.replace("--seconds 60", "--seconds 5");
            let typed = typed.replace("klasktron ", &format!("{program} "));
            let mut command = Command::new("sh");
            command.args(["-c", &typed]).current_dir(dir.path()).stdin(Stdio::null());
            let (_, stderr, status) = said(&command.output().unwrap());
            let expected = if words == "recover" { 3 } else { 0 };
            assert_eq!(status, expected, "{line}: {stderr}");
            run += 1;
        }
    }
    assert!(14 <= run, "{run}");
}
