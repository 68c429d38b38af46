//! `klasktron export` of tables as a process.

use crate::support::{Rig, klasktron, said};
use std::{collections::BTreeSet, fs};

#[test]
fn several_topics_give_a_folder_and_one_gives_a_file() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig { seconds: 1, ..Rig::default() }.write(dir.path(), "good.mcap");
    let name = path.to_str().unwrap();
    for format in ["csv", "parquet", "npz"] {
        let out = dir.path().join(format);
        let args = ["export", name, "--to", format, "--output", out.to_str().unwrap()];
        let (_, stderr, status) = said(&klasktron(&args));
        assert_eq!((status, stderr.as_str()), (0, ""));
        let files: BTreeSet<String> = fs::read_dir(&out)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        let expected = ["run_marker", "striker_left_carriage", "striker_left_command"];
        assert_eq!(files, expected.iter().map(|name| format!("{name}.{format}")).collect());
    }
    let out = dir.path().join("one.csv");
    let file = out.to_str().unwrap();
    let args =
        ["export", name, "--to", "csv", "--output", file, "--topic", "/striker/left/command"];
    assert_eq!(said(&klasktron(&args)).2, 0);
    let text = fs::read_to_string(&out).unwrap();
    assert!(text.starts_with("log_time_ns,publish_time_ns,vx,vy\n1700000000000000000,"), "{text}");
    assert_eq!(text.lines().count(), 51);
    let (_, stderr, status) = said(&klasktron(&args));
    assert_eq!(status, 1);
    assert!(stderr.contains("exists already"), "{stderr}");
}

#[test]
fn what_cannot_be_exported_is_one_sentence() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig { seconds: 1, ..Rig::default() }.write(dir.path(), "good.mcap");
    let out = dir.path().join("out");
    let base = ["export", path.to_str().unwrap(), "--output", out.to_str().unwrap(), "--to"];
    let with = |rest: &[&str]| said(&klasktron(&[&base[..], rest].concat()));
    let (_, stderr, status) = with(&["csv", "--topic", "/no"]);
    assert_eq!(status, 1);
    assert!(stderr.contains("no topic /no; it has /run/marker, /striker"), "{stderr}");
    let (_, stderr, status) = with(&["onnx"]);
    assert_eq!(status, 1);
    assert!(stderr.contains("no actuator model in this file"), "{stderr}");
    assert!(!out.exists());
}
