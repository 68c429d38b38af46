//! The sweep file: what is read, and what is said of a mistake.

use super::support::Bench;
use klasktron::sweep::{
    CommandLine, InputHashes, OptionKind, OptionSpec, Plan, Point, Setting, hash_of, parse,
};
use proptest::prelude::*;
use std::{collections::BTreeSet, fs, path::Path};

fn refusal(text: &str) -> String {
    parse(Path::new("s.toml"), text).unwrap_err().to_string()
}

#[test]
fn every_mistake_is_told_with_its_line_and_the_way_out() {
    for (text, expected) in [
        ("", "s.toml:1: 'command' is missing; write command = \"train\""),
        ("\ncommand = \"trian\"", "s.toml:2: 'trian' cannot be swept; did you mean 'train'?"),
        ("command = \"play\"", "the commands are fit-actuator, tune-ekf, gap, train, eval"),
        ("command = 3", "'command' is the number 3; it must be text"),
        (
            "command = \"train\"\nsedes = 3",
            "s.toml:2: unknown key 'sedes' in the sweep; did you mean 'seeds'?",
        ),
        (
            "command = \"train\"\nseeds = 0",
            "s.toml:2: 'seeds' is the number 0; it must be a number of seeds",
        ),
        ("command = \"train\"\nseeds = [1, 1]", "a list of different seeds"),
        ("command = \"train\"\nseeds = -1", "none negative"),
        (
            "command = \"train\"\n[grid]\nhidden = 8",
            "s.toml:3: 'hidden' is the number 8; every axis of [grid] is a list",
        ),
        (
            "command = \"train\"\n[grid]\nenvs = [8,\n8]",
            "s.toml:4: 'envs' is the number 8; and stands twice",
        ),
        ("command = \"train\"\n[grid]\nenvs = []", "'envs' is an empty list"),
        ("command = \"train\"\n[options]\nenvs = 1979-05-27", "'envs' is the date"),
        (
            "command = \"train\"\n[slurm]\ncors = 2",
            "s.toml:3: unknown key 'cors' in [slurm]; did you mean 'cores'?",
        ),
        ("command = \"train\"\nbetter = \"bigger\"", "it must be \"smaller\" or \"larger\""),
        ("command = \"train\"\ninputs = \"x\"", "it must be a list of paths"),
        ("command = \"train\"\ninputs = [\"--out\"]", "it must be a path"),
        ("command = \"train\"\ncommand = \"gap\"", "s.toml:2: not valid TOML: duplicate key"),
        ("command = \"train", "s.toml:1: not valid TOML"),
    ] {
        let said = refusal(text);
        assert!(said.contains(expected), "{text}\n{said}");
    }
}

#[test]
fn the_program_holds_options_against_the_command() {
    let bench = Bench::new(2, "");
    let out = bench.out("out");
    for (text, expected) in [
        (
            "command = \"train\"\n[options]\nstpes = 1e3",
            ":3: train has no option 'stpes'; did you mean 'steps'?",
        ),
        (
            "command = \"train\"\n[options]\nsteps = 1.5",
            ":3: train rejects a point: invalid value '1.5' for '--steps",
        ),
        (
            "command = \"train\"\n[options]\nthreads = 2",
            ":3: 'threads' cannot be set in a sweep: results do not depend",
        ),
        (
            "command = \"train\"\n[options]\nrandomize = 1",
            ":3: 'randomize' is '1'; it is a flag: true or false",
        ),
        (
            "command = \"train\"\n[options]\nenvs = [1, 2]",
            ":3: 'envs' is a list of 2; it takes one value",
        ),
        (
            "command = \"train\"\n[options]\nenvs = 8\n[grid]\nenvs = [8]",
            ":5: 'envs' is in [options] and in [grid]",
        ),
        ("command = \"train\"\n[options]\nactuator = \"no.json\"", ":3: "),
        ("command = \"gap\"\ninputs = [\"match.mcap\"]\nseeds = 3", "gap draws no random numbers"),
        ("command = \"eval\"\ninputs = [\"no.mcap\"]", ":2: "),
        (
            "command = \"eval\"",
            "eval rejects a point: the following required arguments were not provided: <MATCH>",
        ),
        (
            "command = \"train\"\nseeds = 100000\n[grid]\nenvs = [1, 2]",
            "200000 points; at most 100000 are allowed",
        ),
    ] {
        fs::write(bench.file(), text).unwrap();
        let (stdout, said, status) = bench.run(&out, &[]);
        assert_eq!((stdout.as_str(), status), ("", 1), "{said}");
        assert!(said.contains(expected), "{text}\n{said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{said}");
        assert!(!out.exists(), "{text}");
    }
}

