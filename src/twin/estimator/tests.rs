//! Tests with a recording of a sine whose estimators are known in closed form.

use super::*;
use crate::effects::{Axis, find};
use crate::recording::{ExistingFile, FlushPolicy, RecordingWriter};
use crate::twin::{Machine, Source};
use crate::units::Nanos;
use std::f64::consts::TAU;

/// Amplitude (m) and frequency (1/s) of the left striker's x; it rests in y.
const AMPLITUDE: f64 = 0.08;
const OMEGA: f64 = TAU;

/// Records 20 s of frames and states. Frames at 120 Hz have their own clock (an hour off, 100 ppm
/// fast) and arrive 1 ms to 5 ms later. States come at 50 Hz with the velocity `velocity(t)`; t
/// counts with the arrivals.
fn recording(velocity: impl Fn(f64) -> f64) -> Recording {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sine.mcap");
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
    let at = |seconds: f64| Nanos(1_000_000_000).after_seconds(seconds);
    for k in 0..2400 {
        let t = f64::from(k) / 120.0;
        // Arrivals vary by up to 2 ms around t.
        let arrived = t + 0.002 * (f64::from(k) * 2.399_963).sin();
        let detections = CameraDetections {
            capture_time_ns: Nanos(3_600_000_000_000).after_seconds(1.0001 * t).0,
            left: Some(Point { x: AMPLITUDE * (OMEGA * t).sin(), y: -0.1 }),
            ..CameraDetections::default()
        };
        writer.write(topic::CAMERA_DETECTIONS, at(arrived + 0.003), &detections).unwrap();
    }
    for k in 0..1000 {
        let t = f64::from(k) / 50.0;
        let left = ObjectState { x: 0.0, y: -0.1, vx: velocity(t), vy: 0.0 };
        let state = BoardState { left: Some(left), ..BoardState::default() };
        writer.write(topic::BOARD_STATE, at(t + 0.003), &state).unwrap();
    }
    writer.finish().unwrap();
    Recording::open(&path).unwrap()
}

/// The stage of such a recording in runs at `spans` (s).
fn stage_of(spans: Vec<Range<f64>>, velocity: impl Fn(f64) -> f64) -> Option<EstimatorStage> {
    EstimatorStage::from_recording(&recording(velocity), &spans, None).unwrap()
}

/// All 20 s, in runs of 2.5 s.
fn windows() -> Vec<Range<f64>> {
    (0..8).map(|k| 2.5 * f64::from(k)..2.5 * f64::from(k + 1)).collect()
}

/// Velocity behind a linear estimator with this gain and lag of phase (rad).
fn shifted(gain: f64, phase: f64) -> impl Fn(f64) -> f64 {
    move |t| AMPLITUDE * OMEGA * gain * (OMEGA * t - phase).cos()
}

