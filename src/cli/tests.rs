//! Command line as a whole: names that do not collide, groups of the help, examples that parse, settings as arguments.

use super::{
    Cli,
    expand::{Expanded, expand},
    groups::GROUPS,
};
use clap::{Arg, Command, CommandFactory, FromArgMatches};
use std::{collections::BTreeSet, ffi::OsString, fs};

/// The command line, built, as a parse has it.
fn built() -> Command {
    let mut command = Cli::command();
    command.build();
    command
}

/// Every command below `command` with the words that lead to it, without clap's own `help`.
fn all_below(command: &Command, words: &str) -> Vec<(String, Command)> {
    let own = command.get_subcommands().filter(|below| below.get_name() != "help");
    own.flat_map(|below| {
        let words = format!("{words} {}", below.get_name());
        let deeper = all_below(below, &words);
        std::iter::once((words, below.clone())).chain(deeper)
    })
    .collect()
}

/// Examples of a command: its lines that begin with `klasktron`, continued ones joined.
fn examples(command: &Command) -> Vec<String> {
    let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let text = text.replace("\\\n", " ");
    let lines = text.lines().map(str::trim).filter(|line| line.starts_with("klasktron "));
    lines.map(|line| line.split(['|', '>', '&']).next().unwrap_or(line).trim().to_owned()).collect()
}

#[test]
fn no_command_has_two_options_of_one_name() {
    let command = built();
    for (words, command) in all_below(&command, "klasktron") {
        let mut names = BTreeSet::new();
        let shorts =
            command.get_arguments().filter_map(Arg::get_short).map(|short| short.to_string());
        let longs = command.get_arguments().filter_map(Arg::get_long).map(ToOwned::to_owned);
        for name in shorts.chain(longs) {
            assert!(names.insert(name.clone()), "{words}: two options are called {name}");
        }
    }
}

#[test]
fn the_help_of_every_command_ends_with_examples_that_parse() {
    let mut all = all_below(&built(), "klasktron");
    all.retain(|(_, command)| !command.is_hide_set());
    assert!(18 <= all.len(), "{}", all.len());
    for (words, command) in all {
        let examples = examples(&command);
        let own = examples.iter().filter(|line| line.starts_with(&words)).count();
        assert!(1 <= own, "{words} has no example in its help");
        for line in examples {
            let parsed = Cli::command().try_get_matches_from(line.split_whitespace());
            let parsed = parsed.and_then(|matches| Cli::from_arg_matches(&matches));
            assert!(parsed.is_ok(), "{line}: {}", parsed.unwrap_err());
        }
    }
}

#[test]
fn every_visible_subcommand_is_in_one_group_of_the_help() {
    let command = built();
    let own = command.get_subcommands().filter(|own| own.get_name() != "help");
    let visible: Vec<&str> = own.filter(|own| !own.is_hide_set()).map(Command::get_name).collect();
    let grouped: Vec<&str> = GROUPS.iter().flat_map(|(_, names)| names.iter().copied()).collect();
    for name in &visible {
        let times = grouped.iter().filter(|grouped| *grouped == name).count();
        assert_eq!(times, 1, "{name} is in {times} groups of src/cli/groups.rs");
    }
    let unknown: Vec<&&str> = grouped.iter().filter(|name| !visible.contains(name)).collect();
    assert!(unknown.is_empty(), "no subcommand is called {unknown:?}");
    let help = Cli::command().render_long_help().to_string();
    for name in visible {
        let line = help.lines().find(|line| line.starts_with(&format!("  {name} ")));
        let line = line.unwrap_or_else(|| panic!("{name} is not in the help:\n{help}"));
        assert!(line.len() <= 80, "{line}");
        assert!(line[19..].starts_with(char::is_uppercase), "{line}");
    }
    assert!(help.lines().all(|line| line.chars().count() <= 100), "{help}");
}

#[test]
fn every_command_that_writes_results_has_output_and_the_old_name_is_hidden() {
    for (words, mut command) in all_below(&built(), "klasktron") {
        let is_output = |arg: &&Arg| arg.get_long() == Some("output");
        let Some(output) = command.get_arguments().find(is_output).cloned() else { continue };
        assert!(output.get_all_aliases().is_some_and(|names| names == ["out"]), "{words}");
        if !command.is_hide_set() {
            assert_eq!(output.get_short(), Some('o'), "{words}");
        }
        assert!(!command.render_long_help().to_string().contains("--out "), "{words}");
        for longer in ["OUT ", "OUT/"] {
            assert!(!command.render_long_help().to_string().contains(longer), "{words}: {longer}");
        }
    }
}

