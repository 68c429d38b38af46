//! `klasktron effects`: the catalogue in the terminal, as JSON, and as the page of the documentation.

use crate::support::{klasktron, said};
use std::{fs, path::Path};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn printed(arguments: &[&str]) -> String {
    let (stdout, stderr, status) = said(&klasktron(&[&["effects"], arguments].concat()));
    assert_eq!((stderr.as_str(), status), ("", 0), "{arguments:?}");
    stdout
}

#[test]
fn the_page_and_its_diagram_are_those_of_the_program() {
    for (option, file) in
        [("--markdown", "docs/effects.md"), ("--diagram", "docs/pictures/effects.svg")]
    {
        let text = fs::read_to_string(root().join(file)).unwrap_or_default();
        assert!(
            printed(&[option]) == text,
            "{file} is not that of the program: run scripts/make_effects_page"
        );
    }
}

#[test]
fn the_catalogue_is_listed_by_domain_group_and_name() {
    let all = printed(&[]);
    for domain in ["drive: ", "gantry: ", "coupling: ", "ball: ", "impact: ", "sensor: "] {
        assert!(all.lines().any(|line| line.starts_with(domain)), "{domain}");
    }
    let group = printed(&["drive.friction"]);
    assert!(group.contains("drive.friction.stribeck") && !group.contains("drive.backlash"));
    let one = printed(&["drive.backlash"]);
    for label in ["equation", "parameters", "signals", "excitation", "confused with", "reference"] {
        assert!(one.lines().any(|line| line.starts_with(label)), "{label}: {one}");
    }
}

#[test]
fn the_json_document_has_every_effect_or_the_chosen_ones() {
    let document = |arguments: &[&str]| -> serde_json::Value {
        serde_json::from_str(&printed(arguments)).unwrap()
    };
    let all = document(&["--json"]);
    assert_eq!(all["schema_version"], 1);
    assert_eq!(all["effects"].as_array().unwrap().len(), klasktron::effects::CATALOGUE.len());
    let one = document(&["--json", "sensor.camera_latency"]);
    let effects = one["effects"].as_array().unwrap();
    assert_eq!(effects.len(), 1);
    assert_eq!(effects[0]["parameters"][0]["name"], "latency_s");
    assert_eq!(effects[0]["locations"], serde_json::json!(["all"]));
}

#[test]
fn an_unknown_effect_is_a_usage_error_with_similar_names() {
    for (typed, expected) in [
        ("drive.backlsh", "similar: drive.backlash"),
        ("stribeck", "similar: drive.friction.stribeck"),
        ("qqq", "no such effect; `klasktron effects` lists all"),
    ] {
        let (stdout, stderr, status) = said(&klasktron(&["effects", typed]));
        assert_eq!((stdout.as_str(), status), ("", 2), "{typed}");
        assert!(stderr.contains(expected), "{typed}: {stderr}");
    }
}
