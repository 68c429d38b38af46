//! The local engine: nothing twice, nothing lost, the same bytes with any number of workers.

use super::support::{Bench, files, finished, made};
use crate::support::said;
use serde_json::Value;
use std::{
    fs,
    path::Path,
    process::{Child, Command, Stdio},
    thread,
    time::Duration,
};

#[test]
fn a_finished_point_is_never_run_again_and_workers_do_not_matter() {
    let bench = Bench::new(4, "");
    let [one, two] = ["one", "two"].map(|name| bench.out(name));
    let (stdout, stderr, status) = bench.run(&one, &["--workers", "1"]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.contains("chosen by the one-standard-error rule"), "{stdout}");
    assert_eq!(bench.run(&two, &["--workers", "2"]).2, 0);
    assert!(files(&one) == files(&two), "1 and 2 workers differ");
    let before = made(&one);
    assert_eq!(before.len(), 4);
    let (_, stderr, status) = bench.run(&one, &[]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("4 of 4 points are finished already"), "{stderr}");
    assert_eq!(made(&one), before);
    // A point more is one run more.
    let text = fs::read_to_string(bench.file()).unwrap().replace("seeds = 4", "seeds = 5");
    fs::write(bench.file(), text).unwrap();
    assert_eq!(bench.run(&one, &[]).2, 0);
    let after = made(&one);
    assert_eq!(after.len(), 5);
    assert!(before.iter().all(|(name, when)| after[name] == *when));
}

#[test]
fn a_point_has_the_bytes_of_the_command_typed_by_hand() {
    let bench = Bench::new(1, "");
    let out = bench.out("out");
    assert_eq!(bench.run(&out, &[]).2, 0);
    let hand = bench.out("hand");
    let typed = Command::new(env!("CARGO_BIN_EXE_klasktron"))
        .args(["eval", "match.mcap", "--seed", "0", "--json", "--output"])
        .arg(&hand)
        .current_dir(bench.folder())
        .output()
        .unwrap();
    let (stdout, stderr, status) = said(&typed);
    assert_eq!(status, 0, "{stderr}");
    let point = out.join("points").join(&finished(&out)[0]);
    let point_files = files(&point);
    for (name, bytes) in files(&hand) {
        assert!(point_files[&name] == bytes, "{}", name.display());
    }
    assert_eq!(point_files[Path::new("result.json")], stdout.as_bytes());
}

#[test]
fn the_table_and_the_document_have_every_point() {
    let bench = Bench::new(3, "metric = \"summary.possession_left.mean\"\nbetter = \"larger\"\n");
    let out = bench.out("out");
    let (stdout, stderr, status) = bench.run(&out, &["--json"]);
    assert_eq!(status, 0, "{stderr}");
    let document: Value = serde_json::from_str(&stdout).unwrap();
    crate::schema::assert_valid("sweep", &document);
    assert_eq!(document["finished"], 3);
    assert_eq!(document["metric"]["path"], "summary.possession_left.mean");
    assert_eq!(document["chosen"]["values"].as_array().unwrap().len(), 3);
    let table = fs::read_to_string(out.join("table.csv")).unwrap();
    let mut lines = table.lines();
    let head: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!(head[..4], ["point", "seed", "status", "metric"]);
    assert!(head.contains(&"result.summary.scoring_rate_per_min.mean"));
    for (seed, line) in lines.enumerate() {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!((cells[1], cells[2]), (seed.to_string().as_str(), "0"));
        let metric: f64 = cells[3].parse().unwrap();
        assert!((metric - document["chosen"]["mean"].as_f64().unwrap()).abs() < 1e-12, "{line}");
    }
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    for part in ["3 of 3 points are finished", "table.parquet", "Provenance"] {
        assert!(page.contains(part), "{part}");
    }
}

