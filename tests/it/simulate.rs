//! `klasktron simulate` and `klasktron diff`: twins run open loop, and compared.

use crate::support::{klasktron, said};
use klasktron::{
    effects::{self, Axis},
    recording::Recording,
    twin::{Instance, Machine, Source, Twin, write_twin},
};
use std::{
    fmt::Write as _,
    fs,
    path::{Path, PathBuf},
};

/// A folder with the nominal twins of both machines and with commands for each.
fn folder() -> (tempfile::TempDir, impl Fn(&str) -> String) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().to_owned();
    let at = move |name: &str| path.join(name).display().to_string();
    for (name, machine) in [("table.json", Machine::Table), ("axis.json", Machine::Axis)] {
        write_twin(&Twin::nominal(machine), &PathBuf::from(at(name))).unwrap();
    }
    let mut table = "time_s,command_vx_m_per_s,command_vy_m_per_s\n".to_owned();
    let mut axis = "time_s;force_n\n".to_owned();
    for k in 0..200 {
        let t = 0.02 * f64::from(k);
        writeln!(table, "{t},{},{}", 0.2 * (3.0 * t).sin(), 0.1 * (5.0 * t).cos()).unwrap();
        writeln!(axis, "{t};{}", 4.0 * (3.0 * t).cos()).unwrap();
    }
    fs::write(at("table.csv"), table).unwrap();
    fs::write(at("axis.csv"), axis).unwrap();
    (dir, at)
}

#[test]
fn a_simulated_table_is_a_recording_that_other_commands_read() {
    let (_dir, at) = folder();
    let output = at("out.mcap");
    let words = ["simulate", &at("table.json"), "--commands", &at("table.csv"), "-o", &output];
    let (stdout, stderr, status) = said(&klasktron(&words));
    assert_eq!((stdout.as_str(), status), ("", 0), "{stderr}");
    assert!(stderr.contains("simulated 4.0 s; wrote"), "{stderr}");
    let recording = Recording::open(Path::new(&output)).unwrap();
    assert_eq!(recording.info("source"), Some("simulation"));
    assert_eq!(recording.count("/motor/left/a"), 797);
    assert_eq!(recording.count("/camera/detections"), 478);
    let (info, stderr, status) = said(&klasktron(&["info", "--json", &output]));
    assert_eq!(status, 0, "{stderr}");
    assert!(info.contains("/striker/left/carriage"), "{info}");
    // Its own commands, simulated again, give the same motion.
    let again = at("again.mcap");
    let words = ["simulate", &at("table.json"), "--commands", &output, "-o", &again];
    assert_eq!(said(&klasktron(&words)).2, 0);
    let rows = |name: &str| fs::read_to_string(at(name)).unwrap();
    let (first, second) = (rows("out.csv"), rows("again.csv"));
    assert_eq!([&first, &second].map(|csv| csv.lines().count()), [798; 2]);
    // Recorded times are whole nanoseconds.
    for (one, other) in first.lines().zip(second.lines()).skip(1) {
        for (one, other) in one.split(',').zip(other.split(',')) {
            let [one, other] = [one, other].map(|cell| cell.parse::<f64>().unwrap());
            assert!((one - other).abs() < 1e-6, "{one} {other}");
        }
    }
    // So does the CSV, whose columns are those of commands.
    let third = at("third.mcap");
    let words = ["simulate", &at("table.json"), "--commands", &at("out.csv"), "-o", &third];
    assert_eq!(said(&klasktron(&words)).2, 0);
}

#[test]
fn a_simulated_axis_moves_as_its_force_says() {
    let (_dir, at) = folder();
    let output = at("out.mcap");
    let words = [
        "simulate",
        &at("axis.json"),
        "--commands",
        &at("axis.csv"),
        "--axis",
        "slide",
        "-o",
        &output,
    ];
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 0, "{stderr}");
    let recording = Recording::open(Path::new(&output)).unwrap();
    assert_eq!(recording.count("/axis/slide/output"), 200);
    // The nominal axis is 1 kg without friction: v = 4/3 sin(3 t), q = 4/9 (1 - cos(3 t)).
    let csv = fs::read_to_string(at("out.csv")).unwrap();
    let last: Vec<f64> =
        csv.lines().last().unwrap().split(',').map(|cell| cell.parse().unwrap()).collect();
    let angle = 3.0 * last[0];
    assert!((last[3] - 4.0 / 3.0 * angle.sin()).abs() < 2e-3, "{last:?}");
    assert!((last[2] - 4.0 / 9.0 * (1.0 - angle.cos())).abs() < 2e-3, "{last:?}");
}

