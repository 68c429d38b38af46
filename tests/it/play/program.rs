//! `klasktron play` as it is typed.

use super::series;
use crate::{
    support::{Mistake, check_mistakes, klasktron, said},
    train::support::{settings_file, tiny},
};
use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, Recording, RecordingWriter, SESSION_METADATA,
        message::{RunMarker, SessionEvent, VelocityCommand},
        sha256_of_file,
        topic::{self, Player},
    },
    train::POLICY_METADATA,
};
use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

fn file(dir: &Path, name: &str) -> String {
    dir.join(name).to_str().unwrap().to_owned()
}

/// A match at full speed with these arguments, written to `out`.
fn play(out: &str, arguments: &[&str]) -> (String, String, i32) {
    let typed = ["play", "--speed", "max", "-o", out];
    said(&klasktron(&[&typed[..], arguments].concat()))
}

/// Goals and points of left and right player, as `eval` counts them.
fn by_eval(dir: &Path, recording: &str) -> [[usize; 2]; 2] {
    let out = file(dir, "eval");
    let (_, stderr, status) = said(&klasktron(&["eval", recording, "-o", &out, "--overwrite"]));
    assert_eq!(status, 0, "{stderr}");
    let score: serde_json::Value =
        serde_json::from_slice(&fs::read(Path::new(&out).join("score.json")).unwrap()).unwrap();
    let episodes = score["matches"][0]["episodes"].as_array().unwrap();
    let count = |what: &dyn Fn(&serde_json::Value) -> bool| {
        ["left", "right"].map(|player| {
            episodes.iter().filter(|episode| episode["scorer"] == player && what(episode)).count()
        })
    };
    [count(&|episode| episode["outcome"] == "goal"), count(&|_| true)]
}

/// The referee sees what the camera saw, the rig counts balls in its cups. A ball that falls within the last
/// half second of a recording is the one case in which they may differ; here none does.
#[test]
fn eval_counts_the_goals_that_the_rig_knows_of() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = 0;
    for (left, right) in [("goalkeeper", "chaser"), ("chaser", "chaser")] {
        let out = file(dir.path(), &format!("{left}.mcap"));
        let players =
            ["--left", left, "--right", right, "--seconds", "60", "--seed", "1", "--json"];
        let (stdout, stderr, status) = play(&out, &players);
        assert_eq!(status, 0, "{stderr}");
        let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
        assert_eq!((&report["stop"], &report["samples"]), (&"completed".into(), &3000.into()));
        let goals = &report["truth_goals"];
        let known = ["left", "right"].map(|player| goals[player].as_u64().unwrap() as usize);
        let [goals, points] = by_eval(dir.path(), &out);
        assert_eq!(goals, known, "{left} against {right}");
        // The referee of the match has seen the same.
        assert_eq!(report["score"]["points"], serde_json::json!(points));
        assert!(stderr.contains(&format!("true goals {} : {}", known[0], known[1])));
        all += known[0] + known[1];
    }
    assert!(2 <= all, "{all} goals in two minutes are too few to compare");
}

