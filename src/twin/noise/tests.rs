//! Tests with synthetic noise of known magnitude, and without noise.

use super::*;
use crate::seed::Stream;

/// A normal number (Box and Muller).
fn normal(stream: &mut Stream) -> f64 {
    let radius = f64::from(stream.uniform_f32(f32::MIN_POSITIVE, 1.0));
    let angle = TAU * f64::from(stream.uniform_f32(0.0, 1.0));
    (-2.0 * radius.ln()).sqrt() * angle.cos()
}

/// `n` normal numbers of the stream `name`.
fn normals(seed: u64, name: &str, n: usize) -> Vec<f64> {
    let mut stream = Stream::new(seed, name);
    (0..n).map(|_| normal(&mut stream)).collect()
}

/// Velocity of a smooth oscillation at 120 Hz (m/s).
fn velocities(n: usize) -> Vec<f64> {
    (0..n).map(|k| 0.5 * (TAU * 0.7 * k as f64 / 120.0).sin()).collect()
}

/// 60 s of a camera with `scatter` (m), `jitter` (s) and a latency that is wrong by `latency` (s).
fn camera(seed: u64, scatter: f64, jitter: f64, latency: f64) -> (Vec<f64>, Vec<f64>) {
    let n = 7200;
    let speed = velocities(n);
    let (place, time) = (normals(seed, "place", n), normals(seed, "time", n));
    let residual =
        (0..n).map(|k| scatter * place[k] + speed[k] * (jitter * time[k] + latency)).collect();
    (residual, speed)
}

/// Distance of a variance from zero, in standard errors.
fn in_its_errors(own: Estimate) -> f64 {
    own.value / own.standard_error
}

#[test]
fn jitter_is_measured_and_a_wrong_latency_is_none() {
    let (residual, speed) = camera(1, 2.5e-4, 1e-3, 0.0);
    let found = scattering(&residual, &speed, 60).unwrap();
    let Estimate { value: variance, standard_error: error } = found.timestamp_variance_s2;
    assert!((variance - 1e-6).abs() < 3.0 * error && error < 1e-7, "{found:?}");
    let alarms = (0..300)
        .filter(|seed| {
            let (residual, speed) = camera(*seed, 2.5e-4, 0.0, 0.02);
            let found = scattering(&residual, &speed, 60).unwrap();
            3.0 < in_its_errors(found.timestamp_variance_s2).abs()
        })
        .count();
    assert!(alarms <= 4, "{alarms}");
}

#[test]
fn gaps_are_not_differenced() {
    let (mut residual, speed) = camera(2, 2.5e-4, 0.0, 0.0);
    for k in (0..residual.len()).step_by(500) {
        residual[k] = f64::NAN;
        for later in &mut residual[k + 1..] {
            *later += 0.05;
        }
    }
    let found = scattering(&residual, &speed, 60).unwrap();
    assert!(in_its_errors(found.timestamp_variance_s2).abs() < 3.0);
}

#[test]
fn the_scatter_at_rest_is_that_of_the_places_and_not_of_the_stamps() {
    let (residual, speed) = camera(5, 4e-4, 1e-3, 0.0);
    let found = scattering(&residual, &speed, 60).unwrap();
    for own in [found.frame_to_frame_variance_m2, found.total_variance_m2] {
        let (variance, error) = (own.value, own.standard_error);
        assert!((variance - 1.6e-7).abs() < 3.0 * error && error < 1.6e-8, "{found:?}");
    }
}

#[test]
fn what_is_smooth_scatters_about_the_prediction_but_not_from_frame_to_frame() {
    let (mut residual, speed) = camera(6, 2.5e-4, 0.0, 0.0);
    for k in 1..residual.len() {
        residual[k] = 0.9 * residual[k - 1] + (1.0_f64 - 0.81).sqrt() * residual[k];
    }
    let found = scattering(&residual, &speed, 60).unwrap();
    assert!((found.total_variance_m2.value / 6.25e-8 - 1.0).abs() < 0.2, "{found:?}");
    assert!(found.frame_to_frame_variance_m2.value < 0.2 * 6.25e-8, "{found:?}");
}

