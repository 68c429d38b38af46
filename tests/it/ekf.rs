//! `tune-ekf` on games of a generator that shares no code with the filter.

mod generator;

use crate::support::{klasktron, said};
use generator::{Game, Players};
use klasktron::{
    ekf::{Document, Hit, Region, Tuned, read_settings, tune_recordings},
    provenance::Provenance,
    recording::{
        ExistingFile, FlushPolicy, Recording, RecordingWriter,
        message::{BoardState, CameraDetections, Point, VelocityCommand},
        topic::{self, Player},
    },
    units::Nanos,
};
use std::{fs, path::Path};

/// Tunes on a game in this process.
fn tuned(game: &Game) -> Tuned {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("game.mcap");
    game.write(&path);
    let recording = Recording::open(&path).unwrap();
    tune_recordings(&[recording], Provenance::new("test".to_owned())).unwrap()
}

fn near(found: f64, expected: f64, share: f64) {
    assert!((found / expected - 1.0).abs() < share, "{found} instead of {expected}");
}

/// Measurement noise, process noise and restitution of the generator are found again, and the filter
/// that has them is consistent on rolls that it has not seen.
#[test]
fn the_truth_is_recovered() {
    let game = Game {
        runs: 30,
        psd: 0.05,
        sigma: 4e-4,
        strikers: Players::Absent,
        seed: 3,
        ..Game::default()
    };
    let Document { filter, evaluation, bounces, warnings, tuning, .. } = tuned(&game).document;
    near(filter.ball.measurement_sigma_m, game.sigma, 0.05);
    near(filter.ball.open_psd_m2_per_s3, game.psd, 0.25);
    let ball = filter.ball.ball.unwrap();
    // Of eight seeds the worst was off by 0.055; rolling and the scatter of impacts are too little
    // determined by 50 s under this noise to be asked for.
    assert!((ball.wall_restitution - game.walls[0]).abs() < 0.06, "{ball:?}");
    assert!((filter.latency_s - game.latency).abs() < 1e-6);

    let striker = tuning[0].regions.iter().find(|own| own.region == Region::NearStriker).unwrap();
    assert!(!striker.tuned && striker.reason.contains("too few"), "{striker:?}");
    assert!(
        warnings.iter().any(|own| own.contains("left: not tuned: it is not detected")),
        "{warnings:?}"
    );

    let own = &evaluation[0];
    let open = &own.regions[0];
    assert_eq!(open.region, Region::Open);
    near(open.nis.unwrap().mean, 2.0, 0.06);
    near(open.nees.unwrap().mean, 4.0, 0.1);
    assert!(own.velocity_rmse_m_per_s.unwrap() < 0.5 * own.upstream_velocity_rmse_m_per_s.unwrap());
    assert!(
        own.predicted_position_rmse_m.unwrap() < 0.5 * own.unpredicted_position_rmse_m.unwrap()
    );
    assert!(0.8 < own.whiteness.fraction_within, "{:?}", own.whiteness);
    let wall = bounces.iter().find(|own| own.hit == Hit::Wall).unwrap();
    assert!(20 <= wall.impacts && wall.own.median_frames <= 2.0, "{wall:?}");
    assert!(3.0 <= wall.upstream.median_frames, "{wall:?}");
}

/// Every second detection has five times the noise. Detections that carry their covariance, which is four times too
/// small, give the factor 4 and smaller errors than one constant for all.
#[test]
fn covariances_of_the_detector_are_used_and_their_scale_is_found() {
    let game = Game {
        runs: 24,
        sigma: 3e-4,
        uneven: 5.0,
        strikers: Players::Absent,
        seed: 5,
        ..Game::default()
    };
    let constant = tuned(&game).document;
    assert_eq!(constant.filter.ball.covariance_scale, None);
    let own = tuned(&Game { reported: Some(0.25), ..game.clone() }).document;
    near(own.filter.ball.covariance_scale.unwrap(), 4.0, 0.15);
    // The constant is that of a simulation: the root mean square of both kinds of detections.
    let rms = game.sigma * f64::sqrt((1.0 + 25.0) / 2.0);
    near(own.filter.ball.measurement_sigma_m, rms, 0.1);
    near(own.evaluation[0].regions[0].nis.unwrap().mean, 2.0, 0.06);
    let [with, without] =
        [&own, &constant].map(|own| own.evaluation[0].velocity_rmse_m_per_s.unwrap());
    assert!(with < 0.9 * without, "{with} {without}");
}

