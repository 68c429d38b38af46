//! `fit-actuator --ablate` and `train --seeds`: points of the same engines.

use super::{slurm::FakeSlurm, support::files};
use crate::support::said;
use klasktron::train::{Preset, TrainSettings};
use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

fn data(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name).display().to_string()
}

fn klasktron(args: &[&str], path: Option<&str>) -> (String, String, i32) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_klasktron"));
    if let Some(path) = path {
        command.env("PATH", path);
    }
    said(&command.args(args).output().unwrap())
}

#[test]
fn an_ablation_on_slurm_has_the_bytes_of_a_local_one_and_keeps_its_fits() {
    let dir = tempfile::tempdir().unwrap();
    let fake = FakeSlurm::new(dir.path());
    let (train, check) = (data("example-train.mcap"), data("example-validation.mcap"));
    let ablate = |name: &str, more: &[&str], path: Option<&str>| {
        let out = dir.path().join(name);
        let out_text = out.display().to_string();
        let mut args = vec!["fit-actuator", &train, &check, "--ablate", "--seeds", "1", "--epochs"];
        args.extend(["1", "--hidden-layers", "1", "--output", &out_text]);
        args.extend(more);
        (klasktron(&args, path), out)
    };
    let ((_, stderr, status), local) = ablate("local", &[], None);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("[9/9] history"), "{stderr}");
    let path = fake.path();
    let ((_, stderr, status), slurm) = ablate("slurm", &["--engine", "slurm"], Some(&path));
    assert_eq!(status, 0, "{stderr}");
    assert!(files(&local) == files(&slurm), "{stderr}");
    // What was fitted is kept, so a second time nothing is run, and fewer seeds of it neither.
    let ((_, stderr, status), _) = ablate("local", &[], None);
    assert_eq!(status, 0, "{stderr}");
    assert!(!stderr.contains("history"), "{stderr}");
    let names: Vec<PathBuf> =
        files(&local).into_keys().filter(|name| !name.starts_with("fits")).collect();
    assert_eq!(names, ["actuator.mcap", "index.html"].map(PathBuf::from));
    let refused = klasktron(&["fit-actuator", &train, "--engine", "slurm"], None);
    assert!(refused.1.contains("need --ablate"), "{}", refused.1);
}

/// Two updates of a tiny network.
fn tiny() -> TrainSettings {
    let mut settings = TrainSettings::preset(Preset::Paper);
    settings.environments = 16;
    settings.ppo.hidden = vec![4];
    settings.ppo.horizon = 8;
    settings.ppo.epochs = 1;
    settings.ppo.minibatch = 64;
    settings.evaluation.games_per_opponent = 2;
    settings.evaluation.games_per_pair = 0;
    settings.evaluation.sample_games = 1;
    settings.steps = 2 * settings.transitions_per_update();
    settings
}

#[test]
fn several_seeds_of_a_training_are_the_single_ones_and_a_page() {
    let dir = tempfile::tempdir().unwrap();
    let settings = dir.path().join("tiny.json");
    fs::write(&settings, tiny().to_json()).unwrap();
    let settings = settings.display().to_string();
    let train = |out: &str, more: &[&str], path: Option<&str>| {
        let out = dir.path().join(out);
        let out_text = out.display().to_string();
        let mut args = vec!["train", "--settings", &settings, "--output", &out_text];
        args.extend(more);
        (klasktron(&args, path), out)
    };
    let ((stdout, stderr, status), here) = train("here", &["--seeds", "2"], None);
    assert_eq!(status, 0, "{stderr}");
    assert!(stdout.contains("wrote table.csv"), "{stdout}");
    let ((_, stderr, status), single) = train("single", &["--seed", "1"], None);
    assert_eq!(status, 0, "{stderr}");
    for name in ["policy.mcap", "index.html"] {
        let [a, b] =
            [here.join("seed-1"), single.clone()].map(|out| fs::read(out.join(name)).unwrap());
        assert!(a == b, "{name} of seed 1 differs from a single run");
    }
    let page = fs::read_to_string(here.join("index.html")).unwrap();
    for part in ["2 seeds are finished", "seed-1/index.html", "every seed", "class=\"chart\""] {
        assert!(page.contains(part), "{part}");
    }
    let fake = FakeSlurm::new(dir.path());
    let path = fake.path();
    let ((_, stderr, status), there) =
        train("there", &["--seeds", "2", "--engine", "slurm"], Some(&path));
    assert_eq!(status, 0, "{stderr}");
    assert!(files(&here) == files(&there), "{stderr}");
    // One seed more is one run more; other settings are refused.
    let ((_, stderr, status), _) = train("here", &["--seeds", "3"], None);
    assert_eq!(status, 0, "{stderr}");
    assert!(stderr.contains("2 of 3 points are finished already"), "{stderr}");
    let ((_, stderr, status), _) = train("here", &["--seeds", "3", "--envs", "8"], None);
    assert_eq!(status, 1);
    assert!(stderr.contains("seed-0: holds results of other settings"), "{stderr}");
}
