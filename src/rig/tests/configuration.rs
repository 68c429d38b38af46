//! Tests of invalid configurations and their messages.

use crate::rig::RigConfig;

fn refusal(text: &str) -> String {
    RigConfig::from_json(text).unwrap_err().to_string()
}

#[test]
fn the_default_is_accepted_and_survives_a_round_trip() {
    let config = RigConfig::from_json("{}").unwrap();
    assert_eq!(config, RigConfig::default());
    let text = serde_json::to_string(&config).unwrap();
    assert_eq!(RigConfig::from_json(&text).unwrap(), config);
    let faults = r#"{"faults": [
        {"at_s": 1.0, "kind": "heartbeat_stops", "node": 1},
        {"after_arming_s": 2.0, "for_s": 0.5, "kind": "stuck", "player": "left"},
        {"at_s": 3.0, "kind": "bus_off"}]}"#;
    let config = RigConfig::from_json(faults).unwrap();
    let text = serde_json::to_string(&config).unwrap();
    assert_eq!(RigConfig::from_json(&text).unwrap(), config);
}

#[test]
fn what_cannot_be_is_refused_by_name() {
    assert_eq!(
        refusal(r#"{"gantry": {"left": {"x_friction": {"coulomb_n": -2}}}}"#),
        "gantry.left.x_friction.coulomb_n is -2; it must lie in [0, 1000]"
    );
    assert_eq!(
        refusal(r#"{"drive": {"cogging": [{"amplitude_nm": 99, "periods_per_turn": 2}]}}"#),
        "drive.cogging[0].amplitude_nm is 99; it must lie in [0, 10]"
    );
    assert!(refusal(r#"{"camera": {"latency": 0.1}}"#).contains("unknown field `latency`"));
    assert!(refusal(r#"{"bus": {"bitrate": 0}}"#).starts_with("bus.bitrate is 0; it must lie in"));
    let seat = r#"{"node": 0, "player": "left", "motor": "a", "sign": 1}"#;
    assert!(refusal(&format!(r#"{{"drives": [{seat}, {seat}]}}"#)).contains("has the node"));
    assert!(refusal(&format!(r#"{{"drives": [{}]}}"#, seat.replace("1}", "2}"))).contains("sign"));
    assert!(refusal(r#"{"drives": []}"#).contains("number of drives"));
}

#[test]
fn unstable_springs_are_refused() {
    let text = r#"{"gantry": {"left": {"belt_a_stiffness_n_per_m": 1e7}}}"#;
    assert!(refusal(text).contains("the stiffest spring (belt)"), "{}", refusal(text));
    assert!(
        RigConfig::from_json(&text.replace("{\"gantry\"", "{\"step_s\": 1e-5, \"gantry\"")).is_ok()
    );
}

#[test]
fn faults_are_checked() {
    for (fault, said) in [
        (r#"{"at_s": 1, "kind": "melts"}"#, "unknown variant `melts`"),
        (r#"{"kind": "bus_off"}"#, "either at_s or after_arming_s"),
        (r#"{"at_s": 1, "kind": "encoder_stops"}"#, "missing field `node`"),
        (r#"{"at_s": 1, "kind": "encoder_stops", "node": 9}"#, "faults[0].node is 9"),
        (r#"{"at_s": 1, "kind": "encoder_stops", "node": 1, "x": 2}"#, "unknown field `x`"),
        (r#"{"at_s": -1, "kind": "camera_stops"}"#, "faults[0].at_s or after_arming_s is -1"),
        (r#"{"at_s": 1, "kind": "frames_dropped", "probability": 2}"#, "probability is 2"),
    ] {
        let text = format!(r#"{{"faults": [{fault}]}}"#);
        assert!(refusal(&text).contains(said), "{}", refusal(&text));
    }
}