#[test]
fn the_command_writes_what_can_be_read_back_and_the_same_every_time() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("game.mcap");
    Game { runs: 12, run_s: 2.0, ..Game::default() }.write(&path);
    let out = |name: &str| dir.path().join(name);
    let tune = |name: &str| {
        let (path, out) = (path.display().to_string(), out(name).display().to_string());
        said(&klasktron(&["tune-ekf", &path, "--output", &out, "--json"]))
    };
    let (text, errors, status) = tune("one");
    assert_eq!(status, 0, "{errors}");
    let document: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(document["schema_version"], 2);
    assert_eq!(document["inputs"][0]["name"], "game.mcap");
    assert_eq!(
        (&document["train"]["runs"], &document["validation"]["runs"]),
        (&8.into(), &4.into())
    );

    let settings = read_settings(&out("one").join("ekf.json")).unwrap();
    let sigma = document["filter"]["ball"]["measurement_sigma_m"].as_f64().unwrap();
    near(settings.ball.measurement_sigma_m, sigma, 1e-12);
    near(settings.ball.measurement_sigma_m, 5e-4, 0.1);
    let page = fs::read_to_string(out("one").join("index.html")).unwrap();
    for section in [
        "Process noise by region",
        "Covariance",
        "Whiteness of innovations",
        "Step response of the velocity after an impact",
    ] {
        assert!(page.contains(&format!("<h2>{section}</h2>")), "{section}");
    }
    assert!(!page.contains("picture not drawn"));
    estimates_stand_beside_detections(&out("one").join("ekf.mcap"));

    assert_eq!(tune("two").0, text);
    for file in ["ekf.json", "index.html", "ekf.mcap"] {
        let bytes = |folder: &str| fs::read(out(folder).join(file)).unwrap();
        assert!(bytes("one") == bytes("two"), "{file} differs");
    }
}

/// Every detection of the held-out runs has an estimate at its capture, within a millimetre or two.
fn estimates_stand_beside_detections(tape: &Path) {
    let tape = Recording::open(tape).unwrap();
    let seen = tape.series::<CameraDetections>(topic::CAMERA_DETECTIONS).unwrap();
    let estimates = tape.series::<BoardState>(topic::BOARD_STATE).unwrap();
    assert_eq!(seen.times, estimates.times);
    assert_eq!(tape.count("/ekf/upstream/board_state"), seen.times.len());
    assert_eq!(tape.count("/truth/board/state"), seen.times.len());
    let mut close = 0;
    for (found, state) in seen.values.iter().zip(&estimates.values) {
        if let (Some(place), Some(own)) = (&found.left, &state.left) {
            assert!((place.x - own.x).hypot(place.y - own.y) < 5e-3);
            close += 1;
        }
    }
    assert!(800 < close, "{close}");
    assert!(tape.attachment("ekf.json").is_some());
}

/// A recording of `frames` pictures, 120 a second, of a ball at `place` of the frame.
fn pictures(path: &Path, frames: u64, place: impl Fn(f64) -> Option<f64>) {
    let mut writer =
        RecordingWriter::create(path, ExistingFile::Refuse, FlushPolicy::WhenFull).unwrap();
    for k in 0..frames {
        let now = Nanos(1_000_000_000 + k * 1_000_000_000 / 120);
        let ball = place(k as f64 / 120.0).map(|x| Point { x, y: 0.0 });
        let found =
            CameraDetections { capture_time_ns: now.0, ball, ..CameraDetections::default() };
        writer.write(topic::CAMERA_DETECTIONS, now, &found).unwrap();
    }
    let command = VelocityCommand { vx: 0.0, vy: 0.0 };
    writer.write(&topic::command(Player::Left), Nanos(1_000_000_000), &command).unwrap();
    writer.finish().unwrap();
}

#[test]
fn what_cannot_be_tuned_is_refused_in_one_sentence_and_nothing_is_written() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |name: &str, expected: &str| {
        let (path, out) = (dir.path().join(name), dir.path().join("out"));
        let args = [path.display().to_string(), out.display().to_string()];
        let (text, errors, status) =
            said(&klasktron(&["tune-ekf", &args[0], "--output", &args[1]]));
        assert_eq!((text.as_str(), status), ("", 1), "{errors}");
        assert!(errors.contains(expected), "{errors}");
        assert_eq!(errors.lines().count(), 1, "{errors}");
        assert!(!out.exists());
    };
    let file = |name: &str| dir.path().join(name);
    pictures(&file("empty.mcap"), 2000, |_| None);
    refused("empty.mcap", "no detections on /camera/detections");
    pictures(&file("short.mcap"), 200, |t| Some(0.1 * (3.0 * t).sin()));
    refused("short.mcap", "at least 300 are needed");
    pictures(&file("still.mcap"), 2400, |t| Some(0.001 * (30.0 * t).sin()));
    refused("still.mcap", "no object moves further than");
    refused("absent.mcap", "absent.mcap: cannot open");
}

/// Writes the games of `reports/2026-11-21-ekf` into `target/tmp`: 300 s to tune on, 150 s held out.
#[test]
#[ignore = "makes the inputs of a report"]
fn write_the_games_of_the_report() {
    for seed in [1, 11, 12, 13] {
        let name = format!("ekf-game-{seed}.mcap");
        let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::remove_file(&path).ok();
        Game { seed, runs: 180, ..Game::default() }.write(&path);
    }
}