/// A game of one point ends with the first goal; the recording tells the score when it changes.
#[test]
fn a_match_ends_when_it_is_won() {
    let dir = tempfile::tempdir().unwrap();
    let out = file(dir.path(), "won.mcap");
    let players =
        ["--left", "chaser", "--right", "stationary", "--seconds", "600", "--points", "1"];
    let (stdout, stderr, status) =
        play(&out, &[&players[..], &["--best-of", "3", "--json"]].concat());
    assert_eq!(status, 0, "{stderr}");
    let report: serde_json::Value = serde_json::from_str(&stdout).unwrap();
    assert_eq!(report["stop"], "completed");
    let games: Vec<u64> = serde_json::from_value(report["score"]["games"].clone()).unwrap();
    assert_eq!(games.iter().max(), Some(&2), "{stdout}");
    assert!(report["samples"].as_u64().unwrap() < 30_000, "{stdout}");
    let [_, points] = by_eval(dir.path(), &out);
    assert_eq!(points.map(|own| own as u64).to_vec(), games);
    let recording = Recording::open(Path::new(&out)).unwrap();
    let events = series::<SessionEvent>(&recording, topic::SESSION_EVENT);
    let told: Vec<&str> = events
        .iter()
        .filter(|(_, own)| own.kind == "match")
        .map(|(_, own)| own.text.as_str())
        .collect();
    assert_eq!(told.len() as u64, games.iter().sum::<u64>(), "{told:?}");
    assert!(told[0].starts_with("score "), "{told:?}");
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let bytes = |seed| {
        let dir = tempfile::tempdir().unwrap();
        let out = file(dir.path(), "match.mcap");
        let players = ["--left", "random", "--right", "chaser", "--seconds", "3", "--seed", seed];
        let (_, stderr, status) = play(&out, &players);
        assert_eq!(status, 0, "{stderr}");
        fs::read(out).unwrap()
    };
    let first = bytes("4");
    assert!(first == bytes("4"));
    assert!(first != bytes("5"));
}

/// A policy of one update; 20 values in.
fn trained(dir: &Path) -> PathBuf {
    let mut settings = tiny();
    settings.steps = settings.transitions_per_update();
    let settings = settings_file(dir, &settings).display().to_string();
    let out = dir.join("tiny.mcap");
    let typed =
        ["train", "--settings", &settings, "--games", "0", "--output", out.to_str().unwrap()];
    let (_, stderr, status) = said(&klasktron(&typed));
    assert_eq!(status, 0, "{stderr}");
    out
}

#[test]
fn a_policy_plays_and_the_recording_says_which() {
    let dir = tempfile::tempdir().unwrap();
    let policy = trained(dir.path());
    let out = file(dir.path(), "match.mcap");
    let players = ["--left", policy.to_str().unwrap(), "--right", "stationary", "--seconds", "3"];
    let (_, stderr, status) = play(&out, &players);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("tiny.mcap against stationary 0 : 0, 150 actions"), "{stderr}");
    let recording = Recording::open(Path::new(&out)).unwrap();
    let said = |key| recording.info(key).unwrap().to_owned();
    assert_eq!(
        (said("player_left"), said("player_right")),
        ("tiny.mcap".into(), "stationary".into())
    );
    assert_eq!(said("player_left_sha256"), sha256_of_file(&policy).unwrap());
    assert_eq!((said("rate_hz"), said("source")), ("50".into(), "virtual".into()));
    for key in ["seed", "git_hash", "robot_json", "rig_json", "filter_json"] {
        assert!(recording.info(key).is_some(), "{key}");
    }
    assert_eq!(recording.metadata[SESSION_METADATA]["stop"], "completed");
    let markers = series::<RunMarker>(&recording, topic::RUN_MARKER);
    let [start, end] = [0, 1].map(|at| markers[at].0);
    let moved = |player| {
        let commands = series::<VelocityCommand>(&recording, &topic::command(player));
        let mut in_match = commands.iter().filter(|(time, _)| start < *time && *time < end);
        in_match.any(|(_, command)| command.vx != 0.0 || command.vy != 0.0)
    };
    assert!(moved(Player::Left) && !moved(Player::Right));
}

/// The policy's file with other entries in its metadata.
fn altered(policy: &Path, name: &str, entries: &[(&str, &str)]) -> String {
    let recording = Recording::open(policy).unwrap();
    let path = policy.with_file_name(name);
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Replace, FlushPolicy::WhenFull).unwrap();
    let mut metadata: BTreeMap<String, String> = recording.metadata[POLICY_METADATA].clone();
    metadata.extend(entries.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())));
    writer.metadata(POLICY_METADATA, metadata).unwrap();
    for name in ["policy.safetensors", "settings.json"] {
        let data = &recording.attachment(name).unwrap().data;
        writer.attach(name, "application/octet-stream", data).unwrap();
    }
    writer.finish().unwrap();
    path.display().to_string()
}