/// The plan of `text` for a command with some options of `train`.
fn plan(text: &str) -> Plan {
    let option = |(name, kind): (&str, OptionKind)| OptionSpec { name: name.to_owned(), kind };
    let options = [
        ("envs", OptionKind::One),
        ("steps", OptionKind::One),
        ("hidden", OptionKind::Delimited(',')),
        ("randomize", OptionKind::Flag),
    ]
    .map(option);
    let line = CommandLine { options: &options, check: &|_words| Ok(()) };
    Plan::new(&parse(Path::new("s.toml"), text).unwrap(), &line).unwrap()
}

#[test]
fn a_grid_is_every_combination_and_listed_points_come_after() {
    let plan = plan(
        "command = \"train\"\nseeds = [4, 7]\n[options]\nsteps = 20e6\nrandomize = true\n[grid]\nhidden = [[8], [64, \
         64]]\nenvs = [16, 32]\n[[points]]\nenvs = 64\nrandomize = false\n[[points]]\nhidden = [8]\nenvs = 16\n",
    );
    let lines: Vec<&str> = plan.points.iter().map(|point| point.command_line.as_str()).collect();
    // The last listed point is one of the grid.
    assert_eq!(lines.len(), 2 * (4 + 1));
    assert_eq!(
        lines[..3],
        [
            "klasktron train --envs 16 --hidden 8 --randomize --steps 20000000 --seed 4",
            "klasktron train --envs 16 --hidden 8 --randomize --steps 20000000 --seed 7",
            "klasktron train --envs 32 --hidden 8 --randomize --steps 20000000 --seed 4",
        ]
    );
    assert_eq!(lines[8], "klasktron train --envs 64 --steps 20000000 --seed 4");
    assert_eq!(plan.points[4].title(), "envs 16, hidden 64,64, randomize true, seed 4");
    let hashes: BTreeSet<&String> = plan.points.iter().map(|point| &point.hash).collect();
    assert_eq!(hashes.len(), lines.len());
}

#[test]
fn the_order_and_the_spelling_of_options_do_not_change_a_point() {
    let hashes = |text: &str| plan(text).points.into_iter().map(|p| p.hash).collect::<Vec<_>>();
    let one = hashes("command = \"train\"\n[options]\nenvs = 16\nsteps = 20e6\n");
    assert_eq!(one, hashes("command = \"train\"\n[options]\nsteps = 20_000_000\nenvs = 0x10\n"));
    assert_ne!(one, hashes("command = \"train\"\n[options]\nsteps = 20e6\nenvs = 17\n"));
}

#[test]
fn a_point_knows_the_content_of_its_inputs_but_not_their_age() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("a.mcap");
    let hash = |bytes: &[u8]| {
        fs::write(&file, bytes).unwrap();
        let inputs = [InputHashes::default().of(&file).unwrap()];
        (hash_of(&["eval".to_owned()], &inputs), InputHashes::default().of(dir.path()).unwrap())
    };
    let one = hash(b"one");
    let two = hash(b"two");
    assert!(one.0 != two.0 && one.1 != two.1);
    assert_eq!(one, hash(b"one"));
}

proptest! {
    #[test]
    fn no_text_makes_the_reader_panic(text in "(command = \"train\"\n)?[a-z\\[\\]{}=\"'#\\.0-9e\n, -]{0,80}") {
        match parse(Path::new("s.toml"), &text) {
            Ok(file) => prop_assert!(!file.command.name().is_empty()),
            Err(error) => prop_assert!(error.to_string().starts_with("s.toml:")),
        }
    }

    #[test]
    fn a_grid_has_the_product_of_its_axes(
        envs in prop::collection::btree_set(1_u32..10_000, 1..6),
        steps in prop::collection::btree_set(1_u32..10_000, 1..6),
        seeds in 1_usize..5,
    ) {
        let text = format!(
            "command = \"train\"\nseeds = {seeds}\n[grid]\nenvs = {envs:?}\nsteps = {steps:?}\n"
        )
        .replace('{', "[")
        .replace('}', "]");
        let points = plan(&text).points;
        let hashes: BTreeSet<&String> = points.iter().map(|point| &point.hash).collect();
        prop_assert_eq!(points.len(), envs.len() * steps.len() * seeds);
        prop_assert_eq!(hashes.len(), points.len());
    }

    #[test]
    fn numbers_keep_their_value_whatever_their_notation(value in prop::num::f64::NORMAL) {
        let text = format!("command = \"train\"\n[options]\nsteps = {value:e}\n");
        let file = parse(Path::new("s.toml"), &text).unwrap();
        let Setting::One(word) = &file.options[0].1.value else { panic!("{file:?}") };
        prop_assert_eq!(word.parse::<f64>().unwrap(), value);
    }

    #[test]
    fn points_survive_their_list(words in prop::collection::vec("\\PC{0,12}", 1..6)) {
        let point = Point::new(words, &[]);
        let line = serde_json::to_string(&point).unwrap();
        prop_assert!(!line.contains('\n'));
        let hash = format!("{{\"hash\":\"{}\"", point.hash);
        prop_assert!(line.starts_with(&hash));
        prop_assert_eq!(serde_json::from_str::<Point>(&line).unwrap(), point);
    }
}
