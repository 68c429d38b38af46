//! Sessions of a recorded sine: the samples of each run, and their clock.

use super::*;
use crate::{
    recording::{
        ExistingFile, FlushPolicy, RECORDING_METADATA, RecordingWriter, arrival_key,
        message::{
            BoardState, CameraDetections, CarriageState, MotorState, ObjectState, Point, RunMarker,
            VelocityCommand, run_marker::Phase,
        },
        topic::{Motor, Player},
    },
    twin::Stage,
    units::Nanos,
};

/// Log time of the first message.
const BEGAN: Nanos = Nanos(1_700_000_000_000_000_000);
/// Amplitude of the sine (m) and its angular frequency (rad/s).
const SINE: (f64, f64) = (0.08, 3.0);
/// Time from exposure to arrival of a frame (s).
const TRANSPORT: f64 = 0.03;
/// Time by which each motor reports its torque before its position (s).
const TORQUE_AGES: [f64; 2] = [0.004, 0.007];
/// Runs by number: start and end (s), and their purpose.
const RUNS: [(f64, f64, &str); 4] = [
    (1.0, 4.0, "train"),
    (4.0, 7.0, "validation"),
    (7.5, 10.5, "train"),
    (11.0, 12.0, "validation"),
];

fn at(seconds: f64) -> Nanos {
    BEGAN.after_seconds(seconds)
}

fn place(t: f64) -> f64 {
    SINE.0 * (SINE.1 * t).sin()
}

fn velocity(t: f64) -> f64 {
    SINE.0 * SINE.1 * (SINE.1 * t).cos()
}

/// 12 s in which the left carriage and its striker are at `place(t)`, with commands, carriage and
/// states at 50 Hz and frames at 120 Hz that carry `stamp(exposure)`.
fn recording(stamp: impl Fn(f64) -> Nanos) -> Recording {
    recording_with(stamp, &[])
}