#[test]
fn policies_that_do_not_belong_here_are_refused_with_both_values() {
    let dir = tempfile::tempdir().unwrap();
    let policy = trained(dir.path());
    let altered = |name, entries| altered(&policy, name, entries);
    let robot = file(dir.path(), "slow.json");
    fs::write(&robot, r#"{"limits": {"speed_m_per_s": 0.3}}"#).unwrap();
    let game = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/example-match.mcap");
    let broken = file(dir.path(), "broken.mcap");
    fs::write(&broken, "not an mcap").unwrap();
    let cases = [
        (game.display().to_string(), "no policy in this file; make one with `klasktron train`"),
        (broken, "broken.mcap"),
        (file(dir.path(), "nowhere.mcap"), "nowhere.mcap"),
        (altered("slow.mcap", &[("rate_hz", "25")]), "rate_hz is 25, but this program has 50"),
        (
            altered("old.mcap", &[("format_version", "0")]),
            "format_version is 0, but this program has 1",
        ),
        (
            altered("narrow.mcap", &[("observations", "standard12")]),
            "the width of the network's input is 37, but its observation layout has 18",
        ),
        (
            policy.display().to_string(),
            "action_scale_m_per_s is 0.4, but limits.speed_m_per_s of the robot file has 0.3",
        ),
    ];
    let out = file(dir.path(), "out.mcap");
    for (right, expected) in cases {
        let typed = ["--left", "none", "--right", &right, "--robot", &robot];
        let (stdout, stderr, status) = play(&out, &typed);
        assert_eq!(status, 1, "{right}: {stderr}");
        assert!(stderr.contains(expected), "{right}: {stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
        assert!(stdout.is_empty() && !Path::new(&out).exists(), "{right}");
    }
}

#[test]
fn mistakes_are_told_in_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let taken = file(dir.path(), "taken.mcap");
    fs::write(&taken, "x").unwrap();
    let ekf = file(dir.path(), "ekf.json");
    fs::write(&ekf, "{}").unwrap();
    let out = file(dir.path(), "out.mcap");
    let both = ["--left", "chaser", "--right", "chaser"];
    let cases: &[Mistake<'_>] = &[
        (
            &["--left", "chasr", "--right", "none"],
            2,
            "`chasr` is no player; the players are stationary",
        ),
        (&["--left", "chaser"], 2, "--right <WHO>"),
        (&["--left", "none", "--right", "none"], 1, "nobody plays"),
        (&[both[0], both[1], both[2], both[3], "--points", "0"], 2, "0 is not in 1..=99"),
        (&[both[0], both[1], both[2], both[3], "--best-of", "3"], 2, "--points <N>"),
        (
            &[both[0], both[1], both[2], both[3], "--points", "6", "--best-of", "2"],
            2,
            "not an odd number from 1 to 99",
        ),
        (&[both[0], both[1], both[2], both[3], "--secnds", "3"], 2, "--secnds"),
        (&[both[0], both[1], both[2], both[3], "--seconds", "0"], 2, "from 1 to 7200 s"),
        (&[both[0], both[1], both[2], both[3], "--ekf", &ekf], 1, "schema_version is missing"),
        (&[both[0], both[1], both[2], both[3], "--rig", &ekf, "-o", &taken], 1, "taken.mcap"),
        (&[both[0], both[1], both[2], both[3], "--bus", "slcan:/dev/nothing"], 1, "give --camera"),
        (&[both[0], both[1], both[2], both[3], "--bus", "replay:bus.log"], 1, "is a log"),
    ];
    check_mistakes("play", &out, cases);
    assert_eq!(fs::read(&taken).unwrap(), b"x");
}