#[test]
fn the_file_may_hold_the_old_name_of_an_option() {
    assert_eq!(line("[gap]\nout = \"a\"\n", "gap x.mcap"), "gap x.mcap --output=a");
    assert_eq!(line("[gap]\nout = \"a\"\n", "gap x.mcap --out b"), "gap x.mcap --out b");
    let said = expanded("[gap]\nout = \"a\"\noutput = \"b\"\n", "gap x.mcap").unwrap_err();
    assert_eq!(said, "FILE:3: [gap] output: out is another name of it (FILE:2)");
}

/// Command line for `typed` with the settings `file`; the words without program and `--config FILE`.
fn expanded(file: &str, typed: &str) -> Result<(Vec<String>, Expanded), String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("klasktron.toml");
    fs::write(&path, file).unwrap();
    let path = path.to_str().unwrap().to_owned();
    let words = ["klasktron", "--config", &path].into_iter().chain(typed.split_whitespace());
    let expanded = expand(&Cli::command(), words.map(OsString::from).collect());
    let expanded = expanded.map_err(|error| error.to_string().replace(&path, "FILE"))?;
    let words = expanded.arguments[3..].iter().map(|word| word.to_str().unwrap().to_owned());
    Ok((words.collect(), expanded))
}

fn line(file: &str, typed: &str) -> String {
    let (words, expanded) = expanded(file, typed).unwrap();
    let parsed = Cli::command().try_get_matches_from(&expanded.arguments);
    assert!(parsed.is_ok(), "{}", parsed.unwrap_err());
    words.join(" ")
}

#[test]
fn settings_stand_behind_what_is_typed() {
    let file = "[fit-actuator]\nepochs = 50\nlearning-rate = 1e-4\nlayout = \"klask-rl\"\nablate = true\n\
                [train]\nhidden = [256, 128]\nsteps = 20e6\n[gap]\ntwin = \"twin.json\"\n";
    assert_eq!(
        line(file, "fit-actuator a.mcap"),
        "fit-actuator a.mcap --epochs=50 --learning-rate=1e-4 --layout=klask-rl --ablate"
    );
    assert_eq!(line(file, "train"), "train --hidden=256 --hidden=128 --steps=20e6");
    assert_eq!(line(file, "gap -- a.mcap"), "gap --twin=twin.json -- a.mcap");
    assert_eq!(line(file, "info a.mcap"), "info a.mcap");
}

#[test]
fn what_is_typed_wins() {
    let file = "[fit-actuator]\nepochs = 50\nablate = true\njson = true\n";
    assert_eq!(
        line(file, "fit-actuator a.mcap --epochs 3 --ablate=false"),
        "fit-actuator a.mcap --epochs 3 --json"
    );
    // An option that contradicts a typed one is left out too, whichever of both says so.
    let collect = "[collect]\npattern = [\"circle\"]\nseconds = 5\nspeed = \"max\"\n";
    assert_eq!(line(collect, "collect --plan paper"), "collect --plan paper --speed=max");
    assert_eq!(
        line("[collect]\nplan = \"paper\"\n", "collect --pattern ramp"),
        "collect --pattern ramp"
    );
    assert_eq!(line("[eval]\ncompare = [\"a\", \"b\"]\n", "eval c.mcap"), "eval c.mcap");
    assert_eq!(line("[global]\nverbose = 2\n", "info -q a.mcap"), "info -q a.mcap");
}

#[test]
fn lists_counts_and_options_that_need_no_value() {
    let file = "[eval]\ncompare = [\"a\", \"b\"]\n[global]\nverbose = 2\n[collect]\ndry-run = true\n\
                pattern = [\"circle:radius_m=0.05\", \"ramp\"]\n";
    assert_eq!(line(file, "eval"), "eval --verbose --verbose --compare a b");
    assert_eq!(
        line(file, "collect -q"),
        "collect -q --dry-run --pattern=circle:radius_m=0.05 --pattern=ramp"
    );
    assert_eq!(line("[collect]\npattern = \"ramp\"\n", "collect"), "collect --pattern=ramp");
    assert_eq!(
        line("[collect]\ndry-run = \"here\"\n[global]\n", "collect --plan paper"),
        "collect --plan paper --dry-run=here"
    );
}

#[test]
fn required_options_may_stand_in_the_file() {
    let file = "[play]\nleft = \"goalkeeper\"\nright = \"chaser\"\n[import.csv]\ntime = \"t\"\n\
                input = \"u:V\"\nvelocity = \"v\"\noutput = \"axis.mcap\"\n";
    assert_eq!(line(file, "play --right none"), "play --right none --left=goalkeeper");
    assert_eq!(
        line(file, "import csv axis.csv"),
        "import csv axis.csv --time=t --input=u:V --velocity=v --output=axis.mcap"
    );
    assert_eq!(line(file, "import bus.log -o b.mcap"), "import bus.log -o b.mcap");
}

