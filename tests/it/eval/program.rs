//! The program: files in, files out, exit statuses.

use super::{
    game::{CAMERA, play},
    recorded::{write_detections, write_detections_with_biscuits, write_states},
};
use crate::support::{klasktron, said};
use klasktron::{
    recording::{Recording, message::MatchEvent, topic::MATCH_EVENT},
    referee::{EventKind, MatchFrames},
};
use std::{fs, path::Path};

/// Of the README's example.
const EXAMPLE_SEED: u64 = 102;
const EXAMPLE_SECONDS: f64 = 60.0;

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Two biscuits get onto the left striker during the fourth episode and stay: it ends with a point of the right player, and
/// no other one begins.
#[test]
fn two_biscuits_on_a_striker_lose_the_point() {
    let dir = tempfile::tempdir().unwrap();
    let game = play(11, 60.0, CAMERA);
    let since = 25.0;
    let path = write_detections_with_biscuits(&game.pictures, since, dir.path(), "match.mcap");
    let out = dir.path().join("out");
    let (_, stderr, status) = said(&klasktron(&["eval", text(&path), "--output", text(&out)]));
    assert_eq!((status, stderr.as_str()), (0, ""));
    let score = json(&out.join("score.json"));
    crate::schema::assert_valid("score", &score);
    let episodes = score["matches"][0]["episodes"].as_array().unwrap();
    let outcomes: Vec<_> = episodes.iter().map(|own| own["outcome"].as_str().unwrap()).collect();
    assert_eq!(outcomes, ["goal", "goal", "goal", "two_biscuits"]);
    assert_eq!(episodes[3]["scorer"], "right");
    let end = episodes[3]["end_s"].as_f64().unwrap();
    assert!((end - since).abs() < 0.05, "{end} s");
}

#[test]
fn a_match_becomes_a_score_with_everything_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let game = play(11, 60.0, CAMERA);
    let path = write_detections(&game.pictures, dir.path(), "match.mcap");
    let out = dir.path().join("out");
    let (stdout, stderr, status) =
        said(&klasktron(&["eval", text(&path), "--output", text(&out), "--json"]));
    assert_eq!((status, stderr.as_str()), (0, ""));
    let score = json(&out.join("score.json"));
    assert_eq!(score, serde_json::from_str::<serde_json::Value>(&stdout).unwrap());
    let keys = |value: &serde_json::Value| -> Vec<String> {
        value.as_object().unwrap().keys().cloned().collect()
    };
    assert_eq!(keys(&score), ["events_file", "matches", "schema_version", "summary", "warnings"]);
    let one = &score["matches"][0];
    assert_eq!(keys(one), ["duration_s", "episodes", "file", "winner"]);
    let mut of_episode = keys(&one["episodes"][0]);
    of_episode.sort();
    assert_eq!(
        of_episode,
        [
            "blocks_left",
            "blocks_right",
            "contacts",
            "end_s",
            "goal_directed_left",
            "goal_directed_right",
            "outcome",
            "possession_left",
            "scorer",
            "start_s",
            "strikes_left",
            "strikes_right"
        ]
    );
    let figure = &score["summary"]["contacts_per_episode"];
    assert_eq!(keys(figure), ["ci95", "mean", "n"]);
    assert!(figure["ci95"][0].as_f64().unwrap() <= figure["mean"].as_f64().unwrap());

    let events = Recording::open(&out.join(score["events_file"].as_str().unwrap())).unwrap();
    let series = events.series::<MatchEvent>(MATCH_EVENT).unwrap();
    let strikes = series.values.iter().filter(|e| e.kind == EventKind::Strike.name()).count();
    let episodes = one["episodes"].as_array().unwrap();
    let sum = |key: &str| episodes.iter().map(|e| e[key].as_u64().unwrap()).sum::<u64>() as usize;
    assert_eq!(strikes, sum("strikes_left") + sum("strikes_right"));
    assert!(events.info("command_line").unwrap().starts_with("klasktron eval "));

    let csv = fs::read_to_string(out.join("episodes.csv")).unwrap();
    assert_eq!(csv.lines().count(), episodes.len() + 1);
    assert!(csv.starts_with("file,episode,start_s,end_s,outcome,scorer,contacts,blocks_left"));
    assert!(fs::read(out.join("episodes.parquet")).unwrap().starts_with(b"PAR1"));
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    for part in ["id=\"replay\"", "Goal-directed hit", "table I", "goals per minute of play"] {
        assert!(page.contains(part), "{part}");
    }
    assert!(!page.contains("src=\"http") && !page.contains("href=\"http"));
}

#[test]
fn the_same_matches_give_the_same_bytes_whatever_the_number_of_threads() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("matches");
    fs::create_dir(&folder).unwrap();
    for seed in [21, 22, 23] {
        let game = play(seed, 20.0, CAMERA);
        write_detections(&game.pictures, &folder, &format!("{seed}.mcap"));
    }
    let files = ["score.json", "events.mcap", "episodes.csv", "index.html"];
    let bytes = |threads: &str| -> Vec<Vec<u8>> {
        let out = dir.path().join(threads);
        let run = klasktron(&["eval", text(&folder), "--output", text(&out), "--threads", threads]);
        assert_eq!(said(&run).2, 0);
        files.iter().map(|file| fs::read(out.join(file)).unwrap()).collect()
    };
    assert_eq!(bytes("1"), bytes("3"));
}

