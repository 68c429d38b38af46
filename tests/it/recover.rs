//! `klasktron recover` as a process.

use crate::support::{Rig, klasktron, said};
use klasktron::recording::Recording;
use std::fs;

#[test]
fn what_a_cut_off_file_holds_is_written_whole() {
    let dir = tempfile::tempdir().unwrap();
    let whole = Rig::default().write(dir.path(), "whole.mcap");
    let all = Recording::open(&whole).unwrap();
    let cut = dir.path().join("cut.mcap");
    let bytes = fs::read(&whole).unwrap();
    // The summary, which repeats the schemas, takes the second half of so short a file.
    fs::write(&cut, &bytes[..bytes.len() / 3]).unwrap();
    let out = dir.path().join("out.mcap");
    let args = ["recover", cut.to_str().unwrap(), "-o", out.to_str().unwrap()];
    let (stdout, stderr, status) = said(&klasktron(&args));
    assert_eq!((status, stdout.as_str()), (3, ""), "{stderr}");
    assert!(stderr.contains("lost: cut off at byte"), "{stderr}");

    let saved = Recording::open(&out).unwrap();
    assert!(saved.loss.is_none() && saved.ends_whole);
    assert_eq!(saved.metadata, all.metadata);
    for channel in &saved.channels {
        let original = all.channels_of(&channel.topic).next().unwrap();
        let messages = |c: &klasktron::recording::Channel| -> Vec<(u64, Vec<u8>)> {
            c.raw().map(|(index, bytes)| (index.log_time.0, bytes.to_vec())).collect()
        };
        assert!(messages(original).starts_with(&messages(channel)), "{}", channel.topic);
    }
    let saved_messages: usize = saved.channels.iter().map(|c| c.messages.len()).sum();
    assert!(300 < saved_messages && saved_messages < 1002, "{saved_messages}");

    // The name is taken now.
    let (_, stderr, status) = said(&klasktron(&args));
    assert_eq!(status, 1);
    assert!(stderr.contains("--overwrite"), "{stderr}");
    let mut again = args.to_vec();
    again.push("--overwrite");
    assert_eq!(said(&klasktron(&again)).2, 3);
}

#[test]
fn a_whole_file_is_copied_without_complaint_and_never_onto_itself() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig::default().write(dir.path(), "whole.mcap");
    let bytes = fs::read(&path).unwrap();
    let name = path.to_str().unwrap();
    let (_, stderr, status) = said(&klasktron(&["recover", name, "-o", name, "--overwrite"]));
    assert_eq!(status, 1);
    assert!(stderr.contains("same file"), "{stderr}");
    assert_eq!(fs::read(&path).unwrap(), bytes);
    let out = dir.path().join("out.mcap");
    let (_, stderr, status) = said(&klasktron(&["recover", name, "-o", out.to_str().unwrap()]));
    assert_eq!(status, 0, "{stderr}");
    assert!(!dir.path().join(".out.mcap.partial").exists());
}

#[test]
fn a_file_without_its_summary_lost_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let path = Rig::default().write(dir.path(), "whole.mcap");
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() - 20]).unwrap();
    let (stdout, _, status) = said(&klasktron(&["info", path.to_str().unwrap()]));
    assert_eq!(status, 0);
    assert!(stdout.contains("ends without its summary"), "{stdout}");
    let out = dir.path().join("out.mcap");
    let args = ["recover", path.to_str().unwrap(), "-o", out.to_str().unwrap()];
    assert_eq!(said(&klasktron(&args)).2, 0);
    assert!(Recording::open(&out).unwrap().ends_whole);
}