#[test]
fn a_commands_own_table_stands_for_the_global_one() {
    let file = "[global]\nquiet = true\n[train]\nquiet = false\n";
    assert_eq!(line(file, "train"), "train");
    assert_eq!(line(file, "info a.mcap"), "info a.mcap --quiet");
    assert_eq!(line(file, "info a.mcap --quiet=false"), "info a.mcap");
    let file = "[global]\nverbose = 2\n";
    assert_eq!(line(file, "info --verbose=false a.mcap"), "info a.mcap");
    assert_eq!(line(file, "--verbose=true info a.mcap"), "--verbose info a.mcap");
}

#[test]
fn a_flag_of_one_command_may_take_a_value_in_another() {
    assert_eq!(line("", "sweep a.toml --dry-run=false"), "sweep a.toml");
    let collect = "collect --plan paper --dry-run=false";
    assert_eq!(line("", collect), collect);
}

#[test]
fn a_mistake_in_the_file_is_told_with_its_line_and_the_way_out() {
    let cases = [
        (
            "[fit-actuator]\nepoch = 5",
            "FILE:2: [fit-actuator] has no option `epoch`; did you mean `epochs`?",
        ),
        (
            "\n[fit_actuator]\nepochs = 5",
            "FILE:2: no command is called `fit_actuator`; did you mean `fit-actuator`?",
        ),
        ("epochs = 5", "FILE:1: `epochs` is in no table"),
        ("[[train]]\nseed = 1", "FILE:1: `train` must be one table, written [train], not a list"),
        ("[train]\n\nseed = \"7\"", "FILE:3: [train] seed: must be a number, not a text"),
        (
            "[train]\nrandomize = \"yes\"",
            "FILE:2: [train] randomize: must be true or false, not a text",
        ),
        ("[train]\noutput = 5", "FILE:2: [train] output: must be a text in quotes, not a number"),
        (
            "[train]\nsteps = 2.5",
            "FILE:2: [train] steps: invalid value '2.5' for '--steps <COUNT>': must be a whole number",
        ),
        ("[train]\npreset = \"papr\"", "tip: a similar value exists: 'paper'"),
        ("[train]\nseed = [1, 2]", "FILE:2: [train] seed: must be a number, not a list"),
        ("[train]\nseed = 1979-05-27", "FILE:2: [train] seed: must be a number, not a date"),
        ("[collect]\npattern = [\"circle\", true]", "FILE:2: [collect] pattern: must be a text"),
        ("[collect]\npattern = [\"sircle\"]", "FILE:2: [collect] pattern: invalid value 'sircle'"),
        (
            "[eval]\ncompare = \"a\"",
            "FILE:2: [eval] compare: must be a list of 2 values, not a text",
        ),
        ("[eval]\ncompare = [\"a\"]", "FILE:2: [eval] compare: 2 values required"),
        ("[import.cvs]\ntime = \"t\"", "FILE:1: [import] has no option `cvs`"),
        (
            "[global]\nverbose = \"much\"",
            "FILE:2: [global] verbose: must be a whole number, not a text",
        ),
        ("[global]\nepochs = 5", "FILE:2: [global] has no option `epochs`"),
        ("[global]\nconfig = \"other.toml\"", "FILE:2: [global] has no option `config`"),
        ("[train]\nseed = ", "FILE:2: "),
        ("[train]\nseed = 1\nseed = 2", "FILE:3: "),
        (
            "[collect]\nplan = \"paper\"\npattern = [\"ramp\"]",
            "FILE:3: pattern cannot be used with plan (FILE:2)",
        ),
    ];
    for (file, expected) in cases {
        let typed = if file.starts_with("[collect]") { "collect" } else { "train" };
        let said = expanded(file, typed).map(|(words, _)| words).unwrap_err();
        assert!(said.contains(expected), "{file:?}: {said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

#[test]
fn help_and_version_need_no_file() {
    for typed in ["--help", "train --help", "--version", ""] {
        assert!(expanded("nonsense", typed).is_ok(), "{typed}");
    }
}

/// A value that begins with a dash is no option.
#[test]
fn negative_numbers_pass() {
    let said =
        expanded("[fit-actuator]\nlearning-rate = -1.0\n", "fit-actuator a.mcap").unwrap_err();
    assert!(said.contains("must be a number above 0"), "{said}");
}
