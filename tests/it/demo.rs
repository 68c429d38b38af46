//! `klasktron demo`: every command runs, what is finished is kept, what fails is told.

use crate::support::{klasktron, said};
use std::{collections::BTreeMap, fs, path::Path};

/// Names and bytes of the finished recordings and results in a demo's folder.
fn results(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let names = ["monday.mcap", "actuator/actuator.mcap", "ekf/ekf.json", "gap/twin.json"];
    let more = [
        "twin/policy.mcap",
        "matches/learned-chaser-left.mcap",
        "simulated/twin-sensors-chaser-left.mcap",
        "eval/score.json",
    ];
    names
        .into_iter()
        .chain(more)
        .map(|name| (name.to_owned(), fs::read(folder.join(name)).unwrap()))
        .collect()
}

#[test]
fn the_demo_runs_every_command_keeps_what_is_finished_and_goes_on_after_a_failure() {
    let dir = tempfile::tempdir().unwrap();
    let demo = dir.path().join("demo");
    let run = || {
        let out = demo.display().to_string();
        said(&klasktron(&["demo", "--smallest", "--json", "--output", &out]))
    };
    let (printed, told, status) = run();
    assert_eq!(status, 0, "{told}");
    let document: serde_json::Value = serde_json::from_str(&printed).unwrap();
    let count = |value: &serde_json::Value| value.as_array().unwrap().len();
    assert_eq!(count(&document["experiment"]["contests"]), 12);
    assert_eq!(count(&document["experiment"]["differences"]), 7);
    let page = fs::read_to_string(demo.join("index.html")).unwrap();
    let line = "klasktron train --settings training.json --actuator gap/twin.json";
    for word in ["Close the gap", line, "class=\"chart\"", "Hidden effects"] {
        assert!(page.contains(word), "{word}");
    }
    let before = results(&demo);

    // All is kept; nothing is run again.
    let (_, told, status) = run();
    assert_eq!(status, 0, "{told}");
    assert_eq!(told.matches(": kept").count(), count(&document["steps"]));

    // A result that is gone is made again, with the same bytes.
    fs::remove_dir_all(demo.join("twin")).unwrap();
    let (_, told, status) = run();
    assert_eq!(status, 0, "{told}");
    assert!(
        told.lines().any(|line| line.contains("train-twin: ") && line.ends_with(" s")),
        "{told}"
    );
    assert_eq!(results(&demo), before);

    // A step that cannot be done is named, with the way to its log.
    fs::remove_file(demo.join("steps/gap.json")).unwrap();
    fs::write(demo.join("monday.mcap"), b"no recording").unwrap();
    let (_, told, status) = run();
    assert_eq!(status, 1);
    assert!(told.contains("gap monday.mcap") && told.contains("steps/gap.log"), "{told}");
    assert_eq!(told.matches("error: ").count(), 1, "{told}");
}
