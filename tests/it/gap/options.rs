//! Options of the search: selected effects, known values, error, masks, validation sessions, threads.

use super::{Axis, names};
use crate::support::{klasktron, said};
use serde_json::Value;
use std::{fs, path::Path};

/// The program with these words: its document, standard error and status.
fn run(words: &[&str]) -> (Value, String, i32) {
    let (text, errors, status) = said(&klasktron(words));
    let document = serde_json::from_str(&text);
    (document.unwrap_or_else(|_| panic!("no document: {text} {errors}")), errors, status)
}

/// The document of `command` on `recordings` with `more` options.
fn document(command: &str, recordings: &[String; 2], out: &Path, more: &[&str]) -> Value {
    let out = out.to_str().unwrap();
    let words = [&[command, &recordings[0], &recordings[1], "--json", "-o", out], more].concat();
    run(&words).0
}

/// Values of the parameter in a twin, with their sources.
fn parameter(twin: &Path, effect: &str) -> (f64, String) {
    let twin: Value = serde_json::from_slice(&fs::read(twin).unwrap()).unwrap();
    let effects = twin["effects"].as_array().unwrap();
    let own = effects.iter().find(|own| own["name"] == effect).unwrap();
    let first = &own["parameters"][0];
    (first["value"].as_f64().unwrap(), first["source"].as_str().unwrap().to_owned())
}

#[test]
fn only_selected_effects_are_searched_and_the_error_is_chosen() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [80.0, 140.0]);
    let asymmetric = "drive.friction.asymmetric";
    let found = |name: &str, more: &[&str]| {
        let document = document("gap", &recordings, &dir.path().join(name), more);
        let rejected = document["rejected"].as_array().unwrap();
        let tried = rejected.iter().map(|own| own["name"].as_str().unwrap().to_owned());
        let tried: Vec<String> = tried.collect();
        (names(&document).iter().map(|name| (*name).to_owned()).collect::<Vec<_>>(), tried)
    };
    assert_eq!(found("only", &["--only", "drive.friction"]).0, [asymmetric]);
    let (added, tried) = found("other", &["--only", "drive.delay", "--only", "drive.gain"]);
    assert!(!added.contains(&asymmetric.to_owned()));
    assert!(tried.iter().all(|name| ["drive.delay", "drive.gain"].contains(&name.as_str())));
    let (added, tried) = found("without", &["--exclude", asymmetric]);
    assert!(![added, tried].concat().contains(&asymmetric.to_owned()));
    assert_eq!(found("strict", &["--alpha", "1e-100"]).0, [""; 0]);
}

#[test]
fn a_known_value_stays_and_a_calibration_fits_only_what_is_selected() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [100.0; 2]);
    let viscous = "drive.friction.viscous";
    let [free, fixed, only, one] =
        ["free", "fixed", "only", "one"].map(|name| dir.path().join(format!("{name}.json")));
    document("calibrate", &recordings, &free, &[]);
    assert!((parameter(&free, viscous).0 - 100.0).abs() < 3.0);
    let known = "drive.friction.viscous.coefficient_n_s_per_m=90";
    document("calibrate", &recordings, &fixed, &["--fix", known]);
    assert_eq!(parameter(&fixed, viscous), (90.0, "known".to_owned()));
    // The other parameters make up for it.
    let coulomb = "drive.friction.coulomb";
    assert!(parameter(&free, coulomb).0 + 0.1 < parameter(&fixed, coulomb).0);
    document("calibrate", &recordings, &only, &["--only", viscous]);
    assert_eq!(parameter(&only, "gantry.inertia").1, "nominal");
    assert_eq!(parameter(&only, viscous).1, "fitted");
    // Threads change nothing.
    document("calibrate", &recordings, &one, &["--threads", "1"]);
    assert!(fs::read(&one).unwrap() == fs::read(&free).unwrap());
}

#[test]
fn a_masked_time_counts_nowhere() {
    let dir = tempfile::tempdir().unwrap();
    let knocked = Axis { knock: 400.0, ..Axis::session([100.0; 2]) };
    let recordings = knocked.written_twice(dir.path());
    let rms = |name: &str, more: &[&str]| {
        let out = dir.path().join(format!("{name}.json"));
        let document = document("calibrate", &recordings, &out, more);
        let warnings = document["warnings"].to_string();
        (document["residuals"][0]["train_after"].as_f64().unwrap(), warnings)
    };
    let quiet = rms("masked", &["--mask", "one.mcap:5.5..6.7"]);
    assert!(!quiet.1.contains("6."), "{}", quiet.1);
    // The disturbance is found without the mask too, and reported.
    let found = rms("found", &[]);
    assert!(found.1.contains("6."), "{}", found.1);
    assert!(quiet.0 < 1.1 * found.0, "{quiet:?} {found:?}");
}