/// RMS (m/s) of the residual of `state.left_vx` with `instances`, away from the ends.
fn left_over(stage: &EstimatorStage, instances: &[Instance]) -> f64 {
    let mut predicted = vec![Vec::new(); stage.channels.len()];
    stage.report(instances, |_, _| [0.0; 2], &mut predicted);
    let squares: Vec<f64> =
        (50..950).map(|k| (stage.channels[0].measured[k] - predicted[0][k]).powi(2)).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

fn instance(name: &str, values: &[f64]) -> Instance {
    Instance::new(find(name).unwrap(), Axis::Whole, values, Source::Fitted)
}

#[test]
fn without_an_estimator_the_state_is_the_derivative() {
    let stage = stage_of([2.0..7.0, 9.0..14.0].to_vec(), shifted(1.0, 0.0)).unwrap();
    let channel = &stage.channels()[0];
    assert_eq!((channel.signal.as_str(), channel.axis), ("state.left_vx", "x"));
    assert!((channel.rate_hz - 50.0).abs() < 0.01 && stage.channels().len() == 2);
    // The states begin 3 ms after the first frame.
    assert_eq!(channel.runs, [100..350, 450..700]);
    // Of a velocity of 0.5 m/s; the parabola over 67 ms flattens a sine of 1 Hz by 0.4 %.
    assert!(left_over(&stage, &[]) < 2.5e-3, "{}", left_over(&stage, &[]));
}

#[test]
fn a_low_pass_and_a_kalman_filter_are_told_by_their_lag() {
    let lag = 0.03;
    let first_order = shifted(1.0 / (OMEGA * lag).hypot(1.0), (OMEGA * lag).atan());
    let stage = stage_of(windows(), first_order).unwrap();
    assert_eq!(stage.channels()[0].runs.len(), 8);
    assert_eq!(stage.channels()[0].runs[7].end, 1000);
    let left = |lag: f64| left_over(&stage, &[instance("estimator.lag", &[lag, 20.0])]);
    assert!(0.05 < left_over(&stage, &[]));
    assert!(left(0.03) < 3e-3 && 2.0 * left(0.03) < left(0.027).min(left(0.033)));

    // w^2 / (w^2 - W^2 + 2 i z w W) with z = 1/sqrt(2) and the same lag 2 z / w.
    let natural = 2.0_f64.sqrt() / lag;
    let (real, imaginary) = (natural * natural - OMEGA * OMEGA, 2.0_f64.sqrt() * natural * OMEGA);
    let gain = natural * natural / real.hypot(imaginary);
    let kalman = shifted(gain, imaginary.atan2(real));
    let stage = stage_of(windows(), kalman).unwrap();
    let left = |lag: f64| left_over(&stage, &[instance("estimator.lag", &[lag, 0.5_f64.sqrt()])]);
    assert!(left(0.03) < 3e-3 && 2.0 * left(0.03) < left(0.027).min(left(0.033)));
}

#[test]
fn a_dead_zone_is_told_from_none() {
    let reports = |t: f64| {
        let v = shifted(1.0, 0.0)(t);
        if v.abs() < 0.2 { 0.0 } else { v }
    };
    let stage = stage_of(windows(), reports).unwrap();
    let left = left_over(&stage, &[instance("estimator.velocity_deadzone", &[0.2])]);
    assert!(left < 0.02 && 0.05 < left_over(&stage, &[]), "{left}");
    assert!(stage.calls(find("estimator.lag").unwrap()));
    assert!(!stage.calls(find("sensor.camera_latency").unwrap()));
}

#[test]
fn without_zeros_there_is_no_dead_zone() {
    let feels = |stage: &EstimatorStage, name| stage.feels(find(name).unwrap(), Axis::Whole);
    let smooth = stage_of(windows(), shifted(1.0, 0.0)).unwrap();
    assert!(feels(&smooth, "estimator.lag") && !feels(&smooth, "estimator.velocity_deadzone"));
    let zeroed = |t: f64| if t % 1.0 < 0.2 { 0.0 } else { shifted(1.0, 0.0)(t) };
    assert!(feels(&stage_of(windows(), zeroed).unwrap(), "estimator.velocity_deadzone"));
}

#[test]
fn states_without_velocities_make_no_stage() {
    assert!(stage_of(windows(), |_| 0.0).is_none());
    assert!(stage_of(Vec::new(), shifted(1.0, 0.0)).is_none());
}

#[test]
fn a_gap_in_the_frames_leaves_nothing_said() {
    let track = Track {
        times: (0..100).filter(|k| !(40..70).contains(k)).map(|k| f64::from(k) / 100.0).collect(),
        places: vec![[0.0; 2]; 70],
        guide: None,
    };
    assert!(track.slope(0.2, 0.01).is_some());
    assert!(track.slope(0.5, 0.01).is_none() && track.slope(0.0, 0.01).is_none());
}

#[test]
fn encoders_tell_a_reversal_that_frames_smear() {
    // 0.3 m/s to and fro, turning every 0.5 s with 7.5 m/s^2; the camera sees it 24 ms later, turned and scaled.
    let velocity = |t: f64| (1.2 * (OMEGA * t).sin()).clamp(-0.3, 0.3);
    let mut way = vec![0.0];
    for k in 0..101_000 {
        way.push(way[k] + 1e-4 * velocity(1e-4 * (k as f64 + 0.5)));
    }
    let place = |t: f64| way[(1e4 * t.max(0.0)).round() as usize];
    let times: Vec<f64> = (0..2000).map(|k| 0.005 * f64::from(k)).collect();
    let path = MeasuredPath::new(
        times.clone(),
        times.iter().map(|t| [place(*t), 0.02 * (9.0 * t).sin()]).collect(),
        times.iter().map(|t| [velocity(*t), 0.18 * (9.0 * t).cos()]).collect(),
    );
    let frames: Vec<f64> = (0..1200).map(|k| f64::from(k) / 120.0).collect();
    let noise = |k: usize| 2.5e-4 * (k as f64 * 2.399_963).sin();
    let points: Vec<Point> = frames
        .iter()
        .enumerate()
        .map(|(k, t)| {
            let [x, y] = [place(t - 0.024), 0.02 * (9.0 * (t - 0.024)).sin()];
            Point { x: 1.02 * x + 0.03 * y + noise(k), y: y - 0.03 * x - 0.1 + noise(k + 7) }
        })
        .collect();
    let worst = |track: &Track<'_>| {
        let errors = (100..1100).map(|k| {
            let time = frames[k] + 0.004;
            let slope = track.slope(time, 1.0 / 120.0).unwrap();
            (slope.velocity[0]
                - 1.02 * velocity(time - 0.024)
                - 0.0054 * (9.0 * (time - 0.024)).cos())
            .powi(2)
        });
        (errors.sum::<f64>() / 1000.0).sqrt()
    };
    let track = || Track::new(&frames, points.iter().map(Some));
    let (guided, alone) = (track().guided(Some(&path)), track().guided(None));
    assert!(guided.guide.is_some() && alone.guide.is_none());
    assert!(5.0 * worst(&guided) < worst(&alone), "{} {}", worst(&guided), worst(&alone));
    let mut stage = EstimatorStage::default();
    let states: Vec<f64> = (0..400).map(|k| 0.1 + f64::from(k) / 50.0).collect();
    let reported: Vec<_> = states.iter().map(|t| Some([1.02 * velocity(t - 0.024), 0.1])).collect();
    stage.add("left", &guided, &reported, (&states, &[0..200, 200..400]));
    assert_eq!(stage.channels.len(), 2);
    // The carriage of another player is no guide.
    let other = MeasuredPath::new(
        times.clone(),
        times.iter().map(|t| [0.05 * (7.3 * t).sin(), 0.05 * (5.1 * t).cos()]).collect(),
        times.iter().map(|t| [0.365 * (7.3 * t).cos(), -0.255 * (5.1 * t).sin()]).collect(),
    );
    assert!(track().guided(Some(&other)).guide.is_none());
}