#[test]
fn what_cannot_be_simulated_is_refused_in_one_sentence() {
    let (_dir, at) = folder();
    let bad = |name: &str, text: &str| {
        fs::write(at(name), text).unwrap();
        at(name)
    };
    let version = fs::read_to_string(at("table.json")).unwrap();
    let number = version.split("\"schema_version\": ").nth(1).unwrap().split(',').next().unwrap();
    let version = version.replace(&format!("version\": {number}"), "version\": 99");
    let cases = [
        (bad("version.json", &version), at("table.csv"), "schema_version 99"),
        (
            at("table.json"),
            at("axis.csv"),
            "commands for a single axis, but the twin describes a table",
        ),
        (
            at("axis.json"),
            at("table.csv"),
            "commands for a table, but the twin describes a single axis",
        ),
        (
            at("table.json"),
            bad("no_y.csv", "time_s,command_vx_m_per_s\n0,0\n1,0\n"),
            "no column 'command_vy_m_per_s'; the columns are time_s, command_vx_m_per_s",
        ),
        (
            at("axis.json"),
            bad("none.csv", "time_s,u\n0,0\n1,0\n"),
            "no input column; expected one of force_n, torque_nm, current_a, voltage_v",
        ),
        (
            at("table.json"),
            bad("empty.csv", "time_s,command_vx_m_per_s,command_vy_m_per_s\n0,0,0\n1,,0\n"),
            "1 rows without a value (an empty cell or nan), the first is row 3",
        ),
        (
            at("axis.json"),
            "tests/data/example-train.mcap".to_owned(),
            "commands for a table, but the twin describes a single axis",
        ),
        (at("table.json"), at("table.json"), "commands are a recording (.mcap) or a table (.csv)"),
        (at("table.json"), at("no.mcap"), "no.mcap: cannot open"),
    ];
    for (twin, commands, expected) in cases {
        let output = at("out.mcap");
        let words = ["simulate", &twin, "--commands", &commands, "-o", &output];
        let (stdout, stderr, status) = said(&klasktron(&words));
        assert_eq!((stdout.as_str(), status), ("", 1), "{stderr}");
        assert!(stderr.contains(expected), "{stderr}");
        assert_eq!(stderr.trim_end().lines().count(), 1, "{stderr}");
        assert!(!Path::new(&output).exists() && !Path::new(&at("out.csv")).exists(), "{stderr}");
    }
}

#[test]
fn existing_results_are_replaced_only_on_request() {
    let (_dir, at) = folder();
    fs::write(at("out.csv"), "precious").unwrap();
    let output = at("out.mcap");
    let words = ["simulate", &at("table.json"), "--commands", &at("table.csv"), "-o", &output];
    let (_, stderr, status) = said(&klasktron(&words));
    assert_eq!(status, 1);
    assert!(stderr.contains("out.csv: exists already; replace it with --overwrite"), "{stderr}");
    assert!(!Path::new(&output).exists());
    let words = [&words[..], &["--overwrite"]].concat();
    assert_eq!(said(&klasktron(&words)).2, 0);
    assert!(fs::read_to_string(at("out.csv")).unwrap().starts_with("time_s,"));
    // The commands are never replaced by the CSV of the result.
    let output = at("table.mcap");
    let commands = at("table.csv");
    let words =
        ["simulate", &at("table.json"), "--commands", &commands, "-o", &output, "--overwrite"];
    let (_, stderr, status) = said(&klasktron(&words));
    assert!(
        status == 1 && stderr.contains("table.csv: is an input; give another --output"),
        "{stderr}"
    );
}

#[test]
fn two_twins_are_compared() {
    let (_dir, at) = folder();
    let mut twin = Twin::nominal(Machine::Table);
    let delay = effects::find("drive.delay").unwrap();
    twin.instances.push(Instance::new(delay, Axis::Motors, &[0.0125], Source::Fitted));
    twin.instances[0].values[0].value = 25.0;
    write_twin(&twin, &PathBuf::from(at("after.json"))).unwrap();
    let (stdout, stderr, status) =
        said(&klasktron(&["diff", &at("table.json"), &at("after.json")]));
    assert_eq!((stderr.as_str(), status), ("", 0));
    assert!(stdout.contains("drive.delay on a+b: added"), "{stdout}");
    assert!(
        stdout.trim_end().ends_with("effects: 1 added, 0 removed, 1 changed, 9 equal"),
        "{stdout}"
    );
    let words = ["diff", "--json", &at("table.json"), &at("after.json")];
    let document: serde_json::Value = serde_json::from_str(&said(&klasktron(&words)).0).unwrap();
    assert_eq!(document["schema_version"], 1);
    let changes = document["effects"].as_array().unwrap().iter();
    let added: Vec<_> = changes.filter(|own| own["change"] == "added").collect();
    assert_eq!(added[0]["parameters"][0]["after"], 0.0125);
    let (stdout, _, status) = said(&klasktron(&["diff", &at("table.json"), &at("table.json")]));
    assert_eq!((stdout.trim_end(), status), ("no difference in 10 effects", 0));
    let (_, stderr, status) = said(&klasktron(&["diff", &at("table.json"), &at("no.json")]));
    assert!(status == 1 && stderr.contains("no.json"), "{stderr}");
}
