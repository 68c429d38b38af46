//! Completions in a real shell, and manual pages in a real formatter.

use crate::support::{klasktron, said};
use std::{
    fs,
    path::Path,
    process::{Command, Stdio},
};

fn completions(shell: &str) -> String {
    let (stdout, stderr, status) = said(&klasktron(&["completions", shell]));
    assert_eq!(status, 0, "{stderr}");
    stdout
}

fn is_installed(program: &str) -> bool {
    let mut command = Command::new(program);
    command.arg("--version").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok()
}

/// What bash offers for the last of `words`.
fn offered(script: &Path, words: &[&str]) -> Vec<String> {
    let list = words.iter().map(|word| format!("'{word}'")).collect::<Vec<_>>().join(" ");
    let last = words.len() - 1;
    let program = format!(
        "source '{}'; COMP_WORDS=({list}); COMP_CWORD={last}; \
         complete -p klasktron >&2; _klasktron klasktron '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        script.display(),
        words[last],
        words[last - 1]
    );
    let output = Command::new("bash").args(["--norc", "-c", &program]).output().unwrap();
    let (stdout, stderr, status) = said(&output);
    assert!(status == 0 && stderr.contains("-F _klasktron"), "{stderr}");
    stdout.lines().map(ToOwned::to_owned).collect()
}

#[cfg(unix)]
#[test]
fn bash_completes_commands_options_and_values() {
    let dir = tempfile::tempdir().unwrap();
    let script = dir.path().join("klasktron.bash");
    fs::write(&script, completions("bash")).unwrap();
    assert_eq!(offered(&script, &["klasktron", "fit"]), ["fit-actuator"]);
    assert_eq!(offered(&script, &["klasktron", "import", "can"]), ["candump"]);
    assert_eq!(offered(&script, &["klasktron", "train", "--tensor"]), ["--tensorboard"]);
    assert_eq!(offered(&script, &["klasktron", "train", "--preset", "pa"]), ["paper"]);
    assert!(offered(&script, &["klasktron", ""]).contains(&"tune-ekf".to_owned()));
}

#[test]
fn every_shell_gets_a_script_with_every_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let script = completions(shell);
        for word in
            ["fit-actuator", "tune-ekf", "candump", "completions", "no-config", "learning-rate"]
        {
            assert!(script.contains(word), "{shell}: no {word}");
        }
        if ["zsh", "fish"].contains(&shell) && is_installed(shell) {
            let dir = tempfile::tempdir().unwrap();
            let path = dir.path().join("script");
            fs::write(&path, script).unwrap();
            assert!(
                Command::new(shell).arg("-n").arg(&path).status().unwrap().success(),
                "{shell}"
            );
        }
    }
    let (_, stderr, status) = said(&klasktron(&["completions", "bahs"]));
    assert!(status == 2 && stderr.contains("a similar value exists: 'bash'"), "{stderr}");
}

#[test]
fn there_is_a_manual_page_for_every_command_that_groff_sets_without_a_warning() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("man1");
    let (stdout, stderr, status) = said(&klasktron(&["man", "--output", folder.to_str().unwrap()]));
    assert_eq!(status, 0, "{stderr}");
    let mut pages: Vec<_> =
        fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    pages.sort();
    assert_eq!(stdout, format!("wrote {} pages to {}\n", pages.len(), folder.display()));
    let help = said(&klasktron(&["--help"])).0;
    let commands = help.lines().skip_while(|line| *line != "Data:");
    let commands = commands.take_while(|line| *line != "Options:");
    let named = commands.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    for command in named.filter_map(|line| line.split_whitespace().next()) {
        let page = folder.join(format!("klasktron-{command}.1"));
        assert!(command == "help" || page.exists(), "{command} has no page");
    }
    assert!(folder.join("klasktron-import-csv.1").exists());
    let own = said(&klasktron(&["man"])).0;
    assert_eq!(own, fs::read_to_string(folder.join("klasktron.1")).unwrap());
    let train = fs::read_to_string(folder.join("klasktron-train.1")).unwrap();
    assert!(train.contains("\n.SH EXAMPLES\n"), "{train}");
    assert!(train.contains("klasktron train \\-\\-steps 20e6"), "no example in {train}");
    if !is_installed("groff") {
        return;
    }
    let output = Command::new("groff").args(["-man", "-ww", "-Tutf8", "-z"]).args(&pages).output();
    let (_, stderr, status) = said(&output.unwrap());
    assert_eq!((stderr.as_str(), status), ("", 0));
}