#[test]
fn a_striker_that_swings_on_its_magnet_is_told_from_a_slow_estimator() {
    // A carriage that jumps to and fro with 12 m/s^2 drags 12 g on a spring of 60 N/m, by small explicit steps.
    let (mass, stiffness, damping) = (0.012, 60.0, 0.1);
    let velocity = |t: f64| (3.0 * (OMEGA * t).sin()).clamp(-0.3, 0.3);
    let step = 1e-5;
    let critical = 2.0 * f64::sqrt(stiffness * mass);
    let (mut carriage, mut striker, mut speed) = (0.0, 0.0, 0.0);
    let (mut carriages, mut strikers, mut speeds) = (vec![], vec![], vec![]);
    for k in 0..1_010_000_u32 {
        let t = step * f64::from(k);
        if k % 100 == 0 {
            carriages.push(carriage);
            strikers.push(striker);
            speeds.push(speed);
        }
        let pull = stiffness * (carriage - striker) + damping * critical * (velocity(t) - speed);
        speed += step * pull / mass;
        striker += step * speed;
        carriage += step * velocity(t + 0.5 * step);
    }
    let at = |values: &[f64], t: f64| values[(1e3 * t).round() as usize];
    let times: Vec<f64> = (0..2000).map(|k| 0.005 * f64::from(k)).collect();
    let path = MeasuredPath::new(
        times.clone(),
        times.iter().map(|t| [at(&carriages, *t), 0.02 * (9.0 * t).sin()]).collect(),
        times.iter().map(|t| [velocity(*t), 0.18 * (9.0 * t).cos()]).collect(),
    );
    let frames: Vec<f64> = (0..1000).map(|k| 0.01 * f64::from(k)).collect();
    let points: Vec<Point> =
        frames.iter().map(|t| Point { x: at(&strikers, *t), y: 0.02 * (9.0 * t).sin() }).collect();
    let track = Track::new(&frames, points.iter().map(Some)).guided(Some(&path));
    let states: Vec<f64> = (0..380).map(|k| 1.0 + 0.02 * f64::from(k)).collect();
    let reported: Vec<_> = states.iter().map(|t| Some([at(&speeds, *t), 0.1])).collect();
    let mut stage = EstimatorStage::default();
    let run = 0..states.len();
    stage.add("left", &track, &reported, (&states, std::slice::from_ref(&run)));
    let left = |instances: Vec<Instance>| {
        let mut twin = Twin::nominal(Machine::Table);
        (twin.striker_mass, twin.instances) = (mass, instances);
        let mut predicted = vec![Vec::new(); 2];
        stage.predict(&twin, &[], &mut predicted);
        let errors = predicted[0].iter().zip(&stage.channels[0].measured).map(|(p, m)| p - m);
        let finite: Vec<f64> = errors.filter(|error| error.is_finite()).collect();
        assert!(300 < finite.len());
        (finite.iter().map(|error| error * error).sum::<f64>() / finite.len() as f64).sqrt()
    };
    let spring = instance("coupling.magnet_spring", &[stiffness, damping, 1.0, 0.0]);
    let (rigid, swinging) = (left(Vec::new()), left(vec![spring]));
    assert!(0.03 < rigid && 5.0 * swinging < rigid, "{rigid} {swinging}");
}
