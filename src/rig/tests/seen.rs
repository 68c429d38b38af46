//! Tests of the camera's output.

use super::support::{Host, START};
use crate::units::Nanos;
use serde_json::Value;

/// Arrival (s), timestamp (s), ball, left and right (m) of a frame.
struct Picture {
    arrival: f64,
    stamp: f64,
    objects: [Option<[f64; 2]>; 3],
}

fn pictures(host: &Host) -> Vec<Picture> {
    let read = |(arrival, bytes): &(f64, Vec<u8>)| {
        let value: Value = serde_json::from_slice(bytes).unwrap();
        let stamp = Nanos(value["capture_time_ns"].as_u64().unwrap()).seconds_since(START);
        let object = |name: &str| {
            let place = &value[name];
            let of = |axis: &str| place[axis].as_f64();
            assert!(place.is_null() || place.is_object(), "{value}");
            Some([of("x")?, of("y")?])
        };
        Picture { arrival: *arrival, stamp, objects: ["ball", "left", "right"].map(object) }
    };
    host.pictures.iter().map(read).collect()
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> (f64, f64) {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (mean, (square / values.len() as f64).sqrt())
}

#[test]
fn latency_rate_and_noise_are_those_of_the_configuration() {
    let mut host = Host::from_json(
        r#"{"camera": {"latency_s": 0.03, "latency_jitter_s": 0.004, "noise_m": 0.0005}}"#,
    );
    host.wait(10.0);
    let pictures = pictures(&host);
    assert!(pictures.len().abs_diff(1196) <= 1, "{}", pictures.len());
    let latency: Vec<f64> = pictures.iter().map(|p| p.arrival - p.stamp).collect();
    let (mean, deviation) = moments(&latency);
    // Uniform between 30 and 34 ms.
    assert!((mean - 0.032).abs() < 2e-4, "{mean}");
    assert!((deviation - 0.004 / 12.0_f64.sqrt()).abs() < 1e-4, "{deviation}");
    let x: Vec<f64> = pictures.iter().map(|p| p.objects[1].unwrap()[0]).collect();
    let (mean, deviation) = moments(&x);
    assert!(mean.abs() < 1e-4, "{mean}");
    assert!((deviation / 0.0005 - 1.0).abs() < 0.1, "{deviation}");
}

#[test]
fn a_moving_striker_is_seen_where_it_was_at_capture() {
    let quiet = r#""noise_m": 0.0, "latency_s": 0.04, "latency_jitter_s": 0.0"#;
    for (more, late, scale) in [
        ("", 0.0, 1.0),
        (r#", "exposure_s": 0.01"#, 0.005, 1.0),
        (r#", "x_scale_error": 0.05"#, 0.0, 1.05),
    ] {
        let mut host = Host::from_json(&format!(r#"{{"camera": {{{quiet}{more}}}}}"#));
        host.arm();
        let truths = host.drive([0.2, 0.0], 0.6);
        let mut compared = 0;
        for picture in pictures(&host) {
            let when = picture.stamp - late;
            let Some(pair) = truths.windows(2).find(|p| p[0].0 <= when && when < p[1].0) else {
                continue;
            };
            let seen = picture.objects[2].unwrap()[0];
            // Truth samples are a millisecond apart and up to a step ahead of their time.
            let peg = pair[0].1.right.peg;
            let wanted = scale * (peg.x + peg.vx * (when - pair[0].0));
            assert!((seen - wanted).abs() < 1e-4, "{seen} {wanted}{more}");
            compared += 1;
        }
        assert!(40 < compared);
    }
}

#[test]
fn objects_are_missed_pictures_lost_and_stamps_wrong_when_told_to() {
    let mut host = Host::from_json(
        r#"{"ball": {"start": null},
            "camera": {"drop_fraction": 0.25, "miss_fraction": 0.1, "outlier_fraction": 0.05,
                       "quantisation_m": 0.001, "stamp": "arrival", "stamp_offset_s": 0.5}}"#,
    );
    host.wait(10.0);
    let pictures = pictures(&host);
    let share = pictures.len() as f64 / 1197.0;
    assert!((share - 0.75).abs() < 0.05, "{share}");
    assert!(pictures.iter().all(|p| p.objects[0].is_none()));
    let left: Vec<[f64; 2]> = pictures.iter().filter_map(|p| p.objects[1]).collect();
    let found = left.len() as f64 / pictures.len() as f64;
    assert!((found - 0.9).abs() < 0.04, "{found}");
    let far = |p: &&[f64; 2]| 0.005 < p[0].abs().max((p[1] + 0.1).abs());
    let strays = left.iter().filter(far).count() as f64 / left.len() as f64;
    assert!((0.02..0.08).contains(&strays), "{strays}");
    for [x, y] in left {
        assert!(((x * 1000.0).round() / 1000.0 - x).abs() < 1e-6);
        assert!(((y * 1000.0).round() / 1000.0 - y).abs() < 1e-6);
    }
    assert!(pictures.iter().all(|p| (p.stamp - p.arrival - 0.5).abs() < 1e-6));
}
