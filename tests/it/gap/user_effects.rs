//! Effects that a user defines with `--effects`.

use super::{Axis, gap_with, names};
use crate::support::{klasktron, said};
use std::{fs, path::Path};

/// What holds the carriage in the middle (N/m^3).
const HARDENING: f64 = 4e4;

/// Relative error of an estimate from twenty seconds.
const TOLERANCE: f64 = 0.05;

const SPRING: &str = r#"[[effect]]
name = "user.hardening_spring"
summary = "a spring that hardens pulls the carriage to the middle"
place = "force"
expression = "-hardening * position^3"
confused_with = ["gantry.stiffness"]

[[effect.parameter]]
name = "hardening"
unit = "N/m^3"
typical = 1e4
sign = "positive"
"#;

fn sprung(dir: &Path) -> [String; 2] {
    Axis { hardening: HARDENING, ..Axis::session([100.0, 100.0]) }.written_twice(dir)
}

fn written(dir: &Path, text: &str) -> String {
    let path = dir.join("effects.toml");
    fs::write(&path, text).unwrap();
    path.display().to_string()
}

#[test]
fn an_effect_of_the_user_is_named_kept_in_the_twin_and_simulated() {
    let dir = tempfile::tempdir().unwrap();
    let (recordings, file) = (sprung(dir.path()), written(dir.path(), SPRING));
    let (document, status) =
        gap_with(&recordings, vec!["--effects", &file], &dir.path().join("out"));
    assert_eq!(status, 0);
    assert_eq!(names(&document), ["user.hardening_spring"], "{document:#}");
    let parameter = &document["effects"][0]["parameters"][0];
    assert_eq!(parameter["unit"], "N/m^3");
    let value = parameter["value"].as_f64().unwrap();
    assert!((value / HARDENING - 1.0).abs() < TOLERANCE, "{parameter}");

    // The twin holds the definition: neither another search nor a simulation needs the file.
    let twin = dir.path().join("out/twin.json").display().to_string();
    let (again, _) = gap_with(&recordings, vec!["--twin", &twin], &dir.path().join("again"));
    assert_eq!(again["verdict"], "none", "{again:#}");
    let motion = dir.path().join("motion.mcap").display().to_string();
    let simulate = ["simulate", &twin, "--commands", &recordings[0], "--output", &motion];
    let (_, errors, status) = said(&klasktron(&simulate));
    assert_eq!(status, 0, "{errors}");
}

#[test]
fn an_expression_without_a_value_in_the_recorded_motion_is_named_and_not_fatal() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = sprung(dir.path());
    let file =
        written(dir.path(), &SPRING.replace("-hardening * position^3", "hardening * ln(position)"));
    let options = vec!["--effects", &file, "--only", "user.hardening_spring"];
    let (document, status) = gap_with(&recordings, options, &dir.path().join("out"));
    assert_eq!(status, 0);
    assert!(names(&document).is_empty(), "{document:#}");
    let warnings = document["warnings"].to_string();
    assert!(warnings.contains("user.hardening_spring was not searched"), "{warnings}");
    assert!(warnings.contains("is NaN at position = -"), "{warnings}");
}

#[test]
fn a_mistake_in_the_file_is_told_with_its_place_before_anything_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let file = written(dir.path(), &SPRING.replace("position^3", "positon^3"));
    let (_, errors, status) = said(&klasktron(&["gap", "none.mcap", "--effects", &file]));
    assert_eq!(status, 2, "{errors}");
    assert!(errors.contains("effects.toml:5:15: the expression"), "{errors}");
    assert!(errors.contains("did you mean 'position'?"), "{errors}");
}