#[test]
fn a_failed_point_is_told_kept_and_tried_again_when_asked() {
    let bench = Bench::new(1, "[[points]]\ncompare = [\"match.mcap\", \"match.mcap\"]\n");
    // The match stands in the way of --compare, so the file is refused before anything is run.
    let out = bench.out("out");
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 1);
    assert!(stderr.contains("cannot be used with"), "{stderr}");

    let bench = Bench::new(1, "");
    let out = bench.out("out");
    let good = fs::read(bench.folder().join("match.mcap")).unwrap();
    fs::write(bench.folder().join("match.mcap"), b"no recording at all").unwrap();
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 3, "{stderr}");
    assert!(stderr.contains("failed: seed 0: match.mcap: not an MCAP file"), "{stderr}");
    assert!(stderr.contains("1 point failed; run it again with --retry"), "{stderr}");
    let document = fs::read_to_string(out.join("sweep.json")).unwrap();
    crate::schema::assert_valid("sweep", &serde_json::from_str(&document).unwrap());
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Failed points") && page.contains("not an MCAP file"));
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 3);
    assert!(!stderr.contains("[1/1]"), "a failed point was run again: {stderr}");
    let (_, stderr, status) = bench.run(&out, &["--retry"]);
    assert_eq!(status, 3);
    assert!(stderr.contains("[1/1] seed 0: failed"), "{stderr}");
    // Another content is another point.
    fs::write(bench.folder().join("match.mcap"), good).unwrap();
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 0, "{stderr}");
}

fn start(bench: &Bench, out: &Path) -> Child {
    let mut command = bench.command(out, &["--workers", "2"]);
    command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

fn wait_for_points(out: &Path, count: usize) {
    while finished(out).len() < count {
        thread::sleep(Duration::from_millis(2));
    }
}

#[cfg(unix)]
#[test]
fn killed_it_goes_on_and_a_second_one_is_told_who_is_first() {
    let bench = Bench::new(10, "");
    let [out, whole] = ["out", "whole"].map(|name| bench.out(name));
    let mut first = start(&bench, &out);
    wait_for_points(&out, 1);
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 1);
    let holder = format!("another sweep is running in this folder: process {} on ", first.id());
    assert!(stderr.contains(&holder), "{stderr}");
    first.kill().unwrap();
    first.wait().unwrap();
    let before = made(&out);
    assert!(before.len() < 10, "it was over before it could be killed");
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 0, "{stderr}");
    let after = made(&out);
    assert_eq!(after.len(), 10);
    assert!(
        before.iter().all(|(name, when)| after[name] == *when),
        "a finished point was run again"
    );
    assert_eq!(bench.run(&whole, &[]).2, 0);
    assert!(files(&out) == files(&whole), "a killed sweep ends with other bytes");
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_what_is_finished_and_says_how_to_go_on() {
    let bench = Bench::new(10, "");
    let out = bench.out("out");
    let first = start(&bench, &out);
    wait_for_points(&out, 1);
    let pid = first.id().to_string();
    assert!(Command::new("kill").args(["-INT", &pid]).status().unwrap().success());
    let ended = first.wait_with_output().unwrap();
    let stderr = String::from_utf8(ended.stderr).unwrap();
    assert_eq!(ended.status.code(), Some(130), "{stderr}");
    let count = finished(&out).len();
    let said =
        format!("interrupted: {count} of 10 points are finished; the same command continues");
    assert!(stderr.contains(&said), "{stderr}");
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("still to be run"));
    let (_, stderr, status) = bench.run(&out, &[]);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains(&format!("{count} of 10 points are finished already")), "{stderr}");
}

#[test]
fn options_of_slurm_want_slurm() {
    let bench = Bench::new(1, "");
    let (_, stderr, status) = bench.run(&bench.out("out"), &["--mem", "1G"]);
    assert_eq!(status, 1);
    assert!(stderr.contains("need --engine slurm"), "{stderr}");
    let (stdout, _, status) = bench.run(&bench.out("out"), &["--dry-run"]);
    assert_eq!(status, 0);
    assert_eq!(stdout, "klasktron eval match.mcap --seed 0\n1 points, of which 0 are finished\n");
}
