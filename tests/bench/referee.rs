//! One hour of a match: read and judged, on one core. The goal is 3 s for both together.
//!
//! The match is that of the tests, with a physics of its own; the goals found are compared with the true
//! ones before anything is timed.

#[path = "../it/eval/game.rs"]
#[expect(dead_code, reason = "the tests use more of it")]
mod game;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use game::{CAMERA, Game, What, play};
use klasktron::{
    recording::{
        ExistingFile, FlushPolicy, RecordingWriter,
        message::{CameraDetections, Point},
        topic::CAMERA_DETECTIONS,
    },
    referee::{EventKind, MatchAnalysis, MatchFrames, Rules, analyze},
    units::Nanos,
};
use std::{hint::black_box, path::Path, time::Duration};

const SECONDS: f64 = 3600.0;
const START: Nanos = Nanos(1_700_000_000_000_000_000);

fn write(game: &Game, path: &Path) {
    let create = RecordingWriter::create(path, ExistingFile::Replace, FlushPolicy::WhenFull);
    let mut writer = create.expect("the temporary folder can be written");
    let point = |place: Option<[f64; 2]>| place.map(|[x, y]| Point { x, y });
    for picture in &game.pictures {
        let capture = START.after_seconds(picture.time);
        let message = CameraDetections {
            capture_time_ns: capture.0,
            ball: point(picture.ball),
            left: point(picture.strikers[0]),
            right: point(picture.strikers[1]),
            ..CameraDetections::default()
        };
        writer
            .write(CAMERA_DETECTIONS, capture.after_seconds(0.005), &message)
            .expect("the temporary folder can be written");
    }
    writer.finish().expect("the temporary folder can be written");
}

/// True goals before the last second, which nobody can decide yet.
fn check(game: &Game, analysis: &MatchAnalysis) {
    let goals = game.truths.iter().filter(|truth| matches!(truth.what, What::Goal(_)));
    let wanted = goals.filter(|truth| truth.time < SECONDS - 1.0).count();
    let found = analysis.events.iter().filter(|event| event.kind == EventKind::Goal);
    let found = found.filter(|event| event.time < SECONDS - 1.0).count();
    assert!(wanted.abs_diff(found) <= wanted / 100 + 1, "{found} goals, {wanted} happened");
}

fn hour(criterion: &mut Criterion) {
    let game = play(5000, SECONDS, CAMERA);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("hour.mcap");
    write(&game, &path);
    let read_and_judge = || {
        let tape = MatchFrames::open(&path).expect("a recording just written");
        analyze(&tape.frames, &tape.rules(&Rules::default()))
    };
    check(&game, &read_and_judge());
    let mut group = criterion.benchmark_group("referee");
    group.sample_size(10).measurement_time(Duration::from_secs(30));
    group.throughput(Throughput::Elements(game.pictures.len() as u64));
    group.bench_function("one_hour", |bencher| bencher.iter(|| black_box(read_and_judge())));
    group.finish();
}

criterion_group!(benches, hour);
criterion_main!(benches);