#[test]
fn a_broken_file_is_told_and_does_not_stop_the_rest() {
    let dir = tempfile::tempdir().unwrap();
    let game = play(31, 20.0, CAMERA);
    let good = write_detections(&game.pictures, dir.path(), "good.mcap");
    let broken = dir.path().join("broken.mcap");
    fs::write(&broken, "no match at all").unwrap();
    let cut = dir.path().join("cut.mcap");
    let bytes = fs::read(&good).unwrap();
    fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let out = dir.path().join("out");
    let run = klasktron(&["eval", text(&broken), text(&good), text(&cut), "--output", text(&out)]);
    let (_, stderr, status) = said(&run);
    assert_eq!(status, 3);
    assert!(stderr.contains("broken.mcap: not an MCAP file"), "{stderr}");
    assert!(stderr.contains("cut.mcap: cut off at byte"), "{stderr}");
    assert_eq!(json(&out.join("score.json"))["matches"].as_array().unwrap().len(), 2);
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Not analysed") && page.contains("is damaged"));
    // Alone, its error is that of the command.
    let (_, stderr, status) =
        said(&klasktron(&["eval", text(&broken), "--output", text(&out), "--overwrite"]));
    assert_eq!(status, 1);
    assert!(stderr.starts_with("error: ") && stderr.contains("klasktron import"), "{stderr}");
    let (_, stderr, status) = said(&klasktron(&[
        "eval",
        "tests/data/example-train.mcap",
        "-o",
        text(&out),
        "--overwrite",
    ]));
    // The example holds detections of strikers, but no ball ever: a match without an episode.
    assert_eq!(status, 3);
    assert!(stderr.starts_with("warning: ") && stderr.contains("no episode: the ball"), "{stderr}");
    assert!(json(&out.join("score.json"))["warnings"][0].as_str().unwrap().contains("no episode"));
    assert_eq!(said(&klasktron(&["eval"])).2, 2);
    let empty = dir.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let (_, stderr, status) = said(&klasktron(&["eval", text(&empty)]));
    assert_eq!(status, 1);
    assert!(stderr.contains("no .mcap file"), "{stderr}");
}

#[test]
fn two_groups_are_compared_with_interval_and_test() {
    let dir = tempfile::tempdir().unwrap();
    let group = |name: &str, seeds: std::ops::Range<u64>, hide: bool| {
        let folder = dir.path().join(name);
        fs::create_dir(&folder).unwrap();
        for seed in seeds {
            let mut pictures = play(seed, 150.0, CAMERA).pictures;
            if hide {
                // Without a left striker there is nobody to touch the ball on that side.
                pictures.iter_mut().for_each(|picture| picture.strikers[0] = None);
            }
            write_detections(&pictures, &folder, &format!("{seed}.mcap"));
        }
        folder
    };
    let (a, b, c) =
        (group("a", 40..43, false), group("b", 43..46, false), group("c", 46..49, true));
    let compared = |b: &Path| {
        let out = dir.path().join("out");
        let typed = ["eval", "--compare", text(&a), text(b), "-o", text(&out), "--overwrite"];
        let run = klasktron(&typed);
        assert_eq!(said(&run).2, 0);
        json(&out.join("score.json"))["comparison"].clone()
    };
    let alike = compared(&b);
    let sentence = alike["summary"].as_str().unwrap();
    assert!(sentence.starts_with("no significant difference between"), "{sentence}");
    assert_eq!(alike["matches"], serde_json::json!([3, 3]));
    let other = compared(&c);
    let sentence = other["summary"].as_str().unwrap();
    let possession = "possession of the left player";
    assert!(sentence.contains("differs from") && sentence.contains(possession), "{sentence}");
    let metric = |name: &str| {
        let metrics = other["metrics"].as_array().unwrap();
        metrics.iter().find(|metric| metric["metric"] == name).unwrap().clone()
    };
    assert!(metric("contacts_per_episode")["difference"].as_f64().unwrap() < 0.0);
    let possession = metric("possession_left");
    assert!(possession["ci95"][1].as_f64().unwrap() < 0.0);
    assert!(possession["p_value_corrected"].as_f64().unwrap() < 0.05);
}

#[test]
fn the_filtered_state_is_judged_where_there_are_no_detections() {
    let dir = tempfile::tempdir().unwrap();
    let game = play(51, 90.0, CAMERA);
    let by_camera = write_detections(&game.pictures, dir.path(), "camera.mcap");
    let by_state = write_states(&game.pictures, dir.path(), "state.mcap");
    assert_eq!(MatchFrames::open(&by_camera).unwrap().frames.len(), game.pictures.len());
    let contacts = |path: &Path| {
        let out = dir.path().join("out");
        assert_eq!(said(&klasktron(&["eval", text(path), "-o", text(&out), "--overwrite"])).2, 0);
        let page = fs::read_to_string(out.join("index.html")).unwrap();
        let warned = page.contains("no camera detections");
        let score = json(&out.join("score.json"));
        let episodes = score["matches"][0]["episodes"].as_array().unwrap().clone();
        let sum: u64 = episodes.iter().map(|e| e["contacts"].as_u64().unwrap()).sum();
        (sum as f64, warned)
    };
    let ((camera, quiet), (state, warned)) = (contacts(&by_camera), contacts(&by_state));
    assert!(!quiet && warned);
    assert!(5.0 < camera && (state - camera).abs() <= 0.2 * camera, "{camera} {state}");
}

/// Makes the README's example: `cargo test --release --test it -- --ignored example_match`.
#[test]
#[ignore = "writes tests/data/example-match.mcap"]
fn example_match() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let name = "example-match.mcap";
    fs::remove_file(data.join(name)).ok();
    write_detections(&play(EXAMPLE_SEED, EXAMPLE_SECONDS, CAMERA).pictures, &data, name);
}
