use super::*;
use proptest::prelude::*;

/// The JSON parser may differ in the last digit (m).
const LAST_DIGIT: f64 = 1e-15;

fn refusal(text: &str) -> String {
    parse_detections(text.as_bytes()).unwrap_err().to_string()
}

#[test]
fn specs_are_read_and_written_back() {
    for text in ["udp:127.0.0.1:5600", "udp:[::1]:0", "unix:/tmp/camera"] {
        assert_eq!(text.parse::<CameraSpec>().unwrap().to_string(), text);
    }
    for text in ["", "udp:5600", "udp::5600", "udp:host:port", "unix:", "/tmp/camera"] {
        let error = text.parse::<CameraSpec>().unwrap_err().to_string();
        assert_eq!(
            error,
            format!("'{text}' names no camera socket; write udp:HOST:PORT or unix:PATH")
        );
    }
}

#[test]
fn objects_may_be_absent_or_null_and_other_keys_stand_beside_them() {
    let text = br#"{"capture_time_ns": 18446744073709551615, "left": null, "fps": 120,
                    "right": {"x": 1, "y": -1.0, "confidence": 0.5}}"#;
    let seen = parse_detections(text).unwrap();
    assert_eq!(seen.capture_time_ns, u64::MAX);
    assert_eq!((seen.ball, seen.left), (None, None));
    assert_eq!(seen.right, Some(Point { x: 1.0, y: -1.0 }));
}

#[test]
fn refusals_name_field_and_value() {
    for (text, expected) in [
        ("[]", "the camera's datagram is []; send an object"),
        ("{}", "the camera's capture_time_ns is missing; send nanoseconds as an integer"),
        (
            r#"{"capture_time_ns": -1}"#,
            "the camera's capture_time_ns is -1; send nanoseconds as an integer",
        ),
        (
            r#"{"capture_time_ns": 1.5}"#,
            "the camera's capture_time_ns is 1.5; send nanoseconds as an integer",
        ),
        (
            r#"{"capture_time_ns": 1, "ball": [0, 0]}"#,
            "the camera's ball is [0,0]; send an object with x and y, or null",
        ),
        (
            r#"{"capture_time_ns": 1, "left": {"x": 0}}"#,
            "the camera's left.y is missing; send a number of metres",
        ),
        (
            r#"{"capture_time_ns": 1, "left": {"x": "0", "y": 0}}"#,
            "the camera's left.x is \"0\"; send a number of metres",
        ),
        (
            r#"{"capture_time_ns": 1, "right": {"x": 0, "y": -1.01}}"#,
            "the camera's right.y is -1.01 m; send metres in the board frame, from -1 to 1",
        ),
    ] {
        assert_eq!(refusal(text), expected);
    }
    for text in [r#"{"capture_time_ns": 1, "ball": {"x": NaN, "y": 0}}"#, "{", "\u{0}", ""] {
        assert!(refusal(text).starts_with("the camera's datagram is no JSON ("), "{text}");
    }
    let infinite = refusal(r#"{"capture_time_ns": 1, "ball": {"x": 1e999, "y": 0}}"#);
    assert!(infinite.starts_with("the camera's datagram is no JSON (number out of range"));
    let long = refusal(&format!(r#"{{"capture_time_ns": "{}"}}"#, "x".repeat(1000)));
    assert!(long.len() < 150, "{long}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(256))]

    #[test]
    fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        parse_detections(&bytes).ok();
    }

    #[test]
    fn what_was_written_is_read(time in any::<u64>(), x in -1.0_f64..=1.0, y in -1.0_f64..=1.0) {
        let text = format!(r#"{{"capture_time_ns": {time}, "ball": {{"x": {x:?}, "y": {y:?}}}}}"#);
        let seen = parse_detections(text.as_bytes()).unwrap();
        let ball = seen.ball.unwrap();
        prop_assert_eq!(seen.capture_time_ns, time);
        prop_assert!((ball.x - x).abs() < LAST_DIGIT && (ball.y - y).abs() < LAST_DIGIT);
    }
}