#[test]
fn the_user_chooses_the_validation_session() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, seed: u64| {
        let axis = Axis { seed, ..Axis::session([100.0; 2]) };
        axis.write(dir.path(), name).display().to_string()
    };
    let recordings = [write("one.mcap", 1), write("two.mcap", 2)];
    let out = dir.path().join("twin.json");
    document("calibrate", &recordings, &out, &["--validation", "two.mcap"]);
    let twin: Value = serde_json::from_slice(&fs::read(&out).unwrap()).unwrap();
    // Only the other recording was fitted.
    assert_eq!(twin["fitted_to_sha256"].as_array().unwrap().len(), 1);
    let sha256 = klasktron::recording::sha256_of_file(Path::new(&recordings[0])).unwrap();
    assert_eq!(twin["fitted_to_sha256"][0], sha256.as_str());
    // A file that is not among the recordings is read as well.
    let other = dir.path().join("other.json");
    let [first, second] = &recordings;
    let words = ["calibrate", first, "--validation", second, "-o", other.to_str().unwrap()];
    assert_eq!(said(&klasktron(&words)).2, 0);
    assert!(fs::read(&other).unwrap() == fs::read(&out).unwrap());
}

#[test]
fn selected_effects_that_the_recordings_cannot_show_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [100.0; 2]);
    let found = |name: &str, more: &[&str]| {
        let out = dir.path().join(name);
        let base = ["gap", &recordings[0], &recordings[1], "--json", "-o", out.to_str().unwrap()];
        run(&[&base[..], more].concat())
    };
    let (document, _, status) = found("sag", &["--only", "drive.supply_sag"]);
    assert_eq!((document["verdict"].as_str().unwrap(), status), ("not_testable", 3));
    let (document, _, status) =
        found("both", &["--only", "drive.supply_sag", "--only", "drive.delay"]);
    let warnings = document["warnings"].to_string();
    assert!(warnings.contains("drive.supply_sag was selected, but"), "{warnings}");
    assert!(!warnings.contains("drive.delay was selected") && status == 0, "{warnings}");
    let out = dir.path().join("twin.json");
    let words = ["calibrate", &recordings[0], "--only", "drive.delay", "-o", out.to_str().unwrap()];
    let (_, errors, status) = said(&klasktron(&words));
    assert!(
        status == 3 && errors.contains("the twin has none of the selected effects"),
        "{errors}"
    );
    assert!(!out.exists());
}

#[test]
fn wrong_options_are_refused_in_one_sentence_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [100.0; 2]);
    let out = dir.path().join("twin.json");
    for (more, expected_status, expected) in [
        (["--only", "drive.dealy"], 2, "did you mean 'drive.delay'?"),
        (["--exclude", "frction"], 2, "is no effect and no group of effects"),
        (["--fix", "drive.delay.delay_s"], 2, "write EFFECT.PARAMETER=VALUE"),
        (["--fix", "drive.delay.delay=0.01"], 2, "its parameters are delay_s"),
        (["--fix", "drive.delay.delay_s=7"], 1, "allowed are -0.02 to 0.2 s"),
        (["--fix", "ball.rolling_resistance.coefficent=0.1"], 2, "its parameters are coefficient"),
        (["--alpha", "2"], 2, "must be a probability above 0 and at most 0.5"),
        (["--mask", "5"], 2, "FROM..TO"),
        (["--mask", "three:1..2"], 1, "'three' is none of the recordings"),
        (["--mask", "100..110"], 1, "begins behind the end of the session"),
        (["--validation", "tow"], 1, "'tow' is none of the recordings"),
        (["--threads", "0"], 2, "--threads"),
    ] {
        let base = ["calibrate", &recordings[0], &recordings[1], "-o", out.to_str().unwrap()];
        let words = [&base[..], &more[..]];
        let (stdout, stderr, status) = said(&klasktron(&words.concat()));
        assert_eq!((stdout.as_str(), status), ("", expected_status), "{more:?}: {stderr}");
        assert!(stderr.contains(expected), "{more:?}: {stderr}");
        assert!(status == 2 || stderr.trim_end().lines().count() == 1, "{stderr}");
        assert!(!out.exists());
    }
}