/// Times of frames with jitter (s), a fraction of them lost.
fn frame_times(seed: u64, jitter: f64, lost: f64) -> Vec<f64> {
    let noise = normals(seed, "frames", 7200);
    let mut stream = Stream::new(seed, "lost");
    (0..7200)
        .filter(|_| lost <= f64::from(stream.uniform_f32(0.0, 1.0)))
        .map(|k: usize| k as f64 / 120.0 + jitter * noise[k])
        .collect()
}

/// Fraction of these frames that were lost; no frame repeats another.
fn lost(times: &[f64]) -> LostFraction {
    let losses = FrameLosses::new(times, &vec![false; times.len()], 120).unwrap();
    FrameLosses::fraction(&[&losses]).unwrap()
}

#[test]
fn lost_frames_are_counted_whatever_the_jitter() {
    for jitter in [0.0, 3e-4, 1e-3] {
        let found = lost(&frame_times(3, jitter, 0.03));
        let Estimate { value: share, standard_error: error } = found.fraction;
        assert!((share - 0.03).abs() < 0.006 && 5.0 * error < share, "{jitter} {found:?}");
    }
    for jitter in [3e-4, 1e-3, 2e-3, 3e-3, 5e-3] {
        let is_alarm = |seed: &u64| {
            let own = lost(&frame_times(*seed, jitter, 0.0)).fraction;
            let (share, error) = (own.value, own.standard_error);
            3.0 * error < share.abs()
        };
        let alarms = (0..40).filter(is_alarm).count();
        assert!(alarms <= 1, "{jitter} {alarms}");
    }
}

#[test]
fn pauses_of_the_recording_are_no_lost_frames() {
    let paused: Vec<f64> = frame_times(7, 1e-4, 0.0)
        .iter()
        .enumerate()
        .map(|(k, t)| t + 1.5 * (k / 300) as f64)
        .collect();
    assert!(lost(&paused).fraction.value.abs() < 1e-4);
}

#[test]
fn frames_that_repeat_another_are_lost_as_well() {
    let times = frame_times(4, 0.0, 0.02);
    let repeated: Vec<bool> = (0..times.len()).map(|k| k % 25 == 7).collect();
    let half = times.len() / 2;
    let parts = [0..half, half..times.len()]
        .map(|own| FrameLosses::new(&times[own.clone()], &repeated[own], 120).unwrap());
    let found = FrameLosses::fraction(&parts.each_ref()).unwrap();
    assert!((found.fraction.value - 0.06).abs() < 0.006, "{found:?}");
}

#[test]
fn the_grid_of_an_encoder_is_found_and_no_grid_is_not() {
    let place = |k: usize| 0.1 * (TAU * 0.3 * k as f64 / 100.0).sin();
    for step in [0.04 / 16_384.0, 1e-5, 7.3e-5] {
        let rounded: Vec<f64> = (0..4000).map(|k| (place(k) / step).round() * step).collect();
        let found = encoder_quantisation(&rounded).unwrap();
        assert!((found.value / step - 1.0).abs() < 1e-6, "{step} {found:?}");
        // In single precision too, as it comes over the bus.
        let single: Vec<f64> =
            rounded.iter().map(|x| f64::from((x / 0.04) as f32) * 0.04).collect();
        let found = encoder_quantisation(&single).unwrap();
        assert!((found.value / step - 1.0).abs() < 1e-3, "{step} {found:?}");
    }
    // Nor is there a grid where speeds are constant: 2 mm and 4 mm between samples, and noise.
    let noise = normals(6, "encoder", 4000);
    let (mut x, mut even) = (0.0, Vec::new());
    for (k, z) in noise.iter().enumerate() {
        x += if k % 400 < 200 { 2e-3 } else { -4e-3 };
        even.push(x + 1e-6 * z);
    }
    assert_eq!(encoder_quantisation(&even).unwrap().value, 0.0);
    for seed in 0..30 {
        let noise = normals(seed, "encoder", 4000);
        let smooth: Vec<f64> = (0..4000).map(|k| place(k) + 1e-5 * noise[k]).collect();
        assert_eq!(encoder_quantisation(&smooth).unwrap().value, 0.0);
    }
}
