//! What a person sees: version, colours, notes, logs.

use crate::support::said;
use klasktron::provenance::{CRATE_VERSION, GIT_HASH};
use std::{
    path::Path,
    process::{Command, Output},
};

const EXAMPLE: &str = "tests/data/example-validation.mcap";

fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
    command.env_remove("RUST_LOG").env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
    command
}

fn run(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}

/// A recording that ends early: every command that reads it has something to say.
fn cut_file(dir: &Path) -> String {
    let bytes = std::fs::read("tests/data/example-train.mcap").unwrap();
    let path = dir.join("cut.mcap");
    std::fs::write(&path, &bytes[..500_000]).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn the_version_names_the_commit() {
    let (stdout, _, status) = said(&run(&["--version"]));
    let expected = match GIT_HASH {
        "unknown" => format!("klasktron {CRATE_VERSION}\n"),
        hash => format!("klasktron {CRATE_VERSION} ({hash})\n"),
    };
    assert_eq!((stdout.as_str(), status), (expected.as_str(), 0));
}

#[test]
fn colours_are_used_where_they_are_asked_for() {
    let colored = |arguments: &[&str], variables: &[(&str, &str)]| {
        let output = program().args(arguments).envs(variables.iter().copied()).output().unwrap();
        let (stdout, stderr, _) = said(&output);
        (stdout + &stderr).contains('\u{1b}')
    };
    let wrong = ["info", "no-such.mcap"];
    let mistyped = ["inof"];
    let help = ["info", "--help"];
    for words in [&wrong[..], &mistyped, &help] {
        let always = [&["--color", "always"], words].concat();
        // Help and mistakes of clap, and errors of our own, obey alike; a pipe is no terminal.
        assert!(colored(&always, &[]), "{words:?}");
        assert!(!colored(words, &[]), "{words:?}");
        assert!(
            !colored(&[&["--color=never"], words].concat(), &[("CLICOLOR_FORCE", "1")]),
            "{words:?}"
        );
        assert!(colored(words, &[("CLICOLOR_FORCE", "1")]), "{words:?}");
        assert!(!colored(words, &[("NO_COLOR", "1"), ("CLICOLOR_FORCE", "0")]), "{words:?}");
    }
    // The option may stand behind the command, too.
    assert!(colored(&["info", "no-such.mcap", "--color=always"], &[]));
}

#[test]
fn quiet_leaves_errors_and_losses() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.mcap");
    let recover = |file: &str, words: &[&str]| {
        let out = whole.to_str().unwrap();
        said(&run(&[&["recover", file, "-o", out, "--overwrite"], words].concat()))
    };
    assert!(recover(EXAMPLE, &[]).1.contains("nothing was lost"));
    assert_eq!(recover(EXAMPLE, &["-q"]), (String::new(), String::new(), 0));
    let (_, stderr, status) = recover(&cut_file(dir.path()), &["--quiet"]);
    assert!(stderr.contains("bytes lost") && status == 3, "{stderr}");
    let (_, stderr, status) = said(&run(&["-q", "info", "no-such.mcap"]));
    assert!(stderr.starts_with("error: no-such.mcap") && status == 1, "{stderr}");
    // A result stays.
    assert!(said(&run(&["-q", "info", EXAMPLE])).0.contains("no warnings"));
    let (_, stderr, status) = said(&run(&["-q", "-v", "info", EXAMPLE]));
    assert!(stderr.contains("cannot be used with") && status == 2, "{stderr}");
}

#[test]
fn the_log_is_on_stderr_and_changes_no_result() {
    let (plain, silent, _) = said(&run(&["info", "--json", EXAMPLE]));
    assert_eq!(silent, "");
    let (stdout, stderr, _) = said(&run(&["info", "--json", EXAMPLE, "-v"]));
    assert_eq!(stdout, plain);
    let opened = format!("opened {EXAMPLE}: ");
    assert!(stderr.contains(&opened) && stderr.contains("6056 messages"), "{stderr}");
    assert!(!stderr.contains("sha256") && stderr.contains("ended after"), "{stderr}");
    assert!(said(&run(&["info", "-vv", EXAMPLE])).1.contains("sha256 f78c3d50"));
    let logged = |filter: &str, words: &[&str]| {
        let words = [words, &["info", EXAMPLE]].concat();
        let output = program().args(words).env("RUST_LOG", filter).output().unwrap();
        said(&output).1
    };
    assert!(logged("klasktron::recording=info", &[]).contains(&opened));
    assert!(!logged("klasktron::recording=info", &[]).contains("ended after"));
    // The variable wins, also where it silences; an empty one is none.
    assert_eq!(logged("off", &["-v"]), "");
    assert_eq!(logged("", &[]), "");
}

#[test]
fn the_log_of_a_fit_tells_files_seeds_and_steps() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().to_str().unwrap();
    let files = ["tests/data/example-train.mcap", EXAMPLE];
    let words = ["--epochs", "2", "--seeds", "2", "--width", "8", "-v", "--output", out];
    let (stdout, stderr, status) = said(&run(&[&["fit-actuator"], &files[..], &words].concat()));
    assert_eq!(status, 0, "{stderr}");
    for expected in ["opened tests/data/example-train.mcap", "fit of seed 1 starts", "wrote "] {
        assert!(stderr.contains(expected), "{expected}: {stderr}");
        assert!(!stdout.contains("fit of seed"), "{stdout}");
    }
}