/// The same with this in its metadata.
fn recording_with(stamp: impl Fn(f64) -> Nanos, metadata: &[(String, &str)]) -> Recording {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("sine.mcap");
    let mut writer =
        RecordingWriter::create(&path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
    let metadata = metadata.iter().map(|(key, value)| (key.clone(), (*value).to_owned()));
    writer.metadata(RECORDING_METADATA, metadata.collect()).unwrap();
    let left = Player::Left;
    for k in 0..=600 {
        let t = f64::from(k) / 50.0;
        let (x, vx) = (place(t), velocity(t));
        let command = VelocityCommand { vx, vy: 0.0 };
        writer.write(&topic::command(left), at(t), &command).unwrap();
        let carriage = CarriageState { x, y: 0.0, vx, vy: 0.0 };
        writer.write(&topic::carriage(left), at(t), &carriage).unwrap();
        for (motor, age) in Motor::BOTH.into_iter().zip(TORQUE_AGES) {
            let report = MotorState {
                position_turns: x / BELT_METRES_PER_TURN,
                velocity_turns_per_s: vx / BELT_METRES_PER_TURN,
                torque_target_nm: None,
                torque_estimate_nm: Some(velocity(t - age)),
                torque_age_s: Some(age),
            };
            writer.write(&topic::motor(left, motor), at(t), &report).unwrap();
        }
        let state = ObjectState { x, y: 0.0, vx, vy: 0.0 };
        let state = BoardState { left: Some(state), ..BoardState::default() };
        writer.write(topic::BOARD_STATE, at(t), &state).unwrap();
    }
    for k in 0..1436 {
        let t = f64::from(k) / 120.0;
        let picture = CameraDetections {
            capture_time_ns: stamp(t).0,
            left: Some(Point { x: place(t), y: 0.0 }),
            ..CameraDetections::default()
        };
        writer.write(topic::CAMERA_DETECTIONS, at(t + TRANSPORT), &picture).unwrap();
    }
    for (run, (start, end, split)) in (0..).zip(RUNS) {
        for (phase, time) in [(Phase::Start, start), (Phase::End, end)] {
            let marker = RunMarker {
                run,
                pattern: "sine".to_owned(),
                phase: phase.into(),
                split: split.to_owned(),
            };
            writer.write(topic::RUN_MARKER, at(time), &marker).unwrap();
        }
    }
    writer.finish().unwrap();
    Recording::open(&path).unwrap()
}

fn sessions(stamp: impl Fn(f64) -> Nanos) -> Vec<Session> {
    sessions_of(&[recording(stamp)]).unwrap()
}

/// Start and end of each run of `stage` that its samples show (s).
fn covered(stage: &dyn Stage) -> Vec<Range<f64>> {
    let channel = &stage.channels()[0];
    channel.runs.iter().map(|run| channel.times[run.start]..channel.times[run.end - 1]).collect()
}

#[test]
fn every_link_covers_the_runs_of_its_own_session_only() {
    let sessions = sessions(at);
    let splits: Vec<Split> = sessions.iter().map(|session| session.split).collect();
    assert_eq!(splits, [Split::Train, Split::Validation]);
    for session in &sessions {
        let estimator = session.estimator.as_ref().expect("states and pictures are there");
        let camera = session.camera.as_ref().expect("carriage and pictures are there");
        let drive = session.drive.as_ref().expect("commands and carriage are there");
        let own: Vec<_> = RUNS.iter().filter(|run| run.2 == session.split.to_string()).collect();
        for stage in [estimator as &dyn Stage, camera, drive] {
            let covered = covered(stage);
            assert_eq!(covered.len(), own.len(), "{:?}", stage.kind());
            for (found, (start, end, _)) in covered.iter().zip(&own) {
                // Up to the settling of the drive at the start, and a sample at the end.
                let inside = *start <= found.start + 1e-9 && found.end < *end;
                let whole = found.start < start + 0.15 && end - 0.021 - TRANSPORT < found.end;
                assert!(inside && whole, "{:?} {found:?} of {start}..{end}", stage.kind());
            }
        }
    }
}

#[test]
fn each_motor_hears_commands_when_the_metadata_say_and_at_once_without() {
    let arrivals = |metadata: &[(String, &str)]| {
        let sessions = sessions_of(&[recording_with(at, metadata)]);
        sessions.map(|own| own[0].drive.as_ref().expect("commands and carriage").arrivals)
    };
    let [a, b] = Motor::BOTH.map(|motor| arrival_key(Player::Left, motor));
    let other = arrival_key(Player::Right, Motor::A);
    assert_eq!(arrivals(&[]).unwrap(), [0.0, 0.0]);
    assert_eq!(arrivals(&[(a, "0.000444"), (b.clone(), "0.000888")]).unwrap(), [444e-6, 888e-6]);
    assert_eq!(arrivals(&[(b.clone(), "0.002"), (other, "0.003")]).unwrap(), [0.0, 0.002]);
    for wrong in ["late", "-0.001", "0.2", "NaN"] {
        let said = arrivals(&[(b.clone(), wrong)]).unwrap_err().to_string();
        let expected = format!("command_arrival_left_b_s = '{wrong}', which must be a time from 0");
        assert!(said.contains(&expected), "{said}");
    }
}

#[test]
fn a_torque_is_compared_at_the_time_at_which_its_drive_reported_it() {
    let sessions = sessions(at);
    let drive = sessions[0].drive.as_ref().expect("commands and motors are there");
    let torques = drive.channels.iter().filter(|channel| channel.unit == "N m");
    let mut count = 0;
    for channel in torques {
        for (time, measured) in channel.times.iter().zip(&channel.measured) {
            assert!((measured - velocity(*time)).abs() < 1e-6, "{time} s: {measured} N m");
            count += 1;
        }
    }
    assert!(1000 < count, "{count} torques");
}

/// RMS of the camera's sine against the carriage `delay` (s) before (m).
fn camera_misses(session: &Session, delay: f64) -> f64 {
    let camera = session.camera.as_ref().expect("carriage and pictures are there");
    let channel = &camera.channels[0];
    let squares: Vec<f64> = channel
        .runs
        .iter()
        .flat_map(|run| run.clone())
        .map(|k| (channel.measured[k] - place(channel.times[k] - delay)).powi(2))
        .collect();
    assert!(600 < squares.len(), "{}", squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_camera_with_an_epoch_of_its_own_is_compared_by_its_arrivals() {
    let since_boot = |t: f64| Nanos(0).after_seconds(500.0 + 1.0002 * t);
    let session = &sessions(since_boot)[0];
    assert!(camera_misses(session, TRANSPORT) < 1e-5, "{}", camera_misses(session, TRANSPORT));
}

#[test]
fn a_stamp_on_the_recordings_clock_keeps_its_latency() {
    let late = |t: f64| at(t + 0.012);
    let session = &sessions(late)[0];
    assert!(camera_misses(session, 0.012) < 1e-8, "{}", camera_misses(session, 0.012));
}

#[test]
fn a_recording_without_markers_is_cut_into_equal_pieces() {
    let runs = unmarked_runs(12.0, None);
    let spans: Vec<Range<f64>> = runs.iter().map(|run| run.span.clone()).collect();
    assert_eq!(spans, [0.0..6.0, 6.0..12.0]);
    assert_eq!(unmarked_runs(3.0, Some(Split::Train))[0].span, 0.0..3.0);
}
