//! Description of a residual that no effect of the catalogue explains.

use super::{Axis, Units, gap, gap_with, names};
use serde_json::Value;
use std::fs;

/// Drag in one direction (N s^3/m^3).
const CUBIC: f64 = 4000.0;

/// Together with quadratic friction, asymmetric friction comes so close to that drag that both are named.
const WITHOUT_ASYMMETRY: [&str; 2] = ["--exclude", "drive.friction.asymmetric"];

/// Relative error of a coefficient from twenty seconds.
const TOLERANCE: f64 = 0.05;

/// Relative difference of a coefficient from the same one in other units: scales are rounded to three digits.
const UNIT_TOLERANCE: f64 = 0.02;

fn terms(document: &Value) -> Vec<&Value> {
    document["description"]["terms"].as_array().map(|all| all.iter().collect()).unwrap_or_default()
}

fn features(document: &Value) -> Vec<&str> {
    terms(document).iter().map(|term| term["feature"].as_str().unwrap()).collect()
}

/// Size of the quantity with this symbol.
fn scale(document: &Value, symbol: &str) -> f64 {
    let all = document["description"]["scales"].as_array().unwrap();
    all.iter().find(|own| own["symbol"] == symbol).unwrap()["scale"].as_f64().unwrap()
}

/// The only term is `feature`, and its interval contains `truth` once the error of the simulation is allowed for.
fn assert_describes(document: &Value, feature: &str, truth: f64) {
    assert_eq!(document["verdict"], "unexplained", "{document:#}");
    assert_eq!(features(document), [feature], "{document:#}");
    let term = terms(document)[0];
    let value = term["coefficient"].as_f64().unwrap();
    assert!((value / truth - 1.0).abs() < TOLERANCE, "{truth}: {term:#}");
    let ends = [0, 1].map(|end| term["ci95"][end].as_f64().unwrap());
    let margin = TOLERANCE * truth.abs();
    assert!(ends[0] - margin <= truth && truth <= ends[1] + margin, "{truth}: {term:#}");
    assert_eq!(term["unit"], "N");
    let summary = document["summary"].as_str().unwrap();
    assert!(summary.contains("Description, not a cause: F = "), "{summary}");
    let journal = document["journal"].as_array().unwrap();
    assert_eq!(journal.last().unwrap()["move"]["kind"], "describe");
}

#[test]
fn drag_in_one_direction_is_described_and_does_not_depend_on_the_units() {
    let dir = tempfile::tempdir().unwrap();
    let described = |units: Units, name: &str| {
        let folder = dir.path().join(name);
        fs::create_dir(&folder).unwrap();
        let axis = Axis { cubic_forwards: CUBIC, units, ..Axis::session([100.0, 100.0]) };
        gap_with(&axis.written_twice(&folder), WITHOUT_ASYMMETRY.to_vec(), &folder.join("out")).0
    };
    let plain = described(Units::SI, "si");
    assert_describes(&plain, "[v > 0] v^3", -CUBIC * scale(&plain, "v").powi(3));
    let units = Units { input: 1e3, position: 1e-3, time: 1 };
    let other = described(units, "other");
    assert_eq!(features(&other), features(&plain), "{other:#}");
    let coefficient = |document: &Value| terms(document)[0]["coefficient"].as_f64().unwrap();
    let ratio = coefficient(&other) / (units.input * coefficient(&plain));
    assert!((ratio - 1.0).abs() < UNIT_TOLERANCE, "{ratio}");
}

#[test]
fn a_described_term_is_an_effect_of_the_user() {
    let dir = tempfile::tempdir().unwrap();
    let axis = Axis { cubic_forwards: CUBIC, ..Axis::session([100.0, 100.0]) };
    let recordings = axis.written_twice(dir.path());
    let (document, _) = gap_with(&recordings, WITHOUT_ASYMMETRY.to_vec(), &dir.path().join("out"));
    let page = fs::read_to_string(dir.path().join("out/index.html")).unwrap();
    assert!(page.contains("Description of the unexplained residual"));
    let term = terms(&document)[0];
    let file = dir.path().join("effects.toml");
    let text = format!(
        "[[effect]]\nname = \"user.described\"\nplace = \"force\"\nexpression = {}\n\n[[effect.parameter]]\n\
         name = \"coefficient\"\nunit = {}\ntypical = 1.0\n",
        term["expression"], term["unit"]
    );
    fs::write(&file, text).unwrap();
    let file = file.display().to_string();
    let options = [&WITHOUT_ASYMMETRY[..], &["--effects", &file]].concat();
    let (again, _) = gap_with(&recordings, options, &dir.path().join("again"));
    assert_eq!(again["verdict"], "named", "{again:#}");
    assert_eq!(again["effects"][0]["name"], "user.described");
    let [value, described] = [&again["effects"][0]["parameters"][0]["value"], &term["coefficient"]]
        .map(|own| own.as_f64().unwrap());
    assert!((value / described - 1.0).abs() < TOLERANCE, "{value} {described}");
}

/// Features of the description, as effects of a user.
const FEATURES: [&str; 6] = [
    "(velocity / 0.12)^3",
    "(0.5 * (velocity + abs(velocity)) / 0.12)^2",
    "(position / 0.1)^3",
    "sin(20 * position)",
    "position / 0.1 * velocity / 0.12",
    "time / 20 * signum(velocity)",
];

#[test]
fn no_feature_passes_on_white_noise() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::session([100.0, 100.0]).written_twice(dir.path());
    let definition = |(number, feature): (usize, &&str)| {
        format!(
            "[[effect]]\nname = \"feature.of_noise_{number}\"\nplace = \"force\"\n\
             expression = \"coefficient * {feature}\"\n\n[[effect.parameter]]\nname = \"coefficient\"\n\
             unit = \"N\"\ntypical = 1.0\n\n"
        )
    };
    let text: String = FEATURES.iter().enumerate().map(definition).collect();
    let file = dir.path().join("features.toml");
    fs::write(&file, text).unwrap();
    let file = file.display().to_string();
    let options = vec!["--effects", &file, "--only", "feature.of_noise_0"];
    let all: Vec<String> = (1..FEATURES.len()).map(|k| format!("feature.of_noise_{k}")).collect();
    let more = all.iter().flat_map(|name| ["--only", name.as_str()]);
    let options: Vec<&str> = options.into_iter().chain(more).collect();
    let (document, _) = gap_with(&recordings, options, &dir.path().join("out"));
    assert!(names(&document).is_empty(), "{document:#}");
    assert!(document["description"].is_null());
}

#[test]
fn an_effect_of_the_catalogue_needs_no_description() {
    let dir = tempfile::tempdir().unwrap();
    let recordings = Axis::pair(dir.path(), [80.0, 140.0]);
    let (document, _) = gap(&recordings, None, &dir.path().join("out"));
    assert_eq!(document["verdict"], "named");
    assert!(document["description"].is_null(), "{document:#}");
}
